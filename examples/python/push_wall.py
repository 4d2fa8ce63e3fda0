"""A motion by gradients through contact: a tip that is to stand on a spot of a wall, at rest, after 0.4 s.

    pip install ".[torch,plot]"
    python examples/python/push_wall.py --out push_wall

The spot is where the tip leans on the wall at rest under some command. Given that command at once, the robot reaches the wall
elsewhere and creeps to the spot along it, held back by friction. `tdcr.torch.rollout(scene=...)` has the contacts in its
gradient: Adam finds commands at eight knots in time that bring the tip to the spot, and let it rest there, by the distance of
the tip and its speed over the last tenth of the motion.

Writes push_wall.png and push_wall.json to the folder.

Caption of the figure: Left: paths of the tip in the plane of the wall, under the command of the spot (grey) and under the
commands that were found (blue), thick where the robot touches the wall; the spot is black. Right: distance of the tip from the
spot over time.
"""

import argparse
import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import torch

import tdcr
import tdcr.plot
from tdcr.torch import rollout

STEPS, SKIP, KNOTS = 100, 2, 8
"""Commands of 4 ms each, two time steps; knots between which they are linear."""
LEANING = np.array([0.03, 0.008, 0.014, 0.03, 0.015, 0.019])
"""The command (m) under which the tip leans on the spot."""


def between_knots() -> torch.Tensor:
    """Shares of the knots in each command, shape (STEPS, KNOTS)."""
    places = np.linspace(0.0, KNOTS - 1.0, STEPS)
    return torch.from_numpy(np.maximum(0.0, 1.0 - np.abs(places[:, None] - np.arange(KNOTS))))


def optimise(
    robot: tdcr.Robot, scene: tdcr.Scene, start: tdcr.Equilibrium, goal: tdcr.Equilibrium, rounds: int
) -> tuple[np.ndarray, list[float]]:
    """Commands of the motion (m), shape (STEPS, tendons), and the cost of each round."""
    low, high = (torch.from_numpy(limit) for limit in robot.command_ranges.T)
    shares, spot = between_knots(), torch.from_numpy(goal.tip)
    command = torch.from_numpy(LEANING)
    # Any real number is a command within the range.
    free = torch.logit((command - low) / (high - low)).repeat(KNOTS, 1).requires_grad_()
    optimizer = torch.optim.Adam([free], lr=0.1)
    configuration, costs = torch.from_numpy(start.configuration), []
    for _ in range(rounds):
        optimizer.zero_grad()
        commands = shares @ (low + (high - low) * torch.sigmoid(free))
        positions, _, _ = rollout(robot, commands, configuration, scene=scene, frame_skip=SKIP)
        last = positions[-STEPS // 10 :, -1]
        # In cm, and of speeds in cm for each command.
        cost = 1e4 * (last - spot).square().sum(dim=1).mean() + 1e6 * last.diff(dim=0).square().sum(dim=1).mean()
        cost.backward()
        optimizer.step()
        costs.append(cost.item())
    return commands.detach().numpy(), costs


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--out", type=Path, default=Path("push_wall"), help="folder of the results")
    parser.add_argument("--short", action="store_true", help="few rounds, for a quick look")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    robot = tdcr.Robot("2m")
    wall = tdcr.Obstacle.box("wall", (0.1, 1.0, 1.0), position=(-0.1, 0.0, 0.5), friction=0.3, compliance=1e-4)
    scene = tdcr.Scene([wall])
    start = tdcr.settle(robot, robot.mean_command)
    goal = tdcr.settle(robot, LEANING, scene=scene).check()
    commands, costs = optimise(robot, scene, start, goal, rounds=5 if args.short else 200)

    motions = [
        tdcr.simulate(robot, of_steps, start=start, scene=scene, frame_skip=SKIP)
        for of_steps in (np.tile(LEANING, (STEPS, 1)), commands)
    ]
    figure, (plane, history) = plt.subplots(1, 2, figsize=(8.0, 3.6), layout="constrained")
    result: dict[str, object] = {"costs": costs}
    for motion, color, name in zip(motions, ("0.6", tdcr.plot.COLORS[0]), ("command of the spot", "found"), strict=True):
        away = 1e3 * np.linalg.norm(motion.tip - goal.tip, axis=1)
        speed = 1e3 * np.linalg.norm(np.diff(motion.tip[-2:], axis=0)) / (motion.times[-1] - motion.times[-2])
        print(f"{name}: tip {away[-1]:.2f} mm from the spot at the end, at {speed:.1f} mm/s")
        result[name] = {"distance_mm": away[-1], "speed_mm_s": speed}
        assert motion.contacts is not None, "the motion is among obstacles"
        touching = np.where(np.isin(np.arange(STEPS), motion.contacts.row), 1.0, np.nan)
        plane.plot(*(1e3 * motion.tip.T[1:]), color=color, linewidth=1)
        plane.plot(*(1e3 * motion.tip.T[1:] * touching), color=color, linewidth=3)
        history.plot(motion.times, away, color=color, label=name)
    plane.plot(*(1e3 * goal.tip[1:]), "o", color="black", markersize=5)
    plane.set(xlabel="y (mm)", ylabel="z (mm)", aspect="equal")
    history.set(xlabel="time (s)", ylabel="tip from the spot (mm)", ylim=(0, None))
    history.legend(frameon=False)
    figure.savefig(args.out / "push_wall.png", dpi=100)
    (args.out / "push_wall.json").write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()

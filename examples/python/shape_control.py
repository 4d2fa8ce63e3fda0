"""The command for a whole shape, by gradients: a robot is bent into an arc while it carries a payload.

    pip install ".[torch,plot]"
    python examples/python/shape_control.py --out shape_control

`tdcr.torch.settle` is an operator of PyTorch: any cost of the discs' poses can be minimised by any optimiser, or be a layer
of a network. Here L-BFGS minimises the mean squared distance of the discs from their places on the arc, from the best of
256 random commands. For targets of discs alone `tdcr.inverse.shape` does the same with less work, and says whether they can
be reached; the script prints what both find.

Writes shape_control.png and shape_control.json to the folder.

Caption of the figure: Left: the robot 2m with a payload of 10 g under the command that was found (blue), the places of its
discs on the arc (black dots), and the robot under the mean command (grey). Right: distance of the discs from the arc, root
mean square, after each evaluation of the cost.
"""

import argparse
import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import torch

import tdcr
import tdcr.plot
from tdcr.torch import settle


def arc(robot: tdcr.Robot, bend: float, direction: float) -> np.ndarray:
    """Places of the discs on an arc that leaves the base upwards and turns by ``bend`` (rad), shape (n, 3) (m)."""
    base = np.array(robot.to_dict()["base"]["position"])
    along = robot.straight_positions[:, 2] - base[2]
    angles, radius = bend * along / along[-1], along[-1] / bend
    sideways = radius * (1.0 - np.cos(angles))
    up = radius * np.sin(angles)
    return base + np.stack([sideways * np.cos(direction), sideways * np.sin(direction), up], axis=1)


def mean_square(positions: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    """Mean squared distance of the discs from their targets, shape (...) (m²), from positions of shape (..., n, 3)."""
    return (positions - target).square().sum(dim=-1).mean(dim=-1)


def reach(robot: tdcr.Robot, target: np.ndarray, payload: float, steps: int) -> tuple[np.ndarray, list[float]]:
    """The command (m) whose shape is nearest to the target, and the distance (m) after each evaluation."""
    low, high = (torch.from_numpy(limit) for limit in robot.command_ranges.T)
    wanted = torch.from_numpy(target)
    # The best of some random commands to start from: one batch.
    commands = torch.from_numpy(robot.random_commands(256))
    start = commands[mean_square(settle(robot, commands, payload)[0], wanted).argmin()]
    # Any real number is a command within the range.
    free = torch.logit((start - low) / (high - low)).requires_grad_()
    optimizer = torch.optim.LBFGS([free], lr=0.5, max_iter=steps, line_search_fn="strong_wolfe", tolerance_change=1e-12)
    distances = []

    def cost() -> torch.Tensor:
        optimizer.zero_grad()
        positions, _ = settle(robot, low + (high - low) * torch.sigmoid(free), payload)
        # In cm², as the optimiser's tolerances are absolute.
        squared = 1e4 * mean_square(positions, wanted)
        squared.backward()
        distances.append(1e-2 * squared.item() ** 0.5)
        return squared

    optimizer.step(cost)
    return (low + (high - low) * torch.sigmoid(free)).detach().numpy(), distances


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--out", type=Path, default=Path("shape_control"), help="folder of the results")
    parser.add_argument("--bend", type=float, default=90.0, help="angle that the arc turns by (degrees)")
    parser.add_argument("--direction", type=float, default=30.0, help="direction that it bends to, from the x axis (degrees)")
    parser.add_argument("--payload", type=float, default=0.01, help="mass on the tip (kg)")
    parser.add_argument("--short", action="store_true", help="few steps, for a quick look")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    robot = tdcr.Robot("2m")
    target = arc(robot, np.radians(args.bend), np.radians(args.direction))
    command, distances = reach(robot, target, args.payload, steps=30 if args.short else 100)
    settled = tdcr.settle(robot, command, args.payload).check()
    rms = np.sqrt(np.square(settled.positions - target).sum(axis=1).mean())

    targets = [tdcr.inverse.Target(disc, position) for disc, position in enumerate(target)]
    solved = tdcr.inverse.shape(robot, targets, args.payload)
    rms_solved = np.sqrt(np.square(solved.equilibrium.positions - target).sum(axis=1).mean())
    print(f"best of 256 commands: discs {1e3 * distances[0]:.2f} mm from the arc (root mean square)")
    print(f"gradients in PyTorch: {1e3 * rms:.2f} mm after {len(distances)} evaluations")
    print(f"tdcr.inverse.shape: {1e3 * rms_solved:.2f} mm, {solved.outcome}")

    figure = plt.figure(figsize=(8.0, 3.6), layout="constrained")
    space = figure.add_subplot(1, 2, 1, projection="3d")
    start = tdcr.settle(robot, robot.mean_command, args.payload)
    tdcr.plot.robot(space, robot, start, color="0.7", alpha=0.1, tendons=False)
    tdcr.plot.robot(space, robot, settled, color=tdcr.plot.COLORS[0], tendons=False)
    space.plot(*(1e3 * target).T, "o", color="black", markersize=3, zorder=10)
    history = figure.add_subplot(1, 2, 2)
    history.plot(range(1, len(distances) + 1), 1e3 * np.array(distances), color=tdcr.plot.COLORS[0])
    history.set(xlabel="evaluation of the cost", ylabel="distance from the arc (mm)", ylim=(0, None))
    figure.savefig(args.out / "shape_control.png", dpi=100)
    result = {"command_m": command.tolist(), "rms_m": rms, "rms_start_m": distances[0], "rms_inverse_shape_m": rms_solved}
    (args.out / "shape_control.json").write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()

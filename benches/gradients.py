"""What derivatives cost beside what they are derivatives of, on one thread.

    python benches/gradients.py

A line for each robot: the time of one equilibrium; as multiples of it, that of the gradient of a cost by all commands and forces,
and what each dimension or density of the robot adds to it; the time of a motion of 100 steps; as multiples of it, that of its
gradient and of its tangent. Then those of a motion whose tip leans on a wall with friction, with its contacts, and in water.
"""

import timeit
from collections.abc import Callable

import numpy as np

import tdcr

ROWS, STEPS = 50, 100


def seconds(call: Callable[[], object]) -> float:
    """Shortest time of a call."""
    call()
    return min(timeit.repeat(call, number=1, repeat=10))


def equilibria(robot: tdcr.Robot) -> str:
    """Time of one, and of its gradients."""
    rows, by = robot.random_commands(ROWS), np.ones((ROWS, robot.discs, 3))
    names = [f"command[{tendon}]" for tendon in range(robot.tendons)]
    names += [f"force[{disc}].{axis}" for disc in range(robot.discs) for axis in "xyz"]
    laid_out = [name for name in tdcr.parameters(robot).names if name.startswith(("pitch", "density", "hole["))]
    settle = seconds(lambda: tdcr.settle_batch(robot, rows))
    gradient = seconds(lambda: tdcr.vjp(robot, rows, names, by))
    each = (seconds(lambda: tdcr.vjp(robot, rows, names + laid_out, by)) - gradient) / len(laid_out)
    return f"{settle / ROWS * 1e6:11.0f}   {gradient / settle:12.1f}   {each / settle:14.2f}"


def motions(robot: tdcr.Robot) -> str:
    """Time of one, and of its derivatives."""
    start = tdcr.State(tdcr.settle(robot, robot.mean_command).configuration)
    ramp = np.linspace(robot.mean_command, robot.random_commands(1)[0], STEPS)[np.newaxis]
    weights, rates = np.ones((1, STEPS, robot.discs, 3)), tdcr.RolloutRates(commands=np.ones_like(ramp))
    motion = seconds(lambda: tdcr.rollout(robot, ramp, start=start))
    gradient = seconds(lambda: tdcr.rollout_vjp(robot, ramp, weights, start=start))
    tangent = seconds(lambda: tdcr.rollout_jvp(robot, ramp, rates, start=start))
    return f"{motion * 1e6:11.0f}   {gradient / motion:12.1f}   {tangent / motion:11.0f}"


def among(robot: tdcr.Robot, scene: tdcr.Scene | None) -> str:
    """Time of a motion that begins where the robot has come to lean on something, and of its gradient."""
    bent = np.array([0.034, 0.007, 0.001, 0.026, 0.015, 0.019] + [0.02] * (robot.tendons - 6))
    start = tdcr.simulate(robot, np.tile(bent, (500, 1)), scene=scene).end
    hold = np.tile(bent, (1, STEPS, 1))
    touched = tdcr.simulate(robot, hold[0], scene=scene, start=start).contacts
    weights = np.ones((1, STEPS, robot.discs, 3))
    motion = seconds(lambda: tdcr.rollout(robot, hold, start=start, scene=scene))
    gradient = seconds(lambda: tdcr.rollout_vjp(robot, hold, weights, start=start, scene=scene))
    contacts = 0.0 if touched is None else len(touched) / STEPS
    return f"{contacts:8.1f}   {motion * 1e6:11.0f}   {gradient / motion:12.1f}"


def main() -> None:
    tdcr.set_threads(1)
    print("robot   settle (us)   its gradient   each dimension   motion (us)   its gradient   its tangent")
    for name in ("2m", "3m", "5m"):
        robot = tdcr.Robot(name)
        print(f"{name:<5}   {equilibria(robot)}   {motions(robot)}")
    wall = tdcr.Obstacle.box("wall", (0.1, 1.0, 1.0), position=(-0.08, 0.0, 0.5), friction=0.3)
    water = {"fluid": {"density": 998.0, "drag_coefficient": 1.1}}
    print("robot                contacts   motion (us)   its gradient")
    for name in ("2m", "3m", "5m"):
        robot = tdcr.Robot(name)
        print(f"{name:<5} at a wall      {among(robot, tdcr.Scene([wall]))}")
        print(f"{name:<5} in water       {among(tdcr.Robot(robot.to_dict() | water), None)}")


if __name__ == "__main__":
    main()

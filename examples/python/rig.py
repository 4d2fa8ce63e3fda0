"""Bends a robot to three sides and measures its tip, on whatever rig a file names: in memory or on the desk.

    python rig.py [FILE]

Nothing here knows what the rig consists of. With your own file in place of rig-sim.toml (rig-2m.toml is a template), the same
program moves real servos. It asks the simulator for commands, and compares where the cameras see the tip with where it should be.
"""

import argparse
from pathlib import Path

import numpy as np

import tdcr


def sides(robot: tdcr.Robot, home: np.ndarray, pull: float):
    """Commands that wind the last module's tendons up by at most ``pull`` (m), as a bend to each of three sides takes."""
    for side in range(3):
        turn = 2.0 * np.pi * (np.arange(3) - side) / 3.0
        command = home.copy()
        command[-3:] -= pull * np.cos(turn)
        yield 120 * side, command


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", nargs="?", type=Path, default=Path(__file__).parents[1] / "rig-sim.toml")
    parser.add_argument("--pull", type=float, default=0.004, help="how far tendons are wound up (m, %(default)s)")
    options = parser.parse_args(arguments)
    with tdcr.Rig(options.file) as rig:
        if set(rig.homing()) != {"homed"}:
            # Servos without power forget their turns.
            rig.home(recall=True)
        rig.engage()
        rig.go_home()
        home = rig.commanded
        for degrees, command in sides(rig.robot, home, options.pull):
            rig.move_to(command)
            for _ in range(20):
                states = rig.step(command)
            tip = rig.measure().tip
            expected = tdcr.settle(rig.robot, command).tip
            ticks = " ".join(f"{state.position:5}" for state in states)
            off = 1e3 * np.linalg.norm(tip - expected)
            x, y, z = 1e3 * tip
            print(
                f"tendon at {degrees:3} degrees: servos at {ticks} ticks, tip at ({x:.1f}, {y:.1f}, {z:.1f}) mm, {off:.1f} mm off"
            )
            rig.go_home()


if __name__ == "__main__":
    main()

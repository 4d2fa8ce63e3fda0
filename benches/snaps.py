"""Where a robot snaps: how far its tip moves under one gram more, and under noise on its tendons.

    .venv/bin/python benches/snaps.py --robot 5m --payload 0.03 [--worst scores.json]

Prints quantiles of the tip's displacement (mm) under one gram more, over 2,000 random commands, each with a random payload up to
a gram below --payload (kg), and the share of tips that move by more than 100 mm. For each of the worst commands that `tdcr eval
--worst N --json` wrote into a file, it prints the same over 200 draws of normal noise of half a millimetre on every tendon.
"""

import argparse
import json
import pathlib

import numpy as np

import tdcr

COMMANDS, DRAWS = 2000, 200
GRAM, NOISE, JUMP = 1e-3, 0.5e-3, 0.1  # kg, m, m


def row(name: str, before: np.ndarray, after: np.ndarray) -> str:
    moved = np.linalg.norm(after - before, axis=1)
    median, high, most = 1e3 * np.quantile(moved, [0.5, 0.99, 1.0])
    return f"| {name} | {median:.1f} | {high:.1f} | {most:.0f} | {100 * (moved > JUMP).mean():.1f} % |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--robot", default="5m", help="built-in robot or file")
    parser.add_argument("--payload", type=float, default=0.03, metavar="KG", help="heaviest payload, at least a gram [0.03]")
    parser.add_argument("--worst", type=pathlib.Path, metavar="FILE", help="what `tdcr eval --json` printed")
    args = parser.parse_args()
    if not args.payload >= GRAM:
        parser.error(f"--payload is {args.payload:g} kg, expected at least {GRAM:g}")
    try:
        worst_commands = json.loads(args.worst.read_text())["worst"] if args.worst else []
    except (OSError, ValueError, KeyError, TypeError) as error:
        parser.error(f"--worst {args.worst}: {error!r}, expected what `tdcr eval --worst N --json` prints")
    robot = tdcr.Robot(args.robot)
    rng = np.random.default_rng(1)

    def tips(commands: np.ndarray, payloads: np.ndarray) -> np.ndarray:
        return tdcr.settle_batch(robot, commands, payloads).tips

    print("| tip's displacement (mm) | median | 99 % | most | above 100 mm |\n|---|---|---|---|---|")
    commands = robot.random_commands(COMMANDS, seed=1)
    payloads = rng.uniform(0.0, args.payload - GRAM, COMMANDS)
    print(row("one gram more", tips(commands, payloads), tips(commands, payloads + GRAM)))
    low, high = robot.command_ranges.T
    for worst in worst_commands:
        noise = rng.normal(0.0, NOISE, (DRAWS, len(low)))
        commands = np.clip(np.asarray(worst["command"]) + noise, low, high)
        before = tips(np.asarray([worst["command"]]), np.asarray([worst["payload"]]))
        print(row(f"noise at test {worst['test']}", before, tips(commands, np.full(DRAWS, worst["payload"]))))


if __name__ == "__main__":
    main()

"""How far does a payload bend the tip down? Deflections of the paper's three robots, over random commands.

    pip install ".[plot]"
    python examples/python/payload_sweep.py --out payload_sweep

Writes payload_sweep.png and payload_sweep.csv to the folder, and prints the table.

Caption of the figure: Distance between the tip with a payload and the tip without one, under the same command. Lines:
median over 1,000 commands drawn uniformly from the tendons' ranges; bands: the middle 50 % and 90 % of the commands.
Commands under which the robot does not settle with every payload are left out.
"""

import argparse
import csv
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import tdcr
import tdcr.plot

ROBOTS = ("2m", "3m", "5m")
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


def deflections(robot: tdcr.Robot, commands: np.ndarray, payloads: np.ndarray) -> np.ndarray:
    """Distances of the tip from its place without payload, shape (commands, payloads) (m); the first payload is 0."""
    # Every command with every payload: all rows in one call, on all cores.
    rows = np.repeat(commands, len(payloads), axis=0)
    settled = tdcr.settle_batch(robot, rows, np.tile(payloads, len(commands)))
    tips = settled.tips.reshape(len(commands), len(payloads), 3)
    whole = settled.converged.reshape(len(commands), len(payloads)).all(axis=1)
    return np.linalg.norm(tips - tips[:, :1], axis=2)[whole]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--out", type=Path, default=Path("payload_sweep"), help="folder of the results")
    parser.add_argument("--commands", type=int, default=1000, help="random commands of each robot")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--short", action="store_true", help="few commands and payloads, for a quick look")
    args = parser.parse_args()
    payloads = np.linspace(0.0, 0.03, 4 if args.short else 16)
    count = 50 if args.short else args.commands
    args.out.mkdir(parents=True, exist_ok=True)

    table = []
    figure, ax = plt.subplots(figsize=(5.5, 3.6), layout="constrained")
    for name, color in zip(ROBOTS, tdcr.plot.COLORS, strict=False):
        robot = tdcr.Robot(name)
        found = deflections(robot, robot.random_commands(count, args.seed), payloads)
        quantiles = np.quantile(found, QUANTILES, axis=0)
        table += [(name, len(found), p, *row) for p, row in zip(payloads, quantiles.T, strict=True)]
        grams, (q05, q25, median, q75, q95) = 1e3 * payloads, 1e3 * quantiles
        ax.fill_between(grams, q05, q95, color=color, alpha=0.15, linewidth=0)
        ax.fill_between(grams, q25, q75, color=color, alpha=0.3, linewidth=0)
        ax.plot(grams, median, color=color, label=name)
    ax.set(xlabel="payload (g)", ylabel="deflection of the tip (mm)", xlim=(0, 30), ylim=(0, None))
    ax.legend(title="robot", loc="upper left")
    figure.savefig(args.out / "payload_sweep.png", dpi=110)

    columns = ["robot", "commands", "payload_kg", *(f"q{100 * q:02.0f}_m" for q in QUANTILES)]
    with open(args.out / "payload_sweep.csv", "w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([columns, *table])
    for name, commands, payload, *quantiles in table:
        if payload == payloads[-1]:
            low, median, high = (f"{1e3 * quantiles[k]:.1f}" for k in (0, 2, 4))
            print(f"{name}: {1e3 * payload:.0f} g move the tip by {median} mm ({low} to {high}) over {commands} commands")


if __name__ == "__main__":
    main()

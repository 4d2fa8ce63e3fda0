"""A real robot calibrated on its recording, held against another one, with a page of paths, errors and residuals.

    python examples/python/real_robot.py --out real_robot

The recordings are in `examples/opencr`: motions of one and two segments to fit to, motions of all three to hold the calibrated
robot against. `OUT/real_robot.html` is the page, `OUT/calibrated.toml` the robot file, `OUT/real_robot.png` a figure of errors.
`--robot`, `--columns`, `--data` and `--validate` take a robot and recordings of your own.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

import tdcr
from tdcr.recordings import Replayed

OPENCR = Path(__file__).resolve().parents[1] / "opencr"

SHORT = 120
"""Rows of the table that the short mode fits to."""


def errors(recording: Replayed) -> NDArray[np.float64]:
    """What the calibrated robot misses in each row (mm), the mean offset taken off; without rows that say nothing."""
    misses = 1e3 * (recording.predicted - recording.measured)[:, 0]
    misses = misses[np.isfinite(misses).all(axis=1)]
    return np.asarray(np.linalg.norm(misses - misses.mean(axis=0), axis=1))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("real_robot"))
    parser.add_argument("--robot", default=str(OPENCR / "robot.toml"))
    parser.add_argument("--columns", type=Path, default=OPENCR / "columns.toml")
    parser.add_argument("--data", type=Path, default=OPENCR / "real_robot_v4_train.csv")
    parser.add_argument("--validate", type=Path, default=OPENCR / "real_robot_v4_val.csv")
    parser.add_argument("--short", action="store_true", help=f"fit few unknowns to {SHORT} rows: seconds")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)

    data, fit = args.data, None
    if args.short:
        data = args.out / "short.csv"
        lines = args.data.read_text().splitlines(keepends=True)
        data.write_text("".join(lines[: SHORT + 1]))
        fit = ["pretension", "stiffness", "base_pose"]
    page = args.out / "real_robot.html"
    found = tdcr.calibrate_recording(args.robot, data, args.columns, validate=args.validate, fit=fit, report=page)
    found.save(args.out / "calibrated.toml")

    figure, axes = plt.subplots(figsize=(6.4, 3.4), layout="constrained")
    held = {"training": found.train} | ({"validation": found.validation} if found.validation else {})
    for name, recording in held.items():
        sizes = np.sort(errors(recording))
        axes.plot(sizes, np.linspace(0.0, 100.0, len(sizes)), label=f"{name}: {np.sqrt(np.mean(sizes**2)):.1f} mm rms")
        print(f"{name}: {np.sqrt(np.mean(sizes**2)):.2f} mm rms in {len(sizes)} rows")
    axes.set_xlabel("error of the tip (mm)")
    axes.set_ylabel("rows with no larger one (%)")
    axes.set_xlim(0.0)
    axes.legend()
    figure.savefig(args.out / "real_robot.png", dpi=150)

    told = [unknown for unknown in found.parameters if not unknown["prior_only"]]
    print(f"{len(found.parameters)} unknowns, of which the recording tells {len(told)}; see {page}")


if __name__ == "__main__":
    main()

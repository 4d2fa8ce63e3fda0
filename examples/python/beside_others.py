"""Robots of others, beside their own figures: a soft tentacle, a column that falls, a helical robot's hysteresis.

    pip install ".[plot]"
    python examples/python/beside_others.py --out beside_others

Writes beside_others.png and beside_others.json to the folder, and prints what docs/beside-others.md has in its tables.

Caption of the figure: Left: the tentacle's markers, measured (circles) and calibrated (the other end of each line), seen along x;
middle: the height of the column's tip; right: release minus pull of the helical robot's top, along its travel, by step.
"""

import argparse
import csv
import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

import tdcr
import tdcr.plot

EXAMPLES = Path(__file__).parents[1]
TENTACLE, DATA = EXAMPLES / "soromox_tentacle", EXAMPLES / "beside_others"
UNKNOWNS = ["stiffness", "hole_radius", "rest_bend", "mass", "base_pose", "marker_offset"]
PULL = 1e-3 * np.array([-7.5, 2.364, 1.482])
"""Change of the helical robot's three tendons at the last step (m), as one of its authors' scripts has it."""
STRAIGHT = 0.2487612
"""Length of its tendons when straight (m)."""
Floats = NDArray[np.float64]


def tentacle(out: Path, ax: Axes) -> dict[str, float]:
    """Calibrates the tentacle on its 22 poses, then on the 20 that its authors train on, for the two that they test on."""
    with open(TENTACLE / "poses.csv", encoding="utf-8") as file:
        header, *rows = list(csv.reader(file))
    split = header.index("network_split")
    paths = {name: out / f"tentacle_{name}.csv" for name in ("train", "test")}
    for name, path in paths.items():
        with open(path, "w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([header, *(row for row in rows if row[split] == name)])
    found: dict[str, float] = {}
    robot, columns, priors = (TENTACLE / f"{name}.toml" for name in ("robot", "columns", "priors"))
    for name, data in (("all", TENTACLE / "poses.csv"), ("held_out", paths["train"])):
        fit = tdcr.calibrate_recording(
            robot, data, columns, fit=UNKNOWNS, priors=priors, loss=1.0, validate=None if name == "all" else paths["test"]
        )
        shown = fit.train if fit.validation is None else fit.validation
        missed = np.linalg.norm(shown.predicted - shown.measured, axis=2)
        found |= {f"{name}_mean_mm": 1e3 * missed.mean(), f"{name}_rms_mm": 1e3 * np.sqrt((missed**2).mean())}
        if name == "all":
            found |= {f"p{i + 1}_mean_mm": 1e3 * m for i, m in enumerate(missed.mean(axis=0))}
            for i, color in enumerate(tdcr.plot.COLORS[:4]):
                ends = 1e3 * np.stack([shown.measured[:, i, 1:], shown.predicted[:, i, 1:]])
                ax.plot(*ends[0].T, "o", color=color, fillstyle="none", label=f"p{i + 1}")
                ax.plot(ends[..., 0], ends[..., 1], "-", color=color, linewidth=1.0)
    ax.set(xlabel="y (mm)", ylabel="z (mm)", title="tentacle: measured, calibrated", aspect="equal")
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return {key: float(value) for key, value in found.items()}


def fall(t: Floats, tip: Floats) -> dict[str, float]:
    """Growth rate of the deflection from 0.6 to 1.2 s (1/s), deflection at 1 s (m), lowest point (m) and its time (s)."""
    deflection, grows = np.hypot(tip[:, 0], tip[:, 1]), (t >= 0.6) & (t <= 1.2)
    lowest = int(tip[:, 2].argmin())
    return {
        "growth": float(np.polyfit(t[grows], np.log(deflection[grows]), 1)[0]),
        "deflection_1s": float(np.interp(1.0, t, deflection)),
        "z_1s": float(np.interp(1.0, t, tip[:, 2])),
        "lowest": float(tip[lowest, 2]),
        "lowest_at": float(t[lowest]),
    }


def column(dt: float, ax: Axes) -> dict[str, dict[str, float]]:
    """Lets the column fall, as a whole and with the first hundredth of its length held rigid, as a clamped element of 100 is; the
    mass is that of the whole."""
    commands = np.ones((round(3.0 / dt), 2))
    whole = tdcr.Robot(DATA / "column.toml")
    spec = whole.to_dict()
    module, short = spec["modules"][0], 0.99
    for length in ("first_offset", "pitch", "joint_below"):
        module[length] *= short
    module["rod"]["density"] /= short
    spec["base"]["position"] = [0.0, 0.0, 0.6 * (1.0 - short)]
    found = {}
    robots = {"tdcr": whole, "tdcr, first element rigid": tdcr.Robot.from_json(json.dumps(spec))}
    for name, robot in robots.items():
        motion = tdcr.simulate(robot, commands, dt=dt, integrator="implicit-midpoint")
        found[name] = fall(motion.times, motion.tip)
        ax.plot(motion.times, motion.tip[:, 2], label=name, linestyle="-" if robot is whole else "--")
    for name in ("SoRoSim", "SoRoMoX", "PyElastica"):
        t, *tip = np.loadtxt(DATA / f"column_{name.lower()}.csv", delimiter=",", skiprows=1).T
        found[name] = fall(t, np.array(tip).T)
        ax.plot(t, tip[2], label=name, linewidth=1.0)
    ax.set(xlabel="time (s)", ylabel="z of the tip (m)", title="a column that falls")
    ax.legend(loc="lower left", fontsize="small")
    return found


def loop(places: Floats) -> tuple[float, Floats]:
    """Travel to step 10 (mm), and release minus pull along it at steps 0 to 9 (mm), by the places at steps 0 to 10 and back."""
    whole = places[10] - places[0]
    along = 1e3 * (places - places[0]) @ whole / np.linalg.norm(whole)
    return float(along[10]), along[:10:-1] - along[:10]


def helical(ax: Axes) -> dict[str, dict[str, float]]:
    """Pulls the helical robot in ten steps and releases it, with the friction that its authors assume and with half of it."""
    steps = np.r_[0:11, 9:-1:-1] / 10.0
    spec = tdcr.Robot(DATA / "helical.toml").to_dict()
    found, loops = {}, {}
    for friction in (0.2, 0.1):
        for route in spec["routes"]:
            route["tendon"]["friction"]["coefficient"] = friction
        path = tdcr.FrictionPath(tdcr.Robot.from_json(json.dumps(spec)))
        states = path.follow(STRAIGHT + np.outer(steps, PULL))
        tops = [state.equilibrium.check() for state in states]
        loops[f"friction {friction}"] = loop(np.array([top.tip for top in tops]))
    with open(DATA / "helical_plateaus.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for run in ("T1", "T2"):
        loops[run] = loop(np.array([[float(row[a]) for a in "xyz"] for row in rows if row["run"] == run]))
    for name, (travel, width) in loops.items():
        mean = float(width[1:].mean())
        found[name] = {"travel_mm": travel, "mean_mm": mean, "share": mean / travel, "widest_at": int(np.abs(width).argmax())}
        ax.plot(range(10), width, "o-" if name.startswith("T") else "--", label=name)
    ax.set(xlabel="step", ylabel="release minus pull (mm)", title="helical robot: the loop")
    ax.legend()
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--out", type=Path, default=Path("beside_others"), help="folder of the results")
    parser.add_argument("--short", action="store_true", help="longer time steps, for a quick look")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    figure, axes = plt.subplots(1, 3, figsize=(13.0, 4.2), layout="constrained")
    missed = tentacle(args.out, axes[0])
    motions = {"column": column(0.004 if args.short else 0.002, axes[1]), "helical": helical(axes[2])}
    figure.savefig(args.out / "beside_others.png", dpi=80)
    (args.out / "beside_others.json").write_text(json.dumps({"tentacle": missed} | motions, indent=2) + "\n", encoding="utf-8")
    print("tentacle:", ", ".join(f"{key} {value:.1f}" for key, value in missed.items()))
    for name, robots in motions.items():
        for of, facts in robots.items():
            print(f"{name}, {of}:", ", ".join(f"{key} {value:.4g}" for key, value in facts.items()))


if __name__ == "__main__":
    main()

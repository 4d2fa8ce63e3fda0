"""How far are robots off that are built like each other, but not quite? Tips of 2,000 variations of a robot.

    pip install ".[plot]"
    python examples/python/domain_randomisation.py --out domain_randomisation

Gains of all tendons, densities, radii of the holes and the spacing of the discs of all modules, and the radius of the base's
holes are drawn from normal distributions; each row of a batch is a robot of its own. Beside it stands what the Jacobian says of
the spread, without a single further robot: a covariance J S J', with S the variances of the parameters. Training data for a
policy or a network that is to work on a real robot can be randomised the same way.

Writes domain_randomisation.png and domain_randomisation.json to the folder.

Caption of the figure: Tips of 2,000 variations of the robot 2m (gain 2 %, density 5 %, radius of the holes 1 %, spacing 0.5
%, as standard deviations) under four commands, in the vertical plane x, z. Ellipses: two standard deviations by the
Jacobian of the robot without errors.
"""

import argparse
import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Ellipse

import tdcr
import tdcr.plot

SPREAD = {"gain": 0.02, "density": 0.05, "hole_radius": 0.01, "pitch": 0.005}
"""Relative standard deviations of what varies."""


def parameters(robot: tdcr.Robot) -> dict[str, float]:
    """Names of what varies, with relative standard deviations: of every tendon, every module, and the holes of the base."""
    kinds = {parameter.name: parameter.name.partition("[")[0] for parameter in tdcr.parameters(robot)}
    return {name: SPREAD[kind] for name, kind in kinds.items() if kind in SPREAD}


def variations(robot: tdcr.Robot, spread: dict[str, float], count: int, rng: np.random.Generator) -> list[tdcr.Robot]:
    """Robots whose parameters are drawn about those of ``robot``."""
    means = np.array([robot.value(name) for name in spread])
    values = means * (1.0 + np.array(list(spread.values())) * rng.normal(size=(count, len(spread))))
    return [robot.with_values(dict(zip(spread, row, strict=True))) for row in values]


def covariance(robot: tdcr.Robot, spread: dict[str, float], command: np.ndarray) -> np.ndarray:
    """Covariance of the tip to first order, shape (3, 3) (m²)."""
    deviations = [spread[name] * robot.value(name) for name in spread]
    by_parameters = tdcr.jacobian(robot, command, list(spread))[-1, :3]
    return (by_parameters * np.square(deviations)) @ by_parameters.T


def ellipse(centre: np.ndarray, covariance: np.ndarray) -> Ellipse:
    """Two standard deviations about a centre, in a plane."""
    variances, axes = np.linalg.eigh(covariance)
    width, height = 4.0 * np.sqrt(variances)
    angle = np.degrees(np.arctan2(axes[1, 0], axes[0, 0]))
    return Ellipse(tuple(centre), width, height, angle=angle, fill=False, color="black", linewidth=0.8)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--out", type=Path, default=Path("domain_randomisation"), help="folder of the results")
    parser.add_argument("--robot", default="2m", help="a name, or a robot file")
    parser.add_argument("--robots", type=int, default=2000, help="variations of it")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--short", action="store_true", help="few variations, for a quick look")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    robot = tdcr.Robot(args.robot)
    spread = parameters(robot)
    several = variations(robot, spread, 200 if args.short else args.robots, np.random.default_rng(args.seed))

    figure, ax = plt.subplots(figsize=(5.5, 3.9), layout="constrained")
    results = []
    for k, command in enumerate(robot.random_commands(4, args.seed)):
        settled = tdcr.settle_batch(several, np.tile(command, (len(several), 1)))
        tips, centre = settled.tips[settled.converged], tdcr.settle(robot, command).check().tip
        expected = covariance(robot, spread, command)
        tdcr.plot.workspace(ax, tips, color=tdcr.plot.COLORS[k], size=1.5, label=f"command {k}")
        ax.add_patch(ellipse(1e3 * centre[[0, 2]], 1e6 * expected[np.ix_([0, 2], [0, 2])]))
        result = {
            "command": command.tolist(),
            "settled": len(tips),
            "tip_m": centre.tolist(),
            "deviation_m": tips.std(axis=0).tolist(),
            "deviation_by_jacobian_m": np.sqrt(np.diag(expected)).tolist(),
        }
        results.append(result)
        x, y, z = 1e3 * tips.std(axis=0)
        print(f"command {k}: {len(tips)} of {len(several)} settle; standard deviation of the tip {x:.1f}, {y:.1f}, {z:.1f} mm")
    ax.legend(markerscale=5, fontsize="small", loc="lower right")
    figure.savefig(args.out / "domain_randomisation.png", dpi=110, bbox_inches="tight")
    (args.out / "domain_randomisation.json").write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()

"""From a simulated robot to a network that predicts its shape: collect, train, predict, score.

    pip install ".[plot]"
    python examples/python/flow_model.py --out flow_model        # about as long as make demo

The steps of `make demo`, in Python. Each can be interrupted: the same command goes on where it stopped.

Writes the data set, the training run, flow_model.png and flow_model.json to the folder.

Caption of the figure: Left: cloud of a test command, which the network has not seen, by the cameras (grey), and the cloud
that it predicts (colours: uncertainty of each point). Right: loss of each training step, and the Chamfer distance on the
validation split.
"""

import argparse
import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import tdcr
import tdcr.plot


def figure_of(data: tdcr.Dataset, run: tdcr.Run, sample: tdcr.Sample) -> plt.Figure:
    """The prediction for a sample beside its cloud, and how the training went."""
    predicted = run.predictor.clouds(sample.condition, points=min(data.points, 4000), uncertainty=True)
    figure = plt.figure(figsize=(9.0, 4.2), layout="constrained")
    grid = figure.add_gridspec(1, 2, width_ratios=[1.2, 1.0])
    space = figure.add_subplot(grid[0], projection="3d")
    tdcr.plot.cloud(space, sample.points[:4000], color="0.75", size=0.5)
    points = tdcr.plot.cloud(space, predicted.points[0], values=1e3 * predicted.uncertainty[0], size=1.5)
    figure.colorbar(points, ax=space, label="uncertainty (mm)", shrink=0.6, pad=0.1)
    # Few ticks, so that their labels do not meet on the short axes.
    space.locator_params(axis="x", nbins=3)
    space.locator_params(axis="y", nbins=3)
    space.zaxis.labelpad = 8
    loss = figure.add_subplot(grid[1])
    loss.semilogy(np.arange(1, run.steps + 1), run.losses, color=tdcr.plot.COLORS[0], linewidth=0.5)
    loss.set(xlabel="step", ylabel="loss")
    distance = loss.twinx()
    distance.semilogy(run.validation_steps, run.validation_cd, "o-", color=tdcr.plot.COLORS[1], markersize=3)
    distance.set_ylabel("Chamfer distance, validation (m²)", color=tdcr.plot.COLORS[1])
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--out", type=Path, default=Path("flow_model"), help="folder of the results")
    parser.add_argument("--robot", default="2m", help="a name, or a robot file")
    parser.add_argument("--samples", type=int, default=2000, help="commands: 80 %% train, 10 %% validation, 10 %% test")
    parser.add_argument("--short", action="store_true", help="few samples, a tiny network, seconds")
    args = parser.parse_args()
    if args.short:
        size = {"samples": 60, "points": 500}
        network = {"width": 32, "depth": 3, "embedding": 32, "steps": 150, "clouds": 16, "points": 64, "validate_every": 50}
        # What pays in long runs costs short ones.
        network |= {"octaves": 0, "late_times": 0.0, "prior_cut": 0.0}
        scored = {"points": 400, "emd_points": 50}
    else:
        size, network, scored = {"samples": args.samples}, {}, {}

    # Random commands, settled and seen by the robot's ring of cameras.
    data = tdcr.collect(args.robot, args.out / "data", **size)
    print(data)
    # Action-conditioned flow matching: noise flows to the points of the cloud of a command.
    run = tdcr.train(data, args.out / "run", **network)
    print(run)
    # A condition is a command (m), in a data set with payloads followed by the payload (kg). These are new to the network.
    scores = tdcr.evaluate(run.predictor, data, **scored)
    for name, key in (("network", "cd"), ("nearest training command", "cd_nearest"), ("sampling floor", "cd_floor")):
        print(f"Chamfer distance, {name}: {1e4 * scores[key]:.3f} cm²")

    figure = figure_of(data, run, data.test[0])
    figure.savefig(args.out / "flow_model.png", dpi=100)
    (args.out / "flow_model.json").write_text(json.dumps(scores, indent=1))


if __name__ == "__main__":
    main()

"""Measures `Predictor.reach`: how near to wanted clouds a trained model's commands lead, from the mean command.

The wanted clouds are those of a data set's test split. For each the model looks for a command in 20 steps; then the model's
cloud for it is compared with the wanted one, and, where the data is simulated, the robot itself is settled under the command
and its tip compared with that under the command of the set. Distances are means over both clouds' points, both ways.

    tdcr demo --out demo_out
    python benches/reach_clouds.py demo_out/run demo_out/data
"""

import argparse
import time

import numpy as np

import tdcr


def main() -> None:
    """Prints quantiles over the clouds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run")
    parser.add_argument("data")
    parser.add_argument("--clouds", type=int, default=50)
    parser.add_argument("--steps", type=int, default=20)
    args = parser.parse_args()
    predictor, test = tdcr.Predictor(args.run), tdcr.Dataset(args.data).test
    count = min(args.clouds, len(test))
    first, last, tips, seconds = [], [], [], []
    for k in range(count):
        cloud, condition = test[k].points, test[k].condition.astype(float)
        began = time.perf_counter()
        found = predictor.reach(cloud, steps=args.steps)
        seconds.append(time.perf_counter() - began)
        first.append(1e3 * found.distances[0])
        last.append(1e3 * found.distances[-1])
        if predictor.robot is not None:
            tendons = predictor.robot.tendons
            # Single precision may lead past the ends of ranges by a last digit.
            low, high = np.transpose(predictor.robot.command_ranges)
            asked = [np.clip(command[:tendons], low, high) for command in (found.condition, condition)]
            tip = [tdcr.settle(predictor.robot, command).tip for command in asked]
            tips.append(1e3 * np.linalg.norm(tip[0] - tip[1]))
    print(f"{count} clouds, {args.steps} steps, {np.median(seconds):.2f} s each")
    for name, values in (("mean distance at first", first), ("mean distance", last), ("tip from the wanted one's", tips)):
        if values:
            low, middle, high = np.quantile(values, [0.0, 0.5, 1.0])
            within = np.mean(np.array(values) <= 2.0)
            spread = f"{low:.2f} to {high:.2f}, median {middle:.2f}"
            print(f"{name}: mean {np.mean(values):.2f} mm, {spread}; {100 * within:.0f} % within 2 mm")


if __name__ == "__main__":
    main()

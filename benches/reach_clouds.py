"""Measures `Predictor.reach`: how near to wanted clouds a trained model's commands lead, from the mean command.

The wanted clouds are those of a data set's test split. For each the model looks for a command in 20 steps; then the model's
cloud for it is compared with the wanted one, and, where the data is simulated, the robot itself is settled under the command
and its tip compared with that under the command of the set. Distances are means over both clouds' points, both ways. What no
command leads below is printed beside them: the distance of the model's cloud for the set's own command and, of a perfect model,
that of two samples of the same surface.

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
    parser.add_argument("--points", type=int, default=2048, help="of predicted clouds")
    args = parser.parse_args()
    predictor, test = tdcr.Predictor(args.run), tdcr.Dataset(args.data).test
    count = min(args.clouds, len(test))
    first, last, own, floor, tips, seconds = [], [], [], [], [], []
    for k in range(count):
        cloud, condition = test[k].points, test[k].condition.astype(float)
        began = time.perf_counter()
        found = predictor.reach(cloud, steps=args.steps, points=args.points)
        seconds.append(time.perf_counter() - began)
        first.append(1e3 * found.distances[0])
        last.append(1e3 * found.distances[-1])
        there = predictor.reach(cloud, start=condition, steps=0, points=args.points)
        own.append(1e3 * there.distances[-1])
        again = predictor.clouds([condition], len(cloud), seed=1).points[0]
        floor.append(1e3 * predictor.reach(again, start=condition, steps=0, points=args.points).distances[-1])
        if predictor.robot is not None:
            tendons = predictor.robot.tendons
            # Single precision may lead past the ends of ranges by a last digit.
            low, high = np.transpose(predictor.robot.command_ranges)
            asked = [np.clip(command[:tendons], low, high) for command in (found.condition, condition)]
            tip = [tdcr.settle(predictor.robot, command).tip for command in asked]
            tips.append(1e3 * np.linalg.norm(tip[0] - tip[1]))
    sizes = f"of {len(test[0].points)} points, predictions of {args.points}"
    print(f"{count} clouds {sizes}, {args.steps} steps, {np.median(seconds):.2f} s each")
    for name, values in (
        ("mean distance at first", first),
        ("mean distance", last),
        ("of the model's clouds for the set's own commands", own),
        ("of two samples of the model's surface", floor),
        ("tip from the wanted one's", tips),
    ):
        if values:
            low, middle, high = np.quantile(values, [0.0, 0.5, 1.0])
            within = np.mean(np.array(values) <= 2.0)
            spread = f"{low:.2f} to {high:.2f}, median {middle:.2f}"
            print(f"{name}: mean {np.mean(values):.2f} mm, {spread}; {100 * within:.0f} % within 2 mm")


if __name__ == "__main__":
    main()

"""What a network learns on top of a calibrated simulator, beside either alone: tip errors over the number of samples.

    python examples/python/residual.py --out residual

A robot is calibrated on some motions of a recording (`tdcr.calibrate_recording`); a small network then learns what the calibrated
robot misses, from the servos' pulls, those of the rows before, and where the simulator says that the tip is. Beside it stands the
same network without physics, which learns the place of the tip from the same pulls. Both are held against a recording of other
motions.
Motions are drawn whole: rows of one motion are too alike to be learned from and tested on.
"""

import argparse
import csv
import json
import tempfile
import tomllib
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

import tdcr
from tdcr.recordings import Replayed

OPENCR = Path(__file__).resolve().parents[1] / "opencr"

Floats = NDArray[np.float64]

HISTORY = 3
"""Rows before the present one that a network sees."""

GAP = 5.0
"""Seconds after which the rows before tell nothing of the way."""

MEMBERS = 5
"""Networks that are averaged."""


def features(recording: Replayed, simulated: bool) -> Floats:
    """Inputs of a network for each row: pulls (mm), how they changed over the rows before, and the simulated tip (cm)."""
    pulls = 1e3 * recording.pulls
    columns = [pulls]
    before = np.arange(len(pulls))
    for _ in range(HISTORY):
        earlier = np.maximum(before - 1, 0)
        before = np.where(recording.times[before] - recording.times[earlier] < GAP, earlier, before)
        columns.append(pulls - pulls[before])
    if simulated:
        columns.append(1e2 * recording.predicted[:, 0])
    return np.concatenate(columns, axis=1)


RIDGES = (1e-2, 1e-1, 1.0, 10.0, 100.0, np.inf)
"""Penalties of the linear part, of which motions kept aside choose; the last leaves it out."""


class Ensemble:
    """From inputs to millimetres: a linear part, and small networks for the rest.

    The penalty of the linear part, and when a network's training ends, are where motions that are kept aside are told best.
    """

    def __init__(self, inputs: Floats, outputs: Floats, motions: NDArray[np.str_], steps: int, seed: int) -> None:
        self.mean, self.scale = inputs.mean(0), inputs.std(0) + 0.1
        self.offset, self.size = outputs.mean(0), float(outputs.std()) + 1e-6
        x, y = (inputs - self.mean) / self.scale, (outputs - self.offset) / self.size
        names = np.unique(motions)
        draws = [np.random.default_rng([seed, member]) for member in range(MEMBERS)]
        asides = [np.isin(motions, draw.choice(names, max(1, len(names) // 5), replace=False)) for draw in draws]
        errors = [sum(((y - x @ linear(x[~a], y[~a], ridge))[a] ** 2).mean() for a in asides) for ridge in RIDGES]
        self.linear = linear(x, y, RIDGES[int(np.argmin(errors))])
        rest = torch.tensor(y - x @ self.linear, dtype=torch.float32)
        x32 = torch.tensor(x, dtype=torch.float32)
        self.networks = [
            self._train(x32, rest, torch.tensor(aside), steps, 1000 * seed + member) for member, aside in enumerate(asides)
        ]

    @staticmethod
    def _train(x: torch.Tensor, y: torch.Tensor, aside: torch.Tensor, steps: int, seed: int) -> nn.Module:
        torch.manual_seed(seed)
        width = 64
        network = nn.Sequential(
            nn.Linear(x.shape[1], width), nn.Tanh(), nn.Linear(width, width), nn.Tanh(), nn.Linear(width, y.shape[1])
        )
        # It begins with no correction at all.
        nn.init.zeros_(network[-1].weight)
        nn.init.zeros_(network[-1].bias)
        optimiser = torch.optim.AdamW(network.parameters(), lr=3e-3, weight_decay=0.1)
        best, kept = float("inf"), {name: value.clone() for name, value in network.state_dict().items()}
        for step in range(steps + 1):
            if step % 10 == 0:
                with torch.no_grad():
                    error = float(nn.functional.mse_loss(network(x[aside]), y[aside]))
                if error < best:
                    best, kept = error, {name: value.clone() for name, value in network.state_dict().items()}
            optimiser.zero_grad()
            nn.functional.huber_loss(network(x[~aside]), y[~aside]).backward()
            optimiser.step()
        network.load_state_dict(kept)
        return network

    def __call__(self, inputs: Floats) -> Floats:
        """The linear part and the networks' mean (mm)."""
        x = (inputs - self.mean) / self.scale
        with torch.no_grad():
            x32 = torch.tensor(x, dtype=torch.float32)
            rest = torch.stack([network(x32) for network in self.networks]).mean(0)
        return self.offset + self.size * (x @ self.linear + rest.numpy().astype(float))


def linear(x: Floats, y: Floats, ridge: float) -> Floats:
    """Coefficients of ridge regression."""
    if np.isinf(ridge):
        return np.zeros((x.shape[1], y.shape[1]))
    return np.linalg.solve(x.T @ x + ridge * len(x) / 100 * np.eye(x.shape[1]), x.T @ y)


def rmse(misses: Floats) -> float:
    """Root mean square distance, mean offset taken off."""
    missed = misses[np.isfinite(misses).all(1)]
    return float(np.sqrt(((missed - missed.mean(0)) ** 2).sum(1).mean()))


def excerpt(table: Path, motions: NDArray[np.str_], rows: int, seed: int, out: Path) -> None:
    """Writes whole motions of a recording, drawn at random, until there are so many rows, in their order."""
    names, counts = np.unique(motions, return_counts=True)
    order = np.random.default_rng(seed).permutation(len(names))
    enough = int(np.searchsorted(np.cumsum(counts[order]), rows)) + 1
    chosen = np.isin(motions, names[order[:enough]])
    header, *lines = table.read_text().splitlines()
    out.write_text("\n".join([header, *(line for line, keep in zip(lines, chosen, strict=True) if keep)]))


def trial(train: Path, arguments: argparse.Namespace, seed: int) -> dict[str, float]:
    """Errors (mm) on the other recording after learning from `train`."""
    columns = arguments.columns
    fit = tdcr.calibrate_recording(str(arguments.robot), train, columns, validate=arguments.validate)
    assert fit.validation is not None and fit.validation_rmse is not None
    errors = {"rows": float(len(fit.train.times)), "calibrated simulator": 1e3 * fit.validation_rmse}
    settled = np.isfinite(fit.train.predicted[:, 0]).all(1)
    held = np.isfinite(fit.validation.predicted[:, 0]).all(1)
    motions = np.array(fit.train.patterns)[settled]
    measured, truth = (1e3 * r.measured[:, 0] for r in (fit.train, fit.validation))
    said, predicted = (1e3 * r.predicted[:, 0] for r in (fit.train, fit.validation))
    for name, physics in (("simulator and network", True), ("network", False)):
        inputs = features(fit.train, physics)[settled]
        learned = Ensemble(inputs, (measured - physics * said)[settled], motions, arguments.steps, seed)
        guess = learned(features(fit.validation, physics)[held]) + (predicted[held] if physics else 0.0)
        errors[name] = rmse(guess - truth[held])
    return errors


def draw(rows: list[dict[str, float]], out: Path) -> None:
    figure, axes = plt.subplots(figsize=(6.0, 3.6), layout="constrained")
    for name in ("network", "calibrated simulator", "simulator and network"):
        sizes = sorted({row["samples"] for row in rows})
        values = [[row[name] for row in rows if row["samples"] == size] for size in sizes]
        axes.plot(sizes, [np.median(v) for v in values], "o-", label=name)
        axes.fill_between(sizes, [min(v) for v in values], [max(v) for v in values], alpha=0.2)
    axes.set(xscale="log", yscale="log", xlabel="rows to learn from", ylabel="tip error on other motions (mm)")
    axes.legend(frameon=False)
    figure.savefig(out, dpi=150)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot", type=Path, default=OPENCR / "robot.toml")
    parser.add_argument("--columns", type=Path, default=OPENCR / "columns.toml")
    parser.add_argument("--data", type=Path, default=OPENCR / "real_robot_v4_train.csv")
    parser.add_argument("--validate", type=Path, default=OPENCR / "real_robot_v4_val.csv")
    parser.add_argument("--samples", type=int, nargs="+", default=[50, 100, 200, 400, 800, 1600])
    parser.add_argument("--seeds", type=int, default=3, help="draws of the motions (%(default)s)")
    parser.add_argument("--steps", type=int, default=600, help="of a network's training (%(default)s)")
    parser.add_argument("--short", action="store_true", help="a few rows and steps, to see that it works")
    parser.add_argument("--out", type=Path, default=Path("residual"))
    arguments = parser.parse_args()
    if arguments.short:
        arguments.samples, arguments.seeds, arguments.steps = [60], 1, 60
    arguments.out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    pattern = tomllib.loads(arguments.columns.read_text()).get("pattern")
    with open(arguments.data, encoding="utf-8") as file:
        motions = np.array([row[pattern] if pattern else "" for row in csv.DictReader(file)])
    rows = []
    print("samples  seed  simulator  simulator and network  network (mm)")
    for samples in arguments.samples:
        for seed in range(arguments.seeds):
            with tempfile.TemporaryDirectory() as folder:
                train = Path(folder) / "train.csv"
                excerpt(arguments.data, motions, samples, seed, train)
                errors = trial(train, arguments, seed)
            rows.append({"samples": float(samples), "seed": float(seed), **errors})
            print(
                f"{samples:7} {seed:5} {errors['calibrated simulator']:10.2f} {errors['simulator and network']:22.2f} "
                f"{errors['network']:8.2f}",
                flush=True,
            )
    (arguments.out / "residual.json").write_text(json.dumps(rows, indent=1))
    draw(rows, arguments.out / "residual.png")


if __name__ == "__main__":
    main()

"""Trains one of the paper's baselines on a data set, or predicts with it.

    python -m tdcr.torch.baselines vsm --data data --out run
    python -m tdcr.torch.baselines predict --model run --data data --out predictions.npz
    tdcr eval --predictions predictions.npz --data data

Interrupted, the same command goes on where it stopped.
"""

import argparse
import json
import sys
import time
from dataclasses import fields
from pathlib import Path
from typing import Any

from tdcr.data import SPLITS
from tdcr.errors import InputError
from tdcr.torch.baselines._method import Settings
from tdcr.torch.baselines._model import FILE, BaselineModel, write_predictions
from tdcr.torch.baselines._registry import METHODS, method
from tdcr.torch.baselines._run import Run
from tdcr.torch.baselines.captured import Pictures
from tdcr.torch.ranks import distributed
from tdcr.torch.train import SECONDS_PER_LINE, Progress, exit_status, stopped_by_signals

#: Length of a run for which no other is given (minutes).
MINUTES = 90.0

#: Options that are fields of `Settings`, with their metavariable, help and type.
OPTIONS: dict[str, tuple[str, str, Any]] = {
    "minutes": (
        "M",
        f"end after so many minutes, with all that belongs to the run [default: {MINUTES:g}, without --steps]",
        float,
    ),
    "steps": ("N", "end after so many optimiser steps", int),
    "batch": ("N", "clouds per step [default: the method's]", int),
    "points": ("N", "points per cloud and step [default: the method's]", int),
    "learning_rate": ("R", "learning rate of the first half of the run [default: the method's]", float),
    "validations": ("N", "validations in a run [default: 10]", int),
    "validation_clouds": ("N", "clouds of each [default: 16]", int),
    "validation_points": ("N", "points of each of these clouds [default: 2000]", int),
    "precision": ("P", "operand type of matrix products: float32, tf32 (GPU) or bfloat16 [default: the method's]", str),
    "seed": ("N", "seed of weights, batches and noise [default: 0]", int),
}


def parser() -> argparse.ArgumentParser:
    """The command line."""
    top = argparse.ArgumentParser(prog="python -m tdcr.torch.baselines", description=(__doc__ or "").split("\n", maxsplit=1)[0])
    commands = top.add_subparsers(dest="command", required=True)
    for name in METHODS:
        one = commands.add_parser(name, help=f"train {name}")
        one.add_argument("--data", type=Path, default=Path("data"), metavar="DIR", help="folder of the data set")
        one.add_argument(
            "--out",
            type=Path,
            default=Path(name),
            metavar="DIR",
            help=f"folder of the run: model, state, and log.csv [default: {name}]",
        )
        for option, (metavar, text, kind) in OPTIONS.items():
            choices = ("float32", "tf32", "bfloat16") if option == "precision" else None
            one.add_argument(f"--{option.replace('_', '-')}", type=kind, metavar=metavar, help=text, choices=choices)
        one.add_argument(
            "--masks",
            type=Path,
            metavar="DIR",
            help="masks of a captured set's frames, for a method that learns from pictures: camera0/000000.png ...",
        )
        one.add_argument(
            "--frames",
            type=Path,
            metavar="DIR",
            help="the frames, as `tdcr log pictures` writes them, for one that learns colours",
        )
    predict = commands.add_parser("predict", help="predict the commands of a split")
    predict.add_argument("--model", type=Path, required=True, metavar="RUN", help="folder of a run, or its model.safetensors")
    predict.add_argument("--data", type=Path, default=Path("data"), metavar="DIR", help="folder of the data set")
    predict.add_argument("--split", choices=SPLITS, default="test", help="split of the commands [default: test]")
    predict.add_argument("--first", type=int, metavar="N", help="the split's first N commands alone, for `tdcr eval --tests N`")
    predict.add_argument("--points", type=int, default=10_000, metavar="N", help="points of a cloud [default: 10000]")
    predict.add_argument("--seed", type=int, default=0, metavar="N", help="seed of the first cloud [default: 0]")
    predict.add_argument("--name", metavar="NAME", help="name of the method in tables of several [default: its own]")
    predict.add_argument("--out", type=Path, default=Path("predictions.npz"), metavar="FILE", help="NPZ file of the clouds")
    for one in commands.choices.values():
        one.add_argument("--device", choices=["cpu", "cuda"], help="where to compute [default: the GPU, if there is one]")
        one.add_argument("--json", action="store_true", help="print the result as JSON")
        one.add_argument("--quiet", action="store_true", help="no progress")
    return top


class BaselineProgress(Progress):
    """Tells on stderr how far a run is, which may end by the clock."""

    def __init__(self, name: str, minutes: float | None, *, quiet: bool) -> None:
        super().__init__(quiet=quiet)
        self.name, self.minutes = name, minutes

    def note(self, text: str) -> None:
        """Says what is being prepared."""
        self.tell(f"{self.name}: {text}", end="\n")

    def begin(self, steps: int, taken: int) -> None:
        """The run starts, with `taken` of its steps taken, of 0 where the clock ends it."""
        self.steps, self.first, self.began = steps, taken, time.monotonic()
        if taken:
            self.note(f"goes on after step {taken}")

    def advance(self, step: int, loss: float) -> None:
        """Some steps were taken, with this mean loss."""
        now = time.monotonic()
        if now - self.told < (0.2 if self.terminal else SECONDS_PER_LINE):
            return
        self.told = now
        rate = (step - self.first) / max(now - self.began, 1e-9)
        of = f" of {self.steps}" if self.steps else ""
        end = "" if self.terminal else "\n"
        self.tell(f"{self.name}: step {step}{of}, loss {loss:.3e}, {rate:.1f} steps/s", end=end)

    def validated(self, step: int, loss: float, cd: float) -> None:
        """The weights were validated."""
        self.note(f"step {step}, loss {loss:.3e}, validation CD {cd:.3e} m²")


def train(args: argparse.Namespace) -> None:
    """Trains a method."""
    kind = method(args.command)
    monitor = BaselineProgress(args.command, args.minutes, quiet=args.quiet)
    with stopped_by_signals() as asked_to_stop, distributed(args.device) as device:
        given = {name: getattr(args, name) for name in OPTIONS if getattr(args, name) is not None}
        if args.minutes is None and args.steps is None:
            given["minutes"] = MINUTES
        settings = Settings(**(kind.defaults(device) | given))
        if args.frames is not None and args.masks is None:
            raise InputError("--frames without --masks: what of a frame is the robot is not known")
        run = Run(
            kind,
            args.data,
            args.out,
            settings,
            pictures=None if args.masks is None else Pictures(args.masks, args.frames),
            device=device,
            monitor=monitor,
            tell=monitor.note,
            interrupted=lambda: bool(asked_to_stop),
        )
        model = run.run()
    result = {
        "model": str(args.out / FILE),
        "method": args.command,
        "parameters": sum(value.numel() for value in model.method.parameters()),
        "steps": run.step,
        "best_step": model.step,
        "validation_cd": model.validation_distance * model.scale**2,
        "seconds": run.seconds,
        "processor_seconds": run.processor_seconds,
        "settings": {field.name: getattr(settings, field.name) for field in fields(settings)},
    }
    if args.json:
        print(json.dumps(result))
    else:
        print(
            f"{result['model']}: {args.command}, {result['parameters']} parameters, best at step {model.step} of {run.step}, "
            f"validation CD {result['validation_cd']:.3e} m²"
        )


def predict(args: argparse.Namespace) -> None:
    """Predicts with a trained method."""
    with distributed(args.device) as device:
        model = BaselineModel.load(args.model, device)
        seconds = write_predictions(args.out, model, args.data, args.split, args.points, args.seed, args.name, args.first)
    result = {"predictions": str(args.out), "method": model.method.name, "points": args.points, "seconds": seconds}
    print(json.dumps(result) if args.json else f"{args.out}: {model.method.name}, {seconds:.1f} s")


def main(arguments: list[str] | None = None) -> int:
    """The command; returns its exit status."""
    args = parser().parse_args(arguments)
    return exit_status(lambda: (predict if args.command == "predict" else train)(args))


if __name__ == "__main__":
    sys.exit(main())

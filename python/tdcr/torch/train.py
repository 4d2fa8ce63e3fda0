"""Trains a velocity network on a data set or a stream, as `tdcr train`, on one device or on several.

    python -m tdcr.torch.train --data data --out run
    torchrun --nproc-per-node 4 -m tdcr.torch.train --data data --out run --preset paper --net hybrid

Options, presets and defaults are those of `tdcr train`. Interrupted, the same command goes on where it stopped.
`tdcr predict` and `tdcr eval` read run/model.safetensors.
"""

import argparse
import json
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch

from tdcr._options import Option, train_options
from tdcr.errors import InputError, TdcrError
from tdcr.stream import Stream
from tdcr.torch.data import CloudSet, StreamWindow, find_reduction
from tdcr.torch.layers import Shape
from tdcr.torch.model import Model
from tdcr.torch.networks import network, start_as_authors
from tdcr.torch.ranks import distributed, group
from tdcr.torch.settings import Settings, complete, of_conditions, presets, resolve
from tdcr.torch.trainer import Interrupted, Trainer

#: Exit status after an interruption, as shells report SIGINT.
INTERRUPTED = 130

#: Seconds between two lines of progress where they do not replace each other.
SECONDS_PER_LINE = 30.0


#: What training in PyTorch lacks.
LACKING = {"coupling", "refinement_steps", "surface_prior"}

#: How the values of options are read.
KINDS: dict[str, Callable[[str], Any]] = {"count": int, "number": float, "file": str, "choice": str, "text": str}


def parser() -> argparse.ArgumentParser:
    """The command line."""
    top = argparse.ArgumentParser(prog="python -m tdcr.torch.train", description=(__doc__ or "").split("\n", maxsplit=1)[0])
    add = top.add_argument
    add("--data", type=Path, default=Path("data"), metavar="DIR", help="folder of the data set")
    add("--out", type=Path, default=Path("run"), metavar="DIR", help="folder of the run: model, state, and log.csv")
    headed: dict[str | None, argparse._ActionsContainer] = {None: top}
    for option in train_options().values():
        if option.name in LACKING:
            continue
        if option.heading not in headed:
            headed[option.heading] = top.add_argument_group(option.heading)
        add_option(headed[option.heading], option)

    stream = top.add_argument_group("training without a data set")
    stream.add_argument("--stream", metavar="ROBOT", help="train on fresh samples of this robot")
    stream.add_argument("--base", action="store_true", help="show the robot's base to the stream's cameras")
    stream.add_argument("--payload", type=payload, metavar="MIN:MAX", help="payloads of the stream (kg)")
    stream.add_argument("--stream-points", type=int, default=2000, metavar="N", help="points per cloud [default: 2000]")
    stream.add_argument("--voxel", type=float, default=0.002, metavar="M", help="edge of the voxels that thin clouds (m)")
    stream.add_argument("--noise", choices=["d435"], help="simulate the noise of a real depth camera")
    stream.add_argument("--window", type=int, default=512, metavar="N", help="clouds that a step draws from [default: 512]")
    stream.add_argument(
        "--fresh",
        type=float,
        default=1.0,
        metavar="N",
        help="fresh clouds of the window after each step, also below 1 [default: 1]",
    )
    stream.add_argument("--validation", type=Path, metavar="DIR", help="data set whose val split validates")
    stream.add_argument("--workers", type=int, default=2, metavar="N", help="processes of a rank that simulate [default: 2]")

    add("--device", choices=["cpu", "cuda"], help="where to compute [default: the GPUs, if there are any]")
    add("--json", action="store_true", help="print the result as JSON")
    add("--quiet", action="store_true", help="no progress")
    return top


def add_option(group: argparse._ActionsContainer, option: Option) -> None:
    """Adds an option of `tdcr train`."""
    help_text = option.help if option.default is None else f"{option.help} [default: {option.default}]"
    name, known = f"--{option.name.replace('_', '-')}", {"help": help_text.replace("%", "%%"), "default": option.default}
    if option.kind == "flag":
        group.add_argument(name, action=argparse.BooleanOptionalAction, **known)
    elif option.kind == "counts":
        group.add_argument(name, type=numbers, metavar=option.placeholder, **known)
    elif option.choices:
        group.add_argument(name, choices=option.choices, **known)
    else:
        group.add_argument(name, type=KINDS[option.kind], metavar=option.placeholder, **known)


def numbers(text: str) -> list[int]:
    """Numbers, one for each stage."""
    return [int(part) for part in text.split(",")]


def payload(text: str) -> tuple[float, float]:
    """MIN:MAX."""
    low, _, high = text.partition(":")
    return float(low), float(high)


def plan(args: argparse.Namespace, clouds_in_set: int | None, device: torch.device) -> tuple[dict[str, Any], Settings]:
    """Shape of the network, without the dimension of its conditions, and settings: what is asked for, resolved."""
    options = {name: getattr(args, name) for name in train_options() if name not in LACKING}
    if args.precision is None and device.type == "cuda" and torch.cuda.is_bf16_supported(including_emulation=False):
        options["precision"] = "bfloat16"
    shape, settings = resolve(options, clouds_in_set)
    return shape, complete({**settings})


def reduction(args: argparse.Namespace, source: Stream | Path) -> dict[str, Any] | None:
    """How the samples of a stream, or of the data set in a folder, are reduced by symmetries; says so.

    A run that starts at a model without symmetries has none.
    """
    use = args.symmetry or presets()[args.preset].options[args.net]["symmetry"]
    found: dict[str, Any] | None = None
    if use == "none":
        words = "none, as asked for"
    elif args.init is not None and "reduction" not in Model.load(args.init).provenance:
        words = "none, as the initial model has none"
    else:
        found, words = source.find_reduction(args.colors) if isinstance(source, Stream) else find_reduction(source, args.colors)
    if group()[0] == 0 and not args.quiet:
        print(f"symmetry: {words}", file=sys.stderr)
    return found


def clouds(args: argparse.Namespace) -> tuple[CloudSet | StreamWindow, CloudSet]:
    """What is trained on, and what validates."""
    if args.stream is None:
        units = None
        if args.normalisation_from is not None:
            units = Model.load(args.normalisation_from).provenance["normalisation"]
        reduced = reduction(args, args.data)
        training, validation = (
            CloudSet.read(args.data, split, colors=args.colors, units=units, reduction=reduced) for split in ("train", "val")
        )
        return training, validation
    stream = Stream(
        args.stream,
        base=args.base,
        payload=args.payload,
        points=args.stream_points,
        voxel=args.voxel,
        noise=args.noise,
        seed=args.seed,
    )
    reduced = reduction(args, stream)
    stream = stream if reduced is None else stream.reduced(reduced)
    window = StreamWindow(stream, clouds=args.window, fresh=args.fresh, workers=args.workers, colors=args.colors)
    if args.validation is None:
        return window, window.validation(16)
    units = stream.provenance["normalisation"]
    return window, CloudSet.read(args.validation, "val", colors=args.colors, units=units, reduction=reduced)


def initial(path: Path, shape: Shape, provenance: dict[str, Any]) -> torch.nn.Module:
    """The network of the model `path`, which must have this shape, these units and these symmetries."""
    model = Model.load(path)
    if model.provenance.get("reduction") != provenance.get("reduction"):
        raise InputError(f"{path} learned by other symmetries than these data have: train it without symmetries")
    if model.shape != shape:
        raise InputError(f"{path} has the shape {model.shape}, expected {shape}")
    if model.provenance["normalisation"] != provenance["normalisation"]:
        raise InputError(f"{path} is of other units than the data: normalisation_from takes a model for theirs")
    return model.network


class Progress:
    """Tells on stderr how far a run is: on a terminal in one line, else in a line every half minute."""

    def __init__(self, *, quiet: bool) -> None:
        self.quiet, self.terminal = quiet, sys.stderr.isatty()
        self.steps, self.first, self.began, self.told = 0, 0, time.monotonic(), time.monotonic()

    def begin(self, steps: int, taken: int) -> None:
        """The run starts, with `taken` of its steps taken."""
        self.steps, self.first, self.began = steps, taken, time.monotonic()
        if 0 < taken < steps:
            self.tell(f"train: goes on after step {taken} of {steps}", end="\n")

    def advance(self, step: int, loss: float) -> None:
        """Some steps were taken, with this mean loss."""
        now = time.monotonic()
        if now - self.told < (0.2 if self.terminal else SECONDS_PER_LINE):
            return
        self.told = now
        rate = (step - self.first) / max(now - self.began, 1e-9)
        left = (self.steps - step) / rate / 60
        text = f"train: step {step} of {self.steps}, loss {loss:.3e}, {rate:.1f} steps/s, {left:.0f} min left"
        self.tell(text, end="" if self.terminal else "\n")

    def validated(self, step: int, loss: float, cd: float) -> None:
        """The averaged weights were validated."""
        self.tell(f"train: step {step} of {self.steps}, loss {loss:.3e}, validation CD {cd:.3e} m²", end="\n")

    def tell(self, text: str, end: str) -> None:
        """Prints a line, over an unfinished one."""
        if not self.quiet:
            print(f"\r\x1b[K{text}" if self.terminal else text, end=end, file=sys.stderr, flush=True)


@contextmanager
def stopped_by_signals() -> Iterator[list[int]]:
    """Collects SIGINT and SIGTERM instead of dying of them."""
    received: list[int] = []
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, lambda number, _: received.append(number)) for number in numbers]
    try:
        yield received
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def train(args: argparse.Namespace) -> None:
    """Runs the command."""
    if args.colors is None:
        args.colors = presets()[args.preset].options[args.net]["colors"]
    with stopped_by_signals() as asked_to_stop, distributed(args.device) as device:
        training, validation = clouds(args)
        size = len(training) if isinstance(training, CloudSet) else None
        shape, settings = plan(args, size, device)
        shape = of_conditions(shape, training.condition_dim)
        torch.manual_seed(settings["seed"])
        module: torch.nn.Module
        if args.init is None:
            module = network(shape)
            if settings["procedure"] == "authors":
                start_as_authors(module)
        else:
            module = initial(args.init, shape, training.provenance)
        trainer = Trainer(
            module,
            training,
            validation,
            settings,
            args.out,
            shape=shape,
            device=device,
            monitor=Progress(quiet=args.quiet),
            interrupted=lambda: bool(asked_to_stop),
        )
        model = trainer.run()
        if model is None or group()[0] != 0:
            return
        count = sum(value.numel() for value in model.network.parameters())
        cd = model.validation_distance * trainer.area
    path = args.out / "model.safetensors"
    if args.json:
        result = {
            "model": str(path),
            "parameters": count,
            "steps": trainer.step,
            "best_step": model.step,
            "validation_cd": cd,
            "precision": settings["precision"],
        }
        print(json.dumps(result))
    else:
        print(f"{path}: {count} parameters, best at step {model.step} of {trainer.step}, validation CD {cd:.3e} m²")


def main(arguments: list[str] | None = None) -> int:
    """The command; returns its exit status."""
    args = parser().parse_args(arguments)
    return exit_status(lambda: train(args))


def exit_status(work: Callable[[], None]) -> int:
    """Does a command's work and says what went wrong; returns the command's exit status."""
    try:
        work()
    except Interrupted:
        print("error: interrupted; run the same command again to go on", file=sys.stderr)
        return INTERRUPTED
    except (TdcrError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())

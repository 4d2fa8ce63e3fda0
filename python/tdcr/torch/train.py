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
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from tdcr.errors import InputError, TdcrError
from tdcr.stream import Stream
from tdcr.torch.data import CloudSet, StreamWindow, find_reduction
from tdcr.torch.layers import Shape
from tdcr.torch.model import Model
from tdcr.torch.networks import network, start_as_authors
from tdcr.torch.ranks import distributed, group
from tdcr.torch.settings import CONTEXTS, Preset, Settings, presets
from tdcr.torch.trainer import Interrupted, Trainer

#: Exit status after an interruption, as shells report SIGINT.
INTERRUPTED = 130

#: Seconds between two lines of progress where they do not replace each other.
SECONDS_PER_LINE = 30.0


def parser() -> argparse.ArgumentParser:
    """The command line."""
    top = argparse.ArgumentParser(prog="python -m tdcr.torch.train", description=(__doc__ or "").split("\n", maxsplit=1)[0])
    known = presets()
    default = next(iter(known))

    def by_preset(about: str, field: str) -> str:
        return f"{about} [default: {', '.join(f'{p.name} {getattr(p, field)}' for p in known.values())}]"

    def by_network(about: str, field: str) -> str:
        def values(preset: Preset) -> str:
            mlp, hybrid = (preset.networks[net][field] for net in ("mlp", "hybrid"))
            return f"{mlp}" if mlp == hybrid else f"{mlp}, hybrid {hybrid}"

        return f"{about} [default: {'; '.join(f'{p.name} {values(p)}' for p in known.values())}]"

    add = top.add_argument
    add("--data", type=Path, default=Path("data"), metavar="DIR", help="folder of the data set")
    add("--out", type=Path, default=Path("run"), metavar="DIR", help="folder of the run: model, state, and log.csv")
    add("--net", choices=["mlp", "hybrid"], default="mlp", help="each point on its own, or with features of the cloud around it")
    add("--preset", choices=list(known), default=default, help=f"set of defaults [default: {default}]")
    add("--width", type=int, metavar="N", help=by_preset("features per layer", "width"))
    add("--depth", type=int, metavar="N", help=by_preset("layers", "depth"))
    add("--embedding", type=int, metavar="N", help=by_preset("features of the embedding of time and command", "embedding"))
    add(
        "--colors",
        action=argparse.BooleanOptionalAction,
        help=f"learn the colours of the points too [default: {', '.join(f'{p.name} {p.colors}' for p in known.values())}]",
    )
    add("--color-weight", type=float, metavar="W", help="weight of the colours' error beside the positions' [default: 0.05]")
    lengths = ", ".join(f"{p.name} {p.steps or f'{p.epochs} epochs'}" for p in known.values())
    add("--steps", type=int, metavar="N", help=f"optimiser steps [default: {lengths}]")
    add("--clouds", type=int, metavar="N", help=by_network("clouds per step, of all ranks together", "clouds"))
    add("--points", type=int, metavar="N", help=by_network("points per cloud and step, or all that a cloud has", "points"))
    add("--precision", choices=["float32", "bfloat16"], help="operand type of products [default: bfloat16 on a GPU that has it]")
    add("--optimizer", choices=["adamw", "muon"], help="optimiser [default: muon, of the preset paper adamw]")
    add("--learning-rate", type=float, metavar="RATE", help=by_network("learning rate after warm-up", "learning_rate"))
    add("--warmup", type=int, metavar="N", help=by_network("steps of warm-up, at most a tenth of all", "warmup_steps"))
    add("--validate-every", type=int, metavar="N", help=by_network("steps between validations", "validate_every"))
    add("--patience", type=int, metavar="N", help="end the run after so many validations without a better one")
    about = by_preset("features of the flow time: the paper's, or some that tell its last hundredths apart", "time_features")
    add("--time-features", choices=["plain", "late"], help=about)
    about = by_preset("residual blocks that a command passes through on its way to the embedding", "condition_blocks")
    add("--condition-blocks", type=int, metavar="N", help=about)
    add("--octaves", type=int, metavar="N", help=by_preset("octaves of the Fourier features of the points' positions", "octaves"))
    add(
        "--late-times",
        type=float,
        metavar="SHARE",
        help="share of the flow times that are drawn near the data [default: the preset's]",
    )
    add(
        "--prior-cut",
        type=float,
        metavar="R",
        help="where the noise is cut off, in deviations; 0: nowhere [default: the preset's]",
    )
    add("--time-exponent", type=float, metavar="ALPHA", help="flow times are Beta(ALPHA, 1) [default: 3]")
    about = by_network("learn one of all commands that symmetries make alike, or every one", "symmetry")
    add("--symmetry", choices=["auto", "none"], help=about)
    add("--init", type=Path, metavar="FILE", help="start from the weights of this model")
    add("--normalisation-from", type=Path, metavar="FILE", help="normalise commands and points as this model does")
    add("--seed", type=int, default=0, help="seed of weights, noise and subsets")

    context = top.add_argument_group("context of --net hybrid")
    layers = ", ".join(f"{p.name} {p.context.get('layers', 'residual')}" for p in known.values())
    context.add_argument("--layers", choices=list(CONTEXTS), help=f"this project's layers, or the authors' [default: {layers}]")
    context.add_argument("--channels", type=numbers, metavar="N,N,N", help="features of the three stages [default: 80,112,112]")
    context.add_argument("--resolutions", type=numbers, metavar="N,N,N", help="voxels per edge [default: 24,16,8]")
    context.add_argument("--blocks", type=int, metavar="N", help="point-voxel blocks per stage [default: 2]")
    context.add_argument("--context", type=int, metavar="N", help="features of a point's context [default: 64]")

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


def numbers(text: str) -> list[int]:
    """Three numbers, one for each stage."""
    values = [int(part) for part in text.split(",")]
    if len(values) != 3:
        raise argparse.ArgumentTypeError(f"{len(values)} values, expected 3, one per stage")
    return values


def payload(text: str) -> tuple[float, float]:
    """MIN:MAX."""
    low, _, high = text.partition(":")
    return float(low), float(high)


def context(args: argparse.Namespace, preset: Preset) -> dict[str, Any]:
    """What is asked of the context network.

    Raises:
        InputError: where the network is an MLP, which has none.
    """
    given = [name for name in ("layers", "channels", "resolutions", "blocks", "context") if getattr(args, name) is not None]
    if given and args.net == "mlp":
        raise InputError(f"--{given[0]} is of --net hybrid, the network is an mlp")
    stages = [dict(stage) for stage in preset.context["stages"]]
    for field, values in (("channels", args.channels), ("resolution", args.resolutions)):
        for stage, value in zip(stages, values or [], strict=False):
            stage[field] = value
    changes = {"layers": args.layers, "blocks": args.blocks, "features": args.context}
    return {"stages": stages} | {name: value for name, value in changes.items() if value is not None}


def plan(args: argparse.Namespace, clouds_in_set: int | None, device: torch.device) -> tuple[Preset, Settings]:
    """Network and settings: the preset's, but for what is asked for."""
    names = ("width", "depth", "embedding", "condition_blocks", "octaves", "time_features")
    sizes = {name: getattr(args, name) for name in names if getattr(args, name) is not None}
    preset = replace(presets()[args.preset], **sizes)
    fields = {
        "color_weight": args.color_weight,
        "steps": args.steps,
        "clouds": args.clouds,
        "points": args.points,
        "optimizer": {"adamw": "adam-w", "muon": {"muon": {"learning_rate": 0.02}}}.get(args.optimizer),
        "learning_rate": args.learning_rate,
        "warmup_steps": args.warmup,
        "validate_every": args.validate_every,
        "patience": args.patience,
        "precision": args.precision,
        "symmetry": args.symmetry,
        "seed": args.seed,
    }
    changes = {name: value for name, value in fields.items() if value is not None}
    if args.precision is None and device.type == "cuda" and torch.cuda.is_bf16_supported(including_emulation=False):
        changes["precision"] = "bfloat16"
    path = {"time_exponent": args.time_exponent, "late_times": args.late_times, "prior_cut": args.prior_cut}
    given = {name: value for name, value in path.items() if value is not None}
    if given.get("prior_cut") == 0:
        given["prior_cut"] = None
    if given:
        changes["path"] = presets()[args.preset].networks[args.net]["path"] | given
    return preset, preset.settings(net=args.net, clouds_in_set=clouds_in_set, **changes)


def reduction(args: argparse.Namespace, source: Stream | Path) -> dict[str, Any] | None:
    """How the samples of a stream, or of the data set in a folder, are reduced by symmetries; says so.

    A run that starts at a model without symmetries has none.
    """
    use = args.symmetry or presets()[args.preset].networks[args.net]["symmetry"]
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
        raise InputError(f"{path} learned by other symmetries than these data have: train it with --symmetry none")
    if model.shape != shape:
        raise InputError(f"{path} has the shape {model.shape}, expected {shape}")
    if model.provenance["normalisation"] != provenance["normalisation"]:
        raise InputError(f"{path} is of other units: give it to --normalisation-from too")
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
        args.colors = presets()[args.preset].colors
    with stopped_by_signals() as asked_to_stop, distributed(args.device) as device:
        training, validation = clouds(args)
        size = len(training) if isinstance(training, CloudSet) else None
        preset, settings = plan(args, size, device)
        shape = preset.shape(training.condition_dim, net=args.net, colors=args.colors, context=context(args, preset))
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
    try:
        train(args)
    except Interrupted:
        print("error: interrupted; run the same command again to go on", file=sys.stderr)
        return INTERRUPTED
    except (TdcrError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Training networks that tell a robot's cloud from its condition.

Options have the names and defaults of the command line.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tdcr import _tdcr
from tdcr._arrays import Floats, Progress, as_choice, as_count, as_flag, as_number, as_text, maybe_count, maybe_number, maybe_text
from tdcr._files import as_path
from tdcr._results import Result
from tdcr.data import MOST, Dataset, Floats32, PathLike, as_payload, as_seed, folder_of
from tdcr.errors import InputError
from tdcr.predictor import Precision, Predictor, model_file
from tdcr.robot import Robot


@dataclass(frozen=True, eq=False, repr=False)
class Run(Result):
    """A finished training run.

    Attributes:
        folder: Its folder: model, state to resume from, and the log as ``log.csv`` and for TensorBoard.
        losses: Loss of every step, shape (steps,), float32.
        validation_steps: Steps that were validated, shape (validations,).
        validation_cd: Chamfer distance of each validation, shape (validations,) (m²).
        precision: Operand type of the network's matrix products in training.
    """

    folder: Path
    losses: Floats32
    validation_steps: NDArray[np.uint64]
    validation_cd: Floats
    precision: str

    @property
    def model(self) -> Path:
        """The model file, of the best validation."""
        return self.folder / "model.safetensors"

    @property
    def steps(self) -> int:
        """Steps taken."""
        return len(self.losses)

    @cached_property
    def predictor(self) -> Predictor:
        """The network of the best validation."""
        return Predictor(self.model)

    def __repr__(self) -> str:
        return f"Run({str(self.folder)!r}: {self.steps} steps, validation CD {self.validation_cd.min():.3e} m²)"


def train(
    data: Dataset | PathLike | None = None,
    out: PathLike = "run",
    *,
    net: Literal["mlp", "hybrid"] = "mlp",
    preset: Literal["quick", "laptop", "paper"] = "quick",
    width: int | None = None,
    depth: int | None = None,
    embedding: int | None = None,
    condition_blocks: int | None = None,
    octaves: int | None = None,
    time_features: Literal["plain", "late"] | None = None,
    colors: bool | None = None,
    color_weight: float | None = None,
    steps: int | None = None,
    clouds: int | None = None,
    points: int | None = None,
    precision: Precision | None = None,
    optimizer: Literal["adamw", "muon"] | None = None,
    learning_rate: float | None = None,
    warmup: int | None = None,
    validate_every: int | None = None,
    patience: int | None = None,
    coupling: str = "independent",
    time_exponent: float = 3.0,
    late_times: float | None = None,
    prior_cut: float | None = None,
    refinement_steps: int | None = None,
    surface_prior: Robot | PathLike | dict[str, Any] | None = None,
    symmetry: Literal["auto", "none"] | None = None,
    prior_deviation: float | None = None,
    init: PathLike | None = None,
    normalisation_from: PathLike | None = None,
    seed: int = 0,
    layers: Literal["residual", "pvcnn"] | None = None,
    channels: Sequence[int] | None = None,
    resolutions: Sequence[int] | None = None,
    blocks: int | None = None,
    context: int | None = None,
    stream: Robot | PathLike | dict[str, Any] | None = None,
    base: bool = False,
    payload: tuple[float, float] | None = None,
    stream_points: int = 2000,
    voxel: float = 0.002,
    noise: Literal["d435"] | None = None,
    window: int = 512,
    fresh: int = 1,
    validation: PathLike | None = None,
    progress: Progress | None = None,
) -> Run:
    """Trains a velocity network on a data set or a stream by action-conditioned flow matching; as ``tdcr train``.

    The network is a function of the arguments. Interrupted by Ctrl-C or by an exception of ``progress``, the same call goes on
    where it stopped, and ends in the same network; with more ``steps`` it goes on from where the run ended.

    Args:
        data: The data set, or its folder; ``"data"`` by default.
        out: Folder of the run: model, state and log.
        net: ``"mlp"`` moves each point on its own, ``"hybrid"`` with features of the cloud around it.
        preset: Set of defaults, for all that is ``None``: ``"quick"`` is a small network in minutes on a CPU, ``"laptop"`` a
            larger one in about half an hour on 2 cores, ``"paper"`` has the authors' settings, for days on a CPU.
        width: Features per layer.
        depth: Layers.
        embedding: Features of the embedding of time and condition.
        condition_blocks: Residual blocks that a command passes through, once per cloud, on its way to the embedding.
        octaves: Octaves of the Fourier features of the points' positions.
        time_features: Features of the flow time that the network sees: ``"plain"`` are the paper's; half of the ``"late"`` ones
            are of the logarithm of the noise that is left, so that its last hundredths differ.
        colors: Whether to learn the colours of the points beside their positions; by default the preset ``"paper"`` alone does.
        color_weight: Weight of the colours' error beside the positions', with ``colors``.
        steps: Optimiser steps.
        clouds: Clouds per step.
        points: Points per cloud and step, or all that a cloud has.
        precision: Operand type of the network's matrix products.
        optimizer: ``"adamw"`` or ``"muon"``.
        learning_rate: Learning rate after warm-up; Muon's own follows in proportion.
        warmup: Steps of warm-up, at most a tenth of all.
        validate_every: Steps between validations.
        patience: Validations without a better one after which the run ends; by default it takes all steps.
        coupling: How noise is coupled to the points of a cloud: ``"independent"``, or ``"optimal-transport:K"``, matched within
            ``K`` points.
        time_exponent: Flow times are Beta(``time_exponent``, 1): 1 is uniform, above it they are mostly near the data.
        late_times: Share of the flow times that are drawn near the data instead, with ``1 - t`` log-uniform from 0.003 to 0.15.
        prior_cut: Where the noise that the flow starts from is cut off, in its standard deviations; 0: nowhere.
        refinement_steps: Steps of the refinement, at most a third of ``steps``: a copy of the network learns on the ends of its
            own flow, and takes its place in the last evaluation of a prediction; 0: none.
        surface_prior: A robot, or what :class:`tdcr.Robot` makes one of: the flow starts from its simulated surface under the
            same command, not from noise. For a model of the robot that the data show, which needs few samples then.
        symmetry: ``"auto"`` learns one representative of all commands that the robot's symmetries make alike, such as permuted
            tendons, where robot, base and cameras have them; ``"none"`` learns every command. By default ``"auto"``, of the
            preset ``"paper"`` ``"none"``.
        prior_deviation: Standard deviation of the noise that the flow starts from, in units of the data's scale; 0.5 by default,
            0.005 about a simulated surface.
        init: Model file, or run, whose weights the network starts at.
        normalisation_from: Model file, or run, whose normalisation takes the place of the data set's own.
        seed: Seed of weights, noise and subsets.
        layers: Layers of a hybrid's context network: ``"residual"``, or the authors' ``"pvcnn"``, as the preset ``"paper"`` has
            them, which ``python -m tdcr.torch.train`` alone trains.
        channels: Features of the three stages of a hybrid's context network; 80, 112, 112 by default.
        resolutions: Voxels per edge in its three stages; 24, 16, 8 by default.
        blocks: Point-voxel blocks per stage; 2 by default.
        context: Features of a point's context; 64 by default.
        stream: A robot, or what :class:`tdcr.Robot` makes one of: trains on fresh samples of it instead of a data set. What
            follows is of the stream.
        base: Whether the cameras see the robot's base.
        payload: Smallest and largest mass that hangs from the tip (kg).
        stream_points: Points per cloud.
        voxel: Edge of the voxels that thin the clouds (m).
        noise: ``"d435"`` simulates the noise of that depth camera.
        window: Clouds that a step draws from.
        fresh: Clouds of the window that are replaced by fresh ones after each step.
        validation: Folder of a data set whose val split validates; by default clouds of the stream that no step sees.
        progress: Is called with the number of steps taken since its last call, as ``tqdm(total=steps).update``; those that were
            taken before count at its first.

    Returns:
        The run, with its ``predictor``.

    Raises:
        InputError: For arguments that describe no network or run.
        DataError: For a data set that cannot be read.
        TrainError: For a folder that holds another run, an initial model that does not fit, and training that diverges.
    """
    shape = {"layers": layers, "channels": channels, "resolutions": resolutions, "blocks": blocks, "context": context}
    as_choice(net, "net", ("mlp", "hybrid"))
    given = [name for name, value in shape.items() if value is not None]
    if net == "mlp" and given:
        raise InputError(f"{given[0]} is of the net 'hybrid'; the network is an mlp")
    if color_weight is not None and not colors:
        raise InputError("color_weight is of a network with colors=True")
    options = {
        "preset": as_text(preset, "preset"),
        "width": maybe_count(width, "width"),
        "depth": maybe_count(depth, "depth"),
        "embedding": maybe_count(embedding, "embedding"),
        "condition_blocks": maybe_count(condition_blocks, "condition_blocks"),
        "octaves": maybe_count(octaves, "octaves"),
        "time_features": maybe_text(time_features, "time_features"),
        "context": None
        if net == "mlp"
        else {"layers": maybe_text(layers, "layers")} | {n: _sizes(v, n) for n, v in shape.items() if n != "layers"},
        "colors": None if colors is None else as_flag(colors, "colors"),
        "color_weight": maybe_number(color_weight, "color_weight"),
        "steps": maybe_count(steps, "steps"),
        "clouds": maybe_count(clouds, "clouds"),
        "points": maybe_count(points, "points"),
        "precision": maybe_text(precision, "precision"),
        "optimizer": maybe_text(optimizer, "optimizer"),
        "learning_rate": maybe_number(learning_rate, "learning_rate"),
        "warmup": maybe_count(warmup, "warmup"),
        "validate_every": maybe_count(validate_every, "validate_every"),
        "patience": maybe_count(patience, "patience"),
        "coupling": as_text(coupling, "coupling"),
        "time_exponent": as_number(time_exponent, "time_exponent"),
        "late_times": maybe_number(late_times, "late_times"),
        "prior_cut": maybe_number(prior_cut, "prior_cut"),
        "refinement_steps": None if refinement_steps is None else as_count(refinement_steps, "refinement_steps", 0, MOST),
        "surface_prior": None if surface_prior is None else Robot(surface_prior)._native,
        "symmetry": maybe_text(symmetry, "symmetry"),
        "prior_deviation": maybe_number(prior_deviation, "prior_deviation"),
        "seed": as_seed(seed),
    }
    source: tuple[Any, ...]
    if stream is None:
        units = None if normalisation_from is None else model_file(normalisation_from)
        source = (folder_of("data" if data is None else data), units)
    else:
        for name, value in (("data", data), ("normalisation_from", normalisation_from)):
            if value is not None:
                raise InputError(f"{name} is of a run on a data set; this one is on a stream")
        of_stream = {
            "base": as_flag(base, "base"),
            "payload": as_payload(payload),
            "stream_points": as_count(stream_points, "stream_points", 1, MOST),
            "voxel": as_number(voxel, "voxel"),
            "noise": maybe_text(noise, "noise"),
            "window": as_count(window, "window", 1, MOST),
            "fresh": as_count(fresh, "fresh", 1, MOST),
            "validation": None if validation is None else as_path(validation, "validation"),
        }
        source = (Robot(stream)._native, of_stream)
    initial = None if init is None else model_file(init)
    told = _tdcr.train(source, as_path(out, "out"), options, initial, progress=progress)
    return Run(Path(out), *told)


def distill(
    model: Predictor | PathLike = "run",
    data: Dataset | PathLike = "data",
    out: PathLike = "distilled",
    *,
    evaluations: int = 4,
    power: float = 3.0,
    steps: int = 4000,
    precision: Precision | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Run:
    """Distils a trained network into one that predicts with a few evaluations instead of many; as ``tdcr distill``.

    The result is a model like any other. Interrupted, the same call goes on where it stopped.

    Args:
        model: The trained model, its file, or the folder of its run.
        data: A data set whose val split validates, or its folder; its clouds are not trained on.
        out: Folder of the run.
        evaluations: Evaluations of the network in a prediction; the last one takes the points to the surface near them.
        power: Exponent ``p`` of the time grid ``1 - (1 - k/n)^p`` of the ``n`` evaluations before the last.
        steps: Optimiser steps.
        precision: Operand type of the network's matrix products.
        seed: Seed of commands and noise.
        progress: Is called with the number of steps taken since its last call.

    Raises:
        TrainError: As :func:`train`, and where the data set shows another robot.
    """
    options = {
        "evaluations": as_count(evaluations, "evaluations", 1, MOST),
        "power": as_number(power, "power"),
        "steps": as_count(steps, "steps"),
        "precision": maybe_text(precision, "precision"),
        "seed": as_seed(seed),
    }
    teacher = model.path if isinstance(model, Predictor) else model_file(model)
    told = _tdcr.distill(teacher, folder_of(data), as_path(out, "out"), options, progress=progress)
    return Run(Path(out), *told)


def demo(
    out: PathLike = "demo_out",
    *,
    samples: int = 2000,
    steps: int = 5500,
    precision: Precision | None = None,
    symmetry: Literal["auto", "none"] = "auto",
    seed: int = 0,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Simulates, sees, learns, predicts and evaluates the paper's 2m robot, and writes a report; as ``tdcr demo``.

    Interrupted, the same call goes on where it stopped.

    Args:
        out: Folder of everything that the demo makes: ``data``, ``run``, ``metrics.json``, ``report.html``, ``shapes.png``.
        samples: Commands to simulate, split 80/10/10.
        steps: Optimiser steps.
        precision: Operand type of the network's matrix products.
        symmetry: ``"auto"`` uses the robot's symmetries, ``"none"`` does not: see :func:`train`.
        seed: Seed of everything random.
        progress: Is called with the number of samples made, steps taken and test commands scored since its last call:
            ``samples + steps + samples / 10`` in all.

    Returns:
        Mean scores and times, as ``metrics.json`` has them and ``tdcr demo --json`` prints them.

    Raises:
        DataError: For a folder that holds a demo of another number of samples.
        TrainError: For a folder that holds a run of other settings.
    """
    options = {
        "samples": as_count(samples, "samples", 1, MOST),
        "steps": as_count(steps, "steps"),
        "precision": maybe_text(precision, "precision"),
        "symmetry": as_text(symmetry, "symmetry"),
        "seed": as_seed(seed),
    }
    metrics: dict[str, Any] = json.loads(_tdcr.demo(as_path(out, "out"), options, progress=progress))
    return metrics


def _sizes(value: Any, name: str) -> Any:
    """A size, or one for each of three stages."""
    if value is None or name in ("blocks", "context"):
        return maybe_count(value, name)
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise InputError(f"{name} is {value!r}; expected 3 numbers, one for each stage")
    sizes = [as_count(size, name) for size in value]
    if len(sizes) != 3:
        raise InputError(f"{name} has {len(sizes)} values; expected 3, one for each stage")
    return sizes

"""Training networks that tell a robot's cloud from its condition.

Options have the names and defaults of the command line.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Unpack

import numpy as np
from numpy.typing import NDArray

from tdcr import _tdcr
from tdcr._arrays import Floats, Progress, as_count, as_flag, as_number, as_text, maybe_text
from tdcr._files import as_path
from tdcr._options import as_options
from tdcr._results import Result
from tdcr._train_options import TrainOptions
from tdcr.data import MOST, Dataset, Floats32, PathLike, as_payload, as_seed, as_variation, folder_of
from tdcr.errors import InputError
from tdcr.predictor import Precision, Predictor, model_file
from tdcr.robot import Robot
from tdcr.scene import Scene, as_scene


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
    stream: Robot | PathLike | dict[str, Any] | None = None,
    base: bool = False,
    payload: tuple[float, float] | None = None,
    stream_points: int = 2000,
    voxel: float = 0.002,
    noise: Literal["d435"] | None = None,
    window: int = 512,
    fresh: int = 1,
    validation: PathLike | None = None,
    scene: Scene | None = None,
    vary_obstacles: float | tuple[float, float] | None = None,
    progress: Progress | None = None,
    **options: Unpack[TrainOptions],
) -> Run:
    """Trains a velocity network on a data set or a stream by action-conditioned flow matching; as ``tdcr train``.

    The network is a function of the arguments. Interrupted by Ctrl-C or by an exception of ``progress``, the same call goes on
    where it stopped, and ends in the same network; with more ``steps`` it goes on from where the run ended.

    Args:
        data: The data set, or its folder; ``"data"`` by default.
        out: Folder of the run: model, state and log.
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
        scene: Obstacles around the stream's robot, as of :func:`collect`.
        vary_obstacles: Moves them anew for each sample, as of :func:`collect`.
        progress: Is called with the number of steps taken since its last call, as ``tqdm(total=steps).update``; those that were
            taken before count at its first.
        **options: Network and training: :class:`TrainOptions` has their names and what they mean.

    Returns:
        The run, with its ``predictor``.

    Raises:
        InputError: For arguments that describe no network or run.
        DataError: For a data set that cannot be read.
        TrainError: For a folder that holds another run, an initial model that does not fit, and training that diverges.
    """
    asked = as_options(options)
    if "color_weight" in asked and not asked.get("colors"):
        raise InputError("color_weight is of a network with colors=True")
    source: Any
    if stream is None:
        if scene is not None or vary_obstacles is not None:
            given = "scene" if scene is not None else "vary_obstacles"
            raise InputError(f"{given} is of a run on a stream; a data set has the one that it was collected in")
        source = folder_of("data" if data is None else data)
    else:
        for name, value in (("data", data), ("normalisation_from", asked.get("normalisation_from"))):
            if value is not None:
                raise InputError(f"{name} is of a run on a data set; this one is on a stream")
        of_stream = {
            "base": as_flag(base, "base"),
            "payload": as_payload(payload),
            "vary_obstacles": as_variation(vary_obstacles, scene),
            "stream_points": as_count(stream_points, "stream_points", 1, MOST),
            "voxel": as_number(voxel, "voxel"),
            "noise": maybe_text(noise, "noise"),
            "window": as_count(window, "window", 1, MOST),
            "fresh": as_count(fresh, "fresh", 1, MOST),
            "validation": None if validation is None else as_path(validation, "validation"),
        }
        source = (Robot(stream)._native, json.dumps(of_stream), None if scene is None else as_scene(scene)._native)
    surface: Robot | None = asked.pop("surface_prior", None)
    of_prior = None if surface is None else surface._native
    run = _tdcr.train(source, as_path(out, "out"), json.dumps(asked), of_prior, progress=progress)
    return Run(Path(out), *run)


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
        evaluations: Evaluations of a network in a prediction; the last one takes the points to the surface near them, or of a
            refined teacher the last two.
        power: Exponent ``p`` of the time grid ``1 - (1 - k/n)^p`` of the ``n`` evaluations before these.
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
    run = _tdcr.distill(teacher, folder_of(data), as_path(out, "out"), options, progress=progress)
    return Run(Path(out), *run)


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

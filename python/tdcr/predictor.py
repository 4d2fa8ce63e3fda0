"""Trained networks, and the clouds that they predict.

A condition is a command (m, or N for a tension drive), then for a network of data with payloads the payload (kg).
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tdcr import _tdcr
from tdcr._arrays import (
    Floats,
    Progress,
    as_count,
    as_float,
    as_floats,
    as_number,
    as_rows,
    maybe_count,
    maybe_number,
    maybe_text,
)
from tdcr._files import as_path
from tdcr._results import Batch, Result
from tdcr.data import MOST, Bytes, Floats32, Normalisation, PathLike, as_seed
from tdcr.errors import InputError, TrainError
from tdcr.robot import Robot

Method = Literal["heun", "euler", "adams-bashforth", "exponential", "exponential3"]
"""How a network's flow is integrated: ``heun`` evaluates the network twice per step, the others once."""

Precision = Literal["float32", "bfloat16"]
"""Operand type of a network's matrix products. Sums are float32 in either."""


class ExtrapolationWarning(UserWarning):
    """A prediction is asked for outside the range of the training data."""


@dataclass(frozen=True, eq=False, repr=False)
class Prediction(Batch):
    """Predicted clouds of ``B`` conditions, ``N`` points each.

    Attributes:
        points: Shape (B, N, 3), float32, world frame (m).
        colors: Shape (B, N, 3), uint8, RGB; ``None`` where the network predicts positions alone.
        uncertainty: Shape (B, N), float32 (m): how far the prediction spreads, normal to its surface, about each point, times
            :attr:`Predictor.uncertainty_factor`, so that twice as much covers the error of 95 % of the points of unseen
            commands. ``None`` where it was not asked for, or clouds have fewer than 16 points.
        evaluations: Evaluations of the network that each cloud took, shape (B,).
    """

    points: Floats32
    colors: Bytes | None
    uncertainty: Floats32 | None
    evaluations: NDArray[np.uint32]

    _by_rows = ("points", "colors", "uncertainty", "evaluations")

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, rows: slice | Sequence[int] | NDArray[Any]) -> Prediction:
        """The clouds that a slice, a mask of flags or an array of numbers names."""
        return self._take(rows)


@dataclass(frozen=True, eq=False, repr=False)
class Reached(Result):
    """A command that was found for a cloud.

    Attributes:
        condition: Shape (D,): the command (m or N), then the payload (kg) if there is one.
        distances: Mean distance of the points of both clouds from each other (m): before the first step, and after each.
        cloud: The predicted cloud, shape (N, 3), float32 (m).
    """

    condition: Floats
    distances: Floats
    cloud: Floats32


class Predictor:
    """A trained network, of conditions of ``D`` numbers. It can be pickled, and used in forked and spawned processes.

    Args:
        path: A model file, or the folder of a run that has one.
        precision: Operand type of the network's matrix products; by default bfloat16 on processors that compute it faster,
            where the network's width allows it, else float32.

    Raises:
        TrainError: If there is no model, or the file is damaged.
    """

    path: str
    """The model file."""

    def __init__(self, path: PathLike = "run", precision: Precision | None = None) -> None:
        self.path = model_file(path)
        self._precision = precision
        self._native = _tdcr.Predictor(self.path, maybe_text(precision, "precision"))

    def predict(
        self,
        conditions: Any,
        points: int = 10_000,
        *,
        seed: int = 0,
        sampler: Method | None = None,
        sampler_steps: int | None = None,
        sampler_power: float | None = None,
        sampler_tolerance: float | None = None,
        sampler_denoise: float | None = None,
        sampler_spare: float | None = None,
        progress: Progress | None = None,
    ) -> Floats32:
        """Predicts the clouds of the robot under conditions; as ``tdcr predict``.

        Args:
            conditions: Shape (B, D), or (D,) for one: the command (m or N), then the payload (kg) if there is one.
            points: Points of each cloud ``N``.
            seed: Seed of the noise that every cloud starts from.
            sampler: How the flow is integrated; the model's own way by default, as all that follows.
            sampler_steps: Number of steps; with a tolerance the most, 200 by default.
            sampler_power: Exponent ``p`` of the time grid ``1 - (1 - k/n)^p``.
            sampler_tolerance: Adaptive steps with this local error tolerance, relative to the data's extent.
            sampler_denoise: Flow time, below 1, of a last evaluation that takes the points to the data predicted there; 1: none.
                Of a refined model at another time than its own, the network itself makes it.
            sampler_spare: Points to draw beyond ``points``, as a share of these; isolated and crowded ones are left
                out, and the others moved apart along the surface.
            progress: Is called with the number of clouds predicted since its last call, as ``tqdm(total=B).update``.

        Returns:
            Points, shape (B, N, 3), float32, world frame (m). :meth:`clouds` gives colours too.

        Raises:
            InputError, CommandError, LoadsError: For conditions that the robot cannot be under, and options that describe no
                sampler.
        """
        return self.clouds(
            conditions,
            points,
            seed=seed,
            sampler=sampler,
            sampler_steps=sampler_steps,
            sampler_power=sampler_power,
            sampler_tolerance=sampler_tolerance,
            sampler_denoise=sampler_denoise,
            sampler_spare=sampler_spare,
            progress=progress,
        ).points

    def clouds(
        self,
        conditions: Any,
        points: int = 10_000,
        *,
        uncertainty: bool = False,
        prior_samples: int = 1,
        seed: int = 0,
        sampler: Method | None = None,
        sampler_steps: int | None = None,
        sampler_power: float | None = None,
        sampler_tolerance: float | None = None,
        sampler_denoise: float | None = None,
        sampler_spare: float | None = None,
        progress: Progress | None = None,
    ) -> Prediction:
        """Predicts clouds with all that is known of them.

        Args:
            conditions: As of :meth:`predict`, and so are the other arguments.
            points: Points of each cloud ``N``.
            uncertainty: Whether to tell how uncertain each point is.
            prior_samples: Number of clouds, each from its own noise, that the uncertainty of the first is estimated from. One
                is enough for a network that moves each point on its own (the MLP).
            seed: Seed of the noise.
            sampler: Integration method.
            sampler_steps: Number of steps.
            sampler_power: Exponent of the time grid.
            sampler_tolerance: Tolerance of adaptive steps.
            sampler_denoise: Flow time of the last denoising; 1: none.
            sampler_spare: Share of spare points.
            progress: Is called with the number of clouds predicted since its last call.
        """
        rows = as_rows(conditions, "conditions", self.condition_width, self._condition_words())
        self._warn_outside(rows)
        options = {
            "points": as_count(points, "points", 1, MOST),
            "seed": as_seed(seed),
            "sampler": sampler_options(sampler, sampler_steps, sampler_power, sampler_tolerance, sampler_denoise, sampler_spare),
            "prior_samples": as_count(prior_samples, "prior_samples", 1, MOST) if uncertainty else 0,
        }
        return Prediction(*self._native.predict(rows, options, progress=progress))

    def reach(
        self,
        cloud: Any,
        *,
        start: Any = None,
        steps: int = 20,
        points: int = 2048,
        tolerance: float = 0.0,
        seed: int = 0,
    ) -> Reached:
        """Looks for the command whose predicted cloud is nearest to a wanted one; as ``tdcr reach --cloud``.

        It needs no simulator: each step takes differences of predictions that start from the same noise for derivatives, and
        changes the command so that matched points come together. Commands stay within those of the training data.

        Args:
            cloud: Points that the robot is to look like, shape (N, 3) (m, world frame).
            start: Condition to start from, shape (D,): the command, then the payload (kg) if there is one, which stays. The
                middle of the training data's unless given.
            steps: Most steps.
            points: Points of the predicted clouds, 16 or more.
            tolerance: Mean distance between the clouds (m) at which the search ends.
            seed: Seed of the noise that predictions start from.

        Raises:
            InputError: For a cloud that is none, and conditions that the robot cannot be under.
        """
        wanted = np.ascontiguousarray(as_floats(cloud, "cloud"), dtype=np.float32)
        if wanted.ndim != 2 or wanted.shape[1] != 3 or len(wanted) == 0:
            raise InputError(f"cloud has shape {wanted.shape}; expected (N, 3), N above 0")
        low, high, _ = self._native.units()
        first = (low + high) / 2 if start is None else as_float(start, "start", (self.condition_width,))
        found = as_number(tolerance, "tolerance")
        if found < 0.0:
            raise InputError(f"tolerance is {found}; expected a number, 0 or above")
        options = {
            "steps": as_count(steps, "steps", 0, MOST),
            "points": as_count(points, "points", 16, MOST),
            "tolerance": found,
            "seed": as_seed(seed),
            "sampler": sampler_options(None, None, None, None, None, None),
        }
        return Reached(*self._native.reach(wanted, first, options))

    def uncertainty(
        self, conditions: Any, points: int = 10_000, *, prior_samples: int = 1, seed: int = 0, **options: Any
    ) -> Floats32:
        """How uncertain each point of :meth:`predict` with the same arguments is, shape (B, N) (m).

        See :attr:`Prediction.uncertainty`.

        Raises:
            InputError: For fewer than 16 points, of which nothing can be told.
        """
        found = self.clouds(conditions, points, uncertainty=True, prior_samples=prior_samples, seed=seed, **options).uncertainty
        if found is None:
            raise InputError(f"points is {points}; expected 16 or more, of which an uncertainty can be told")
        return found

    def save(self, path: PathLike) -> None:
        """Writes the model to a file."""
        self._native.save(as_path(path, "path"))

    @cached_property
    def robot(self) -> Robot | None:
        """The robot of the training clouds; ``None`` where they did not say."""
        native = self._native.robot()
        return None if native is None else Robot._of(native)

    @cached_property
    def normalisation(self) -> Normalisation:
        """Ranges of the conditions in training, and the scale of the points: the units that the network sees."""
        return Normalisation(*self._native.units())

    @property
    def condition_width(self) -> int:
        """Numbers of a condition ``D``."""
        return len(self.normalisation.condition_min)

    @property
    def condition_ranges(self) -> Floats:
        """Smallest and largest value of each number of a condition in training, shape (D, 2): beyond, clouds are
        extrapolations."""
        return np.stack([self.normalisation.condition_min, self.normalisation.condition_max], axis=1)

    @property
    def base(self) -> bool | None:
        """Whether clouds show the robot's base; ``None`` where the training clouds did not say."""
        return None if self._subject is None else self._subject["base"] == "shown"

    @property
    def payload(self) -> tuple[float, float] | None:
        """Smallest and largest payload of the training data (kg); ``None`` where a condition has none."""
        payload = (self._subject or {}).get("payload")
        return None if payload is None else (payload["min"], payload["max"])

    @property
    def has_colors(self) -> bool:
        """Whether clouds have colours."""
        return bool(self.about["colors"])

    @property
    def precision(self) -> str:
        """Operand type of the network's matrix products."""
        return str(self.about["precision"])

    @property
    def uncertainty_factor(self) -> float | None:
        """What the spread of a cloud is multiplied by to be its uncertainty: training finds it in validation, such that twice
        the uncertainty covers the error of 95 % of the points of unseen commands. ``None`` (1) for models that do not say."""
        factor: float | None = self.about["uncertainty_factor"]
        return factor

    @property
    def refined(self) -> bool:
        """Whether a network of its own makes the last evaluation of a prediction."""
        return bool(self.about["refined"])

    @property
    def parameters(self) -> int:
        """Number of weights."""
        return int(self.about["parameters"])

    @cached_property
    def about(self) -> dict[str, Any]:
        """What the model file says but for the weights: ``provenance`` (robot, base, payloads, normalisation), ``settings`` of
        the training, ``shape`` of the network, the ``step`` that its weights are of and their ``validation_cd`` (m²); and
        ``parameters``, ``precision``, ``colors``, ``refined``, ``uncertainty_factor``."""
        about: dict[str, Any] = json.loads(self._native.about())
        return about

    @property
    def _subject(self) -> dict[str, Any] | None:
        subject: dict[str, Any] | None = self.about["provenance"]["subject"]
        return subject

    def _condition_words(self) -> str:
        if self.robot is None:
            return "one for each number of a condition in training"
        payload = ", then the payload" if self.payload else ""
        return f"one for each tendon of {self.robot.name}{payload}"

    def _warn_outside(self, rows: Floats) -> None:
        outside = self.normalisation.outside(rows)
        if outside.any():
            row, column = (int(k) for k in np.argwhere(outside)[0])
            low, high = self.condition_ranges[column]
            message = (
                f"{outside.any(axis=1).sum()} of {len(rows)} conditions are outside the training range, where clouds are "
                f"extrapolations: number {column} of row {row} is {rows[row, column]}, the range {low} to {high}"
            )
            warnings.warn(message, ExtrapolationWarning, stacklevel=4)

    def __reduce__(self) -> tuple[Any, ...]:
        return Predictor, (self.path, self._precision)

    def __repr__(self) -> str:
        robot = "imported clouds" if self.robot is None else self.robot.name
        return f"Predictor({self.path!r}: {robot}, {self.parameters} parameters, step {self.about['step']})"


def model_file(path: PathLike) -> str:
    """The model file that is meant by a path, which may be that of a run's folder.

    Raises:
        TrainError: If there is none.
    """
    file = Path(as_path(path, "path"))
    if file.is_dir():
        file = file / "model.safetensors"
    if not file.exists():
        raise TrainError(f"there is no model {file}; `tdcr.train(out=DIR)` makes DIR/model.safetensors")
    return str(file)


def sampler_options(
    method: str | None,
    steps: int | None,
    power: float | None,
    tolerance: float | None,
    denoise: float | None,
    spare: float | None,
) -> dict[str, Any]:
    """Options of a sampler, as the native module takes them."""
    if power is not None and tolerance is not None:
        raise InputError("sampler_power is of a fixed grid and sampler_tolerance of adaptive steps; expected one of them")
    return {
        "sampler": maybe_text(method, "sampler"),
        "sampler_steps": maybe_count(steps, "sampler_steps"),
        "sampler_power": maybe_number(power, "sampler_power"),
        "sampler_tolerance": maybe_number(tolerance, "sampler_tolerance"),
        "sampler_denoise": maybe_number(denoise, "sampler_denoise"),
        "sampler_spare": maybe_number(spare, "sampler_spare"),
    }

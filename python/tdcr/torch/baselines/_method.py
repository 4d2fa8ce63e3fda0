"""What a baseline is: networks with a loss on a training set, and clouds for conditions.

Units are those of a data set's normalisation: conditions (D,) in [0, 1], points divided by the scale (m).
"""

import importlib
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Literal, Self

import torch
from torch import Tensor, nn

from tdcr.errors import InputError, MissingPackageError
from tdcr.torch.baselines.captured import Pictures
from tdcr.torch.baselines.views import Views
from tdcr.torch.data import CloudSet

#: Operand type of matrix products: float32, float32 rounded to TF32, which GPUs alone have, or bfloat16 by autocast.
Precision = Literal["float32", "tf32", "bfloat16"]


@dataclass(frozen=True)
class Settings:
    """How a baseline is trained. A run ends at whichever of `steps` and `minutes` comes first."""

    #: Clouds of a step.
    batch: int
    #: Points of each cloud in a step: on the surface, or along rays, as the method has it.
    points: int
    #: Learning rate of Adam in the first half of a run.
    learning_rate: float
    #: Steps of the optimiser; None: any number.
    steps: int | None = None
    #: Length of the run with all that belongs to it (minutes); None: any.
    minutes: float | None = None
    #: Largest norm of a gradient; longer ones are scaled. None: any.
    clip_norm: float | None = None
    #: Validations in a run, equally spaced.
    validations: int = 10
    #: Clouds of the validation split that each looks at.
    validation_clouds: int = 16
    #: Points of each.
    validation_points: int = 2000
    precision: Precision = "float32"
    seed: int = 0

    def __post_init__(self) -> None:
        """Raises:
        tdcr.errors.InputError: for a number out of its bounds, and a run without an end.
        """
        for name in ("batch", "points", "validations", "validation_clouds", "validation_points"):
            if getattr(self, name) < 1:
                raise InputError(f"{name} is {getattr(self, name)}, expected 1 or more")
        for name in ("learning_rate", "clip_norm"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < math.inf:
                raise InputError(f"{name} is {value}, expected a finite number above 0")
        if self.steps is None and self.minutes is None:
            raise InputError("a run has neither steps nor minutes, expected one of them or both")
        if self.steps is not None and self.steps < 1:
            raise InputError(f"steps is {self.steps}, expected 1 or more")
        if self.minutes is not None and not 0.0 < self.minutes < math.inf:
            raise InputError(f"minutes is {self.minutes}, expected a finite number above 0")
        if self.seed < 0:
            raise InputError(f"seed is {self.seed}, expected 0 or more")


@dataclass(frozen=True)
class Training:
    """What a method learns from."""

    #: Folder of the data set.
    folder: Path
    #: Its training split, on the device.
    clouds: CloudSet
    settings: Settings
    device: torch.device
    #: Is told what is being prepared before the first step, in words.
    tell: Callable[[str], None]
    #: Pictures that cameras took, in place of rendered ones.
    pictures: Pictures | None = None

    @property
    def scale(self) -> float:
        """Length that points are divided by (m)."""
        return float(self.clouds.provenance["normalisation"]["scale"])

    def views(self) -> Views:
        """Pictures of the training split, on the device."""
        if self.pictures is not None:
            self.tell("reads the pictures of the training split")
            return self.pictures.read(self.folder).to(self.device)
        self.tell("renders the pictures of the training split")
        return Views.render(self.folder).to(self.device)

    def draw(self, numbers: torch.Generator) -> tuple[Tensor, Tensor]:
        """Clouds (B,) of a step and points (B, N) of each, drawn with replacement."""
        which = torch.randint(len(self.clouds), (self.settings.batch,), generator=numbers, device=self.device)
        count = (self.settings.batch, self.settings.points)
        return which, torch.randint(self.clouds.points_per_cloud, count, generator=numbers, device=self.device)


class Method(nn.Module, ABC):
    """A baseline. Its weights and buffers are all that predictions need beside `shape`.

    `cls(**shape)` makes a module of the same sizes; what else training needs (`prepare`) is no part of a state: it is a function
    of the training set and the seed, made anew when a run is resumed.
    """

    #: Its name on the command line and in files.
    name: ClassVar[str]
    #: What a step is taken from.
    learns_from: ClassVar[Literal["clouds", "masks", "colours"]] = "clouds"

    @classmethod
    @abstractmethod
    def defaults(cls, device: torch.device) -> dict[str, Any]:
        """Fields of `Settings` for this kind of device, but for the run's length and seed."""

    @classmethod
    @abstractmethod
    def start(cls, training: Training) -> Self:
        """The method before its first step; PyTorch's own generator of random numbers has the run's seed."""

    @abstractmethod
    def shape(self) -> dict[str, Any]:
        """Arguments of the constructor, plain values of JSON."""

    def prepare(self, training: Training) -> None:
        """Makes what training needs beside the clouds, such as normals or views, at the start of a process."""

    @abstractmethod
    def loss(self, training: Training, step: int, numbers: torch.Generator) -> Tensor:
        """The loss of a step (the first is 1) on a batch that `numbers` draws, which are on the device. No host reads it, so a
        GPU does not wait."""

    @abstractmethod
    def points(self, conditions: Tensor, count: int, seeds: Sequence[int]) -> Tensor:
        """Clouds (B, count, 3) for conditions (B, D), in the data's units on the device of the weights. Seed k gives cloud k its
        random numbers, whatever the other clouds are."""

    def optimizer(self, settings: Settings) -> torch.optim.Optimizer:
        """The optimiser of all weights: Adam, unless a method says otherwise."""
        return torch.optim.Adam(self.parameters(), lr=settings.learning_rate)

    def rate(self, progress: float) -> float:
        """Learning rate after this part of a run, relative to that of its start: constant, then falling to zero in the second
        half (PointFlow's linear schedule)."""
        return min(1.0, 2.0 - 2.0 * progress)

    def stepped(self, training: Training, step: int, progress: float) -> None:
        """A step was taken: the place to change what is no gradient's."""

    @property
    def device(self) -> torch.device:
        """Where the weights are."""
        return next(self.parameters()).device

    def generators(self, seeds: Sequence[int]) -> list[torch.Generator]:
        """Random numbers of each seed on the device of the weights."""
        return [torch.Generator(self.device).manual_seed(seed) for seed in seeds]


def load(package: str, needs: str, pip: str | None = None) -> ModuleType:
    """An optional package; `needs` is what needs it, `pip` its name in a registry where that is another one.

    Raises:
        tdcr.errors.MissingPackageError: where it is not installed.
    """
    try:
        return importlib.import_module(package)
    except ImportError as error:
        name = pip or package.partition(".")[0]
        raise MissingPackageError(f"{needs} needs {name}, which is not installed: pip install {name}") from error

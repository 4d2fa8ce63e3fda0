"""Data sets: pairs of a condition and the cloud that cameras see of the robot under it.

A condition is a command (one number for each tendon: m, or N for a tension drive), then in a data set with payloads the payload
(kg). Clouds are in the world frame (m).
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np
from numpy.typing import NDArray

from tdcr import _tdcr
from tdcr._arrays import Floats, Progress, as_array, as_count, as_float
from tdcr._files import as_file, as_path, write_whole
from tdcr._html import of_data
from tdcr._results import Result, is_row, row_of, rows_of
from tdcr.errors import InputError, MissingPackageError
from tdcr.robot import Robot

if TYPE_CHECKING:
    import torch.utils.data

PathLike = str | os.PathLike[str]
"""A path of a file or folder."""

Floats32 = NDArray[np.float32]
"""An array of float32."""

Bytes = NDArray[np.uint8]
"""An array of uint8."""

SplitName = Literal["train", "val", "test"]
"""Name of a split."""

_ROUNDING = 1e-6
"""What a condition may be outside its range, relative to that."""

SPLITS: tuple[SplitName, ...] = ("train", "val", "test")
"""Names of the splits, in their order."""


@dataclass(frozen=True, eq=False, repr=False)
class Sample(Result):
    """One sample of a data set of ``D`` numbers a condition and ``N`` points a cloud.

    Attributes:
        condition: Shape (D,), float32: the command (m or N), then where obstacles are if they are moved (m, rad), then the
            payload (kg) if there is one.
        points: Shape (N, 3), float32, world frame (m).
        colors: Shape (N, 3), uint8, RGB.
    """

    condition: Floats32
    points: Floats32
    colors: Bytes


@dataclass(frozen=True, eq=False, repr=False)
class Normalisation(Result):
    """The units that a network sees: conditions from 0 to 1, points divided by a length.

    Attributes:
        condition_min: Smallest value of each number of a condition, shape (D,).
        condition_max: Largest value of each number of a condition, shape (D,).
        scale: Length that points are divided by (m): the largest distance of a point from the origin.
    """

    condition_min: Floats
    condition_max: Floats
    scale: float

    def conditions(self, conditions: Any) -> Floats32:
        """Conditions, shape (..., D), in the units of a network, float32."""
        return ((self._rows(conditions) - self.condition_min) / self._widths).astype(np.float32)

    def points(self, points: Any) -> Floats32:
        """Points (m) in the units of a network, float32, of the same shape."""
        return (as_array(points, "points").astype(np.float64) / self.scale).astype(np.float32)

    def metres(self, points: Any) -> Floats32:
        """Points in the units of a network in metres, float32, of the same shape: the way back of :meth:`points`."""
        return (as_array(points, "points").astype(np.float64) * self.scale).astype(np.float32)

    def outside(self, conditions: Any) -> NDArray[np.bool_]:
        """Which numbers of conditions, shape (..., D), are outside their range, up to the rounding of float32."""
        values, margin = self._rows(conditions), _ROUNDING * self._widths
        outside: NDArray[np.bool_] = (values < self.condition_min - margin) | (values > self.condition_max + margin)
        return outside

    @property
    def _widths(self) -> Floats:
        """What conditions are divided by: their range, or 1 where they have none."""
        widths = self.condition_max - self.condition_min
        return np.where(widths > 0.0, widths, 1.0)

    def _rows(self, conditions: Any) -> Floats:
        values: Floats = as_array(conditions, "conditions").astype(np.float64)
        if values.shape[-1:] != self.condition_min.shape:
            raise InputError(f"conditions has shape {values.shape}; expected (..., {len(self.condition_min)})")
        return values


class Dataset(Sequence[Sample]):
    """A data set on disk: one of ours, or another program's in the same layout.

    It is a sequence of all its samples, those of ``train`` first, then ``val``, then ``test``. Samples are read when they are
    asked for, and no file stays open: data sets can be pickled, and used in forked and spawned processes.

    Args:
        path: Folder of the data set.

    Raises:
        DataError: If there is no data set, or it is unfinished, a part of one, or damaged. The message says which file.
    """

    path: str
    """Folder of the data set."""

    def __init__(self, path: PathLike) -> None:
        self.path = as_path(path, "path")
        self._native = _tdcr.Dataset(self.path)
        sizes = [self._native.sizes(split) for split in range(len(SPLITS))]
        self._lengths = [length for length, _, _ in sizes]
        self._points, self._width = sizes[0][1:]

    def split(self, name: SplitName) -> Split:
        """The samples of one split: ``"train"``, ``"val"`` or ``"test"``."""
        if name not in SPLITS:
            raise InputError(f"split {name!r}; expected one of {', '.join(SPLITS)}")
        return Split(self, name)

    @property
    def train(self) -> Split:
        """The samples that networks are fitted to: 80 %."""
        return self.split("train")

    @property
    def val(self) -> Split:
        """The samples that choose among networks: 10 %."""
        return self.split("val")

    @property
    def test(self) -> Split:
        """The samples of the figures that are reported: 10 %."""
        return self.split("test")

    def __len__(self) -> int:
        return sum(self._lengths)

    @overload
    def __getitem__(self, index: int) -> Sample: ...

    @overload
    def __getitem__(self, index: slice | Sequence[int] | NDArray[Any]) -> list[Sample]: ...

    def __getitem__(self, index: int | slice | Sequence[int] | NDArray[Any]) -> Sample | list[Sample]:
        """A sample; or, of a slice, a mask of flags or an array of numbers, a list of those samples."""
        if not is_row(index):
            return [self[k] for k in np.arange(len(self))[rows_of(index, len(self))].tolist()]
        place = row_of(index, len(self), "sample")
        for name, length in zip(SPLITS, self._lengths, strict=True):
            if place < length:
                return self.split(name)[place]
            place -= length
        raise IndexError(index)

    def __iter__(self) -> Iterator[Sample]:
        for name in SPLITS:
            yield from self.split(name)

    @cached_property
    def meta(self) -> dict[str, Any] | None:
        """What the data set was made with (``meta.json``); ``None`` for another program's."""
        text = self._native.meta()
        meta: dict[str, Any] | None = None if text is None else json.loads(text)
        return meta

    @cached_property
    def robot(self) -> Robot | None:
        """The robot that the clouds show; ``None`` where the data set does not say."""
        native = self._native.robot()
        return None if native is None else Robot._of(native)

    @property
    def points(self) -> int:
        """Points in each cloud ``N``."""
        return self._points

    @property
    def condition_width(self) -> int:
        """Numbers of a condition ``D``: the command, where obstacles are if they are moved, and the payload if there is one."""
        return self._width

    @property
    def base(self) -> bool | None:
        """Whether the cameras see the base; ``None`` where the data set does not say."""
        subject = self._subject
        return None if subject is None else subject["base"] == "shown"

    @property
    def vary_obstacles(self) -> tuple[float, float] | None:
        """How far obstacles are moved along (m) and turned about each axis (rad) for each sample; ``None`` where they stand."""
        moved = (self._subject or {}).get("obstacles")
        return None if moved is None else (moved["shift"], moved["turn"])

    @property
    def payload(self) -> tuple[float, float] | None:
        """Smallest payload besides 0 and largest (kg); ``None`` in a data set without payloads."""
        recorded = (self.meta or {}).get("origin", {}).get("recorded", {})
        hung = [mass for mass in recorded.get("recording", {}).get("payloads", []) if mass > 0.0]
        if hung:
            return (min(hung), max(hung))
        payload = (self._subject or {}).get("payload")
        return None if payload is None else (payload["min"], payload["max"])

    @property
    def condition_units(self) -> tuple[str | None, ...]:
        """Unit of each number of a condition: ``"m"``, ``"N"``, ``"rad"``, ``"kg"``; ``None`` where the data set does not say."""
        if self.robot is None:
            return (None,) * self._width
        loaded = 0 if self.payload is None else 1
        moved = self._width - self.robot.tendons - loaded
        turns = self.vary_obstacles is not None and self.vary_obstacles[1] > 0.0
        each = ("m", "m", "m", "rad", "rad", "rad") if turns else ("m", "m", "m")
        return self.robot.command_units + each * (moved // len(each)) + ("kg",) * loaded

    @cached_property
    def normalisation(self) -> Normalisation:
        """The units that a network of this data set sees."""
        return Normalisation(*self._native.units())

    def check(self, progress: Progress | None = None) -> list[str]:
        """Reads the whole data set and says what is wrong with it: nothing, where the list is empty.

        Args:
            progress: Is called with the number of shards read since its last call.

        Raises:
            DataError: For the first file that cannot be read.
        """
        return _tdcr.check_data(self.path, progress=progress)

    def info(self) -> dict[str, Any]:
        """Robot, splits, ranges, size on disk: what ``tdcr data info --json`` says of it."""
        info: dict[str, Any] = json.loads(_tdcr.data_info(self.path))
        return info

    def view(self, out: PathLike = "data.html", *, clouds: int = 8, progress: Progress | None = None) -> Path:
        """Draws the data set: workspace, histograms of commands and payloads, some of the clouds; as :func:`data_view`."""
        return data_view(self, out, clouds=clouds, progress=progress)

    @property
    def _subject(self) -> dict[str, Any] | None:
        origin = (self.meta or {}).get("origin", {})
        simulated = origin.get("simulated")
        return None if simulated is None else simulated["recipe"]["subject"]

    def __eq__(self, other: object) -> bool:
        return self.path == other.path if isinstance(other, Dataset) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.path)

    def __reduce__(self) -> tuple[Any, ...]:
        return Dataset, (self.path,)

    def _repr_html_(self) -> str:
        """What a notebook shows: a cloud, and a table."""
        return of_data(self)

    def __repr__(self) -> str:
        lengths = ", ".join(f"{length} {name}" for name, length in zip(SPLITS, self._lengths, strict=True))
        return f"Dataset({self.path!r}: {lengths}, {self._points} points a cloud)"


class Split(Sequence[Sample]):
    """The samples of one split of a data set, ``B`` of them, of ``N`` points and ``D`` numbers a condition."""

    def __init__(self, dataset: Dataset, name: SplitName) -> None:
        self.dataset = dataset
        self.name = name
        self._index = SPLITS.index(name)

    def __len__(self) -> int:
        return self.dataset._lengths[self._index]

    @overload
    def __getitem__(self, index: int) -> Sample: ...

    @overload
    def __getitem__(self, index: slice | Sequence[int] | NDArray[Any]) -> list[Sample]: ...

    def __getitem__(self, index: int | slice | Sequence[int] | NDArray[Any]) -> Sample | list[Sample]:
        """A sample; or, of a slice, a mask of flags or an array of numbers, a list of those samples."""
        if not is_row(index):
            return [self[k] for k in np.arange(len(self))[rows_of(index, len(self))].tolist()]
        place = row_of(index, len(self), "sample")
        conditions, points, colors = self._read(place, place + 1)
        return Sample(conditions[0], points[0], colors[0])

    def __iter__(self) -> Iterator[Sample]:
        for index in range(len(self)):
            yield self[index]

    @property
    def conditions(self) -> Floats32:
        """All conditions, shape (B, D), float32. No cloud is read."""
        return self.dataset._native.conditions(self._index)

    @property
    def clouds(self) -> Floats32:
        """Points of all clouds, shape (B, N, 3), float32, world frame (m): 12 bytes of memory a point."""
        return self.read()[1]

    @property
    def colors(self) -> Bytes:
        """Colours of all clouds, shape (B, N, 3), uint8, RGB."""
        return self.read()[2]

    def read(self, progress: Progress | None = None) -> tuple[Floats32, Floats32, Bytes]:
        """Reads all of the split: conditions (B, D), points (B, N, 3) (m) and colours (B, N, 3).

        Args:
            progress: Is called with the number of samples read since its last call.
        """
        return self._read(0, len(self), progress)

    def torch(
        self, *, normalised: bool = False, colors: bool = False, points: int | None = None, seed: int = 0
    ) -> torch.utils.data.Dataset[dict[str, torch.Tensor]]:
        """The split as a data set of PyTorch, whose items are read by whatever worker asks for them.

        Args:
            normalised: Conditions from 0 to 1 and points in units of the data set's scale, as :attr:`Dataset.normalisation`
                has it, in place of metres.
            colors: Whether items have colours.
            points: Points of each cloud that are kept, a random subset that follows from ``seed`` and the index; all by
                default.
            seed: Seed of the subsets.

        Returns:
            A map-style data set of dictionaries: ``condition`` (D,), ``points`` (``points``, 3), both float32, and with
            ``colors`` also ``colors`` (``points``, 3), float32 from 0 to 1.

        Raises:
            MissingPackageError: If PyTorch is not installed.
        """
        kept = self.dataset.points if points is None else as_count(points, "points", 1, self.dataset.points)
        try:
            from tdcr._torch_data import SplitView
        except ImportError as error:
            raise MissingPackageError("a view for PyTorch needs the package torch: pip install torch") from error
        return SplitView(self, normalised, colors, kept, as_seed(seed))

    def _read(self, start: int, stop: int, progress: Progress | None = None) -> tuple[Floats32, Floats32, Bytes]:
        return self.dataset._native.read(self._index, start, stop, progress=progress)

    def __eq__(self, other: object) -> bool:
        return (self.dataset, self.name) == (other.dataset, other.name) if isinstance(other, Split) else NotImplemented

    def __hash__(self) -> int:
        return hash((self.dataset, self.name))

    def __repr__(self) -> str:
        return f"Split({self.dataset.path!r}, {self.name!r}: {len(self)} samples)"


def data_view(
    data: Dataset | PathLike | Sequence[Dataset | PathLike],
    out: PathLike = "data.html",
    *,
    clouds: int = 8,
    progress: Progress | None = None,
) -> Path:
    """Draws data sets side by side: workspace, histograms of commands and payloads, some of the clouds; as ``tdcr data view``.

    Args:
        data: A data set or its folder, or several.
        out: The file to write: ``.html`` for all of it, ``.svg`` for the workspace, ``.png`` for the clouds of one data set.
        clouds: Clouds to show of each data set.
        progress: Is called with the number of samples whose robot has settled since its last call: the tips of simulated data
            sets are computed again.

    Returns:
        The file.

    Raises:
        InputError: For a file of another extension, and a ``.png`` of several data sets.
        DataError: For a data set that cannot be read.
    """
    one = isinstance(data, Dataset | str | os.PathLike) or not isinstance(data, Iterable)
    sets: list[Any] = [data] if one else [*data]  # type: ignore[misc]
    folders = [folder_of(found) for found in sets]
    if not folders:
        raise InputError("data is empty; expected a data set, or several")
    file = as_file(out, "out", ".html", ".svg", ".png")
    write_whole(file, _tdcr.draw_data(folders, os.fspath(file), as_count(clouds, "clouds", 1, MOST), progress=progress))
    return file


MOST = 10_000_000
"""Most points of a cloud, samples of a data set and so on."""


def as_payload(payload: Any) -> tuple[float, float] | None:
    """A range of payloads (kg), if there is one."""
    if payload is None:
        return None
    low, high = as_float(payload, "payload", (2,))
    return float(low), float(high)


def as_variation(vary_obstacles: Any, scene: Any) -> tuple[float, float] | None:
    """How far obstacles of a scene are moved (m) and turned (rad), if they are."""
    if vary_obstacles is None:
        return None
    if scene is None:
        raise InputError(f"vary_obstacles is {vary_obstacles!r} without obstacles; expected `scene`, or None")
    given = as_array(vary_obstacles, "vary_obstacles")
    shift, *turn = np.atleast_1d(as_float(given, "vary_obstacles", () if given.ndim == 0 else (2,))).tolist()
    return float(shift), float(turn[0]) if turn else 0.0


def as_seed(seed: Any) -> int:
    """A seed."""
    return as_count(seed, "seed", 0, 2**64 - 1)


def folder_of(data: Dataset | PathLike) -> str:
    """The folder of a data set."""
    return data.path if isinstance(data, Dataset) else as_path(data, "data")

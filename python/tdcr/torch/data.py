"""Training clouds: data sets in memory, streams, and both as `torch.utils.data.IterableDataset`s.

Samples are in the units that networks see: a condition (D,) in [0, 1], and rows (N, C) of positions divided by the
normalisation's scale and, where they are wanted, colours in [0, 1].

Of the datasets, every rank of a process group and every worker of a `DataLoader` gets a share of its own by stride: with R
ranks of W workers, worker w of rank r has the samples r + R (w + W k), k = 0, 1, ... As a `DataLoader` asks its workers in
turn, a rank sees its samples in their order whatever the number of workers.
"""

import hashlib
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor
from torch.utils.data import DataLoader, IterableDataset, get_worker_info

from tdcr import _tdcr, data
from tdcr.errors import InputError
from tdcr.stream import Stream
from tdcr.torch.ranks import group

#: A condition (D,) and the rows (N, C) of its cloud.
Sample = tuple[Tensor, Tensor]

#: Samples of a stream from here on validate: no step sees them.
VALIDATION = 1 << 62


@dataclass(frozen=True)
class CloudSet:
    """Clouds in memory."""

    #: Conditions (B, D), float32.
    conditions: Tensor
    #: Rows (B, N, C), float32.
    rows: Tensor
    #: What the clouds are of: `subject` (robot, base and payloads, or None), `normalisation`, and `reduction` where they are
    #: reduced by symmetries.
    provenance: dict[str, Any]

    @classmethod
    def read(
        cls,
        folder: str | Path,
        split: str = "train",
        *,
        colors: bool = False,
        units: dict[str, Any] | None = None,
        reduction: dict[str, Any] | None = None,
    ) -> Self:
        """Reads the split `train`, `val` or `test` of a data set of `tdcr collect` or `tdcr data import`.

        `units` is the normalisation of a model, to train on in its units, as `--normalisation-from` does; by default it is
        the data set's own. With the `reduction` of the data set (`find_reduction`) each cloud is replaced by the
        representative of its class, as `--symmetry auto` does.

        Raises:
            tdcr.errors.TdcrError: for whatever is wrong with the folder, by file.
        """
        normalisation = None if units is None else json.dumps(units)
        reduced = None if reduction is None else json.dumps(reduction)
        conditions, points, rgb, provenance = _tdcr.read_cloud_set(str(folder), split, normalisation, reduced, colors)
        return cls(torch.from_numpy(conditions), to_rows(points, rgb), json.loads(provenance))

    def __len__(self) -> int:
        return len(self.conditions)

    @property
    def points_per_cloud(self) -> int:
        """Points N of a cloud."""
        return self.rows.shape[1]

    @property
    def condition_dim(self) -> int:
        """Values D of a condition."""
        return self.conditions.shape[1]

    def to(self, device: torch.device) -> Self:
        """The same on a device."""
        return replace(self, conditions=self.conditions.to(device), rows=self.rows.to(device))

    def at_step(self, step: int) -> Self:
        """The clouds that step `step` (the first is 1) draws from: all."""
        return self

    def fingerprint(self) -> str:
        """A hash of all numbers, to tell whether two sets are the same."""
        found = hashlib.blake2b(digest_size=16)
        for values in (self.conditions, self.rows):
            found.update(str(tuple(values.shape)).encode())
            found.update(np.ascontiguousarray(values.cpu().numpy()).data)
        return found.hexdigest()


def find_reduction(folder: str | Path, colors: bool = False) -> tuple[dict[str, Any], str]:
    """How the clouds of a data set are reduced by the robot's symmetries that they have, and that in words.

    As `tdcr.Stream.find_reduction`; by none where the clouds are not simulated.
    """
    found, words = _tdcr.set_reduction(str(folder), colors)
    return json.loads(found), words


def to_rows(points: npt.NDArray[np.float32], rgb: npt.NDArray[np.uint8] | None) -> Tensor:
    """Rows (..., C) of positions (..., 3) and, if there are any, 8-bit colours (..., 3)."""
    positions = torch.from_numpy(points)
    return positions if rgb is None else torch.cat([positions, torch.from_numpy(rgb).float() / 255], dim=-1)


def tensors(sample: data.Sample, colors: bool) -> Sample:
    """A sample of a stream, as tensors."""
    return torch.from_numpy(sample.condition), to_rows(sample.points, sample.colors if colors else None)


class Shared(IterableDataset[Sample]):
    """A dataset of which every rank and worker has a share: of `rank` of `ranks`, by default those of the process group."""

    def __init__(self, rank: int | None, ranks: int | None) -> None:
        own, all_ranks = group()
        self.rank = own if rank is None else rank
        self.ranks = all_ranks if ranks is None else ranks
        if not 0 <= self.rank < self.ranks:
            raise InputError(f"rank is {self.rank}; expected 0 to {self.ranks - 1}")

    def share(self) -> tuple[int, int]:
        """First sample and stride of this process."""
        worker = get_worker_info()
        first, workers = (0, 1) if worker is None else (worker.id, worker.num_workers)
        return self.rank + self.ranks * first, self.ranks * workers


class SetSamples(Shared):
    """One pass over the clouds of a set, by shares; shares differ in length by one at most.

    With a `seed` the order is that of a random permutation, which is another one after `set_epoch`.
    """

    def __init__(self, clouds: CloudSet, seed: int | None = None, *, rank: int | None = None, ranks: int | None = None) -> None:
        super().__init__(rank, ranks)
        self.clouds, self.seed, self.epoch = clouds, seed, 0

    def set_epoch(self, epoch: int) -> None:
        """Chooses the permutation of pass `epoch`; to be called before the pass, as of a `DistributedSampler`."""
        self.epoch = epoch

    def __iter__(self) -> Iterator[Sample]:
        order = np.arange(len(self.clouds))
        if self.seed is not None:
            order = np.random.default_rng([self.seed, self.epoch]).permutation(order)
        first, stride = self.share()
        for index in order[first::stride].tolist():
            yield self.clouds.conditions[index], self.clouds.rows[index]


class StreamSamples(Shared):
    """Fresh samples of a simulated robot, by shares, without end.

    `stream` says what the samples are and at which one they start; it is not read from itself.
    """

    def __init__(self, stream: Stream, *, colors: bool = False, rank: int | None = None, ranks: int | None = None) -> None:
        super().__init__(rank, ranks)
        self.stream, self.colors = stream, colors

    def __iter__(self) -> Iterator[Sample]:
        first, stride = self.share()
        stream = self.stream.at(self.stream.index + self.stream.stride * first, self.stream.stride * stride)
        while True:
            yield tensors(stream.next_normalised(), self.colors)


class StreamWindow:
    """The newest `clouds` clouds of a stream, a window that moves on by `fresh` clouds a step.

    Step k (the first is 1) draws from the samples from floor((k - 1) fresh) on, so that what it sees follows from k alone:
    a step waits for its samples, and a run that is resumed makes those of its window anew. A GPU that outruns the cameras
    takes more steps in a window: `fresh` is 1, or below it. Of each window, a rank holds and makes its share, by stride.
    """

    def __init__(
        self,
        stream: Stream,
        *,
        clouds: int = 512,
        fresh: float = 1.0,
        workers: int = 0,
        colors: bool = False,
        rank: int | None = None,
        ranks: int | None = None,
    ) -> None:
        """`workers` are processes that simulate; without any, the process itself does, in between its steps.

        Raises:
            tdcr.errors.InputError: for a window that is empty or not a multiple of the ranks, and where no cloud is fresh.
        """
        shared = StreamSamples(stream, rank=rank, ranks=ranks)
        self.rank, self.ranks = shared.rank, shared.ranks
        if clouds < 1 or clouds % self.ranks:
            raise InputError(f"the window is of {clouds} clouds; expected a multiple of the {self.ranks} ranks")
        if not 0 < fresh < math.inf:
            raise InputError(f"{fresh} fresh clouds a step; expected a number above 0")
        self.stream, self.colors, self.fresh, self.workers = stream, colors, fresh, workers
        self.provenance = stream.provenance
        self.clouds, self.own = clouds, clouds // self.ranks
        self.device = torch.device("cpu")
        views = self.provenance.get("reduction", {}).get("views", [])
        self.condition_dim = len(stream.normalisation.condition_min) + (max(views) + 1 if views else 0)
        self.points_per_cloud = stream.points
        self.window: CloudSet | None = None
        self.samples: Iterator[Sample] | None = None
        #: Of the rank's samples, the next one that `samples` gives.
        self.next = 0

    def to(self, device: torch.device) -> Self:
        """Keeps the window on a device."""
        self.device = device
        return self

    def fingerprint(self) -> str:
        """What the clouds are functions of."""
        of = [self.stream.spec, self.stream.index, self.clouds, self.fresh]
        reduced = self.provenance.get("reduction")
        return json.dumps(of if reduced is None else [*of, reduced], sort_keys=True)

    def validation(self, clouds: int) -> CloudSet:
        """Clouds for validation, which no step sees."""
        held_out = self.stream.at(VALIDATION)
        samples = [tensors(held_out.next_normalised(), self.colors) for _ in range(clouds)]
        conditions, rows = zip(*samples, strict=True)
        return CloudSet(torch.stack(conditions), torch.stack(rows), self.provenance)

    def at_step(self, step: int) -> CloudSet:
        """The clouds of the rank that step `step` draws from; valid until the next call."""
        start = math.floor((step - 1) * self.fresh)
        # The rank's k-th sample is sample rank + ranks k of the stream.
        first, end = (-(-(place - self.rank) // self.ranks) for place in (start, start + self.clouds))
        if self.samples is None or not first <= self.next <= end:
            self.next = first
            self.samples = self.read(first)
        while self.next < end:
            condition, rows = next(self.samples)
            if self.window is None:
                self.window = CloudSet(
                    torch.zeros(self.own, *condition.shape, device=self.device),
                    torch.zeros(self.own, *rows.shape, device=self.device),
                    self.provenance,
                )
            place = self.next % self.own
            self.window.conditions[place], self.window.rows[place] = condition, rows
            self.next += 1
        assert self.window is not None
        return self.window

    def read(self, first: int) -> Iterator[Sample]:
        """The rank's samples from its sample `first` on."""
        stream = self.stream.at(self.stream.index + self.stream.stride * self.ranks * first, self.stream.stride)
        dataset = StreamSamples(stream, colors=self.colors, rank=self.rank, ranks=self.ranks)
        loader = DataLoader(
            dataset,
            batch_size=None,
            num_workers=self.workers,
            prefetch_factor=8 if self.workers else None,
        )
        return iter(loader)

"""What a robot touches where it settles in a scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tdcr import _tdcr
from tdcr._arrays import Floats
from tdcr._results import Result
from tdcr.scene import Scene

SLIDING = np.array(["free", "sticks", "slips"])
"""What :attr:`Contacts.sliding` has, by the native module's codes."""
_EXACTNESS = ("complementarity", "penetration", "shape_error")
"""What contacts have for each row."""


@dataclass(frozen=True, eq=False, repr=False)
class Contacts(Result):
    """The ``k`` places where a robot, or the robots of a batch, touch obstacles or themselves; vectors are of the world frame.

    Attributes:
        row: Row of the batch, shape (k,), ascending; None for a single equilibrium.
        disc: The disc that touches, shape (k,), from 0 at the base.
        obstacle: Number of the obstacle in the scene, shape (k,); -1 where the robot touches itself.
        other_disc: The disc that is touched, shape (k,), farther from the base; -1 where it is an obstacle. The opposite force
            acts on it.
        point: Where on the surface that is touched, shape (k, 3) (m).
        normal: The outward normal of that surface there, shape (k, 3).
        gap: Distance of the undeformed surfaces, shape (k,) (m): below 0 where they are pressed into each other.
        force: Force on the disc, shape (k, 3) (N).
        weak: Whether neither force nor gap is clearly above 0, shape (k,): after a small change such a contact may bear more, or
            none, so that derivatives differ from one side to the other.
        sliding: Whether it slides, shape (k,): ``"free"`` where nothing resists that, as there is no friction or none is known;
            ``"sticks"`` where friction holds it; ``"slips"`` where it slides against friction.
        complementarity: Largest product of a force and the distance of its surfaces after they have given way (J), 0 of exact
            contact: a number, or shape (rows,).
        penetration: Deepest overlap of the undeformed shapes (m): a number, or shape (rows,).
        shape_error: How far a plane that touches a disc may be from one that touches its beads (m): a number, or shape (rows,).
        names: Names of all obstacles of the scene, by their numbers.
    """

    row: NDArray[np.int64] | None
    disc: NDArray[np.int64]
    obstacle: NDArray[np.int64]
    other_disc: NDArray[np.int64]
    point: Floats
    normal: Floats
    gap: Floats
    force: Floats
    weak: NDArray[np.bool_]
    sliding: NDArray[np.str_]
    complementarity: Any
    penetration: Any
    shape_error: Any
    names: tuple[str, ...]

    @property
    def obstacle_names(self) -> tuple[str | None, ...]:
        """Name of the obstacle of each contact, None where the robot touches itself."""
        return tuple(self.names[number] if number >= 0 else None for number in self.obstacle.tolist())

    def __len__(self) -> int:
        return len(self.disc)

    @classmethod
    def _of(cls, found: _tdcr.ContactRows, scenes: Sequence[Scene]) -> Contacts:
        """Those of a batch."""
        by_name = {name: getattr(found, name) for name in cls.__dataclass_fields__ if name != "names"}
        by_name["sliding"] = SLIDING[found.sliding]
        return cls(**by_name, names=scenes[0].names)

    @classmethod
    def _of_one(cls, found: _tdcr.ContactRows, scene: Scene) -> Contacts:
        """Those of a single equilibrium."""
        return cls._of(found, [scene])._single(slice(None), 0)

    def _of_row(self, row: int) -> Contacts:
        """Those of one row of a batch."""
        start, end = np.searchsorted(self.row, (row, row + 1))  # type: ignore[arg-type]
        return self._single(slice(start, end), row)

    def _single(self, chosen: slice, row: int) -> Contacts:
        exactness: dict[str, Any] = {name: float(getattr(self, name)[row]) for name in _EXACTNESS}
        return replace(self, row=None, **self._chosen(chosen), **exactness)

    def _of_rows(self, rows: NDArray[np.intp]) -> Contacts:
        """Those of several rows of a batch, which count from 0 again."""
        starts, ends = np.searchsorted(self.row, rows), np.searchsorted(self.row, rows + 1)  # type: ignore[arg-type]
        counts = ends - starts
        chosen = np.concatenate([np.arange(start, end) for start, end in zip(starts, ends, strict=True)] or [starts])
        return replace(
            self,
            row=np.repeat(np.arange(len(rows)), counts),
            **self._chosen(chosen),
            **{name: getattr(self, name)[rows] for name in _EXACTNESS},
        )

    def _chosen(self, chosen: Any) -> dict[str, Any]:
        each = ("disc", "obstacle", "other_disc", "point", "normal", "gap", "force", "weak", "sliding")
        return {name: getattr(self, name)[chosen] for name in each}

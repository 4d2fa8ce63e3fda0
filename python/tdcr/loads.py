"""Loads on a robot besides its own weight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from tdcr import _tdcr
from tdcr._arrays import Floats, as_count, as_float, as_number, as_several
from tdcr.errors import InputError, LoadsError

Vector = tuple[float, float, float]


def _three(vector: Any, name: str) -> Vector:
    try:
        x, y, z = as_float(vector, name, (3,)).tolist()
    except InputError as error:
        raise LoadsError(str(error)) from None
    return x, y, z


def _number(value: Any, name: str) -> float:
    try:
        return as_number(value, name)
    except InputError as error:
        raise LoadsError(str(error)) from None


@dataclass(frozen=True)
class Wrench:
    """A force and a moment on a disc, or on a point fixed to it.

    Attributes:
        disc: The disc, from 0 at the base.
        force: Force on the point (N).
        moment: Moment (N m).
        frame: The frame that both are given in and keep their direction in: ``"world"``, or ``"disc"`` for a wrench that turns
            with its disc.
        point: The point that the force acts on, in the disc's frame whatever ``frame`` is (m).

    Raises:
        LoadsError: For numbers that are not finite, and a frame that is none.
    """

    disc: int
    force: Vector = (0.0, 0.0, 0.0)
    moment: Vector = (0.0, 0.0, 0.0)
    frame: Literal["world", "disc"] = "world"
    point: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not isinstance(self.frame, str) or self.frame not in ("world", "disc"):
            raise LoadsError(f"a wrench is given in the frame {self.frame!r}; expected 'world' or 'disc'")
        object.__setattr__(self, "disc", as_count(self.disc, "disc of a wrench"))
        for name in ("force", "moment", "point"):
            object.__setattr__(self, name, _three(getattr(self, name), f"{name} of a wrench"))


@dataclass(frozen=True)
class Loads:
    """Loads on a robot besides its own weight.

    Attributes:
        payload: Mass hung from the last disc (kg).
        payload_offset: Where it hangs, in the last disc's frame (m).
        wrenches: Forces and moments on discs.
        line: Force for each length of the backbone, world frame (N/m).

    Raises:
        LoadsError: For a negative mass, or numbers that are not finite.
    """

    payload: float = 0.0
    payload_offset: Vector = (0.0, 0.0, 0.0)
    wrenches: tuple[Wrench, ...] = ()
    line: Vector = (0.0, 0.0, 0.0)
    _native: _tdcr.Loads = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "payload", _number(self.payload, "payload"))
        object.__setattr__(self, "wrenches", tuple(as_several(self.wrenches, "wrenches", Wrench)))
        for name in ("payload_offset", "line"):
            object.__setattr__(self, name, _three(getattr(self, name), name))
        wrenches = [(w.disc, w.point, w.force, w.moment, w.frame == "disc") for w in self.wrenches]
        object.__setattr__(self, "_native", _tdcr.Loads(self.payload, self.payload_offset, wrenches, self.line))

    def __reduce__(self) -> tuple[Any, ...]:
        return Loads, (self.payload, self.payload_offset, self.wrenches, self.line)


NO_LOADS = Loads()
"""No loads but the robot's own weight."""


def one_load(loads: Loads | None, payload: Any = None) -> Loads:
    """Loads, or those of a payload (kg) that is given in their place."""
    if loads is None:
        return NO_LOADS if payload is None else Loads(payload=payload)
    if not isinstance(loads, Loads):
        raise InputError(f"loads are {loads!r}; expected tdcr.Loads")
    if payload is not None:
        raise InputError("the payload is given by `payload` beside `loads`; expected one of them")
    return loads


@dataclass(frozen=True)
class LoadRows:
    """Loads of each row of a batch, as the native module takes them."""

    base: list[_tdcr.Loads]
    payload: Floats | None
    wrench: Floats | None

    @classmethod
    def of(cls, loads: Loads | Sequence[Loads] | None, payload: Any, wrench: Any, rows: int, discs: int) -> LoadRows:
        """Reads the arguments that describe loads: see :func:`tdcr.settle_batch`."""
        base = [NO_LOADS] if loads is None else as_several(loads, "loads", Loads)
        if payload is not None and any(one.payload for one in base):
            raise InputError("the payload is given twice, by `payload` and by `loads`; expected one of them")
        masses, wrenches = _rows(payload, "payload", (rows,)), _rows(wrench, "wrench", (rows, discs, 6))
        return cls([one._native for one in base], masses, wrenches)


def native_loads(loads: Loads | None, payload: Any, wrench: Any, discs: int) -> tuple[_tdcr.Loads, float | None, Floats | None]:
    """Loads of a single row, as the native module takes them: see :func:`tdcr.settle`."""
    if loads is None:
        loads = NO_LOADS
    elif not isinstance(loads, Loads):
        raise InputError(f"loads is {loads!r}; expected tdcr.Loads")
    if payload is not None and loads.payload:
        raise InputError("the payload is given twice, by `payload` and by `loads`; expected one of them")
    mass = None if payload is None else as_number(payload, "payload")
    return loads._native, mass, None if wrench is None else as_float(wrench, "wrench", (discs, 6))


def _rows(value: Any, name: str, shape: tuple[int, ...]) -> Floats | None:
    """Rows of numbers, or one row that is for all."""
    if value is None:
        return None
    one_for_all = np.ndim(value) == len(shape) - 1
    numbers = as_float(value, name, shape[1:] if one_for_all else shape)
    return np.ascontiguousarray(np.broadcast_to(numbers, shape))

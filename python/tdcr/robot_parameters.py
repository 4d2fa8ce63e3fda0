"""The physical parameters of a robot: their names, values and units, and what each acts on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np

from tdcr._arrays import Floats
from tdcr.errors import ParameterError
from tdcr.robot import RobotLike, as_robot

_SHOWN = 20
"""Lines of a table of parameters that are shown at most."""


@dataclass(frozen=True)
class Parameter:
    """A physical parameter of a robot. Modules, discs and tendons count from 0.

    Attributes:
        name: As :meth:`tdcr.Robot.with_values`, :func:`tdcr.jacobian` and all others take it.
        value: In the robot, in its unit. Where the discs of a module or the holes of a body differ, their mean.
        unit: SI unit.
        acts_on: In words: ``"tendon 2"``, ``"module 1 (discs 5 to 9)"`` or ``"base"``.
        module: The module, where all its discs have the parameter in common.
        discs: These discs.
        tendons: The tendon that it is a parameter of.
        overlaps: Names of parameters that stand for the same numbers, so that they cannot be named with it: the radius of a
            body's holes, and the places of each.
        bounds: Smallest and largest value that a robot can have, in the unit; a size that cannot be 0 is above 0.
    """

    name: str
    value: float
    unit: str
    acts_on: str
    module: int | None
    discs: tuple[int, ...]
    tendons: tuple[int, ...]
    overlaps: tuple[str, ...]
    bounds: tuple[float, float]


class Parameters(Sequence[Parameter]):
    """The parameters of a robot, each once, by place or by name: ``parameters[0]``, ``parameters["gain[2]"]``."""

    def __init__(self, robot: str, parameters: Sequence[Parameter]) -> None:
        self._robot, self._all = robot, tuple(parameters)
        self._by_name = {parameter.name: parameter for parameter in self._all}

    @property
    def names(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(self._by_name)

    @property
    def values(self) -> Floats:
        """Their values, shape (p,)."""
        return np.array([parameter.value for parameter in self._all])

    def __len__(self) -> int:
        return len(self._all)

    @overload
    def __getitem__(self, which: int | str) -> Parameter: ...
    @overload
    def __getitem__(self, which: slice) -> Parameters: ...
    def __getitem__(self, which: int | str | slice) -> Parameter | Parameters:
        if isinstance(which, str):
            found = self._by_name.get(which)
            if found is None:
                raise ParameterError(
                    f"robot {self._robot!r} has no parameter {which!r} here; expected one of {', '.join(self.names)}"
                )
            return found
        if isinstance(which, slice):
            return Parameters(self._robot, self._all[which])
        return self._all[which]

    def __contains__(self, which: object) -> bool:
        return which in self._by_name if isinstance(which, str) else which in self._all

    def __eq__(self, other: object) -> bool:
        return self._all == other._all if isinstance(other, Parameters) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._all)

    def __repr__(self) -> str:
        shown = self._all if len(self) < _SHOWN else self._all[: _SHOWN - 2]
        rows = [(p.name, f"{p.value:.6g} {p.unit}", p.acts_on) for p in shown]
        widths = [max((len(row[column]) for row in rows), default=0) for column in range(2)]
        lines = [f"{len(self)} parameters of robot {self._robot!r}"]
        lines += [f"  {name:<{widths[0]}}  {value:<{widths[1]}}  {acts_on}" for name, value, acts_on in rows]
        if len(shown) < len(self):
            lines.append(f"  ... and {len(self) - len(shown)} more")
        return "\n".join(lines)


def parameters(robot: RobotLike) -> Parameters:
    """The physical parameters of a robot that have values: names, values, units, and what each acts on.

    Commands and loads are named besides them (``"command[0]"``, ``"payload"``, ``"force[9].x"``): see :mod:`tdcr.sensitivity`.

    >>> import tdcr
    >>> radius = tdcr.parameters(tdcr.Robot("2m"))["hole_radius[5]"]
    >>> round(radius.value, 4), radius.unit, radius.acts_on
    (0.0125, 'm', 'module 1 (discs 5 to 9)')
    """
    robot = as_robot(robot)
    every = robot._native.parameters()
    return Parameters(
        robot.name,
        [
            Parameter(name, value, unit, acts_on, module, tuple(discs), tuple(tendons), tuple(overlaps), bounds)
            for name, value, unit, acts_on, module, discs, tendons, overlaps, bounds in every
        ],
    )

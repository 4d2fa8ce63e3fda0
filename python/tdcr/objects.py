"""Objects: obstacles of a scene that have a mass, and so move."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tdcr._arrays import Floats, as_float, as_number
from tdcr._results import Result
from tdcr.errors import InputError

_STATE = {"position": 3, "orientation": 4, "velocity": 3, "angular_velocity": 3}
"""What an object's state consists of, and of how many numbers each."""


@dataclass(frozen=True)
class Hinge:
    """A joint by which an object turns about an axis, like a door. Angle 0 is where the scene has the object.

    Attributes:
        axis: Direction of the axis in the object's frame, shape (3,); normalised on use.
        anchor: A point on it in the object's frame, shape (3,) (m).
        limits: Smallest and largest angle (rad), 0 in between, within half a turn; None for a hinge that turns on and on.
        damping: Viscous damping (N m s/rad).

    Raises:
        InputError: For values of the wrong type or shape, or not finite.
    """

    axis: Any
    anchor: Any = (0.0, 0.0, 0.0)
    limits: Any = None
    damping: float = 0.0

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "axis", _numbers(self.axis, "axis", 3))
        put(self, "anchor", _numbers(self.anchor, "anchor", 3))
        put(self, "limits", None if self.limits is None else _numbers(self.limits, "limits", 2))
        put(self, "damping", as_number(self.damping, "damping"))

    def _fields(self) -> dict[str, Any]:
        """What a scene's file says of it."""
        limits = {} if self.limits is None else {"limits": self.limits}
        return {"hinge": {"axis": self.axis, "anchor": self.anchor, "damping": self.damping} | limits}


@dataclass(frozen=True)
class Slider:
    """A joint by which an object moves along an axis, like a drawer. Position 0 is where the scene has the object.

    Attributes:
        axis: Direction in the object's frame, shape (3,); normalised on use.
        limits: Smallest and largest way along it (m), 0 in between; None for a slider without an end.
        damping: Viscous damping (N s/m).

    Raises:
        InputError: For values of the wrong type or shape, or not finite.
    """

    axis: Any
    limits: Any = None
    damping: float = 0.0

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "axis", _numbers(self.axis, "axis", 3))
        put(self, "limits", None if self.limits is None else _numbers(self.limits, "limits", 2))
        put(self, "damping", as_number(self.damping, "damping"))

    def _fields(self) -> dict[str, Any]:
        """What a scene's file says of it."""
        limits = {} if self.limits is None else {"limits": self.limits}
        return {"slider": {"axis": self.axis, "damping": self.damping} | limits}


def joint_of(fields: Any) -> Hinge | Slider:
    """The joint of which a scene's file says this."""
    ((kind, values),) = fields.items()
    return Hinge(**values) if kind == "hinge" else Slider(**values)


def _numbers(value: Any, name: str, count: int) -> Any:
    return tuple(as_float(value, name, (count,)).tolist())


@dataclass(frozen=True, eq=False, repr=False)
class Objects(Result):
    """Where the ``m`` objects of a scene are, and how they move: now, or after each of ``T`` commands. By name they are those of
    one object, without the axis of ``m``: ``motion.objects["box"].position`` has the shape (T, 3).

    Attributes:
        names: Names of the objects, in the order of their numbers in the scene.
        position: Origin of each object's frame, shape (m, 3) or (T, m, 3), world frame (m).
        orientation: Quaternion (w, x, y, z) of that frame in the world, shape (m, 4) or (T, m, 4).
        velocity: Velocity of that origin, shape (m, 3) or (T, m, 3), world axes (m/s).
        angular_velocity: Shape (m, 3) or (T, m, 3), world axes (rad/s).
        force: Sum of the forces of the robot's contacts on the object in the last time step, shape (m, 3) or (T, m, 3), world
            axes (N).
    """

    names: tuple[str, ...]
    position: Floats
    orientation: Floats
    velocity: Floats
    angular_velocity: Floats
    force: Floats

    @classmethod
    def _of(cls, names: tuple[str, ...], numbers: Floats) -> Objects:
        """Those of rows of numbers, shape (..., m, 16)."""
        parts = np.split(numbers, np.cumsum((3, 4, 3, 3)), axis=-1)
        return cls(names, *(np.ascontiguousarray(part) for part in parts))

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, name: str) -> Objects:
        """One of them, by its name."""
        if name not in self.names:
            raise KeyError(f"there is no object {name!r}; expected one of {', '.join(self.names) or 'none'}")
        at = self.names.index(name)
        parts = (self.position, self.orientation, self.velocity, self.angular_velocity, self.force)
        return Objects((name,), *(part[..., at, :] for part in parts))


def object_states(objects: Any, names: tuple[str, ...]) -> Floats:
    """States of all objects of a scene as rows of numbers, shape (m, 13)."""
    if not isinstance(objects, Objects) or objects.names != names or np.ndim(objects.position) != 2:
        raise InputError(f"objects is {objects!r}; expected what `MovingRobot.objects` of the same scene gave, of {names}")
    parts = (as_float(getattr(objects, part), f"objects.{part}", (len(names), width)) for part, width in _STATE.items())
    return np.ascontiguousarray(np.concatenate(list(parts), axis=-1))

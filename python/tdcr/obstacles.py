"""Obstacles: what scenes consist of."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tdcr._arrays import as_float, as_number, as_text
from tdcr._files import as_path
from tdcr.errors import InputError, SceneError
from tdcr.objects import Hinge, Slider, joint_of

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True)
class Obstacle:
    """A thing in the world that a robot may touch. Made by its shape: ``Obstacle.sphere("ball", 0.02, position=(0.1, 0, 0.2))``.

    All builders take the attributes from ``position`` on as keywords. :class:`Scene` checks sizes and numbers.

    Attributes:
        name: Name, no other obstacle's of its scene.
        kind: ``"half_space"``, ``"box"``, ``"sphere"``, ``"capsule"``, ``"cylinder"``, ``"pipe"`` or ``"mesh"``.
        position: Origin of the obstacle's frame in the world (m).
        orientation: Quaternion (w, x, y, z) of that frame in the world, normalised on use.
        compliance: How far the surface gives way for each newton (m/N). Below 1e-8 m/N it counts as that in contact.
        friction: Coefficient of friction, in motion and along paths.
        color: Red, green and blue under full light, 0 to 255.
        mass: Mass of an obstacle that moves, an object (kg), or None for one that is fixed. Equilibria take objects as fixed.
        velocity: Velocity of an object's origin at the start, world axes (m/s).
        angular_velocity: Its angular velocity at the start, world axes (rad/s).
        joint: A :class:`Hinge` or :class:`Slider` between an object and the world, or None for one that moves freely.

    Raises:
        SceneError: For values of the wrong type or shape, or not finite.
    """

    name: str
    kind: str
    position: Vector = (0.0, 0.0, 0.0)
    orientation: Quaternion = (1.0, 0.0, 0.0, 0.0)
    compliance: float = 1e-6
    friction: float = 0.0
    color: tuple[int, int, int] = (150, 140, 125)
    mass: float | None = None
    velocity: Vector = (0.0, 0.0, 0.0)
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    joint: Hinge | Slider | None = None
    _size: tuple[tuple[str, Any], ...] = field(default=(), repr=False, kw_only=True)

    def __post_init__(self) -> None:
        try:
            what = f"of obstacle {as_text(self.name, 'name of an obstacle')!r}"
            put = object.__setattr__
            put(self, "position", numbers_of(self.position, f"position {what}", 3))
            put(self, "orientation", numbers_of(self.orientation, f"orientation {what}", 4))
            put(self, "compliance", as_number(self.compliance, f"compliance {what}"))
            put(self, "friction", as_number(self.friction, f"friction {what}"))
            put(self, "color", _color(self.color, f"color {what}"))
            if self.mass is not None:
                put(self, "mass", as_number(self.mass, f"mass {what}"))
            put(self, "velocity", numbers_of(self.velocity, f"velocity {what}", 3))
            put(self, "angular_velocity", numbers_of(self.angular_velocity, f"angular_velocity {what}", 3))
            if not isinstance(self.joint, Hinge | Slider | None):
                raise InputError(f"joint {what} is {self.joint!r}; expected a tdcr.Hinge or a tdcr.Slider")
            put(self, "_size", tuple((name, _checked(name, value, what)) for name, value in self._size))
        except InputError as error:
            raise SceneError(str(error)) from None

    @property
    def size(self) -> dict[str, Any]:
        """The numbers of the shape, by the arguments of its builder: ``{"radius": 0.02}`` (m)."""
        return dict(self._size)

    @classmethod
    def half_space(cls, name: str, **surface: Any) -> Obstacle:
        """All that is below the obstacle's x-y plane."""
        return _made(cls, name, "half_space", surface)

    @classmethod
    def box(cls, name: str, size: Any, **surface: Any) -> Obstacle:
        """A box of whole sides, shape (3,) (m), about the origin of its frame."""
        return _made(cls, name, "box", surface, size=size)

    @classmethod
    def sphere(cls, name: str, radius: float, **surface: Any) -> Obstacle:
        """A sphere of a radius (m)."""
        return _made(cls, name, "sphere", surface, radius=radius)

    @classmethod
    def capsule(cls, name: str, radius: float, length: float, **surface: Any) -> Obstacle:
        """A capsule about its z axis, of a radius and the distance of its balls' centres (m)."""
        return _made(cls, name, "capsule", surface, radius=radius, length=length)

    @classmethod
    def cylinder(cls, name: str, radius: float, length: float, **surface: Any) -> Obstacle:
        """A cylinder about its z axis, of a radius and a length (m)."""
        return _made(cls, name, "cylinder", surface, radius=radius, length=length)

    @classmethod
    def pipe(cls, name: str, radius: float, length: float | None = None, *, path: Any = None, **surface: Any) -> Obstacle:
        """A pipe of a radius (m): straight along its z axis, of a ``length`` (m), or along the line through the points of a
        ``path``, shape (points, 3), in its own frame (m)."""
        if (length is None) == (path is None):
            raise SceneError(f"pipe {name!r} has length {length!r} and path {path!r}; expected one of them")
        size = {"length": length} if path is None else {"path": path}
        return _made(cls, name, "pipe", surface, radius=radius, **size)

    @classmethod
    def mesh(
        cls,
        name: str,
        file: str | os.PathLike[str] | None = None,
        scale: float = 1.0,
        *,
        vertices: Any = None,
        triangles: Any = None,
        **surface: Any,
    ) -> Obstacle:
        """Triangles of an STL file, which a :class:`Scene` reads when it is made, or of arrays.

        Args:
            name: Name.
            file: The STL file.
            scale: What the file's numbers, or those of ``vertices``, are multiplied with to give metres.
            vertices: In place of a file the vertices in the obstacle's frame, shape (v, 3).
            triangles: The vertices of each triangle, by their numbers from 0, shape (t, 3), counterclockwise as seen from
                outside.
        """
        if (file is None) != (vertices is not None and triangles is not None):
            given = [word for word, one in (("file", file), ("vertices", vertices), ("triangles", triangles)) if one is not None]
            raise SceneError(f"mesh {name!r} is given {given}; expected `file`, or `vertices` and `triangles`")
        if file is not None:
            return _made(cls, name, "mesh", surface, file=os.path.abspath(as_path(file, "file")), scale=scale)
        try:
            what = f"of obstacle {as_text(name, 'name of an obstacle')!r}"
            points = as_number(scale, f"scale {what}") * as_float(vertices, f"vertices {what}", ("vertices", 3))
        except InputError as error:
            raise SceneError(str(error)) from None
        return _made(cls, name, "mesh", surface, vertices=points, triangles=triangles)

    def _fields(self) -> dict[str, Any]:
        """What a scene's file says of it."""
        fields: dict[str, Any] = {
            "name": self.name,
            self.kind: self.size,
            "position": self.position,
            "orientation": self.orientation,
            "compliance": self.compliance,
            "friction": self.friction,
            "color": self.color,
        }
        if self.mass is not None:
            fields["mass"] = self.mass
        # A file says of what is fixed that it does not move, by saying nothing.
        fields |= {name: value for name in ("velocity", "angular_velocity") if any(value := getattr(self, name))}
        return fields if self.joint is None else fields | {"joint": self.joint._fields()}

    @classmethod
    def _of(cls, fields: Mapping[str, Any]) -> Obstacle:
        """The obstacle of which a scene's file says this."""
        surface = {name: value for name, value in fields.items() if name in _SURFACE}
        (kind,) = fields.keys() - surface.keys() - {"name"}
        if "joint" in surface:
            surface["joint"] = joint_of(surface["joint"])
        return _made(cls, fields["name"], kind, surface, **fields[kind])


_SURFACE = ("position", "orientation", "compliance", "friction", "color", "mass", "velocity", "angular_velocity", "joint")
"""Attributes that every obstacle has."""


def _made(cls: type[Obstacle], name: str, kind: str, surface: Mapping[str, Any], **size: Any) -> Obstacle:
    if unknown := surface.keys() - set(_SURFACE):
        raise SceneError(f"obstacle {name!r} is given {sorted(unknown)}; expected {', '.join(_SURFACE)}")
    return cls(name, kind, **surface, _size=tuple(size.items()))


def numbers_of(value: Any, name: str, count: int) -> Any:
    """So many finite numbers as a tuple."""
    return tuple(as_float(value, name, (count,)).tolist())


def _color(value: Any, name: str) -> Any:
    color = numbers_of(value, name, 3)
    if not all(one in range(256) for one in color):
        raise InputError(f"{name} is {value!r}; expected three whole numbers from 0 to 255")
    return tuple(int(one) for one in color)


def _checked(name: str, value: Any, what: str) -> Any:
    """A number, or what else gives a shape, by its name."""
    if name == "file":
        return value
    if name in ("path", "vertices"):
        return tuple(tuple(point) for point in as_float(value, f"{name} {what}", ("points", 3)).tolist())
    if name == "triangles":
        return _triangles(value, f"{name} {what}")
    return numbers_of(value, f"size {what}", 3) if name == "size" else as_number(value, f"{name} {what}")


def _triangles(value: Any, name: str) -> tuple[tuple[int, ...], ...]:
    """Triples of numbers of vertices."""
    numbers = as_float(value, name, ("triangles", 3))
    wrong = np.argwhere((numbers < 0) | (numbers >= 2**32) | (numbers != np.floor(numbers)))
    if wrong.size:
        row, column = wrong[0].tolist()
        raise InputError(f"{name}[{row}][{column}] is {numbers[row, column]:g}; expected the number of a vertex, from 0")
    return tuple(tuple(row) for row in numbers.astype(np.int64).tolist())

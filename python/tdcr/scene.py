"""Scenes: obstacles around a robot."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, overload

from tdcr import _tdcr
from tdcr._arrays import Floats, as_float, as_number, as_text
from tdcr._dictionary import in_its_words
from tdcr._files import as_path, write_whole
from tdcr._results import is_row
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
        friction: Coefficient of friction, which equilibria do not know yet.
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
            put(self, "position", _numbers(self.position, f"position {what}", 3))
            put(self, "orientation", _numbers(self.orientation, f"orientation {what}", 4))
            put(self, "compliance", as_number(self.compliance, f"compliance {what}"))
            put(self, "friction", as_number(self.friction, f"friction {what}"))
            put(self, "color", _color(self.color, f"color {what}"))
            if self.mass is not None:
                put(self, "mass", as_number(self.mass, f"mass {what}"))
            put(self, "velocity", _numbers(self.velocity, f"velocity {what}", 3))
            put(self, "angular_velocity", _numbers(self.angular_velocity, f"angular_velocity {what}", 3))
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
    def mesh(cls, name: str, file: str | os.PathLike[str], scale: float = 1.0, **surface: Any) -> Obstacle:
        """Triangles of an STL file, whose numbers times ``scale`` are metres; a :class:`Scene` reads it when it is made."""
        return _made(cls, name, "mesh", surface, file=os.path.abspath(as_path(file, "file")), scale=scale)

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


def _numbers(value: Any, name: str, count: int) -> Any:
    return tuple(as_float(value, name, (count,)).tolist())


def _color(value: Any, name: str) -> Any:
    color = _numbers(value, name, 3)
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
        return tuple(tuple(int(vertex) for vertex in row) for row in as_float(value, f"{name} {what}", ("triangles", 3)).tolist())
    return _numbers(value, f"size {what}", 3) if name == "size" else as_number(value, f"{name} {what}")


class Scene(Sequence[Obstacle]):
    """Obstacles around a robot, which is not one of them. By number or by name: ``scene[0]``, ``scene["ball"]``.

    Scenes never change; :meth:`moved` makes others. They compare by what they consist of, and can be pickled: meshes by the
    paths of their files, which are read again.

    Args:
        obstacles: The obstacles, in the order of their numbers, or a scene.

    Raises:
        SceneError: For two obstacles of one name, sizes and numbers that no obstacle can have, and meshes that cannot be read.
            The message names the obstacle and the field.
    """

    __slots__ = ("_names", "_native", "_text")

    _native: _tdcr.Scene
    _names: tuple[str, ...]
    _text: str

    def __init__(self, obstacles: Iterable[Obstacle] = ()) -> None:
        if isinstance(obstacles, Scene):
            self._keep(obstacles._native)
            return
        if isinstance(obstacles, str) or not isinstance(obstacles, Iterable):
            raise SceneError(f"a scene of {obstacles!r}; expected a list of tdcr.Obstacle, or `Scene.load` of a file")
        several = list(obstacles)
        for number, one in enumerate(several):
            if not isinstance(one, Obstacle):
                raise SceneError(f"obstacle {number} is {one!r}; expected a tdcr.Obstacle")
        text = json.dumps({"obstacle": [one._fields() for one in several]})
        with in_its_words(text):
            self._keep(_tdcr.Scene.from_json(text))

    def _keep(self, native: _tdcr.Scene) -> None:
        self._native, self._names, self._text = native, tuple(native.names()), native.to_json()

    @classmethod
    def _of(cls, native: _tdcr.Scene) -> Scene:
        scene = cls.__new__(cls)
        scene._keep(native)
        return scene

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Scene:
        """Reads a scene's file (TOML): the guide *Scene files* has its fields. Meshes with relative paths are beside it.

        Of a MuJoCo model (``.xml``) it is what stands still there and touches what moves; what a scene has no place for is warned
        of.

        Raises:
            SceneError: For a file that cannot be read, or is not that of a scene. The message names the obstacle and the field.
        """
        native, notes = _tdcr.Scene.load(as_path(path, "path"))
        for note in notes:
            warnings.warn(note, stacklevel=2)
        return cls._of(native)

    @classmethod
    def from_json(cls, text: str) -> Scene:
        """A scene from the JSON text of a scene's file; meshes with relative paths are in the working directory."""
        return cls._of(_tdcr.Scene.from_json(as_text(text, "text")))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the obstacles, by their numbers."""
        return self._names

    @property
    def objects(self) -> tuple[str, ...]:
        """Names of the objects: the obstacles that have a mass, so that they move, in the order of their numbers."""
        return tuple(one["name"] for one in json.loads(self._text).get("obstacle", []) if "mass" in one)

    @property
    def self_contact(self) -> float | None:
        """How far discs of the robot that touch each other give way (m/N), 1e-6 by default; None where they pass through each
        other. Neighbours always do."""
        return self._native.self_contact()

    def with_self_contact(self, compliance: float | None) -> Scene:
        """This scene for robots whose discs give way so far where they touch each other (m/N); with None they pass through.

        Raises:
            SceneError: For a compliance below 0 or not finite.
        """
        try:
            own = "ignored" if compliance is None else {"compliance": as_number(compliance, "compliance")}
        except InputError as error:
            raise SceneError(str(error)) from None
        return Scene.from_json(json.dumps(json.loads(self._text) | {"self_contact": own}))

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """The obstacles, by their numbers."""
        return tuple(Obstacle._of(fields) for fields in json.loads(self._text).get("obstacle", []))

    def find(self, obstacle: str | int) -> int:
        """The number of an obstacle, from its name or a number that may count from the end.

        Raises:
            SceneError: If there is no such obstacle.
        """
        if isinstance(obstacle, str):
            if obstacle in self._names:
                return self._names.index(obstacle)
            raise SceneError(f"the scene has no obstacle {obstacle!r}; expected one of {', '.join(self._names) or 'none'}")
        count = len(self)
        number = obstacle.__index__() if is_row(obstacle) else None
        if number is None or not -count <= number < count:
            raise SceneError(f"obstacle {obstacle!r} of {count}; expected a name, or a number from 0")
        return int(number) % count

    def moved(self, obstacle: str | int, position: Any = None, orientation: Any = None) -> Scene:
        """This scene with one obstacle elsewhere.

        Args:
            obstacle: Its name or number.
            position: Origin of its frame in the world, shape (3,) (m); where it is by default.
            orientation: Quaternion (w, x, y, z) of its frame in the world; as it is by default.

        Raises:
            SceneError: If there is no such obstacle, and for a pose that it cannot have.
        """
        number = self.find(obstacle)
        try:
            where = None if position is None else _numbers(position, "position", 3)
            turned = None if orientation is None else _numbers(orientation, "orientation", 4)
            if turned is not None and not any(turned):
                raise InputError(f"orientation is {orientation!r}; expected a quaternion (w, x, y, z), not all 0")
        except InputError as error:
            raise SceneError(str(error)) from None
        return Scene._of(self._native.moved([(number, where, turned)]))

    def _placed(self, poses: Floats) -> Scene:
        """This scene with other poses of all obstacles: positions (m) and quaternions (w, x, y, z), not 0, shape (m, 7)."""
        if poses.shape != (len(self), 7):
            raise InputError(f"{poses.shape[0]} poses; expected {len(self)}, one for each obstacle of the scene")
        return Scene._of(self._native.moved([(k, (*pose[:3],), (*pose[3:],)) for k, pose in enumerate(poses.tolist())]))

    def to_json(self) -> str:
        """The scene's file as JSON text: ``Scene.from_json(scene.to_json()) == scene``."""
        return self._text

    def to_toml(self) -> str:
        """The scene's file. Meshes are named by absolute paths."""
        return self._native.to_toml()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the scene's file (``.toml``). A file that is there already is replaced, by the whole new one or not at all."""
        file = Path(as_path(path, "path"))
        if file.suffix != ".toml":
            raise InputError(f"cannot write a scene to {file}; expected a name that ends in .toml")
        write_whole(file, self.to_toml().encode())

    def __len__(self) -> int:
        return len(self._names)

    @overload
    def __getitem__(self, which: int | str) -> Obstacle: ...
    @overload
    def __getitem__(self, which: slice) -> tuple[Obstacle, ...]: ...
    def __getitem__(self, which: int | str | slice) -> Obstacle | tuple[Obstacle, ...]:
        if isinstance(which, slice):
            return self.obstacles[which]
        return Obstacle._of(json.loads(self._text)["obstacle"][self._place(which)])

    def _place(self, which: Any) -> int:
        try:
            return self.find(which)
        except SceneError as error:
            raise (KeyError if isinstance(which, str) else IndexError)(str(error)) from None

    def __iter__(self) -> Iterator[Obstacle]:
        return iter(self.obstacles)

    def __contains__(self, which: object) -> bool:
        return which in (self._names if isinstance(which, str) else self.obstacles)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Scene):
            return NotImplemented
        return self._native is other._native or self._text == other._text

    def __hash__(self) -> int:
        return hash(self._text)

    def __reduce__(self) -> tuple[Any, ...]:
        return Scene.from_json, (self._text,)

    def __copy__(self) -> Scene:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Scene:
        return self

    def __repr__(self) -> str:
        shown = [repr(name) for name in self._names[:8]]
        more = ["..."] if len(self) > len(shown) else []
        count = f"{len(self)} obstacle{'' if len(self) == 1 else 's'}"
        return f"Scene({count}{': ' if shown else ''}{', '.join(shown + more)})"


@cache
def nothing() -> Scene:
    """The scene in which nothing is touched."""
    return Scene().with_self_contact(None)


def as_scene(scene: Any) -> Scene:
    """A scene, if it is one."""
    if not isinstance(scene, Scene):
        hint = "; tdcr.Scene.load reads one from a file" if isinstance(scene, (str, os.PathLike)) else ""
        raise InputError(f"scene is {scene!r}; expected a tdcr.Scene{hint}")
    return scene


def as_scenes(scene: Scene | Sequence[Scene], rows: int) -> list[Scene]:
    """One scene for all rows, or one for each, all with obstacles of the same names."""
    if isinstance(scene, Scene):
        return [scene]
    if isinstance(scene, str) or not isinstance(scene, Iterable):
        raise InputError(f"scene is {scene!r}; expected a tdcr.Scene, or one for each row")
    scenes = [as_scene(one) for one in scene]
    if len(scenes) != rows or not scenes:
        raise InputError(f"there are {len(scenes)} scenes; expected one, or {rows}, one for each row")
    for row, one in enumerate(scenes):
        if one.names != scenes[0].names:
            raise InputError(f"the scene of row {row} has obstacles {one.names}; expected those of row 0, {scenes[0].names}")
    return scenes

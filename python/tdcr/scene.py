"""Scenes: obstacles around a robot."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, overload

from tdcr import _tdcr
from tdcr._arrays import Floats, as_number, as_text
from tdcr._dictionary import in_its_words
from tdcr._files import as_path, write_whole
from tdcr._results import is_row
from tdcr.contact_law import ContactLaw, law_fields, law_of
from tdcr.errors import InputError, SceneError
from tdcr.obstacles import Obstacle, numbers_of

_LARGEST_FILE = 16 << 20
"""Bytes of the largest scene's file that is read."""


class Scene(Sequence[Obstacle]):
    """Obstacles around a robot, which is not one of them. By number or by name: ``scene[0]``, ``scene["ball"]``.

    Scenes never change; :meth:`moved` makes others. They compare by what they consist of, and can be pickled: meshes by the
    paths of their files, which are read again, or by their vertices and triangles where they were made of those.

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

    @property
    def self_friction(self) -> float:
        """Coefficient of friction between discs of the robot, along paths and in motion; 0 by default."""
        return self._native.self_friction()

    def with_self_contact(self, compliance: float | None, friction: float = 0.0) -> Scene:
        """This scene for robots whose discs give way so far where they touch each other (m/N); with None they pass through.

        Args:
            compliance: How far they give way (m/N), or None.
            friction: Their coefficient of friction, along paths and in motion. Derivatives refuse it.

        Raises:
            SceneError: For a compliance or friction below 0 or not finite.
        """
        try:
            touching = {"compliance": compliance, "friction": friction}
            own = "ignored" if compliance is None else {key: as_number(value, key) for key, value in touching.items()}
        except InputError as error:
            raise SceneError(str(error)) from None
        return Scene.from_json(json.dumps(json.loads(self._text) | {"self_contact": own}))

    @property
    def contact_law(self) -> ContactLaw:
        """How contacts push in motion: a :class:`Compliant` or an :class:`Impedance`. At rest surfaces give way by their
        compliance under either."""
        return law_of(json.loads(self._text).get("contact_law"))

    def with_contact_law(self, law: ContactLaw) -> Scene:
        """This scene with contacts that push so in motion.

        Raises:
            InputError: For what is no law.
            SceneError: For a relaxation time outside of 0 to 1 s, and parameters that MuJoCo's contacts cannot have.
        """
        return Scene.from_json(json.dumps(json.loads(self._text) | {"contact_law": law_fields(law)}))

    @property
    def smoothing(self) -> float:
        """What the product of a contact's force and of the distance of its surfaces is at rest (J); 0 in exact contact."""
        return float(json.loads(self._text).get("smoothing", 0.0))

    def with_smoothing(self, smoothing: float) -> Scene:
        """This scene with surfaces that push each other at rest already from afar (J): equilibria are then smooth functions of
        obstacles that are not touched yet, and have gradients by them. Motions have exact contact.

        Raises:
            SceneError: For a smoothing outside of 0 to 1 J.
        """
        try:
            number = as_number(smoothing, "smoothing")
        except InputError as error:
            raise SceneError(str(error)) from None
        return Scene.from_json(json.dumps(json.loads(self._text) | {"smoothing": number}))

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
            where = None if position is None else numbers_of(position, "position", 3)
            turned = None if orientation is None else numbers_of(orientation, "orientation", 4)
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
        """The scene's file. Meshes of files are named by absolute paths, those of arrays written by their numbers."""
        return self._native.to_toml()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the scene's file (``.toml``). A file that is there already is replaced, by the whole new one or not at all.

        Raises:
            SceneError: For meshes of arrays with so many numbers that the file could not be read again: write those to STL files.
        """
        file = Path(as_path(path, "path"))
        if file.suffix != ".toml":
            raise InputError(f"cannot write a scene to {file}; expected a name that ends in .toml")
        text = self.to_toml().encode()
        if len(text) > _LARGEST_FILE:
            raise SceneError(
                f"the scene's file would have {len(text)} bytes; expected {_LARGEST_FILE} at most: name large meshes by STL files"
            )
        write_whole(file, text)

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

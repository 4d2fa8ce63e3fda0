"""Robots: those that the paper calls 2m, 3m and 5m, and any of your own."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from tdcr import _tdcr
from tdcr._arrays import (
    Floats,
    as_array,
    as_count,
    as_flag,
    as_float,
    as_number,
    as_quaternions,
    as_text,
    as_texts,
    maybe_number,
)
from tdcr._dictionary import as_json, in_its_words
from tdcr._files import as_path, write_whole
from tdcr._html import of_robot
from tdcr.errors import InputError, RobotError
from tdcr.scene import Scene, as_scene


class Robot:
    """A tendon-driven continuum robot: discs on ball joints or hinges, pulled by tendons.

    Robots never change; :meth:`with_values` makes others. They compare by what they consist of, and can be pickled.

    Args:
        source: ``"2m"``, ``"3m"`` or ``"5m"`` of the paper; the path of a robot file (``.toml``, ``.json``, MJCF as ``.xml``,
            ``.urdf``); a dictionary with the fields of a robot file; or a robot.

    Raises:
        RobotError: If there is no such robot, or it cannot be read or built. The message names the field.
    """

    # Plain attributes, not the native object's: `torch.compile` looks through these.
    __slots__ = ("_discs", "_native", "_tendons", "_text", "notes")

    _native: _tdcr.Robot
    _text: str
    notes: tuple[str, ...]
    """What was passed over in a file of another tool."""

    def __init__(self, source: str | os.PathLike[str] | Mapping[str, Any] | Robot = "2m") -> None:
        if isinstance(source, Robot):
            self._keep(source._native, source.notes)
        elif isinstance(source, Mapping):
            text = as_json(source, "the robot", RobotError)
            with in_its_words(text):
                self._keep(_tdcr.Robot.from_json(text))
        elif isinstance(source, str | os.PathLike):
            native, notes = _tdcr.Robot.load(as_path(source, "the robot's file"))
            self._keep(native, tuple(notes))
        else:
            raise RobotError(f"a robot from {source!r}; expected a name, a path, a dictionary or a robot")

    def _keep(self, native: _tdcr.Robot, notes: tuple[str, ...] = ()) -> None:
        self._native, self.notes, self._text = native, notes, native.to_json()
        self._discs, self._tendons = native.discs, native.tendons

    @classmethod
    def _of(cls, native: _tdcr.Robot, notes: tuple[str, ...] = ()) -> Robot:
        robot = cls.__new__(cls)
        robot._keep(native, notes)
        return robot

    @property
    def name(self) -> str:
        """Name."""
        return self._native.name

    @property
    def discs(self) -> int:
        """Number of discs ``n``."""
        return self._discs

    @property
    def tendons(self) -> int:
        """Number of tendons: a command has one entry for each."""
        return self._tendons

    @property
    def command_units(self) -> tuple[str, ...]:
        """Unit of each entry of a command: ``"m"`` or ``"N"``."""
        return tuple(self._native.units)

    @property
    def command_ranges(self) -> Floats:
        """Smallest and largest command of each tendon, shape (tendons, 2) (m or N)."""
        return self._native.ranges()

    @property
    def mean_command(self) -> Floats:
        """The command in the middle of every tendon's range, shape (tendons,) (m or N)."""
        return self._native.mean_command()

    @property
    def straight_positions(self) -> Floats:
        """Origins of the discs in the straight pose, shape (n, 3), world frame (m)."""
        return self._native.straight_positions()

    def random_commands(self, count: int, seed: int = 0) -> Floats:
        """Commands drawn uniformly from the box of the tendons' ranges, shape (count, tendons) (m or N)."""
        return self._native.random_commands(as_count(count, "count", 0, 10**9), as_count(seed, "seed", 0, 2**64 - 1))

    def value(self, parameter: str) -> float:
        """Value of a physical parameter by its name, such as ``"gain[2]"`` or ``"bending[0].x"``, in its SI unit."""
        return self._native.value(as_text(parameter, "parameter"))

    def check_parameters(self, parameters: Sequence[str]) -> None:
        """Checks names of parameters that are to be changed, or differentiated by, together.

        Raises:
            ParameterError: For one that the robot does not have, and for two that overlap: that stand for the same numbers.
        """
        self._native.check_parameters(as_texts(parameters, "parameters"))

    def with_values(self, values: Mapping[str, float]) -> Robot:
        """This robot with other values of some physical parameters, by name, in SI units; :func:`tdcr.parameters` lists them.

        Raises:
            ParameterError: For one that the robot does not have, and for two that overlap.
        """
        if not isinstance(values, Mapping):
            raise InputError(f"values is {values!r}; expected a dictionary from names of parameters to numbers")
        names = as_texts(values, "values")
        return Robot._of(self._native.with_values(names, [as_number(v, name) for name, v in values.items()]))

    def with_base(self, position: Any = None, quaternion: Any = None) -> Robot:
        """This robot with its base elsewhere: inserted, or turned, as a whole. Gravity does not turn with it.

        Args:
            position: Origin of the base in the world, shape (3,) (m); where it is by default.
            quaternion: Orientation (w, x, y, z) of the base in the world, normalised on use; as it is by default.

        Raises:
            InputError: For another shape, and a quaternion that is 0.
            RobotError: For a position that no robot file can have.
        """
        place, turn = self._native.base()
        place = place if position is None else tuple(as_float(position, "position", (3,)).tolist())
        turn = turn if quaternion is None else tuple(as_quaternions(quaternion, "quaternion", (4,)).tolist())
        return Robot._of(self._native.with_base(place, turn), self.notes)

    def to_dict(self) -> dict[str, Any]:
        """The fields of the robot's file: ``Robot(robot.to_dict()) == robot``."""
        fields: dict[str, Any] = json.loads(self.to_json())
        return fields

    def to_json(self) -> str:
        """The robot file as JSON text: ``Robot.from_json(robot.to_json()) == robot``."""
        return self._text

    @classmethod
    def from_json(cls, text: str) -> Robot:
        """A robot from the JSON text of a robot file."""
        return cls._of(_tdcr.Robot.from_json(as_text(text, "text")))

    def to_toml(self) -> str:
        """The robot file."""
        return self._native.to_toml()

    def to_mjcf(
        self,
        *,
        base: bool = False,
        payload: float = 0.0,
        dt: float | None = None,
        integrator: Literal["euler", "implicitfast", "implicit", "rk4"] = "euler",
        command: Any = None,
        scene: Scene | None = None,
        attach: str | None = None,
        joints: Literal["ball", "hinges", "universal"] = "ball",
    ) -> str:
        """The robot as a model for MuJoCo; as ``tdcr export``.

        Args:
            base: Whether the base is shown below the robot.
            payload: Mass that hangs from the tip disc (kg).
            dt: Time step (s), which must be stable; by default the longest of 0.002, 0.001, 0.0005, 0.0002, ... that is.
            integrator: How MuJoCo takes a step.
            command: Command of the keyframe, shape (tendons,) (m or N), in which the robot must settle; by default the middle
                of every tendon's range, with a little more pull by the first tendon of each module.
            scene: Obstacles around the robot, as geoms of the world, and spheres on the discs that touch them. What MuJoCo has
                otherwise is warned of.
            attach: Prefix of all names in a model that is to be mounted on another one (``mujoco.MjSpec.attach``): its base
                stands at the origin, and cameras, gravity, time step and keyframe are left to that model. Goes with
                ``payload``, ``integrator`` and ``joints`` alone.
            joints: How ball joints are written: as they are; as ``"hinges"`` about x, y, then z; or ``"universal"``, about x,
                then y, so that discs cannot twist. What is otherwise in the model then is warned of.

        Raises:
            InputError: For ``attach`` with what it does not go with.
            ContactError: In a scene, for a straight robot inside an obstacle.
            RobotError: For a robot that MuJoCo cannot have, a step that is not stable, and a command in which it does not
                settle.
        """
        if attach is not None and (base or dt is not None or command is not None or scene is not None):
            raise InputError(
                "`attach` goes with `payload`, `integrator` and `joints` alone: the rest is left to the model around the robot"
            )
        options = {
            "attach": None if attach is None else as_text(attach, "attach"),
            "base": as_flag(base, "base"),
            "payload": as_number(payload, "payload"),
            "dt": maybe_number(dt, "dt"),
            "integrator": as_text(integrator, "integrator"),
            "joints": as_text(joints, "joints"),
            "command": None if command is None else as_float(command, "command", (self.tendons,)).tolist(),
        }
        text, notes = self._native.to_mjcf(options, None if scene is None else as_scene(scene)._native)
        for note in notes:
            warnings.warn(note, stacklevel=2)
        return text

    def to_urdf(self) -> str:
        """The robot as URDF, with its own file in an element ``<tdcr>``, as URDF has no tendons."""
        return self._native.to_urdf()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the robot to a file, in the format of its extension: ``.toml``, ``.json``, ``.xml`` (MJCF) or ``.urdf``.

        A file that is there already is replaced, by the whole new one or not at all.
        """
        path = Path(as_path(path, "path"))
        writers = {".toml": self.to_toml, ".json": self.to_json, ".xml": self.to_mjcf, ".urdf": self.to_urdf}
        writer = writers.get(path.suffix)
        if writer is None:
            raise InputError(f"cannot write a robot to {path}; expected a name that ends in {', '.join(writers)}")
        write_whole(path, writer().encode())

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Robot):
            return NotImplemented
        return self._native is other._native or self.to_json() == other.to_json()

    def __hash__(self) -> int:
        return hash(self.to_json())

    def __reduce__(self) -> tuple[Any, ...]:
        return _unpickle, (self.to_json(), self.notes)

    def __copy__(self) -> Robot:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Robot:
        return self

    def _repr_html_(self) -> str:
        """What a notebook shows: the straight pose, and a table."""
        return of_robot(self)

    def __repr__(self) -> str:
        return f"Robot({self.name!r}: {self.discs} discs, {self.tendons} tendons)"


RobotLike: TypeAlias = str | os.PathLike[str] | Mapping[str, Any] | Robot
"""What :class:`Robot` makes one of, and every function takes for one: a name, a file, a dictionary, or a robot."""


def as_robot(robot: RobotLike) -> Robot:
    """A robot, or what :class:`Robot` makes one of."""
    return robot if isinstance(robot, Robot) else Robot(robot)


def as_robots(robot: RobotLike | Sequence[RobotLike]) -> list[Robot]:
    """One robot for all rows, or one for each row."""
    if isinstance(robot, Robot):
        return [robot]
    if isinstance(robot, str | os.PathLike | Mapping) or not isinstance(robot, Iterable):
        return [Robot(robot)]
    robots = [as_robot(one) for one in robot]
    if not robots:
        raise InputError("there are no robots; expected one, or one for each row")
    return robots


def at_bases(robots: list[Robot], position: Any, quaternion: Any, rows: int) -> list[Robot]:
    """Robots, one for all rows or one for each, with their bases elsewhere: one for all rows, or one for each.

    Args:
        robots: The robots.
        position: ``base_position`` of :func:`tdcr.settle_batch`.
        quaternion: ``base_quaternion`` of it.
        rows: Number of rows.
    """
    # Another number of robots is refused where they are used.
    if (position is None and quaternion is None) or len(robots) not in (1, rows) or rows == 0:
        return robots
    poses = np.empty((rows, 7))
    poses[:] = [(*place, *turn) for place, turn in (robot._native.base() for robot in robots)]
    if position is not None:
        position = as_array(position, "base_position")
        poses[:, :3] = as_float(position, "base_position", (rows, 3) if position.ndim == 2 else (3,))
    if quaternion is not None:
        quaternion = as_array(quaternion, "base_quaternion")
        poses[:, 3:] = as_quaternions(quaternion, "base_quaternion", (rows, 4) if quaternion.ndim == 2 else (4,))
    return robots_at(robots, poses)


def robots_at(robots: Sequence[Robot], poses: Floats) -> list[Robot]:
    """Robots with their bases at poses: one for all rows, or one for each.

    Args:
        robots: One, or one for each row.
        poses: Position (m) and quaternion (w, x, y, z) of each row's base, shape (rows, 7).
    """
    if len(robots) == 1 and len(poses) > 1 and (poses == poses[0]).all():
        poses = poses[:1]
    several = robots if len(robots) > 1 else [robots[0]] * len(poses)
    return [robot.with_base(pose[:3], pose[3:]) for robot, pose in zip(several, poses, strict=True)]


def _unpickle(text: str, notes: tuple[str, ...]) -> Robot:
    return Robot._of(_tdcr.Robot.from_json(text), notes)

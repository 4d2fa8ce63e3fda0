"""Equilibria: where a robot settles under a command and loads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from tdcr import _tdcr
from tdcr._arrays import Floats, Progress, as_float, as_quaternions, as_rows
from tdcr._html import of_equilibrium
from tdcr._results import Batch, Result, is_row, row_of, rows_of
from tdcr.contact import Contacts
from tdcr.errors import InputError, NotSettledError
from tdcr.loads import NO_LOADS, LoadRows, Loads, native_loads, one_load
from tdcr.robot import Robot, RobotLike, as_robot, as_robots, at_bases
from tdcr.scene import Scene, as_scene, as_scenes

STABILITY = ("unknown", "stable", "neutral", "unstable", "flutter")
"""Names of the codes of :attr:`Equilibria.stability`."""
EXAMINED = ("unknown", "energy", "motion", "statics")
"""Names of the codes of :attr:`Equilibria.examined`."""


@dataclass(frozen=True, eq=False, repr=False)
class Equilibrium(Result):
    """Where a robot of ``n`` discs and ``t`` tendons settled.

    Attributes:
        positions: Origin of each disc, shape (n, 3), world frame (m).
        quaternions: Orientation (w, x, y, z) of each disc, shape (n, 4), world frame.
        configuration: Rotation (w, x, y, z) of each disc relative to the body below, shape (n, 4): the configuration ``q``.
        lengths: Length of each tendon, shape (t,) (m).
        tensions: Tension of each tendon, shape (t,), positive when it pulls (N).
        residual: Largest moment that is not balanced at a joint (N m).
        iterations: Newton steps taken.
        converged: Whether this is an equilibrium that is not unstable. Look at it before you use the rest.
        stability: ``"stable"``, ``"neutral"``, ``"unstable"``, ``"flutter"`` (under moments or forces that turn with their disc:
            small motions swing ever wider), or ``"unknown"`` where there is no equilibrium.
        examined: What that was told from: ``"energy"`` (its second derivative), ``"motion"`` (the linearised motion, with the
            robot's own inertia and damping, under loads without a potential), ``"statics"`` (under such loads the Jacobian of
            the moments alone, as small motions could not be examined), or ``"unknown"``.
        growth: Rate of the small motion that grows fastest (1/s) and its frequency (Hz), shape (2,): zeros where none was
            found, or not looked for.
        contacts: What it touches, in a scene; None without one.
    """

    positions: Floats
    quaternions: Floats
    configuration: Floats
    lengths: Floats
    tensions: Floats
    residual: float
    iterations: int
    converged: bool
    stability: str
    examined: str
    growth: Floats
    contacts: Contacts | None = None

    @classmethod
    def _of(cls, found: _tdcr._One) -> Equilibrium:
        return cls(*found[:8], STABILITY[found[8]], EXAMINED[found[9]], found[10])

    @classmethod
    def _among(cls, found: tuple[_tdcr._One, _tdcr.ContactRows], scene: Scene) -> Equilibrium:
        one = found[0]
        contacts = Contacts._of_one(found[1], scene)
        return cls(*one[:8], STABILITY[one[8]], EXAMINED[one[9]], one[10], contacts)

    @property
    def tip(self) -> Floats:
        """Origin of the last disc, shape (3,), world frame (m)."""
        tip: Floats = self.positions[-1]
        return tip

    def _repr_html_(self) -> str:
        """What a notebook shows: where the discs are, and a table."""
        return of_equilibrium(self)

    def check(self) -> Equilibrium:
        """Returns this equilibrium.

        Raises:
            NotSettledError: If it has not converged.
        """
        if not self.converged:
            raise NotSettledError(
                f"the robot has not settled: residual {self.residual:.1e} N m after {self.iterations} steps, stability "
                f"{self.stability}"
            )
        return self


@dataclass(frozen=True, eq=False, repr=False)
class Equilibria(Batch):
    """Equilibria of a batch of ``rows``: the arrays of :class:`Equilibrium` with rows as their first axis.

    Attributes:
        positions: Shape (rows, n, 3) (m).
        quaternions: Shape (rows, n, 4).
        configuration: Shape (rows, n, 4).
        lengths: Shape (rows, t) (m).
        tensions: Shape (rows, t) (N).
        residual: Shape (rows,) (N m).
        iterations: Shape (rows,).
        converged: Shape (rows,). Rows that have not converged are here too: look before you use them.
        stability: Shape (rows,): index into :data:`STABILITY`.
        examined: Shape (rows,): index into :data:`EXAMINED`.
        growth: Shape (rows, 2).
        contacts: What all rows touch, in a scene; None without one.
    """

    positions: Floats
    quaternions: Floats
    configuration: Floats
    lengths: Floats
    tensions: Floats
    residual: Floats
    iterations: NDArray[np.uint32]
    converged: NDArray[np.bool_]
    stability: NDArray[np.uint8]
    examined: NDArray[np.uint8]
    growth: Floats
    contacts: Contacts | None = None

    _by_rows = (
        "positions",
        "quaternions",
        "configuration",
        "lengths",
        "tensions",
        "residual",
        "iterations",
        "converged",
        "stability",
        "examined",
        "growth",
    )

    @classmethod
    def _of(cls, rows: _tdcr.EquilibriumRows, contacts: Contacts | None = None) -> Equilibria:
        return cls(**{name: getattr(rows, name) for name in cls._by_rows}, contacts=contacts)

    def _take(self, rows: Any) -> Equilibria:
        taken = super()._take(rows)
        if self.contacts is None:
            return taken
        places = np.arange(len(self))[rows_of(rows, len(self))]
        return replace(taken, contacts=self.contacts._of_rows(places))

    @property
    def tips(self) -> Floats:
        """Origin of the last disc of each row, shape (rows, 3), world frame (m)."""
        return self.positions[:, -1]

    def __len__(self) -> int:
        return len(self.residual)

    @overload
    def __getitem__(self, row: int) -> Equilibrium: ...

    @overload
    def __getitem__(self, row: slice | Sequence[int] | NDArray[Any]) -> Equilibria: ...

    def __getitem__(self, row: int | slice | Sequence[int] | NDArray[Any]) -> Equilibrium | Equilibria:
        """The equilibrium of a row; or, of a slice, a mask of flags or an array of numbers, a batch of those rows."""
        if not is_row(row):
            return self._take(row)
        row = row_of(row, len(self))
        return Equilibrium(
            self.positions[row],
            self.quaternions[row],
            self.configuration[row],
            self.lengths[row],
            self.tensions[row],
            float(self.residual[row]),
            int(self.iterations[row]),
            bool(self.converged[row]),
            STABILITY[self.stability[row]],
            EXAMINED[self.examined[row]],
            self.growth[row],
            None if self.contacts is None else self.contacts._of_row(row),
        )


def settle(
    robot: RobotLike,
    command: Any,
    payload: Any = None,
    *,
    wrench: Any = None,
    loads: Loads | None = None,
    scene: Scene | None = None,
    base_position: Any = None,
    base_quaternion: Any = None,
) -> Equilibrium:
    """Settles a robot under a command, from the straight pose.

    Args:
        robot: The robot, of ``n`` discs, or what :class:`tdcr.Robot` makes one of: a name, a file, a dictionary.
        command: One entry for each tendon, shape (tendons,): a rest length or a length (m), or a tension (N).
        payload: Mass hung from the last disc (kg).
        wrench: Force (N) and moment (N m) on each disc, world frame, shape (n, 6).
        loads: Other loads.
        scene: Obstacles around the robot, which touches them without friction: the result has its contacts.
        base_position: Where the robot's base is, in place of its own position, shape (3,) (m).
        base_quaternion: How the base is turned (w, x, y, z), in place of its own orientation, shape (4,), normalised on use.
            Neither gravity nor the loads turn with it.

    Returns:
        The equilibrium; look at its ``converged``, or call its ``check()``.

    Raises:
        CommandError: For a command that the robot cannot take.
        LoadsError: For loads that it cannot take.
        ContactError: In a scene, for a straight robot inside an obstacle, and for loads that are moments or turn with their disc.
    """
    robot = at_bases([as_robot(robot)], base_position, base_quaternion, 1)[0]
    command = as_float(command, "command", (robot.tendons,))
    if scene is not None:
        question = robot._native, as_scene(scene)._native, command, *native_loads(loads, payload, wrench, robot.discs)
        return Equilibrium._among(_tdcr.settle_one_among(*question), scene)
    return Equilibrium._of(_tdcr.settle_one(robot._native, command, *native_loads(loads, payload, wrench, robot.discs)))


def settle_batch(
    robot: RobotLike | Sequence[RobotLike],
    commands: Any,
    payload: Any = None,
    *,
    wrench: Any = None,
    loads: Loads | Sequence[Loads] | None = None,
    scene: Scene | Sequence[Scene] | None = None,
    base_position: Any = None,
    base_quaternion: Any = None,
    progress: Progress | None = None,
) -> Equilibria:
    """Settles rows of commands on all threads, each from the straight pose.

    Results are the same for any number of threads.

    Args:
        robot: One robot for all rows, or one for each row, all of as many discs ``n`` and tendons.
        commands: Shape (rows, tendons) (m or N).
        payload: Mass hung from the last disc (kg): one for all rows, or shape (rows,).
        wrench: Force (N) and moment (N m) on each disc, world frame: shape (n, 6) for all rows, or (rows, n, 6).
        loads: Other loads: for all rows, or one for each row.
        scene: Obstacles around the robot: for all rows, or one scene for each row, of obstacles of the same names.
        base_position, base_quaternion: Poses of the bases as of :func:`settle`, shapes (3,) and (4,) for all rows, or (rows, 3)
            and (rows, 4).
        progress: Is called with the number of rows done since its last call, as ``tqdm(total=rows).update``.

    Raises:
        CommandError, LoadsError: For a row that the robot cannot take; the message names it.
        ContactError: As of :func:`settle`; the message names the row.
        InputError: For shapes that do not fit.
    """
    rows = Rows.of(robot, commands, payload, wrench, loads, scene)
    rows = replace(rows, robots=at_bases(rows.robots, base_position, base_quaternion, len(rows.commands)))
    if rows.scenes is not None:
        found, touched = _tdcr.settle_rows_among(rows.argument(), rows.native_scenes(), progress)
        return Equilibria._of(found, Contacts._of(touched, rows.scenes))
    return Equilibria._of(_tdcr.settle_rows(rows.argument(), progress))


def follow(
    robot: RobotLike,
    commands: Any,
    payload: Any = None,
    *,
    wrench: Any = None,
    loads: Loads | Sequence[Loads] | None = None,
    scene: Scene | None = None,
    progress: Progress | None = None,
) -> Equilibria:
    """Follows one branch of equilibria along a path of commands: each row starts from the equilibrium of the row before it.

    Arguments as of :func:`settle_batch`, with one robot and one scene.
    """
    rows = Rows.of(robot, commands, payload, wrench, loads, None if scene is None else as_scene(scene))
    if scene is not None:
        found, touched = _tdcr.follow_rows_among(rows.argument(), scene._native, progress)
        return Equilibria._of(found, Contacts._of(touched, [scene]))
    return Equilibria._of(_tdcr.follow_rows(rows.argument(), progress))


class Settler:
    """Finds equilibria one after another, and remembers the last one. It can be copied and pickled, memory and all.

    Args:
        robot: The robot, or what :class:`tdcr.Robot` makes one of.
        scene: Obstacles around it, if there are any.
    """

    def __init__(self, robot: RobotLike, scene: Scene | None = None) -> None:
        self.robot = as_robot(robot)
        self.scene = None if scene is None else as_scene(scene)
        self._native: _tdcr.Settler | _tdcr.ContactSettler
        if self.scene is None:
            self._native = _tdcr.Settler(self.robot._native)
        else:
            self._native = _tdcr.ContactSettler(self.robot._native, self.scene._native)
        self._loads = NO_LOADS

    def settle(self, command: Any, loads: Loads | None = None, *, payload: Any = None) -> Equilibrium:
        """Settles from the straight pose under a command, shape (tendons,) (m or N).

        Args:
            command: One entry for each tendon.
            loads: Loads, or none.
            payload: Mass hung from the last disc (kg), in place of ``loads``.
        """
        return self._found(self._native.settle(self._command(command), self._take(loads, payload)))

    def follow(self, command: Any, loads: Loads | None = None, *, payload: Any = None) -> Equilibrium:
        """Settles from the last equilibrium; the first time, from the straight pose. Arguments as of :meth:`settle`."""
        return self._found(self._native.follow(self._command(command), self._take(loads, payload)))

    def settle_from(self, configuration: Any, command: Any, loads: Loads | None = None, *, payload: Any = None) -> Equilibrium:
        """Settles from a configuration: rotations (w, x, y, z) of the joints, shape (n, 4). The others as of :meth:`settle`."""
        start = as_quaternions(configuration, "configuration", (self.robot.discs, 4))
        return self._found(self._native.settle_from(self._command(command), self._take(loads, payload), start))

    def _command(self, command: Any) -> Floats:
        return as_float(command, "command", (self.robot.tendons,))

    def _found(self, found: Any) -> Equilibrium:
        return Equilibrium._of(found) if self.scene is None else Equilibrium._among(found, self.scene)

    def __getstate__(self) -> dict[str, Any]:
        return {"robot": self.robot, "scene": self.scene, "memory": self._native.memory(), "loads": self._loads}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        self.__init__(saved["robot"], saved.get("scene"))  # type: ignore[misc]
        self._loads = saved["loads"]
        self._native.resume(saved["memory"], self._loads._native)

    def _take(self, loads: Loads | None, payload: Any) -> _tdcr.Loads:
        self._loads = one_load(loads, payload)
        return self._loads._native


@dataclass(frozen=True)
class Rows:
    """Rows of robots, commands and loads, as the native module takes them."""

    robots: list[Robot]
    commands: Floats
    loads: LoadRows
    scenes: list[Scene] | None = None

    @classmethod
    def of(
        cls,
        robot: RobotLike | Sequence[RobotLike],
        commands: Any,
        payload: Any,
        wrench: Any,
        loads: Loads | Sequence[Loads] | None,
        scene: Scene | Sequence[Scene] | None = None,
    ) -> Rows:
        """Reads the arguments of :func:`settle_batch`."""
        robots = as_robots(robot)
        first = robots[0]
        commands = as_rows(commands, "commands", first.tendons, f"one for each tendon of robot {first.name!r}")
        rows = LoadRows.of(loads, payload, wrench, len(commands), first.discs)
        return cls(robots, commands, rows, None if scene is None else as_scenes(scene, len(commands)))

    def argument(self) -> tuple[list[_tdcr.Robot], Floats, list[_tdcr.Loads], Floats | None, Floats | None]:
        """The rows as the native functions take them."""
        loads = self.loads
        return [robot._native for robot in self.robots], self.commands, loads.base, loads.payload, loads.wrench

    def scenes_given(self) -> list[Scene]:
        """The scenes: one for all rows, or one for each.

        Raises:
            InputError: If there are none.
        """
        if self.scenes is None:
            raise InputError("scene is None; expected a tdcr.Scene, or one for each row")
        return self.scenes

    def native_scenes(self) -> list[_tdcr.Scene]:
        """The scenes as the native functions take them."""
        return [scene._native for scene in self.scenes_given()]

    def maybe_scenes(self) -> list[_tdcr.Scene] | None:
        """The same, where there may be none."""
        return None if self.scenes is None else self.native_scenes()

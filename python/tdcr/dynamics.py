"""Motion in time: robots moved through sequences of commands.

A state is a configuration, the rotation (w, x, y, z) of each disc relative to the body below, and a velocity, the angular
velocity of each joint in its disc's own frame, or the rates of its hinges in order, then 0 (rad/s). Friction of tendons in
their holes, where the robot's file has it, acts in steps of first order, and has no derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args, overload

import numpy as np
from numpy.typing import NDArray

from tdcr import _tdcr, errors
from tdcr._arrays import Floats, Progress, as_array, as_choice, as_count, as_float, as_number, as_quaternions
from tdcr._results import Batch, Result, is_row, row_of
from tdcr.contact import Contacts
from tdcr.errors import InputError
from tdcr.loads import LoadRows, Loads
from tdcr.objects import Objects
from tdcr.robot import Robot, RobotLike, as_robot, as_robots
from tdcr.scene import Scene, as_scene, as_scenes
from tdcr.statics import Equilibria, Equilibrium

Integrator = Literal["semi-implicit-euler", "runge-kutta4", "implicit-euler", "implicit-midpoint"]
"""How a step is taken: first order with implicit joint damping, as MuJoCo's Euler; fourth order, explicit; or first order with
implicit stiffness too, for stiff robots."""


@dataclass(frozen=True, eq=False, repr=False)
class State(Result):
    """A state of a robot of ``n`` discs, or one for each of some rows.

    Attributes:
        configuration: Rotation (w, x, y, z) of each disc relative to the body below, shape (n, 4) or (rows, n, 4).
        velocity: Rates of the joints in the discs' own frames, shape (n, 3) or (rows, n, 3) (rad/s); at rest where it is not
            given.
    """

    configuration: Any
    velocity: Any = None

    @classmethod
    def straight(cls, robot: RobotLike) -> State:
        """The straight pose, at rest."""
        return cls(np.tile([1.0, 0.0, 0.0, 0.0], (as_robot(robot).discs, 1)))


Start = State | Equilibrium | Equilibria | Literal["straight", "settled"]
"""Where a motion starts: in a state; at rest in an equilibrium that was found before; at rest in the straight pose; or at rest
in the equilibrium of the first command."""


@dataclass(frozen=True, eq=False, repr=False)
class Motion(Result):
    """States of a robot of ``n`` discs and ``t`` tendons after each of ``T`` commands.

    Attributes:
        times: Time after each command, shape (T,) (s).
        positions: Origin of each disc, shape (T, n, 3), world frame (m).
        quaternions: Orientation (w, x, y, z) of each disc, shape (T, n, 4), world frame.
        configuration: Rotation (w, x, y, z) of each disc relative to the body below, shape (T, n, 4).
        velocity: Rates of the joints in the discs' own frames, shape (T, n, 3) (rad/s).
        lengths: Length of each tendon, shape (T, t) (m).
        tensions: Tension of each tendon under the command, shape (T, t), positive when it pulls (N).
        contacts: What the robot touched in the last time step of each command, whose number is a contact's ``row``, in a scene;
            None without one. Forces are means over the time step and act at its begin; gaps are those at its end.
        objects: Where the scene's objects are after each command, and how they move; None without a scene.
    """

    times: Floats
    positions: Floats
    quaternions: Floats
    configuration: Floats
    velocity: Floats
    lengths: Floats
    tensions: Floats
    contacts: Contacts | None = None
    objects: Objects | None = None

    @property
    def tip(self) -> Floats:
        """Origin of the last disc, shape (T, 3), world frame (m)."""
        return self.positions[:, -1]

    @property
    def end(self) -> State:
        """The last state, from which another motion may start."""
        return State(self.configuration[-1], self.velocity[-1])

    def __len__(self) -> int:
        return len(self.times)


@dataclass(frozen=True, eq=False, repr=False)
class Motions(Batch):
    """Motions of a batch of ``rows``: the arrays of :class:`Motion`, but for the times, with rows as their first axis.

    A row that could not go on is not a number from there on.

    Attributes:
        times: Shape (T,) (s).
        positions: Shape (rows, T, n, 3) (m).
        quaternions: Shape (rows, T, n, 4).
        configuration: Shape (rows, T, n, 4).
        velocity: Shape (rows, T, n, 3) (rad/s).
        lengths: Shape (rows, T, t) (m).
        tensions: Shape (rows, T, t) (N).
        steps: How many commands each row was moved by, shape (rows,): ``T`` where nothing failed.
        failures: Why a row could not go on, by its number: its start has not settled, or its motion diverged.
    """

    times: Floats
    positions: Floats
    quaternions: Floats
    configuration: Floats
    velocity: Floats
    lengths: Floats
    tensions: Floats
    steps: NDArray[np.uint32]
    failures: dict[int, str]

    _by_rows = ("positions", "quaternions", "configuration", "velocity", "lengths", "tensions", "steps")

    @classmethod
    def _of(cls, rows: _tdcr.MotionRows, times: Floats) -> Motions:
        return cls(
            times,
            rows.positions,
            rows.quaternions,
            rows.configuration,
            rows.velocity,
            rows.lengths,
            rows.tensions,
            rows.steps,
            {row: why for row, _, why in rows.failures},
        )

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """Whether a row failed, shape (rows,)."""
        failed = np.zeros(len(self.steps), dtype=np.bool_)
        failed[list(self.failures)] = True
        return failed

    @property
    def tips(self) -> Floats:
        """Origin of the last disc, shape (rows, T, 3), world frame (m)."""
        return self.positions[:, :, -1]

    def __len__(self) -> int:
        return len(self.steps)

    @overload
    def __getitem__(self, row: int) -> Motion: ...

    @overload
    def __getitem__(self, row: slice | Sequence[int] | NDArray[Any]) -> Motions: ...

    def __getitem__(self, row: int | slice | Sequence[int] | NDArray[Any]) -> Motion | Motions:
        """The motion of a row; or, of a slice, a mask of flags or an array of numbers, a batch of those rows."""
        if not is_row(row):
            return self._take(row)
        row = row_of(row, len(self))
        return Motion(
            self.times,
            self.positions[row],
            self.quaternions[row],
            self.configuration[row],
            self.velocity[row],
            self.lengths[row],
            self.tensions[row],
        )


def simulate(
    robot: RobotLike,
    commands: Any,
    payload: Any = None,
    *,
    wrench: Any = None,
    loads: Loads | None = None,
    start: Start = "straight",
    dt: float = 0.002,
    integrator: Integrator = "semi-implicit-euler",
    frame_skip: int = 1,
    scene: Scene | None = None,
    progress: Progress | None = None,
) -> Motion:
    """Moves a robot through a sequence of commands, as ``tdcr simulate`` does.

    Args:
        robot: The robot, of ``n`` discs and ``t`` tendons, or what :class:`tdcr.Robot` makes one of.
        commands: Shape (T, t) (m or N). Servos with a lag or a largest rate start where the first one has them.
        payload: Point mass on the last disc (kg).
        wrench: Force (N) and moment (N m) on each disc, world frame, shape (n, 6); or one for each command, shape (T, n, 6).
        loads: Other loads.
        start: Where the robot starts; in the straight pose at rest where it is not given.
        dt: Time step (s).
        integrator: How a step is taken.
        frame_skip: Time steps for which each command holds.
        scene: Obstacles around the robot, which have friction, and how its discs touch each other. Those with a mass move, from
            where the scene has them. The integrator is one of the two of first order.
        progress: Is called with the number of commands done since its last call, as ``tqdm(total=T).update``.

    Raises:
        DynamicsError: If the time step is too long for the robot: small motions about the start would grow, or the motion
            diverged.
        CommandError: For a command that the robot cannot take; the message names its step.
        NotSettledError: If the start is to be settled and has not.
        ContactError: In a scene, for a start inside an obstacle.
    """
    robot = as_robot(robot)
    scene = None if scene is None else as_scene(scene)
    commands = as_float(commands, "commands", ("T", robot.tendons))[np.newaxis]
    if wrench is not None and np.ndim(wrench) == 3:
        wrench = as_float(wrench, "wrench", (commands.shape[1], robot.discs, 6))[np.newaxis]
    question = Question.of(robot, commands, payload, wrench, loads, start, dt, integrator, frame_skip, scene)
    rows = question.rollout(progress)
    for _, error, why in rows.failures:
        raise getattr(errors, error)(why)
    motion = Motions._of(rows, question.times)[0]
    if scene is None:
        return motion
    objects = Objects._of(scene.objects, rows.objects[0])
    return replace(motion, contacts=Contacts._of(rows.contacts, [scene]), objects=objects)


def rollout(
    robot: RobotLike | Sequence[RobotLike],
    commands: Any,
    payload: Any = None,
    *,
    wrench: Any = None,
    loads: Loads | Sequence[Loads] | None = None,
    start: Start = "straight",
    dt: float = 0.002,
    integrator: Integrator = "semi-implicit-euler",
    frame_skip: int = 1,
    scene: Scene | Sequence[Scene] | None = None,
    progress: Progress | None = None,
) -> Motions:
    """Moves rows of robots, each through its own sequence of commands, on all threads.

    Results are the same for any number of threads.

    Args:
        robot: One robot for all rows, or one for each row, all of as many discs ``n`` and tendons ``t``.
        commands: Shape (rows, T, t) (m or N).
        payload: Point mass on the last disc (kg): one for all rows, or shape (rows,).
        wrench: Force (N) and moment (N m) on each disc, world frame, the same all along: shape (n, 6) or (rows, n, 6); or one for
            each command, shape (rows, T, n, 6).
        loads: Other loads: for all rows, or one for each row.
        start: Where each row starts; a single state is for all rows.
        dt, integrator, frame_skip: As of :func:`simulate`.
        scene: Obstacles as of :func:`simulate`: for all rows, or one scene for each row, of obstacles of the same names.
        progress: Is called with the number of commands done since its last call, as ``tqdm(total=rows * T).update``.

    Returns:
        The motions. Rows that diverge do not stop the others: see :attr:`Motions.failures`.

    Raises:
        CommandError, LoadsError: For a row that the robot cannot take; the message names it.
        DynamicsError: If the time step is too long for all rows: small motions about their starts would grow. Where it is for
            some, these have failed.
        InputError: For shapes that do not fit.
        ContactError: In a scene, for a start inside an obstacle.
    """
    question = Question.of(robot, commands, payload, wrench, loads, start, dt, integrator, frame_skip, scene)
    return Motions._of(question.rollout(progress), question.times)


@dataclass(frozen=True)
class Question:
    """Rows of motions, as the native module takes them."""

    robots: list[Robot]
    commands: Floats
    loads: LoadRows
    start: tuple[Floats | None, Floats | None, bool]
    norms: Floats | None
    steps: _tdcr.Steps
    times: Floats
    scenes: list[Scene] | None
    wrenches: Floats | None
    """Of each command, shape (rows, T, n, 6)."""

    @classmethod
    def of(
        cls,
        robot: RobotLike | Sequence[RobotLike],
        commands: Any,
        payload: Any,
        wrench: Any,
        loads: Loads | Sequence[Loads] | None,
        start: Start,
        dt: float,
        integrator: Integrator,
        frame_skip: int,
        scene: Scene | Sequence[Scene] | None,
    ) -> Question:
        """Reads the arguments of :func:`rollout`."""
        robots = as_robots(robot)
        first = robots[0]
        commands = as_float(commands, "commands", ("rows", "T", first.tendons))
        rows, length, _ = commands.shape
        configuration, velocity, norms = _start(start, rows, first.discs)
        wrenches = None
        if wrench is not None and np.ndim(wrench) == 4:
            wrenches, wrench = as_float(wrench, "wrench", (rows, length, first.discs, 6)), None
        times = np.arange(1, length + 1) * (as_number(dt, "dt") * as_count(frame_skip, "frame_skip", 1))
        return cls(
            robots,
            commands,
            LoadRows.of(loads, payload, wrench, rows, first.discs),
            (configuration, velocity, isinstance(start, str) and start == "settled"),
            norms,
            native_steps(dt, integrator, frame_skip),
            times,
            None if scene is None else as_scenes(scene, rows),
            wrenches,
        )

    def arguments(
        self,
    ) -> tuple[
        list[_tdcr.Robot],
        Floats,
        list[_tdcr.Loads],
        Floats | None,
        Floats | None,
        tuple[Floats | None, Floats | None, bool],
        _tdcr.Steps,
        tuple[list[_tdcr.Scene] | None, Floats | None],
    ]:
        """The first arguments of the native functions."""
        loads = self.loads
        robots = [robot._native for robot in self.robots]
        scenes = None if self.scenes is None else [scene._native for scene in self.scenes]
        return robots, self.commands, loads.base, loads.payload, loads.wrench, self.start, self.steps, (scenes, self.wrenches)

    def rollout(self, progress: Progress | None) -> _tdcr.MotionRows:
        return _tdcr.rollout_rows(*self.arguments(), progress)


def native_steps(dt: float, integrator: str, frame_skip: int) -> _tdcr.Steps:
    """How motions are computed, as the native module takes it."""
    integrator = as_choice(integrator, "integrator", get_args(Integrator))
    return _tdcr.Steps(as_number(dt, "dt"), integrator, as_count(frame_skip, "frame_skip", 1))


def _start(start: Start, rows: int, discs: int) -> tuple[Floats | None, Floats | None, Floats | None]:
    """Configurations and velocities of rows, and the lengths of the quaternions that were given."""
    if isinstance(start, str):
        if start not in ("straight", "settled"):
            raise InputError(f"start is {start!r}; expected 'straight', 'settled', a state or an equilibrium")
        return None, None, None
    if isinstance(start, Equilibrium | Equilibria):
        start = State(start.configuration)
    if not isinstance(start, State):
        raise InputError(f"start is {start!r}; expected 'straight', 'settled', a state or an equilibrium")
    shape = (rows, discs, 4)
    given = as_float(start.configuration, "configuration", _of_rows(start.configuration, "configuration", shape))
    unit = as_quaternions(given, "configuration", given.shape)
    velocity = np.zeros((discs, 3))
    if start.velocity is not None:
        velocity = as_float(start.velocity, "velocity", _of_rows(start.velocity, "velocity", (rows, discs, 3)))
    norms = np.linalg.norm(given, axis=-1, keepdims=True)
    return (
        np.ascontiguousarray(np.broadcast_to(unit, shape)),
        np.ascontiguousarray(np.broadcast_to(velocity, (rows, discs, 3))),
        norms,
    )


def _of_rows(value: Any, name: str, shape: tuple[int, ...]) -> tuple[int, ...]:
    """The shape that is expected of rows, or of one that is for all."""
    return shape[1:] if as_array(value, name).ndim == len(shape) - 1 else shape


def one_state(robot: Robot, state: State) -> tuple[Floats, Floats]:
    """Configuration and velocity of a single state."""
    if not isinstance(state, State):
        raise InputError(f"state is {state!r}; expected a tdcr.State")
    configuration = as_quaternions(state.configuration, "configuration", (robot.discs, 4))
    if state.velocity is None:
        return configuration, np.zeros((robot.discs, 3))
    return configuration, as_float(state.velocity, "velocity", (robot.discs, 3))

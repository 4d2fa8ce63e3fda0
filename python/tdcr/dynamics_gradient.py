"""Derivatives of motions: gradients of costs by all that a motion depends on, and linearised steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr import _tdcr
from tdcr._arrays import Floats, Progress, as_float, as_number, as_texts
from tdcr._results import Batch, brief, equal
from tdcr.dynamics import Question, Start, State, one_state
from tdcr.errors import InputError
from tdcr.loads import Loads, one_load
from tdcr.robot import RobotLike, as_robot
from tdcr.scene import Scene, as_scene


@dataclass(frozen=True, eq=False, repr=False)
class RolloutGradients(Batch):
    """Derivatives of a cost of each row by what its motion depends on. A row without them is not a number.

    Attributes:
        commands: Shape (rows, T, t) (1/m or 1/N).
        configuration: By the start's rotations (w, x, y, z), shape (rows, n, 4), along unit quaternions.
        velocity: By the start's rates of the joints, shape (rows, n, 3).
        payload: By the mass on the last disc, shape (rows,) (1/kg).
        wrench: By a force and a moment on each disc, world frame, the same all along, shape (rows, n, 6); or, where one was given
            for each command, by those, shape (rows, T, n, 6).
        parameters: By the parameters asked for, shape (rows, p).
        obstacles: By the motion of each of the scene's ``m`` obstacles, a displacement of its origin (m) and a rotation about it
            (rad) in the world's axes before the motion begins, shape (rows, m, 6).
        compliance: By the compliance of each obstacle (m/N), shape (rows, m).
        base: By the motion of the base before the motion begins, a displacement of it (m) and a rotation about it (rad) in the
            world's axes, shape (rows, 6). The joints start as they do, tendons move along; gravity, loads and obstacles stay.
        failures: Why a row has no derivatives, by its number.
    """

    commands: Floats
    configuration: Floats
    velocity: Floats
    payload: Floats
    wrench: Floats
    parameters: Floats
    obstacles: Floats
    compliance: Floats
    base: Floats
    failures: dict[int, str]

    _by_rows = ("commands", "configuration", "velocity", "payload", "wrench", "parameters", "obstacles", "compliance", "base")

    def __len__(self) -> int:
        return len(self.payload)

    def __getitem__(self, rows: slice | Sequence[int] | NDArray[Any]) -> RolloutGradients:
        """The derivatives of those rows that a slice, a mask of flags or an array of numbers names."""
        return self._take(rows)


class RolloutRates(NamedTuple):
    """How fast all changes that the motions of some rows depend on; what is not given does not change."""

    commands: Any = None
    """Shape (rows, T, t) (m or N)."""
    configuration: Any = None
    """Of the start's rotations (w, x, y, z), shape (rows, n, 4); only what keeps them unit quaternions counts."""
    velocity: Any = None
    """Of the start's rates of the joints, shape (rows, n, 3) (rad/s)."""
    payload: Any = None
    """Of the mass on the last disc, shape (rows,) (kg)."""
    wrench: Any = None
    """Of a force (N) and a moment (N m) on each disc, world frame, the same all along, shape (rows, n, 6); or one for each
    command, shape (rows, T, n, 6)."""
    parameters: Any = None
    """Of the parameters that are named, shape (rows, p)."""
    obstacles: Any = None
    """Of each of the scene's ``m`` obstacles before the motion begins: a displacement of its origin (m) and a rotation about it
    (rad), world axes, shape (rows, m, 6)."""
    compliance: Any = None
    """Of the compliance of each obstacle (m/N), shape (rows, m)."""
    base: Any = None
    """Of the base before the motion begins: a displacement of it (m) and a rotation about it (rad), world axes, shape
    (rows, 6)."""


@dataclass(frozen=True, eq=False, repr=False)
class RolloutTangents(Batch):
    """Changes of the states of :func:`tdcr.rollout` after each command. A row without them is not a number.

    Attributes:
        positions: Shape (rows, T, n, 3) (m).
        quaternions: Shape (rows, T, n, 4).
        velocity: Shape (rows, T, n, 3) (rad/s).
        failures: Why a row has no derivatives, by its number.
    """

    positions: Floats
    quaternions: Floats
    velocity: Floats
    failures: dict[int, str]

    _by_rows = ("positions", "quaternions", "velocity")

    def __len__(self) -> int:
        return len(self.positions)

    def __getitem__(self, rows: slice | Sequence[int] | NDArray[Any]) -> RolloutTangents:
        """The changes of those rows that a slice, a mask of flags or an array of numbers names."""
        return self._take(rows)


class Linearisation(NamedTuple):
    """A step to first order, ``dx_next = a @ dx + b @ du``.

    The coordinates ``x`` are turns of the joints in the discs' own frames, ``q exp(dq)`` (rad), three for each joint, then their
    rates (rad/s): those of MuJoCo's ``mjd_transitionFD``.
    """

    a: Floats
    """By the state, shape (6 n, 6 n)."""
    b: Floats
    """By the command, shape (6 n, t)."""

    def __eq__(self, other: object) -> bool:
        return equal(tuple(self), tuple(other)) if isinstance(other, Linearisation) else NotImplemented

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __repr__(self) -> str:
        return f"Linearisation(a={brief(self.a)}, b={brief(self.b)})"


def rollout_vjp(
    robot: RobotLike | Sequence[RobotLike],
    commands: Any,
    by_positions: Any = None,
    by_quaternions: Any = None,
    by_velocity: Any = None,
    payload: Any = None,
    *,
    parameters: Sequence[str] = (),
    wrench: Any = None,
    loads: Loads | Sequence[Loads] | None = None,
    start: Start = "straight",
    dt: float = 0.002,
    frame_skip: int = 1,
    scene: Scene | Sequence[Scene] | None = None,
    progress: Progress | None = None,
) -> RolloutGradients:
    """Derivatives of a cost of each row by all that its motion depends on, from those by the states of :func:`rollout`: the
    adjoint of the steps, which takes about three times as long as the motion. A parameter is laid out once a row, and costs
    nothing at the steps. The integrator is ``"semi-implicit-euler"``.

    Args:
        robot, commands, payload, wrench, loads, start, dt, frame_skip, scene: As of :func:`rollout`. The motion is computed
            again. Obstacles of the scene have no mass; derivatives are one-sided where a contact begins, ends or begins to slip.
        by_positions: Derivative of the cost by the positions, shape (rows, T, n, 3); zero where it is not given.
        by_quaternions: Derivative by the world orientations (w, x, y, z), shape (rows, T, n, 4); only the part along unit
            quaternions counts.
        by_velocity: Derivative by the rates of the joints, shape (rows, T, n, 3).
        parameters: Names of ``p`` parameters of the robot or its loads, such as ``"gain[2]"`` or ``"damping[0]"``.
        progress: Is called with the number of rows done since its last call, as ``tqdm(total=rows).update``.

    Raises:
        ParameterError: For a parameter that the robot does not have, and for two that overlap.
        InputError: For shapes that do not fit, and for a start that is to be settled: what changes with an equilibrium is for
            :func:`tdcr.vjp`.
        DynamicsError: For commanded lengths of inextensible tendons, and objects of the scene that move, which have no
            derivatives.
        ContactError: In a scene, for a start inside an obstacle.
    """
    question = _question(robot, commands, payload, wrench, loads, start, dt, frame_skip, scene)
    shape = (*question.commands.shape[:2], question.robots[0].discs)
    given = ((by_positions, "by_positions", 3), (by_quaternions, "by_quaternions", 4), (by_velocity, "by_velocity", 3))
    by_position, by_quaternion, by_rate = (
        None if value is None else as_float(value, name, (*shape, width)) for value, name, width in given
    )
    rows = _tdcr.rollout_vjp_rows(
        *question.arguments(), (by_position, by_quaternion, by_rate), as_texts(parameters, "parameters"), progress
    )
    by_configuration = rows.configuration
    if question.norms is not None:
        # Of a rotation that was given as a longer quaternion.
        by_configuration = by_configuration / question.norms
    return RolloutGradients(
        rows.commands,
        by_configuration,
        rows.velocity,
        rows.payload,
        rows.wrench if rows.wrenches is None else rows.wrenches,
        rows.parameters,
        np.ascontiguousarray(rows.obstacles[..., :6]),
        np.ascontiguousarray(rows.obstacles[..., 6]),
        rows.base,
        {row: why for row, _, why in rows.failures},
    )


def rollout_jvp(
    robot: RobotLike | Sequence[RobotLike],
    commands: Any,
    rates: RolloutRates,
    payload: Any = None,
    *,
    parameters: Sequence[str] = (),
    wrench: Any = None,
    loads: Loads | Sequence[Loads] | None = None,
    start: Start = "straight",
    dt: float = 0.002,
    frame_skip: int = 1,
    scene: Scene | Sequence[Scene] | None = None,
    progress: Progress | None = None,
) -> RolloutTangents:
    """Changes of the states of each row when what its motion depends on changes: forward mode, of which :func:`rollout_vjp` is
    the adjoint. A time step takes one adjoint for each rate of a joint, 3 n of them: for the derivatives of a cost, take
    :func:`rollout_vjp`.

    Args:
        rates: How fast each changes.
        robot, commands, payload, parameters, wrench, loads, start, dt, frame_skip, scene, progress: As of :func:`rollout_vjp`.

    Raises:
        ParameterError: For a parameter that the robot does not have, and for two that overlap.
        InputError: For shapes that do not fit, for a start that is to be settled, and for rates of obstacles without a scene.
        DynamicsError, ContactError: As of :func:`rollout_vjp`.
    """
    if not isinstance(rates, RolloutRates):
        raise InputError(f"rates is {rates!r}; expected tdcr.RolloutRates")
    question = _question(robot, commands, payload, wrench, loads, start, dt, frame_skip, scene)
    names = as_texts(parameters, "parameters")
    (rows, length, tendons), discs = question.commands.shape, question.robots[0].discs
    of_wrenches = None
    if rates.wrench is not None and np.ndim(rates.wrench) == 4:
        of_wrenches = as_float(rates.wrench, "rates.wrench", (rows, length, discs, 6))
        rates = rates._replace(wrench=None)
    obstacles = 0 if question.scenes is None else len(question.scenes[0])
    for name in ("obstacles", "compliance"):
        if getattr(rates, name) is not None and question.scenes is None:
            raise InputError(f"rates.{name} is given without a scene; expected `scene`")
    shapes = (
        (rows, length, tendons),
        (rows, discs, 4),
        (rows, discs, 3),
        (rows,),
        (rows, discs, 6),
        (rows, len(names)),
        (rows, obstacles, 6),
        (rows, obstacles),
        (rows, 6),
    )
    given = [
        np.zeros(shape) if rate is None else as_float(rate, f"rates.{name}", shape)
        for name, rate, shape in zip(RolloutRates._fields, rates, shapes, strict=True)
    ]
    if question.norms is not None:
        # Of a rotation that was given as a longer quaternion.
        given[1] = given[1] / question.norms
    by_commands, by_configuration, by_velocity, by_payload, by_wrench, by_parameters, by_motions, by_compliance, by_base = given
    around = np.concatenate([by_motions, by_compliance[..., np.newaxis]], axis=-1), by_base
    native = (by_commands, by_configuration, by_velocity, by_payload, by_wrench, by_parameters, of_wrenches, *around)
    found = _tdcr.rollout_jvp_rows(*question.arguments(), native, names, progress)
    failures = {row: why for row, _, why in found.failures}
    return RolloutTangents(found.positions, found.quaternions, found.velocity, failures)


def _question(
    robot: RobotLike | Sequence[RobotLike],
    commands: Any,
    payload: Any,
    wrench: Any,
    loads: Loads | Sequence[Loads] | None,
    start: Start,
    dt: float,
    frame_skip: int,
    scene: Scene | Sequence[Scene] | None,
) -> Question:
    """Motions that can be differentiated."""
    if isinstance(start, str) and start == "settled":
        raise InputError("start is 'settled', which has no derivative here; expected a state, such as that of tdcr.settle")
    return Question.of(robot, commands, payload, wrench, loads, start, dt, "semi-implicit-euler", frame_skip, scene)


def linearise(
    robot: RobotLike,
    state: State,
    command: Any,
    payload: Any = None,
    *,
    loads: Loads | None = None,
    dt: float = 0.002,
    scene: Scene | None = None,
) -> Linearisation:
    """Derivatives of a step from ``state`` by ``"semi-implicit-euler"``, exact but for rounding.

    Where a tendon goes slack or a joint meets its limit they are of one side.

    Args:
        robot: The robot.
        state: Configuration, shape (n, 4), and velocity, shape (n, 3).
        command: Shape (t,) (m or N).
        payload: Point mass on the last disc (kg).
        loads: Other loads.
        dt: Time step (s).
        scene: Obstacles around the robot, without a mass.

    Raises:
        DynamicsError: If a derivative is not finite; for servos with a lag or a largest rate, whose state a step does not have,
            and for what :func:`rollout_vjp` refuses.
    """
    robot = as_robot(robot)
    configuration, velocity = one_state(robot, state)
    command = as_float(command, "command", (robot.tendons,))
    native = None if scene is None else as_scene(scene)._native
    load = one_load(loads, payload)._native
    a, b = _tdcr.linearise(robot._native, configuration, velocity, command, load, as_number(dt, "dt"), native)
    return Linearisation(a, b)

"""Differentiable equilibria and motions in JAX: works under ``jit``, ``vmap``, ``grad`` and ``jvp``, on the host.

JAX is an optional dependency: ``pip install ".[jax]"``. Results have the type of ``command``: for float64 set
``jax.config.update("jax_enable_x64", True)``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from tdcr._arrays import as_count, as_number
from tdcr._differentiable import Problem, check_parameters, own_base, own_poses, scene_text
from tdcr._differentiable_motions import MotionProblem
from tdcr.errors import InputError, MissingPackageError
from tdcr.robot import Robot, RobotLike, as_robot
from tdcr.scene import Scene
from tdcr.sensitivity import OnFailure, check_on_failure

try:
    import jax
    import jax.numpy as jnp
except ImportError as error:
    raise MissingPackageError("tdcr.jax needs JAX, which is not installed: pip install jax") from error

from tdcr._jax_primitives import OnHost, call


def settle(
    robot: RobotLike,
    command: Any,
    payload: Any = 0.0,
    wrench: Any = None,
    *,
    line: Any = None,
    parameters: Sequence[str] = (),
    values: Any = None,
    scene: Scene | None = None,
    obstacle_positions: Any = None,
    obstacle_quaternions: Any = None,
    base_position: Any = None,
    base_quaternion: Any = None,
    on_failure: OnFailure = "raise",
) -> tuple[jax.Array, jax.Array]:
    """Settles rows of commands; gradients flow to the commands, the loads, the values of physical parameters, and the poses
    of obstacles and of the base.

    Computed in float64 by a callback to the host. It has first derivatives, in reverse and in forward mode; second ones are
    refused.

    Args:
        robot: A robot of ``n`` discs, or what :class:`tdcr.Robot` makes one of.
        command: Shape (..., tendons) (m or N).
        payload: Mass hung from the last disc, shape (...) or one number (kg).
        wrench: Force (N) and moment (N m) on each disc, world frame, shape (..., n, 6) or (n, 6).
        line: Force for each length of the backbone, world frame (N/m), shape (..., 3) or (3,): each disc bears that of half the
            backbone to each neighbour.
        parameters: Names of ``p`` physical parameters: see :mod:`tdcr.sensitivity`.
        values: Their values, shape (p,), or (..., p) for a robot of its own for each row.
        scene: Obstacles around the robots.
        obstacle_positions: Where the obstacles are in place of the scene's own positions, shape (..., m, 3) or (m, 3) (m), with
            gradients.
        obstacle_quaternions: How they are turned (w, x, y, z), in place of the scene's, shape (..., m, 4) or (m, 4), normalised
            on use, with gradients.
        base_position: Where the robot's base is, in place of its own position, shape (..., 3) or (3,) (m), with gradients.
        base_quaternion: How the base is turned (w, x, y, z), in place of its own orientation, shape (..., 4) or (4,), normalised
            on use, with gradients. Neither gravity nor the loads turn with it.
        on_failure: What becomes of rows that do not settle: ``"raise"``, or ``"nan"``.

    Returns:
        Positions of the discs, shape (..., n, 3), world frame (m), and quaternions (w, x, y, z), shape (..., n, 4).
    """
    robot = as_robot(robot)
    chosen = check_on_failure(on_failure)
    command = jnp.asarray(command)
    if command.ndim == 0 or command.shape[-1] != robot.tendons:
        raise InputError(f"command has shape {command.shape}; expected (..., {robot.tendons})")
    dtype = _float_type(command, "command")
    values = None if values is None else jnp.asarray(values)
    names = check_parameters(parameters, values)
    robot.check_parameters(names)
    leading, discs = command.shape[:-1], robot.discs
    arguments = (
        command.astype(dtype),
        _rows(payload, "payload", dtype, leading, ()),
        _rows(wrench, "wrench", dtype, leading, (discs, 6)),
        # One row of values for each command: their gradients are summed by the adjoint of the broadcast.
        _rows(values, "values", dtype, leading, (len(names),)),
        _poses(scene, obstacle_positions, obstacle_quaternions, dtype, leading),
        _base(robot, base_position, base_quaternion, dtype, leading),
        _rows(line, "line", dtype, leading, (3,)),
    )
    positions, quaternions = call(_settling(_Settling(robot.to_json(), names, chosen, scene_text(scene))), *arguments)
    return positions, quaternions


def rollout(
    robot: RobotLike,
    commands: Any,
    configuration: Any,
    velocity: Any = None,
    payload: Any = 0.0,
    wrench: Any = None,
    *,
    line: Any = None,
    parameters: Sequence[str] = (),
    values: Any = None,
    dt: float = 0.002,
    frame_skip: int = 1,
    scene: Scene | None = None,
    obstacle_positions: Any = None,
    obstacle_quaternions: Any = None,
    base_position: Any = None,
    base_quaternion: Any = None,
    on_failure: OnFailure = "raise",
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Moves rows of robots by sequences of commands; gradients flow to the commands, the start, the loads, the values of physical
    parameters, and the poses of obstacles and of the base.

    Computed in float64 by a callback to the host, by the integrator ``"semi-implicit-euler"``. It has first derivatives, in
    reverse and in forward mode, of which a forward one takes as long as a reverse one for each rate of a joint: see
    :func:`tdcr.rollout_jvp`. Second ones are refused.

    Args:
        robot: A robot of ``n`` discs, or what :class:`tdcr.Robot` makes one of.
        commands: Shape (..., T, tendons) (m or N).
        configuration: Of the start, rotations (w, x, y, z) of the joints, shape (..., n, 4) or (n, 4).
        velocity: Rates of the joints at the start, in the discs' own frames, shape (..., n, 3) or (n, 3) (rad/s); at rest
            where it is not given.
        payload: Point mass on the last disc, shape (...) or one number (kg).
        wrench: Force (N) and moment (N m) on each disc, world frame, the same all along, shape (..., n, 6) or (n, 6); or one for
            each command, shape (..., T, n, 6), with all axes of ``commands`` in front.
        line: Force for each length of the backbone, world frame (N/m), the same all along, shape (..., 3) or (3,), as of
            :func:`settle`.
        parameters: Names of ``p`` physical parameters: see :mod:`tdcr.sensitivity`.
        values: Their values, shape (p,), or (..., p) for a robot of its own for each row.
        dt: Time step (s).
        frame_skip: Time steps for which each command holds.
        scene: Obstacles around the robots, without a mass: see :func:`tdcr.rollout_vjp`.
        obstacle_positions, obstacle_quaternions, base_position, base_quaternion: Poses of the obstacles and of the base all
            along, in place of the scene's and the robot's own, as of :func:`settle`. The joints start as they do.
        on_failure: What becomes of rows that diverge: ``"raise"``, or ``"nan"``.

    Returns:
        After each command the positions of the discs, shape (..., T, n, 3), world frame (m); quaternions (w, x, y, z), shape
        (..., T, n, 4); and rates of the joints, shape (..., T, n, 3) (rad/s).
    """
    robot = as_robot(robot)
    chosen = check_on_failure(on_failure)
    commands = jnp.asarray(commands)
    if commands.ndim < 2 or commands.shape[-1] != robot.tendons:
        raise InputError(f"commands has shape {commands.shape}; expected (..., T, {robot.tendons})")
    dtype = _float_type(commands, "commands")
    values = None if values is None else jnp.asarray(values)
    names = check_parameters(parameters, values)
    robot.check_parameters(names)
    leading, discs = commands.shape[:-2], robot.discs
    of_wrench = (commands.shape[-2], discs, 6) if wrench is not None and jnp.ndim(wrench) > commands.ndim else (discs, 6)
    arguments = (
        commands.astype(dtype),
        _rows(configuration, "configuration", dtype, leading, (discs, 4)),
        _rows(velocity, "velocity", dtype, leading, (discs, 3)),
        _rows(payload, "payload", dtype, leading, ()),
        _rows(wrench, "wrench", dtype, leading, of_wrench),
        _rows(values, "values", dtype, leading, (len(names),)),
        _poses(scene, obstacle_positions, obstacle_quaternions, dtype, leading),
        _base(robot, base_position, base_quaternion, dtype, leading),
        _rows(line, "line", dtype, leading, (3,)),
    )
    steps = as_number(dt, "dt"), as_count(frame_skip, "frame_skip", 1)
    positions, quaternions, rates = call(_moving(_Moving(robot.to_json(), names, *steps, chosen, scene_text(scene))), *arguments)
    return positions, quaternions, rates


def _float_type(array: jax.Array, name: str) -> Any:
    """The floating-point type that an array of real numbers is computed with."""
    if array.dtype == bool or jnp.issubdtype(array.dtype, jnp.complexfloating):
        raise InputError(f"{name} has entries of type {array.dtype}; expected real numbers")
    return jnp.result_type(float, array.dtype)


def _rows(value: Any, name: str, dtype: Any, leading: tuple[int, ...], shape: tuple[int, ...]) -> jax.Array:
    """An argument with these leading axes; zeros where it is not given."""
    array = jnp.zeros(shape, dtype) if value is None else jnp.asarray(value)
    _float_type(array, name)
    try:
        return jnp.broadcast_to(array.astype(dtype), (*leading, *shape))
    except ValueError:
        expected = f"{(*leading, *shape)}, or {shape} for all rows"
        raise InputError(f"{name} has shape {array.shape}; expected {expected}") from None


def _poses(scene: Scene | None, positions: Any, quaternions: Any, dtype: Any, leading: tuple[int, ...]) -> jax.Array:
    """Poses of obstacles, shape (..., m, 7), the scene's own where only positions or quaternions are given; of none where neither
    is."""
    places, turns = own_poses(scene_text(scene), positions is not None or quaternions is not None)
    poses = (
        _rows(places if positions is None else positions, "obstacle_positions", dtype, leading, places.shape),
        _rows(turns if quaternions is None else quaternions, "obstacle_quaternions", dtype, leading, turns.shape),
    )
    return jnp.concatenate(poses, axis=-1)


def _base(robot: Robot, position: Any, quaternion: Any, dtype: Any, leading: tuple[int, ...]) -> jax.Array:
    """Pose of the base, shape (..., 1, 7), the robot's own where only position or quaternion is given; of none, shape
    (..., 0, 7), where neither is."""
    if position is None and quaternion is None:
        return jnp.zeros((*leading, 0, 7), dtype)
    place, turn = own_base(robot.to_json())
    pose = (
        _rows(place if position is None else position, "base_position", dtype, leading, (3,)),
        _rows(turn if quaternion is None else quaternion, "base_quaternion", dtype, leading, (4,)),
    )
    return jnp.concatenate(pose, axis=-1)[..., None, :]


class _Settling(NamedTuple):
    """Options of equilibria."""

    robot: str
    names: tuple[str, ...]
    on_failure: OnFailure
    scene: str

    def problem(self, arguments: Any) -> Problem:
        return Problem.of(self.robot, self.scene, self.names, *arguments)

    def value(self, arguments: Any) -> Any:
        return self.problem(arguments).settle(self.on_failure)

    def adjoint(self, cotangents: Any, arguments: Any) -> Any:
        positions, quaternions = cotangents
        return self.problem(arguments).adjoint(positions, quaternions, (True, True, True, bool(self.names), True, True, True))

    def tangent(self, changes: Any, arguments: Any) -> Any:
        return self.problem(arguments).tangent(changes)


class _Moving(NamedTuple):
    """Options of motions."""

    robot: str
    names: tuple[str, ...]
    dt: float
    frame_skip: int
    on_failure: OnFailure
    scene: str

    def problem(self, arguments: Any) -> MotionProblem:
        return MotionProblem.of(self.robot, self.scene, self.names, self.dt, self.frame_skip, *arguments)

    def value(self, arguments: Any) -> Any:
        return self.problem(arguments).roll_out(self.on_failure)

    def adjoint(self, cotangents: Any, arguments: Any) -> Any:
        return self.problem(arguments).adjoint(*cotangents)

    def tangent(self, changes: Any, arguments: Any) -> Any:
        return self.problem(arguments).tangent(changes)


def _shapes_of_settle(shapes: Sequence[tuple[int, ...]]) -> list[tuple[int, ...]]:
    command, _, wrench, *_ = shapes
    return [(*command[:-1], wrench[-2], width) for width in (3, 4)]


def _shapes_of_rollout(shapes: Sequence[tuple[int, ...]]) -> list[tuple[int, ...]]:
    commands, configuration = shapes[:2]
    return [(*commands[:-1], configuration[-2], width) for width in (3, 4, 3)]


def _settling(options: _Settling) -> OnHost:
    return OnHost("tdcr.jax.settle", options, _Settling.value, _Settling.adjoint, _Settling.tangent, _shapes_of_settle)


def _moving(options: _Moving) -> OnHost:
    return OnHost("tdcr.jax.rollout", options, _Moving.value, _Moving.adjoint, _Moving.tangent, _shapes_of_rollout)

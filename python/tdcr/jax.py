"""Differentiable equilibria and motions in JAX: works under ``jit``, ``vmap`` and ``grad``, on the host.

JAX is an optional dependency: ``pip install ".[jax]"``. Results have the type of ``command``: for float64 set
``jax.config.update("jax_enable_x64", True)``.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from tdcr._differentiable import MotionProblem, Problem, check_parameters
from tdcr.errors import InputError, MissingPackageError
from tdcr.robot import Robot
from tdcr.sensitivity import OnFailure

try:
    import jax
    import jax.numpy as jnp
except ImportError as error:
    raise MissingPackageError("tdcr.jax needs JAX, which is not installed: pip install jax") from error


def settle(
    robot: Robot,
    command: Any,
    payload: Any = 0.0,
    wrench: Any = None,
    *,
    parameters: Sequence[str] = (),
    values: Any = None,
    on_failure: OnFailure = "raise",
) -> tuple[jax.Array, jax.Array]:
    """Settles rows of commands; gradients flow to the commands, the loads and the values of physical parameters.

    Computed in float64 by a callback to the host. It has first derivatives in reverse mode only.

    Args:
        robot: A robot of ``n`` discs.
        command: Shape (..., tendons) (m or N).
        payload: Mass hung from the last disc, shape (...) or one number (kg).
        wrench: Force (N) and moment (N m) on each disc, world frame, shape (..., n, 6) or (n, 6).
        parameters: Names of ``p`` physical parameters: see :mod:`tdcr.sensitivity`.
        values: Their values, shape (p,), or (..., p) for a robot of its own for each row.
        on_failure: What becomes of rows that do not settle: ``"raise"``, or ``"nan"``.

    Returns:
        Positions of the discs, shape (..., n, 3), world frame (m), and quaternions (w, x, y, z), shape (..., n, 4).
    """
    command = jnp.asarray(command)
    if command.ndim == 0 or command.shape[-1] != robot.tendons:
        raise InputError(f"command has shape {command.shape}; expected (..., {robot.tendons})")
    command = command.astype(jnp.result_type(float, command.dtype))
    values = None if values is None else jnp.asarray(values)
    names = check_parameters(parameters, values)
    leading, dtype = command.shape[:-1], command.dtype
    payload = jnp.broadcast_to(jnp.asarray(payload, dtype), leading)
    wrench = jnp.zeros((robot.discs, 6), dtype) if wrench is None else jnp.asarray(wrench, dtype)
    wrench = jnp.broadcast_to(wrench, (*leading, robot.discs, 6))
    # One row of values for each command: their gradients are summed by the adjoint of the broadcast.
    values = jnp.zeros(0, dtype) if values is None else values.astype(dtype)
    values = jnp.broadcast_to(values, (*leading, len(names)))
    positions, quaternions = _settle(robot.to_json(), names, on_failure, command, payload, wrench, values)
    return positions, quaternions


@partial(jax.custom_vjp, nondiff_argnums=(0, 1, 2))
def _settle(
    robot: str, names: tuple[str, ...], on_failure: OnFailure, command: Any, payload: Any, wrench: Any, values: Any
) -> Any:
    def on_host(command: Any, payload: Any, wrench: Any, values: Any) -> tuple[Any, Any]:
        positions, quaternions = Problem.of(robot, names, command, payload, wrench, values).settle(on_failure)
        return positions.astype(dtype), quaternions.astype(dtype)

    dtype = np.dtype(command.dtype)
    poses = (*command.shape[:-1], wrench.shape[-2])
    shapes = jax.ShapeDtypeStruct((*poses, 3), dtype), jax.ShapeDtypeStruct((*poses, 4), dtype)
    return jax.pure_callback(on_host, shapes, command, payload, wrench, values, vmap_method="broadcast_all")


def _forward(
    robot: str, names: tuple[str, ...], on_failure: OnFailure, command: Any, payload: Any, wrench: Any, values: Any
) -> Any:
    arguments = command, payload, wrench, values
    return _settle(robot, names, on_failure, *arguments), arguments


def _backward(robot: str, names: tuple[str, ...], on_failure: OnFailure, arguments: Any, cotangents: Any) -> Any:
    def on_host(by_positions: Any, by_quaternions: Any, *arguments: Any) -> tuple[Any, ...]:
        problem = Problem.of(robot, names, *arguments)
        gradients = problem.adjoint(by_positions, by_quaternions, (True, True, True, bool(names)))
        return tuple(g.astype(a.dtype) for g, a in zip(gradients, arguments, strict=True))

    shapes = tuple(jax.ShapeDtypeStruct(a.shape, a.dtype) for a in arguments)
    return jax.pure_callback(on_host, shapes, *cotangents, *arguments, vmap_method="broadcast_all")


_settle.defvjp(_forward, _backward)


def rollout(
    robot: Robot,
    commands: Any,
    configuration: Any,
    velocity: Any = None,
    payload: Any = 0.0,
    wrench: Any = None,
    *,
    parameters: Sequence[str] = (),
    values: Any = None,
    dt: float = 0.002,
    frame_skip: int = 1,
    on_failure: OnFailure = "raise",
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Moves rows of robots by sequences of commands; gradients flow to the commands, the start, the loads and the values of
    physical parameters.

    Computed in float64 by a callback to the host, by the integrator ``"semi-implicit-euler"``. It has first derivatives in
    reverse mode only.

    Args:
        robot: A robot of ``n`` discs.
        commands: Shape (..., T, tendons) (m or N).
        configuration: Of the start, rotations (w, x, y, z) of the joints, shape (..., n, 4) or (n, 4).
        velocity: Rates of the joints at the start, in the discs' own frames, shape (..., n, 3) or (n, 3) (rad/s); at rest
            where it is not given.
        payload: Point mass on the last disc, shape (...) or one number (kg).
        wrench: Force (N) and moment (N m) on each disc, world frame, the same all along, shape (..., n, 6) or (n, 6).
        parameters: Names of ``p`` physical parameters: see :mod:`tdcr.sensitivity`.
        values: Their values, shape (p,), or (..., p) for a robot of its own for each row.
        dt: Time step (s).
        frame_skip: Time steps for which each command holds.
        on_failure: What becomes of rows that diverge: ``"raise"``, or ``"nan"``.

    Returns:
        After each command the positions of the discs, shape (..., T, n, 3), world frame (m); quaternions (w, x, y, z), shape
        (..., T, n, 4); and rates of the joints, shape (..., T, n, 3) (rad/s).
    """
    commands = jnp.asarray(commands)
    if commands.ndim < 2 or commands.shape[-1] != robot.tendons:
        raise InputError(f"commands has shape {commands.shape}; expected (..., T, {robot.tendons})")
    commands = commands.astype(jnp.result_type(float, commands.dtype))
    values = None if values is None else jnp.asarray(values)
    names = check_parameters(parameters, values)
    leading, dtype, discs = commands.shape[:-2], commands.dtype, robot.discs

    def rows(value: Any, shape: tuple[int, ...]) -> Any:
        value = jnp.zeros(shape, dtype) if value is None else jnp.asarray(value, dtype)
        return jnp.broadcast_to(value, (*leading, *shape))

    arguments = (
        commands,
        rows(configuration, (discs, 4)),
        rows(velocity, (discs, 3)),
        rows(payload, ()),
        rows(wrench, (discs, 6)),
        rows(values, (len(names),)),
    )
    positions, quaternions, rates = _rollout(robot.to_json(), names, (dt, frame_skip), on_failure, *arguments)
    return positions, quaternions, rates


@partial(jax.custom_vjp, nondiff_argnums=(0, 1, 2, 3))
def _rollout(robot: str, names: tuple[str, ...], steps: tuple[float, int], on_failure: OnFailure, *arguments: Any) -> Any:
    def on_host(*arguments: Any) -> tuple[Any, ...]:
        states = MotionProblem.of(robot, names, *steps, *arguments).roll_out(on_failure)
        return tuple(state.astype(dtype) for state in states)

    commands, configuration = arguments[:2]
    dtype = np.dtype(commands.dtype)
    poses = (*commands.shape[:-1], configuration.shape[-2])
    shapes = tuple(jax.ShapeDtypeStruct((*poses, width), dtype) for width in (3, 4, 3))
    return jax.pure_callback(on_host, shapes, *arguments, vmap_method="broadcast_all")


def _forward_of_rollout(
    robot: str, names: tuple[str, ...], steps: tuple[float, int], on_failure: OnFailure, *arguments: Any
) -> Any:
    return _rollout(robot, names, steps, on_failure, *arguments), arguments


def _backward_of_rollout(
    robot: str, names: tuple[str, ...], steps: tuple[float, int], on_failure: OnFailure, arguments: Any, cotangents: Any
) -> Any:
    def on_host(by_positions: Any, by_quaternions: Any, by_velocity: Any, *arguments: Any) -> tuple[Any, ...]:
        problem = MotionProblem.of(robot, names, *steps, *arguments)
        gradients = problem.adjoint(by_positions, by_quaternions, by_velocity)
        return tuple(g.astype(a.dtype) for g, a in zip(gradients, arguments, strict=True))

    shapes = tuple(jax.ShapeDtypeStruct(a.shape, a.dtype) for a in arguments)
    return jax.pure_callback(on_host, shapes, *cotangents, *arguments, vmap_method="broadcast_all")


_rollout.defvjp(_forward_of_rollout, _backward_of_rollout)

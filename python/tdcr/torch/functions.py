"""Differentiable equilibria and motions in PyTorch: custom operators with formulas for autograd, which ``torch.compile`` keeps
whole."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from tdcr._differentiable import MotionProblem, Problem, check_parameters
from tdcr.errors import InputError
from tdcr.robot import Robot
from tdcr.sensitivity import OnFailure


def settle(
    robot: Robot,
    command: Tensor,
    payload: Tensor | float = 0.0,
    wrench: Tensor | None = None,
    *,
    parameters: Sequence[str] = (),
    values: Tensor | None = None,
    on_failure: OnFailure = "raise",
) -> tuple[Tensor, Tensor]:
    """Settles rows of commands; gradients flow to the commands, the loads and the values of physical parameters.

    Computed in float64 on the processor, whatever the type of the tensors; results have the type of ``command``. It has first
    derivatives only.

    Args:
        robot: A robot of ``n`` discs.
        command: Shape (..., tendons) (m or N).
        payload: Mass hung from the last disc, shape (...) or one number (kg).
        wrench: Force (N) and moment (N m) on each disc, world frame, shape (..., n, 6) or (n, 6).
        parameters: Names of ``p`` physical parameters: see :mod:`tdcr.sensitivity`.
        values: Their values, shape (p,), or (..., p) for a robot of its own for each row.
        on_failure: What becomes of rows that do not settle: ``"raise"``, or ``"nan"``, which may be masked: they have no
            influence on gradients where the cost does not depend on them.

    Returns:
        Positions of the discs, shape (..., n, 3), world frame (m), and quaternions (w, x, y, z), shape (..., n, 4).

    Raises:
        InputError: For shapes that do not fit, and tensors on another device than the processor.
        NotSettledError: For a row that does not settle.
    """
    names = check_parameters(parameters, values)
    if command.ndim == 0:
        raise InputError("command has shape (); expected (..., tendons)")
    leading = command.shape[:-1]
    payload = torch.as_tensor(payload, dtype=command.dtype)
    wrench = command.new_zeros(robot.discs, 6) if wrench is None else wrench
    values = command.new_zeros(0) if values is None else values
    _check_devices(command=command, payload=payload, wrench=wrench, values=values)
    positions, quaternions = _settle(
        command,
        payload.expand(leading),
        wrench.expand(*leading, robot.discs, 6),
        values,
        robot.to_json(),
        _SEPARATOR.join(names),
        on_failure,
    )
    return positions, quaternions


def rollout(
    robot: Robot,
    commands: Tensor,
    configuration: Tensor,
    velocity: Tensor | None = None,
    payload: Tensor | float = 0.0,
    wrench: Tensor | None = None,
    *,
    parameters: Sequence[str] = (),
    values: Tensor | None = None,
    dt: float = 0.002,
    frame_skip: int = 1,
    on_failure: OnFailure = "raise",
) -> tuple[Tensor, Tensor, Tensor]:
    """Moves rows of robots by sequences of commands; gradients flow to the commands, the start, the loads and the values of
    physical parameters.

    Computed in float64 on the processor by the integrator ``"semi-implicit-euler"``; results have the type of ``commands``. It
    has first derivatives only.

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
        on_failure: What becomes of rows that diverge, as of :func:`settle`.

    Returns:
        After each command the positions of the discs, shape (..., T, n, 3), world frame (m); quaternions (w, x, y, z), shape
        (..., T, n, 4); and rates of the joints, shape (..., T, n, 3) (rad/s).

    Raises:
        InputError: For shapes that do not fit, and tensors on another device than the processor.
        DynamicsError: For a row that diverges.
    """
    names = check_parameters(parameters, values)
    if commands.ndim < 2:
        raise InputError(f"commands has shape {tuple(commands.shape)}; expected (..., T, tendons)")
    leading = commands.shape[:-2]
    discs = robot.discs
    payload = torch.as_tensor(payload, dtype=commands.dtype)
    velocity = commands.new_zeros(discs, 3) if velocity is None else velocity
    wrench = commands.new_zeros(discs, 6) if wrench is None else wrench
    values = commands.new_zeros(0) if values is None else values
    _check_devices(
        commands=commands, configuration=configuration, velocity=velocity, payload=payload, wrench=wrench, values=values
    )
    positions, quaternions, rates = _rollout(
        commands,
        configuration.expand(*leading, discs, 4),
        velocity.expand(*leading, discs, 3),
        payload.expand(leading),
        wrench.expand(*leading, discs, 6),
        values,
        robot.to_json(),
        _SEPARATOR.join(names),
        dt,
        frame_skip,
        on_failure,
    )
    return positions, quaternions, rates


def _check_devices(**tensors: Tensor) -> None:
    for name, tensor in tensors.items():
        if tensor.device.type != "cpu":
            raise InputError(f"{name} is on {tensor.device}; expected a tensor in the processor's memory: `{name}.cpu()`")


_SEPARATOR = ","
"""Between names of parameters: an operator takes one text, not a list of them."""


def _like(arguments: Sequence[Tensor], gradients: Sequence[Any]) -> list[Tensor]:
    """Gradients as tensors of their arguments' types; the last one is summed over rows where they share its argument."""
    *others, by_values = gradients
    if arguments[-1].ndim == 1:
        by_values = by_values.sum(axis=tuple(range(by_values.ndim - 1)))
    tensors = (torch.as_tensor(gradient) for gradient in (*others, by_values))
    return [gradient.to(argument.dtype) for gradient, argument in zip(tensors, arguments, strict=True)]


def _empty_like(tensor: Tensor) -> Tensor:
    return torch.empty(tensor.shape, dtype=tensor.dtype)


def _split(names: str) -> list[str]:
    return names.split(_SEPARATOR) if names else []


def _problem(command: Tensor, payload: Tensor, wrench: Tensor, values: Tensor, robot: str, names: str) -> Problem:
    arrays = (tensor.detach().double().numpy() for tensor in (command, payload, wrench, values))
    return Problem.of(robot, _split(names), *arrays)


@torch.library.custom_op("tdcr::settle", mutates_args=(), device_types="cpu")
def _settle(
    command: Tensor,
    payload: Tensor,
    wrench: Tensor,
    values: Tensor,
    robot: str,
    names: str,
    on_failure: str,
) -> tuple[Tensor, Tensor]:
    problem = _problem(command, payload, wrench, values, robot, names)
    positions, quaternions = problem.settle("raise" if on_failure == "raise" else "nan")
    return torch.from_numpy(positions).to(command.dtype), torch.from_numpy(quaternions).to(command.dtype)


@_settle.register_fake
def _(
    command: Tensor,
    payload: Tensor,
    wrench: Tensor,
    values: Tensor,
    robot: str,
    names: str,
    on_failure: str,
) -> tuple[Tensor, Tensor]:
    poses = (*command.shape[:-1], wrench.shape[-2])
    return command.new_empty(*poses, 3), command.new_empty(*poses, 4)


@torch.library.custom_op("tdcr::settle_backward", mutates_args=(), device_types="cpu")
def _settle_backward(
    by_positions: Tensor,
    by_quaternions: Tensor,
    command: Tensor,
    payload: Tensor,
    wrench: Tensor,
    values: Tensor,
    robot: str,
    names: str,
    wanted: Sequence[bool],
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    problem = _problem(command, payload, wrench, values, robot, names)
    positions, quaternions = (tensor.detach().double().numpy() for tensor in (by_positions, by_quaternions))
    by_command, by_payload, by_wrench, by_values = problem.adjoint(positions, quaternions, wanted)
    gradients = _like((command, payload, wrench, values), (by_command, by_payload, by_wrench, by_values))
    return gradients[0], gradients[1], gradients[2], gradients[3]


@_settle_backward.register_fake
def _(
    by_positions: Tensor,
    by_quaternions: Tensor,
    command: Tensor,
    payload: Tensor,
    wrench: Tensor,
    values: Tensor,
    robot: str,
    names: str,
    wanted: Sequence[bool],
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    return _empty_like(command), _empty_like(payload), _empty_like(wrench), _empty_like(values)


def _setup(ctx, inputs, output):  # type: ignore[no-untyped-def]
    command, payload, wrench, values, ctx.robot, ctx.names, _ = inputs
    ctx.save_for_backward(command, payload, wrench, values)


def _backward(ctx, by_positions, by_quaternions):  # type: ignore[no-untyped-def]
    wanted = [bool(want) for want in ctx.needs_input_grad[:4]]
    gradients = _settle_backward(by_positions, by_quaternions, *ctx.saved_tensors, ctx.robot, ctx.names, wanted)
    return *(g if want else None for g, want in zip(gradients, wanted, strict=True)), None, None, None


_settle.register_autograd(_backward, setup_context=_setup)


def _motion_problem(arguments: Sequence[Tensor], robot: str, names: str, dt: float, frame_skip: int) -> MotionProblem:
    arrays = (tensor.detach().double().numpy() for tensor in arguments)
    return MotionProblem.of(robot, _split(names), dt, frame_skip, *arrays)


@torch.library.custom_op("tdcr::rollout", mutates_args=(), device_types="cpu")
def _rollout(
    commands: Tensor,
    configuration: Tensor,
    velocity: Tensor,
    payload: Tensor,
    wrench: Tensor,
    values: Tensor,
    robot: str,
    names: str,
    dt: float,
    frame_skip: int,
    on_failure: str,
) -> tuple[Tensor, Tensor, Tensor]:
    arguments = (commands, configuration, velocity, payload, wrench, values)
    problem = _motion_problem(arguments, robot, names, dt, frame_skip)
    states = problem.roll_out("raise" if on_failure == "raise" else "nan")
    positions, quaternions, rates = (torch.from_numpy(state).to(commands.dtype) for state in states)
    return positions, quaternions, rates


@_rollout.register_fake
def _(
    commands: Tensor,
    configuration: Tensor,
    velocity: Tensor,
    payload: Tensor,
    wrench: Tensor,
    values: Tensor,
    robot: str,
    names: str,
    dt: float,
    frame_skip: int,
    on_failure: str,
) -> tuple[Tensor, Tensor, Tensor]:
    poses = (*commands.shape[:-1], wrench.shape[-2])
    return commands.new_empty(*poses, 3), commands.new_empty(*poses, 4), commands.new_empty(*poses, 3)


@torch.library.custom_op("tdcr::rollout_backward", mutates_args=(), device_types="cpu")
def _rollout_backward(
    cotangents: Sequence[Tensor], arguments: Sequence[Tensor], robot: str, names: str, dt: float, frame_skip: int
) -> list[Tensor]:
    problem = _motion_problem(arguments, robot, names, dt, frame_skip)
    return _like(arguments, problem.adjoint(*(tensor.detach().double().numpy() for tensor in cotangents)))


@_rollout_backward.register_fake
def _(
    cotangents: Sequence[Tensor], arguments: Sequence[Tensor], robot: str, names: str, dt: float, frame_skip: int
) -> list[Tensor]:
    return [_empty_like(argument) for argument in arguments]


def _setup_rollout(ctx, inputs, output):  # type: ignore[no-untyped-def]
    *arguments, ctx.robot, ctx.names, ctx.dt, ctx.frame_skip, _ = inputs
    ctx.save_for_backward(*arguments)


def _backward_of_rollout(ctx, *cotangents):  # type: ignore[no-untyped-def]
    arguments = list(ctx.saved_tensors)
    gradients = _rollout_backward(list(cotangents), arguments, ctx.robot, ctx.names, ctx.dt, ctx.frame_skip)
    return *gradients, None, None, None, None, None


_rollout.register_autograd(_backward_of_rollout, setup_context=_setup_rollout)

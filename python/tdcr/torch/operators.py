"""Equilibria and motions as operators of PyTorch: what ``torch.compile`` keeps whole, and what computes on the processor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor
from torch.autograd import forward_ad

from tdcr._differentiable import Problem
from tdcr._differentiable_motions import MotionProblem
from tdcr.errors import SensitivityError
from tdcr.sensitivity import OnFailure
from tdcr.torch.derivatives import Differentiable, Tensors

_SEPARATOR = ","
"""Between names of parameters: an operator takes one text, not a list of them."""


def settle(arguments: Tensors, robot: str, names: Sequence[str], on_failure: OnFailure, scene: str) -> tuple[Tensor, Tensor]:
    """Positions and quaternions; arguments are commands, payloads, wrenches, values, poses of obstacles and of the base,
    and line loads, with the same leading axes."""
    text = _SEPARATOR.join(names)
    if _compiling():
        found: tuple[Tensor, Tensor] = _settle(*arguments, robot, text, on_failure, scene)
        return found
    positions, quaternions = _settling(robot, text, on_failure, scene)(*arguments)
    return positions, quaternions


def rollout(
    arguments: Tensors, robot: str, names: Sequence[str], steps: tuple[float, int], on_failure: OnFailure, scene: str
) -> tuple[Tensor, Tensor, Tensor]:
    """Positions, quaternions and rates of the joints; arguments are commands, configurations and velocities of the start,
    payloads, wrenches, values, poses of obstacles and of the base, and line loads, with the same leading axes."""
    text = _SEPARATOR.join(names)
    if _compiling():
        found: tuple[Tensor, Tensor, Tensor] = _rollout(*arguments, robot, text, *steps, on_failure, scene)
        return found
    positions, quaternions, rates = _moving(robot, text, steps, on_failure, scene)(*arguments)
    return positions, quaternions, rates


def _compiling() -> bool:
    """Whether ``torch.compile`` traces, with no forward mode around it: it takes operators whole, which know none."""
    return torch.compiler.is_compiling() and forward_ad._current_level < 0


def _refuse_forward_mode(function: str) -> None:
    """Refuses what ``torch.compile`` would lose in silence: it traces operators, which know no forward mode."""
    if forward_ad._current_level >= 0:
        raise SensitivityError(
            f"forward mode is asked for inside `torch.compile`, which does not give it for tdcr.torch.{function}; expected "
            "`torch.func.jvp(torch.compile(f), ...)`, or no `torch.compile`"
        )


def _settling(robot: str, names: str, on_failure: OnFailure, scene: str) -> Differentiable:
    return Differentiable(
        "tdcr.torch.settle",
        lambda arguments: _settle(*arguments, robot, names, on_failure, scene),
        lambda cotangents, arguments, wanted: _settle_backward(*cotangents, *arguments, robot, names, wanted, scene),
        lambda changes, arguments: _settle_forward(*changes, *arguments, robot, names, scene),
    )


def _moving(robot: str, names: str, steps: tuple[float, int], on_failure: OnFailure, scene: str) -> Differentiable:
    return Differentiable(
        "tdcr.torch.rollout",
        lambda arguments: _rollout(*arguments, robot, names, *steps, on_failure, scene),
        lambda cotangents, arguments, _: _rollout_backward(*cotangents, *arguments, robot, names, *steps, scene),
        lambda changes, arguments: _rollout_forward(*changes, *arguments, robot, names, *steps, scene),
    )


def _arrays(tensors: Tensors) -> list[Any]:
    return [tensor.detach().double().numpy() for tensor in tensors]


def _like(arguments: Tensors, gradients: Sequence[Any]) -> list[Tensor]:
    """Arrays as tensors of their arguments' types."""
    pairs = zip(gradients, arguments, strict=True)
    return [torch.from_numpy(gradient.copy(order="C")).to(argument.dtype) for gradient, argument in pairs]


def _of_type(command: Tensor, arrays: Sequence[Any]) -> list[Tensor]:
    return [torch.from_numpy(array).to(command.dtype) for array in arrays]


def _empty_like(tensor: Tensor) -> Tensor:
    return torch.empty(tensor.shape, dtype=tensor.dtype)


def _split(names: str) -> list[str]:
    return names.split(_SEPARATOR) if names else []


def _problem(arguments: Tensors, robot: str, names: str, scene: str) -> Problem:
    return Problem.of(robot, scene, _split(names), *_arrays(arguments))


@torch.library.custom_op("tdcr::settle", mutates_args=(), device_types="cpu")
def _settle(
    command: Tensor,
    payload: Tensor,
    wrench: Tensor,
    values: Tensor,
    poses: Tensor,
    base: Tensor,
    line: Tensor,
    robot: str,
    names: str,
    on_failure: str,
    scene: str = "",
) -> tuple[Tensor, Tensor]:
    problem = _problem((command, payload, wrench, values, poses, base, line), robot, names, scene)
    positions, quaternions = _of_type(command, problem.settle("raise" if on_failure == "raise" else "nan"))
    return positions, quaternions


@_settle.register_fake
def _(
    command: Tensor,
    payload: Tensor,
    wrench: Tensor,
    values: Tensor,
    poses: Tensor,
    base: Tensor,
    line: Tensor,
    robot: str,
    names: str,
    on_failure: str,
    scene: str = "",
) -> tuple[Tensor, Tensor]:
    _refuse_forward_mode("settle")
    discs = (*command.shape[:-1], wrench.shape[-2])
    return command.new_empty(*discs, 3), command.new_empty(*discs, 4)


@torch.library.custom_op("tdcr::settle_backward", mutates_args=(), device_types="cpu")
def _settle_backward(
    by_positions: Tensor,
    by_quaternions: Tensor,
    command: Tensor,
    payload: Tensor,
    wrench: Tensor,
    values: Tensor,
    poses: Tensor,
    base: Tensor,
    line: Tensor,
    robot: str,
    names: str,
    wanted: Sequence[bool],
    scene: str = "",
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor, Tensor, Tensor]:
    arguments = command, payload, wrench, values, poses, base, line
    positions, quaternions = _arrays((by_positions, by_quaternions))
    found = _problem(arguments, robot, names, scene).adjoint(positions, quaternions, wanted)
    by_command, by_payload, by_wrench, by_values, by_poses, by_base, by_line = _like(arguments, found)
    return by_command, by_payload, by_wrench, by_values, by_poses, by_base, by_line


@_settle_backward.register_fake
def _(
    by_positions: Tensor,
    by_quaternions: Tensor,
    command: Tensor,
    payload: Tensor,
    wrench: Tensor,
    values: Tensor,
    poses: Tensor,
    base: Tensor,
    line: Tensor,
    robot: str,
    names: str,
    wanted: Sequence[bool],
    scene: str = "",
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor, Tensor, Tensor]:
    loads = _empty_like(payload), _empty_like(wrench)
    return _empty_like(command), *loads, _empty_like(values), _empty_like(poses), _empty_like(base), _empty_like(line)


@torch.library.custom_op("tdcr::settle_forward", mutates_args=(), device_types="cpu")
def _settle_forward(
    of_command: Tensor,
    of_payload: Tensor,
    of_wrench: Tensor,
    of_values: Tensor,
    of_poses: Tensor,
    of_base: Tensor,
    of_line: Tensor,
    command: Tensor,
    payload: Tensor,
    wrench: Tensor,
    values: Tensor,
    poses: Tensor,
    base: Tensor,
    line: Tensor,
    robot: str,
    names: str,
    scene: str = "",
) -> tuple[Tensor, Tensor]:
    changes = _arrays((of_command, of_payload, of_wrench, of_values, of_poses, of_base, of_line))
    found = _problem((command, payload, wrench, values, poses, base, line), robot, names, scene).tangent(changes)
    positions, quaternions = _of_type(command, found)
    return positions, quaternions


@_settle_forward.register_fake
def _(
    of_command: Tensor,
    of_payload: Tensor,
    of_wrench: Tensor,
    of_values: Tensor,
    of_poses: Tensor,
    of_base: Tensor,
    of_line: Tensor,
    command: Tensor,
    payload: Tensor,
    wrench: Tensor,
    values: Tensor,
    poses: Tensor,
    base: Tensor,
    line: Tensor,
    robot: str,
    names: str,
    scene: str = "",
) -> tuple[Tensor, Tensor]:
    discs = (*command.shape[:-1], wrench.shape[-2])
    return command.new_empty(*discs, 3), command.new_empty(*discs, 4)


def _setup(ctx, inputs, output):  # type: ignore[no-untyped-def]
    command, payload, wrench, values, poses, base, line, ctx.robot, ctx.names, _, ctx.scene = inputs
    ctx.save_for_backward(command, payload, wrench, values, poses, base, line)


def _backward(ctx, by_positions, by_quaternions):  # type: ignore[no-untyped-def]
    wanted = [bool(want) for want in ctx.needs_input_grad[:7]]
    gradients = _settle_backward(by_positions, by_quaternions, *ctx.saved_tensors, ctx.robot, ctx.names, wanted, ctx.scene)
    return *(g if want else None for g, want in zip(gradients, wanted, strict=True)), None, None, None, None


_settle.register_autograd(_backward, setup_context=_setup)


def _motion_problem(arguments: Tensors, robot: str, names: str, dt: float, frame_skip: int, scene: str) -> MotionProblem:
    return MotionProblem.of(robot, scene, _split(names), dt, frame_skip, *_arrays(arguments))


@torch.library.custom_op("tdcr::rollout", mutates_args=(), device_types="cpu")
def _rollout(
    commands: Tensor,
    configuration: Tensor,
    velocity: Tensor,
    payload: Tensor,
    wrench: Tensor,
    values: Tensor,
    poses: Tensor,
    base: Tensor,
    line: Tensor,
    robot: str,
    names: str,
    dt: float,
    frame_skip: int,
    on_failure: str,
    scene: str,
) -> tuple[Tensor, Tensor, Tensor]:
    arguments = (commands, configuration, velocity, payload, wrench, values, poses, base, line)
    problem = _motion_problem(arguments, robot, names, dt, frame_skip, scene)
    positions, quaternions, rates = _of_type(commands, problem.roll_out("raise" if on_failure == "raise" else "nan"))
    return positions, quaternions, rates


@_rollout.register_fake
def _(
    commands: Tensor,
    configuration: Tensor,
    velocity: Tensor,
    payload: Tensor,
    wrench: Tensor,
    values: Tensor,
    poses: Tensor,
    base: Tensor,
    line: Tensor,
    robot: str,
    names: str,
    dt: float,
    frame_skip: int,
    on_failure: str,
    scene: str,
) -> tuple[Tensor, Tensor, Tensor]:
    _refuse_forward_mode("rollout")
    discs = (*commands.shape[:-1], wrench.shape[-2])
    return commands.new_empty(*discs, 3), commands.new_empty(*discs, 4), commands.new_empty(*discs, 3)


@torch.library.custom_op("tdcr::rollout_backward", mutates_args=(), device_types="cpu")
def _rollout_backward(
    by_positions: Tensor,
    by_quaternions: Tensor,
    by_rates: Tensor,
    commands: Tensor,
    configuration: Tensor,
    velocity: Tensor,
    payload: Tensor,
    wrench: Tensor,
    values: Tensor,
    poses: Tensor,
    base: Tensor,
    line: Tensor,
    robot: str,
    names: str,
    dt: float,
    frame_skip: int,
    scene: str,
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor, Tensor, Tensor, Tensor, Tensor]:
    arguments = (commands, configuration, velocity, payload, wrench, values, poses, base, line)
    problem = _motion_problem(arguments, robot, names, dt, frame_skip, scene)
    found = problem.adjoint(*_arrays((by_positions, by_quaternions, by_rates)))
    by_commands, by_configuration, by_velocity, by_payload, by_wrench, by_values, by_poses, by_base, by_line = _like(
        arguments, found
    )
    return by_commands, by_configuration, by_velocity, by_payload, by_wrench, by_values, by_poses, by_base, by_line


@_rollout_backward.register_fake
def _(
    by_positions: Tensor,
    by_quaternions: Tensor,
    by_rates: Tensor,
    commands: Tensor,
    configuration: Tensor,
    velocity: Tensor,
    payload: Tensor,
    wrench: Tensor,
    values: Tensor,
    poses: Tensor,
    base: Tensor,
    line: Tensor,
    robot: str,
    names: str,
    dt: float,
    frame_skip: int,
    scene: str,
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor, Tensor, Tensor, Tensor, Tensor]:
    start = _empty_like(configuration), _empty_like(velocity)
    loads, around = (_empty_like(payload), _empty_like(wrench)), (_empty_like(poses), _empty_like(base), _empty_like(line))
    return _empty_like(commands), *start, *loads, _empty_like(values), *around


@torch.library.custom_op("tdcr::rollout_forward", mutates_args=(), device_types="cpu")
def _rollout_forward(
    of_commands: Tensor,
    of_configuration: Tensor,
    of_velocity: Tensor,
    of_payload: Tensor,
    of_wrench: Tensor,
    of_values: Tensor,
    of_poses: Tensor,
    of_base: Tensor,
    of_line: Tensor,
    commands: Tensor,
    configuration: Tensor,
    velocity: Tensor,
    payload: Tensor,
    wrench: Tensor,
    values: Tensor,
    poses: Tensor,
    base: Tensor,
    line: Tensor,
    robot: str,
    names: str,
    dt: float,
    frame_skip: int,
    scene: str,
) -> tuple[Tensor, Tensor, Tensor]:
    changes = _arrays((of_commands, of_configuration, of_velocity, of_payload, of_wrench, of_values, of_poses, of_base, of_line))
    arguments = (commands, configuration, velocity, payload, wrench, values, poses, base, line)
    found = _motion_problem(arguments, robot, names, dt, frame_skip, scene).tangent(changes)
    positions, quaternions, rates = _of_type(commands, found)
    return positions, quaternions, rates


@_rollout_forward.register_fake
def _(
    of_commands: Tensor,
    of_configuration: Tensor,
    of_velocity: Tensor,
    of_payload: Tensor,
    of_wrench: Tensor,
    of_values: Tensor,
    of_poses: Tensor,
    of_base: Tensor,
    of_line: Tensor,
    commands: Tensor,
    configuration: Tensor,
    velocity: Tensor,
    payload: Tensor,
    wrench: Tensor,
    values: Tensor,
    poses: Tensor,
    base: Tensor,
    line: Tensor,
    robot: str,
    names: str,
    dt: float,
    frame_skip: int,
    scene: str,
) -> tuple[Tensor, Tensor, Tensor]:
    discs = (*commands.shape[:-1], wrench.shape[-2])
    return commands.new_empty(*discs, 3), commands.new_empty(*discs, 4), commands.new_empty(*discs, 3)


def _setup_rollout(ctx, inputs, output):  # type: ignore[no-untyped-def]
    *arguments, ctx.robot, ctx.names, ctx.dt, ctx.frame_skip, _, ctx.scene = inputs
    ctx.save_for_backward(*arguments)


def _backward_of_rollout(ctx, *cotangents):  # type: ignore[no-untyped-def]
    gradients = _rollout_backward(*cotangents, *ctx.saved_tensors, ctx.robot, ctx.names, ctx.dt, ctx.frame_skip, ctx.scene)
    return *gradients, None, None, None, None, None, None


_rollout.register_autograd(_backward_of_rollout, setup_context=_setup_rollout)

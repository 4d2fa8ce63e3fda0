"""Differentiable equilibria and motions in PyTorch, in both modes, under ``torch.func`` and ``torch.compile``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor

from tdcr._arrays import as_count, as_number
from tdcr._differentiable import check_parameters, own_base, own_poses, scene_text
from tdcr.errors import InputError
from tdcr.robot import Robot, RobotLike, as_robot
from tdcr.scene import Scene
from tdcr.sensitivity import OnFailure, check_on_failure
from tdcr.torch import operators


def settle(
    robot: RobotLike,
    command: Tensor,
    payload: Tensor | float = 0.0,
    wrench: Tensor | None = None,
    *,
    line: Tensor | None = None,
    parameters: Sequence[str] = (),
    values: Tensor | None = None,
    scene: Scene | None = None,
    obstacle_positions: Tensor | None = None,
    obstacle_quaternions: Tensor | None = None,
    base_position: Tensor | None = None,
    base_quaternion: Tensor | None = None,
    on_failure: OnFailure = "raise",
) -> tuple[Tensor, Tensor]:
    """Settles rows of commands; gradients flow to the commands, the loads, the values of physical parameters, and the poses
    of obstacles and of the base.

    Computed in float64 on the processor, whatever the type of the tensors; results have the type of ``command``, and whole
    numbers count as ones of PyTorch's default type. It has first derivatives, in reverse and in forward mode; second ones are
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
        on_failure: What becomes of rows that do not settle: ``"raise"``, or ``"nan"``, which may be masked: they have no
            influence on gradients where the cost does not depend on them.

    Returns:
        Positions of the discs, shape (..., n, 3), world frame (m), and quaternions (w, x, y, z), shape (..., n, 4).

    Raises:
        InputError: For shapes and options that do not fit, and tensors on another device than the processor.
        ParameterError: For a parameter that the robot does not have, and for two that overlap.
        ContactError: As of :func:`tdcr.settle_batch`.
        NotSettledError: For a row that does not settle.
        SensitivityError: Where a derivative is differentiated.
    """
    robot = as_robot(robot)
    chosen: OnFailure = check_on_failure(on_failure)
    command = _floats(command, "command")
    values = None if values is None else _floats(values, "values", command.dtype)
    names = _names(robot, parameters, values)
    if command.ndim == 0 or command.shape[-1] != robot.tendons:
        raise InputError(f"command has shape {tuple(command.shape)}; expected (..., {robot.tendons})")
    leading, discs = command.shape[:-1], robot.discs
    arguments = (
        command,
        _rows(payload, "payload", command, leading, ()),
        _rows(wrench, "wrench", command, leading, (discs, 6)),
        # One row of values for each command: their gradients are summed by the adjoint of the expansion.
        _rows(values, "values", command, leading, (len(names),)),
        _poses(scene, obstacle_positions, obstacle_quaternions, command, leading),
        _base(robot, base_position, base_quaternion, command, leading),
        _rows(line, "line", command, leading, (3,)),
    )
    return operators.settle(arguments, robot.to_json(), names, chosen, scene_text(scene))


def rollout(
    robot: RobotLike,
    commands: Tensor,
    configuration: Tensor,
    velocity: Tensor | None = None,
    payload: Tensor | float = 0.0,
    wrench: Tensor | None = None,
    *,
    line: Tensor | None = None,
    parameters: Sequence[str] = (),
    values: Tensor | None = None,
    dt: float = 0.002,
    frame_skip: int = 1,
    scene: Scene | None = None,
    obstacle_positions: Tensor | None = None,
    obstacle_quaternions: Tensor | None = None,
    base_position: Tensor | None = None,
    base_quaternion: Tensor | None = None,
    on_failure: OnFailure = "raise",
) -> tuple[Tensor, Tensor, Tensor]:
    """Moves rows of robots by sequences of commands; gradients flow to the commands, the start, the loads, the values of physical
    parameters, and the poses of obstacles and of the base.

    Computed in float64 on the processor by the integrator ``"semi-implicit-euler"``; results have the type of ``commands``, as of
    :func:`settle`. It has first derivatives, in reverse and in forward mode; a forward one takes as long as a reverse one for
    each rate of a joint: see :func:`tdcr.rollout_jvp`.

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
        on_failure: What becomes of rows that diverge, as of :func:`settle`.

    Returns:
        After each command the positions of the discs, shape (..., T, n, 3), world frame (m); quaternions (w, x, y, z), shape
        (..., T, n, 4); and rates of the joints, shape (..., T, n, 3) (rad/s).

    Raises:
        InputError: For shapes and options that do not fit, and tensors on another device than the processor.
        ParameterError: For a parameter that the robot does not have, and for two that overlap.
        DynamicsError: For a row that diverges.
        ContactError: As of :func:`tdcr.rollout`.
        SensitivityError: Where a derivative is differentiated.
    """
    robot = as_robot(robot)
    chosen: OnFailure = check_on_failure(on_failure)
    commands = _floats(commands, "commands")
    values = None if values is None else _floats(values, "values", commands.dtype)
    names = _names(robot, parameters, values)
    if commands.ndim < 2 or commands.shape[-1] != robot.tendons:
        raise InputError(f"commands has shape {tuple(commands.shape)}; expected (..., T, {robot.tendons})")
    leading, discs = commands.shape[:-2], robot.discs
    of_wrench = (commands.shape[-2], discs, 6) if wrench is not None and wrench.ndim > commands.ndim else (discs, 6)
    arguments = (
        commands,
        _rows(configuration, "configuration", commands, leading, (discs, 4)),
        _rows(velocity, "velocity", commands, leading, (discs, 3)),
        _rows(payload, "payload", commands, leading, ()),
        _rows(wrench, "wrench", commands, leading, of_wrench),
        _rows(values, "values", commands, leading, (len(names),)),
        _poses(scene, obstacle_positions, obstacle_quaternions, commands, leading),
        _base(robot, base_position, base_quaternion, commands, leading),
        _rows(line, "line", commands, leading, (3,)),
    )
    steps = as_number(dt, "dt"), as_count(frame_skip, "frame_skip", 1)
    return operators.rollout(arguments, robot.to_json(), names, steps, chosen, scene_text(scene))


def _names(robot: Robot, parameters: Sequence[str], values: Tensor | None) -> tuple[str, ...]:
    names = check_parameters(parameters, values)
    if names and not torch.compiler.is_compiling():
        # Where operators are traced, they check it when they run.
        robot.check_parameters(names)
    return names


def _rows(value: Any, name: str, like: Tensor, leading: torch.Size, shape: Sequence[int]) -> Tensor:
    """An argument as a tensor with these leading axes; zeros where it is not given."""
    if value is None:
        value = like.new_zeros(tuple(shape))
    tensor = _floats(value, name, like.dtype, like.device)
    try:
        return tensor.expand((*leading, *shape))
    except RuntimeError:
        expected = tuple(leading) + tuple(shape)
        raise InputError(f"{name} has shape {tuple(tensor.shape)}; expected {expected}, or {tuple(shape)} for all rows") from None


def _poses(scene: Scene | None, positions: Any, quaternions: Any, like: Tensor, leading: torch.Size) -> Tensor:
    """Poses of obstacles, shape (..., m, 7), the scene's own where only positions or quaternions are given; of none where neither
    is."""
    places, turns = _known(_own_poses, scene_text(scene), positions is not None or quaternions is not None)
    return torch.cat(
        [
            _rows(places if positions is None else positions, "obstacle_positions", like, leading, places.shape),
            _rows(turns if quaternions is None else quaternions, "obstacle_quaternions", like, leading, turns.shape),
        ],
        dim=-1,
    )


def _base(robot: Robot, position: Any, quaternion: Any, like: Tensor, leading: torch.Size) -> Tensor:
    """Pose of the base, shape (..., 1, 7), the robot's own where only position or quaternion is given; of none, shape
    (..., 0, 7), where neither is."""
    if position is None and quaternion is None:
        return like.new_zeros((*leading, 0, 7))
    place, turn = _known(_own_base, robot.to_json())
    pose = (
        _rows(place if position is None else position, "base_position", like, leading, (3,)),
        _rows(turn if quaternion is None else quaternion, "base_quaternion", like, leading, (4,)),
    )
    return torch.cat(pose, dim=-1).unsqueeze(-2)


def _known(function: Callable[..., tuple[Tensor, Tensor]], *arguments: Any) -> tuple[Tensor, Tensor]:
    """What the function returns of no tensors; where operators are traced, it is a constant of theirs."""
    if torch.compiler.is_compiling():
        from tdcr.torch import _traced

        return _traced.constant(function, *arguments)  # type: ignore[no-any-return]
    return function(*arguments)


def _own_base(robot: str) -> tuple[Tensor, Tensor]:
    """Position and quaternion of the robot's own base."""
    position, quaternion = own_base(robot)
    return torch.from_numpy(position), torch.from_numpy(quaternion)


def _own_poses(scene: str, asked: bool) -> tuple[Tensor, Tensor]:
    """Positions and quaternions of the scene's own."""
    positions, quaternions = own_poses(scene, asked)
    return torch.from_numpy(positions), torch.from_numpy(quaternions)


def _floats(value: Any, name: str, dtype: torch.dtype | None = None, device: torch.device | None = None) -> Tensor:
    """A tensor of floating-point numbers in the processor's memory: whole numbers become ones of ``dtype``."""
    tensor: Tensor = value if isinstance(value, Tensor) else torch.as_tensor(value, dtype=dtype, device=device)
    if tensor.device.type != "cpu":
        raise InputError(f"{name} is on {tensor.device}; expected a tensor in the processor's memory: `{name}.cpu()`")
    if tensor.is_complex() or tensor.dtype == torch.bool:
        raise InputError(f"{name} has entries of type {tensor.dtype}; expected real numbers")
    if tensor.is_floating_point():
        return tensor
    return tensor.to(torch.get_default_dtype() if dtype is None else dtype)

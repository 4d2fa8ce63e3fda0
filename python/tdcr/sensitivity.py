"""Derivatives of equilibria by commands, loads and physical parameters, exact by the implicit function theorem.

Parameters have names; those of a robot are listed by :func:`tdcr.parameters`. Numbers count from 0:

- of tendons: ``"command[0]"`` (m or N), ``"gain[0]"``, ``"axial_stiffness[0]"`` (N/m);
- of modules: ``"bending[1].x"``, ``"torsion[1]"`` (N m/rad), ``"density[1]"`` (kg/m³), ``"youngs[1]"`` (Pa), ``"pitch[1]"`` (m);
- of discs: ``"force[9].x"`` (N) and ``"moment[9].z"`` (N m), world frame;
- of holes, by the base or a **disc** of a module, all of whose discs have the same: ``"hole_radius[base]"``,
  ``"hole_radius[5]"``, ``"hole[5][0].x"`` (m);
- ``"payload"`` (kg), on the last disc.

Two that stand for the same numbers, such as ``"hole_radius[0]"`` and ``"hole_radius[3]"`` where discs 0 and 3 are of one module,
are refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, get_args

import numpy as np

from tdcr import _tdcr
from tdcr._arrays import Floats, as_choice, as_float, as_texts
from tdcr.loads import Loads
from tdcr.robot import RobotLike
from tdcr.scene import Scene
from tdcr.statics import Rows

OnFailure = Literal["raise", "nan"]
"""What becomes of a row that has not settled: an exception, or derivatives that are not numbers."""


def jacobian(
    robot: RobotLike | Sequence[RobotLike],
    commands: Any,
    parameters: Sequence[str] | None = None,
    payload: Any = None,
    *,
    wrench: Any = None,
    loads: Loads | Sequence[Loads] | None = None,
    scene: Scene | Sequence[Scene] | None = None,
    on_failure: OnFailure = "raise",
) -> Floats:
    """Jacobian of all disc poses by parameters; by the command where none are given.

    Args:
        robot: One robot, or one for each row.
        commands: Shape (rows, tendons) (m or N), or (tendons,).
        parameters: Names of ``p`` parameters.
        payload, wrench, loads, scene: As of :func:`tdcr.settle_batch`. Where a contact is weak, derivatives differ from one side
            to the other, and these are in between.
        on_failure: What becomes of a row without derivatives.

    Returns:
        Shape (rows, n, 6, p), without the first axis for a single command: of each disc the change of its origin (m) and its
        rotation vector (rad), world frame, for each unit of a parameter.

    Raises:
        SensitivityError: For a row that has not settled, or whose equilibrium is on the brink of instability.
        ParameterError: For a parameter that the robot does not have, and for two that overlap.
    """
    rows = Rows.of(robot, commands, payload, wrench, loads, scene)
    names = command_names(rows.commands.shape[1]) if parameters is None else as_texts(parameters, "parameters")
    flat = _tdcr.jacobian_rows(rows.argument(), names, raises(on_failure), rows.maybe_scenes())
    by_disc = flat.reshape(len(flat), rows.robots[0].discs, 6, len(names))
    return by_disc[0] if np.ndim(commands) == 1 else by_disc


def jvp(
    robot: RobotLike | Sequence[RobotLike],
    commands: Any,
    parameters: Sequence[str],
    rates: Any,
    payload: Any = None,
    *,
    wrench: Any = None,
    loads: Loads | Sequence[Loads] | None = None,
    scene: Scene | Sequence[Scene] | None = None,
    on_failure: OnFailure = "raise",
) -> tuple[Floats, Floats]:
    """Change of the disc poses when parameters change together.

    Args:
        robot, commands, payload, wrench, loads, scene, on_failure: As of :func:`jacobian`, with rows of commands.
        parameters: Names of ``p`` parameters.
        rates: How fast each changes, shape (rows, p), or (p,) for all rows.

    Returns:
        Change of the positions, shape (rows, n, 3) (m), and of the quaternions (w, x, y, z), shape (rows, n, 4).
    """
    rows = Rows.of(robot, commands, payload, wrench, loads, scene)
    names = as_texts(parameters, "parameters")
    shape = (len(rows.commands), len(names))
    rates = as_float(rates, "rates", shape[1:] if np.ndim(rates) == 1 else shape)
    rates = np.ascontiguousarray(np.broadcast_to(rates, shape))
    change = _tdcr.jvp_rows(rows.argument(), names, rates, raises(on_failure), rows.maybe_scenes())
    return change[..., :3], change[..., 3:]


def vjp(
    robot: RobotLike | Sequence[RobotLike],
    commands: Any,
    parameters: Sequence[str],
    by_positions: Any,
    by_quaternions: Any = None,
    payload: Any = None,
    *,
    wrench: Any = None,
    loads: Loads | Sequence[Loads] | None = None,
    scene: Scene | Sequence[Scene] | None = None,
    on_failure: OnFailure = "raise",
) -> Floats:
    """Derivative of a cost by parameters, from its derivative by the disc poses: one linear solve a row for all parameters.

    Args:
        robot, commands, payload, wrench, loads, scene, on_failure: As of :func:`jacobian`, with rows of commands.
        parameters: Names of ``p`` parameters.
        by_positions: Derivative of the cost by the positions, shape (rows, n, 3).
        by_quaternions: Derivative by the quaternions (w, x, y, z), shape (rows, n, 4); zero where it is not given.

    Returns:
        Shape (rows, p).
    """
    rows = Rows.of(robot, commands, payload, wrench, loads, scene)
    cotangents = cotangents_of(rows, by_positions, by_quaternions)
    return _tdcr.vjp_rows(
        rows.argument(), as_texts(parameters, "parameters"), cotangents, raises(on_failure), rows.maybe_scenes()
    )


def cotangents_of(rows: Rows, by_positions: Any, by_quaternions: Any) -> Floats:
    """Derivatives by positions and, where they are given, quaternions, as the native functions take them: shape (rows, n, 7)."""
    shape = (len(rows.commands), rows.robots[0].discs)
    cotangents = np.zeros((*shape, 7))
    cotangents[..., :3] = as_float(by_positions, "by_positions", (*shape, 3))
    if by_quaternions is not None:
        cotangents[..., 3:] = as_float(by_quaternions, "by_quaternions", (*shape, 4))
    return cotangents


def command_names(tendons: int) -> list[str]:
    """Names of the entries of a command as parameters."""
    return [f"command[{tendon}]" for tendon in range(tendons)]


def check_on_failure(on_failure: OnFailure) -> OnFailure:
    """What becomes of a row that has not settled, if that is one of the choices."""
    as_choice(on_failure, "on_failure", get_args(OnFailure))
    return on_failure


def raises(on_failure: OnFailure) -> bool:
    """Whether a row without derivatives is an exception."""
    return check_on_failure(on_failure) == "raise"

"""Derivatives of equilibria by what is around the robot: obstacles, and the motion of its base.

A motion is a displacement of an origin (m) and a rotation about it (rad), world axes: 6 numbers. That of an obstacle is about the
origin of its frame, that of the base about the base's origin. The command stays: tendons move with the base.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tdcr import _tdcr
from tdcr._arrays import Floats
from tdcr._results import Batch
from tdcr.loads import Loads
from tdcr.robot import RobotLike
from tdcr.scene import Scene, nothing
from tdcr.sensitivity import OnFailure, cotangents_of, raises
from tdcr.statics import Rows


@dataclass(frozen=True, eq=False, repr=False)
class SceneGradients(Batch):
    """Derivatives of the costs of rows by what is around their robots, of ``m`` obstacles.

    Attributes:
        base: By the motion of the base, shape (rows, 6).
        obstacles: By the motion of each obstacle, shape (rows, m, 6).
        compliance: By the compliance of each obstacle (m/N), shape (rows, m).
    """

    base: Floats
    obstacles: Floats
    compliance: Floats

    _by_rows = ("base", "obstacles", "compliance")

    def __len__(self) -> int:
        return len(self.base)


def scene_vjp(
    robot: RobotLike | Sequence[RobotLike],
    commands: Any,
    by_positions: Any,
    by_quaternions: Any = None,
    payload: Any = None,
    *,
    scene: Scene | Sequence[Scene],
    wrench: Any = None,
    loads: Loads | Sequence[Loads] | None = None,
    on_failure: OnFailure = "raise",
) -> SceneGradients:
    """Derivative of a cost by the motions and compliances of all obstacles and the motion of the base, from its derivative by the
    disc poses: one linear solve a row.

    Args:
        robot, commands, payload, wrench, loads, on_failure: As of :func:`tdcr.jacobian`, with rows of commands.
        by_positions: Derivative of the cost by the positions, shape (rows, n, 3).
        by_quaternions: Derivative by the quaternions (w, x, y, z), shape (rows, n, 4); zero where it is not given.
        scene: The obstacles: one scene, or one for each row.

    Raises:
        SensitivityError: For a row that has not settled, or whose equilibrium is on the brink of instability.
        ContactError: As of :func:`tdcr.settle`.
    """
    rows = Rows.of(robot, commands, payload, wrench, loads, scene)
    cotangents = cotangents_of(rows, by_positions, by_quaternions)
    flat = _tdcr.scene_vjp_rows(rows.argument(), rows.native_scenes(), cotangents, raises(on_failure))
    by_obstacle = flat[:, 6:].reshape(len(flat), len(rows.scenes_given()[0]), 7)
    base, obstacles, compliance = flat[:, :6], by_obstacle[..., :6], by_obstacle[..., 6]
    return SceneGradients(*(np.ascontiguousarray(part) for part in (base, obstacles, compliance)))


def obstacle_jacobian(
    robot: RobotLike | Sequence[RobotLike],
    commands: Any,
    obstacle: str | int,
    payload: Any = None,
    *,
    scene: Scene | Sequence[Scene],
    wrench: Any = None,
    loads: Loads | Sequence[Loads] | None = None,
    on_failure: OnFailure = "raise",
) -> Floats:
    """Jacobian of all disc poses by the motion of an obstacle and its compliance.

    Args:
        robot, commands, payload, wrench, loads, on_failure: As of :func:`tdcr.jacobian`.
        obstacle: Its name or number.
        scene: The obstacles: one scene, or one for each row.

    Returns:
        Shape (rows, n, 6, 7), without the first axis for a single command: of each disc the change of its origin (m) and its
        rotation vector (rad), world frame, by the 6 numbers of the motion and by the compliance (m/N).

    Raises:
        SceneError: If there is no such obstacle.
        SensitivityError, ContactError: As of :func:`scene_vjp`.
    """
    rows = Rows.of(robot, commands, payload, wrench, loads, scene)
    number = rows.scenes_given()[0].find(obstacle)
    flat = _tdcr.obstacle_jacobian_rows(rows.argument(), rows.native_scenes(), number, raises(on_failure))
    return _by_disc(flat, rows, commands)


def base_jacobian(
    robot: RobotLike | Sequence[RobotLike],
    commands: Any,
    payload: Any = None,
    *,
    scene: Scene | Sequence[Scene] | None = None,
    wrench: Any = None,
    loads: Loads | Sequence[Loads] | None = None,
    on_failure: OnFailure = "raise",
) -> Floats:
    """Jacobian of all disc poses by the motion of the robot's base, which obstacles and weights do not follow.

    Arguments as of :func:`obstacle_jacobian`; without a scene there are no obstacles.

    Returns:
        Shape (rows, n, 6, 6), without the first axis for a single command.
    """
    rows = Rows.of(robot, commands, payload, wrench, loads, nothing() if scene is None else scene)
    flat = _tdcr.base_jacobian_rows(rows.argument(), rows.native_scenes(), raises(on_failure))
    return _by_disc(flat, rows, commands)


def _by_disc(flat: Floats, rows: Rows, commands: Any) -> Floats:
    by_disc = flat.reshape(len(flat), rows.robots[0].discs, 6, flat.shape[-1])
    return by_disc[0] if np.ndim(commands) == 1 else by_disc

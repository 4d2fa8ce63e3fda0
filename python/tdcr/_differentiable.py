"""Equilibria, their tangents and adjoints on NumPy arrays with any leading axes: what :mod:`tdcr.torch` and :mod:`tdcr.jax`
share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tdcr._arrays import Floats, as_float, as_quaternions
from tdcr.errors import InputError, NotSettledError
from tdcr.loads import Loads
from tdcr.robot import Robot, robots_at
from tdcr.scene import Scene, as_scene, nothing
from tdcr.scene_gradient import base_jacobian, obstacle_jacobian, scene_vjp
from tdcr.sensitivity import OnFailure, command_names, jvp, vjp
from tdcr.statics import settle_batch


@lru_cache(maxsize=64)
def robot_of(text: str) -> Robot:
    """A robot from its JSON text; the robots of the last calls are kept."""
    return Robot.from_json(text)


@lru_cache(maxsize=64)
def scene_of(text: str) -> Scene | None:
    """A scene from its JSON text, none from an empty one; the scenes of the last calls are kept."""
    return Scene.from_json(text) if text else None


def scene_text(scene: Scene | None) -> str:
    """The text of a scene for :func:`scene_of`."""
    return "" if scene is None else as_scene(scene).to_json()


def own_poses(scene: str, asked: bool) -> tuple[Floats, Floats]:
    """Positions, shape (m, 3), and quaternions, shape (m, 4), of the obstacles whose poses are inputs: all, or none.

    Args:
        scene: The text of :func:`scene_text`.
        asked: Whether poses are inputs.
    """
    among = scene_of(scene)
    if asked and among is None:
        raise InputError("poses of obstacles are given without a scene; expected `scene`")
    obstacles = among.obstacles if asked and among is not None else ()
    count = len(obstacles)
    return (
        np.array([one.position for one in obstacles]).reshape(count, 3),
        np.array([one.orientation for one in obstacles]).reshape(count, 4),
    )


def own_base(robot: str) -> tuple[Floats, Floats]:
    """Position, shape (3,) (m), and quaternion (w, x, y, z), shape (4,), of the robot's own base, from the robot as JSON."""
    position, quaternion = robot_of(robot)._native.base()
    return np.array(position), np.array(quaternion)


def check_parameters(parameters: Sequence[str], values: Any) -> tuple[str, ...]:
    """Names of the parameters that ``values`` has on its last axis."""
    names = (parameters,) if isinstance(parameters, str) else tuple(parameters)
    count = 0 if values is None else (values.shape[-1] if values.ndim else -1)
    if count != len(names):
        shape = None if values is None else tuple(values.shape)
        raise InputError(f"values has shape {shape}; expected ({len(names)},) on its last axis, one for each of `parameters`")
    return names


SECOND = (
    "second derivatives of {} are asked for, which it does not have; expected first ones, in reverse or in forward mode: for "
    "second ones take differences of gradients"
)
"""Why a derivative of a derivative is refused."""


@dataclass(frozen=True)
class Problem:
    """Rows of commands, loads and values of parameters; made from arrays with the same leading axes."""

    robots: Robot | list[Robot]
    names: tuple[str, ...]
    leading: tuple[int, ...]
    commands: Floats
    payload: Floats
    wrench: Floats
    poses: Floats
    base: Floats
    line: Floats
    scene: Scene | None

    @classmethod
    def of(cls, text: str, scene: str, names: Sequence[str], *arguments: Any) -> Problem:
        """Reads a problem.

        Args:
            text: The robot as JSON.
            scene: The scene as JSON, or an empty text.
            names: Names of ``p`` parameters.
            arguments: Commands, shape (..., tendons) (m or N); payloads, shape (...) (kg); wrenches, shape (..., n, 6), world
                frame (N, N m); values of the parameters, shape (..., p), or (p,) for all rows; position (m) and quaternion
                (w, x, y, z) of each obstacle, shape (..., m, 7), of none, shape (..., 0, 7), where they are those of the scene;
                those of the base, shape (..., 1, 7), or (..., 0, 7) where they are the robot's own; and force for each length of
                the backbone, shape (..., 3), world frame (N/m).
        """
        command, payload, wrench, values, poses, base, line = (np.asarray(argument) for argument in arguments)
        robot, leading = robot_of(text), command.shape[:-1]
        bases = rows_of_poses(base, "base_quaternion", leading)
        return cls(
            robots_based(robots_of(robot, names, values, leading), bases),
            tuple(names),
            leading,
            as_rows(command, "command", leading, (robot.tendons,)),
            as_rows(payload, "payload", leading, ()),
            as_rows(wrench, "wrench", leading, (robot.discs, 6)),
            rows_of_poses(poses, "obstacle_quaternions", leading),
            bases,
            as_rows(line, "line", leading, (3,)),
            scene_of(scene),
        )

    def settle(self, on_failure: OnFailure) -> tuple[Floats, Floats]:
        """Positions, shape (..., n, 3), and quaternions (w, x, y, z), shape (..., n, 4), of the discs.

        Raises:
            NotSettledError: For a row that has not settled, with ``on_failure="raise"``; with ``"nan"`` it is not a number.
        """
        if len(self.commands) == 0:
            discs = self.wrench.shape[1]
            return np.zeros((*self.leading, discs, 3)), np.zeros((*self.leading, discs, 4))
        settled = settle_batch(
            self.robots,
            self.commands,
            self.payload,
            wrench=self.wrench,
            loads=line_loads(self.line),
            scene=self._scenes(slice(None)),
        )
        failed = np.flatnonzero(~settled.converged)
        if failed.size and on_failure == "raise":
            residual = settled.residual[failed[0]]
            raise NotSettledError(f"row {failed[0]}: the robot has not settled: residual {residual:.1e} N m")
        settled.positions[failed], settled.quaternions[failed] = np.nan, np.nan
        shape = settled.positions.shape[1:-1]
        return settled.positions.reshape(*self.leading, *shape, 3), settled.quaternions.reshape(*self.leading, *shape, 4)

    def adjoint(self, by_positions: Any, by_quaternions: Any, wanted: Sequence[bool]) -> list[Floats]:
        """Derivatives of a cost by the arguments that are wanted, from those by positions and quaternions.

        Returns:
            By all arguments of :meth:`of`, in their order and shapes; zeros where not wanted. Rows that have not settled have
            derivatives that are not numbers, unless the cost does not depend on them.
        """
        rows, discs = self.wrench.shape[:2]
        tendons = self.commands.shape[1]
        groups = self._groups()
        # A line load is a force on each disc.
        by = [wanted[0], wanted[1], wanted[2] or wanted[6], wanted[3]]
        chosen = [names if want else [] for names, want in zip(groups, by, strict=True)]
        by_positions = np.asarray(by_positions, dtype=np.float64).reshape(rows, discs, 3)
        by_quaternions = np.asarray(by_quaternions, dtype=np.float64).reshape(rows, discs, 4)
        counts = by_positions.any(axis=(1, 2)) | by_quaternions.any(axis=(1, 2))
        gradient = np.zeros((rows, sum(map(len, chosen))))
        if counts.any() and gradient.shape[1]:
            gradient[counts] = vjp(
                chosen_robots(self.robots, counts),
                self.commands[counts],
                sum(chosen, []),
                by_positions[counts],
                by_quaternions[counts],
                self.payload[counts],
                wrench=self.wrench[counts],
                loads=line_loads(self.line[counts]),
                scene=self._scenes(counts),
                on_failure="nan",
            )
        ends = np.cumsum([len(names) for names in chosen])[:-1]
        shapes = [(tendons,), (), (discs, 6), (len(self.names),)]
        split = np.split(gradient, ends, axis=1)
        by_line = np.zeros((rows, 3))
        if wanted[6]:
            by_line = line_cotangent(self.robots, split[2].reshape(rows, discs, 6))
        parts = zip(split, chosen, shapes, strict=True)
        by_poses, by_base = np.zeros(self.poses.shape), np.zeros(self.base.shape)
        if counts.any() and ((wanted[4] and self.poses.size) or (wanted[5] and self.base.size)):
            by_motions = scene_vjp(
                chosen_robots(self.robots, counts),
                self.commands[counts],
                by_positions[counts],
                by_quaternions[counts],
                self.payload[counts],
                scene=self._among(counts),
                wrench=self.wrench[counts],
                loads=line_loads(self.line[counts]),
                on_failure="nan",
            )
            if self.poses.size:
                by_poses[counts] = poses_cotangent(self.poses[counts], by_motions.obstacles)
            if self.base.size:
                by_base[counts] = poses_cotangent(self.base[counts], by_motions.base[:, None])
        return [
            *(
                part.reshape((*self.leading, *shape)) if names else np.zeros((*self.leading, *shape))
                for part, names, shape in parts
            ),
            by_poses.reshape((*self.leading, *self.poses.shape[1:])),
            by_base.reshape((*self.leading, *self.base.shape[1:])),
            by_line.reshape((*self.leading, 3)),
        ]

    def tangent(self, rates: Sequence[Any]) -> tuple[Floats, Floats]:
        """Change of positions and quaternions when all arguments of :meth:`of` change at ``rates``, of their shapes.

        Rows that have not settled have changes that are not numbers, unless nothing of them changes.
        """
        rows, discs = self.wrench.shape[:2]
        *rates, of_poses, of_base, of_line = rates
        of_line = np.asarray(of_line, dtype=np.float64).reshape(rows, 3)
        rates[2] = np.asarray(rates[2], dtype=np.float64).reshape(rows, discs, 6) + line_wrench(self.robots, of_line)
        flat = [np.asarray(rate, dtype=np.float64).reshape(rows, -1) if rows else np.zeros((0, 1)) for rate in rates]
        wanted = [bool(rate.any()) for rate in flat]
        positions, quaternions = np.zeros((rows, discs, 3)), np.zeros((rows, discs, 4))
        if any(wanted):
            names = sum((group for group, want in zip(self._groups(), wanted, strict=True) if want), [])
            by = np.concatenate([rate for rate, want in zip(flat, wanted, strict=True) if want], axis=1)
            counts: NDArray[np.bool_] = np.asarray(by.any(axis=1))
            positions[counts], quaternions[counts] = jvp(
                chosen_robots(self.robots, counts),
                self.commands[counts],
                names,
                by[counts],
                self.payload[counts],
                wrench=self.wrench[counts],
                loads=line_loads(self.line[counts]),
                scene=self._scenes(counts),
                on_failure="nan",
            )
        of_poses = np.asarray(of_poses, dtype=np.float64).reshape(self.poses.shape)
        of_base = np.asarray(of_base, dtype=np.float64).reshape(self.base.shape)
        moving: NDArray[np.bool_] = np.asarray(of_poses.any(axis=(1, 2)) | of_base.any(axis=(1, 2)))
        if moving.any():
            motions = motions_of(self.poses[moving], of_poses[moving]), motions_of(self.base[moving], of_base[moving])
            by_positions, by_quaternions = self._moved(moving, *motions)
            positions[moving] += by_positions
            quaternions[moving] += by_quaternions
        return positions.reshape(*self.leading, discs, 3), quaternions.reshape(*self.leading, discs, 4)

    def _moved(self, chosen: NDArray[np.bool_], obstacles: Floats, bases: Floats) -> tuple[Floats, Floats]:
        """Change of positions and quaternions of some rows when their obstacles move, shape (rows, m, 6), and their bases, shape
        (rows, 1, 6), or (rows, 0, 6) where these stay."""
        robots, scene, given = chosen_robots(self.robots, chosen), self._among(chosen), self.payload[chosen]
        commands, wrench, loads = self.commands[chosen], self.wrench[chosen], line_loads(self.line[chosen])
        change = np.zeros((len(commands), wrench.shape[1], 6))
        for obstacle in range(obstacles.shape[1]):
            jacobian = obstacle_jacobian(
                robots, commands, obstacle, given, scene=scene, wrench=wrench, loads=loads, on_failure="nan"
            )
            change += np.einsum("rnij,rj->rni", jacobian[..., :6], obstacles[:, obstacle])
        if bases.any():
            jacobian = base_jacobian(robots, commands, given, scene=scene, wrench=wrench, loads=loads, on_failure="nan")
            change += np.einsum("rnij,rj->rni", jacobian, bases[:, 0])
        turned = settle_batch(robots, commands, given, scene=scene, wrench=wrench, loads=loads).quaternions
        turning = np.concatenate([np.zeros((*change.shape[:2], 1)), change[..., 3:]], axis=-1)
        return change[..., :3], 0.5 * _product(turning, turned)

    def _among(self, chosen: Any) -> Scene | list[Scene]:
        """The scenes of some rows: one for all, or one for each."""
        return placed(self.scene if self.scene is not None else nothing(), self.poses[chosen])

    def _scenes(self, chosen: Any) -> Scene | list[Scene] | None:
        return None if self.scene is None else self._among(chosen)

    def _groups(self) -> list[list[str]]:
        """Names of the entries of each argument as parameters."""
        discs = self.wrench.shape[1]
        return [
            command_names(self.commands.shape[1]),
            ["payload"],
            [f"{kind}[{disc}].{axis}" for disc in range(discs) for kind in ("force", "moment") for axis in "xyz"],
            list(self.names),
        ]


def _product(a: Floats, b: Floats) -> Floats:
    """Products of quaternions (w, x, y, z) along the last axis."""
    scalar = a[..., :1] * b[..., :1] - (a[..., 1:] * b[..., 1:]).sum(axis=-1, keepdims=True)
    vector = a[..., :1] * b[..., 1:] + b[..., :1] * a[..., 1:] + np.cross(a[..., 1:], b[..., 1:])
    return np.concatenate([scalar, vector], axis=-1)


def motions_of(poses: Floats, rates: Floats) -> Floats:
    """Motions, shape (..., 6), of poses (..., 7) that change at ``rates``: of a quaternion ``p`` the vector part of
    ``2 p' p^-1``."""
    inverse = poses[..., 3:] * [1.0, -1.0, -1.0, -1.0] / (poses[..., 3:] ** 2).sum(axis=-1, keepdims=True)
    return np.concatenate([rates[..., :3], 2.0 * _product(rates[..., 3:], inverse)[..., 1:]], axis=-1)


def poses_cotangent(poses: Floats, by_motions: Floats) -> Floats:
    """The adjoint of :func:`motions_of`: from derivatives by motions to those by poses."""
    turning = np.concatenate([np.zeros((*by_motions.shape[:-1], 1)), by_motions[..., 3:]], axis=-1)
    unit = poses[..., 3:] / (poses[..., 3:] ** 2).sum(axis=-1, keepdims=True)
    return np.concatenate([by_motions[..., :3], 2.0 * _product(turning, unit)], axis=-1)


def line_loads(line: Floats) -> list[Loads] | None:
    """Loads along the backbone for each row, from forces for each length, shape (rows, 3); of none where all are 0."""
    return [Loads(line=tuple(row)) for row in line.tolist()] if line.any() else None


def _shares(robots: Robot | list[Robot]) -> Floats:
    """Length of the backbone that each disc bears the load of (m): half of that to each neighbour, shape (n,), or (rows, n)."""
    if isinstance(robots, list):
        return np.array([_shares(robot) for robot in robots])
    origins = np.vstack([robots._native.base()[0], robots.straight_positions])
    spans = np.linalg.norm(np.diff(origins, axis=0), axis=1)
    shares: Floats = 0.5 * (spans + np.append(spans[1:], 0.0))
    return shares


def line_wrench(robots: Robot | list[Robot], line: Floats) -> Floats:
    """Wrenches on the discs, shape (rows, n, 6), that loads along the backbone, shape (rows, 3), amount to."""
    forces = _shares(robots)[..., None] * line[:, None]
    return np.concatenate([forces, np.zeros_like(forces)], axis=-1)


def line_cotangent(robots: Robot | list[Robot], by_wrench: Floats) -> Floats:
    """The adjoint of :func:`line_wrench`."""
    gradient: Floats = (_shares(robots)[..., None] * by_wrench[..., :3]).sum(axis=-2)
    return gradient


def rows_of_poses(poses: Any, quaternions: str, leading: tuple[int, ...]) -> Floats:
    """Poses, shape (..., m, 7), with their leading axes as one; ``quaternions`` is what theirs are called in errors."""
    rows = as_rows(poses, "poses", leading, np.shape(poses)[-2:])
    as_quaternions(rows[..., 3:], quaternions, (*rows.shape[:2], 4))
    return rows


def placed(scene: Scene, poses: Floats) -> Scene | list[Scene]:
    """A scene with its obstacles at poses, shape (rows, m, 7): one for all rows, or one for each; without poses as it is."""
    if poses.shape[1] == 0:
        return scene
    if (poses == poses[:1]).all():
        return scene._placed(poses[0])
    return [scene._placed(of_row) for of_row in poses]


def as_rows(value: Any, name: str, leading: tuple[int, ...], shape: tuple[int, ...]) -> Floats:
    """An argument with its leading axes as one."""
    rows = int(np.prod(leading))
    array = np.asarray(value)
    if array.shape[array.ndim - len(shape) :] == shape:
        array = np.broadcast_to(array, (*leading, *shape)).reshape(rows, *shape)
    return as_float(array, name, (rows, *shape))


def robots_of(robot: Robot, names: Sequence[str], values: Any, leading: tuple[int, ...]) -> Robot | list[Robot]:
    """The robot with the values of parameters: one for all rows, or one for each."""
    values = np.asarray(values, dtype=np.float64)
    if not names:
        return robot
    if values.ndim == 1:
        return robot.with_values(dict(zip(names, values, strict=True)))
    rows = values.reshape(int(np.prod(leading)), len(names))
    if len(rows) and (rows == rows[0]).all():
        return robot.with_values(dict(zip(names, rows[0], strict=True)))
    return [robot.with_values(dict(zip(names, row, strict=True))) for row in rows]


def robots_based(robots: Robot | list[Robot], bases: Floats) -> Robot | list[Robot]:
    """Robots with their bases at poses, shape (rows, 1, 7); without poses, shape (rows, 0, 7), as they are."""
    if bases.size == 0:
        return robots
    placed = robots_at(robots if isinstance(robots, list) else [robots], bases[:, 0])
    return placed if len(placed) > 1 else placed[0]


def chosen_robots(robots: Robot | list[Robot], rows: NDArray[np.bool_]) -> Robot | list[Robot]:
    return [robots[row] for row in np.flatnonzero(rows)] if isinstance(robots, list) else robots

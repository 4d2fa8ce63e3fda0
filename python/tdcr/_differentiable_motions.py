"""Motions, their tangents and adjoints on NumPy arrays with any leading axes: what :mod:`tdcr.torch` and :mod:`tdcr.jax`
share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tdcr._arrays import Floats
from tdcr._differentiable import (
    as_rows,
    chosen_robots,
    line_cotangent,
    line_loads,
    line_wrench,
    motions_of,
    placed,
    poses_cotangent,
    robot_of,
    robots_based,
    robots_of,
    rows_of_poses,
    scene_of,
)
from tdcr.dynamics import State, rollout
from tdcr.dynamics_gradient import RolloutRates, rollout_jvp, rollout_vjp
from tdcr.errors import DynamicsError
from tdcr.robot import Robot
from tdcr.scene import Scene
from tdcr.sensitivity import OnFailure


@dataclass(frozen=True)
class MotionProblem:
    """Rows of motions; made from arrays with the same leading axes."""

    robots: Robot | list[Robot]
    names: tuple[str, ...]
    leading: tuple[int, ...]
    commands: Floats
    start: State
    payload: Floats
    wrench: Floats
    poses: Floats
    base: Floats
    line: Floats
    scene: Scene | None
    dt: float
    frame_skip: int

    @classmethod
    def of(cls, text: str, scene: str, names: Sequence[str], dt: float, frame_skip: int, *arguments: Any) -> MotionProblem:
        """Reads a problem.

        Args:
            text: The robot as JSON.
            scene: What it moves among: the text of :func:`scene_text`.
            names: Names of ``p`` parameters.
            dt: Time step (s).
            frame_skip: Time steps for which each command holds.
            arguments: Commands, shape (..., T, tendons); configuration and velocity of the start, shapes (..., n, 4) and
                (..., n, 3); payload, wrench, values, poses of obstacles and of the base and line load as of :meth:`Problem.of`, a
                wrench for each command of shape (..., T, n, 6) as well.
        """
        *given, payload, wrench, values, poses, base, line = (np.asarray(argument) for argument in arguments)
        commands, configuration, velocity = given
        robot, leading, discs = robot_of(text), commands.shape[:-2], robot_of(text).discs
        start = State(
            as_rows(configuration, "configuration", leading, (discs, 4)), as_rows(velocity, "velocity", leading, (discs, 3))
        )
        of_wrench = (commands.shape[-2], discs, 6) if wrench.ndim > commands.ndim else (discs, 6)
        bases = rows_of_poses(base, "base_quaternion", leading)
        return cls(
            robots_based(robots_of(robot, names, values, leading), bases),
            tuple(names),
            leading,
            as_rows(commands, "commands", leading, (commands.shape[-2], robot.tendons)),
            start,
            as_rows(payload, "payload", leading, ()),
            as_rows(wrench, "wrench", leading, of_wrench),
            rows_of_poses(poses, "obstacle_quaternions", leading),
            bases,
            as_rows(line, "line", leading, (3,)),
            scene_of(scene),
            dt,
            frame_skip,
        )

    def roll_out(self, on_failure: OnFailure) -> tuple[Floats, Floats, Floats]:
        """Positions (..., T, n, 3), quaternions (..., T, n, 4) and rates of the joints (..., T, n, 3) after each command.

        Raises:
            DynamicsError: For a row that diverges, with ``on_failure="raise"``; with ``"nan"`` it is not a number.
        """
        rows, steps, discs = *self.commands.shape[:2], self.wrench.shape[-2]
        shapes = [(*self.leading, steps, discs, width) for width in (3, 4, 3)]
        if rows == 0:
            empty = [np.zeros(shape) for shape in shapes]
            return empty[0], empty[1], empty[2]
        motions = rollout(
            self.robots,
            self.commands,
            self.payload,
            wrench=self.wrench,
            loads=line_loads(self.line),
            start=self.start,
            dt=self.dt,
            frame_skip=self.frame_skip,
            scene=self._scenes(slice(None)),
        )
        for row, why in motions.failures.items():
            if on_failure == "raise":
                raise DynamicsError(f"row {row}: {why}")
            for array in (motions.positions, motions.quaternions, motions.velocity):
                array[row] = np.nan
        found = (motions.positions, motions.quaternions, motions.velocity)
        positions, quaternions, velocity = (array.reshape(shape) for array, shape in zip(found, shapes, strict=True))
        return positions, quaternions, velocity

    def adjoint(self, by_positions: Any, by_quaternions: Any, by_velocity: Any) -> list[Floats]:
        """Derivatives of a cost from those by the states: by all arguments of :meth:`of`, in their order and shapes.

        Rows that diverge have derivatives that are not numbers, unless the cost does not depend on them.
        """
        rows, steps, discs = *self.commands.shape[:2], self.wrench.shape[-2]
        by_states = [
            np.asarray(by, dtype=np.float64).reshape(rows, steps, discs, width)
            for by, width in ((by_positions, 3), (by_quaternions, 4), (by_velocity, 3))
        ]
        *gradients, by_poses, by_base, by_line = (np.zeros((rows, *shape)) for shape in self._shapes())
        counts = np.any([by.any(axis=(1, 2, 3)) for by in by_states], axis=0)
        if counts.any():
            found = rollout_vjp(
                chosen_robots(self.robots, counts),
                self.commands[counts],
                by_states[0][counts],
                by_states[1][counts],
                by_states[2][counts],
                self.payload[counts],
                parameters=self.names,
                wrench=self.wrench[counts],
                loads=line_loads(self.line[counts]),
                start=State(self.start.configuration[counts], self.start.velocity[counts]),
                dt=self.dt,
                frame_skip=self.frame_skip,
                scene=self._scenes(counts),
            )
            parts = found.commands, found.configuration, found.velocity, found.payload, found.wrench, found.parameters
            for gradient, part in zip(gradients, parts, strict=True):
                gradient[counts] = part
            if self.poses.size:
                by_poses[counts] = poses_cotangent(self.poses[counts], found.obstacles)
            if self.base.size:
                by_base[counts] = poses_cotangent(self.base[counts], found.base[:, None])
            by_wrench = found.wrench.sum(axis=1) if found.wrench.ndim == 4 else found.wrench
            by_line[counts] = line_cotangent(chosen_robots(self.robots, counts), by_wrench)
        return [gradient.reshape((*self.leading, *gradient.shape[1:])) for gradient in (*gradients, by_poses, by_base, by_line)]

    def tangent(self, rates: Sequence[Any]) -> tuple[Floats, Floats, Floats]:
        """Change of positions, quaternions and rates of the joints when all arguments of :meth:`of` change at ``rates``, of
        their shapes.

        Rows that diverge have changes that are not numbers, unless nothing of them changes.
        """
        rows, steps, discs = *self.commands.shape[:2], self.wrench.shape[-2]
        given = zip(rates, self._shapes(), strict=True)
        by = [np.asarray(rate, dtype=np.float64).reshape(rows, *shape) for rate, shape in given]
        changes = [np.zeros((rows, steps, discs, width)) for width in (3, 4, 3)]
        counts = np.zeros(rows, dtype=np.bool_)
        for rate in by:
            counts |= rate.reshape(rows, int(np.prod(rate.shape[1:]))).any(axis=1)
        if counts.any():
            *others, of_poses, of_base, of_line = (rate[counts] for rate in by)
            along = line_wrench(chosen_robots(self.robots, counts), of_line)
            others[4] = others[4] + (along[:, None] if others[4].ndim == 4 else along)
            moving = motions_of(self.poses[counts], of_poses) if of_poses.size else None
            based = motions_of(self.base[counts], of_base)[:, 0] if of_base.size else None
            found = rollout_jvp(
                chosen_robots(self.robots, counts),
                self.commands[counts],
                RolloutRates(*others)._replace(obstacles=moving, base=based),
                self.payload[counts],
                parameters=self.names,
                wrench=self.wrench[counts],
                loads=line_loads(self.line[counts]),
                start=State(self.start.configuration[counts], self.start.velocity[counts]),
                dt=self.dt,
                frame_skip=self.frame_skip,
                scene=self._scenes(counts),
            )
            for change, part in zip(changes, (found.positions, found.quaternions, found.velocity), strict=True):
                change[counts] = part
        positions, quaternions, velocity = (change.reshape(*self.leading, *change.shape[1:]) for change in changes)
        return positions, quaternions, velocity

    def _shapes(self) -> list[tuple[int, ...]]:
        """Shapes of a row of what motions are differentiated by, in the order of :meth:`of`: commands, start, payload, wrench,
        values, poses of obstacles and of the base, line load."""
        discs = self.wrench.shape[-2]
        start = (discs, 4), (discs, 3)
        poses = self.poses.shape[1:], self.base.shape[1:]
        return [self.commands.shape[1:], *start, (), self.wrench.shape[1:], (len(self.names),), *poses, (3,)]

    def _scenes(self, chosen: Any) -> Scene | list[Scene] | None:
        """The scenes of some rows: one for all, or one for each."""
        return None if self.scene is None else placed(self.scene, self.poses[chosen])

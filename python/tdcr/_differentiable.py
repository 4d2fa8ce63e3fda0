"""Settling and its adjoint on NumPy arrays with any leading axes: what :mod:`tdcr.torch` and :mod:`tdcr.jax` share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from tdcr._arrays import Floats, as_float
from tdcr.errors import InputError, NotSettledError
from tdcr.robot import Robot
from tdcr.sensitivity import OnFailure, command_names, vjp
from tdcr.statics import settle_batch

ARGUMENTS = ("command", "payload", "wrench", "values")
"""What can be differentiated by, in the order of gradients."""


@lru_cache(maxsize=64)
def robot_of(text: str) -> Robot:
    """A robot from its JSON text; the robots of the last calls are kept."""
    return Robot.from_json(text)


def check_parameters(parameters: Sequence[str], values: Any) -> tuple[str, ...]:
    """Names of the parameters that ``values`` has on its last axis."""
    names = tuple(parameters)
    count = 0 if values is None else (values.shape[-1] if values.ndim else -1)
    if count != len(names):
        shape = None if values is None else tuple(values.shape)
        raise InputError(f"values has shape {shape}; expected ({len(names)},) on its last axis, one for each of `parameters`")
    return names


@dataclass(frozen=True)
class Problem:
    """Rows of commands, loads and values of parameters; made from arrays with the same leading axes."""

    robots: Robot | list[Robot]
    names: tuple[str, ...]
    leading: tuple[int, ...]
    commands: Floats
    payload: Floats
    wrench: Floats

    @classmethod
    def of(cls, text: str, names: Sequence[str], command: Any, payload: Any, wrench: Any, values: Any) -> Problem:
        """Reads a problem.

        Args:
            text: The robot as JSON.
            names: Names of ``p`` parameters.
            command: Shape (..., tendons) (m or N).
            payload: Shape (...) (kg).
            wrench: Shape (..., n, 6), world frame (N, N m).
            values: Values of the parameters, shape (..., p), or (p,) for all rows.
        """
        robot = robot_of(text)
        command = np.asarray(command)
        leading = command.shape[:-1]
        rows = int(np.prod(leading))
        commands = as_float(command.reshape(rows, -1), "command", (rows, robot.tendons))
        payload = as_float(np.broadcast_to(payload, leading).reshape(rows), "payload", (rows,))
        wrench = np.broadcast_to(wrench, (*leading, robot.discs, 6))
        wrench = as_float(wrench.reshape(rows, robot.discs, 6), "wrench", (rows, robot.discs, 6))
        values = np.asarray(values, dtype=np.float64)
        robots: Robot | list[Robot] = robot
        if names and values.ndim == 1:
            robots = robot.with_values(dict(zip(names, values, strict=True)))
        elif names:
            robots = [robot.with_values(dict(zip(names, row, strict=True))) for row in values.reshape(rows, -1)]
        return cls(robots, tuple(names), leading, commands, payload, wrench)

    def settle(self, on_failure: OnFailure) -> tuple[Floats, Floats]:
        """Positions, shape (..., n, 3), and quaternions (w, x, y, z), shape (..., n, 4), of the discs.

        Raises:
            NotSettledError: For a row that has not settled, with ``on_failure="raise"``; with ``"nan"`` it is not a number.
        """
        if len(self.commands) == 0:
            discs = self.wrench.shape[1]
            return np.zeros((*self.leading, discs, 3)), np.zeros((*self.leading, discs, 4))
        settled = settle_batch(self.robots, self.commands, self.payload, wrench=self.wrench)
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
            By command (..., tendons), payload (...), wrench (..., n, 6) and values (..., p); zeros where not wanted. Rows that
            have not settled have derivatives that are not numbers, unless the cost does not depend on them.
        """
        rows, discs = self.wrench.shape[:2]
        tendons = self.commands.shape[1]
        groups = [
            command_names(tendons),
            ["payload"],
            [f"{kind}[{disc}].{axis}" for disc in range(discs) for kind in ("force", "moment") for axis in "xyz"],
            list(self.names),
        ]
        chosen = [names if want else [] for names, want in zip(groups, wanted, strict=True)]
        by_positions = np.asarray(by_positions, dtype=np.float64).reshape(rows, discs, 3)
        by_quaternions = np.asarray(by_quaternions, dtype=np.float64).reshape(rows, discs, 4)
        counts = by_positions.any(axis=(1, 2)) | by_quaternions.any(axis=(1, 2))
        gradient = np.zeros((rows, sum(map(len, chosen))))
        if counts.any() and gradient.shape[1]:
            gradient[counts] = vjp(
                [self.robots[row] for row in np.flatnonzero(counts)] if isinstance(self.robots, list) else self.robots,
                self.commands[counts],
                sum(chosen, []),
                by_positions[counts],
                by_quaternions[counts],
                self.payload[counts],
                wrench=self.wrench[counts],
                on_failure="nan",
            )
        ends = np.cumsum([len(names) for names in chosen])[:-1]
        shapes = [(tendons,), (), (discs, 6), (len(self.names),)]
        parts = zip(np.split(gradient, ends, axis=1), chosen, shapes, strict=True)
        return [
            part.reshape((*self.leading, *shape)) if names else np.zeros((*self.leading, *shape))
            for part, names, shape in parts
        ]

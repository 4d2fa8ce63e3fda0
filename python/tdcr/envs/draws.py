"""What is drawn at each reset: values of parameters, and what disturbs an episode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tdcr import _tdcr
from tdcr._arrays import Floats, as_number
from tdcr.errors import InputError
from tdcr.robot import Robot

Ranges = dict[str, tuple[float, float]]
"""Ends of what is drawn, by name."""

DISTURBANCES = ("payload", "disturbance", "noise", "delay")
"""Names of ``randomise`` that are no parameters of a robot."""

HOLD = 10
"""Steps for which a disturbance keeps its direction."""


class Draws:
    """Ranges that each reset draws from, and what it drew for each of ``count`` rows.

    Attributes:
        ranges: Ends (low, high) by name.
        own: Names that belong to no robot: :data:`DISTURBANCES`, and those of the task.
        values: What was drawn last of those, by name, shape (count,); 0 before.
    """

    def __init__(self, count: int, robot: Robot, randomise: Mapping[str, tuple[float, float]], of_task: Sequence[str]) -> None:
        self._robot = robot
        self.own = tuple(dict.fromkeys((*DISTURBANCES, *of_task)))
        self.ranges: Ranges = {}
        self.values: dict[str, Floats] = {name: np.zeros(count) for name in self.own}
        self._seeds: NDArray[np.uint64] = np.zeros(count, dtype=np.uint64)
        self.change(randomise)

    def change(self, randomise: Mapping[str, tuple[float, float]]) -> None:
        """Other ranges, from the next reset on; those of other names stay.

        Raises:
            InputError: For ends that make no range, and values that the name cannot have.
            ParameterError: For names that the robot and the task do not have.
        """
        if not isinstance(randomise, Mapping):
            raise InputError(f"randomise is {randomise!r}; expected a dictionary from names to (low, high)")
        checked = {name: self._checked(name, ends) for name, ends in randomise.items()}
        ranges = self.ranges | checked
        self._robot.check_parameters([name for name in ranges if name not in self.own])
        self.ranges = ranges

    def _checked(self, name: str, ends: tuple[float, float]) -> tuple[float, float]:
        try:
            low, high = (as_number(end, f"randomise[{name!r}]") for end in ends)
        except (TypeError, ValueError) as error:
            raise InputError(f"randomise[{name!r}] is {ends!r}; expected (low, high): {error}") from None
        if not low <= high:
            raise InputError(f"randomise[{name!r}] is ({low}, {high}); expected low <= high")
        least = 0.0 if name in self.own else _tdcr.parameter_bounds(name)[0]
        if low < least:
            raise InputError(f"randomise[{name!r}] is ({low}, {high}); expected values of {least:g} or more")
        if name == "delay" and not (low.is_integer() and high.is_integer() and high <= 1000.0):
            raise InputError(f"randomise['delay'] is ({low}, {high}); expected whole numbers of steps, 1000 at most")
        if name not in self.own:
            for end in (low, high):
                self._robot.with_values({name: end})
        return low, high

    def draw(self, row: int, rng: np.random.Generator) -> dict[str, float]:
        """Draws anew for a row, from its generator alone; returns the values of its robot's parameters."""
        values = {name: _drawn(name, ends, rng) for name, ends in self.ranges.items()}
        for name in self.own:
            self.values[name][row] = values.pop(name, 0.0)
        if "noise" in self.ranges or "disturbance" in self.ranges:
            self._seeds[row] = rng.integers(2**63)
        return values

    @property
    def longest_delay(self) -> int:
        """Of the range of delays, in steps."""
        return int(self.ranges.get("delay", (0.0, 0.0))[1])

    def forces(self, steps: NDArray[np.int64]) -> Floats | None:
        """Forces that disturb the rows in the step after ``steps``, shape (count, 3) (N); ``None`` where there are none."""
        sizes = self.values["disturbance"]
        if not sizes.any():
            return None
        forces = np.zeros((len(sizes), 3))
        for row in np.flatnonzero(sizes):
            direction = self._stream(int(row), 0, int(steps[row]) // HOLD).standard_normal(3)
            forces[row] = sizes[row] * direction / np.linalg.norm(direction)
        return forces

    def add_noise(self, observed: NDArray[np.float32], steps: NDArray[np.int64]) -> None:
        """Adds what the rows see wrongly after ``steps``, in place: normal deviates of each entry."""
        sizes = self.values["noise"]
        for row in np.flatnonzero(sizes):
            noise = self._stream(int(row), 1, int(steps[row])).standard_normal(observed.shape[1], dtype=np.float32)
            observed[row] += np.float32(sizes[row]) * noise

    def _stream(self, row: int, what: int, when: int) -> np.random.Generator:
        """Random numbers of one moment of a row's episode: the same however often, and in which order, they are asked for."""
        return np.random.Generator(np.random.Philox(key=int(self._seeds[row]), counter=[0, 0, what, when]))


def _drawn(name: str, ends: tuple[float, float], rng: np.random.Generator) -> float:
    low, high = ends
    return float(rng.integers(int(low), int(high) + 1)) if name == "delay" else float(rng.uniform(low, high))

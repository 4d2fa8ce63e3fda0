"""Episodes of a batch of environments: what single and vector environments are both made of."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from tdcr._arrays import Floats, as_count
from tdcr.envs.rig_world import RigWorld, world
from tdcr.envs.tasks import TASKS, Infos, Rngs, Task
from tdcr.envs.world import Bools, Settings
from tdcr.errors import ArgumentError, InputError

Observation = Any
"""A float32 array of rows, or a dictionary of such arrays."""

Space = spaces.Box | spaces.Dict
"""Spaces of observations."""


class Episodes:
    """``count`` environments of one task: resets, steps, ends and pictures, by rows.

    Attributes:
        world: The simulated robots.
        task: What is asked of them.
        steps: Steps since the last reset, shape (count,).
        layout: Where each quantity is in an observation, by name.
        observation_space, action_space: Of one environment.
    """

    def __init__(
        self,
        count: int,
        task: str | Callable[..., Task],
        camera: int = 0,
        width: int = 320,
        height: int = 240,
        max_steps: int | None = None,
        **arguments: Any,
    ) -> None:
        if isinstance(task, str) and task not in TASKS:
            raise InputError(f"task is {task!r}; expected one of {', '.join(TASKS)}, or a subclass of Task")
        maker: Any = TASKS[task] if isinstance(task, str) else task
        known = Settings.__dataclass_fields__
        settings = {name: arguments.pop(name) for name in list(arguments) if name in known}
        if maker.payload is not None:
            settings["randomise"] = {"payload": maker.payload, **settings.get("randomise", {})}
        self.world = world(as_count(count, "num_envs", 1, 10**6), Settings(**settings))
        try:
            self.task: Task = maker(self.world, **arguments)
        except TypeError as error:
            raise ArgumentError(f"arguments of the environment: {error}; the others are {', '.join(known)}") from None
        if isinstance(self.world, RigWorld) and not self.task.measurable:
            raise InputError(f"a rig does not measure what {type(self.task).__name__} asks for; expected a task of reaching")
        cost = self.world.settings.contact_cost
        if self.task.goal_based and cost:
            name = type(self.task).__name__
            raise InputError(
                f"contact_cost is {cost} with {name}, whose reward is one of goals alone; expected 0, or another task"
            )
        self.steps: NDArray[np.int64] = np.zeros(count, dtype=np.int64)
        self._view = (as_count(width, "width", 1, 4096), as_count(height, "height", 1, 4096), as_count(camera, "camera"))
        length = self.world.settings.episode_length
        self._length = length if max_steps is None else min(length, as_count(max_steps, "max_episode_steps", 1))
        self._failed: Bools = np.zeros(count, dtype=np.bool_)
        self.layout = dict(self.world.layout)
        self.action_space = spaces.Box(-1.0, 1.0, (self.world.tendons,), np.float32)
        self.observation_space: Space = self._space()

    def _space(self) -> Space:
        high, goal = self.world.high, self.task.bounds()
        if self.task.goal_based:
            parts = {"observation": high, "achieved_goal": goal, "desired_goal": goal}
            return spaces.Dict({name: spaces.Box(-bound, bound, dtype=np.float32) for name, bound in parts.items()})
        self.layout["goal"] = slice(self.world.width, self.world.width + self.task.width)
        high = np.concatenate([high, goal])
        return spaces.Box(-high, high, dtype=np.float32)

    def reset(self, rows: Sequence[int], rngs: Rngs, options: Mapping[str, Any] | None = None) -> None:
        """Starts new episodes in some rows, from their generators and what ``options`` ask for alone."""
        asked = None if options is None else self.task.asked(options)
        self.world.randomise(rows, rngs)
        self.task.draw(rows, rngs)
        if asked is not None:
            self.task.goal[rows] = asked[rows]
        self.task.start(rows, rngs)
        self.world.begin()
        self.steps[rows] = 0
        self._failed[rows] = False

    def check_options(self, options: Any, *others: str) -> Mapping[str, Any] | None:
        """Options of a reset: those of the task, and ``others``.

        Raises:
            InputError: For options that are not known; the message names them, and those that are.
        """
        if options is None:
            return None
        known = (*self.task.options, *others)
        expected = f"expected {', '.join(map(repr, known))}" if known else "expected none"
        if not isinstance(options, Mapping):
            raise InputError(f"options is {options!r}; expected None, or a dictionary of {expected.removeprefix('expected ')}")
        unknown = [name for name in options if name not in known]
        if unknown:
            names = ", ".join(map(repr, unknown))
            raise InputError(f"options has {names}, which {type(self.task).__name__} does not take; {expected}")
        return options

    def drive(self, actions: Any) -> None:
        """Advances all rows by actions, shape (count, tendons)."""
        self._failed = self.world.drive(actions)
        self.steps += 1

    def look(self) -> tuple[Observation, Floats, Bools, Infos]:
        """What is observed now, in new arrays, the rewards for being here, which episodes are cut off, and what is told."""
        task = self.task
        goals = task.goals(self.steps)
        observation: Observation
        if task.goal_based:
            observed = self.world.observe()
            observation = {
                "observation": observed,
                "achieved_goal": self.world.tips(observed).copy(),
                "desired_goal": goals.copy(),
            }
        else:
            observed = self.world.observe(task.width)
            observed[:, self.world.width :] = goals
            observation = observed
        rewards, infos = task.assess(observed, goals)
        infos |= (touch := self.world.touch())
        if cost := self.world.settings.contact_cost:
            rewards = rewards - cost * touch["contact_force"]
        infos["simulation_failed"] = self._failed.copy()
        return observation, rewards, (self.steps >= self._length) | self._failed, infos

    def picture(self, row: int, mode: str) -> NDArray[Any]:
        """Colours of shape (height, width, 3), or for ``mode`` ``"depth_array"`` depth of shape (height, width) (m)."""
        targets = np.ascontiguousarray(self.task.targets(row, int(self.steps[row])), dtype=np.float64)
        radius = 0.015 * self.world.length if len(targets) > 64 else 0.03 * self.world.length
        width, height, camera = self._view
        colors, depth = self.world.picture(row, (width, height), camera, targets, radius)
        return depth if mode == "depth_array" else colors


def first(observation: Observation) -> Observation:
    """The observation of a batch of one."""
    if isinstance(observation, dict):
        return {name: rows[0] for name, rows in observation.items()}
    return observation[0]


def first_info(infos: Infos) -> dict[str, Any]:
    """The information of a batch of one: numbers, and arrays where there are several a row."""
    return {name: values.item(0) if values.ndim == 1 else values[0] for name, values in infos.items()}

"""Episodes of a batch of environments: what single and vector environments are both made of."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from tdcr._arrays import Floats, as_array, as_count, as_float
from tdcr.envs.all_tasks import TASKS
from tdcr.envs.rig_world import RigWorld, world
from tdcr.envs.tasks import Infos, Rngs, Task, Terms
from tdcr.envs.world import Bools, Settings
from tdcr.errors import ArgumentError, InputError, NotSettledError

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
        if maker.ranges:
            settings["randomise"] = {**maker.ranges, **settings.get("randomise", {})}
        if maker.in_motion:
            settings.setdefault("dynamics", True)
        count = as_count(count, "num_envs", 1, 10**6)
        self.world = world(count, Settings(**settings), tuple(maker.ranges), maker.insertion, maker.in_scenes)
        try:
            self.task: Task = maker(self.world, **arguments)
        except TypeError as error:
            raise ArgumentError(f"arguments of the environment: {error}; the others are {', '.join(known)}") from None
        if isinstance(self.world, RigWorld) and not self.task.measurable:
            raise InputError(f"a rig does not measure what {type(self.task).__name__} asks for; expected a task of reaching")
        self.task.check_ranges()
        self._check_weights()
        self._view = (as_count(width, "width", 1, 4096), as_count(height, "height", 1, 4096), as_count(camera, "camera"))
        length = self.world.settings.episode_length
        self._length = length if max_steps is None else min(length, as_count(max_steps, "max_episode_steps", 1))
        self._failed: Bools = np.zeros(count, dtype=np.bool_)
        self._begun: Bools = np.zeros(count, dtype=np.bool_)
        self.layout = dict(self.world.layout)
        self.action_space = spaces.Box(-1.0, 1.0, (self.world.entries,), np.float32)
        self.observation_space: Space = self._space()

    def _check_weights(self) -> None:
        """Refuses weights of terms that the reward does not have."""
        settings, name = self.world.settings, type(self.task).__name__
        if settings.contact_cost and settings.scene is None and not self.task.in_scenes:
            raise InputError(f"contact_cost is {settings.contact_cost} without a scene; expected `scene`, or 0")
        for what, given in (("contact_cost", settings.contact_cost), ("weights", dict(settings.weights))):
            if self.task.goal_based and given:
                raise InputError(
                    f"{what} is {given} with {name}, whose reward is one of goals alone; expected none, or another task"
                )
        known = (*self.task.terms, "change")
        for term in settings.weights:
            if term not in known:
                raise InputError(
                    f"weights has {term!r}, which is no term of {name}'s reward; expected {', '.join(map(repr, known))}"
                )

    @property
    def steps(self) -> NDArray[np.int64]:
        """Steps since the last reset, shape (count,)."""
        return self.world.steps

    def _space(self) -> Space:
        high, goal = self.world.high, self.task.bounds()
        if self.task.goal_based:
            parts = {"observation": high, "achieved_goal": goal, "desired_goal": goal}
            return spaces.Dict({name: spaces.Box(-bound, bound, dtype=np.float32) for name, bound in parts.items()})
        start = self.world.width
        self.layout["goal"] = slice(start, start + self.task.width)
        for name, part in self.task.parts().items():
            self.layout[name] = slice(start + part.start, start + part.stop)
        high = np.concatenate([high, goal])
        return spaces.Box(-high, high, dtype=np.float32)

    def reset(self, rows: Sequence[int], rngs: Rngs, options: Mapping[str, Any] | None = None) -> None:
        """Starts new episodes in some rows, from their generators and what ``options`` ask for alone."""
        options = {} if options is None else options
        asked, starts, payloads = self.task.asked(options), self._starts(options), self._payloads(options)
        rows = list(rows)
        self.world.randomise(rows, rngs)
        if payloads is not None:
            self.world.payloads[rows] = payloads[rows]
        self.task.draw(rows, rngs)
        if asked is not None:
            self.task.goal[rows, : asked.shape[1]] = asked[rows]
        if starts is None:
            self.task.start(rows, rngs)
        elif (failed := self.world.settle(rows, starts[rows])).any():
            row = rows[int(np.flatnonzero(failed)[0])]
            raise NotSettledError(f"the robot does not settle under options['start'], {starts[row].tolist()}")
        self.world.begin(rows)
        self._failed[rows] = False
        self._begun[rows] = True

    def randomise(self, ranges: Mapping[str, tuple[float, float]]) -> None:
        """Other ranges, from the next reset on; those of other names stay.

        Raises:
            InputError: On a rig; for ends that make no range, and values that the task cannot have.
            ParameterError: For names that the robot does not have.
        """
        if isinstance(self.world, RigWorld):
            raise InputError("ranges are of simulated robots; expected no `randomise` on a rig")
        before = self.world.draws.ranges
        self.world.draws.change(ranges)
        try:
            self.task.check_ranges()
        except InputError:
            self.world.draws.ranges = before
            raise

    def _starts(self, options: Mapping[str, Any]) -> Floats | None:
        """Commands that episodes are to start under, shape (count, entries)."""
        if "start" not in options:
            return None
        world, name = self.world, "options['start']"
        given = as_array(options["start"], name)
        starts = as_float(given, name, (world.entries,) if given.ndim == 1 else (world.count, world.entries))
        starts = np.ascontiguousarray(np.broadcast_to(starts, (world.count, world.entries)))
        outside = starts != world.clip(starts.copy())
        if outside.any():
            row, entry = (int(k) for k in np.argwhere(outside)[0])
            low, high = world.clip(np.array([[-np.inf] * world.entries, [np.inf] * world.entries]))[:, entry]
            raise InputError(f"{name} has {starts[row, entry]:.6g} as entry {entry}; expected {low:g} to {high:g}")
        return starts

    def _payloads(self, options: Mapping[str, Any]) -> Floats | None:
        """Payloads that are asked for, shape (count,) (kg)."""
        if "payload" not in options:
            return None
        name = "options['payload']"
        given = as_array(options["payload"], name)
        payloads = as_float(given, name, () if given.ndim == 0 else (self.world.count,))
        if not (payloads >= 0.0).all():
            raise InputError(f"{name} is {payloads.min():g} kg; expected 0 or more")
        return np.broadcast_to(payloads, (self.world.count,))

    def check_options(self, options: Any, *others: str) -> Mapping[str, Any] | None:
        """Options of a reset: those of the task, of simulated robots, and ``others``.

        Raises:
            InputError: For options that are not known; the message names them, and those that are.
        """
        if options is None:
            return None
        simulated = () if isinstance(self.world, RigWorld) else ("start", "payload")
        known = (*self.task.options, *simulated, *others)
        expected = f"expected {', '.join(map(repr, known))}" if known else "expected none"
        if not isinstance(options, Mapping):
            raise InputError(f"options is {options!r}; expected None, or a dictionary of {expected.removeprefix('expected ')}")
        unknown = [name for name in options if name not in known]
        if unknown:
            names = ", ".join(map(repr, unknown))
            raise InputError(f"options has {names}, which {type(self.task).__name__} does not take; {expected}")
        return options

    def drive(self, actions: Any) -> None:
        """Advances all rows by actions, shape (count, entries)."""
        if not self._begun.all():
            raise ResetNeeded("a step before the first reset; call `reset` first")
        self._failed = self.world.drive(actions)

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
        assessed, infos = task.assess(observed, goals)
        infos |= (touch := self.world.touch())
        terms = self._weighted(assessed, touch)
        # A sum of one term is that term, to the last bit.
        rewards = np.add.reduce(list(terms.values()))
        infos |= {f"reward_{name}": term for name, term in terms.items()}
        self.world.blur(observed)
        infos["simulation_failed"] = self._failed.copy()
        return observation, rewards, (self.steps >= self._length) | self._failed, infos

    def _weighted(self, assessed: Floats | Terms, touch: Infos) -> Terms:
        """The terms of the reward as they count."""
        settings = self.world.settings
        terms: Terms = assessed if isinstance(assessed, dict) else {"task": assessed}
        if cost := settings.contact_cost:
            terms = {**terms, "contact": -cost * touch["contact_force"]}
        if "change" in settings.weights:
            terms = {**terms, "change": -np.square(self.world.changes).mean(axis=1)}
        return {name: settings.weights.get(name, 1.0) * term for name, term in terms.items()}

    def balls(self, row: int) -> tuple[Floats, float]:
        """Centres of the balls that show what is asked of a row, shape (balls, 3) (m), and their radius (m)."""
        targets = np.ascontiguousarray(self.task.targets(row, int(self.steps[row])), dtype=np.float64)
        return targets, (0.015 if len(targets) > 64 else 0.03) * self.world.length

    def picture(self, row: int, mode: str) -> NDArray[Any]:
        """Colours of shape (height, width, 3), or for ``mode`` ``"depth_array"`` depth of shape (height, width) (m)."""
        targets, radius = self.balls(row)
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

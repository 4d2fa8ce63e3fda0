"""The environments, many robots in one call."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from tdcr._arrays import Floats
from tdcr.envs.environment import PICTURES, TendonRobotEnv, _of_goals
from tdcr.envs.episodes import Episodes, Observation
from tdcr.envs.tasks import Infos, Task
from tdcr.envs.world import Bools
from tdcr.errors import InputError

Rows = NDArray[np.int64]


class TendonRobotVectorEnv(VectorEnv[Observation, NDArray[np.float32], NDArray[Any]]):
    """Many environments, stepped by one call on all threads. :class:`~tdcr.envs.TendonRobotEnv` has the other arguments.

    It does what :class:`gymnasium.vector.SyncVectorEnv` does of as many single environments, number for number:
    environment ``i`` has a generator of its own, seeded by ``seed + i``.

    Args:
        num_envs: How many.
        max_episode_steps: Steps after which an episode is cut off, where that is sooner than ``episode_length``.
        autoreset_mode: What happens after the end of an episode: ``"NextStep"``, ``"SameStep"`` or ``"Disabled"`` (reset
            them by ``reset(options={"reset_mask": ...})``).
    """

    metadata: dict[str, Any] = {
        **TendonRobotEnv.metadata,
        "render_modes": list(PICTURES),
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        task: str | Callable[..., Task] = "reach",
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        max_episode_steps: int | None = None,
        **arguments: Any,
    ) -> None:
        if render_mode not in (None, *PICTURES):
            raise InputError(f"render_mode is {render_mode!r}; expected one of {', '.join(PICTURES)}, or None")
        try:
            self.autoreset_mode = AutoresetMode(autoreset_mode)
        except ValueError:
            modes = ", ".join(repr(mode.value) for mode in AutoresetMode)
            raise InputError(f"autoreset_mode is {autoreset_mode!r}; expected one of {modes}") from None
        # As Gymnasium has it, -1 is no limit.
        limit = None if max_episode_steps == -1 else max_episode_steps
        self.episodes = Episodes(num_envs, task, max_steps=limit, **arguments)
        fps = self.episodes.world.settings.render_fps
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode, "render_fps": fps}
        self.num_envs, self.render_mode = num_envs, render_mode
        self.layout = self.episodes.layout
        self.single_action_space = self.episodes.action_space
        self.single_observation_space = self.episodes.observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._generators: list[np.random.Generator | None] = [None] * num_envs
        self._generator_seeds = [-1] * num_envs
        self._ended: Bools = np.zeros(num_envs, dtype=np.bool_)

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The generator of each environment."""
        return tuple(self._generator(row) for row in range(self.num_envs))

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seed of each environment."""
        return tuple(self._generator_seeds) if self.np_random else ()

    def _generator(self, row: int, seed: int | None = None) -> np.random.Generator:
        generator = self._generators[row]
        if generator is None or seed is not None:
            generator, self._generator_seeds[row] = seeding.np_random(seed)
            self._generators[row] = generator
        return generator

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Starts new episodes.

        Args:
            seed: Environment ``i`` is seeded by ``seed + i``, or by its entry of a list; without, generators go on.
            options: ``"reset_mask"``, flags of shape (num_envs,): only these are reset. The others as of
                :meth:`tdcr.envs.TendonRobotEnv.reset`, one for all or with an axis of (num_envs,) before.

        Raises:
            InputError: For options that the task does not take, and seeds that do not fit.
        """
        asked = self.episodes.check_options(options, "reset_mask")
        seeds = [seed + row for row in range(self.num_envs)] if isinstance(seed, int) else seed
        seeds = [None] * self.num_envs if seeds is None else list(seeds)
        if len(seeds) != self.num_envs:
            raise InputError(f"{len(seeds)} seeds; expected {self.num_envs}, one for each environment")
        mask = np.ones(self.num_envs, dtype=np.bool_)
        if options is not None and "reset_mask" in options:
            mask = options["reset_mask"]
            if not (isinstance(mask, np.ndarray) and mask.dtype == np.bool_ and mask.shape == (self.num_envs,)):
                raise InputError(f"reset_mask is {mask!r}; expected an array of {self.num_envs} flags (numpy.bool_)")
            if not mask.any():
                raise InputError("reset_mask has no entry that is true; expected at least one")
        rows = np.flatnonzero(mask)
        for row in rows.tolist():
            self._generator(row, seeds[row])
        self._reset(rows, asked)
        self._ended[rows] = False
        observation, _, _, infos = self.episodes.look()
        return observation, _told(infos, mask)

    def randomise(self, ranges: Mapping[str, tuple[float, float]]) -> None:
        """As :meth:`tdcr.envs.TendonRobotEnv.randomise`, for all environments."""
        self.episodes.randomise(ranges)

    def _reset(self, rows: Rows, options: Mapping[str, Any] | None = None) -> None:
        chosen = rows.tolist()
        self.episodes.reset(chosen, [self._generator(row) for row in chosen], options)

    def step(self, actions: Any) -> tuple[Observation, Floats, Bools, Bools, dict[str, Any]]:
        """Takes a step in all environments; those that ended are reset as ``autoreset_mode`` says."""
        mode, episodes, before = self.autoreset_mode, self.episodes, self._ended
        if mode is AutoresetMode.DISABLED and before.any():
            raise gymnasium.error.ResetNeeded(
                f"environments {np.flatnonzero(before).tolist()} have ended; reset them by `reset(options={{'reset_mask': "
                "ended}})`, as autoreset_mode is 'Disabled'"
            )
        episodes.drive(actions)
        if mode is AutoresetMode.NEXT_STEP and before.any():
            self._reset(np.flatnonzero(before))
        observation, rewards, truncated, infos = episodes.look()
        if mode is AutoresetMode.NEXT_STEP:
            rewards[before] = 0.0
            truncated &= ~before
        everywhere = np.ones(self.num_envs, dtype=np.bool_)
        final: dict[str, Any] = {}
        if mode is AutoresetMode.SAME_STEP and truncated.any():
            final = {"final_obs": _objects(observation, truncated), "_final_obs": truncated.copy()}
            final |= {"final_info": _told(infos, truncated), "_final_info": truncated.copy()}
            self._reset(np.flatnonzero(truncated))
            observation, _, _, infos = episodes.look()
        self._ended = truncated if mode is not AutoresetMode.SAME_STEP else np.zeros_like(truncated)
        return observation, rewards, np.zeros_like(truncated), truncated.copy(), final | _told(infos, everywhere)

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any = None) -> Any:
        """As :meth:`tdcr.envs.TendonRobotGoalEnv.compute_reward`."""
        return _of_goals(self.episodes).compute_reward(achieved_goal, desired_goal)

    def render(self) -> tuple[NDArray[Any], ...] | None:
        """The picture of each environment."""
        if self.render_mode is None:
            return None
        return tuple(self.episodes.picture(row, self.render_mode) for row in range(self.num_envs))


def along(rows: Bools, values: NDArray[Any]) -> Bools:
    """Flags of rows in a shape that goes with arrays of several numbers a row."""
    flags: Bools = rows.reshape(-1, *[1] * (values.ndim - 1))
    return flags


def _told(infos: Infos, rows: Bools) -> dict[str, Any]:
    """Information as vector environments tell it: 0 where ``rows`` has none, with a mask beside each name."""
    told: dict[str, Any] = {}
    for name, values in infos.items():
        told[name] = np.where(along(rows, values), values, np.zeros_like(values))
        told[f"_{name}"] = rows.copy()
    return told


def _objects(observation: Observation, rows: Bools) -> NDArray[Any]:
    """The observations of some rows, each an object of its own."""
    objects = np.full(len(rows), None, dtype=object)
    for row in np.flatnonzero(rows):
        if isinstance(observation, dict):
            objects[row] = {name: values[row] for name, values in observation.items()}
        else:
            objects[row] = observation[row]
    return objects

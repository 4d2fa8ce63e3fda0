"""The environments for Stable-Baselines3, which does not take Gymnasium's vector environments.

>>> from stable_baselines3 import PPO
>>> from tdcr.envs.sb3 import Sb3VecEnv
>>> PPO("MlpPolicy", Sb3VecEnv("tdcr/Reach2m-v0", num_envs=64)).learn(100_000)
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from tdcr.envs.vector import TendonRobotVectorEnv, along
from tdcr.errors import InputError, MissingPackageError

try:
    from stable_baselines3.common.vec_env import VecEnv
except ImportError:
    raise MissingPackageError("tdcr.envs.sb3 needs Stable-Baselines3: pip install stable-baselines3") from None


class Sb3VecEnv(VecEnv):
    """A :class:`~tdcr.envs.TendonRobotVectorEnv` as Stable-Baselines3's ``VecEnv``: one call steps all environments.

    Wrap it with SB3's ``VecMonitor`` for statistics of episodes.

    Args:
        env: Name of an environment, or a vector environment with ``autoreset_mode="SameStep"``.
        num_envs: How many, for a name.
        arguments: Of the environment, for a name.
    """

    def __init__(self, env: str | TendonRobotVectorEnv, num_envs: int = 1, **arguments: Any) -> None:
        if isinstance(env, str):
            mode = AutoresetMode.SAME_STEP.value
            made = gymnasium.make_vec(env, num_envs, "vector_entry_point", autoreset_mode=mode, **arguments).unwrapped
        else:
            made = env.unwrapped
        if not (isinstance(made, TendonRobotVectorEnv) and made.autoreset_mode is AutoresetMode.SAME_STEP):
            raise InputError(f"{made!r} is not a TendonRobotVectorEnv with autoreset_mode='SameStep'")
        self.env = made
        self._actions: Any = None
        super().__init__(made.num_envs, made.single_observation_space, made.single_action_space)

    def reset(self) -> Any:
        """Starts new episodes, with the seeds given by ``seed`` and the options by ``set_options``."""
        observation, infos = self.env.reset(seed=self._seeds, options=self._shared_options())
        self.reset_infos = self._by_rows(infos)
        self._reset_seeds()
        self._reset_options()
        return observation

    def _shared_options(self) -> dict[str, Any] | None:
        """The options given by ``set_options`` to each environment, as one dictionary for all."""
        names = {name for options in self._options for name in options}
        for name in names:
            if not all(name in options for options in self._options):
                raise InputError(f"option {name!r} is given to some environments; expected to all of them, or to none")
        return {name: np.stack([options[name] for options in self._options]) for name in names} or None

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keeps the actions for :meth:`step_wait`."""
        self._actions = actions

    def step_wait(self) -> Any:
        """Takes the step: observations, rewards, ends, and what is told of each environment."""
        observation, rewards, _, ended, infos = self.env.step(self._actions)
        if ended.any():
            final_obs, final = infos.pop("final_obs"), infos.pop("final_info")
            resets = self._by_rows(infos)
            told = {name: np.where(along(ended, values), final[name], values) for name, values in infos.items() if name in final}
            rows = self._by_rows(told)
            for row in np.flatnonzero(ended):
                rows[row]["terminal_observation"] = final_obs[row]
                self.reset_infos[row] = resets[row]
        else:
            rows = self._by_rows(infos)
        # Episodes never terminate.
        for info, cut_off in zip(rows, ended.tolist(), strict=True):
            info["TimeLimit.truncated"] = cut_off
        return observation, rewards.astype(np.float32), ended, rows

    def _by_rows(self, infos: dict[str, Any]) -> list[dict[str, Any]]:
        names = [name for name in infos if not name.startswith("_")]
        columns = [list(infos[name]) if infos[name].ndim > 1 else infos[name].tolist() for name in names]
        return [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]

    def close(self) -> None:
        """Closes the vector environment."""
        self.env.close()

    def get_images(self) -> Sequence[NDArray[Any] | None]:
        """The picture of each environment."""
        return self.env.render() or [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute that all environments share, once for each of ``indices``."""
        return [getattr(self.env, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Sets an attribute that all environments share; ``indices`` must name all."""
        if sorted(self._get_indices(indices)) != list(range(self.num_envs)):
            raise InputError(f"{attr_name} is shared by all environments; expected indices of all, or None")
        setattr(self.env, attr_name, value)

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Calls a method of the vector environment once for each of ``indices``."""
        method = getattr(self.env, method_name)
        return [method(*method_args, **method_kwargs) for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Iterable[int] | int | None = None) -> list[bool]:
        """No environment is wrapped."""
        return [False for _ in self._get_indices(indices)]

"""Trains a policy from a sparse reward: SAC with hindsight experience replay of Stable-Baselines3.

    python examples/python/reach_her.py --out reach_her.zip

The reward is 0 where the tip is within the tolerance of the target, and else -1. Hindsight tells the learner what its episodes
would have been worth for the points that they did reach. Takes a minute or two. The last line tells how often the
policy succeeds.
"""

import argparse

import gymnasium
import numpy as np
import torch
from stable_baselines3 import SAC, HerReplayBuffer

import tdcr.envs  # noqa: F401
from tdcr.envs.sb3 import Sb3VecEnv

ARGUMENTS = {"observation": "tip", "episode_length": 40, "tolerance": 0.02}


def success(policy, episodes=100):
    """Share of episodes that end within the tolerance."""
    envs = gymnasium.make_vec("tdcr/ReachGoal2m-v0", episodes, autoreset_mode="Disabled", **ARGUMENTS)
    observation, _ = envs.reset(seed=1)
    ended = np.zeros(episodes, dtype=bool)
    while not ended.all():
        observation, _, _, ended, infos = envs.step(policy(observation))
    return infos["is_success"].mean()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=12_000, help="steps to train for, of all robots together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", help="file for the policy")
    parser.add_argument("--short", action="store_true", help="a tenth of the steps")
    options = parser.parse_args()
    steps = options.steps // 10 if options.short else options.steps

    # Networks as small as these are not worth a second thread.
    torch.set_num_threads(1)
    envs = Sb3VecEnv("tdcr/ReachGoal2m-v0", num_envs=8, **ARGUMENTS)
    model = SAC(
        "MultiInputPolicy",
        envs,
        replay_buffer_class=HerReplayBuffer,
        replay_buffer_kwargs={"n_sampled_goal": 4, "goal_selection_strategy": "future"},
        buffer_size=100_000,
        learning_starts=500,
        train_freq=1,
        gradient_steps=8,
        batch_size=256,
        gamma=0.95,
        tau=0.02,
        learning_rate=1e-3,
        policy_kwargs={"net_arch": [64, 64]},
        seed=options.seed,
        device="cpu",
    )
    model.learn(steps)
    if options.out:
        model.save(options.out)

    rng = np.random.default_rng(options.seed)
    learned = success(lambda observation: model.predict(observation, deterministic=True)[0])
    random = success(lambda observation: rng.uniform(-1.0, 1.0, (len(observation["observation"]), 6)))
    print(f"after {model.num_timesteps} steps: success {learned:.0%}; random actions: {random:.0%}")


if __name__ == "__main__":
    main()

"""Trains a policy that moves the robot's tip to points: PPO of Stable-Baselines3 on 64 robots at a time.

    python examples/python/reach_ppo.py --out reach_ppo.zip

Takes about a minute on two cores. `--dynamics` lets the robots move in time, `--randomise` gives each episode other tendons and
another payload. The last line tells what the policy is worth beside random actions.
"""

import argparse

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO

import tdcr.envs  # noqa: F401
from tdcr.envs.sb3 import Sb3VecEnv

RANGES = {**{f"gain[{tendon}]": (400.0, 600.0) for tendon in range(6)}, "payload": (0.0, 0.02)}


def returns(policy, arguments, episodes=100):
    """Mean return of episodes, and the mean distance at their ends (m)."""
    envs = gymnasium.make_vec("tdcr/Reach2m-v0", episodes, autoreset_mode="Disabled", **arguments)
    observation, _ = envs.reset(seed=1)
    total, ended = np.zeros(episodes), np.zeros(episodes, dtype=bool)
    while not ended.all():
        observation, rewards, _, ended, infos = envs.step(policy(observation))
        total += rewards
    return total.mean(), infos["distance"].mean()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=200_000, help="steps to train for, of all robots together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--dynamics", action="store_true", help="robots move in time")
    parser.add_argument("--randomise", action="store_true", help="other tendons and another payload in each episode")
    parser.add_argument("--out", help="file for the policy")
    parser.add_argument("--short", action="store_true", help="a tenth of the steps")
    options = parser.parse_args()
    arguments = {"dynamics": options.dynamics, "randomise": RANGES if options.randomise else {}}
    steps = options.steps // 10 if options.short else options.steps

    # Networks as small as these are not worth a second thread.
    torch.set_num_threads(1)
    envs = Sb3VecEnv("tdcr/Reach2m-v0", num_envs=64, **arguments)
    model = PPO(
        "MlpPolicy",
        envs,
        n_steps=32,
        batch_size=512,
        gamma=0.9,
        gae_lambda=0.9,
        learning_rate=1e-3,
        policy_kwargs={"log_std_init": -0.5},
        seed=options.seed,
        device="cpu",
    )
    model.learn(steps)
    if options.out:
        model.save(options.out)

    rng = np.random.default_rng(options.seed)
    learned = returns(lambda observation: model.predict(observation, deterministic=True)[0], arguments)
    random = returns(lambda observation: rng.uniform(-1.0, 1.0, (len(observation), 6)), arguments)
    print(
        f"after {model.num_timesteps} steps: return {learned[0]:.1f}, {1e3 * learned[1]:.1f} mm from the target at the end; "
        f"random actions: {random[0]:.1f}, {1e3 * random[1]:.1f} mm"
    )


if __name__ == "__main__":
    main()

"""Trains a policy that pushes an object to a place: PPO of Stable-Baselines3 on 64 robots at a time.

    python examples/python/push_ppo.py --out push_ppo.zip

An episode succeeds if the object is within 5 % of the robot's length (8 mm) of its place at the end. `--straight` asks for the
easier ones alone: the object stands straight before the robot, its place straight behind it. Steps are half as long as the
environment's own, so that they cost less, and the object's distance counts three times as much as where the robot is.
The last lines tell how often the policy succeeds, and random actions, by how far the object has to go.
"""

import argparse
import time

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize

import tdcr.envs  # noqa: F401
from tdcr.envs.sb3 import Sb3VecEnv

ARGUMENTS = {"observation": "tip", "episode_length": 50, "frame_skip": 10, "weights": {"distance": 3.0}}
STRAIGHT = {"bearing": (0.0, 0.0), "turn": (0.0, 0.0)}


def play(policy, arguments, episodes):
    """How far the object had to go (m), how far it is from its place at the end (m), and whether that is a success."""
    envs = gymnasium.make_vec("tdcr/Push2m-v0", episodes, autoreset_mode="Disabled", **arguments)
    observation, infos = envs.reset(seed=1)
    ways, ended = infos["distance"], np.zeros(episodes, dtype=bool)
    while not ended.all():
        observation, _, _, ended, infos = envs.step(policy(observation))
    return ways, infos["distance"], infos["is_success"]


def show(name, ways, distances, successes):
    """Prints the rate of success, of all and of the third with the shortest ways to the third with the longest."""
    thirds = np.array_split(np.argsort(ways), 3)
    rates = ", ".join(f"up to {ways[third].max() * 1e3:.0f} mm {successes[third].mean():.0%}" for third in thirds)
    print(f"{name}: success {successes.mean():.0%}, {distances.mean() * 1e3:.1f} mm from the place at the end; by ways: {rates}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=100_000, help="steps to train for, of all robots together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--straight", action="store_true", help="push straight away from the robot alone")
    parser.add_argument("--out", help="file for the policy")
    parser.add_argument("--short", action="store_true", help="a fiftieth of the steps")
    options = parser.parse_args()
    arguments = {**ARGUMENTS, "randomise": STRAIGHT if options.straight else {}}
    steps, episodes = (options.steps // 50, 10) if options.short else (options.steps, 200)

    # Networks as small as these are not worth a second thread.
    torch.set_num_threads(1)
    # The object moves by a tenth of what observations may be: each entry is scaled to its own spread.
    envs = VecNormalize(Sb3VecEnv("tdcr/Push2m-v0", num_envs=64, **arguments), gamma=0.9)
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
    began = time.process_time()
    model.learn(steps)
    print(f"{model.num_timesteps} steps, {time.process_time() - began:.0f} s of a processor")
    if options.out:
        model.save(options.out)
        envs.save(f"{options.out}.scales")

    rng = np.random.default_rng(options.seed)
    show("learned", *play(lambda seen: model.predict(envs.normalize_obs(seen), deterministic=True)[0], arguments, episodes))
    show("random actions", *play(lambda seen: rng.uniform(-1.0, 1.0, (len(seen), 6)), arguments, episodes))


if __name__ == "__main__":
    main()

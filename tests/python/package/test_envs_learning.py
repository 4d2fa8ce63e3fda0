"""That strangers' learners learn in the environments, and that the examples run."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("gymnasium")
pytest.importorskip("stable_baselines3")

EXAMPLES = Path(__file__).parents[3] / "examples" / "python"


def test_ppo_reaches_points_far_better_than_random_actions(request: pytest.FixtureRequest) -> None:
    import gymnasium
    import torch
    from stable_baselines3 import PPO

    from tdcr.envs.sb3 import Sb3VecEnv

    # Networks as small as these are not worth a second thread.
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    request.addfinalizer(lambda: torch.set_num_threads(threads))
    began = time.monotonic()
    settings = {"n_steps": 32, "batch_size": 512, "gamma": 0.9, "gae_lambda": 0.9, "learning_rate": 1e-3}
    envs = Sb3VecEnv("tdcr/Reach2m-v0", num_envs=64)
    model = PPO("MlpPolicy", envs, seed=0, device="cpu", policy_kwargs={"log_std_init": -0.5}, **settings)
    model.learn(40_000)
    learned = time.monotonic() - began

    def result(act: object) -> tuple[float, float]:
        """Mean return of 100 episodes, and the mean distance at their ends."""
        test = gymnasium.make_vec("tdcr/Reach2m-v0", 100, autoreset_mode="Disabled")
        observation, _ = test.reset(seed=1)
        total = np.zeros(100)
        for _ in range(100):
            observation, rewards, *_, infos = test.step(act(observation))  # type: ignore[operator]
            total += rewards
        return total.mean(), infos["distance"].mean()

    rng = np.random.default_rng(0)
    random, far = result(lambda observation: rng.uniform(-1.0, 1.0, (100, 6)))
    policy, near = result(lambda observation: model.predict(observation, deterministic=True)[0])
    assert policy > random / 4.0 and near < far / 4.0, (policy, random, near, far)
    assert learned < 120.0


@pytest.mark.parametrize(
    ("script", "says"),
    [
        ("reach_ppo.py", r"after \d+ steps: return (-[\d.]+), .* random actions: (-[\d.]+),"),
        ("push_ppo.py", r"learned: success (\d+)%,.*\nrandom actions: success (\d+)%,"),
        ("reach_her.py", r"after \d+ steps: success (\d+)%; random actions: (\d+)%"),
    ],
)
def test_examples_run(script: str, says: str, tmp_path: Path) -> None:
    out = tmp_path / "policy.zip"
    command = [sys.executable, str(EXAMPLES / script), "--short", "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    found = re.search(says, done.stdout)
    assert found and float(found[1]) >= float(found[2]), done.stdout
    assert out.exists()

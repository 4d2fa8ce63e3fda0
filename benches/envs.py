"""Steps per second of our Gymnasium environments: beside the same environment on MuJoCo, in one run.

    make bench            or   .venv/bin/python benches/envs.py

The peer is Reach2m in motion written with Gymnasium and MuJoCo: the robot that `tdcr export` gives, the same time step, frame
skip, actions, observation and reward, stepped inside the C library. Of many environments the faster one of Gymnasium's
SyncVectorEnv and AsyncVectorEnv stands. Ours and MuJoCo's alternate, and medians over the rounds are shown. Where
gym-softrobot is installed, its TendonArmReach-v1, which is another robot, stands beside.
"""

import importlib.util
import os
import statistics
import sys
import time

import gymnasium
import mujoco
import numpy as np

import tdcr
import tdcr.envs

ROUNDS = 5
MANY = 64
FRAME_SKIP = 20
LONG = 1_000_000
RATE = 0.1


class MujocoReach(gymnasium.Env):
    """Reach2m in motion on MuJoCo."""

    metadata = {"render_modes": []}

    def __init__(self):
        self.robot = tdcr.Robot("2m")
        self.model = mujoco.MjModel.from_xml_string(self.robot.to_mjcf())
        self.data = mujoco.MjData(self.model)
        # The bodies of the joints are the discs.
        self.discs = self.model.jnt_bodyid.copy()
        assert np.array_equal(self.discs, np.arange(self.discs[0], self.discs[0] + 10))
        self.discs = slice(self.discs[0], self.discs[-1] + 1)
        self.base = np.array(self.robot.to_dict()["base"]["position"])
        self.length = self.robot.straight_positions[-1, 2] - self.base[2]
        self.low, self.high = self.robot.command_ranges.T
        self.change = RATE * (self.high - self.low)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (6,), np.float32)
        self.observation_space = gymnasium.spaces.Box(-50.0, 50.0, (6 + 30 + 40 + 30 + 3,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        draw = self.low + (self.high - self.low) * self.np_random.random((2, 6))
        goal, start = (tdcr.settle(self.robot, command) for command in draw)
        self.goal = (goal.tip - self.base) / self.length
        mujoco.mj_resetData(self.model, self.data)
        self.command = draw[1]
        self.data.qpos[:] = start.configuration.ravel()
        mujoco.mj_forward(self.model, self.data)
        return self.observe(), {}

    def observe(self):
        observation = np.empty(109, dtype=np.float32)
        observation[:6] = 2.0 * (self.command - self.low) / (self.high - self.low) - 1.0
        observation[6:36] = ((self.data.xpos[self.discs] - self.base) / self.length).ravel()
        observation[36:76] = self.data.xquat[self.discs].ravel()
        observation[76:106] = self.data.qvel
        observation[106:] = self.goal
        return observation

    def step(self, action):
        command = self.command + np.minimum(np.maximum(action, -1.0), 1.0) * self.change
        self.command = np.minimum(np.maximum(command, self.low), self.high)
        self.data.ctrl[:] = self.command
        mujoco.mj_step(self.model, self.data, nstep=FRAME_SKIP)
        observation = self.observe()
        distance = float(np.sqrt(np.square(observation[33:36] - self.goal).sum()))
        return observation, -distance, False, False, {"distance": distance * self.length}


gymnasium.register("MujocoReach2m-v0", MujocoReach)


def agree(ours, theirs):
    """Stops where both environments are not the same."""
    first, other = ours.reset(seed=0)[0], theirs.reset(seed=0)[0]
    for _ in range(50):
        # MuJoCo's positions after a step are those at the beginning of its last time step; its velocities are not.
        apart = np.abs(first - other)
        assert apart.max() < 1e-2 and apart[76:].max() < 1e-4, apart
        action = ours.action_space.sample()
        first, other = ours.step(action)[0], theirs.step(action)[0]


def speed(env, steps):
    """Steps per second, of all environments together."""
    many = getattr(env, "num_envs", 1)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(16)]
    env.reset(seed=0)
    env.step(actions[0])
    began = time.perf_counter()
    for k in range(steps):
        env.step(actions[k % 16])
    return many * steps / (time.perf_counter() - began)


def measured(work):
    """Medians over the rounds of alternating measurements, by name."""
    rounds = [{name: speed(env, steps) for name, (env, steps) in work.items()} for _ in range(ROUNDS)]
    return {name: statistics.median(one[name] for one in rounds) for name in work}


def make(name, many=None, **arguments):
    if many is None:
        return gymnasium.make(name, **arguments)
    return gymnasium.make_vec(name, many, **arguments)


def softrobot():
    """Steps per second of gym-softrobot's environment, or why there are none."""
    if importlib.util.find_spec("gym_softrobot") is None:
        return "gym-softrobot is not installed (pip install gym-softrobot)"
    try:
        import gym_softrobot  # noqa: F401

        # Its first step compiles for a minute.
        return speed(gymnasium.make("TendonArmReach-v1"), 20)
    except Exception as error:  # A stranger's package may fail in any way.
        return f"gym-softrobot's TendonArmReach-v1 does not run: {error}"


def row(name, ours, theirs, goal):
    ratio = ours / theirs
    verdict = "reached" if ratio >= goal else "missed"
    return f"| {name} | {ours:,.0f} | {theirs:,.0f} | **{ratio:.1f}x** | {goal}x, {verdict} |"


def main():
    motion = {"dynamics": True, "frame_skip": FRAME_SKIP, "timestep": 0.002, "rate": RATE, "episode_length": LONG}
    print(f"MuJoCo {mujoco.__version__}, Gymnasium {gymnasium.__version__}, {os.cpu_count()} processors", file=sys.stderr)
    ours, theirs = make("tdcr/Reach2m-v0", **motion), make("MujocoReach2m-v0")
    agree(ours.unwrapped, theirs.unwrapped)
    single = measured({"ours": (ours, 1500), "theirs": (theirs, 300)})
    many = {
        "ours": (make("tdcr/Reach2m-v0", MANY, **motion), 60),
        "sync": (make("MujocoReach2m-v0", MANY, vectorization_mode="sync"), 8),
        "async": (make("MujocoReach2m-v0", MANY, vectorization_mode="async"), 8),
    }
    vectors = measured(many)
    many["async"][0].close()
    rest = {"episode_length": LONG}
    still = measured({"one": (make("tdcr/Reach2m-v0", **rest), 2000), "many": (make("tdcr/Reach2m-v0", MANY, **rest), 100)})
    best = max("sync", "async", key=vectors.get)
    print("| Reach2m, steps per second | ours | MuJoCo's | ratio | goal |\n|---|---|---|---|---|")
    print(row("in motion, one environment", single["ours"], single["theirs"], 5))
    print(row(f"in motion, {MANY} environments (MuJoCo: {best})", vectors["ours"], vectors[best], 10))
    print(f"| at rest, one environment | {still['one']:,.0f} | | | |")
    verdict = "reached" if still["many"] >= 10_000 else "missed"
    print(f"| at rest, {MANY} environments | {still['many']:,.0f} | | | 10,000, {verdict} |")
    other = softrobot()
    if isinstance(other, str):
        print(f"left out: {other}", file=sys.stderr)
    else:
        print(
            f"| in motion, one environment, beside gym-softrobot's TendonArmReach-v1 | {single['ours']:,.0f} | {other:,.1f} "
            f"| **{single['ours'] / other:,.0f}x** | |"
        )


if __name__ == "__main__":
    main()

"""Environments of Gymnasium, many robots at a time."""

from __future__ import annotations

import copy
import pickle
import signal
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from tdcr.errors import InputError

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import data_equivalence  # noqa: E402
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv  # noqa: E402

import tdcr.envs  # noqa: E402

MODES = ["NextStep", "SameStep", "Disabled"]
RANDOM = {"gain[0]": (300.0, 700.0), "payload": (0.0, 0.02)}

DIVERGING = {
    "timestep": 0.1,
    "frame_skip": 5,
    "rate": 1.0,
    "randomise": {f"damping[{m}]": (0.0, 1e-6) for m in range(2)},
}
"""Motions that diverge for some robots: without damping they swing ever faster, from where small motions would not grow."""


@pytest.fixture(autouse=True)
def time_limit() -> Iterator[None]:
    """Fails a test that hangs."""

    def late(*_: object) -> None:
        raise TimeoutError("the test hangs")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(90)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


class Single:
    """Makes a single environment; pickles, so that spawned workers take it."""

    def __init__(self, name: str, **arguments: Any) -> None:
        self.name, self.arguments = name, arguments

    def __call__(self) -> Any:
        import tdcr.envs  # noqa: F401

        return gymnasium.make(f"tdcr/{self.name}-v0", **self.arguments)


def vector(name: str, count: int, **arguments: Any) -> Any:
    return gymnasium.make_vec(f"tdcr/{name}-v0", count, "vector_entry_point", **arguments)


def begun(name: str, count: int) -> Any:
    env = vector(name, count)
    env.reset(seed=0)
    return env


def actions(count: int, steps: int) -> np.ndarray:
    return np.random.default_rng(3).uniform(-1.2, 1.2, (steps, count, 6)).astype(np.float32)


def assert_same(ours: Any, theirs: Any) -> None:
    """That all is equal to the last bit, arrays of objects included."""
    if isinstance(theirs, dict):
        assert ours.keys() == theirs.keys()
        for name in theirs:
            assert_same(ours[name], theirs[name])
    elif isinstance(theirs, np.ndarray) and theirs.dtype == object:
        assert ours.dtype == object and len(ours) == len(theirs)
        for a, b in zip(ours, theirs, strict=True):
            assert_same(a, b)
    elif isinstance(theirs, tuple):
        assert len(ours) == len(theirs)
        for a, b in zip(ours, theirs, strict=True):
            assert_same(a, b)
    else:
        assert data_equivalence(ours, theirs, exact=True), (ours, theirs)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("Reach2m", {}),
        ("Reach2m", {"dynamics": True, "observation": "tip"}),
        ("ReachGoal2m", {"dynamics": True}),
        ("Shape2m", {}),
        ("Shape2m", {"target": "cloud", "observation": "cloud", "points": 40}),
        ("Payload2m", {"dynamics": True}),
        ("Track2m", {"observation": "tip"}),
        # Diverges in some of the environments, so that their episodes end at other times.
        ("Reach2m", {"dynamics": True, "episode_length": 9, **DIVERGING}),
    ],
)
def test_a_vector_is_its_environments_stepped_one_by_one(name: str, arguments: dict[str, Any], mode: str) -> None:
    arguments = {"episode_length": 5, "randomise": RANDOM, **arguments}
    ours = vector(name, 3, autoreset_mode=mode, **arguments)
    theirs = SyncVectorEnv([Single(name, **arguments)] * 3, autoreset_mode=mode)
    assert ours.metadata["autoreset_mode"] is ours.unwrapped.autoreset_mode is AutoresetMode(mode)
    assert ours.observation_space == theirs.observation_space and ours.action_space == theirs.action_space
    assert_same(ours.reset(seed=4), theirs.reset(seed=4))
    ends = 0
    for action in actions(3, 18):
        step = ours.step(action)
        assert_same(step, theirs.step(action))
        ended = step[2] | step[3]
        ends += ended.sum()
        if mode == "Disabled" and ended.any():
            resets = [env.reset(options={"reset_mask": ended.copy()}) for env in (ours, theirs)]
            assert_same(*resets)
    assert ends >= 3
    assert ours.np_random_seed == (4, 5, 6)


def test_a_failed_simulation_ends_one_episode_and_not_the_others() -> None:
    env = vector("Reach2m", 8, dynamics=True, **DIVERGING)
    env.reset(seed=0)
    for action in actions(8, 30):
        observation, _, terminated, truncated, infos = env.step(action)
        assert env.observation_space.contains(observation) and not terminated.any()
        assert np.array_equal(truncated, infos["simulation_failed"])
        if truncated.any():
            break
    assert truncated.any() and not truncated.all()


def test_ended_environments_must_be_reset_where_nothing_else_does() -> None:
    env = vector("Reach2m", 2, autoreset_mode="Disabled", episode_length=2)
    env.reset(seed=0)
    for action in actions(2, 2):
        *_, truncated, _ = env.step(action)
    assert truncated.all()
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"environments \[0, 1\] have ended"):
        env.step(action)
    env.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"environments \[1\] have ended"):
        env.step(action)
    env.reset()
    env.step(action)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: vector("Reach2m", 2, autoreset_mode="Never"), "expected one of 'NextStep', 'SameStep', 'Disabled'"),
        (lambda: vector("Reach2m", 0), "num_envs is 0; expected 1 to"),
        (lambda: vector("Reach2m", 2).reset(seed=[1]), "1 seeds; expected 2"),
        (lambda: vector("Reach2m", 2).reset(options={"reset_mask": [True, False]}), "expected an array of 2 flags"),
        (lambda: vector("Reach2m", 2).reset(options={"reset_mask": np.zeros(2, bool)}), "no entry that is true"),
        (lambda: begun("Reach2m", 2).step(np.zeros((3, 6))), r"have shape \(3, 6\); expected \(2, 6\)"),
    ],
)
def test_what_makes_no_sense_is_refused(call: Any, says: str) -> None:
    with pytest.raises(InputError, match=says):
        call()


def test_results_do_not_depend_on_the_number_of_threads() -> None:
    def tips() -> np.ndarray:
        env = vector("Reach2m", 16, dynamics=True)
        env.reset(seed=0)
        return np.stack([env.step(action)[0] for action in actions(16, 5)])

    expected = tips()
    tdcr.set_threads(1)
    try:
        assert np.array_equal(tips(), expected)
    finally:
        tdcr.set_threads(2)


def test_pictures_are_of_each_environment() -> None:
    env = vector("Reach2m", 2, render_mode="rgb_array", width=80, height=60)
    env.reset(seed=0)
    first, second = env.render()
    assert first.shape == (60, 80, 3) and not np.array_equal(first, second)
    assert vector("Reach2m", 2).render() is None


@pytest.mark.parametrize("context", ["fork", "spawn"])
def test_subprocesses_step_as_this_process_does(context: str) -> None:
    ours = vector("Reach2m", 2, dynamics=True)
    # The pool of this process is at work before it forks.
    expected = [ours.reset(seed=1), *(ours.step(action) for action in actions(2, 5))]
    theirs = AsyncVectorEnv([Single("Reach2m", dynamics=True)] * 2, context=context)
    try:
        found = [theirs.reset(seed=1), *(theirs.step(action) for action in actions(2, 5))]
    finally:
        theirs.close()
    for one, other in zip(expected, found, strict=True):
        assert_same(one, other)


class Vectors:
    """Makes a vector environment in a forked child."""

    def __call__(self) -> np.ndarray:
        env = vector("Reach2m", 8)
        env.reset(seed=0)
        return env.step(actions(8, 1)[0])[0]


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_vectors_run_in_child_processes(method: str) -> None:
    import multiprocessing

    expected = Vectors()()
    with multiprocessing.get_context(method).Pool(2) as pool:
        for found in pool.map_async(_call, [Vectors()] * 2).get(timeout=60.0):
            assert np.array_equal(found, expected)


def _call(function: Any) -> Any:
    return function()


@pytest.mark.parametrize("mode", MODES)
def test_copies_go_on_in_mid_episode_to_the_last_bit(mode: str) -> None:
    env = vector("ReachGoal2m", 3, autoreset_mode=mode, dynamics=True, episode_length=5, randomise=RANDOM)
    env.reset(seed=2)
    for action in actions(3, 3):
        env.step(action)
    copies = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    for action in actions(3, 2 if mode == "Disabled" else 12):
        expected = env.step(action)
        for one in copies:
            assert_same(one.step(action), expected)


def test_goals_of_a_vector_are_one_for_all_or_one_for_each() -> None:
    env = vector("ReachGoal2m", 2, autoreset_mode="Disabled")
    goals = np.array([[0.03, 0.0, 0.3], [0.0, 0.03, 0.31]])
    world = env.unwrapped.episodes.world
    for given, expected in ((goals, goals), (goals[0], goals[[0, 0]])):
        observation, _ = env.reset(seed=0, options={"goal": given})
        assert np.abs(world.unscaled(observation["desired_goal"]) - expected).max() < 1e-8
    mask = np.array([False, True])
    observation, _ = env.reset(options={"goal": goals, "reset_mask": mask})
    assert np.abs(world.unscaled(observation["desired_goal"]) - goals[[0, 1]]).max() < 1e-8
    for options, says in (
        (
            {"reset_mask": mask, "gaol": goals},
            "options has 'gaol', which ReachGoal does not take; expected 'goal', 'start', 'payload', 'reset_mask'",
        ),
        ({"goal": goals[:, :2]}, r"options\['goal'\] has shape \(2, 2\); expected \(2, 3\)"),
    ):
        with pytest.raises(InputError, match=says):
            env.reset(options=options)


def test_most_steps_of_an_episode_are_those_of_gymnasium() -> None:
    ours = gymnasium.make_vec("tdcr/Reach2m-v0", 2, max_episode_steps=3)
    theirs = gymnasium.make_vec("tdcr/Reach2m-v0", 2, "sync", max_episode_steps=3)
    assert_same(ours.reset(seed=1)[0], theirs.reset(seed=1)[0])
    for action in actions(2, 8):
        assert_same(ours.step(action)[:4], theirs.step(action)[:4])
    unlimited = gymnasium.make_vec("tdcr/Reach2m-v0", 2, max_episode_steps=-1, episode_length=2)
    unlimited.reset(seed=0)
    assert [unlimited.step(action)[3].all() for action in actions(2, 2)] == [False, True]
    with pytest.raises(InputError, match="max_episode_steps is 0; expected 1 to"):
        gymnasium.make_vec("tdcr/Reach2m-v0", 2, max_episode_steps=0)


def test_vector_environments_pickle() -> None:
    env = tdcr.envs.TendonRobotVectorEnv(3, "track", dynamics=True, preview=2)
    again = pickle.loads(pickle.dumps(env))
    assert_same(env.reset(seed=2), again.reset(seed=2))
    for action in actions(3, 3):
        assert_same(env.step(action), again.step(action))


def test_torchrl_takes_vectors() -> None:
    pytest.importorskip("torchrl")
    from torchrl.envs import GymWrapper

    env = GymWrapper(vector("Reach2m", 4, autoreset_mode="SameStep", episode_length=3), device="cpu")
    rollout = env.rollout(7, break_when_any_done=False)
    assert rollout["next", "reward"].shape == (4, 7, 1)
    assert rollout["next", "truncated"][:, :, 0].sum(0).tolist() == [0, 0, 4, 0, 0, 4, 0]


class TestStableBaselines3:
    """The adapter to SB3's vector environments."""

    @pytest.fixture(autouse=True)
    def sb3(self) -> None:
        pytest.importorskip("stable_baselines3")

    @pytest.mark.parametrize("name", ["Reach2m", "ReachGoal2m"])
    def test_it_steps_as_sb3s_own_vector_environments(self, name: str) -> None:
        from stable_baselines3.common.vec_env import DummyVecEnv

        from tdcr.envs.sb3 import Sb3VecEnv

        ours = Sb3VecEnv(f"tdcr/{name}-v0", num_envs=3, episode_length=4, randomise=RANDOM)
        theirs = DummyVecEnv([Single(name, episode_length=4, randomise=RANDOM)] * 3)
        ours.seed(6)
        theirs.seed(6)
        assert_same(ours.reset(), theirs.reset())
        for action in np.clip(actions(3, 10), -1.0, 1.0):
            (o, r, d, infos), (their_o, their_r, their_d, their_infos) = ours.step(action), theirs.step(action)
            assert_same(o, dict(their_o) if isinstance(o, dict) else their_o)
            assert_same((r, d), (their_r, their_d))
            for info, other in zip(infos, their_infos, strict=True):
                final, others = info.pop("terminal_observation", None), other.pop("terminal_observation", None)
                assert_same(final, others)
                assert info == other
        assert ours.reset_infos == theirs.reset_infos

    def test_attributes_and_methods_are_those_of_the_vector_environment(self) -> None:
        from tdcr.envs.sb3 import Sb3VecEnv

        env = Sb3VecEnv("tdcr/ReachGoal2m-v0", num_envs=2, render_mode="rgb_array", width=64, height=48)
        goals = env.reset()
        rewards = env.env_method("compute_reward", goals["desired_goal"], goals["desired_goal"], [{}, {}], indices=[0])
        assert len(rewards) == 1 and rewards[0].tolist() == [0.0, 0.0]
        assert env.render().shape == (96, 64, 3)
        assert env.get_attr("render_mode") == ["rgb_array"] * 2 and not env.has_attr("colour")
        env.set_attr("note", 1)
        assert env.get_attr("note", [1]) == [1]
        with pytest.raises(InputError, match="shared by all environments"):
            env.set_attr("note", 2, [0])
        with pytest.raises(InputError, match="autoreset_mode='SameStep'"):
            Sb3VecEnv(vector("Reach2m", 2).unwrapped)

    def test_its_subprocesses_step_as_ours(self) -> None:
        from stable_baselines3.common.vec_env import SubprocVecEnv

        from tdcr.envs.sb3 import Sb3VecEnv

        ours = Sb3VecEnv("tdcr/Reach2m-v0", num_envs=2)
        theirs = SubprocVecEnv([Single("Reach2m")] * 2)
        try:
            ours.seed(6)
            theirs.seed(6)
            assert_same(ours.reset(), theirs.reset())
            for action in actions(2, 3):
                (o, r, d, _), (their_o, their_r, their_d, _) = ours.step(action), theirs.step(action)
                assert_same((o, r, d), (their_o, their_r.astype(np.float32), their_d))
        finally:
            theirs.close()


def test_making_vectors_warns_of_nothing() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in ("Reach2m", "ReachGoal2m", "Track3m"):
            env = vector(name, 2)
            env.reset(seed=0)
            env.step(env.action_space.sample())


def test_copies_keep_what_friction_bears_in_the_holes() -> None:
    robot = tdcr.Robot("2m").to_dict()
    for module in robot["modules"]:
        module["tendons"]["friction"] = {"coefficient": 0.2}
    env = tdcr.envs.TendonRobotVectorEnv(3, "reach", robot=robot, dynamics=True)
    env.reset(seed=2)
    actions = np.random.default_rng(3).uniform(-1.0, 1.0, (8, 3, 6))
    for action in actions[:4]:
        env.step(action)
    twin = copy.deepcopy(env)
    for action in actions[4:]:
        assert data_equivalence(twin.step(action), env.step(action), exact=True)

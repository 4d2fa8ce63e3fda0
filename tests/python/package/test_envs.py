"""Environments of Gymnasium, one robot at a time."""

from __future__ import annotations

import copy
import pickle
import re
import subprocess
import sys
import time
import urllib.request
import webbrowser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tdcr
from tdcr.errors import ArgumentError, CommandError, DynamicsError, InputError, NotSettledError, ParameterError

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import check_env, data_equivalence  # noqa: E402

import tdcr.envs  # noqa: E402

pytestmark = pytest.mark.filterwarnings("error")

IDS = sorted(name for name in gymnasium.registry if name.startswith("tdcr/"))
SMALL = ["Reach2m", "ReachGoal2m", "Shape2m", "Payload2m", "Track2m"]
RANDOM = {"gain[0]": (300.0, 700.0), "density[0]": (20.0, 60.0), "payload": (0.0, 0.02)}


def make(name: str, **arguments: Any) -> Any:
    return gymnasium.make(f"tdcr/{name}-v0", **arguments)


def episode(env: Any, seed: int | None, steps: int = 8) -> list[Any]:
    """What a seed and a row of actions lead to."""
    actions = np.random.default_rng(7).uniform(-1.0, 1.0, (steps, *env.action_space.shape)).astype(np.float32)
    return [env.reset(seed=seed), *(env.step(action) for action in actions)]


def same(a: Any, b: Any) -> bool:
    """Whether all numbers are equal to the last bit."""
    return bool(data_equivalence(a, b, exact=True))


def test_every_task_is_there_for_every_robot() -> None:
    tasks = [
        "Insert{}",
        "Payload{}",
        "Push{}",
        "ReachGoal{}",
        "ReachGoal{}Dense",
        "ReachObstacle{}",
        "Reach{}",
        "Shape{}",
        "Track{}",
    ]
    assert sorted(f"tdcr/{task.format(robot)}-v0" for task in tasks for robot in ("2m", "3m", "5m")) == IDS


@pytest.mark.parametrize("dynamics", [False, True], ids=["rest", "motion"])
@pytest.mark.parametrize("name", IDS)
def test_strangers_find_nothing_to_complain_of(name: str, dynamics: bool) -> None:
    if dynamics and "Insert" in name:
        pytest.skip("a base that moves does so at rest")
    if not dynamics and "Push" in name:
        pytest.skip("objects move in time alone")
    check_env(gymnasium.make(name, dynamics=dynamics, render_mode="rgb_array").unwrapped)
    check = pytest.importorskip("stable_baselines3.common.env_checker").check_env
    check(gymnasium.make(name, dynamics=dynamics).unwrapped)


@pytest.mark.parametrize("observation", ["state", "tip", "cloud"])
@pytest.mark.parametrize("name", SMALL)
def test_every_observation_is_one_of_its_space(name: str, observation: str) -> None:
    for dynamics in (False, True):
        env = make(name, observation=observation, dynamics=dynamics, points=32, randomise=RANDOM)
        check_env(env.unwrapped, skip_render_check=True)


def test_the_package_does_not_import_gymnasium_and_its_name_imports_the_environments() -> None:
    alone = "import sys, tdcr; assert 'gymnasium' not in sys.modules"
    by_name = "import gymnasium; gymnasium.make('tdcr.envs:tdcr/Reach2m-v0').reset()"
    for code in (alone, by_name):
        subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


def test_every_line_of_the_documents_that_makes_one_works_in_a_fresh_process() -> None:
    root, lines = Path(__file__).parents[3], []
    for page in (root / "docs/environments.md", root / "docs/hardware.md", root / "python/tdcr/envs/__init__.py"):
        text = page.read_text(encoding="utf-8")
        # In running text and tables a line stands alone; in blocks it follows its imports.
        lines += re.findall(r"`(gymnasium\.make\([^`]*\))`", text)
    assert len(lines) >= 4
    for line in set(lines):
        line = re.sub(r'rig="[^"]*"', 'rig="examples/rig-sim.toml"', line)
        done = subprocess.run(
            [sys.executable, "-c", f"import gymnasium\n{line}"], cwd=root, capture_output=True, text=True, timeout=60
        )
        assert done.returncode == 0, f"{line}: {done.stderr}"


def test_registering_again_changes_nothing() -> None:
    gymnasium.registry.pop("tdcr/Shape5m-v0")
    tdcr.envs.register()
    assert sorted(name for name in gymnasium.registry if name.startswith("tdcr/")) == IDS


class Rise(tdcr.envs.Task):
    """As high as possible."""

    def __init__(self, world: Any, power: float = 1.0) -> None:
        super().__init__(world, 0)
        self.power = power

    def draw(self, rows: Any, rngs: Any) -> None:
        pass

    def assess(self, observed: Any, goals: Any) -> Any:
        height = self.world.tips(observed)[:, 2].astype(np.float64)
        return height**self.power, {"height": height}


def test_a_task_of_ones_own_is_a_class() -> None:
    env = tdcr.envs.TendonRobotEnv(Rise, power=2.0, render_mode="rgb_array")
    check_env(env, skip_render_check=True)
    assert env.reset() and env.render().shape == (240, 320, 3)
    _, info = env.reset(seed=0)
    assert info.keys() == {"height", "simulation_failed", "reward_task"}
    _, reward, *_, info = env.step(np.zeros(6))
    assert reward == info["height"] ** 2 and 0.0 < info["height"] <= 1.0
    assert tdcr.envs.TendonRobotVectorEnv(4, Rise).reset(seed=0)[1]["height"].shape == (4,)


@pytest.mark.parametrize("dynamics", [False, True], ids=["rest", "motion"])
@pytest.mark.parametrize("name", SMALL)
def test_a_reset_forgets_everything(name: str, dynamics: bool) -> None:
    fresh = make(name, dynamics=dynamics, randomise=RANDOM)
    used = make(name, dynamics=dynamics, randomise=RANDOM)
    episode(used, seed=1, steps=23)
    for seed in (11, 12):
        assert same(episode(fresh, seed), episode(used, seed))
    assert not same(episode(fresh, 11), episode(used, 12))
    # A reset without a seed goes on with the generator.
    assert not same(episode(used, None), episode(used, None))


def test_randomness_comes_from_the_generator_alone() -> None:
    env, other = make("Payload2m"), make("Payload2m")
    env.unwrapped.np_random = np.random.default_rng(5)
    other.unwrapped.np_random = np.random.default_rng(5)
    np.random.seed(0)
    first = episode(env, None)
    np.random.seed(1)
    assert same(first, episode(other, None))


def test_a_step_leads_where_the_robot_settles_and_is_rewarded_by_the_distance() -> None:
    env = make("Reach2m", randomise=RANDOM).unwrapped
    observation, _ = env.reset(seed=3)
    world, layout = env.episodes.world, env.layout
    robot, payload = world.robot_of(0), world.payloads[0]
    assert 300.0 <= robot.value("gain[0]") <= 700.0 and 20.0 <= robot.value("density[0]") <= 60.0 and 0.0 < payload <= 0.02
    settler, loads = tdcr.Settler(robot), tdcr.Loads(payload=payload)
    ranges = robot.command_ranges
    command = ranges[:, 0] + np.diff(ranges)[:, 0] * (observation[layout["command"]].astype(np.float64) + 1.0) / 2.0
    base, length = np.array([0.0, 0.0, 0.174]), 0.33595 - 0.174
    goal = observation[layout["goal"]] * length + base
    for action in np.random.default_rng(0).uniform(-1.5, 1.5, (30, 6)):
        observation, reward, terminated, truncated, info = env.step(action)
        command = np.clip(command + 0.1 * np.clip(action, -1.0, 1.0) * np.diff(ranges)[:, 0], *ranges.T)
        settled = settler.follow(command, loads).check()
        assert np.abs(observation[layout["tip"]] * length + base - settled.tip).max() < 1e-6
        assert np.abs(observation[layout["quaternions"]] - settled.quaternions.ravel()).max() < 1e-5
        distance = np.linalg.norm(settled.tip - goal)
        assert abs(info["distance"] - distance) < 1e-6 and abs(reward + distance / length) < 1e-5
        assert info["is_success"] == (info["distance"] < 0.05 * length) and not terminated and not truncated


def test_goals_are_tips_of_settled_commands() -> None:
    env = make("Reach2m").unwrapped
    for seed in range(5):
        observation, _ = env.reset(seed=seed)
        ranges = env.episodes.world.robot.command_ranges
        draw = gymnasium.utils.seeding.np_random(seed)[0].random(6)
        tip = tdcr.settle(tdcr.Robot("2m"), ranges[:, 0] + draw * np.diff(ranges)[:, 0]).tip
        goal = env.episodes.world.unscaled(observation[env.layout["goal"]])
        assert np.abs(goal - tip).max() < 1e-6


def test_motion_is_that_of_mujoco() -> None:
    mujoco = pytest.importorskip("mujoco")
    env = make("Reach2m", dynamics=True).unwrapped
    env.reset(seed=2)
    world = env.episodes.world
    model = mujoco.MjModel.from_xml_string(world.robot.to_mjcf())
    assert model.opt.timestep == 0.002
    data = mujoco.MjData(model)
    settled = tdcr.settle(world.robot, world.commands[0])
    data.qpos[:] = settled.configuration.ravel()
    for action in np.random.default_rng(1).uniform(-1.0, 1.0, (50, 6)):
        observation, *_ = env.step(action)
        data.ctrl[:] = world.commands[0]
        mujoco.mj_step(model, data, nstep=20)
    assert np.abs(observation[env.layout["rates"]] - data.qvel).max() < 1e-5 * np.abs(data.qvel).max()
    assert np.abs(data.qvel).max() > 0.05


def test_a_path_is_closed_and_reached_at_every_step() -> None:
    env = make("Track2m", episode_length=40, preview=2).unwrapped
    _, info = env.reset(seed=0)
    assert info["distance"] < 1e-6
    points = env.episodes.task.goals(np.arange(41)[:1] * 0)
    path = [env.episodes.task.goals(np.array([step]))[0, :3] for step in range(41)]
    assert np.array_equal(path[0], path[40]) and np.array_equal(points[0, 3:], path[1])
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert 0.0 < steps.max() < 0.2
    # The robot reaches points of the path: those of its own commands on it.
    for _ in range(40):
        _, _, _, truncated, info = env.step(np.zeros(6))
    assert truncated


def test_shapes_are_rewarded_by_places_and_angles_or_by_clouds() -> None:
    env = make("Shape2m").unwrapped
    observation, info = env.reset(seed=0)
    goal = observation[env.layout["goal"]]
    places, turns = goal[:30].reshape(10, 3), goal[30:].reshape(10, 4)
    _, reward, *_, info = env.step(np.zeros(6))
    settled = tdcr.settle(tdcr.Robot("2m"), env.episodes.world.commands[0])
    apart = np.linalg.norm(settled.positions - env.episodes.world.unscaled(places), axis=1).mean()
    angles = [2.0 * np.arccos(min(1.0, abs(a @ b))) for a, b in zip(settled.quaternions, turns, strict=True)]
    assert abs(info["distance"] - apart) < 1e-6 and abs(info["angle"] - np.mean(angles)) < 1e-3
    assert abs(reward + apart / 0.16195 + np.mean(angles) / np.pi) < 1e-3

    env = make("Shape2m", target="cloud", observation="cloud", points=200).unwrapped
    observation, info = env.reset(seed=0)
    p, q = (observation[env.layout[name]].reshape(200, 1, 3).astype(np.float64) for name in ("cloud", "goal"))
    squares = ((p - q.transpose(1, 0, 2)) ** 2).sum(-1) * 0.16195**2
    chamfer = squares.min(0).mean() + squares.min(1).mean()
    assert abs(info["chamfer"] / chamfer - 1.0) < 1e-3 and abs(info["distance"] ** 2 * 2.0 / chamfer - 1.0) < 1e-3
    # All points are of the robot's surface.
    discs = env.episodes.world.simulation.positions()[0]
    cloud = env.episodes.world.unscaled(p[:, 0])
    assert np.linalg.norm(cloud[:, None] - discs, axis=-1).min(axis=1).max() < 0.025


def test_rewards_of_goals_are_computed_for_any_number_of_them() -> None:
    for name, dense in (("ReachGoal2m", False), ("ReachGoal2mDense", True)):
        env = make(name, tolerance=0.01).unwrapped
        observation, reward, *_, info = [env.reset(seed=0), env.step(env.action_space.sample())][1]
        achieved, desired = observation["achieved_goal"], observation["desired_goal"]
        assert env.compute_reward(achieved, desired, info) == reward
        rows = env.compute_reward(np.stack([achieved, desired]), np.stack([desired, desired]), [info, info])
        assert rows.tolist() == [reward, 0.0]
        assert reward == pytest.approx(-info["distance"] / 0.16195, rel=1e-6) if dense else reward in (-1.0, 0.0)
        near = desired + np.array([0.009, 0.0, 0.0]) / 0.16195
        assert dense or env.compute_reward(near, desired, {}) == 0.0
    assert not hasattr(make("Reach2m").unwrapped, "compute_reward")
    with pytest.raises(InputError, match="Reach is not a goal-based task"):
        gymnasium.make_vec("tdcr/Reach2m-v0").compute_reward(achieved, desired, {})


def test_a_motion_that_diverges_ends_the_episode_where_it_was() -> None:
    undamped = tdcr.Robot("2m").with_values({"damping[0]": 0.0, "damping[1]": 0.0})
    env = make("Reach2m", robot=undamped, dynamics=True, timestep=0.1, frame_skip=5, rate=1.0).unwrapped
    env.reset(seed=0)
    env.action_space.seed(0)
    for _ in range(90):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert env.observation_space.contains(observation) and np.isfinite(reward) and not terminated
        assert truncated == info["simulation_failed"]
        if truncated:
            break
    assert truncated
    _, _, _, still, _ = env.step(env.action_space.sample())
    assert still
    _, info = env.reset()
    assert not info["simulation_failed"]


def test_a_robot_that_does_not_settle_is_flagged_and_stays_where_it_was() -> None:
    robot = tdcr.Robot("2m")
    both = tdcr._tdcr.BatchSimulation([robot._native] * 2, None, 1, (0.0, 0.0, 0.0), 1.0)
    commands = robot.random_commands(2)
    assert not both.reset([0, 1], commands, np.zeros(2)).any()
    before = both.positions()
    for _ in range(2):
        assert both.advance(robot.random_commands(2, seed=1), np.array([0.0, 1e200])).tolist() == [False, True]
    assert np.array_equal(before[1], both.positions()[1]) and not np.array_equal(before[0], both.positions()[0])
    assert not both.reset([1], commands[1:], np.zeros(1)).any()
    assert not both.advance(commands).any()
    with pytest.raises(InputError, match="row 2; expected one below 2"):
        both.reset([2], commands[1:], np.zeros(1))


def test_a_robot_that_never_settles_is_an_error() -> None:
    env = make("Reach2m", randomise={"payload": (1e200, 1e200)})
    with pytest.raises(NotSettledError, match="robot '2m' settles under none of 100 random commands"):
        env.reset(seed=0)


@pytest.mark.parametrize(
    ("arguments", "error", "says"),
    [
        ({"observation": "sound"}, InputError, "observation is 'sound'; expected one of state, tip, cloud"),
        ({"frame_skip": 0}, InputError, "frame_skip is 0; expected 1 to"),
        ({"timestep": -1.0}, InputError, "timestep is -1.0; expected a number above 0"),
        ({"randomise": {"colour": (0, 1)}}, ParameterError, "colour"),
        ({"randomise": {"gain[9]": (1, 2)}}, ParameterError, r"gain\[9\]"),
        ({"randomise": {"gain[0]": (2, 1)}}, InputError, "expected low <= high"),
        ({"randomise": {"gain[0]": 3}}, InputError, r"randomise\['gain\[0\]'\] is 3; expected \(low, high\)"),
        ({"randomise": {"payload": (-1, 1)}}, InputError, r"'payload'\] is \(-1.0, 1.0\); expected values of 0 or more"),
        ({"randomise": {"density[0]": (-1, 9)}}, InputError, r"randomise\['density\[0\]'\] is .* expected values of 0 or more"),
        ({"robot": "9m"}, tdcr.errors.RobotError, "unknown robot `9m`"),
        ({"task": "fly"}, InputError, "task is 'fly'; expected one of reach"),
        ({"speed": 3}, ArgumentError, "unexpected keyword argument 'speed'"),
        ({"width": 0}, InputError, "width is 0; expected 1 to 4096"),
    ],
)
def test_arguments_that_make_no_sense_are_refused(arguments: dict[str, Any], error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says):
        tdcr.envs.TendonRobotEnv(**arguments)


def test_actions_that_make_no_sense_are_refused_and_change_nothing() -> None:
    env = make("Reach2m").unwrapped
    env.reset(seed=0)
    before = env.episodes.world.commands.copy()
    with pytest.raises(InputError, match=r"the actions have shape \(1, 5\); expected \(1, 6\)"):
        env.step(np.zeros(5))
    with pytest.raises(CommandError, match="command entry 3"):
        env.step(np.array([0.0, 0.0, np.nan, 0.0, 0.0, 0.0]))
    assert np.array_equal(env.episodes.world.commands, before)


@pytest.mark.parametrize("name", ["Reach2m", "Shape2m", "Track2m"])
def test_pictures_show_the_robot_and_its_target(name: str) -> None:
    env = make(name, render_mode="rgb_array", width=160, height=120)
    env.reset(seed=0)
    picture = env.render()
    assert picture.shape == (120, 160, 3) and picture.dtype == np.uint8
    red = (picture[..., 0] > 60) & (picture[..., 0] > 2 * picture[..., 1]) & (picture[..., 0] > 2 * picture[..., 2])
    assert red.sum() > 5
    assert not np.array_equal(env.render(), [env.step(env.action_space.sample()), env.render()][1])
    depth = make(name, render_mode="depth_array", width=160, height=120)
    depth.reset(seed=0)
    image = depth.render()
    assert image.shape == (120, 160) and image.dtype == np.float32
    assert np.array_equal(image > 0.0, picture.any(axis=2))
    assert image[image > 0.0].min() > 0.3 and image.max() < 0.8


def test_a_page_in_a_browser_shows_the_robot_until_the_environment_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda address: opened.append(address) or True)
    env = make("Reach2m", render_mode="human")
    assert env.unwrapped.window.viewer is None and not opened
    env.reset(seed=0)
    (address,) = opened
    assert urllib.request.urlopen(address).status == 200
    began = time.monotonic()
    for _ in range(3):
        env.step(np.zeros(6))
    # As fast as the robot, and on the same page.
    assert time.monotonic() - began > 0.09 and opened == [address]
    assert env.render() is None
    twin = copy.deepcopy(env.unwrapped)
    assert twin.window.viewer is None
    env.close()
    with pytest.raises(OSError):
        urllib.request.urlopen(address)
    env.close()


def test_without_a_browser_the_page_is_served_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(webbrowser, "open", lambda address: False)
    env = make("Reach2m", render_mode="human")
    with pytest.warns(UserWarning, match=r"no browser could be started; open http://127\.0\.0\.1"):
        env.reset(seed=0)
    assert urllib.request.urlopen(env.unwrapped.window.viewer.address).status == 200
    env.close()
    with pytest.raises(InputError, match="render_mode is 'ansi'"):
        tdcr.envs.TendonRobotEnv(render_mode="ansi")
    with pytest.raises(InputError, match="expected one of rgb_array, depth_array, or None"):
        tdcr.envs.TendonRobotVectorEnv(2, render_mode="human")


@pytest.mark.parametrize("dynamics", [False, True], ids=["rest", "motion"])
@pytest.mark.parametrize("name", SMALL)
def test_copies_go_on_in_mid_episode_to_the_last_bit(name: str, dynamics: bool) -> None:
    env = make(name, dynamics=dynamics, randomise=RANDOM, episode_length=12)
    episode(env, 3, steps=5)
    copies = [copy.deepcopy(env), pickle.loads(pickle.dumps(env)), pickle.loads(pickle.dumps(env.unwrapped))]
    # A copy of a copy, too, and the old one goes on by itself.
    copies.append(copy.deepcopy(copies[0]))
    ends = []
    for action in np.random.default_rng(1).uniform(-1.0, 1.0, (7, 6)):
        expected = env.step(action)
        ends.append(expected[3])
        assert all(same(one.step(action), expected) for one in copies)
    # The counter of steps went with them, and the generator.
    assert ends == [False] * 6 + [True]
    expected = episode(env, None)
    assert all(same(episode(one, None), expected) for one in copies)


def test_a_failed_episode_stays_failed_in_a_copy() -> None:
    both = tdcr.envs.TendonRobotVectorEnv(2, "reach", dynamics=True)
    both.reset(seed=0)
    world = both.episodes.world
    world.simulation.advance(world.commands, np.array([0.0, 1e200]))
    other = copy.deepcopy(both)
    assert other.step(np.zeros((2, 6)))[4]["simulation_failed"].tolist() == [False, True]
    with pytest.raises(InputError, match=r"state has shape \[2, 3\], expected \[2, "):
        world.simulation.restore(np.zeros((2, 3)))


def test_time_steps_that_are_too_long_are_refused_at_the_reset() -> None:
    env = make("Reach2m", dynamics=True, timestep=0.5)
    with pytest.raises(DynamicsError, match="steps of 0.5 s are unstable"):
        env.reset(seed=0)
    with pytest.raises(DynamicsError, match="row 0: steps of 0.5 s are unstable"):
        tdcr.envs.TendonRobotVectorEnv(2, "reach", dynamics=True, timestep=0.5).reset(seed=0)


def test_goals_are_set_by_options_and_others_are_refused() -> None:
    point = np.array([0.05, -0.02, 0.29])
    for name in ("Reach2m", "ReachGoal2m", "Payload2m"):
        env = make(name)
        observation, info = env.reset(seed=3, options={"goal": point})
        world = env.unwrapped.episodes.world
        goal = observation["desired_goal"] if isinstance(observation, dict) else observation[env.unwrapped.layout["goal"]]
        assert np.abs(world.unscaled(goal) - point).max() < 1e-8
        assert abs(info["distance"] - np.linalg.norm(world.simulation.positions()[0, -1] - point)) < 1e-7
        # The start is that of the seed, whichever the goal.
        plain, _ = env.reset(seed=3)
        tip = [o["achieved_goal"] if isinstance(o, dict) else o[env.unwrapped.layout["tip"]] for o in (observation, plain)]
        assert np.array_equal(*tip)
        env.step(env.action_space.sample())
    env = make("Reach2m")
    env.reset(seed=3)
    before = env.unwrapped.episodes.task.goal.copy()
    for options, says in (
        ({"target": point}, "options has 'target', which Reach does not take; expected 'goal', 'start', 'payload'"),
        ({"goal": [0.0, 0.0]}, r"options\['goal'\] has shape \(2,\); expected \(3,\)"),
        ({"goal": [0.0, 0.0, 9.0]}, r"has z = 9 m; expected -0\.150 to 0\.498 m, 2 lengths of the robot from its base"),
        (point, "expected None, or a dictionary of 'goal'"),
    ):
        with pytest.raises(InputError, match=says):
            env.reset(options=options)
    assert np.array_equal(env.unwrapped.episodes.task.goal, before)
    for name in ("Shape2m", "Track2m"):
        with pytest.raises(InputError, match=f"options has 'goal', which {name[:-2]} does not take; expected 'start', 'payload'"):
            make(name).reset(options={"goal": point})


def test_pictures_of_a_second_are_steps_of_a_second() -> None:
    for arguments, fps in (
        ({}, 25),
        ({"frame_skip": 10}, 50),
        ({"frame_skip": 5, "timestep": 0.001}, 200),
        ({"frame_skip": 7}, 71.428571),
    ):
        assert make("Reach2m", dynamics=True, **arguments).metadata["render_fps"] == pytest.approx(fps)
        assert make("Reach2m", **arguments).metadata["render_fps"] == 25
    vector = gymnasium.make_vec("tdcr/Reach2m-v0", 2, dynamics=True, frame_skip=4)
    assert vector.metadata["render_fps"] == 125 and tdcr.envs.TendonRobotEnv.metadata["render_fps"] == 25


@pytest.mark.parametrize("wrapped", [False, True])
def test_environments_pickle(wrapped: bool) -> None:
    robot = tdcr.Robot("2m").with_values({"gain[1]": 400.0})
    env = make("Track2m", robot=robot, dynamics=True, preview=2)
    env = env if wrapped else env.unwrapped
    expected = episode(env, 3)
    for again in (pickle.loads(pickle.dumps(env)), copy.deepcopy(env)):
        assert same(episode(again, 3), expected)
        assert same(episode(again, None), episode(copy.deepcopy(env), None))


def test_torchrl_steps_one() -> None:
    pytest.importorskip("torchrl")
    from torchrl.envs import GymEnv, GymWrapper, check_env_specs

    # It probes for keywords of other environments, and wants a TypeError.
    assert GymEnv("tdcr/ReachGoal2m-v0", frame_skip=2).rollout(3)["next", "reward"].shape == (3, 1)
    env = GymWrapper(make("Reach2m", observation="tip"))
    check_env_specs(env)
    rollout = env.rollout(5)
    assert rollout["next", "reward"].shape == (5, 1) and rollout["observation"].shape == (5, 15)

"""Environments among obstacles."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import numpy as np
import pytest

import tdcr
from tdcr.errors import ContactError, InputError

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import check_env, data_equivalence  # noqa: E402

import tdcr.envs  # noqa: E402

pytestmark = pytest.mark.filterwarnings("error")

GREEN = {"color": (20, 200, 20)}
WALLS = [tdcr.Obstacle.box(f"wall {x}", (0.02, 0.4, 0.5), position=(x, 0.0, 0.25), **GREEN) for x in (-0.04, 0.045)]
SCENE = tdcr.Scene([*WALLS, tdcr.Obstacle.half_space("floor")])
NOTHING = tdcr.Scene.from_json('{"self_contact": "ignored"}')
TOLD = ("contacts", "contact_force", "contact_max", "disc_forces")


def make(name: str = "Reach2m", **arguments: Any) -> Any:
    return gymnasium.make(f"tdcr/{name}-v0", **arguments)


def episode(env: Any, steps: int = 12) -> list[Any]:
    actions = np.random.default_rng(7).uniform(-1.0, 1.0, (steps, *env.action_space.shape)).astype(np.float32)
    return [env.reset(seed=3), *(env.step(action) for action in actions)]


@pytest.mark.parametrize("dynamics", [False, True], ids=["rest", "motion"])
@pytest.mark.parametrize("name", ["Reach2m", "ReachGoal2m", "Shape2m", "Payload2m", "Track2m"])
def test_strangers_find_nothing_to_complain_of(name: str, dynamics: bool) -> None:
    check_env(make(name, scene=SCENE, dynamics=dynamics, render_mode="rgb_array").unwrapped)
    check = pytest.importorskip("stable_baselines3.common.env_checker").check_env
    check(make(name, scene=SCENE, dynamics=dynamics).unwrapped)


@pytest.mark.parametrize("dynamics", [False, True], ids=["rest", "motion"])
def test_an_empty_scene_changes_nothing(dynamics: bool) -> None:
    plain, empty = (episode(make(dynamics=dynamics, scene=scene)) for scene in (None, NOTHING))
    for without, within in zip(plain, empty, strict=True):
        assert data_equivalence(without[:-1], within[:-1], exact=True)
        told = {name: value for name, value in within[-1].items() if name not in TOLD}
        assert data_equivalence(without[-1], told, exact=True)
        assert within[-1]["contacts"] == 0 and not within[-1]["disc_forces"].any()


@pytest.mark.parametrize("dynamics", [False, True], ids=["rest", "motion"])
def test_what_is_told_and_rewarded_is_what_settle_finds(dynamics: bool) -> None:
    cost = 0.3
    free, env = make(scene=SCENE, dynamics=dynamics), make(scene=SCENE, dynamics=dynamics, contact_cost=cost)
    touched = 0
    for (*without, told), (*within, same) in zip(episode(free), episode(env), strict=True):
        assert same.pop("reward_contact") == -cost * told["contact_force"]
        assert data_equivalence(told, same, exact=True)
        if len(within) > 1:
            np.testing.assert_allclose(within[1], without[1] - cost * told["contact_force"], rtol=0, atol=1e-12)
        touched += told["contacts"]
        assert told["contact_max"] <= told["contact_force"]
        assert told["disc_forces"].shape == (10, 3) and (told["contact_force"] > 0.0) == (told["contacts"] > 0)
    assert touched > 0
    world = env.unwrapped.episodes.world
    if not dynamics:
        settled = tdcr.settle("2m", world.commands[0], scene=SCENE)
        on_discs = np.zeros((10, 3))
        np.add.at(on_discs, settled.contacts.disc, settled.contacts.force)
        np.testing.assert_allclose(same["disc_forces"], on_discs, atol=1e-6)
        np.testing.assert_allclose(world.simulation.positions()[0], settled.positions, atol=1e-7)


def test_a_robot_that_rests_on_an_obstacle_says_so_at_once() -> None:
    env = make(scene=SCENE, dynamics=True)
    seen = [env.reset(seed=seed)[1] for seed in range(20)]
    world = env.unwrapped.episodes.world
    settled = tdcr.settle("2m", world.commands[0], scene=SCENE)
    assert seen[-1]["contacts"] == len(settled.contacts)
    assert any(told["contacts"] for told in seen)


@pytest.mark.parametrize("dynamics", [False, True], ids=["rest", "motion"])
def test_copies_go_on_among_obstacles_to_the_last_bit(dynamics: bool) -> None:
    env = make(scene=SCENE, dynamics=dynamics, contact_cost=0.1)
    actions = np.random.default_rng(5).uniform(-1.0, 1.0, (16, 6)).astype(np.float32)
    env.reset(seed=1)
    for action in actions[:8]:
        env.step(action)
    others = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    for action in actions[8:]:
        expected = env.step(action)
        assert all(data_equivalence(expected, other.step(action), exact=True) for other in others)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_a_vector_is_its_environments_stepped_one_by_one(mode: str) -> None:
    arguments: dict[str, Any] = {"scene": SCENE, "contact_cost": 0.2, "episode_length": 4}
    own = gymnasium.make_vec("tdcr/Reach2m-v0", 3, autoreset_mode=mode, **arguments)
    each = gymnasium.vector.SyncVectorEnv([lambda: make(disable_env_checker=True, **arguments)] * 3, autoreset_mode=mode)
    rng = np.random.default_rng(2)
    seen = [(own.reset(seed=9), each.reset(seed=9))]
    for _ in range(10):
        actions = rng.uniform(-1.0, 1.0, (3, 6)).astype(np.float32)
        seen.append((own.step(actions), each.step(actions)))
    for one, other in seen:
        assert all(np.array_equal(a, b) for a, b in zip(one[:-1], other[:-1], strict=True))
        for name in TOLD:
            np.testing.assert_array_equal(one[-1][name], other[-1][name])
            np.testing.assert_array_equal(one[-1][f"_{name}"], other[-1][f"_{name}"])


def test_stable_baselines_takes_what_is_told() -> None:
    pytest.importorskip("stable_baselines3")
    from tdcr.envs.sb3 import Sb3VecEnv

    env = Sb3VecEnv("tdcr/Reach2m-v0", 2, scene=SCENE, episode_length=3)
    env.reset()
    for _ in range(4):
        _, _, _, rows = env.step(np.zeros((2, 6), dtype=np.float32))
        assert all(row["disc_forces"].shape == (10, 3) for row in rows)
    assert len(rows) == 2


def test_pictures_show_obstacles_and_clouds_do_not() -> None:
    with_wall, without = (make(scene=scene, render_mode="rgb_array", width=160, height=120) for scene in (SCENE, None))
    for env in (with_wall, without):
        env.reset(seed=0)
    green = [(env.render()[..., 1] > env.render()[..., 0].astype(int) + 60).sum() for env in (with_wall, without)]
    assert green[0] > 500 > green[1]
    env = make(scene=SCENE, observation="cloud", points=300)
    env.reset(seed=0)
    world = env.unwrapped.episodes.world
    points = world.clouds()[0].astype(np.float64)
    # All that is seen is of the robot: near its backbone, and not beyond a wall.
    discs = world.simulation.positions()[0]
    apart = np.linalg.norm(points[:, None] - discs[None], axis=2).min(axis=1)
    assert apart.max() < 0.04 and points[:, 0].min() > -0.031 and points[:, 0].max() < 0.036


@pytest.mark.parametrize(
    ("arguments", "error", "says"),
    [
        ({"scene": "shelf.toml"}, InputError, "scene"),
        ({"contact_cost": -1.0, "scene": SCENE}, InputError, "contact_cost is -1.0"),
        ({"contact_cost": 1.0}, InputError, "without a scene"),
        ({"contact_cost": 1.0, "scene": SCENE, "name": "ReachGoal2m"}, InputError, "one of goals alone"),
    ],
)
def test_what_makes_no_sense_is_refused(arguments: dict[str, Any], error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says):
        make(arguments.pop("name", "Reach2m"), **arguments)


def test_a_robot_that_starts_inside_an_obstacle_is_refused_by_name() -> None:
    ball = tdcr.Obstacle.sphere("ball", 0.05, position=(0.0, 0.0, 0.2))
    for dynamics in (False, True):
        with pytest.raises(ContactError, match='starts inside obstacle "ball"'):
            make(scene=tdcr.Scene([ball]), dynamics=dynamics).reset(seed=0)

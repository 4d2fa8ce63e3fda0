"""The environment Push, and objects among the robots of a batch."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import numpy as np
import pytest

import tdcr
from tdcr.errors import InputError

gymnasium = pytest.importorskip("gymnasium")

import tdcr.envs  # noqa: E402

pytestmark = pytest.mark.filterwarnings("error")

BASE, LENGTH = np.array([0.0, 0.0, 0.174]), 0.33595 - 0.174
ACTION = np.array([-0.2, -1.0, 0.7, 0.0, 0.2, 0.0])


def make(**arguments: Any) -> Any:
    return gymnasium.make("tdcr/Push2m-v0", **arguments).unwrapped


def place(env: Any, observation: Any) -> Any:
    return observation[env.layout["object"]].astype(np.float64) * LENGTH + BASE


def test_the_object_stands_where_it_is_drawn_until_the_robot_pushes_it() -> None:
    env = make(randomise={"bearing": (0.2, 0.2), "way": (0.1, 0.1), "turn": (0.3, 0.3)})
    observation, info = env.reset(seed=3)
    start, goal = place(env, observation), env.episodes.task.targets(0, 0)[0]
    assert abs(info["distance"] - 0.1 * LENGTH) < 1e-6 and not info["is_success"]
    assert abs(info["reward_distance"] + 0.1) < 1e-6 and info["reward_reach"] == pytest.approx(-info["gap"] / LENGTH)
    bearings = [np.arctan2(-way[0], way[1]) for way in (start, goal - start)]
    assert abs(abs(bearings[0]) - 0.2) < 1e-6 and abs(abs(bearings[1] - bearings[0]) - 0.3) < 1e-6
    # It rests on the table, and the goal is as high.
    observation, *_ = env.step(np.zeros(6))
    assert np.abs(place(env, observation) - start).max() < 1e-4 and abs(goal[2] - start[2]) < 1e-6
    gaps = []
    for _ in range(18):
        observation, reward, *_, info = env.step(push(env))
        gaps.append(info["gap"])
        assert reward == pytest.approx(-(info["distance"] + info["gap"]) / LENGTH)
    moved = info["object_position"] - start
    assert np.linalg.norm(moved) > 0.004 and np.abs(place(env, observation) - info["object_position"]).max() < 1e-6
    assert abs(info["distance"] - np.linalg.norm(info["object_position"] - goal)) < 1e-6 and min(gaps) < gaps[0]
    assert np.abs(observation[env.layout["object_velocity"]]).max() < 20.0


def push(env: Any) -> Any:
    """Towards a command under which the robot bends over the table."""
    action = (ACTION - env.episodes.world._shares()[0]) / 0.2
    return np.clip(action, -1.0, 1.0).astype(np.float32)


def test_seeds_vectors_and_copies_agree() -> None:
    arguments = {"episode_length": 30, "frame_skip": 5}
    one, several = make(**arguments), gymnasium.make_vec("tdcr/Push2m-v0", 2, **arguments)
    first, many = one.reset(seed=6), several.reset(seed=5)
    assert np.array_equal(first[0], many[0][1]) and not np.array_equal(many[0][0], many[0][1])
    for _ in range(20):
        action = push(one)
        observation, *_, info = one.step(action)
        others, *_, infos = several.step(np.stack([np.zeros(6, np.float32), action]))
        assert np.array_equal(observation, others[1]) and info["distance"] == infos["distance"][1]
    # Copies are in the same state, but begin rapier's search for the forces that hold an object anew.
    copies = [copy.deepcopy(one), pickle.loads(pickle.dumps(one))]
    assert all(np.array_equal(each.episodes.look()[0][0], observation) for each in copies)
    expected = place(one, one.step(push(one))[0])
    assert all(np.abs(place(each, each.step(push(each))[0]) - expected).max() < 0.003 for each in copies)


def test_objects_of_a_scene_go_along_with_copies_and_into_pictures() -> None:
    box = tdcr.Obstacle.box("box", (0.02, 0.02, 0.02), position=(0.06, 0.0, 0.3), mass=0.01, velocity=(1.0, 0.0, 0.0))
    env = gymnasium.make("tdcr/Reach2m-v0", dynamics=True, scene=tdcr.Scene([box]), render_mode="rgb_array").unwrapped
    env.reset(seed=0)
    before = env.render()
    env.step(np.zeros(6))
    objects = env.episodes.world.simulation.objects()
    assert objects.shape == (1, 1, 16) and abs(objects[0, 0, 0] - 0.1) < 1e-3
    other = copy.deepcopy(env)
    assert np.array_equal(other.episodes.world.simulation.objects(), objects)
    assert not np.array_equal(env.render(), before) and np.array_equal(other.render(), env.render())


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"dynamics": False}, "objects stand while robots settle; expected dynamics=True"),
        ({"randomise": {"way": (0.1, 0.6)}}, r"randomise\['way'\] is \(0.1, 0.6\); expected 0.5 lengths of the robot at most"),
        ({"randomise": {"turn": (0.0, 2.0)}}, r"randomise\['turn'\] is \(0.0, 2.0\); expected 0.7 rad at most"),
        ({"randomise": {"object_mass": (0.0, 0.1)}}, "expected masses above 0 kg"),
        ({"weights": {"angle": 1.0}}, "no term of Push's reward; expected 'distance', 'reach', 'change'"),
    ],
)
def test_what_makes_no_sense_is_refused(arguments: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        make(**arguments)


def test_robots_that_hang_are_refused() -> None:
    fields = tdcr.Robot("2m").to_dict()
    with pytest.raises(InputError, match=r"under the gravity \(0.0, 0.0, 9.81\) m/s²; .* expected a robot that stands upright"):
        make(robot={**fields, "gravity": [0.0, 0.0, 9.81]})

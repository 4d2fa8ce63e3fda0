"""Environments whose obstacles each episode draws: ReachObstacle and Insert."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import numpy as np
import pytest

import tdcr
from tdcr.errors import InputError

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import data_equivalence  # noqa: E402

import tdcr.envs  # noqa: E402

pytestmark = pytest.mark.filterwarnings("error")

BASE, LENGTH = np.array([0.0, 0.0, 0.174]), 0.33595 - 0.174


def make(name: str, **arguments: Any) -> Any:
    return gymnasium.make(f"tdcr/{name}-v0", **arguments).unwrapped


def episode(env: Any, seed: int, steps: int = 6) -> list[Any]:
    actions = np.random.default_rng(7).uniform(-1.0, 1.0, (steps, *env.action_space.shape)).astype(np.float32)
    return [env.reset(seed=seed), *(env.step(action) for action in actions)]


def test_a_tube_in_which_the_robot_does_not_settle_is_drawn_anew() -> None:
    env = make("Insert5m")
    # The first tube of this seed is one.
    observation, _ = env.reset(seed=229)
    assert env.observation_space.contains(observation)
    assert data_equivalence(observation, make("Insert5m").reset(seed=229)[0], exact=True)


@pytest.mark.parametrize("name", ["ReachObstacle2m", "Insert2m"])
def test_obstacles_follow_from_the_seed_and_copies_go_on_among_them(name: str) -> None:
    env, other = make(name), make(name)
    episode(other, 5)
    assert data_equivalence(episode(env, 3), episode(other, 3), exact=True)
    assert not data_equivalence(episode(env, 3)[0], episode(other, 4)[0], exact=True)
    env.reset(seed=8)
    for action in np.random.default_rng(1).uniform(-1.0, 1.0, (5, *env.action_space.shape)):
        env.step(action)
    copies = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    for action in np.random.default_rng(2).uniform(-1.0, 1.0, (5, *env.action_space.shape)):
        expected = env.step(action)
        assert all(data_equivalence(one.step(action), expected, exact=True) for one in copies)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("name", ["ReachObstacle2m", "Insert2m"])
def test_a_vector_is_its_environments_stepped_one_by_one(name: str, mode: str) -> None:
    arguments = {"episode_length": 3, "contact_cost": 0.1}
    own = gymnasium.make_vec(f"tdcr/{name}-v0", 3, autoreset_mode=mode, **arguments)
    one = [lambda: gymnasium.make(f"tdcr/{name}-v0", disable_env_checker=True, **arguments)] * 3
    each = gymnasium.vector.SyncVectorEnv(one, autoreset_mode=mode)
    seen = [(own.reset(seed=2), each.reset(seed=2))]
    rng = np.random.default_rng(0)
    for _ in range(8):
        actions = rng.uniform(-1.0, 1.0, own.action_space.shape).astype(np.float32)
        seen.append((own.step(actions), each.step(actions)))
    for (*mine, info), (*theirs, other) in seen:
        assert all(np.array_equal(a, b) for a, b in zip(mine, theirs, strict=True))
        assert all(np.array_equal(info[key], other[key]) for key in ("contact_force", "distance", "reward_contact"))


@pytest.mark.parametrize("dynamics", [False, True], ids=["rest", "motion"])
def test_balls_are_observed_where_the_robot_meets_them(dynamics: bool) -> None:
    env = make("ReachObstacle2m", dynamics=dynamics, obstacles=3)
    observation, info = env.reset(seed=7)
    balls = observation[env.layout["obstacles"]].reshape(3, 4).astype(np.float64)
    scene = env.episodes.world.scene_of(0)
    assert scene.names == ("ball 0", "ball 1", "ball 2")
    for ball, obstacle in zip(balls, scene.obstacles, strict=True):
        assert np.abs(ball[:3] * LENGTH + BASE - obstacle.position).max() < 1e-6
        assert abs(ball[3] * LENGTH - obstacle.size["radius"]) < 1e-7 and 0.08 <= ball[3] <= 0.2
    # What is touched is what the simulator finds there.
    touched = 0.0
    for action in np.random.default_rng(4).uniform(-1.0, 1.0, (25, 6)):
        *_, info = env.step(action)
        touched += info["contact_force"]
        if not dynamics and info["contacts"]:
            found = tdcr.settle("2m", env.episodes.world.commands[0], scene=scene)
            assert abs(np.linalg.norm(found.contacts.force, axis=1).sum() - info["contact_force"]) < 1e-4
    assert touched > 0.0


def test_goals_among_balls_are_where_the_robot_settles() -> None:
    env = make("ReachObstacle2m")
    for seed in range(8):
        observation, _ = env.reset(seed=seed)
        goal = observation[env.layout["goal"]][:3] * LENGTH + BASE
        scene = env.episodes.world.scene_of(0)
        assert all(np.linalg.norm(goal - ball.position) > ball.size["radius"] for ball in scene.obstacles)
    point = np.array([0.05, -0.02, 0.29])
    asked, _ = env.reset(seed=3, options={"goal": point})
    plain, _ = env.reset(seed=3)
    assert np.abs(asked[env.layout["goal"]][:3] * LENGTH + BASE - point).max() < 1e-7
    assert np.array_equal(asked[env.layout["obstacles"]], plain[env.layout["obstacles"]])


def test_obstacles_of_ones_own_stay_beside_those_that_are_drawn() -> None:
    floor = tdcr.Scene([tdcr.Obstacle.half_space("floor")]).with_self_contact(None)
    env = make("ReachObstacle2m", scene=floor, obstacles=1)
    env.reset(seed=0)
    scene = env.episodes.world.scene_of(0)
    assert scene.names == ("floor", "ball 0") and scene.self_contact is None


def pushed(env: Any, bent: float) -> tuple[list[float], dict[str, Any]]:
    """Pushes the robot into its tube while its distal module bends to the tube's side by a share of the commands' ranges, in
    proportion to the depth; the forces of the walls at each step (N), and what is told last."""
    world = env.episodes.world
    observation, info = env.reset(seed=0)
    side = observation[env.layout["goal"]].reshape(-1, 3)[-1, :2]
    side /= np.linalg.norm(side)
    low, high = world.robot.command_ranges.T
    pull = np.zeros(6)
    # Holes 0, 120 and 240 degrees about the axis: a shorter tendon bends the robot to its side.
    pull[3:] = [side @ (np.cos(turn), np.sin(turn)) for turn in np.deg2rad([0.0, 120.0, 240.0])]
    forces = []
    for _ in range(40):
        depth = max(info["depth"], 0.0) / (0.5 * LENGTH)
        asked = 0.5 * (low + high) - bent * depth * pull * (high - low)
        action = np.concatenate([(asked - world.commands[0, :6]) / (0.1 * (high - low)), [0.3]])
        _, _, _, truncated, info = env.step(action)
        forces.append(info["contact_force"])
        if truncated or info["is_success"]:
            break
    return forces, info


def test_a_robot_that_bends_along_a_tube_presses_its_walls_less_than_one_that_is_pushed() -> None:
    env = make("Insert2m", randomise={"bend": (1.5, 1.5)})
    limp, steered = (pushed(env, bent) for bent in (0.0, 0.3))
    for forces, info in (limp, steered):
        assert info["is_success"] and not info["simulation_failed"] and info["distance"] < 0.05 * LENGTH
        assert 0.4 * LENGTH < info["depth"] < 0.501 * LENGTH and max(forces) > 0.0
    assert max(steered[0]) < 0.5 * max(limp[0])


def test_the_base_moves_by_the_last_entry_of_an_action_and_the_robot_settles_there_in_the_tube() -> None:
    env = make("Insert2m", contact_cost=0.2)
    observation, info = env.reset(seed=2)
    world = env.episodes.world
    assert env.action_space.shape == (7,) and info["insertion"] == 0.0 and observation[env.layout["insertion"]] == -1.0
    tube = np.array(world.scene_of(0)["tube"].size["path"])
    points = observation[env.layout["goal"]].reshape(-1, 3) * LENGTH + BASE
    # The axis begins with 15 % of the robot in it, and its points are on the tube's.
    assert abs(points[0, 2] - (BASE[2] + 0.85 * LENGTH)) < 1e-6
    assert np.linalg.norm(points[:, None] - tube, axis=2).min(axis=1).max() < 0.01
    way = 0.0
    for action in np.random.default_rng(3).uniform(-0.3, 1.0, (6, 7)):
        observation, reward, _, _, info = env.step(action)
        way = np.clip(way + 0.1 * 0.6 * LENGTH * action[6], 0.0, 0.6 * LENGTH)
        assert abs(info["insertion"] - way) < 1e-12
        assert reward == pytest.approx(-info["distance"] / LENGTH - 0.2 * info["contact_force"], abs=1e-9)
        # The same robot with its base there settles so in the tube.
        moved = tdcr.Robot("2m").to_dict()
        moved["base"]["position"][2] += way
        near = tdcr.Settler(tdcr.Robot(moved), scene=world.scene_of(0))
        found = near.settle(world.commands[0, :6])
        assert np.abs(found.tip - (observation[env.layout["tip"]] * LENGTH + BASE)).max() < 2e-3
    assert way > 0.01


def test_a_tube_that_bends_too_much_for_its_width_is_refused() -> None:
    with pytest.raises(InputError, match=r"randomise\['bend'\] reaches 3.0 rad in a tube of 0.0260 m radius and 0.0810 m length"):
        make("Insert2m", randomise={"bend": (0.1, 3.0)})


def test_a_slender_robot_in_the_wall_of_a_bent_tube_is_refused_with_what_helps() -> None:
    env = make("Insert2m", robot="examples/three-segments.toml")
    with pytest.raises(InputError, match=r"starts inside obstacle \"tube\".* less of randomise\['bend'\], or more clearance"):
        env.reset(seed=0)
    make("Insert2m", robot="examples/three-segments.toml", randomise={"bend": (0.05, 0.2)}).reset(seed=0)


def test_names_of_a_tasks_own_obstacles_are_taken() -> None:
    scene = tdcr.Scene([tdcr.Obstacle.sphere("tube", 0.01, position=(1, 0, 0))])
    with pytest.raises(InputError, match="scene has an obstacle 'tube', as the task itself has; expected another name"):
        make("Insert2m", scene=scene).reset(seed=0)


@pytest.mark.parametrize("name", ["Reach2m", "Track2m"])
def test_steps_before_the_first_reset_are_refused(name: str) -> None:
    env = make(name)
    with pytest.raises(gymnasium.error.ResetNeeded, match="before the first reset"):
        env.step(env.action_space.sample())
    vector = gymnasium.make_vec(f"tdcr/{name}-v0", num_envs=2)
    with pytest.raises(gymnasium.error.ResetNeeded, match="before the first reset"):
        vector.step(vector.action_space.sample())
    env.reset(seed=0)
    copy.deepcopy(env).step(env.action_space.sample())

"""What episodes are asked for, what disturbs them, and what actions and rewards mean."""

from __future__ import annotations

import copy
import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tdcr
from tdcr.errors import InputError, ParameterError

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import check_env, data_equivalence  # noqa: E402

import tdcr.envs  # noqa: E402

pytestmark = pytest.mark.filterwarnings("error")

ELASTIC = str(Path(__file__).parents[3] / "examples" / "three-segments.toml")
BASE, LENGTH = np.array([0.0, 0.0, 0.174]), 0.33595 - 0.174


def make(name: str = "Reach2m", **arguments: Any) -> Any:
    return gymnasium.make(f"tdcr/{name}-v0", **arguments).unwrapped


def actions_of(env: Any, steps: int = 8, seed: int = 7) -> Any:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (steps, *env.action_space.shape)).astype(np.float32)


def test_starts_and_payloads_are_set_by_options() -> None:
    start = np.array([0.034, 0.007, 0.001, 0.026, 0.015, 0.019])
    for name in ("Reach2m", "ReachGoal2m", "Shape2m", "Payload2m", "Track2m"):
        env = make(name)
        env.reset(seed=1, options={"start": start, "payload": 0.02})
        world = env.episodes.world
        settled = tdcr.settle("2m", start, 0.02)
        assert np.abs(world.simulation.positions()[0] - settled.positions).max() < 1e-9
        # The payload stays until the next reset, which draws its own.
        env.step(np.zeros(6))
        assert np.abs(world.simulation.positions()[0] - settled.positions).max() < 1e-7
        env.reset(seed=1)
        assert world.payloads[0] != 0.02 and not np.array_equal(world.commands[0], start)
    vector = gymnasium.make_vec("tdcr/Reach2m-v0", 3)
    vector.reset(seed=0, options={"start": np.stack([start, start[::-1], start]), "payload": np.array([0.0, 0.01, 0.02])})
    world = vector.unwrapped.episodes.world
    assert world.payloads.tolist() == [0.0, 0.01, 0.02] and np.array_equal(world.commands[1], start[::-1])


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"start": np.zeros(5)}, r"options\['start'\] has shape \(5,\); expected \(6,\)"),
        ({"start": np.full(6, 0.05)}, r"options\['start'\] has 0\.05 as entry 0; expected 0 to 0\.04"),
        ({"payload": -0.1}, r"options\['payload'\] is -0\.1 kg; expected 0 or more"),
        ({"begin": np.zeros(6)}, "options has 'begin', which Reach does not take; expected 'goal', 'start', 'payload'"),
    ],
)
def test_options_that_make_no_sense_are_refused_by_name(options: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        make().reset(options=options)


def test_absolute_actions_are_commands_that_are_approached_within_the_rate() -> None:
    env = make(action="absolute", rate=0.25)
    check_env(env, skip_render_check=True)
    env.reset(seed=0)
    world = env.episodes.world
    ranges = world.robot.command_ranges
    for action in actions_of(env):
        before = world.commands[0].copy()
        asked = ranges[:, 0] + 0.5 * (action.astype(np.float64) + 1.0) * np.diff(ranges)[:, 0]
        env.step(action)
        assert np.abs(world.commands[0] - (before + np.clip(asked - before, -0.01, 0.01))).max() < 1e-12
    # Four steps are enough for any.
    for _ in range(4):
        env.step(action)
    assert np.abs(world.commands[0] - asked).max() < 1e-12


def test_tendons_are_driven_by_tensions_and_these_are_observed() -> None:
    env = make(robot=ELASTIC, tension_range=(0.0, 3.0), action="absolute", rate=1.0, observe_tensions=True)
    env.reset(seed=0)
    assert np.array_equal(env.episodes.world.robot.command_ranges, np.tile([0.0, 3.0], (9, 1)))
    for action in actions_of(env, 3):
        observation, *_ = env.step(action)
        tensions = observation[env.layout["tensions"]]
        assert np.abs(tensions - 1.5 * (action + 1.0)).max() < 1e-5
    assert env.layout["goal"].start == env.layout["tensions"].stop
    # Of a robot with springs they are those of its equilibrium.
    for dynamics in (False, True):
        env = make(observe_tensions=True, observation="tip", dynamics=dynamics)
        observation, _ = env.reset(seed=0)
        settled = tdcr.settle("2m", env.episodes.world.commands[0])
        assert np.abs(observation[env.layout["tensions"]] - settled.tensions).max() < 1e-4
        check_env(env, skip_render_check=True)


def test_noise_is_added_to_what_is_measured_and_to_nothing_else() -> None:
    plain, noisy = make(randomise={"noise": (0.0, 0.0)}), make(randomise={"noise": (0.01, 0.01)})
    differences = []
    for one, other in zip(run(plain), run(noisy), strict=True):
        layout = plain.layout
        for name in ("command", "goal"):
            assert np.array_equal(one[0][layout[name]], other[0][layout[name]])
        measured = slice(layout["command"].stop, layout["goal"].start)
        differences.append(other[0][measured] - one[0][measured])
        if len(one) > 2:
            assert one[1] == other[1]
        assert one[-1]["distance"] == other[-1]["distance"]
    found = np.concatenate(differences)
    assert 0.009 < found.std() < 0.011 and abs(found.mean()) < 1e-3
    assert len(np.unique(found)) > 0.9 * len(found)
    # Looking does not change it, nor does a copy.
    assert data_equivalence(run(noisy), run(make(randomise={"noise": (0.01, 0.01)})), exact=True)
    check_env(noisy, skip_render_check=True)


def run(env: Any, steps: int = 20) -> list[Any]:
    return [env.reset(seed=5), *(env.step(action) for action in actions_of(env, steps))]


def test_actions_arrive_late_by_the_steps_that_are_drawn() -> None:
    for action in ("increment", "absolute"):
        late = make(randomise={"delay": (3, 3)}, action=action)
        prompt = make(action=action)
        start = np.array([0.03, 0.01, 0.02, 0.01, 0.02, 0.03])
        for env in (late, prompt):
            env.reset(seed=0, options={"start": start})
        commands: dict[int, list[Any]] = {0: [], 1: []}
        for one in actions_of(late, 12):
            for k, env in enumerate((late, prompt)):
                env.step(one)
                commands[k].append(env.episodes.world.commands[0].copy())
        assert np.abs(np.array(commands[0][:3]) - start).max() < 1e-15
        assert np.abs(np.array(commands[0][3:]) - np.array(commands[1][:-3])).max() < 1e-15
    drawn = {make_delay(seed) for seed in range(30)}
    assert drawn == {1.0, 2.0, 3.0}


def make_delay(seed: int) -> float:
    env = make(randomise={"delay": (1, 3)})
    env.reset(seed=seed)
    return float(env.episodes.world.draws.values["delay"][0])


@pytest.mark.parametrize("dynamics", [False, True], ids=["rest", "motion"])
def test_a_disturbance_pulls_the_tip_with_the_force_that_is_drawn(dynamics: bool) -> None:
    env = make(randomise={"disturbance": (0.05, 0.1)}, dynamics=dynamics)
    env.reset(seed=4)
    world = env.episodes.world
    size = world.draws.values["disturbance"][0]
    assert 0.05 <= size <= 0.1
    settler = tdcr.Settler("2m")
    settler.settle(world.commands[0])
    forces = []
    for action in actions_of(env, 25):
        forces.append(world.draws.forces(world.steps)[0])
        env.step(action)
        if not dynamics:
            push = tdcr.Wrench(9, force=tuple(forces[-1]))
            settled = settler.follow(world.commands[0], tdcr.Loads(wrenches=(push,)))
            assert np.abs(world.simulation.positions()[0] - settled.positions).max() < 1e-9
    assert np.allclose(np.linalg.norm(forces, axis=1), size)
    # Held for ten steps.
    assert len(np.unique(np.round(forces, 12), axis=0)) == 3
    vector = gymnasium.make_vec("tdcr/Reach2m-v0", 2, randomise={"disturbance": (0.05, 0.1)}, dynamics=dynamics)
    vector.reset(seed=3)
    observation, *_ = vector.step(np.stack([actions_of(env, 1)[0]] * 2))
    env.reset(seed=4)
    assert np.array_equal(observation[1], env.step(actions_of(env, 1)[0])[0])


def test_terms_of_the_reward_are_told_and_weighted() -> None:
    plain, weighted = make("Shape2m"), make("Shape2m", weights={"angle": 0.25, "change": 0.1})
    for one, other in zip(run(plain), run(weighted), strict=True):
        told, same = one[-1], other[-1]
        assert same["reward_angle"] == 0.25 * told["reward_angle"] and same["reward_distance"] == told["reward_distance"]
        if len(one) > 2:
            assert one[1] == told["reward_distance"] + told["reward_angle"]
            assert other[1] == pytest.approx(same["reward_distance"] + same["reward_angle"] + same["reward_change"], abs=1e-15)
    env = make(weights={"change": 0.5}, rate=0.05)
    env.reset(seed=0, options={"start": np.full(6, 0.02)})
    action = np.array([1.0, -1.0, 0.5, 0.0, 0.0, 0.0])
    assert env.step(action)[-1]["reward_change"] == pytest.approx(-0.5 * np.mean(action**2))


def test_ranges_change_between_episodes() -> None:
    env = make("Payload2m", randomise={"gain[0]": (400.0, 500.0)})
    env.reset(seed=0)
    world = env.episodes.world
    assert 0.0 <= world.payloads[0] <= 0.03 and 400.0 <= world.robot_of(0).value("gain[0]") <= 500.0
    before = world.payloads[0]
    env.randomise({"payload": (0.04, 0.05), "damping[0]": (0.2, 0.3)})
    assert world.payloads[0] == before
    env.reset(seed=0)
    assert 0.04 <= world.payloads[0] <= 0.05
    assert 0.2 <= world.robot_of(0).value("damping[0]") <= 0.3 and 400.0 <= world.robot_of(0).value("gain[0]") <= 500.0
    env.randomise({"delay": (2, 2)})
    env.reset(seed=0)
    start = world.commands[0].copy()
    env.step(np.ones(6))
    assert np.array_equal(world.commands[0], start)
    with pytest.raises(ParameterError, match="colour"):
        env.randomise({"colour": (0, 1)})
    with pytest.raises(InputError, match=r"randomise\['bend'\] reaches 3"):
        make("Insert2m").randomise({"bend": (0.1, 3.0)})
    vector = gymnasium.make_vec("tdcr/Payload2m-v0", 4).unwrapped
    vector.randomise({"payload": (0.04, 0.05)})
    vector.reset(seed=0)
    assert (vector.episodes.world.payloads >= 0.04).all()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"action": "torque"}, "action is 'torque'; expected one of increment, absolute"),
        ({"tension_range": (3.0, 1.0)}, r"tension_range is \(3.0, 1.0\); expected 0 <= low < high"),
        ({"tension_range": 3.0}, r"tension_range is 3.0; expected \(low, high\)"),
        ({"observe_tensions": True, "observation": "cloud"}, "observe_tensions is of the observations 'state' and 'tip'"),
        ({"weights": {"angle": 1.0}}, "weights has 'angle', which is no term of Reach's reward; expected 'distance', 'change'"),
        ({"weights": 3}, "weights is 3; expected a dictionary"),
        ({"weights": {"goal": 2.0}, "name": "ReachGoal2m"}, "weights is .* with ReachGoal, whose reward is one of goals alone"),
        ({"randomise": {"delay": (0.5, 2)}}, r"randomise\['delay'\] is \(0.5, 2.0\); expected whole numbers of steps"),
        ({"randomise": {"noise": (-1, 0)}}, "expected values of 0 or more"),
        ({"randomise": {"bend": (0.1, 0.2)}}, "bend"),
        (
            {"name": "Insert2m", "dynamics": True},
            "the task moves the base, which stands while a robot moves in time",
        ),
        ({"name": "Insert2m", "depth": 2.0}, "depth is 2.0; expected lengths of the robot above 0, 0.6 at most"),
        ({"name": "Insert2m", "clearance": 0.0}, "clearance is 0.0; expected a share"),
        ({"name": "ReachObstacle2m", "obstacles": 0}, "obstacles is 0"),
        ({"name": "ReachObstacle2m", "randomise": {"ball_radius": (0.0, 0.1)}}, "ball_radius"),
    ],
)
def test_what_makes_no_sense_is_refused(arguments: dict[str, Any], says: str) -> None:
    with pytest.raises((InputError, ParameterError), match=says):
        make(arguments.pop("name", "Reach2m"), **arguments)


def test_a_rig_has_no_ranges_and_takes_no_starts() -> None:
    rig = str(Path(__file__).parents[3] / "examples" / "rig-sim.toml")
    env = make(rig=rig, observation="tip")
    with pytest.raises(InputError, match="ranges are of simulated robots"):
        env.randomise({"payload": (0.0, 0.01)})
    with pytest.raises(InputError, match="options has 'start', which Reach does not take; expected 'goal'"):
        env.reset(options={"start": np.zeros(6)})
    with pytest.raises(InputError, match="surroundings stay as they are"):
        make("ReachObstacle2m", rig=rig, observation="tip")


def test_copies_have_their_late_servos_where_they_are(tmp_path: Path) -> None:
    spec = tdcr.Robot("2m").to_dict()
    for module in spec["modules"]:
        module["tendons"]["servo"] = {"lag": 0.2}
    file = tmp_path / "late.json"
    file.write_text(json.dumps(spec))
    env = make(robot=str(file), dynamics=True)
    # A copy before the first reset has no time yet.
    fresh = copy.deepcopy(env)
    for one in (env, fresh):
        one.reset(seed=1)
        one.step(np.ones(6))
    for other in (copy.deepcopy(env), pickle.loads(pickle.dumps(env)), fresh):
        expected = copy.deepcopy(env)
        for action in actions_of(env):
            assert data_equivalence(other.step(action), expected.step(action), exact=True)

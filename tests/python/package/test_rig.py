"""Rigs in memory from Python: the same calls as on the desk."""

from __future__ import annotations

import shutil
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import tdcr
import tdcr.envs
from tdcr.rig import Silence, WinchState

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
RIG = EXAMPLES / "rig-sim.toml"


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example's rig with smaller pictures."""
    text = RIG.read_text().replace("resolution = [640, 480]", "resolution = [320, 240]")
    path = tmp_path_factory.mktemp("rig") / "rig.toml"
    path.write_text(text)
    shutil.copy(EXAMPLES / "paper-robot.toml", path.parent)
    return path


def test_a_rig_moves_and_measures_its_tip(small: Path) -> None:
    with tdcr.Rig(small) as rig:
        assert rig.ids == [1, 2, 3, 4, 5, 6] and len(rig.cameras) == 4
        assert rig.homing() == ["homed"] * 6 and not rig.engaged and rig.commanded is None
        rig.engage()
        command = rig.draw(seed=3)
        rig.move_to(command)
        for _ in range(20):
            states = rig.step(command)
        assert all(isinstance(state, WinchState) for state in states)
        # To a tick, which is 8 um of tendon; servos under load stay some ticks behind.
        commanded = rig.commanded
        assert commanded is not None
        np.testing.assert_allclose(commanded, command, atol=1e-5)
        settled = tdcr.settle(rig.robot, [state.command for state in states if isinstance(state, WinchState)])
        measured = rig.measure()
        assert np.linalg.norm(measured.tip - settled.tip) < 0.005
        assert measured.axis @ measured.axis == pytest.approx(1.0)
        assert len(measured.cloud) > 500 and measured.pictures.skew < 0.04
        assert np.degrees(np.arccos(measured.axis[2])) > 10.0
    assert not rig.engaged


def test_what_a_rig_refuses_is_an_error_that_says_why(small: Path, tmp_path: Path) -> None:
    with pytest.raises(tdcr.errors.RigError, match="no-such"):
        tdcr.Rig(tmp_path / "no-such.toml")
    rig = tdcr.Rig(small)
    with pytest.raises(tdcr.errors.RigError):
        rig.step(rig.draw(seed=1))
    with pytest.raises(tdcr.errors.InputError, match="command"):
        rig.goals([0.0])
    low, high = rig.tension
    assert 0.0 <= low < high
    assert not rig.within_limits(rig.robot.command_ranges[:, 1] - 1e-9)


def test_states_of_servos_that_are_not_homed_say_so(small: Path, tmp_path: Path) -> None:
    rig = tdcr.Rig(small)
    assert not any(isinstance(state, Silence) for state in rig.state())


def test_a_capture_is_a_data_set_and_grows(small: Path, tmp_path: Path) -> None:
    rig, out, seen = tdcr.Rig(small), tmp_path / "data", list[int]()
    report = rig.capture(out, commands=10, points=500, sentinel_every=5, progress=seen.append)
    assert (report.samples, report.captured, sum(seen)) == (10, 10, 10)
    assert report.drift < 0.005 and len(report.data) == 10
    again = tdcr.Rig(small).capture(out, commands=12, points=500, sentinel_every=5)
    # The last, unfinished block of samples is captured again.
    assert again.samples == 12 and 2 <= again.captured < 10


def test_an_environment_on_a_rig_reaches_what_its_actions_lead_to(small: Path) -> None:
    env = gymnasium.make("tdcr/ReachGoal2m-v0", rig=small, observation="tip", max_episode_steps=None)
    first, _ = env.reset(seed=1)
    home = first["achieved_goal"].copy()
    # Pulls the tendons of one side, and lets the others out.
    action = np.array([-0.2, 0.1, 0.1, -0.2, 0.1, 0.1], dtype=np.float32)
    for _ in range(3):
        observation, reward, terminated, truncated, info = env.step(action)
        assert env.observation_space.contains(observation) and not terminated and not truncated
        assert reward in (0.0, -1.0) and info["distance"] > 0.0
    moved = np.linalg.norm(observation["achieved_goal"] - home)
    assert 0.01 < moved < 1.0
    # A reset forgets it.
    again, _ = env.reset(seed=1)
    np.testing.assert_array_equal(again["desired_goal"], first["desired_goal"])
    assert np.linalg.norm(again["achieved_goal"] - home) < 0.03
    env.close()


def test_environments_on_rigs_refuse_what_cameras_do_not_tell(small: Path) -> None:
    for arguments, message in [
        ({"observation": "state"}, "expected 'tip' or 'cloud'"),
        ({"observation": "tip", "dynamics": True}, "expected neither with a rig"),
        ({"observation": "tip", "robot": "3m"}, "the rig has 6 tendons; expected 9"),
    ]:
        with pytest.raises(tdcr.errors.InputError, match=message):
            gymnasium.make("tdcr/Reach2m-v0", rig=small, **arguments)
    with pytest.raises(tdcr.errors.InputError, match="expected a task of reaching"):
        gymnasium.make("tdcr/Track2m-v0", rig=small, observation="tip")

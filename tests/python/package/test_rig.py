"""Rigs in memory from Python: the same calls as on the desk."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

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


def test_a_tip_is_steered_by_the_model(small: Path) -> None:
    rig = tdcr.Rig(small)
    with pytest.raises(tdcr.errors.RigError, match="the motors are off"):
        rig.steer([0.01, 0.0, 0.0])
    rig.engage()
    before = rig.commanded
    by = np.array([0.01, -0.004, -0.002])
    command = rig.steer(by)
    moved = tdcr.settle(rig.robot, command).tip - tdcr.settle(rig.robot, before).tip
    np.testing.assert_allclose(moved, by, atol=2e-5)
    rig.move_to(command)
    with pytest.raises(tdcr.errors.RigError, match="m short of what is wanted"):
        rig.steer([0.0, 0.0, 0.3])
    with pytest.raises(tdcr.errors.InputError, match="by has shape"):
        rig.steer([0.01])
    rig.release()


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
    assert report.log == out / "log.mcap" and report.log.exists()
    again = tdcr.Rig(small).capture(out, commands=12, points=500, sentinel_every=5, log=False)
    assert again.log is None and (again.rested, again.recalled) == (0.0, 0)
    assert (again.samples, again.captured) == (12, 2)


def test_own_commands_are_captured_and_repeated(small: Path, tmp_path: Path) -> None:
    rig, out = tdcr.Rig(small), tmp_path / "data"
    commands = np.stack([rig.draw(seed=1), rig.draw(seed=2)])
    report = rig.capture(out, commands=commands, repeat=2, points=200, log=False)
    assert (report.samples, report.captured) == (4, 4)
    assert report.repeatability is not None and 0.0 < report.repeatability < 5e-3
    with pytest.raises(tdcr.errors.InputError, match=r"shape \(6,\)"):
        rig.capture(out, commands=commands[0])
    commands[1, 4] += 2e-3
    with pytest.raises(tdcr.errors.InputError, match=r"command 1 of those given: tendon \d would have"):
        rig.capture(tmp_path / "other", commands=commands)
    assert not (tmp_path / "other").exists()


def test_payloads_are_hung_one_after_another(small: Path, tmp_path: Path) -> None:
    first, asked = tmp_path / "first", list[float]()
    options: dict[str, Any] = {"commands": 2, "payloads": [0.1, 0.3], "points": 200}
    report = tdcr.Rig(small).capture(first, **options, hang=asked.append)
    assert report.samples == 4 and report.log is not None and asked == []
    assert sorted(sample.condition[-1] for sample in report.data) == [np.float32(mass) for mass in (0.1, 0.1, 0.3, 0.3)]
    assert report.data.payload == (0.1, 0.3) and report.data.condition_units == ("m",) * 6 + ("kg",)
    # What was recorded is not at hand, so somebody has to say that payloads hang.
    recorded = small.with_name("recorded.toml")
    recorded.write_text(small.read_text().replace('link = "simulated"', f'link = {{ recorded = "{report.log}" }}'))
    with pytest.raises(tdcr.errors.RigError, match=r"nobody says that 0\.1 kg hang at the tip.*give hang"):
        tdcr.Rig(recorded).capture(tmp_path / "unasked", **options, log=False)

    def refuse(payload: float) -> None:
        raise OSError(f"no {payload} kg")

    with pytest.raises(OSError, match=r"no 0\.1 kg"):
        tdcr.Rig(recorded).capture(tmp_path / "raised", **options, log=False, hang=refuse)
    rig = tdcr.Rig(recorded)

    def look(payload: float) -> None:
        rig.state()

    # Who hangs it would wait for himself.
    with pytest.raises(tdcr.errors.RigError, match="waits for hang to return"):
        rig.capture(tmp_path / "looked", **options, log=False, hang=look)
    assert (rig.slew, rig.period) == (0.02, 0.05)
    again = tdcr.Rig(recorded).capture(tmp_path / "again", **options, log=False, hang=asked.append)
    assert asked == [0.1, 0.3] and again.captured == 4
    for payloads, reason in [([0.1, 0.1], "0.1 kg twice"), ([0.0], "0 kg alone"), ([-1.0], "-1 kg"), ([[0.1]], "shape")]:
        with pytest.raises(tdcr.errors.InputError, match=reason):
            tdcr.Rig(small).capture(tmp_path / "wrong", payloads=payloads)


def test_the_empty_scene_is_what_masks_tell_a_robot_from(small: Path, tmp_path: Path) -> None:
    rig, seen = tmp_path / "rig.toml", list[int]()
    shutil.copy(EXAMPLES / "paper-robot.toml", tmp_path)
    log = tdcr.rig.record_background(small, tmp_path / "empty.mcap", pictures=6, progress=seen.append)
    assert log.exists() and sum(seen) == 6
    with pytest.raises(tdcr.errors.RigError, match=r"empty\.mcap"):
        tdcr.rig.record_background(small, log)
    with pytest.raises(tdcr.errors.InputError, match="pictures"):
        tdcr.rig.record_background(small, log, pictures=2)
    masks = 'background = { log = "empty.mcap" }\ncomponents = { pixels = 50, gap = 2 }'
    text = small.read_text()
    start, end = text.index("box = "), text.index("[simulation]")
    rig.write_text(f"{text[:start]}{masks}\n{text[end:]}")
    points = tdcr.Rig(rig).cloud().points
    by_box = tdcr.Rig(small).cloud().points
    assert len(points) > 0.9 * len(by_box)
    assert np.mean(np.linalg.norm(points[:, :2], axis=1) < 0.05) > 0.9
    log.unlink()
    with pytest.raises(tdcr.errors.RigError, match=r"rig\.toml:\d+: masks\.background\.log"):
        tdcr.Rig(rig).cloud()


def test_masks_of_another_program_are_asked_for_before_anything_moves(small: Path, tmp_path: Path) -> None:
    with pytest.raises(tdcr.errors.RigError, match=r"camera0/000000\.png"):
        tdcr.Rig(small).capture(tmp_path / "data", commands=10, points=500, masks=tmp_path / "masks")


def test_the_example_runs_on_the_rig_of_a_file(small: Path) -> None:
    command = [sys.executable, EXAMPLES / "python/rig.py", small]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    found = [
        re.search(r"at +(\d+) degrees: .*tip at \(([-\d.]+), ([-\d.]+), [-\d.]+\) mm, ([\d.]+) mm off", line) for line in lines
    ]
    sides = [(int(m[1]), float(m[2]), float(m[3]), float(m[4])) for m in found if m is not None]
    assert [degrees for degrees, *_ in sides] == [0, 120, 240]
    for degrees, x, y, off in sides:
        # Bent by tens of millimetres towards the tendon that was wound up, and seen where it is.
        toward = np.radians(degrees)
        assert x * np.cos(toward) + y * np.sin(toward) > 10.0 and off < 5.0


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


#: What a process ends with that was told to by a signal, or by nobody.
ENDS = {
    **{
        name: 128 + getattr(signal, name) for name in ("SIGTERM", "SIGHUP", "SIGQUIT", "SIGALRM", "SIGUSR1", "SIGUSR2", "SIGXCPU")
    },
    **{name: 128 + getattr(signal, name) for name in ("SIGTSTP", "SIGTTIN", "SIGTTOU")},
    "SIGINT": -2,
    "raise": 1,
    "nothing": 0,
}


@pytest.mark.parametrize("end", ENDS)
def test_a_process_that_ends_lets_go_of_its_rig(small: Path, end: str) -> None:
    """However it ends, and without a ``with`` block: what was registered first at the exit of a process comes last."""
    script = """
import atexit, sys, time
atexit.register(lambda: print("engaged", rig.engaged, flush=True))
import tdcr
rig = tdcr.Rig(sys.argv[1])
rig.engage()
print("on", rig.engaged, flush=True)
if sys.argv[2] == "raise":
    raise ValueError("on purpose")
if sys.argv[2] != "nothing":
    time.sleep(60)
"""
    process = subprocess.Popen(
        [sys.executable, "-c", script, str(small), end], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None and process.stderr is not None
    assert process.stdout.readline() == "on True\n"
    if end.startswith("SIG"):
        process.send_signal(getattr(signal, end))
    # Not ``communicate``: it loses what ``readline`` has read ahead.
    process.wait(timeout=30)
    said, complaint = process.stdout.read(), process.stderr.read()
    assert said == "engaged False\n", complaint
    assert process.returncode == ENDS[end], complaint
    assert ("motors are on" in complaint) == (end == "SIGTSTP")


def test_a_process_whose_motors_are_off_is_stopped_as_any_other(small: Path) -> None:
    script = """
import sys, time
import tdcr
rig = tdcr.Rig(sys.argv[1])
rig.engage()
rig.release()
print("off", flush=True)
time.sleep(60)
"""
    process = subprocess.Popen([sys.executable, "-c", script, str(small)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "off\n"
    process.send_signal(signal.SIGTSTP)
    _, status = os.waitpid(process.pid, os.WUNTRACED)
    assert os.WIFSTOPPED(status)
    process.send_signal(signal.SIGCONT)
    process.terminate()
    assert process.wait(timeout=30) == 143


def test_what_is_passed_over_in_the_robots_file_is_warned_of(tmp_path: Path) -> None:
    folder = Path(__file__).resolve().parents[2] / "cli" / "notes"
    for name in ("rig.toml", "robot.xml"):
        shutil.copy(folder / name, tmp_path)
    with pytest.warns(UserWarning, match=r"rig\.toml: .*a command is the rest length \(m\), 0\.75 ctrl") as warned:
        rig = tdcr.Rig(tmp_path / "rig.toml")
    assert len(warned) == len(rig.robot.notes) > 0
    with pytest.warns(UserWarning, match="0.75 ctrl"):
        tdcr.rig.record_background(tmp_path / "rig.toml", tmp_path / "empty.mcap", pictures=5)
    with pytest.warns(UserWarning, match="0.75 ctrl"):
        study = {"robot": str(tmp_path / "robot.xml"), "want": ["tip"], "vary": [{"what": "payload", "values": [0.0]}]}
        tdcr.study(study, tmp_path / "study")


def test_a_fork_ends_when_told_as_if_there_were_no_rig(small: Path) -> None:
    script = """
import os, signal, sys, time
import tdcr
rig = tdcr.Rig(sys.argv[1])
child = os.fork()
if child == 0:
    try:
        time.sleep(60)
    finally:
        os._exit(1)
time.sleep(0.2)
os.kill(child, signal.SIGTERM)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
    done = subprocess.run([sys.executable, "-c", script, str(small)], capture_output=True, text=True, timeout=30)
    assert done.stdout == f"{-signal.SIGTERM}\n", done.stderr


def test_two_commands_are_a_data_set(small: Path, tmp_path: Path) -> None:
    with tdcr.Rig(small) as rig:
        report = rig.capture(tmp_path / "two", commands=2, points=200, log=False)
    assert report.captured == 2 and report.data.robot is not None
    assert [len(report.data.split(name)) for name in ("train", "val", "test")] == [1, 0, 1]

"""Data sets of LeRobot: what is handed to its writer, by a stand-in, and what its own loader reads, where it is installed."""

from __future__ import annotations

import importlib.metadata
import json
import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from by_command_line import TDCR

import tdcr
import tdcr.lerobot as lerobot
from tdcr._recorded import Channels, Message
from tdcr.errors import DataError, InputError, MissingPackageError

SAMPLE = Path(__file__).parents[3] / "hw/tests/data/sample.mcap"
FIELDS = tdcr.Robot("2m").to_dict()
ROBOT = tdcr.Robot(FIELDS | {"cameras": FIELDS["cameras"] | {"count": 2, "resolution": [96, 64]}})


def installed(distribution: str) -> bool:
    try:
        importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


class Writer:
    """LeRobot's writer: keeps what it is given, and makes the folder."""

    made: list[Writer] = []

    @classmethod
    def create(cls, repo_id: str, fps: int, features: dict[str, Any], root: Path, **options: Any) -> Writer:
        writer = cls()
        root.mkdir()
        (root / "info.json").write_text(json.dumps({"fps": fps, "repo_id": repo_id}))
        writer.features, writer.options = features, options
        writer.frames, writer.episodes = [], []
        cls.made.append(writer)
        return writer

    features: dict[str, Any]
    options: dict[str, Any]
    frames: list[dict[str, Any]]
    episodes: list[list[dict[str, Any]]]

    def add_frame(self, frame: dict[str, Any]) -> None:
        for name, feature in self.features.items():
            assert np.shape(frame[name]) == feature["shape"], name
        assert frame.keys() == self.features.keys() | {"task"}
        self.frames.append(frame)

    def save_episode(self) -> None:
        self.episodes.append(self.frames)
        self.frames = []

    def finalize(self) -> None:
        pass


@pytest.fixture
def writer(monkeypatch: pytest.MonkeyPatch) -> list[Writer]:
    """What is written, in place of LeRobot."""
    module = ModuleType("lerobot.datasets.lerobot_dataset")
    vars(module).update(LeRobotDataset=Writer, LeRobotDatasetMetadata=type("Metadata", (), {"depth_keys": ()}))
    for name, stand_in in (("lerobot", ModuleType("lerobot")), ("lerobot.datasets", ModuleType("lerobot.datasets"))):
        monkeypatch.setitem(sys.modules, name, stand_in)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    Writer.made = []
    return Writer.made


def test_frames_have_what_was_known_last() -> None:
    channels = Channels(("servo_1", "servo_2"), 1, {}, {})
    messages: list[Message] = [
        (0.00, "command", [1.0]),
        (0.1, "positions", {"servo_1": 0.1}),
        (0.25, "positions", {"servo_2": 0.2}),
        (0.3, "unknown_camera", None),
        (0.4, "command", [2.0]),
        # Exactly at the time of a frame.
        (0.75, "positions", {"servo_1": 0.3}),
        (1.1, "command", [3.0]),
    ]
    frames = list(lerobot._resampled(iter(messages), channels, 4))
    assert [frame["action"].item() for frame in frames] == [1.0, 2.0, 2.0, 2.0]
    np.testing.assert_allclose([frame["observation.state"] for frame in frames], [[0.1, 0.2]] * 2 + [[0.3, 0.2]] * 2)


def test_a_log_is_an_episode(tmp_path: Path, writer: list[Writer]) -> None:
    pytest.importorskip("mcap_protobuf")
    lerobot.export_logs([SAMPLE], tmp_path / "data", fps=1000, task="bend", videos=False, depth=True)
    (made,) = writer
    assert json.loads((tmp_path / "data/info.json").read_text())["fps"] == 1000
    assert [file.name for file in tmp_path.iterdir()] == ["data"]
    assert made.features["observation.state"]["names"] == ["servo_1.pos", "servo_2.pos", "servo_3.pos"]
    assert made.features["action"]["names"] == ["tendon0.pos", "tendon1.pos", "tendon2.pos"]
    assert made.features["observation.images.0123"]["dtype"] == "image" and not made.options["use_videos"]
    assert made.features["observation.images.0123_depth"]["info"] == {"is_depth_map": True}
    (frames,) = made.episodes
    assert frames[0]["task"] == "bend" and len(frames) > 3
    np.testing.assert_array_equal(frames[-1]["action"], np.array([0.1 + 0.2, -0.0, 1e-17], np.float32))
    assert frames[-1]["observation.state"][2] == np.float32(6789 * 2 * np.pi / 4096)
    assert frames[-1]["observation.images.0123"].dtype == np.uint8


def test_a_motion_pairs_each_state_with_the_next_command(tmp_path: Path, writer: list[Writer]) -> None:
    commands = ROBOT.random_commands(4, seed=2)
    motion = tdcr.simulate(ROBOT, commands, frame_skip=50)
    lerobot.export_motions(ROBOT, [(commands, motion)] * 2, tmp_path / "data", cameras=[1], task="move")
    (made,) = writer
    assert json.loads((tmp_path / "data/info.json").read_text())["fps"] == 10
    assert len(made.episodes) == 2 and len(made.episodes[0]) == 3
    for k, frame in enumerate(made.episodes[1]):
        np.testing.assert_array_equal(frame["action"], commands[k + 1].astype(np.float32))
        np.testing.assert_allclose(frame["observation.state"], [*motion.lengths[k], *motion.tip[k]], rtol=1e-6)
        seen = tdcr.render(ROBOT, motion.configuration[k])[1].color
        np.testing.assert_array_equal(frame["observation.images.camera1"], seen)
    names = made.features["observation.state"]["names"]
    assert names[5:7] == ["tendon5.length", "tip.x"] and "observation.images.camera0" not in made.features


def test_commands_are_simulated_a_row_a_frame(tmp_path: Path, writer: list[Writer]) -> None:
    commands = ROBOT.random_commands(4, seed=2)
    lerobot.export_commands(ROBOT, [commands, commands[:3]], tmp_path / "data", fps=30, cameras=[])
    (made,) = writer
    assert json.loads((tmp_path / "data/info.json").read_text())["fps"] == 30 and len(made.episodes[1]) == 2
    # Steps of 2 ms do not fit into a frame: 17 shorter ones do.
    motion = tdcr.simulate(ROBOT, commands, dt=1.0 / 510.0, frame_skip=17)
    for k, frame in enumerate(made.episodes[0]):
        np.testing.assert_allclose(frame["observation.state"], [*motion.lengths[k], *motion.tip[k]], rtol=1e-6)


def test_what_is_no_data_set_leaves_nothing(tmp_path: Path, writer: list[Writer], monkeypatch: pytest.MonkeyPatch) -> None:
    commands = ROBOT.random_commands(3)
    motion = tdcr.simulate(ROBOT, commands, frame_skip=50)
    odd = tdcr.simulate(ROBOT, commands, dt=0.0013)
    out = tmp_path / "data"
    cases: tuple[tuple[str, list[Any], dict[str, Any]], ...] = (
        ("episodes is empty", [], {}),
        (r"episodes\[0\] is Motion; expected a pair", [motion], {}),
        ("769.231 frames per second", [(commands, odd)], {}),
        ("the same in all", [(commands, motion), (commands, tdcr.simulate(ROBOT, commands))], {}),
        ("camera 2; the robot has 2 cameras", [(commands, motion)], {"cameras": [2]}),
    )
    for message, episodes, options in cases:
        with pytest.raises(InputError, match=message):
            lerobot.export_motions(ROBOT, episodes, out, **options)
    not_a_log = tmp_path / "log.mcap"
    not_a_log.write_bytes(b"MCAP?")
    with pytest.raises(DataError, match="log.mcap: not the log of a rig"):
        lerobot.export_logs([not_a_log], out)
    with pytest.raises(DataError, match="is there already"):
        lerobot.export_motions(ROBOT, [(commands, motion)], tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["log.mcap"]
    monkeypatch.setattr(sys.modules["lerobot.datasets.lerobot_dataset"], "LeRobotDatasetMetadata", object)
    with pytest.raises(MissingPackageError, match="no depth"):
        lerobot.export_motions(ROBOT, [(commands, motion)], out, depth=True)
    monkeypatch.setitem(sys.modules, "lerobot.datasets.lerobot_dataset", None)
    with pytest.raises(MissingPackageError, match="needs LeRobot"):
        lerobot.export_motions(ROBOT, [(commands, motion)], out)


STAND_IN = """
    import json, os, time

    class LeRobotDatasetMetadata:
        depth_keys = ()

    class LeRobotDataset:
        @classmethod
        def create(cls, repo_id, fps, features, root, **options):
            made = cls()
            root.mkdir()
            made.root, made.found, made.frames = root, {"repo_id": repo_id, "fps": fps, "features": list(features)}, []
            made.episodes = []
            return made

        def add_frame(self, frame):
            self.frames.append(frame["action"].tolist())
            if frame["task"] == "wait":
                print("waiting", flush=True)
                time.sleep(60)

        def save_episode(self):
            self.episodes.append(self.frames)
            self.frames = []

        def finalize(self):
            (self.root / "info.json").write_text(json.dumps(self.found | {"episodes": self.episodes}))
"""
"""LeRobot's writer, in a process of its own."""


@pytest.fixture
def by_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to run the command line in, which finds the stand-in."""
    package = tmp_path / "site/lerobot/datasets"
    package.mkdir(parents=True)
    for folder in (package, package.parent):
        (folder / "__init__.py").touch()
    (package / "lerobot_dataset.py").write_text(textwrap.dedent(STAND_IN))
    path = [str(tmp_path / "site"), str(Path(tdcr.__file__).parents[1])]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(path))
    monkeypatch.setenv("TDCR_PYTHON", sys.executable)
    # Not the package, though it has its name.
    (tmp_path / "run/tdcr").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "run")
    return tmp_path / "run"


def export(front: list[str], *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [*front, "data", "export", "--format", "lerobot", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)


def test_the_command_line_exports_logs_and_commands(by_command: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mcap_protobuf")
    log = export([str(TDCR)], SAMPLE, "--out", "recorded", "--fps", 1000)
    assert (log.returncode, log.stdout) == (0, "recorded: 1 episode\n"), log.stderr
    assert f"INFO export: {SAMPLE}: " in log.stderr
    recorded = json.loads((by_command / "recorded/info.json").read_text())
    assert (recorded["repo_id"], recorded["fps"]) == ("tdcr/recorded", 1000) and len(recorded["episodes"]) == 1

    # By pip's command, whose own interpreter it is.
    monkeypatch.delenv("TDCR_PYTHON")
    commands = [ROBOT.random_commands(count, seed=count) for count in (4, 3)]
    for k, table in enumerate(commands):
        np.savetxt(f"{k}.csv", table, delimiter=",", fmt="%.17g")
    options = ["--robot", "2m", "--fps", 30, "--cameras", "none", "--json", "--quiet"]
    made = export([sys.executable, "-m", "tdcr"], "0.csv", "1.csv", "--out", "simulated", *options)
    assert made.returncode == 0 and not made.stderr, made.stderr
    assert json.loads(made.stdout) == {"dir": "simulated", "episodes": 2}
    simulated = json.loads((by_command / "simulated/info.json").read_text())
    assert (simulated["repo_id"], simulated["fps"]) == ("tdcr/simulated", 30)
    assert simulated["features"] == ["observation.state", "action"]
    for frames, table in zip(simulated["episodes"], commands, strict=True):
        np.testing.assert_array_equal(frames, table[1:].astype(np.float32))

    again = export([sys.executable, "-m", "tdcr"], "0.csv", "--out", "simulated", "--robot", "2m")
    assert again.returncode == 1 and "simulated is there already; expected none" in again.stderr


def test_an_export_that_ends_early_leaves_nothing(by_command: Path) -> None:
    pytest.importorskip("mcap_protobuf")
    options = ["--format", "lerobot", "--out", "data", "--fps", "1000", "--task", "wait"]
    command = [str(TDCR), "data", "export", str(SAMPLE), *options]
    for number in (signal.SIGINT, signal.SIGTERM):
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
            assert running.stdout is not None and running.stderr is not None
            assert running.stdout.readline() == "waiting\n"
            running.send_signal(number)
            assert running.stderr.read() == "error: interrupted\n"
            assert running.wait(timeout=60.0) == 130
    assert [file.name for file in by_command.iterdir()] == ["tdcr"]


def test_the_command_line_says_what_is_missing(by_command: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bare = by_command / "bare"
    bare.write_text(f'#!/bin/sh\nexec "{sys.executable}" -I -S "$@"\n')
    bare.chmod(0o755)
    cases = [(bare, "cannot import (No module named 'tdcr')"), (by_command / "none", "cannot run ")]
    for python, expected in cases:
        monkeypatch.setenv("TDCR_PYTHON", str(python))
        said = export([str(TDCR)], SAMPLE, "--out", "data")
        assert said.returncode == 1 and expected in said.stderr and "pip install 'tdcr[lerobot]'" in said.stderr, said.stderr
    monkeypatch.setenv("TDCR_PYTHON", sys.executable)
    (by_command.parent / "site/lerobot/__init__.py").write_text("raise ImportError('no torch')")
    said = export([str(TDCR)], SAMPLE, "--out", "data")
    assert said.returncode == 1 and "cannot be imported (no torch): pip install 'lerobot[dataset]'" in said.stderr


@pytest.mark.skipif(not installed("lerobot"), reason="LeRobot reads its data sets")
def test_lerobot_loads_what_is_written(tmp_path: Path) -> None:
    from lerobot.datasets.lerobot_dataset import LeRobotDataset, LeRobotDatasetMetadata

    commands = ROBOT.random_commands(6, seed=2)
    motion = tdcr.simulate(ROBOT, commands, frame_skip=50)
    has_depth = hasattr(LeRobotDatasetMetadata, "depth_keys")
    # Older ones read videos by what newer torchvision has no more.
    options: dict[str, Any] = {"videos": has_depth, "depth": has_depth, "repo_id": "tdcr/test", "task": "move"}
    episodes = [(commands, motion), (commands[:4], motion_until(motion, 4))]
    folder = lerobot.export_motions(ROBOT, episodes, tmp_path / "data", **options)
    metres = {"depth_output_unit": "m"} if has_depth else {}
    data = LeRobotDataset("tdcr/test", root=folder, video_backend="pyav", **metres)
    assert (data.num_episodes, len(data), data.fps) == (2, 5 + 3, 10)
    for k in range(5):
        frame = data[k]
        np.testing.assert_array_equal(frame["action"], commands[k + 1].astype(np.float32))
        np.testing.assert_array_equal(frame["observation.state"][:6], motion.lengths[k].astype(np.float32))
        assert frame["task"] == "move"
        view = tdcr.render(ROBOT, motion.configuration[k])[0]
        seen = 255.0 * np.moveaxis(np.array(frame["observation.images.camera0"]), 0, -1)
        assert np.sqrt(np.mean((seen - view.color) ** 2)) < (12.0 if has_depth else 0.5)
        if has_depth:
            depth = np.squeeze(np.array(frame["observation.images.camera0_depth"]))
            there = view.depth > 0.0
            assert np.median(np.abs(depth[there] - view.depth[there])) < 0.01, k


def motion_until(motion: tdcr.Motion, end: int) -> tdcr.Motion:
    names = ("times", "positions", "quaternions", "configuration", "velocity", "lengths", "tensions")
    return tdcr.Motion(**{name: getattr(motion, name)[:end] for name in names})

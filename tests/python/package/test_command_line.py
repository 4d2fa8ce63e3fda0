"""What the command line can do, Python can do, with the same names and defaults."""

from __future__ import annotations

import inspect
import re
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from by_command_line import TDCR, command_line

import tdcr
from tdcr import inverse, lerobot
from tdcr.errors import InputError

OPTION = re.compile(r"^ +(?:-\w, )?--([a-z][a-z-]*)(?: <[^>]*>)?(.*?)(?=^ +(?:-\w, )?--|\Z)", re.MULTILINE | re.DOTALL)
"""An option in the help, and its text."""

DEFAULT = re.compile(r"\[default: ([^\]]*)\]")

GLOBAL = {"json", "threads", "quiet", "help", "version"}
"""Options of every command: Python returns objects, has `tdcr.set_threads`, and says nothing."""

LOADS = {"wrench": "loads", "line-load": "loads"}
"""`tdcr.Loads` has both."""

EPISODES = ("robot", "cameras", "fps", "task", "repo-id", "images", "depth")
"""Options of episodes for LeRobot."""

EPISODES_ELSEWHERE = {"format": "there is one", "images": "videos=False"}

COMMANDS: dict[str, tuple[Callable[..., Any], dict[str, str]]] = {
    "settle": (
        tdcr.settle,
        {
            **LOADS,
            "commands": "of settle_batch",
            "path": "of FrictionPath.follow, without friction of tdcr.follow",
            "base": "base_position and base_quaternion",
            "out": "arrays are returned",
            "random": "Robot.random_commands",
            "seed": "of Robot.random_commands",
            "compliance": "jacobian by forces and moments",
            "picture": "tdcr.plot",
        },
    ),
    "reach": (
        inverse.ShapeController,
        {
            **{"payload": "loads", **LOADS, "tip": "a target", "path": "of ShapePath", "out": "arrays are returned"},
            **dict.fromkeys(["clearance", "press"], "of ShapeController.reach"),
            **dict.fromkeys(["cloud", "model", "start", "steps", "points"], "tdcr.Predictor.reach"),
        },
    ),
    "study": (tdcr.study, {"new": "a file to start from"}),
    "study merge": (tdcr.merge_study, {}),
    "simulate": (
        tdcr.simulate,
        {**LOADS, "loads-file": "wrench", "out": "arrays are returned", "linearise": "tdcr.linearise", "picture": "tdcr.plot"},
    ),
    "render": (
        tdcr.render,
        {**LOADS, "command": "an equilibrium under it", "voxel": "of tdcr.cloud", "out": "arrays are returned"},
    ),
    "export": (
        tdcr.Robot.to_mjcf,
        {"robot": "self", "format": "Robot.to_urdf, ...", "out": "Robot.save", "force": "Robot.save"},
    ),
    "new": (tdcr.new, {}),
    "log export": (tdcr.export_rosbag2, {"format": "there is one"}),
    "collect": (tdcr.collect, {}),
    "data info": (tdcr.Dataset.info, {}),
    "data view": (tdcr.data_view, {}),
    "data check": (tdcr.Dataset.check, {}),
    "data merge": (tdcr.merge, {}),
    "data import": (tdcr.import_clouds, {}),
    "data export": (tdcr.export_clouds, dict.fromkeys(EPISODES, "of tdcr.lerobot")),
    "data export --format lerobot": (lerobot.export_commands, EPISODES_ELSEWHERE),
    "data export --format=lerobot": (
        lerobot.export_logs,
        {**EPISODES_ELSEWHERE, "robot": "of commands", "cameras": "of commands"},
    ),
    "train": (tdcr.train, {"no-colors": "colors=False"}),
    "distill": (tdcr.distill, {}),
    "predict": (
        tdcr.Predictor.clouds,
        {
            "model": "of Predictor",
            "precision": "of Predictor",
            "command": "conditions",
            "commands": "conditions",
            "payload": "conditions",
            "out": "arrays are returned",
            "picture": "tdcr.plot",
        },
    ),
    "calibrate": (tdcr.calibrate_recording, {"out": "RecordingCalibration.save"}),
    "eval": (tdcr.evaluate, {"picture": "the report has the pictures"}),
    "compare": (tdcr.compare, {}),
    "background": (tdcr.rig.record_background, {}),
    "capture": (
        tdcr.Rig.capture,
        {
            "rig": "self",
            "commands-file": "commands are also an array",
            "dry-run": "Rig.draw and Rig.goals say what would move",
            "no-log": "log=False",
            "fault": "rehearsals are on the command line",
        },
    ),
    "demo": (tdcr.demo, {}),
}
"""Functions with the options of each command, and where those options are that they do not have."""

MODEL_FILE = "run/model.safetensors"
"""What Python also takes by its folder."""


def options(command: str) -> dict[str, str | None]:
    """Options of a command with their defaults, where the help says them."""
    done = subprocess.run([TDCR, *command.split(), "--help"], check=True, capture_output=True, text=True, timeout=60.0)
    _, _, listed = done.stdout.partition("\nOptions:\n")
    found = {}
    for name, text in OPTION.findall(listed):
        default = DEFAULT.search(" ".join(text.split()))
        found[name] = default[1] if default else None
    return found


def same(said: str, default: object) -> bool:
    """Whether a default of the command line is Python's."""
    if isinstance(default, bool) or not isinstance(default, int | float):
        return said == default
    return float(said) == default


@pytest.mark.parametrize("command", COMMANDS)
def test_options_have_the_names_and_defaults_of_the_command_line(command: str) -> None:
    function, elsewhere = COMMANDS[command]
    parameters = dict(inspect.signature(function).parameters)
    if "options" in parameters and function is tdcr.train:
        kind = inspect.Parameter.KEYWORD_ONLY
        parameters |= {name: inspect.Parameter(name, kind) for name in tdcr.TrainOptions.__annotations__}
    found = options(command)
    assert "help" in found
    missing = []
    for name in found.keys() - GLOBAL - elsewhere.keys():
        parameter = parameters.get(name.replace("-", "_"))
        said = found[name]
        if parameter is None:
            missing.append(name)
        elif said not in (None, MODEL_FILE) and parameter.default not in (None, inspect.Parameter.empty):
            assert same(said, parameter.default), f"{command} --{name}"
    assert not missing, f"options of tdcr {command} that Python lacks"
    assert not elsewhere.keys() - found.keys(), f"tdcr {command} has no such options"


def test_a_first_robot_file_is_that_of_the_command_line(tmp_path: Path) -> None:
    robot = tdcr.new(tmp_path / "mine.toml", segments=1, discs=4, backbone="nitinol", servos="position")
    assert (robot.name, robot.discs, robot.tendons, robot.command_units) == ("mine", 4, 3, ("m", "m", "m"))
    ours = (tmp_path / "mine.toml").read_text()
    flags = ["--segments", 1, "--discs", 4, "--backbone", "nitinol", "--servos", "position"]
    command_line("new", tmp_path / "mine.toml", "--force", *flags)
    assert (tmp_path / "mine.toml").read_text() == ours
    with pytest.raises(InputError, match="is there already; force=True replaces it"):
        tdcr.new(tmp_path / "mine.toml")
    assert tdcr.new(tmp_path / "mine.toml", force=True).discs == 20
    with pytest.raises(tdcr.errors.RobotError, match="the number of discs of a segment is 0; expected 1 to 50"):
        tdcr.new(tmp_path / "other.toml", discs=0)
    with pytest.raises(InputError, match='backbone is "oak"; expected one of "steel", "nitinol"'):
        tdcr.new(tmp_path / "other.toml", backbone="oak")  # type: ignore[arg-type]
    assert [file.name for file in tmp_path.iterdir()] == ["mine.toml"]


def test_a_bag_is_that_of_the_command_line(tmp_path: Path) -> None:
    log = Path(__file__).parents[3] / "hw/tests/data/sample.mcap"
    bag = tdcr.export_rosbag2(log, tmp_path / "bag")
    said = command_line("log", "export", log, "--out", tmp_path / "other")
    assert (bag.messages, bag.left_out, bag.whole) == (said["messages"], said["left_out"], said["whole"]) == (12, 3, True)
    assert {topic["topic"]: topic["messages"] for topic in said["topics"]} == {name: n for name, (_, n) in bag.topics.items()}
    for file in ("metadata.yaml", "{}_0.mcap"):
        one, other = (tmp_path / folder / file.format(folder) for folder in ("bag", "other"))
        assert one.read_bytes().replace(b"bag_0", b"other_0") == other.read_bytes()
    with pytest.raises(tdcr.errors.DataError, match="bag"):
        tdcr.export_rosbag2(log, tmp_path / "bag")


def test_a_model_for_mujoco_is_that_of_the_command_line() -> None:
    robot = tdcr.Robot("2m")
    command = [0.03, 0.01, 0.01, 0.02, 0.015, 0.019]
    flags = ["--base", "--payload", 0.02, "--dt", 0.001, "--integrator", "rk4", "--command", ",".join(map(str, command))]
    text = robot.to_mjcf(base=True, payload=0.02, dt=0.001, integrator="rk4", command=command)
    assert text == command_line("export", *flags)["text"] != robot.to_mjcf()
    assert robot.to_mjcf() == command_line("export")["text"]
    part = robot.to_mjcf(attach="tdcr/", payload=0.02)
    assert part == command_line("export", "--attach", "tdcr/", "--payload", 0.02)["text"] and 'name="tdcr/base"' in part
    with pytest.warns(UserWarning, match="10 ball joints are written as hinges about x, then y"):
        universal = robot.to_mjcf(joints="universal", payload=0.02)
    assert universal == command_line("export", "--joints", "universal", "--payload", 0.02)["text"] and "ball" not in universal
    with pytest.raises(InputError, match="`attach` goes with `payload`, `integrator` and `joints` alone"):
        robot.to_mjcf(attach="tdcr/", dt=0.001)
    with pytest.raises(tdcr.errors.RobotError, match="the character ' '"):
        robot.to_mjcf(attach="a robot/")
    with pytest.raises(InputError, match='integrator is "verlet"; expected one of "euler"'):
        robot.to_mjcf(integrator="verlet")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"command has shape \(2,\); expected \(6,\)"):
        robot.to_mjcf(command=[0.0, 0.0])

"""Wrong types and values of every argument of every public function raise errors of the tree, and nothing else."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tdcr
from tdcr import lerobot
from tdcr.errors import InputError, LoadsError, RobotError, TdcrError

ROBOT = tdcr.Robot("2m")
COMMAND = ROBOT.mean_command
ROWS = COMMAND[np.newaxis]
SETTLED = tdcr.settle(ROBOT, COMMAND)
CLOUD = np.zeros((20, 3))
BALL = tdcr.Obstacle.sphere("ball", 0.02, position=(0.2, 0.0, 0.2))
SCENE = tdcr.Scene([BALL])

WRONG = [
    "a",
    "",
    "\0",
    -1,
    10**30,
    1.5,
    math.nan,
    math.inf,
    1j,
    None,
    True,
    [],
    [1, "a"],
    ["a"],
    {},
    {"a": 1},
    {1: 2},
    b"a",
    object(),
    print,
    np.zeros(0),
    np.full(6, np.nan),
    np.zeros((2, 3, 4)),
    np.array(["a"]),
    np.array([None]),
    Path("/nowhere/at/all"),
    [ROBOT, 3],
]
"""What is handed over in place of each argument."""


def functions(folder: Path) -> list[tuple[Callable[..., Any], dict[str, Any]]]:
    """Public functions and methods, with arguments that are right; the files that they would read are not there."""
    out, missing = folder / "out", folder / "missing"
    settler, moving, path = tdcr.Settler(ROBOT), tdcr.MovingRobot(ROBOT), tdcr.FrictionPath(ROBOT)
    among = tdcr.MovingRobot(ROBOT, scene=SCENE)
    stream = tdcr.Stream(ROBOT, points=50)
    batch, target = {"robot": ROBOT, "commands": ROWS}, tdcr.inverse.Target(position=SETTLED.tip)
    controller = tdcr.inverse.ShapeController(ROBOT, samples=3, starts=1, max_steps=3)
    ball = tdcr.Scene([tdcr.Obstacle.sphere("ball", 0.02, position=(0.1, 0.0, 0.2))])
    among_ball = tdcr.inverse.ShapeController(ROBOT, samples=3, starts=1, max_steps=3, scene=ball)
    press = tdcr.inverse.Press("ball", 0.1)
    return [
        (tdcr.Robot, {"source": "2m"}),
        (tdcr.Robot.from_json, {"text": ROBOT.to_json()}),
        (ROBOT.random_commands, {"count": 2, "seed": 0}),
        (ROBOT.value, {"parameter": "gain[0]"}),
        (ROBOT.with_values, {"values": {"gain[0]": 500.0}}),
        (ROBOT.to_mjcf, {"base": False, "payload": 0.0, "dt": 0.001, "integrator": "euler", "command": COMMAND}),
        (ROBOT.to_mjcf, {"attach": "arm/", "joints": "hinges"}),
        (ROBOT.save, {"path": folder / "robot.toml"}),
        (tdcr.Loads, {"payload": 0.0, "payload_offset": (0, 0, 0), "wrenches": (), "line": (0, 0, 0)}),
        (tdcr.Wrench, {"disc": 0, "force": (0, 0, 0), "moment": (0, 0, 0), "frame": "world", "point": (0, 0, 0)}),
        (ROBOT.with_base, {"position": (0, 0, 0), "quaternion": (1, 0, 0, 0)}),
        (tdcr.settle, {"robot": ROBOT, "command": COMMAND, "payload": 0.0, "wrench": None, "loads": None, "scene": SCENE}),
        (tdcr.settle, {"robot": ROBOT, "command": COMMAND, "base_position": (0, 0, 0), "base_quaternion": (1, 0, 0, 0)}),
        (tdcr.settle_batch, {**batch, "base_position": np.zeros((1, 3)), "base_quaternion": (1, 0, 0, 0)}),
        (tdcr.settle_batch, {**batch, "payload": 0.0, "wrench": None, "loads": None, "progress": None, "scene": SCENE}),
        (tdcr.smallest_stiffness, {**batch, "payload": 0.0, "wrench": None, "loads": None, "scene": SCENE}),
        (tdcr.follow, {**batch, "payload": 0.0, "wrench": None, "loads": None, "progress": None, "scene": SCENE}),
        (tdcr.Settler, {"robot": ROBOT, "scene": SCENE}),
        (tdcr.Scene, {"obstacles": [BALL]}),
        (tdcr.Scene.load, {"path": missing}),
        (tdcr.Scene.from_json, {"text": SCENE.to_json()}),
        (SCENE.find, {"obstacle": "ball"}),
        (SCENE.moved, {"obstacle": "ball", "position": (0, 0, 0), "orientation": (1, 0, 0, 0)}),
        (SCENE.save, {"path": folder / "scene.toml"}),
        (tdcr.Obstacle.half_space, {"name": "floor", "position": (0, 0, 0), "orientation": (1, 0, 0, 0), "compliance": 1e-6}),
        (tdcr.Obstacle.box, {"name": "box", "size": (1, 1, 1), "friction": 0.1, "color": (1, 2, 3), "mass": 1.0}),
        (tdcr.Obstacle.sphere, {"name": "b", "radius": 1.0, "mass": 1.0, "velocity": (0, 0, 0), "angular_velocity": (0, 0, 0)}),
        (tdcr.Hinge, {"axis": (0, 0, 1), "anchor": (0, 0, 0), "limits": (-1, 1), "damping": 0.1}),
        (tdcr.Slider, {"axis": (0, 0, 1), "limits": (-1, 1), "damping": 0.1}),
        (tdcr.Compliant, {"relaxation": 1e-3}),
        (tdcr.Impedance, {"solref": (0.02, 1.0), "solimp": (0.9, 0.95, 0.001, 0.5, 2.0)}),
        (SCENE.with_contact_law, {"law": tdcr.Impedance()}),
        (tdcr.Obstacle.capsule, {"name": "rod", "radius": 1.0, "length": 1.0}),
        (tdcr.Obstacle.cylinder, {"name": "post", "radius": 1.0, "length": 1.0}),
        (tdcr.Obstacle.pipe, {"name": "pipe", "radius": 1.0, "length": 1.0, "path": None}),
        (tdcr.Obstacle.mesh, {"name": "part", "file": missing, "scale": 1.0}),
        (tdcr.Obstacle.mesh, {"name": "part", "vertices": np.eye(3), "triangles": [[0, 1, 2]], "scale": 1.0}),
        (
            tdcr.scene_vjp,
            {**batch, "by_positions": np.zeros((1, 10, 3)), "by_quaternions": None, "payload": None, "scene": SCENE},
        ),
        (tdcr.obstacle_jacobian, {**batch, "obstacle": "ball", "payload": None, "scene": SCENE, "on_failure": "raise"}),
        (tdcr.base_jacobian, {**batch, "payload": None, "wrench": None, "loads": None, "scene": SCENE}),
        (settler.settle, {"command": COMMAND, "loads": None, "payload": None}),
        (settler.follow, {"command": COMMAND, "loads": None, "payload": None}),
        (settler.settle_from, {"configuration": SETTLED.configuration, "command": COMMAND, "loads": None, "payload": None}),
        (tdcr.State.straight, {"robot": ROBOT}),
        (
            tdcr.simulate,
            {**batch, "payload": None, "wrench": None, "loads": None, "start": "straight", "dt": 0.002, "frame_skip": 1}
            | {"integrator": "semi-implicit-euler", "scene": None, "progress": None},
        ),
        (tdcr.rollout, {"robot": ROBOT, "commands": ROWS[:, np.newaxis], "start": "straight", "dt": 0.002, "scene": SCENE}),
        (
            tdcr.rollout_vjp,
            {
                "robot": ROBOT,
                "commands": ROWS[:, np.newaxis],
                "by_positions": None,
                "parameters": [],
                "dt": 0.002,
                "scene": SCENE,
            },
        ),
        (
            tdcr.rollout_jvp,
            {"robot": ROBOT, "commands": ROWS[:, np.newaxis], "rates": tdcr.RolloutRates(payload=np.ones(1)), "parameters": []}
            | {"payload": None, "wrench": None, "loads": None, "dt": 0.002, "frame_skip": 1, "scene": None, "progress": None},
        ),
        (tdcr.parameters, {"robot": ROBOT}),
        (ROBOT.check_parameters, {"parameters": ["gain[0]"]}),
        (tdcr.linearise, {"robot": ROBOT, "state": tdcr.State.straight(ROBOT), "command": COMMAND, "dt": 0.002, "scene": None}),
        (tdcr.MovingRobot, {"robot": ROBOT, "dt": 0.002, "integrator": "implicit-euler", "frame_skip": 1, "scene": None}),
        (moving.reset, {"command": COMMAND, "loads": None, "payload": None}),
        (moving.start_at, {"state": tdcr.State.straight(ROBOT), "command": None}),
        (moving.step, {"command": COMMAND, "loads": None, "payload": None, "frame_skip": 1}),
        (among.place_objects, {"objects": among.objects}),
        (tdcr.jacobian, {**batch, "parameters": None, "payload": None, "wrench": None, "loads": None, "on_failure": "raise"}),
        (tdcr.jvp, {**batch, "parameters": ["payload"], "rates": [1.0], "payload": None, "on_failure": "raise"}),
        (tdcr.vjp, {**batch, "parameters": ["payload"], "by_positions": np.zeros((1, 10, 3)), "by_quaternions": None}),
        (
            tdcr.plan,
            {"robot": ROBOT, "scene": SCENE, "from_": COMMAND, "to": COMMAND, "payload": None, "loads": None, "clearance": 0.002}
            | {
                "min_tension": None,
                "max_tension": None,
                "insertion": None,
                "to_insertion": 0.0,
                "seed": 0,
                "nodes": 10,
                "seconds": 0.1,
                "progress": None,
            },
        ),
        (lambda tip: tdcr.plan(ROBOT, SCENE, from_=COMMAND, tip=tip, nodes=10, seconds=0.1), {"tip": SETTLED.tip}),
        (
            tdcr.follow_the_leader,
            {"robot": ROBOT, "curve": [[0, 0, 0], [0, 0, 0.1]], "scene": None, "base": "free", "stages": 2}
            | {"payload": None, "loads": None, "progress": None},
        ),
        (tdcr.FrictionPath, {"robot": ROBOT, "resolution": 0.02, "scene": None}),
        (path.start, {"command": COMMAND, "loads": None, "payload": None}),
        (path.advance, {"command": COMMAND, "loads": None, "payload": None}),
        (path.follow, {"commands": ROWS, "loads": None, "progress": None, "payload": None}),
        (controller.reach, {"targets": target}),
        (among_ball.reach, {"targets": target, "press": press, "clearance": 0.001}),
        (lambda **press: among_ball.reach(press=tdcr.inverse.Press(**press)), {"obstacle": "ball", "force": 0.1, "disc": -1}),
        (lambda **press: among_ball.reach(press=tdcr.inverse.Press("ball", 0.1, **press)), {"lever": 0.1, "weight": 1.0}),
        (controller.path, {"start": COMMAND}),
        (
            tdcr.inverse.ShapeController,
            {"robot": ROBOT, "loads": None, "tolerance": 1e-6, "samples": 3, "seed": 0, "starts": 1, "max_steps": 3},
        ),
        (lambda **target: controller.reach(tdcr.inverse.Target(**target)), {"disc": -1, "position": SETTLED.tip, "lever": 0.1}),
        (lambda **target: controller.reach(tdcr.inverse.Target(**target)), {"direction": [0, 0, 1], "weight": 1.0}),
        (
            tdcr.calibrate,
            {**batch, "unknowns": ["gain[0]"], "positions": SETTLED.tip[np.newaxis, np.newaxis], "discs": None, "payload": None}
            | {"priors": {"gain[0]": {"spread": 10.0}}, "error": 1e-4},
        ),
        (
            tdcr.render,
            {"robot": ROBOT, "at": SETTLED, "base": False, "base_mesh": None, "show": (), "payload": 0.0, "noise": None},
        ),
        (tdcr.cloud, {"robot": ROBOT, "at": SETTLED, "base": False, "voxel": 0.004, "noise": None, "seed": 0, "index": 0}),
        (tdcr.clouds, {"robot": ROBOT, "at": [SETTLED], "voxel": 0.004, "first": 0, "progress": None}),
        (tdcr.Cloud(CLOUD.astype(np.float32), np.zeros((20, 3), np.uint8)).save, {"path": folder / "cloud.ply"}),
        (tdcr.metrics.chamfer, {"p": CLOUD, "q": CLOUD, "progress": None}),
        (tdcr.metrics.emd, {"p": CLOUD, "q": CLOUD, "squared": False, "progress": None}),
        (tdcr.metrics.emd_approximate, {"p": CLOUD, "q": CLOUD, "group": 2}),
        (tdcr.Stream, {"robot": ROBOT, "payload": None, "points": 50, "voxel": 0.004, "noise": None, "seed": 0, "start": 0}),
        (stream.at, {"start": 0, "stride": 1}),
        (tdcr.set_threads, {"count": tdcr.threads()}),
        (tdcr.sweep, {"function": abs, "conditions": [], "engine": "processes", "workers": 1, "cpus": 1, "retries": 0}),
        (tdcr.Dataset, {"path": missing}),
        (tdcr.data_view, {"data": missing, "out": out, "clouds": 1, "progress": None}),
        (
            tdcr.collect,
            {"robot": ROBOT, "out": out, "samples": 0, "points": 10, "voxel": 0.01, "payload": None, "noise": None}
            | {"design": "uniform", "seed": 0, "part": None, "progress": None},
        ),
        (tdcr.merge, {"parts": [missing], "out": out, "progress": None}),
        (
            tdcr.import_clouds,
            {"folder": missing, "out": out, "units": "m", "points": 10, "voxel": None, "split": None, "seed": 0},
        ),
        (tdcr.export_clouds, {"dataset": missing, "out": out, "format": "ply"}),
        (
            tdcr.train,
            {"data": missing, "out": out, "net": "hybrid", "preset": "quick", "width": 32, "precision": None, "layers": None}
            | {"optimizer": None, "coupling": "independent", "time_features": None, "symmetry": None, "init": None, "seed": 0}
            | {"channels": None, "surface_prior": None, "progress": None, "learning_rate": None},
        ),
        (tdcr.distill, {"model": missing, "data": missing, "out": out, "evaluations": 4, "power": 3.0, "precision": None}),
        (tdcr.Predictor, {"path": missing, "precision": None}),
        (
            tdcr.evaluate,
            {"model": None, "data": missing, "predictions": CLOUD[np.newaxis], "colors": None, "commands": None, "points": 20}
            | {"emd_points": 20, "tests": None, "worst": 1, "report": None, "seed": 0, "progress": None},
        ),
        (tdcr.compare, {"a": missing, "b": missing, "match": "condition", "tolerance": 1e-3, "split": "all", "report": None}),
        (tdcr.study, {"file": {"a": 1}, "out": out, "part": None, "engine": None, "parts": 1, "progress": None}),
        (tdcr.merge_study, {"parts": [missing], "out": out}),
        (
            tdcr.calibrate_recording,
            {"robot": ROBOT, "data": missing, "columns": {"a": 1}, "validate": None, "fit": None, "loss": None, "report": None},
        ),
        (
            tdcr.track,
            {"robot": ROBOT, "path": "circle", "plant": None, "controller": "inverse", "diameter": 0.06, "duration": 0.2}
            | {"centre": None, "period": 0.05, "approach": 0.1, "rate": None, "tension": None, "truth": None, "scene": None}
            | {"payload": 0.0, "friction": 0.0, "backlash": 0.0, "gain_error": 0.0, "delay": 0.0, "noise": 0.0}
            | {"tension_noise": 0.0, "timestep": None, "start": None, "seed": 0, "report": None},
        ),
        (
            tdcr.view,
            {"robot": ROBOT, "payload": None, "command": COMMAND, "commands": [COMMAND], "scene": SCENE, "loads": None, "port": 0}
            | {"data": missing, "model": missing, "log": missing, "study": missing, "rig": None, "out": out},
        ),
        (tdcr.Rig, {"path": missing, "real_time": False}),
        (
            lerobot.export_logs,
            {"logs": [missing], "out": out, "fps": 10, "task": "a", "repo_id": "a/b", "videos": True, "depth": False},
        ),
        (lerobot.export_commands, {"robot": ROBOT, "commands": [ROWS], "out": out, "fps": 10, "cameras": [0]}),
        (lerobot.export_motions, {"robot": ROBOT, "episodes": [(ROWS, None)], "out": out, "cameras": [0]}),
        (
            tdcr.new,
            {"file": folder / "new.toml", "segments": 1, "discs": 2, "tendons": 3, "length": 0.1, "backbone": "steel"}
            | {"radius": 5e-4, "servos": "tension", "force": True},
        ),
        (tdcr.export_rosbag2, {"log": missing, "out": out}),
        (tdcr.log_to_rerun, {"what": SETTLED, "entity": "a", "robot": ROBOT, "times": None, "out": out, "recording": None}),
        (tdcr.demo, {"out": out, "samples": 1, "steps": 0, "precision": None, "symmetry": "auto", "seed": 0, "progress": None}),
    ]


def test_every_public_function_is_among_them(tmp_path: Path) -> None:
    tried = {getattr(function, "__name__", "") for function, _ in functions(tmp_path)}
    public = {name for name in tdcr.__all__ if inspect.isfunction(getattr(tdcr, name))}
    assert public - tried == {"threads"}


def test_wrong_arguments_raise_errors_of_the_tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # What is taken for a name of a file in spite of all is written here.
    monkeypatch.chdir(tmp_path)
    threads, outside = tdcr.threads(), []
    for function, right in functions(tmp_path):
        for name in right:
            for wrong in WRONG:
                # What is called with wrong conditions may raise what it likes.
                if function is tdcr.sweep and name in ("function", "conditions") and isinstance(wrong, Iterable | Callable):
                    continue
                try:
                    function(**{**right, name: wrong})
                except TdcrError as error:
                    # It says something, and of whom.
                    assert str(error), (function, name, wrong)
                except Exception as error:
                    called = getattr(function, "__qualname__", repr(function))
                    outside.append(f"{called}({name}={wrong!r}): {type(error).__name__}: {error}")
    tdcr.set_threads(threads)
    assert not outside, f"{len(outside)} outside the tree:\n" + "\n".join(outside)


def test_errors_say_what_was_wrong() -> None:
    with pytest.raises(LoadsError, match="payload has entries of type"):
        tdcr.Loads("a")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="count is -1; expected 1 to 1024"):
        tdcr.set_threads(-1)
    with pytest.raises(InputError, match="out is 3; expected a path"):
        tdcr.collect("2m", 3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="progress is 'a'; expected a function"):
        tdcr.settle_batch(ROBOT, ROWS, progress="a")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="parameters is 'payload'; expected a list of texts"):
        tdcr.jacobian(ROBOT, ROWS, "payload")


def changed(*keys: Any, value: Any) -> dict[str, Any]:
    """The fields of a robot, one of them another one."""
    fields = ROBOT.to_dict()
    inner: Any = fields
    for key in keys[:-1]:
        inner = inner[key]
    inner[keys[-1]] = value
    return fields


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        (changed("modules", 1, "discs", value="five"), r'^modules\[1\]\.discs: .*"five", expected a whole number$'),
        (changed("modules", value=5), r"^modules: .*`5`, expected a list$"),
        (changed("base", "position", 2, value=[]), r"^base\.position\[2\]: .*expected a number$"),
        (changed("modules", 0, "colour", value=1), r"^modules\[0\].*unknown field `colour`"),
        (changed("tendons", value={}), r"unknown field `tendons`.*; `tendons` belongs in \[\[modules\]\]$"),
        (changed("modules", 0, "radius", value=np.float64("nan")), r"the robot: modules\[0\]\.radius is nan; expected a finite"),
        (changed("modules", 0, "radius", value=object()), r"the robot: modules\[0\]\.radius is <object"),
        (changed("modules", 0, 3, value=1), r"the robot: modules\[0\] has the key 3; expected texts"),
    ],
)
def test_errors_of_a_dictionary_name_its_keys(fields: dict[str, Any], says: str) -> None:
    with pytest.raises(RobotError, match=says) as raised:
        tdcr.Robot(fields)
    assert "line 1" not in str(raised.value)


def test_errors_of_other_dictionaries_name_their_keys(tmp_path: Path) -> None:
    with pytest.raises(InputError) as raised:
        tdcr.study({"robots": ["2m"], "commands": {"random": {"count": "many"}}}, tmp_path / "study")
    assert "line 1" not in str(raised.value) and "column" not in str(raised.value)
    with pytest.raises(InputError, match=r"the study: commands\.random\[0\] is inf"):
        tdcr.study({"commands": {"random": [math.inf]}}, tmp_path / "study")
    with pytest.raises(InputError) as raised:
        tdcr.calibrate_recording("2m", tmp_path / "table.csv", {"time": 3})
    assert "line 1" not in str(raised.value) and "column 1" not in str(raised.value)


def test_a_robot_is_what_makes_one(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    ROBOT.save(file)
    expected = tdcr.settle(ROBOT, COMMAND)
    for robot in ("2m", file, str(file), ROBOT.to_dict()):
        assert tdcr.settle(robot, COMMAND) == expected
    assert tdcr.settle_batch(["2m", file], ROWS.repeat(2, axis=0))[1] == expected
    assert tdcr.MovingRobot("2m").robot == tdcr.FrictionPath("2m").robot == tdcr.Settler("2m").robot == ROBOT
    assert tdcr.simulate("2m", ROWS) == tdcr.simulate(ROBOT, ROWS)
    assert np.array_equal(tdcr.jacobian("2m", COMMAND), tdcr.jacobian(ROBOT, COMMAND))
    assert np.array_equal(tdcr.cloud("2m", expected).points, tdcr.cloud(ROBOT, expected).points)
    assert tdcr.inverse.ShapeController("2m").robot == ROBOT
    with pytest.raises(RobotError, match="unknown robot `9m`"):
        tdcr.settle("9m", COMMAND)

"""Objects that a robot pushes: momentum, weights, copies, and what the command line says of the same."""

from __future__ import annotations

import copy
import dataclasses
import json
import os
import pickle
import subprocess
from pathlib import Path

import numpy as np
import pytest

import tdcr
from tdcr.errors import DynamicsError, InputError, SceneError

LEFT = np.array([0.034, 0.007, 0.001, 0.026, 0.015, 0.019])
TABLE = tdcr.Obstacle.box("table", (0.3, 0.4, 0.02), position=(-0.2, 0.0, 0.23), friction=0.3)
BOX = tdcr.Obstacle.box("box", (0.03, 0.06, 0.05), position=(-0.062, 0.0, 0.265), mass=0.02)
SCENE = tdcr.Scene([TABLE, BOX])


def commands(steps: int) -> np.ndarray:
    mean = tdcr.Robot("2m").mean_command
    share = np.minimum(np.arange(steps) * 0.002, 1.0)[:, None]
    return mean + (LEFT - mean) * share


def test_a_pushed_box_moves_and_its_momentum_is_that_of_the_forces_on_it() -> None:
    floating = tdcr.Robot.from_json(json.dumps(json.loads(tdcr.Robot("2m").to_json()) | {"gravity": [0.0, 0.0, 0.0]}))
    box = tdcr.Obstacle.box("box", (0.03, 0.06, 0.05), position=(-0.062, 0.0, 0.265), mass=0.02)
    motion = tdcr.simulate(floating, commands(700), scene=tdcr.Scene([box]))
    objects = motion.objects
    assert objects is not None and objects.names == ("box",)
    assert objects.position.shape == (700, 1, 3) and objects["box"].position.shape == (700, 3)
    momentum = 0.02 * objects["box"].velocity
    impulses = np.cumsum(objects["box"].force, axis=0) * 0.002
    assert np.abs(momentum[-1]).max() > 1e-4
    assert np.abs(momentum - impulses).max() < 1e-13


def test_a_box_on_a_table_goes_where_the_command_line_says(tmp_path: Path) -> None:
    motion = tdcr.simulate("2m", commands(600), scene=SCENE)
    assert motion.objects is not None
    end = motion.objects["box"]
    assert np.linalg.norm(end.position[-1] - end.position[0]) > 5e-3
    if "TDCR" not in os.environ:
        pytest.skip("TDCR is not set")
    SCENE.save(tmp_path / "scene.toml")
    np.savetxt(tmp_path / "commands.csv", commands(600), delimiter=",", fmt="%.17g")
    arguments = ["--robot", "2m", "--commands", "commands.csv", "--scene", "scene.toml", "--out", "path.csv", "--json"]
    done = subprocess.run([os.environ["TDCR"], "simulate", *arguments], cwd=tmp_path, capture_output=True, text=True, check=True)
    (said,) = json.loads(done.stdout)["objects"]
    assert said["name"] == "box"
    np.testing.assert_array_equal(said["position"], end.position[-1])
    np.testing.assert_array_equal(said["force"], end.force[-1])
    with open(tmp_path / "path.csv") as file:
        header = file.readline().strip().split(",")
        rows = np.loadtxt(file, delimiter=",")
    at = header.index("box x (m)")
    np.testing.assert_array_equal(rows[:, at : at + 3], end.position)
    np.testing.assert_array_equal(rows[:, at + 3 : at + 7], end.orientation)


def test_a_moving_robot_is_reset_copied_and_pickled_with_its_objects() -> None:
    moving = tdcr.MovingRobot("2m", scene=SCENE, frame_skip=10)
    start = moving.objects
    assert start is not None
    for _ in range(50):
        moving.step(LEFT)
    there = moving.objects
    assert there is not None and there != start
    for other in (copy.deepcopy(moving), pickle.loads(pickle.dumps(moving))):
        assert other.objects == there or np.array_equal(other.objects.position, there.position)
        other.step(LEFT)
        again = copy.deepcopy(moving)
        again.step(LEFT)
        assert np.abs(other.objects.position - again.objects.position).max() < 1e-5
    moving.reset(moving.robot.mean_command)
    assert np.array_equal(moving.objects.position, start.position)
    moving.place_objects(there)
    assert np.array_equal(moving.objects.position, there.position)
    with pytest.raises(InputError, match=r"of \('box',\)"):
        moving.place_objects(start["box"])


@pytest.mark.parametrize(
    ("field", "value", "expected"),
    [
        ("position", [[1e300, 0, 0]], "position .* at most 1e6 m"),
        ("orientation", [[0, 0, 0, 0]], r"orientation \[0.0, 0.0, 0.0, 0.0\]; expected a quaternion"),
        ("velocity", [[0, 1e200, 0]], "velocity .* at most 1e4"),
        ("angular_velocity", [[0, 0, -2e4]], "angular velocity .* at most 1e4"),
        ("velocity", [[0, 1]], r"objects.velocity has shape \(1, 2\)"),
        ("position", [[0.0, 0.0, 0.2]], "inside obstacle"),
    ],
)
def test_objects_are_placed_only_where_they_can_be(field: str, value: list[list[float]], expected: str) -> None:
    moving = tdcr.MovingRobot("2m", scene=SCENE, frame_skip=10)
    before = moving.objects
    assert before is not None
    with pytest.raises(InputError, match=expected):
        moving.place_objects(dataclasses.replace(before, **{field: np.array(value, float)}))
    assert np.array_equal(moving.objects.position, before.position)


def test_doors_and_drawers_are_written_and_read_again(tmp_path: Path) -> None:
    hinge = tdcr.Hinge((0, 0, 1), (0.0, 0.1, 0.0), limits=(-1.5, 0.0), damping=0.01)
    door = tdcr.Obstacle.box("door", (0.006, 0.2, 0.2), position=(-0.04, 0.1, 0.28), mass=0.05, joint=hinge)
    slider = tdcr.Slider((1, 0, 0), damping=2.0)
    drawer = tdcr.Obstacle.box("drawer", (0.1, 0.1, 0.1), position=(1, 0, 0), mass=1.0, joint=slider, velocity=(0.1, 0, 0))
    scene = tdcr.Scene([door, drawer])
    scene.save(tmp_path / "scene.toml")
    read = tdcr.Scene.load(tmp_path / "scene.toml")
    assert read == scene and list(read) == [door, drawer] and read.objects == ("door", "drawer")
    motion = tdcr.simulate("2m", commands(500), scene=read)
    assert motion.objects is not None
    way = motion.objects["drawer"].position[-1, 0] - 1.0
    # v m / d (1 - exp(-d t / m))
    assert abs(way / (0.1 / 2.0 * (1 - np.exp(-2.0))) - 1) < 0.01


def test_what_objects_cannot_be_is_said() -> None:
    with pytest.raises(SceneError, match="joint of obstacle 'a' is 3; expected a tdcr.Hinge or a tdcr.Slider"):
        tdcr.Obstacle.sphere("a", 0.1, joint=3)
    with pytest.raises(SceneError, match="none without a `mass`"):
        tdcr.Scene([tdcr.Obstacle.sphere("a", 0.1, velocity=(1, 0, 0))])
    with pytest.raises(SceneError, match="with 0 in between"):
        tdcr.Scene([tdcr.Obstacle.sphere("a", 0.1, mass=1.0, joint=tdcr.Hinge((0, 0, 1), limits=(0.5, 1.0)))])
    tube = tdcr.Scene([tdcr.Obstacle.pipe("tube", 0.1, 0.2, mass=1.0)])
    with pytest.raises(DynamicsError, match="object `tube` is a pipe"):
        tdcr.MovingRobot("2m", scene=tube)


def test_equilibria_take_objects_as_fixed() -> None:
    ball = tdcr.Obstacle.sphere("ball", 0.03, position=(-0.07, 0.0, 0.26))
    light = tdcr.Obstacle.sphere("ball", 0.03, position=(-0.07, 0.0, 0.26), mass=0.001)
    one, other = (tdcr.settle("2m", LEFT, scene=tdcr.Scene([each])) for each in (ball, light))
    assert np.array_equal(one.positions, other.positions)

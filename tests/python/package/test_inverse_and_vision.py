"""Friction, targets, calibration, images and clouds from Python, against the command line and themselves."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tdcr
from tdcr.errors import InputError, ParameterError
from tdcr.inverse import ShapeController, Target, shape

COMMAND = [0.034, 0.007, 0.001, 0.026, 0.015, 0.019]


@pytest.fixture(scope="module")
def robot() -> tdcr.Robot:
    return tdcr.Robot("2m")


@pytest.fixture(scope="module")
def line(request: pytest.FixtureRequest) -> Callable[..., dict[str, Any]]:
    """Runs the command line, whose fixture has the package's name."""
    run: Callable[..., dict[str, Any]] = request.getfixturevalue("tdcr")
    return run


def with_friction(robot: tdcr.Robot, coefficient: float) -> tdcr.Robot:
    fields = robot.to_dict()
    for module in fields["modules"]:
        module["tendons"]["friction"] = {"coefficient": coefficient, "contact_stiffness": 2e4}
    return tdcr.Robot(fields)


def test_friction_makes_a_loop_and_its_work_is_accounted_for(robot: tdcr.Robot) -> None:
    rough = with_friction(robot, 0.2)
    path = tdcr.FrictionPath(rough)
    there = np.linspace(robot.mean_command, COMMAND, 8)
    out = path.follow(there)
    back = path.follow(there[::-1])
    assert all(state.equilibrium.converged for state in out + back)
    # It does not come back to where it was, and what was lost is heat.
    assert np.abs(back[-1].equilibrium.tip - out[0].equilibrium.tip).max() > 1e-5
    assert back[-1].dissipated > out[-1].dissipated > 0.0
    assert {slip for tendon in back[-1].tendons for slip in tendon.slip} <= {"sticks", "to servo", "to end"}
    smooth = tdcr.FrictionPath(robot).follow(there)[-1]
    assert np.abs(smooth.equilibrium.positions - tdcr.settle(robot, COMMAND).positions).max() < 1e-9
    assert smooth.dissipated == 0.0


def test_a_target_is_reached_as_by_the_command_line(robot: tdcr.Robot, line: Callable[..., dict[str, Any]]) -> None:
    tip = tdcr.settle(robot, COMMAND).tip
    found = shape(robot, Target(position=tip))
    assert found.outcome == "reached" and found.errors[0] < 1e-6
    assert np.abs(tdcr.settle(robot, found.command).tip - tip).max() < 1e-6
    told = line("reach", "--robot", "2m", "--tip", ",".join(map(repr, tip.tolist())))
    assert np.allclose(told["found"][0]["command"], found.command, atol=1e-12)


def test_a_path_of_targets_has_no_jumps(robot: tdcr.Robot) -> None:
    start, goal = (tdcr.settle(robot, c).tip for c in (robot.mean_command + 1e-3 * np.arange(6), COMMAND))
    path = ShapeController(robot).path()
    points = [path.follow(Target(position=start + share * (goal - start))) for share in np.linspace(0.0, 0.15, 5)]
    assert [point.arrival for point in points] == ["first", *["followed"] * 4]
    assert all(point.solution.outcome == "reached" for point in points)


@pytest.mark.parametrize(
    ("target", "says"),
    [
        ({"position": [0.0, 0.0]}, r"position of a target has shape \(2,\); expected \(3,\)"),
        ({}, "a target has nothing; expected exactly one of"),
        ({"position": [0.0] * 3, "direction": [0.0, 0.0, 1.0]}, "expected exactly one of"),
        ({"direction": [0.0] * 3}, "the direction of a target is 0"),
        ({"disc": 10, "position": [0.0] * 3}, "disc of a target is 10; expected -10 to 9"),
    ],
)
def test_targets_that_make_no_sense_are_refused(robot: tdcr.Robot, target: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        shape(robot, Target(**target))


def test_calibration_finds_what_the_measurements_say(robot: tdcr.Robot) -> None:
    truth = robot.with_values({f"gain[{t}]": 1.2 * robot.value("gain[0]") for t in range(6)} | {"density[1]": 1100.0})
    commands = robot.random_commands(30, seed=4)
    settled = tdcr.settle_batch(truth, commands)
    noise = np.random.default_rng(0).normal(scale=2e-4, size=settled.positions.shape)
    measured = settled.positions + noise
    measured[3, 4] = np.nan
    unknowns = {"gain": [f"gain[{t}]" for t in range(6)], "density of module 1": ["density[1]"]}
    fit = tdcr.calibrate(robot, unknowns, commands, measured)
    assert fit.state == "converged"
    assert fit.noise == pytest.approx(2e-4, rel=0.1)
    assert fit.degrees_of_freedom == 30 * 30 - 3 - 2
    for name in unknowns:
        (finding,) = (f for f in fit.findings if f.name == name)
        value = truth.value(unknowns[name][0])
        # The interval holds with 95 %: three standard errors with 99.7 %.
        assert finding.kind == "identified" and abs(finding.value - value) < 3.0 * finding.standard_error
    assert fit.robot.value("gain[3]") == fit.findings[0].value
    with pytest.raises(ParameterError, match=r"no parameter `torsion\[0\]`: the module has no backbone"):
        tdcr.calibrate(robot, ["torsion[0]"], commands, measured)
    with pytest.raises(InputError, match=r"positions has shape \(30, 4, 3\), and discs are not given"):
        tdcr.calibrate(robot, ["gain[0]"], commands, measured[:, :4])


def test_pictures_are_those_of_the_command_line(robot: tdcr.Robot, line: Callable[..., dict[str, Any]], tmp_path: Path) -> None:
    settled = tdcr.settle(robot, COMMAND)
    views = tdcr.render(robot, settled, base=True, noise="d435", seed=3)
    out = tmp_path / "views"
    command = ",".join(map(str, COMMAND))
    line("render", "--robot", "2m", "--command", command, "--base", "--noise", "d435", "--seed", 3, "--out", out)
    assert len(views) == 8
    for k in (0, 5):
        depth = np.load(out / f"camera{k}_depth.npy")
        assert np.array_equal(views[k].depth, depth.reshape(views[k].depth.shape))
        assert views[k].color.shape == (*views[k].depth.shape, 3)
        assert {0, 1, 10_000, 10_009} <= set(np.unique(views[k].mask).tolist())


def test_a_cloud_lies_where_the_robot_is(robot: tdcr.Robot, tmp_path: Path) -> None:
    batch = tdcr.settle_batch(robot, robot.random_commands(3, seed=1))
    done: list[int] = []
    seen = tdcr.clouds(robot, batch, progress=done.append)
    assert sum(done) == 3
    for row, cloud in enumerate(seen):
        assert len(cloud) > 5000
        distance = np.linalg.norm(cloud.points[:, None] - batch.positions[row], axis=-1).min(axis=1)
        assert distance.max() < 0.03
        one = tdcr.cloud(robot, batch[row])
        assert np.array_equal(one.points, cloud.points) and np.array_equal(one.colors, cloud.colors)
    # The cloud is that of the pixels of the pictures, one in each voxel.
    views = tdcr.render(robot, batch[0])
    assert sum(int((view.depth > 0.0).sum()) for view in views) > len(seen[0])
    seen[0].save(tmp_path / "cloud.ply")
    assert (tmp_path / "cloud.ply").read_bytes().startswith(b"ply\n")
    noisy = [tdcr.cloud(robot, batch[0], noise="d435", seed=1, index=k).points for k in (0, 0, 1)]
    assert np.array_equal(noisy[0], noisy[1]) and not np.array_equal(noisy[0], noisy[2])


def test_settings_of_pictures_that_make_no_sense_are_refused(robot: tdcr.Robot) -> None:
    settled = tdcr.settle(robot, COMMAND)
    with pytest.raises(InputError, match="show has"):
        tdcr.render(robot, settled, show=["wings"])  # type: ignore[list-item]
    with pytest.raises(InputError, match='noise is "kinect"; expected one of "d435"'):
        tdcr.render(robot, settled, noise="kinect")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="the voxels' edge is -1 m"):
        tdcr.cloud(robot, settled, voxel=-1.0)
    with pytest.raises(InputError, match=r"at has shape \(3, 4\); expected \(10, 4\)"):
        tdcr.render(robot, np.ones((3, 4)))


def test_results_pickle(robot: tdcr.Robot) -> None:
    settled = tdcr.settle(robot, COMMAND)
    again = pickle.loads(pickle.dumps((settled, tdcr.Loads(payload=0.01), tdcr.cloud(robot, settled))))
    assert np.array_equal(again[0].positions, settled.positions)
    assert again[1] == tdcr.Loads(payload=0.01)

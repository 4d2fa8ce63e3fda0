"""Robots, equilibria and their derivatives from Python."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tdcr
from tdcr.errors import CommandError, InputError, LoadsError, ParameterError, RobotError, SensitivityError

COMMAND = [0.034, 0.007, 0.001, 0.026, 0.015, 0.019]


@pytest.fixture(scope="module")
def robot() -> tdcr.Robot:
    return tdcr.Robot("2m")


def test_a_robot_comes_from_a_name_a_file_a_dictionary_and_other_tools(robot: tdcr.Robot, tmp_path: Path) -> None:
    assert (robot.name, robot.discs, robot.tendons) == ("2m", 10, 6)
    assert robot.command_units == ("m",) * 6
    assert tdcr.Robot(robot.to_dict()) == robot
    for extension in ("toml", "json", "urdf"):
        path = tmp_path / f"robot.{extension}"
        robot.save(path)
        assert tdcr.Robot(path) == robot, extension
    path = tmp_path / "robot.xml"
    robot.save(path)
    imported = tdcr.Robot(path)
    expected, found = tdcr.settle(robot, COMMAND), tdcr.settle(imported, COMMAND)
    assert np.abs(expected.positions - found.positions).max() < 1e-9


def test_a_robot_file_is_replaced_whole_or_stays(robot: tdcr.Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "robot.toml"
    robot.save(path)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space left on device"):
        tdcr.Robot("3m").save(path)
    assert tdcr.Robot(path) == robot and [file.name for file in tmp_path.iterdir()] == ["robot.toml"]
    with pytest.raises(InputError, match=r"cannot write a robot to .*robot.yaml; expected a name that ends in .toml, .json"):
        robot.save(tmp_path / "robot.yaml")


def test_robots_pickle_compare_hash_and_print(robot: tdcr.Robot) -> None:
    stiffer = robot.with_values({"gain[0]": 2.0 * robot.value("gain[0]")})
    assert stiffer != robot
    assert pickle.loads(pickle.dumps(stiffer)) == stiffer
    assert hash(tdcr.Robot("2m")) == hash(robot)
    assert repr(robot) == "Robot('2m': 10 discs, 6 tendons)"
    assert len({robot, tdcr.Robot("2m"), stiffer}) == 2


@pytest.mark.parametrize(
    ("source", "says"),
    [
        ("9m", "unknown robot `9m`"),
        ("no/such.toml", "cannot read robot file no/such.toml"),
        ({"name": "x"}, "missing field"),
        (3, "expected a name, a path, a dictionary or a robot"),
    ],
)
def test_a_robot_that_is_none_is_refused(source: object, says: str) -> None:
    with pytest.raises(RobotError, match=says):
        tdcr.Robot(source)  # type: ignore[arg-type]


def test_equilibria_are_those_of_the_command_line(robot: tdcr.Robot, settle: Callable[..., dict[str, Any]]) -> None:
    told = settle("2m", COMMAND, payload=0.02)
    settled = tdcr.settle(robot, COMMAND, payload=0.02).check()
    assert settled.stability == "stable"
    assert told["positions"][-1] == settled.tip.tolist()
    assert told["residual"] == settled.residual


def test_a_batch_is_its_rows_settled_one_by_one(robot: tdcr.Robot) -> None:
    commands = robot.random_commands(200, seed=3)
    payload = np.linspace(0.0, 0.03, 200)
    wrench = np.zeros((200, 10, 6))
    wrench[:, 9, 0] = np.linspace(-0.05, 0.05, 200)
    done = []
    batch = tdcr.settle_batch(robot, commands, payload, wrench=wrench, progress=done.append)
    assert batch.converged.mean() > 0.95
    assert sum(done) == 200
    for row in (0, 57, 199):
        push = tdcr.Wrench(9, force=(wrench[row, 9, 0], 0.0, 0.0))
        one = tdcr.settle(robot, commands[row], loads=tdcr.Loads(payload=payload[row], wrenches=(push,)))
        assert np.array_equal(one.positions, batch.positions[row])
        assert np.array_equal(one.tensions, batch[row].tensions)
    tdcr.set_threads(1)
    try:
        alone = tdcr.settle_batch(robot, commands, payload, wrench=wrench)
    finally:
        tdcr.set_threads(2)
    assert np.array_equal(alone.positions, batch.positions)


@pytest.mark.parametrize("discs", [5, 40])
def test_a_single_call_is_a_row_of_a_batch_to_the_bit(robot: tdcr.Robot, discs: int) -> None:
    """Robots of few and of many discs settle on different ways through the native module."""
    modules = [module | {"discs": discs, "pitch": 0.085 / discs} for module in robot.to_dict()["modules"]]
    robot = tdcr.Robot(robot.to_dict() | {"modules": modules})
    command, rng = robot.random_commands(1, seed=3)[0], np.random.default_rng(2)
    wrench = rng.normal(scale=1e-3, size=(robot.discs, 6)) * [1, 1, 1, 0, 0, 0]
    for given in (
        {},
        {"payload": 0.01},
        {"payload": 0.01, "wrench": wrench},
        {"loads": tdcr.Loads(payload=0.01, payload_offset=(0.0, 0.0, 0.01)), "wrench": wrench},
        {"loads": tdcr.Loads(line=(0.0, 0.01, 0.0)), "payload": 0.01},
    ):
        one, batch = tdcr.settle(robot, command, **given), tdcr.settle_batch(robot, np.stack([command, command]), **given)
        for name in ("positions", "quaternions", "configuration", "lengths", "tensions"):
            assert np.array_equal(getattr(one, name), getattr(batch, name)[1]), name
        assert (one.residual, one.iterations, one.converged) == (batch.residual[1], batch.iterations[1], batch.converged[1])
        assert one.stability == tdcr.statics.STABILITY[batch.stability[1]]
        by = tdcr.jacobian(robot, np.stack([command, command]), **given)
        assert np.array_equal(tdcr.jacobian(robot, command, **given), by[0])
    assert np.array_equal(tdcr.Settler(robot).settle(command).positions, tdcr.settle(robot, command).positions)
    with pytest.raises(InputError, match="the payload is given twice"):
        tdcr.settle(robot, command, 0.01, loads=tdcr.Loads(payload=0.01))


def test_rows_may_be_of_different_robots(robot: tdcr.Robot) -> None:
    soft = robot.with_values({f"gain[{t}]": 50.0 for t in range(6)})
    both = tdcr.settle_batch([robot, soft], [COMMAND, COMMAND])
    for row, one in enumerate((robot, soft)):
        assert np.array_equal(tdcr.settle(one, COMMAND).positions, both.positions[row])
    with pytest.raises(InputError, match="robot 1 has 15 discs and 9 tendons, robot 0 has 10 and 6"):
        tdcr.settle_batch([robot, tdcr.Robot("3m")], [COMMAND, COMMAND])


def test_a_path_is_followed(robot: tdcr.Robot) -> None:
    path = np.linspace(robot.mean_command, COMMAND, 30)
    followed = tdcr.follow(robot, path)
    settler = tdcr.Settler(robot)
    for row, command in enumerate(path):
        assert np.array_equal(settler.follow(command).positions, followed.positions[row])
    again = pickle.loads(pickle.dumps(settler)).settle_from(followed.configuration[-1], COMMAND)
    assert np.abs(again.positions - followed.positions[-1]).max() < 1e-9


@pytest.mark.parametrize(
    ("arguments", "error", "says"),
    [
        ({"command": COMMAND[:5]}, InputError, r"command has shape \(5,\); expected \(6,\)"),
        ({"command": [*COMMAND[:5], np.nan]}, InputError, r"command\[5\] is nan; expected finite numbers"),
        ({"command": [*COMMAND[:5], 0.5]}, CommandError, "command entry 6 is 0.5 m; tendon 6 takes"),
        ({"command": ["a"] * 6}, InputError, "command has entries of type"),
        ({"command": COMMAND, "payload": -1.0}, LoadsError, "the payload is -1 kg"),
        ({"command": COMMAND, "wrench": np.zeros((3, 6))}, InputError, r"wrench has shape \(3, 6\); expected \(10, 6\)"),
    ],
)
def test_inputs_are_refused_by_name(robot: tdcr.Robot, arguments: dict[str, object], error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says):
        tdcr.settle(robot, **arguments)  # type: ignore[arg-type]


def test_a_batch_names_the_row_that_it_refuses(robot: tdcr.Robot) -> None:
    commands = robot.random_commands(3)
    commands[1, 2] = -1.0
    with pytest.raises(CommandError, match="row 1: command entry 3 is -1 m"):
        tdcr.settle_batch(robot, commands)


def test_inputs_of_other_libraries_and_types_are_taken(robot: tdcr.Robot) -> None:
    torch = pytest.importorskip("torch")
    expected = tdcr.settle(robot, np.float32(COMMAND)).positions
    tensor = torch.tensor(COMMAND)
    assert np.array_equal(tdcr.settle(robot, tensor).positions, expected)
    assert tdcr.settle(robot, [0] * 6).positions.shape == (10, 3)
    with pytest.raises(InputError, match="command is a tensor that requires gradients"):
        tdcr.settle(robot, tensor.requires_grad_())


class OnAGpu:
    """What a tensor in a GPU's memory says of itself."""

    def __dlpack_device__(self) -> tuple[int, int]:
        return 2, 0

    def __dlpack__(self, **_: object) -> object:
        raise BufferError("not on this device")


def test_a_tensor_on_a_gpu_gets_a_clear_error(robot: tdcr.Robot) -> None:
    with pytest.raises(InputError, match=r"command is on another device .* expected an array in the processor's memory"):
        tdcr.settle(robot, OnAGpu())


PARAMETERS = ["command[0]", "command[4]", "payload", "force[9].x", "moment[4].y", "gain[1]", "density[1]", "pitch[0]"]


def moved(robot: tdcr.Robot, parameter: str, by: float) -> tuple[np.ndarray, np.ndarray]:
    """Poses with a parameter changed by ``by``."""
    command, payload, wrench = np.array(COMMAND), 0.02, np.zeros((10, 6))
    name, _, index = parameter.partition("[")
    if name == "command":
        command[int(index[:-1])] += by
    elif name == "payload":
        payload += by
    elif name in ("force", "moment"):
        wrench[int(index[0]), "xyz".index(parameter[-1]) + (3 if name == "moment" else 0)] += by
    else:
        robot = robot.with_values({parameter: robot.value(parameter) + by})
    settled = tdcr.settle(robot, command, payload, wrench=wrench)
    return settled.positions, settled.quaternions


def test_derivatives_are_those_of_finite_differences(robot: tdcr.Robot) -> None:
    rng = np.random.default_rng(5)
    by_positions, by_quaternions = rng.normal(size=(10, 3)), rng.normal(size=(10, 4))
    rates = np.ones(1)
    gradient = tdcr.vjp(robot, [COMMAND], PARAMETERS, by_positions[None], by_quaternions[None], payload=0.02)[0]
    for parameter, derivative in zip(PARAMETERS, gradient, strict=True):
        scale = {"gain": 1.0, "density": 1.0}.get(parameter.partition("[")[0], 1e-5)
        (high, high_turn), (low, low_turn) = moved(robot, parameter, scale), moved(robot, parameter, -scale)
        change, turn = (high - low) / (2.0 * scale), (high_turn - low_turn) / (2.0 * scale)
        positions, quaternions = tdcr.jvp(robot, [COMMAND], [parameter], rates, payload=0.02)
        assert np.abs(positions[0] - change).max() < 1e-5 * max(1e-3, np.abs(change).max()), parameter
        assert np.abs(quaternions[0] - turn).max() < 1e-5 * max(1e-3, np.abs(turn).max()), parameter
        expected = (by_positions * change).sum() + (by_quaternions * turn).sum()
        assert abs(derivative - expected) < 1e-4 * max(abs(expected), 1e-3), parameter
        jacobian = tdcr.jacobian(robot, COMMAND, [parameter], payload=0.02)
        assert np.abs(jacobian[:, :3, 0] - positions[0]).max() < 1e-12


def test_derivatives_of_rows_that_do_not_settle_are_an_error_or_no_numbers(robot: tdcr.Robot) -> None:
    # All tendons slack: upright, on the brink of falling.
    rows, wrench = np.array([COMMAND, COMMAND]), np.zeros((2, 10, 6))
    # A moment that no tendon balances.
    wrench[1, 9, 3] = 10.0
    assert tdcr.settle_batch(robot, rows, wrench=wrench).converged.tolist() == [True, False]
    with pytest.raises(SensitivityError, match="row 1: the robot has not settled"):
        tdcr.jacobian(robot, rows, wrench=wrench)
    jacobian = tdcr.jacobian(robot, rows, wrench=wrench, on_failure="nan")
    assert np.isfinite(jacobian[0]).all() and np.isnan(jacobian[1]).all()
    with pytest.raises(ParameterError, match=r"no parameter `gain\[9\]`: no such tendon"):
        tdcr.jacobian(robot, COMMAND, ["gain[9]"])
    with pytest.raises(ParameterError, match="colour"):
        tdcr.jacobian(robot, COMMAND, ["colour"])


def test_a_force_on_a_point_of_a_disc_is_a_force_and_a_moment_on_its_origin(robot: tdcr.Robot) -> None:
    point, force = np.array([0.01, -0.02, 0.015]), np.array([0.05, 0.02, -0.04])
    at_point = tdcr.Wrench(7, force=tuple(force), frame="disc", point=tuple(point))
    at_origin = tdcr.Wrench(7, force=tuple(force), moment=tuple(np.cross(point, force)), frame="disc")
    found, expected = (tdcr.settle(robot, COMMAND, loads=tdcr.Loads(wrenches=(w,))) for w in (at_point, at_origin))
    assert found.converged and np.abs(found.positions - expected.positions).max() < 1e-9
    assert np.abs(found.positions - tdcr.settle(robot, COMMAND).positions).max() > 1e-4
    with pytest.raises(LoadsError, match=r"point of a wrench has shape \(2,\); expected \(3,\)"):
        tdcr.Loads(wrenches=(tdcr.Wrench(7, point=(0.0, 1.0)),))  # type: ignore[arg-type]
    with pytest.raises(LoadsError, match=r"point of a wrench"):
        tdcr.Loads(wrenches=(tdcr.Wrench(7, point=(0.0, 1.0, float("nan"))),))

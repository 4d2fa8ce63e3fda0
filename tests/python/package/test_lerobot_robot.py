"""A rig as a robot of LeRobot, on a rig in memory: with stand-ins for its base classes, and in LeRobot, where it is installed."""

from __future__ import annotations

import importlib
import os
import shutil
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from test_lerobot import installed

import tdcr

ROOT = Path(__file__).parents[3]
PLUGIN = ROOT / "python/plugins/lerobot_robot_tdcr"
FARTHEST = 0.02 * 0.05
"""What the rig's slew allows in a period (m)."""


@dataclass(kw_only=True)
class Config:
    """RobotConfig of LeRobot."""

    id: str | None = None

    @staticmethod
    def register_subclass(name: str) -> Callable[[type], type]:
        return lambda of: of


class Robot:
    """The base class of robots."""

    name: str

    def __init__(self, config: Config) -> None:
        self.robot_type, self.id = self.name, config.id


class Teleoperator:
    """The base class of teleoperators."""

    def __init__(self, config: Config) -> None:
        self.id = config.id


@pytest.fixture
def small(tmp_path: Path) -> Path:
    text = (ROOT / "examples/rig-sim.toml").read_text()
    (tmp_path / "rig.toml").write_text(text.replace("resolution = [640, 480]", "resolution = [64, 48]"))
    shutil.copy(ROOT / "examples/paper-robot.toml", tmp_path)
    return tmp_path / "rig.toml"


@pytest.fixture
def plugin(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The plug-in on stand-ins."""
    names = ("lerobot", "lerobot.robots", "lerobot.teleoperators", "lerobot.utils", "lerobot.utils.errors")
    modules = {name: ModuleType(name) for name in names}
    vars(modules["lerobot.robots"]).update(Robot=Robot, RobotConfig=Config)
    vars(modules["lerobot.teleoperators"]).update(Teleoperator=Teleoperator, TeleoperatorConfig=Config)
    errors = {name: type(name, (ConnectionError,), {}) for name in ("DeviceAlreadyConnectedError", "DeviceNotConnectedError")}
    vars(modules["lerobot.utils.errors"]).update(errors)
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.syspath_prepend(str(PLUGIN))
    yield importlib.import_module("lerobot_robot_tdcr")
    for name in [name for name in sys.modules if name.startswith("lerobot_robot_tdcr")]:
        del sys.modules[name]


def moves(robot: Any) -> None:
    """Connects, looks, goes 3 mm, and lets go."""
    assert not robot.is_connected
    with pytest.raises(ConnectionError, match="not connected"):
        robot.send_action({})
    robot.connect()
    assert robot.is_connected and robot.is_calibrated
    with pytest.raises(ConnectionError, match="is connected"):
        robot.connect()
    seen = robot.get_observation()
    assert seen.keys() == robot.observation_features.keys()
    for name, kind in robot.observation_features.items():
        assert np.shape(seen[name]) == kind if isinstance(kind, tuple) else isinstance(seen[name], float)
    home = {name: seen[name] for name in robot.action_features}
    goal = home | {"tendon4.pos": home["tendon4.pos"] - 0.003}
    sent = [robot.send_action(goal)["tendon4.pos"] for _ in range(5)]
    np.testing.assert_allclose(home["tendon4.pos"] - np.array(sent), FARTHEST * np.array([1, 2, 3, 3, 3]), atol=1e-4)
    rig = robot._rig
    robot.disconnect()
    assert not robot.is_connected and not rig.engaged


def test_a_rig_is_a_robot_of_lerobot(plugin: Any, small: Path) -> None:
    robot = plugin.TdcrRobot(plugin.TdcrRobotConfig(rig=small, real_time=False))
    assert list(robot.action_features) == [f"tendon{k}.pos" for k in range(6)]
    assert {name: of for name, of in robot.observation_features.items() if of is not float} == dict.fromkeys(
        ("south", "east", "north", "west"), (48, 64, 3)
    )
    assert list(robot.cameras) == ["south", "east", "north", "west"]
    moves(robot)
    blind = plugin.TdcrRobot(plugin.TdcrRobotConfig(rig=small, pictures=False, currents=True, real_time=False))
    assert len(blind.observation_features) == 12
    blind.connect()
    assert blind.get_observation().keys() == blind.observation_features.keys()
    blind.disconnect()


def test_the_robot_holds_its_pose_while_lerobot_is_silent(plugin: Any, small: Path) -> None:
    robot = plugin.TdcrRobot(plugin.TdcrRobotConfig(rig=small, pictures=False, hold=2.0))
    robot.connect()
    before = robot.get_observation()
    # Longer than the watchdog, as LeRobot is while it encodes an episode.
    time.sleep(0.8)
    assert robot.get_observation() == pytest.approx(before, abs=1e-4)
    time.sleep(2.5)
    with pytest.raises(tdcr.errors.RigError, match="silent for 2 s, and robot.hold is 2 s; all motors were switched off"):
        robot.send_action(before)
    robot.disconnect()


def test_actions_end_at_the_limits_of_the_rig(plugin: Any, small: Path) -> None:
    robot = plugin.TdcrRobot(plugin.TdcrRobotConfig(rig=small, pictures=False, real_time=False))
    robot.connect()
    home = {name: value for name, value in robot.get_observation().items() if name in robot.action_features}
    # The first tendon is at its end before the others are where they are wanted.
    goal = {name: value - 0.002 for name, value in home.items()} | {"tendon0.pos": 1.0}
    for _ in range(300):
        sent = robot.send_action(goal)
    assert sent["tendon0.pos"] < 0.9 and sent["tendon0.pos"] > home["tendon0.pos"] + FARTHEST
    assert sent["tendon1.pos"] == pytest.approx(goal["tendon1.pos"], abs=1e-9)
    robot.disconnect()


def test_keys_and_tables_are_actions(plugin: Any, small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = plugin.TdcrRobot(plugin.TdcrRobotConfig(rig=small, pictures=False, real_time=False))
    teleop = plugin.TdcrTeleop(plugin.TdcrTeleopConfig(step=0.003))
    with pytest.raises(ConnectionError, match="not connected"):
        teleop.get_action()
    keys, hand = os.pipe()
    with open(keys) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        teleop.connect()
        with pytest.raises(ConnectionError, match="no robot of type tdcr"):
            teleop.get_action()
        robot.connect()
        names, model = list(robot.action_features), robot._rig.robot
        assert list(teleop.action_features) == names
        os.write(hand, b"dqw")
        tips = []
        for _ in range(4):
            action = teleop.get_action()
            for _ in range(10):
                sent = robot.send_action(action)
            assert sent == pytest.approx(action, abs=1e-9)
            tips.append(tdcr.settle(model, list(action.values())).tip)
        np.testing.assert_allclose(np.diff(tips, axis=0), [[0, 0, 0], [0, 0.003, 0], [0, 0, 0]], atol=1e-4)
        os.close(hand)
        assert teleop.get_action() == action
        teleop.disconnect()
    rows = [[0.1 * k + 0.01 * row for k in range(6)] for row in range(2)]
    lines = ["time (s)," + ",".join(f"c{k} (m)" for k in range(6)), *(f"0,{','.join(map(repr, row))}" for row in rows)]
    (tmp_path / "moves.csv").write_text("\n".join(lines))
    along = plugin.TdcrTeleop(plugin.TdcrTeleopConfig(commands=tmp_path / "moves.csv"))
    along.connect()
    assert [list(along.get_action().values()) for _ in range(3)] == [rows[0], rows[1], rows[0]]
    robot.disconnect()


@pytest.mark.skipif(not (installed("lerobot") and installed("lerobot_robot_tdcr")), reason="LeRobot finds the plug-in")
def test_lerobot_finds_it_by_its_name(small: Path) -> None:
    from lerobot.robots import RobotConfig
    from lerobot.robots.utils import make_robot_from_config
    from lerobot.utils.import_utils import register_third_party_plugins

    register_third_party_plugins()
    config = RobotConfig.get_choice_class("tdcr")(rig=small, real_time=False)
    moves(make_robot_from_config(config))

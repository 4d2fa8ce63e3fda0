"""The node of ROS 2 for a rig, on a rig in memory, with stand-ins for ROS's packages."""

from __future__ import annotations

import importlib.util
import sys
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import tdcr

ROOT = Path(__file__).parents[3]
RIG = ROOT / "examples/rig-sim.toml"
SPEC = importlib.util.spec_from_file_location("ros2_rig", ROOT / "examples/python/ros2_rig.py")
assert SPEC is not None and SPEC.loader is not None
node = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(node)

FARTHEST = 0.02 * 0.05
"""What the rig's slew allows in a period (m)."""


class Message(SimpleNamespace):
    """sensor_msgs/JointState."""

    def __init__(self) -> None:
        super().__init__(header=SimpleNamespace(stamp=None), name=[], position=[], velocity=[], effort=[])


def stand_in(monkeypatch: pytest.MonkeyPatch, controller: Callable[[list[Any]], list[float] | None], cycles: int) -> list[Any]:
    """ROS's packages: ``controller`` makes positions of what was published so far. Returns what is published."""
    published: list[Any] = []
    heard: list[Callable[[Any], None]] = []
    made = SimpleNamespace(
        create_subscription=lambda kind, topic, callback, depth: heard.append(callback),
        create_publisher=lambda kind, topic, depth: SimpleNamespace(publish=published.append),
        get_clock=lambda: SimpleNamespace(now=lambda: SimpleNamespace(to_msg=lambda: None)),
    )

    def spin_once(of: Any, timeout_sec: float) -> None:
        if (positions := controller(published)) is not None:
            heard[0](SimpleNamespace(name=[f"tendon{k}" for k in range(len(positions))], position=positions))

    rclpy = ModuleType("rclpy")
    vars(rclpy).update(
        init=lambda: None,
        create_node=lambda name: made,
        ok=lambda: len(published) < cycles,
        spin_once=spin_once,
        try_shutdown=lambda: None,
    )
    messages = ModuleType("sensor_msgs.msg")
    vars(messages).update(JointState=Message)
    for name, module in (("rclpy", rclpy), ("sensor_msgs", ModuleType("sensor_msgs")), ("sensor_msgs.msg", messages)):
        monkeypatch.setitem(sys.modules, name, module)
    return published


@pytest.fixture
def rig() -> Any:
    with tdcr.Rig(RIG) as opened:
        opened.home(recall=True)
        opened.engage()
        opened.go_home()
        yield opened


def test_the_rig_follows_at_its_slew_once_it_is_asked_where_it_is(
    rig: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    home = np.array(rig.commanded)
    goal = home + np.array([0.0, 0.0, 0.0, -0.003, 0.003, 0.003])

    def controller(published: list[Any]) -> list[float]:
        # At first it is told to be elsewhere, then to stay where it is, then to go; one message is out of range.
        if len(published) == 3:
            return list(published[-1].position)
        return [9.0] * 6 if len(published) == 5 else goal.tolist()

    published = stand_in(monkeypatch, controller, 12)
    node.follow(rig, FARTHEST, timeout=30.0)
    at = np.array([message.position for message in published])
    assert published[0].name == [f"tendon{k}" for k in range(6)] and len(published[0].effort) == 6
    np.testing.assert_allclose(at[:3], np.tile(home, (3, 1)), atol=FARTHEST)
    np.testing.assert_allclose(rig.commanded, goal, atol=1e-5)
    assert np.abs(np.diff(at, axis=0)).max() < 2.0 * FARTHEST
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 2 and "from where the tendons are" in said[0] and "out of ranges or limits" in said[1]


def test_silence_ends_the_node(rig: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    published = stand_in(monkeypatch, lambda published: list(published[-1].position) if len(published) == 1 else None, 10**9)
    # The rig is faster than the wall's clock; ten of its periods here.
    clock = iter(range(10**9))
    monkeypatch.setattr(time, "monotonic", lambda: float(next(clock)))
    with pytest.raises(SystemExit, match="no command for 10.0 s: the tension is released"):
        node.follow(rig, FARTHEST, timeout=10.0)
    assert 5 < len(published) < 20


def test_the_description_has_each_tendon_with_its_range(capsys: pytest.CaptureFixture[str]) -> None:
    node.main([str(RIG), "--description"])
    urdf = ElementTree.fromstring(capsys.readouterr().out)
    names = [f"tendon{k}" for k in range(6)]
    assert [joint.get("name") for joint in urdf.findall("joint")] == names
    assert [joint.get("name") for joint in urdf.findall("ros2_control/joint")] == names
    ranges = tdcr.Robot(ROOT / "examples/paper-robot.toml").command_ranges
    for joint, (low, high) in zip(urdf.findall("joint"), ranges, strict=True):
        limit = joint.find("limit")
        assert limit is not None and limit.get("velocity") == "0.02"
        np.testing.assert_allclose([float(limit.get(end, "nan")) for end in ("lower", "upper")], [low, high], rtol=1e-8)
    assert urdf.findtext("ros2_control/hardware/plugin") == "joint_state_topic_hardware_interface/JointStateTopicSystem"

"""A rig as hardware of ros2_control: a node of ROS 2 that moves the servos where joint commands say, and publishes their states.

    python ros2_rig.py rig.toml --description > rig.urdf    # tendons as joints, with the tag <ros2_control>; needs no ROS
    python ros2_rig.py rig.toml                             # the node, in an environment with ROS 2 and this package

Each tendon is a prismatic joint, `tendon0` and so on: its position is the tendon's command (m), its effort the servo's
current (A). The controller manager's hardware is joint_state_topic_hardware_interface/JointStateTopicSystem, which speaks with
this node by two topics of sensor_msgs/JointState. docs/ros2.md has the whole picture.

The robot follows no faster than the rig's slew, from the first command on that asks for where it is: what a controller says
before it knows the robot moves nothing. The node ends, and the tension is released, where no command has come for `--timeout`
seconds once it follows, and on every other way out.
"""

import argparse
import sys
import time
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

import tdcr

COMMANDS, STATES = "/tdcr/joint_commands", "/tdcr/joint_states"


def description(rig: tdcr.Rig, slew: float) -> str:
    """URDF of the tendons as prismatic joints, with the tag of ros2_control."""
    links, joints = ['  <link name="base"/>'], []
    for tendon, (low, high) in enumerate(rig.robot.command_ranges):
        name = f"tendon{tendon}"
        links.append(
            f'  <link name="{name}_end"/>\n'
            f'  <joint name="{name}" type="prismatic">\n'
            f'    <parent link="base"/><child link="{name}_end"/><axis xyz="0 0 1"/>\n'
            f'    <limit lower="{low:.9g}" upper="{high:.9g}" velocity="{slew:.9g}" effort="0"/>\n'
            "  </joint>"
        )
        joints.append(
            f'    <joint name="{name}">\n'
            '      <command_interface name="position"/><state_interface name="position"/><state_interface name="effort"/>\n'
            "    </joint>"
        )
    hardware = [
        "      <plugin>joint_state_topic_hardware_interface/JointStateTopicSystem</plugin>",
        f'      <param name="joint_commands_topic">{COMMANDS}</param>',
        f'      <param name="joint_states_topic">{STATES}</param>',
        # Each cycle is sent, so that silence means that the controllers are gone.
        '      <param name="trigger_joint_command_threshold">-1</param>',
    ]
    tag = [f'  <ros2_control name={quoteattr(rig.name)} type="system">', "    <hardware>", *hardware, "    </hardware>"]
    return "\n".join([f"<robot name={quoteattr(rig.name)}>", *links, *tag, *joints, "  </ros2_control>", "</robot>", ""])


class Follower:
    """Leads a rig towards the newest command, no faster than its slew, and remembers when that came.

    Args:
        rig: A rig whose motors are on.
        largest: Farthest that a tendon's command may move in a period (m), and that the first command may be from where it is.

    Attributes:
        heard: When the last command came (s, by :func:`time.monotonic`); ``None`` before the first that is followed.
    """

    def __init__(self, rig: tdcr.Rig, largest: float) -> None:
        self.rig, self.largest = rig, largest
        self.target: np.ndarray = np.array(rig.commanded)
        self.seen = self.target.copy()
        self.heard: float | None = None
        self.passed_over = False

    def take(self, names: list[str], positions: list[float]) -> None:
        """Takes joint commands by name; others' joints are passed over, and so is what no servo may be told."""
        target = self.target.copy()
        for name, position in zip(names, positions, strict=False):
            if name.startswith("tendon") and name[6:].isdecimal() and int(name[6:]) < len(target):
                target[int(name[6:])] = position
        if not np.isfinite(target).all() or not self.rig.within_limits(target):
            self.pass_over(f"out of ranges or limits: {target}")
            return
        if self.heard is None and np.abs(target - self.seen).max() > self.largest:
            self.pass_over(f"more than {self.largest} m from where the tendons are, {self.seen}: {target}")
            return
        self.target, self.heard, self.passed_over = target, time.monotonic(), False

    def pass_over(self, why: str) -> None:
        """Says once in a row why commands are not followed."""
        if not self.passed_over:
            print(f"commands are passed over: {why}", file=sys.stderr)
        self.passed_over = True

    def step(self) -> list[tuple[int, Any]]:
        """Takes one of the rig's periods; returns the servos that answered, with their tendons."""
        at = np.array(self.rig.commanded)
        states = self.rig.step(at + np.clip(self.target - at, -self.largest, self.largest))
        known = [(tendon, state) for tendon, state in enumerate(states) if isinstance(state, tdcr.rig.WinchState)]
        for tendon, state in known:
            self.seen[tendon] = state.command
        return known


def follow(rig: tdcr.Rig, largest: float, timeout: float) -> None:
    """The node: until ROS shuts down, or commands cease."""
    import rclpy
    from sensor_msgs.msg import JointState

    rclpy.init()
    try:
        node = rclpy.create_node("tdcr_rig")
        follower = Follower(rig, largest)
        node.create_subscription(JointState, COMMANDS, lambda message: follower.take(message.name, message.position), 1)
        publisher = node.create_publisher(JointState, STATES, 10)
        while rclpy.ok():
            rclpy.spin_once(node, timeout_sec=0.0)
            if follower.heard is not None and time.monotonic() - follower.heard > timeout:
                raise SystemExit(f"no command for {timeout} s: the tension is released")
            known = follower.step()
            message = JointState()
            message.header.stamp = node.get_clock().now().to_msg()
            message.name = [f"tendon{tendon}" for tendon, _ in known]
            message.position = [state.command for _, state in known]
            message.effort = [state.pull for _, state in known]
            publisher.publish(message)
    finally:
        rclpy.try_shutdown()


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path, help="the rig's file")
    parser.add_argument("--description", action="store_true", help="print the URDF and end")
    parser.add_argument("--timeout", type=float, default=0.5, help="silence after which the tension is released (s, %(default)s)")
    options = parser.parse_args(arguments)
    with tdcr.Rig(options.file, real_time=True) as rig:
        if options.description:
            print(description(rig, rig.slew), end="")
            return
        if set(rig.homing()) != {"homed"}:
            raise SystemExit("not homed: tdcr home first")
        rig.engage()
        rig.go_home()
        follow(rig, rig.slew * rig.period, options.timeout)


if __name__ == "__main__":
    main()

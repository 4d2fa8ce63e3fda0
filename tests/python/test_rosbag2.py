"""Logs as bags of ROS 2, read by the PyPI package `rosbags`, by the definitions inside the bag."""

import math
import pathlib

import numpy as np
import pytest
from test_log import SAMPLE, Log

pytest.importorskip("rosbags", reason="rosbags reads bags")
from rosbags.highlevel import AnyReader


@pytest.fixture(scope="module")
def bag(tdcr, tmp_path_factory):
    """All messages by topic, with their times (s), and what `tdcr log export` says."""
    folder = tmp_path_factory.mktemp("bags") / "bag"
    said = tdcr("log", "export", SAMPLE, "--format", "rosbag2", "--out", folder)
    messages = {}
    # Without types of its own: the bag has them.
    with AnyReader([pathlib.Path(folder)]) as reader:
        for connection, time, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            messages.setdefault(connection.topic, []).append((time / 1e9, connection.msgtype, message))
        count = reader.message_count
    return messages, said, count


def one(bag, topic, kind):
    ((time, found, message),) = bag[0][topic]
    assert found == kind
    return time, message


def test_every_message_that_ros_has_is_in_the_bag(bag):
    messages, said, count = bag
    assert sum(len(of) for of in messages.values()) == said["messages"] == count
    # Temperatures, homes and registers.
    assert said["left_out"] == 3 and said["messages"] + said["left_out"] == 15 and said["whole"]
    assert {topic["topic"]: topic["messages"] for topic in said["topics"]} == {t: len(m) for t, m in messages.items()}


def test_servos_are_joint_states(bag):
    log = Log(SAMPLE)
    time, present = one(bag, "/servos/present", "sensor_msgs/msg/JointState")
    (ours,) = log.messages["/servos/present"]
    assert present.header.stamp.sec + present.header.stamp.nanosec / 1e9 == pytest.approx(time, abs=1e-9)
    assert list(present.name) == [joint.name for joint in ours.joints]
    for name in ("position", "velocity", "effort"):
        np.testing.assert_array_equal(getattr(present, name), [getattr(joint, name) for joint in ours.joints])
    _, goals = one(bag, "/servos/goals", "sensor_msgs/msg/JointState")
    told = [joint.position if joint.HasField("position") else math.nan for joint in log.messages["/servos/goals"][0].joints]
    np.testing.assert_array_equal(goals.position, told)


def test_pictures_and_clouds_are_those_of_the_log(bag):
    log = Log(SAMPLE)
    images = [m for topic, of in bag[0].items() if topic.endswith("/image_raw") for _, _, m in of]
    assert {image.encoding for image in images} >= {"rgb8", "16UC1"}
    for image in images:
        size = {"rgb8": 3, "16UC1": 2, "32FC1": 4}[image.encoding]
        assert len(image.data) == image.step * image.height == size * image.width * image.height
    ours = {message.data for topic, of in log.messages.items() if topic.endswith("/depth") for message in of}
    assert ours == {bytes(image.data) for image in images if image.encoding != "rgb8"}
    _, cloud = one(bag, "/cloud", "sensor_msgs/msg/PointCloud2")
    (theirs,) = log.messages["/cloud"]
    rows = np.frombuffer(theirs.data, np.uint8).reshape(-1, theirs.point_stride)
    read = np.frombuffer(bytes(cloud.data), np.uint8).reshape(-1, cloud.point_step)
    assert cloud.width == len(rows) and [field.name for field in cloud.fields] == ["x", "y", "z", "rgb"]
    np.testing.assert_array_equal(read[:, :12], rows[:, :12])
    # Blue comes first.
    np.testing.assert_array_equal(read[:, 14:11:-1], rows[:, 12:15])


def test_cameras_frames_and_events_come_along(bag):
    log = Log(SAMPLE)
    _, info = one(bag, "/camera_0123/color/camera_info", "sensor_msgs/msg/CameraInfo")
    (ours,) = log.messages["/cameras/0123/calibration"]
    assert (info.width, info.height, info.header.frame_id) == (ours.width, ours.height, ours.frame_id)
    np.testing.assert_array_equal(info.k, ours.K)
    np.testing.assert_array_equal(info.d, ours.D)
    _, tf = one(bag, "/tf", "tf2_msgs/msg/TFMessage")
    (frames,) = log.messages["/tf"]
    for frame, of in zip(tf.transforms, frames.transforms, strict=True):
        assert (frame.header.frame_id, frame.child_frame_id) == (of.parent_frame_id, of.child_frame_id)
        assert frame.transform.translation.x == of.translation.x and frame.transform.rotation.w == of.rotation.w
    events = [message.msg for _, kind, message in bag[0]["/events"] if kind == "rcl_interfaces/msg/Log"]
    assert events == [message.message for message in log.messages["/events"]]
    _, urdf = one(bag, "/robot_description", "std_msgs/msg/String")
    assert urdf.data == log.messages["/robot_description"][0]["data"]
    _, command = one(bag, "/command", "std_msgs/msg/Float64MultiArray")
    assert list(command.data) == log.messages["/command"][0]["values"]

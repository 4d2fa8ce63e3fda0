"""Logs of a rig, as `hw/tests/log/` writes them, read by the libraries of MCAP and of Foxglove's protobuf schemas."""

import io
import json
import math
import pathlib

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from PIL import Image

SAMPLE = pathlib.Path(__file__).parents[2] / "hw/tests/data/sample.mcap"
TURN = 4096


class Log:
    """All messages of a log by topic, decoded, with their schemas and times (s)."""

    def __init__(self, path):
        self.messages, self.schemas, self.times, self.order = {}, {}, {}, []
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
            self.summary = reader.get_summary()
            file.seek(0)
            # JSON is not decoded by the library.
            for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages(log_time_order=False):
                if schema.encoding == "protobuf":
                    decoded = DecoderFactory().decoder_for("protobuf", schema)(message.data)
                else:
                    assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
                    decoded = json.loads(message.data)
                    check(decoded, json.loads(schema.data))
                self.messages.setdefault(channel.topic, []).append(decoded)
                self.schemas[channel.topic] = schema.name
                self.times.setdefault(channel.topic, []).append(message.log_time / 1e9)
                self.order.append(channel.topic)

    def one(self, topic, schema):
        (message,) = self.messages[topic]
        assert self.schemas[topic] == schema
        return message


def check(value, schema):
    """Checks `value` against what our JSON schemas use of JSON Schema."""
    kinds = {"object": dict, "array": list, "string": str, "integer": int, "number": (int, float), "boolean": bool}
    assert isinstance(value, kinds[schema["type"]]), (value, schema)
    assert "enum" not in schema or value in schema["enum"]
    if schema["type"] == "object":
        assert set(schema.get("required", [])) <= set(value) <= set(schema["properties"])
        for key, item in value.items():
            check(item, schema["properties"][key])
    if schema["type"] == "array":
        for item in value:
            check(item, schema["items"])


@pytest.fixture(scope="module")
def log():
    return Log(SAMPLE)


def test_there_is_a_message_of_each_kind_10_ms_apart(log):
    assert log.summary.statistics.message_count == len(log.order) == 15
    assert log.order[:3] == ["/robot_description", "/cameras/0123/calibration", "/cameras/pinhole/calibration"]
    times = sorted(time for times in log.times.values() for time in times)
    np.testing.assert_allclose(times, np.arange(15) * 0.01, rtol=0, atol=1e-12)


def test_servos(log):
    present = log.one("/servos/present", "foxglove.JointStates")
    assert [joint.name for joint in present.joints] == ["servo_1", "servo_2", "servo_3"]
    ticks = [joint.position * TURN / math.tau for joint in present.joints]
    np.testing.assert_allclose(ticks, [-(2**31), 2**31 - 1, 6789], rtol=1e-15)
    assert [joint.velocity for joint in present.joints] == [-0.024, 0.0, 1e-300]
    assert [joint.effort for joint in present.joints] == [0.1 + 0.2, -1e-3, 0.0]

    first, second = log.one("/servos/goals", "foxglove.JointStates").joints
    assert (first.name, round(first.position * TURN / math.tau)) == ("servo_1", -1234)
    assert not first.HasField("effort")
    assert (second.name, second.effort) == ("servo_2", 0.1234)
    assert not second.HasField("position")

    known, unknown = log.one("/servos/status", "tdcr.ServoStatus")["servos"]
    errors = known.pop("hardware_errors")
    assert {name for name, there in errors.items() if there} == {"overload"}
    assert known == {
        "id": 1,
        "model": 1200,
        "firmware": 52,
        "torque": "on",
        "mode": "current_based_position",
        "current_limit": 0.35,
        "watchdog": "armed",
        "watchdog_timeout": 0.5,
        "temperature": 31.0,
        "voltage": 5.1,
    }
    assert unknown == {"id": 252}
    homes = log.one("/servos/homes", "tdcr.Homes")
    assert homes == {"servos": [{"id": 3, "home": -4100, "last": 6789}]}
    registers = log.one("/servos/registers", "tdcr.Registers")
    assert registers == {"id": 3, "address": 0x7FFF, "bytes": [0, 255, 17]}


def test_robot(log):
    assert log.one("/robot_description", "std_msgs/String") == {"data": '<robot name="é"/>'}
    assert log.one("/command", "tdcr.Command") == {"values": [0.1 + 0.2, -0.0, 1e-17]}
    event = log.one("/events", "foxglove.Log")
    assert (event.level, event.name, event.message) == (3, "servo 3", "did not answer within 20 ms")
    (transform,) = log.one("/tf", "foxglove.FrameTransforms").transforms
    assert (transform.parent_frame_id, transform.child_frame_id) == ("world", "camera_0123")
    at, turn = transform.translation, transform.rotation
    assert (at.x, at.y, at.z) == (0.5, -1e-9, 1 / 3)
    expected = np.array([-0.7, 0.3, 0.2, 0.1])
    np.testing.assert_allclose([turn.x, turn.y, turn.z, turn.w], expected / np.linalg.norm(expected), rtol=1e-15)


def test_cameras(log):
    calibration = log.one("/cameras/0123/calibration", "foxglove.CameraCalibration")
    assert (calibration.width, calibration.height, calibration.frame_id) == (3, 2, "camera_0123")
    assert list(calibration.K) == [612.345, 0, 1.03, 0, 611.1, 0.47, 0, 0, 1]
    assert list(calibration.P) == [612.345, 0, 1.03, 0, 0, 611.1, 0.47, 0, 0, 0, 1, 0]
    assert (calibration.distortion_model, list(calibration.D)) == ("plumb_bob", [0.1, -0.2, 1e-3, -2e-4, 0.03])
    color = log.one("/cameras/0123/color", "foxglove.CompressedImage")
    assert (color.format, color.frame_id) == ("png", "camera_0123")
    pixels = np.array(Image.open(io.BytesIO(color.data)))
    expected = np.array([[i * 40, 255 - i, 6] for i in range(6)])
    np.testing.assert_array_equal(pixels, expected.reshape(2, 3, 3))

    millimetres, metres = log.messages["/cameras/0123/depth"]
    assert (millimetres.encoding, millimetres.step, millimetres.width, millimetres.height) == ("16UC1", 6, 3, 2)
    depth = np.frombuffer(millimetres.data, "<u2").reshape(2, 3)
    np.testing.assert_array_equal(depth, [[0, 500, 123], [1000, 65535, 700]])
    assert (metres.encoding, metres.step, metres.width, metres.height) == ("32FC1", 4, 1, 2)
    depth = np.frombuffer(metres.data, "<f4")
    np.testing.assert_array_equal(depth, np.array([0.123456, math.inf], np.float32))


def test_cloud(log):
    cloud = log.one("/cloud", "foxglove.PointCloud")
    assert cloud.frame_id == "world"
    formats = {7: "<f4", 1: "u1"}
    dtype = np.dtype(
        {
            "names": [field.name for field in cloud.fields],
            "formats": [formats[field.type] for field in cloud.fields],
            "offsets": [field.offset for field in cloud.fields],
            "itemsize": cloud.point_stride,
        }
    )
    points = np.frombuffer(cloud.data, dtype)
    tiny = np.finfo(np.float32).tiny
    xyz = np.array([[0.1, -0.2, 0.3], [tiny, 1e9, -0.0]], np.float32)
    for axis, values in zip("xyz", xyz.T):
        np.testing.assert_array_equal(points[axis], values)
    assert [tuple(point)[3:] for point in points] == [(1, 2, 3, 255), (255, 0, 128, 255)]


def test_messages_have_the_time_of_their_log(log):
    present = log.one("/servos/present", "foxglove.JointStates")
    assert present.timestamp.seconds + present.timestamp.nanos / 1e9 == pytest.approx(log.times["/servos/present"][0])

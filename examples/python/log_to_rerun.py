"""A rig's log as a recording of Rerun, in which joints are curves and depth is depth.

    pip install rerun-sdk mcap mcap-protobuf-support
    python examples/python/log_to_rerun.py captured/log.mcap --out log.rrd
    rerun log.rrd

Rerun opens a log by itself (`rerun captured/log.mcap`): colours, clouds, calibrations, transforms and events. This adds what
it then shows as bytes or as plain pictures: positions, velocities and currents of servos, commands and temperatures as curves
(`/servos`, `/command`), and depth images in metres, in the view of their cameras (`/cameras/SERIAL`).
"""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory


def messages(path: Path) -> Iterator[tuple[str, int, Any]]:
    """Topic, time (ns since the Unix epoch) and content of each message, decoded by its own schema."""
    protobuf = DecoderFactory()
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if schema.encoding == "protobuf":
                decode = protobuf.decoder_for("protobuf", schema)
                content = decode(message.data)
            else:
                content = json.loads(message.data)
            yield channel.topic, message.log_time, content


def depth(image: Any) -> rr.DepthImage:
    """A depth image with the length of its unit."""
    millimetres = image.encoding == "16UC1"
    pixels = np.frombuffer(image.data, "<u2" if millimetres else "<f4").reshape(image.height, image.width)
    return rr.DepthImage(pixels, meter=1000.0 if millimetres else 1.0)


def color(image: Any) -> rr.EncodedImage | rr.Image:
    """A colour image, compressed or not."""
    if hasattr(image, "format"):
        return rr.EncodedImage(contents=image.data, media_type=f"image/{image.format}")
    return rr.Image(np.frombuffer(image.data, np.uint8).reshape(image.height, image.width, 3))


def cloud(message: Any) -> rr.Points3D:
    """A point cloud with its colours, if it has any."""
    offsets = {field.name: field.offset for field in message.fields}
    rows = np.frombuffer(message.data, np.uint8).reshape(-1, message.point_stride)
    points = np.ascontiguousarray(rows[:, offsets["x"] : offsets["x"] + 12]).view("<f4")
    channels = [offsets[name] for name in ("red", "green", "blue") if name in offsets]
    return rr.Points3D(points, colors=rows[:, channels] if channels else None)


def log_joints(topic: str, message: Any) -> None:
    """What is known of each servo, as curves."""
    for joint in message.joints:
        for name, label in (("position", "position_rad"), ("velocity", "velocity_rad_s"), ("effort", "current_A")):
            if joint.HasField(name):
                rr.log(f"{topic}/{joint.name}/{label}", rr.Scalars(getattr(joint, name)))


def log_message(topic: str, message: Any) -> None:
    """One message in Rerun's own types; events and what describes the rig are not drawn."""
    if topic in ("/servos/present", "/servos/goals"):
        log_joints(topic, message)
    elif topic == "/servos/status":
        for servo in message["servos"]:
            if servo.get("temperature") is not None:
                rr.log(f"{topic}/servo_{servo['id']}/temperature_C", rr.Scalars(servo["temperature"]))
    elif topic == "/command":
        for tendon, value in enumerate(message["values"]):
            rr.log(f"{topic}/tendon{tendon}", rr.Scalars(value))
    elif topic == "/tf":
        for frame in message.transforms:
            place, turn = frame.translation, frame.rotation
            transform = rr.Transform3D(
                translation=[place.x, place.y, place.z],
                quaternion=rr.Quaternion(xyzw=[turn.x, turn.y, turn.z, turn.w]),
                parent_frame=frame.parent_frame_id,
                child_frame=frame.child_frame_id,
            )
            rr.log(f"{topic}/{frame.child_frame_id}", transform)
    elif topic.endswith("/calibration"):
        pinhole = rr.Pinhole(
            image_from_camera=np.reshape(message.K, (3, 3)),
            resolution=[message.width, message.height],
            parent_frame=message.frame_id,
            child_frame=f"{message.frame_id}/image",
        )
        rr.log(topic, pinhole)
    elif topic.endswith("/color"):
        rr.log(topic, color(message), rr.CoordinateFrame(f"{message.frame_id}/image"))
    elif topic.endswith("/depth"):
        rr.log(topic, depth(message), rr.CoordinateFrame(f"{message.frame_id}/image"))
    elif topic == "/cloud":
        rr.log(topic, cloud(message), rr.CoordinateFrame(message.frame_id))
    elif topic == "/events":
        rr.log(topic, rr.TextLog(message.message))


def layout(cameras: list[str], servos: list[str]) -> rrb.Blueprint:
    """What the viewer shows first: clouds and cameras in the world, what a camera sees, events, and curves of all servos."""
    world = rrb.Spatial3DView(
        name="world",
        contents=["/**", *(f"- {camera}/depth" for camera in cameras)],
        spatial_information=rrb.SpatialInformation("world"),
    )
    seen = [rrb.Spatial2DView(name=camera.split("/")[-1], origin=camera) for camera in cameras[:1]]
    present = [f"/servos/present/{servo}" for servo in servos]
    curves = [
        rrb.TimeSeriesView(name=name, contents=contents, plot_legend=rrb.PlotLegend(visible=False))
        for name, contents in (
            ("positions (rad)", [f"{servo}/position_rad" for servo in present]),
            ("currents (A)", [f"{servo}/current_A" for servo in present]),
            ("commands (m or N)", ["/command/**"]),
        )
    ]
    left = rrb.Vertical(world, rrb.TextLogView(name="events", origin="/events"), row_shares=[3, 1])
    return rrb.Blueprint(
        rrb.Horizontal(left, rrb.Vertical(*seen, *curves), column_shares=[3, 2]),
        rrb.TimePanel(timeline="time", play_state="following", state="collapsed"),
        collapse_panels=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log", type=Path, help="a log of a rig (MCAP)")
    parser.add_argument("--out", type=Path, default=Path("log.rrd"), help="the recording to write")
    args = parser.parse_args()
    rr.init("tdcr_log", spawn=False)
    rr.save(args.out)
    count = 0
    cameras, servos = dict[str, None](), dict[str, None]()
    for topic, time, message in messages(args.log):
        rr.set_time("time", timestamp=np.datetime64(time, "ns"))
        log_message(topic, message)
        count += 1
        if topic.endswith("/depth"):
            cameras[topic.removesuffix("/depth")] = None
        elif topic == "/servos/present":
            servos |= dict.fromkeys(joint.name for joint in message.joints)
    rr.send_blueprint(layout(list(cameras), list(servos)))
    print(f"{args.out}: {count} messages")


if __name__ == "__main__":
    main()

"""Logs of rigs (MCAP) as series of values: what LeRobot's frames are made of."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from tdcr.errors import DataError, MissingPackageError

STATE, ACTION, IMAGES = "observation.state", "action", "observation.images"
"""LeRobot's names of features."""

Message = tuple[float, str, Any]
"""Time (s), key and value of what is of use: ``positions`` with angles by name, ``command``, or a picture by its camera."""


@dataclass(frozen=True)
class Channels:
    """What a log has.

    Attributes:
        servos: Names.
        tendons: How many.
        pictures: Height and width of each camera's pictures, by its serial number.
        depths: The same of its depth; none where depth is not wanted.
    """

    servos: tuple[str, ...]
    tendons: int
    pictures: dict[str, tuple[int, int]]
    depths: dict[str, tuple[int, int]]

    @classmethod
    def of(cls, path: Path, depth: bool) -> Channels:
        """Looks through a log.

        Raises:
            DataError: For a log without positions of servos or without commands.
        """
        servos: dict[str, None] = {}
        tendons = 0
        sizes: dict[str, tuple[int, int]] = {}
        for _, key, value in messages_of(path):
            if key == "positions":
                servos |= dict.fromkeys(value)
            elif key == "command":
                tendons = len(value)
            else:
                sizes[key] = value.size
        if not servos or not tendons:
            missing = "commands" if servos else "positions of servos"
            raise DataError(f"{path}: no {missing}; expected the log of a robot that moves")
        pictures = {key: size for key, size in sizes.items() if not key.endswith("_depth")}
        depths = {key: size for key, size in sizes.items() if depth and key.endswith("_depth")}
        return cls(tuple(servos), tendons, pictures, depths)

    @property
    def keys(self) -> set[str]:
        """Keys of all messages that frames are made of."""
        return {"positions", "command", *self.pictures, *self.depths}

    def features(self) -> dict[str, Any]:
        """LeRobot's description of the frames."""
        actions = [f"tendon{tendon}.pos" for tendon in range(self.tendons)]
        return features_of([f"{servo}.pos" for servo in self.servos], actions, self.pictures, bool(self.depths))

    def merged(self, key: str, before: Any, value: Any) -> Any:
        """A new value; servos that say nothing are where they were."""
        return {**(before or {}), **value} if key == "positions" else value

    def complete(self, known: dict[str, Any]) -> bool:
        """Whether there is something for each part of a frame."""
        return known.keys() == self.keys and known["positions"].keys() == set(self.servos)

    def frame(self, known: dict[str, Any]) -> dict[str, Any]:
        """A frame, but for its task."""
        frame = {
            STATE: np.array([known["positions"][servo] for servo in self.servos], np.float32),
            ACTION: np.array(known["command"], np.float32),
        }
        return frame | {f"{IMAGES}.{key}": known[key].pixels for key in (*self.pictures, *self.depths)}


def features_of(state: list[str], action: list[str], sizes: dict[str, Any], depth: bool) -> dict[str, Any]:
    """LeRobot's description of frames with pictures of these sizes by their cameras' names, and depth of each, if wanted."""
    features: dict[str, Any] = {
        STATE: {"dtype": "float32", "shape": (len(state),), "names": state},
        ACTION: {"dtype": "float32", "shape": (len(action),), "names": action},
    }
    for camera, (height, width) in sizes.items():
        names = ["height", "width", "channels"]
        features[f"{IMAGES}.{camera}"] = {"dtype": "video", "shape": (height, width, 3), "names": names}
        if depth:
            one = {"dtype": "video", "shape": (height, width, 1), "names": names, "info": {"is_depth_map": True}}
            features[f"{IMAGES}.{camera}_depth"] = one
    return features


def messages_of(path: Path) -> Iterator[Message]:
    """What is of use in a log, in the order of time.

    Raises:
        MissingPackageError: Where a package that reads logs is not installed.
        DataError: For a file that is no log, or is damaged.
    """
    try:
        from mcap.reader import make_reader
        from mcap_protobuf.decoder import DecoderFactory
    except ImportError as error:
        raise MissingPackageError("reading logs needs pip install mcap mcap-protobuf-support") from error
    protobuf = DecoderFactory()
    try:
        with path.open("rb") as file:
            for schema, channel, message in make_reader(file).iter_messages():
                if not _of_use(channel.topic):
                    continue
                if schema is not None and schema.encoding == "protobuf":
                    decode = protobuf.decoder_for("protobuf", schema)
                    content = None if decode is None else decode(message.data)
                else:
                    content = json.loads(message.data)
                key, value = _read(channel.topic, content)
                yield message.log_time / 1e9, key, value
    except Exception as error:
        # Whatever a decoder says of damaged bytes.
        raise DataError(f"{path}: not the log of a rig: {error}") from error


def _of_use(topic: str) -> bool:
    return topic in ("/servos/present", "/command") or topic.endswith(("/color", "/depth"))


def _read(topic: str, content: Any) -> tuple[str, Any]:
    if topic == "/servos/present":
        return "positions", {joint.name: joint.position for joint in content.joints if joint.HasField("position")}
    if topic == "/command":
        return "command", content["values"]
    camera = topic.split("/")[-2]
    if topic.endswith("/depth"):
        return f"{camera}_depth", Picture(content)
    return camera, Picture(content)


class Picture:
    """Colours or depth, decoded when they are looked at."""

    def __init__(self, message: Any) -> None:
        self._message = message

    @cached_property
    def _encoded(self) -> Any:
        # LeRobot brings it.
        from PIL import Image

        return Image.open(io.BytesIO(self._message.data))

    @property
    def size(self) -> tuple[int, int]:
        """Height and width."""
        if hasattr(self._message, "format"):
            return self._encoded.height, self._encoded.width
        return self._message.height, self._message.width

    @cached_property
    def pixels(self) -> Any:
        """8-bit RGB, shape (height, width, 3); or depth, (height, width, 1), in millimetres as integers or in metres."""
        message = self._message
        if hasattr(message, "format"):
            return np.asarray(self._encoded.convert("RGB"))
        kind = {"16UC1": "<u2", "32FC1": "<f4"}.get(message.encoding, "u1")
        return np.frombuffer(message.data, kind).reshape(*self.size, -1)

"""Logs of rigs for ROS 2."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tdcr import _tdcr
from tdcr._files import as_path
from tdcr.data import PathLike


@dataclass(frozen=True)
class Bag:
    """A bag of ROS 2 that was written.

    Attributes:
        folder: Its folder.
        topics: Type and number of the messages of each topic.
        left_out: Messages of the log that ROS 2 has no message for.
        whole: Whether all of the log could be read; a damaged one leads to a bag of what could.
    """

    folder: Path
    topics: dict[str, tuple[str, int]]
    left_out: int
    whole: bool

    @property
    def messages(self) -> int:
        """Messages of all topics."""
        return sum(messages for _, messages in self.topics.values())


def export_rosbag2(log: PathLike, out: PathLike) -> Bag:
    """Writes a log of a rig as a bag of ROS 2, which needs nothing of ROS; as ``tdcr log export``.

    Args:
        log: The log (``.mcap``).
        out: Folder of the bag; there must be none.

    Raises:
        DataError: For a file that is no log, and a folder that is there or cannot be written.
    """
    topics, left_out, whole = _tdcr.export_rosbag2(as_path(log, "log"), as_path(out, "out"))
    return Bag(Path(out), {topic: (kind, messages) for topic, kind, messages in topics}, left_out, whole)

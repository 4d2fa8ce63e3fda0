"""First robot files."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tdcr import _tdcr
from tdcr._arrays import as_count, as_flag, as_number, as_text
from tdcr._files import as_file, as_path, write_whole
from tdcr.data import PathLike
from tdcr.errors import InputError
from tdcr.robot import Robot


def new(
    file: PathLike,
    *,
    segments: int = 2,
    discs: int = 10,
    tendons: int = 3,
    length: float = 0.1,
    backbone: Literal["steel", "nitinol"] = "steel",
    radius: float = 0.0005,
    servos: Literal["tension", "position"] = "tension",
    force: bool = False,
) -> Robot:
    """Writes a robot file to start from, with comments that say what to change; as ``tdcr new``.

    Args:
        file: The file (``.toml``); its name is the robot's.
        segments: Segments that bend on their own.
        discs: Discs of each segment.
        tendons: Tendons of each segment, evenly around its axis.
        length: Length of each segment (m).
        backbone: What the wire through the discs is made of.
        radius: Radius of that wire (m).
        servos: What servos are told: the tension of each tendon (N), or how much of it is not wound up (m).
        force: Whether a file that is there is replaced.

    Returns:
        The robot of the file.

    Raises:
        InputError: For a name that does not end in ``.toml``, a folder that is missing, and a file that is there.
        RobotError: For counts and sizes that no robot has.
    """
    path = as_file(file, "file", ".toml")
    if path.exists() and not as_flag(force, "force"):
        raise InputError(f"{as_path(file, 'file')} is there already; force=True replaces it")
    text = _tdcr.sketch(
        path.stem,
        as_count(segments, "segments"),
        as_count(discs, "discs"),
        as_count(tendons, "tendons"),
        as_number(length, "length"),
        as_text(backbone, "backbone"),
        as_number(radius, "radius"),
        as_text(servos, "servos"),
    )
    write_whole(Path(path), text.encode())
    return Robot(path)

"""Episodes for LeRobot (https://github.com/huggingface/lerobot): logs of rigs and simulated motions as its data sets (version 3).

LeRobot's own writer makes the files, Parquet and MP4, so they are those of the version that is installed
(``pip install ".[lerobot]"``).
``tdcr data export --format lerobot`` is :func:`export_logs` and :func:`export_commands` on the command line.
"""

from __future__ import annotations

import logging
import math
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tdcr._arrays import Floats, as_count, as_flag, as_float, as_list, as_text
from tdcr._files import as_path, as_paths
from tdcr._recorded import ACTION, IMAGES, STATE, Channels, Message, features_of, messages_of
from tdcr.data import PathLike
from tdcr.dynamics import Motion, simulate
from tdcr.errors import DataError, InputError, MissingPackageError
from tdcr.robot import Robot, RobotLike, as_robot
from tdcr.vision import View, render

__all__ = ["export_commands", "export_logs", "export_motions"]

_LOG = logging.getLogger(__name__)

_TIME_STEP = 0.002
"""Longest time step of a simulated episode (s): that of :func:`tdcr.simulate`."""

_WHOLE = 1e-6
"""How far a number of frames per second may be from a whole one."""


def export_logs(
    logs: Sequence[PathLike],
    out: PathLike,
    *,
    fps: int = 10,
    task: str = "",
    repo_id: str = "tdcr/recorded",
    videos: bool = True,
    depth: bool = False,
) -> Path:
    """Writes logs of rigs as a data set of LeRobot, an episode each.

    A frame has what was known last at its time: ``observation.state``, the positions of the servos from home (rad,
    ``servo_1.pos``, ...); ``action``, the command (m, ``tendon0.pos``, ...); and ``observation.images.SERIAL``, the picture of
    each camera, with ``depth`` also ``observation.images.SERIAL_depth``. Episodes begin when there is one of each. A log of
    ``tdcr capture`` has pictures where the robot rests, so its frames between show the last one again.

    Args:
        logs: Logs (``.mcap``) of one rig.
        out: Folder of the data set; there must be none.
        fps: Frames per second.
        task: What the robot does, in words, for policies that read them.
        repo_id: Name of the data set, ``user/name``.
        videos: Whether pictures become MP4 videos; else they are kept without loss, in the Parquet files.
        depth: Whether depth is written too, by a version of LeRobot that has depth (0.6).

    Returns:
        The folder.

    Raises:
        MissingPackageError: Where ``lerobot``, ``mcap`` or ``mcap-protobuf-support`` is not installed, or LeRobot has no depth.
        DataError: For a folder that is there, a log that cannot be read, is of another rig than the first, or has no command,
            positions or, if a camera is in it, pictures.
    """
    paths = [Path(path) for path in as_paths(logs, "logs")]
    if not paths:
        raise InputError("logs is empty; expected at least one log")
    rate, depth = as_count(fps, "fps", 1, 1000), as_flag(depth, "depth")
    channels = Channels.of(paths[0], depth)
    with _written(out, rate, channels.features(), repo_id, videos, depth) as data:
        for path in paths:
            if path != paths[0] and Channels.of(path, depth) != channels:
                raise DataError(f"{path}: other servos, tendons or cameras than in {paths[0]}; expected logs of one rig")
            count = 0
            for frame in _resampled(messages_of(path), channels, rate):
                data.add_frame(frame | {"task": as_text(task, "task")})
                count += 1
            if count == 0:
                raise DataError(f"{path}: at no time are positions, a command and all pictures known")
            data.save_episode()
            _LOG.info("%s: %d frames", path, count)
    return Path(out)


def _resampled(messages: Iterator[Message], channels: Channels, fps: int) -> Iterator[dict[str, Any]]:
    """Frames at regular times, of what was known last."""
    known: dict[str, Any] = {}
    first, count = None, 0
    for time, key, value in messages:
        # A frame has what came before its time.
        while first is not None and first + count / fps < time:
            yield channels.frame(known)
            count += 1
        if key in channels.keys:
            known[key] = channels.merged(key, known.get(key), value)
        if first is None and channels.complete(known):
            first = time


def export_commands(
    robot: RobotLike,
    commands: Sequence[Any],
    out: PathLike,
    *,
    fps: int = 10,
    cameras: Sequence[int] = (0,),
    task: str = "",
    repo_id: str = "tdcr/simulated",
    videos: bool = True,
    depth: bool = False,
) -> Path:
    """Simulates a robot under sequences of commands and writes what it did as a data set of LeRobot, an episode each.

    Args:
        robot: The robot, which starts straight and at rest.
        commands: For each episode, an array of shape (T, tendons), T at least 2 (m or N); each command holds for a frame.
        out, cameras, task, repo_id, videos, depth: As of :func:`export_motions`, whose frames these are.
        fps: Frames per second. Time steps are the longest of a whole number in a frame that are no longer than 2 ms.

    Raises:
        DynamicsError: For a robot that needs shorter time steps.
        CommandError: For a command that the robot cannot take.
        MissingPackageError, InputError, DataError: As of :func:`export_motions`.
    """
    # Before what takes time.
    _writer(as_flag(depth, "depth"))
    robot = as_robot(robot)
    rate = as_count(fps, "fps", 1, 1000)
    steps = math.ceil(1.0 / (rate * _TIME_STEP))
    episodes = []
    for k, given in enumerate(as_list(commands, "commands")):
        array = as_float(given, f"commands[{k}]", ("T", robot.tendons))
        episodes.append((array, simulate(robot, array, dt=1.0 / (rate * steps), frame_skip=steps)))
    return export_motions(robot, episodes, out, cameras=cameras, task=task, repo_id=repo_id, videos=videos, depth=depth)


def export_motions(
    robot: RobotLike,
    episodes: Sequence[tuple[Any, Motion]],
    out: PathLike,
    *,
    cameras: Sequence[int] = (0,),
    task: str = "",
    repo_id: str = "tdcr/simulated",
    videos: bool = True,
    depth: bool = False,
) -> Path:
    """Writes simulated motions as a data set of LeRobot, an episode each.

    A frame is of the state after one command: ``observation.state``, the lengths of the tendons (m, ``tendon0.length``, ...) and
    the place of the tip (m, ``tip.x``, ...); ``observation.images.camera0``, what a camera sees then; and ``action``, the next
    command (m or N, ``tendon0.pos``, ...). The first command has no frame of its own.

    Args:
        robot: The robot.
        episodes: Commands, shape (T, tendons), with the motion that :func:`tdcr.simulate` makes of them, for each episode. The
            times of a frame, ``dt * frame_skip``, are a whole number of frames per second, the same in all.
        out: Folder of the data set; there must be none.
        cameras: Numbers of the robot's cameras whose pictures are written; none where it is empty.
        task, repo_id, videos, depth: As of :func:`export_logs`.

    Raises:
        MissingPackageError: Where ``lerobot`` is not installed, or has no depth.
        InputError: For motions that do not fit the robot or one another.
        DataError: For a folder that is there.
    """
    robot = as_robot(robot)
    depth = as_flag(depth, "depth")
    chosen = [as_count(camera, "an entry of cameras") for camera in as_list(cameras, "cameras")]
    given = [_Episode.of(robot, one, f"episodes[{k}]") for k, one in enumerate(as_list(episodes, "episodes"))]
    if not given:
        raise InputError("episodes is empty; expected at least one")
    if len(rates := {episode.fps for episode in given}) > 1:
        raise InputError(f"episodes have {sorted(rates)} frames per second; expected the same in all")
    views = _views(robot, given[0].motion.configuration[0], chosen)
    tendons = range(robot.tendons)
    state = [f"tendon{tendon}.length" for tendon in tendons] + ["tip.x", "tip.y", "tip.z"]
    sizes = {f"camera{camera}": views[camera].depth.shape for camera in chosen}
    features = features_of(state, [f"tendon{tendon}.pos" for tendon in tendons], sizes, depth)
    with _written(out, given[0].fps, features, repo_id, videos, depth) as data:
        for k, episode in enumerate(given):
            for frame in episode.frames():
                seen = _views(robot, frame.pop("configuration"), chosen)
                for camera in chosen:
                    frame[f"{IMAGES}.camera{camera}"] = seen[camera].color
                    if depth:
                        frame[f"{IMAGES}.camera{camera}_depth"] = seen[camera].depth[..., np.newaxis]
                data.add_frame(frame | {"task": as_text(task, "task")})
            data.save_episode()
            _LOG.info("episode %d of %d: %d frames", k + 1, len(given), len(episode.commands) - 1)
    return Path(out)


@dataclass(frozen=True)
class _Episode:
    """Commands, the motion that they lead to, and its frames per second."""

    commands: Floats
    motion: Motion
    fps: int

    @classmethod
    def of(cls, robot: Robot, given: Any, name: str) -> _Episode:
        if not isinstance(given, list | tuple) or len(given) != 2 or not isinstance(given[1], Motion):
            raise InputError(f"{name} is {type(given).__name__}; expected a pair of commands and the Motion that they lead to")
        motion: Motion = given[1]
        commands = as_float(given[0], f"the commands of {name}", (len(motion), robot.tendons))
        if motion.positions.shape[1] != robot.discs or motion.lengths.shape[1] != robot.tendons:
            expected = f"{robot.discs} discs and {robot.tendons} tendons"
            raise InputError(f"the motion of {name} is of another robot; expected {expected}")
        if len(motion) < 2:
            raise InputError(f"{name} has {len(motion)} commands; expected at least 2")
        rate = (len(motion) - 1) / (motion.times[-1] - motion.times[0])
        if abs(rate - round(rate)) > _WHOLE * rate:
            expected = "a whole number, by `dt` and `frame_skip` of the simulation"
            raise InputError(f"{name} has {rate:.6g} frames per second; expected {expected}")
        return cls(commands, motion, round(rate))

    def frames(self) -> Iterator[dict[str, Any]]:
        """Frames without pictures, with the ``configuration`` that these show."""
        for k, action in enumerate(self.commands[1:]):
            state = np.concatenate([self.motion.lengths[k], self.motion.tip[k]]).astype(np.float32)
            yield {STATE: state, ACTION: action.astype(np.float32), "configuration": self.motion.configuration[k]}


def _views(robot: Robot, configuration: Floats, cameras: list[int]) -> list[View]:
    """Pictures of a pose by all cameras, if some are wanted."""
    if not cameras:
        return []
    views = render(robot, configuration)
    if max(cameras) >= len(views):
        raise InputError(f"camera {max(cameras)}; the robot has {len(views)} cameras, from 0")
    return views


def _writer(depth: bool) -> Any:
    """LeRobot's writer of data sets."""
    try:
        from lerobot.datasets.lerobot_dataset import LeRobotDataset, LeRobotDatasetMetadata
    except ImportError as error:
        reason = f"tdcr.lerobot needs LeRobot, which cannot be imported ({error}): pip install 'lerobot[dataset]'"
        raise MissingPackageError(reason) from error
    if depth and not hasattr(LeRobotDatasetMetadata, "depth_keys"):
        raise MissingPackageError("this LeRobot has no depth: pip install 'lerobot[dataset]>=0.6', or leave depth out")
    return LeRobotDataset


@contextmanager
def _written(out: PathLike, fps: int, features: dict[str, Any], repo_id: str, videos: bool, depth: bool) -> Iterator[Any]:
    """A data set to add episodes to: its folder is there, whole, at the end, or not at all."""
    writer = _writer(depth)
    folder = Path(as_path(out, "out")).absolute()
    if folder.exists():
        raise DataError(f"{folder} is there already; expected none")
    if not folder.parent.is_dir():
        raise DataError(f"there is no folder {folder.parent}")
    if not as_flag(videos, "videos"):
        stills = {name: of | {"dtype": "image"} for name, of in features.items() if of["dtype"] == "video"}
        features = features | stills
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}.") as beside:
        part = Path(beside) / folder.name
        name = as_text(repo_id, "repo_id")
        data = writer.create(name, fps, features, root=part, robot_type="tdcr", use_videos=videos)
        yield data
        data.finalize()
        os.replace(part, folder)

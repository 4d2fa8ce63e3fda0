"""Making data sets: all at once, in parts on several machines, or from clouds of other programs."""

from __future__ import annotations

import json
import warnings
from collections.abc import Sequence
from typing import Any, Literal

from tdcr import _tdcr
from tdcr._arrays import Progress, as_count, as_flag, as_number, as_text, maybe_text
from tdcr._files import as_path, as_paths
from tdcr.data import MOST, Dataset, PathLike, as_payload, as_seed, as_variation, folder_of
from tdcr.robot import Robot
from tdcr.scene import Scene, as_scene, nothing


def collect(
    robot: Robot | PathLike | dict[str, Any] = "2m",
    out: PathLike = "data",
    *,
    samples: int = 1000,
    points: int = 10_000,
    voxel: float = 0.002,
    base: bool = False,
    payload: tuple[float, float] | None = None,
    noise: Literal["d435"] | None = None,
    design: Literal["uniform", "latin-hypercube", "sobol", "grid"] = "uniform",
    seed: int = 0,
    part: str | None = None,
    scene: Scene | None = None,
    vary_obstacles: float | tuple[float, float] | None = None,
    progress: Progress | None = None,
) -> Dataset | None:
    """Makes a data set: settles commands, sees each robot with its cameras, keeps the clouds; as ``tdcr collect``.

    The files are a function of the arguments. Interrupted by Ctrl-C, by an exception of ``progress``, or killed, the same call
    goes on where it stopped. With more ``samples`` (designs ``uniform`` and ``sobol``) it adds to the data set, whose splits
    are then drawn anew.

    Args:
        robot: A robot, or what :class:`tdcr.Robot` makes one of.
        out: Folder of the data set, or of the part.
        samples: Number of commands, split 80/10/10 into train, val and test; at least 10.
        points: Points per cloud.
        voxel: Edge of the voxels that thin the fused clouds (m).
        base: Whether the cameras see the robot's base.
        payload: Smallest and largest mass that hangs from the tip (kg); a tenth of the samples has exactly 0.
        noise: ``"d435"`` simulates the noise of that depth camera.
        design: How commands and payloads are chosen.
        seed: Seed of commands, samples, faults and splits.
        part: ``"I/N"`` collects the ``I``-th of ``N`` equal parts alone, in a folder of its own, for :func:`merge`.
        scene: Obstacles around the robot, which settles among them. They hide from the cameras what is behind them; the clouds
            are of the robot alone. ``meta.json`` holds the scene, meshes included.
        vary_obstacles: Moves the scene's obstacles but half spaces anew for each sample, by up to so much along each axis (m), or
            as ``(shift, turn)`` also about each (rad). The displacement of each obstacle, then its rotation vector if it turns,
            follow the command in conditions.
        progress: Is called with the number of samples made since its last call, as ``tqdm(total=samples).update``; those that
            were made before count at its first.

    Returns:
        The data set; ``None`` for a part, which is none before it is merged.

    Raises:
        InputError, RobotError: For arguments of which no data set can be made.
        DataError: For a folder that holds something else, or cannot be written; or if the robot does not settle.
    """
    options = {
        "samples": as_count(samples, "samples"),
        "points": as_count(points, "points", 1, MOST),
        "voxel": as_number(voxel, "voxel"),
        "base": as_flag(base, "base"),
        "payload": as_payload(payload),
        "noise": maybe_text(noise, "noise"),
        "vary_obstacles": as_variation(vary_obstacles, scene),
        "design": as_text(design, "design"),
        "seed": as_seed(seed),
        "part": maybe_text(part, "part"),
    }
    around = nothing() if scene is None else as_scene(scene)
    _tdcr.collect(Robot(robot)._native, around._native, as_path(out, "out"), json.dumps(options), progress=progress)
    return None if part is not None else Dataset(out)


def merge(parts: Sequence[PathLike], out: PathLike, progress: Progress | None = None) -> Dataset:
    """Makes a data set of the parts that :func:`collect` made with ``part="I/N"``; as ``tdcr data merge``.

    Its files are byte for byte those of one call without ``part``. The parts stay as they are. Interrupted, the same call begins
    anew.

    Args:
        parts: Folders of all parts, in any order.
        out: Folder of the data set.
        progress: Is called with the number of steps done since its last call.

    Raises:
        DataError: For parts that are missing, unfinished, there twice or of another data set; the message names them.
    """
    _tdcr.merge(as_paths(parts, "parts"), as_path(out, "out"), progress=progress)
    return Dataset(out)


def import_clouds(
    folder: PathLike,
    out: PathLike,
    *,
    units: Literal["m", "cm", "mm"] = "m",
    points: int = 10_000,
    voxel: float | None = None,
    split: PathLike | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Dataset:
    """Makes a data set of clouds of other programs; as ``tdcr data import``.

    Interrupted by Ctrl-C or by an exception of ``progress``, the same call goes on where it stopped. Files of
    other endings and columns that may be colours of unknown names are passed over with a warning.

    Args:
        folder: Clouds (``.ply``, ``.pcd``, ``.npy``, ``.npz``) and beside each a motor file ``{"ctrl": [...]}`` of its name.
        out: Folder of the data set.
        units: Unit of the clouds.
        points: Points per cloud.
        voxel: Edge of the voxels that thin the clouds (m); they are not thinned where it is not given.
        split: A CSV file of lines ``NAME,SPLIT``; 80, 10 and 10 % by chance where it is not given.
        seed: Seed of the points that are kept, and of the splits.
        progress: Is called with the number of clouds read since its last call.

    Raises:
        DataError: For files that cannot be read; the message names the file and what is wrong with it.
    """
    notes = _tdcr.import_clouds(
        as_path(folder, "folder"),
        as_path(out, "out"),
        as_text(units, "units"),
        as_count(points, "points", 1, MOST),
        None if voxel is None else as_number(voxel, "voxel"),
        None if split is None else as_path(split, "split"),
        as_seed(seed),
        progress,
    )
    for note in notes:
        warnings.warn(f"{as_path(folder, 'folder')}: {note}", stacklevel=2)
    return Dataset(out)


def export_clouds(
    dataset: Dataset | PathLike,
    out: PathLike,
    format: Literal["ply", "npz"] = "ply",
    *,
    progress: Progress | None = None,
) -> int:
    """Writes the clouds of a data set as files of their own, with their conditions beside them; as ``tdcr data export``.

    Each split has a folder of its own in ``out``. Interrupted by Ctrl-C or by an exception of ``progress``, nothing is
    left there.

    Args:
        dataset: The data set, or its folder.
        out: Folder of the clouds, which holds nothing yet.
        format: Binary PLY, or NumPy archives of ``points`` and ``rgb``.
        progress: Is called with the number of clouds written since its last call.

    Returns:
        How many clouds.
    """
    return _tdcr.export_clouds(folder_of(dataset), as_text(format, "format"), as_path(out, "out"), progress)

"""Studies: sweeps over designs, loads and commands that one file, or one dictionary, describes."""

from __future__ import annotations

import functools
import json
import os
import warnings
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from tdcr import _tdcr
from tdcr._arrays import Progress, as_count, maybe_text
from tdcr._dictionary import as_json, in_its_words
from tdcr._files import as_path, as_paths
from tdcr.data import PathLike
from tdcr.errors import InputError
from tdcr.scene import Scene, as_scene
from tdcr.sweeps import sweep


def study(
    file: PathLike | dict[str, Any],
    out: PathLike = "study",
    *,
    part: str | None = None,
    scene: Scene | None = None,
    engine: Literal["ray"] | None = None,
    parts: int = 16,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Runs a study; as ``tdcr study``. The guide is :doc:`/studies`.

    The folder gets ``table.csv`` and ``table.parquet`` (a row for each configuration), ``summary.csv``, ``study.json``,
    ``report.html`` and ``figures/*.svg``. Interrupted by Ctrl-C, by an exception of ``progress``, or killed, the same call goes
    on where it stopped.

    What is passed over in robots' files of other tools is warned of.

    Args:
        file: The study's file, or what it holds as a dictionary. Robots that a dictionary names by path are looked for in the
            working directory.
        out: Folder of the results.
        part: ``"I/N"`` runs the ``I``-th of ``N`` equal parts alone, in a folder of its own, for :func:`merge_study`.
        scene: Obstacles around the robot, in place of those of the study.
        engine: ``"ray"`` runs ``parts`` parts as tasks of the Ray cluster, into folders below ``out``, which all of its machines
            must see, and merges them: the same files. Without it, the study runs on the threads of this process.
        parts: Number of those parts.
        progress: Is called with the number of configurations done since its last call; with ``engine="ray"``, of parts.

    Returns:
        What ``tdcr study --json`` prints: ``dir``, ``rows``, how many ``settled``, and ``seconds``.

    Raises:
        InputError: For a study that is none; its key, and what would be right, are said.
        SceneError: For a scene whose meshes have too many triangles for a record.
        DataError: For a folder that holds something else, or cannot be written.
    """
    folder = as_path(out, "out")
    if engine is None:
        return _run(file, folder, part, scene, progress)
    if not (isinstance(engine, str) and engine == "ray"):
        raise InputError(f"engine is {engine!r}; expected None or 'ray'")
    if part is not None:
        raise InputError("part is given beside engine='ray', which runs all parts; expected one of them")
    parts = as_count(parts, "parts", 1, 100_000)
    folders = [os.path.join(folder, "parts", f"part-{number}-of-{parts}") for number in range(1, parts + 1)]
    numbered = [(f"{number}/{parts}", place) for number, place in enumerate(folders, 1)]
    sweep(functools.partial(_run_part, file, scene), numbered, "ray", progress=progress)
    return merge_study(folders, folder)


def merge_study(parts: Sequence[PathLike], out: PathLike) -> dict[str, Any]:
    """Puts the parts of a study together; as ``tdcr study merge``.

    Args:
        parts: Folders of all parts, in any order. They are only read.
        out: Folder of the results: tables, summary and report byte for byte those of a run without parts.

    Returns:
        What :func:`study` returns.

    Raises:
        InputError: For folders that are not all parts of one study, each finished and there once.
        DataError: For a folder that cannot be read or written.
    """
    said: dict[str, Any] = json.loads(_tdcr.merge_study(as_paths(parts, "parts"), as_path(out, "out")))
    return said


def _run(
    file: PathLike | dict[str, Any], out: str, part: str | None, scene: Scene | None, progress: Progress | None = None
) -> dict[str, Any]:
    part = maybe_text(part, "part")
    around = None if scene is None else as_scene(scene)._native
    if not isinstance(file, Mapping):
        text, notes = _tdcr.study(as_path(file, "file"), None, out, part, around, progress)
    else:
        written = as_json(file, "the study")
        with in_its_words(written):
            text, notes = _tdcr.study("of a dictionary", written, out, part, around, progress)
    for note in notes:
        warnings.warn(note, stacklevel=3)
    said: dict[str, Any] = json.loads(text)
    return said


def _run_part(file: PathLike | dict[str, Any], scene: Scene | None, numbered: tuple[str, str]) -> dict[str, Any]:
    part, out = numbered
    return _run(file, out, part, scene)

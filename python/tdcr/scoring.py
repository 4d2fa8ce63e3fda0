"""Scores of predicted clouds beside trivial predictors and the sampling floor; data sets beside each other."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from tdcr import _tdcr
from tdcr._arrays import Progress, as_array, as_count, as_flag, as_float, as_number, as_text, maybe_count
from tdcr._files import as_file, write_whole
from tdcr.data import Dataset, PathLike, as_seed, folder_of
from tdcr.errors import InputError
from tdcr.metrics import as_clouds
from tdcr.predictor import Method, Precision, Predictor, sampler_options
from tdcr.robot import Robot


def evaluate(
    model: Predictor | PathLike | Sequence[Predictor | PathLike] | None = None,
    data: Dataset | PathLike = "data",
    *,
    predictions: Any = None,
    colors: Any = None,
    commands: Any = None,
    points: int | None = None,
    emd_points: int | None = None,
    tests: int | None = None,
    worst: int = 5,
    report: PathLike | None = None,
    seed: int = 0,
    sampler: Method | None = None,
    sampler_steps: int | None = None,
    sampler_power: float | None = None,
    sampler_tolerance: float | None = None,
    sampler_denoise: float | None = None,
    sampler_spare: float | None = None,
    precision: Precision | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Scores a trained model, or the clouds of any program, on the test commands of a data set, beside trivial predictors and the
    sampling floor; several of them beside each other; as ``tdcr eval``.

    Args:
        model: The model, its file, or the folder of its run, or a list of such; ``"run"`` by default, without ``predictions``.
        data: The data set, or its folder.
        predictions: Clouds to score: shape (T, N, 3), world frame (m), one for each test command in the order of the test
            split, or for the first ones that ``tests`` scores; or an NPZ file of ``points``, and maybe ``rgb`` and
            ``commands``, and ``method`` (a name), ``training_seconds`` and ``prediction_seconds``. Several: a list of
            such files, or a dictionary of names to arrays or files. One alone beside no ``model`` is called "predictions", a file
            among several by the name in it, or its own.
        colors: Colours of an array of ``predictions``, shape (T, N, 3), uint8, if they have any.
        commands: Conditions of an array of ``predictions``, shape (T, D), which are checked against the test split's; of several
            arrays those of all.
        points: Points of each cloud that the Chamfer distance is computed on; 10,000 by default, or as many as the clouds have.
        emd_points: Points of each cloud that the exact earth mover's distances are computed on; 2,000 by default, or as many.
        tests: Test commands to score, the first ones of their split; ``None``: all.
        worst: How many of the worst test commands to list, and to show in the report.
        report: An HTML page of the scores to write: table, distribution, pictures of the worst predictions.
        seed: Seed of noise and subsets.
        sampler: How the flow is integrated, as of :meth:`Predictor.predict`.
        sampler_steps: Number of steps.
        sampler_power: Exponent of the time grid.
        sampler_tolerance: Tolerance of adaptive steps.
        sampler_denoise: Flow time of the last denoising; 1: none.
        sampler_spare: Share of spare points.
        precision: Operand type of the network's matrix products, of a model that is read.
        progress: Is called with the number of test commands scored since its last call.

    Returns:
        What ``tdcr eval --json`` prints: ``points`` and ``emd_points`` that were compared; ``cd`` and ``emd_squared`` (m²),
        ``emd`` (m), the same with ``_nearest`` (cloud of the nearest training command), ``_mean``, ``_floor`` and so on;
        ``network_quantiles`` and the ``worst`` test commands. Of several methods these are of the first, and ``methods`` has a
        row for each, and for what they are compared with: ``name``, ``kind``, ``cd``, ``cd_over_floor``, ``emd``,
        ``emd_squared``, ``tip``, ``training_seconds`` (of all processors), ``prediction_seconds`` (``None`` where it is not
        known), ``quantiles``, ``best`` and ``worst``.

    Raises:
        InputError: For clouds that do not fit, two methods of one name, more points than there are, and a report that is no
            ``.html`` file in a folder that is there.
        DataError: For a data set that cannot be read.
        TrainError: For a model that cannot be read, or is of another robot than the data set.
    """
    of_model = {
        "sampler": sampler,
        "sampler_steps": sampler_steps,
        "sampler_power": sampler_power,
        "sampler_tolerance": sampler_tolerance,
        "sampler_denoise": sampler_denoise,
        "sampler_spare": sampler_spare,
        "precision": precision,
    }
    scored: list[_Scored] = []
    if predictions is None or model is not None:
        how = sampler_options(sampler, sampler_steps, sampler_power, sampler_tolerance, sampler_denoise, sampler_spare)
        scored += _models("run" if model is None else model, precision, how)
    else:
        for name, value in of_model.items():
            if value is not None:
                raise InputError(f"{name} is of a model; predictions are scored")
    if predictions is None:
        for name, value in (("colors", colors), ("commands", commands)):
            if value is not None:
                raise InputError(f"{name} is of predictions; a model is scored")
    else:
        scored += _predictions(predictions, colors, commands)
    options = {
        "points": maybe_count(points, "points"),
        "emd_points": maybe_count(emd_points, "emd_points"),
        "tests": None if tests is None else as_count(tests, "tests"),
        "seed": as_seed(seed),
    }
    listed = as_count(worst, "worst")
    page = None if report is None else as_file(report, "report", ".html")
    methods, labels = [(one.name, one.native) for one in scored], [one.label for one in scored]
    text, html = _tdcr.evaluate(
        methods, labels, folder_of(data), json.dumps(options), listed, page is not None, progress=progress
    )
    if page is not None and html is not None:
        write_whole(page, html.encode())
    results: dict[str, Any] = json.loads(text)
    return results


def compare(
    a: Dataset | PathLike,
    b: Dataset | PathLike | None = None,
    *,
    robot: Robot | PathLike | dict[str, Any] | None = None,
    base: bool = False,
    match: Literal["condition", "index"] = "condition",
    tolerance: float = 1e-3,
    split: Literal["all", "train", "val", "test"] = "all",
    points: int | None = None,
    emd_points: int | None = None,
    worst: int = 5,
    seed: int = 0,
    report: PathLike | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Compares two data sets, or a captured one with the simulator, configuration by configuration; as ``tdcr compare``.

    Args:
        a: A data set, or its folder.
        b: Another one; by default what the simulator sees under the commands and payloads of ``a``, with perfect cameras.
        robot: The robot to simulate where there is no ``b``; that of ``a`` by default.
        base: Whether the simulator's cameras see the base, where ``a`` does not say.
        match: How samples are paired: those of equal commands and payloads, or of one index in one split.
        tolerance: Largest difference of a number of two conditions that count as equal, as a part of its range in both.
        split: Which samples to compare.
        points: Points of each cloud that the Chamfer distance is computed on; by default as many as the smaller clouds have, at
            most 10,000.
        emd_points: Points of each cloud that the exact earth mover's distances are computed on; as many by default, at most
            2,000.
        worst: How many of the worst configurations, by Chamfer distance, to list and to show in the report.
        seed: Seed of the points that are compared.
        report: An HTML page to write: table, pictures of both clouds over each other, a 3-D view of the worst.
        progress: Is called with the number of configurations compared since its last call.

    Returns:
        What ``tdcr compare --json`` prints: of ``cd`` and ``emd_squared`` (m²), ``emd`` and ``tip`` (m) mean, median and other
        quantiles; ``configurations`` with the distances of each; ``worst``, places of the worst in that list.

    Raises:
        InputError: For data sets without a configuration in common, a robot that nobody names, and more points than there are.
        DataError: For a data set that cannot be read, and a robot that does not settle.
    """
    if b is not None and (robot is not None or base):
        raise InputError("robot and base are of the simulator; two data sets are compared")
    if not 0.0 <= as_number(tolerance, "tolerance") <= 1.0:
        raise InputError(f"tolerance is {tolerance}; expected 0 to 1")
    options = {
        "match": as_text(match, "match"),
        "tolerance": as_number(tolerance, "tolerance"),
        "split": as_text(split, "split"),
        "points": maybe_count(points, "points"),
        "emd_points": maybe_count(emd_points, "emd_points"),
        "seed": as_seed(seed),
    }
    in_view, listed = as_flag(base, "base"), as_count(worst, "worst")
    page = None if report is None else as_file(report, "report", ".html")
    first, second = folder_of(a), None if b is None else folder_of(b)
    simulated = None if robot is None else Robot(robot)._native
    text, html = _tdcr.compare(
        first, second, simulated, in_view, json.dumps(options), listed, page is not None, progress=progress
    )
    if page is not None and html is not None:
        write_whole(page, html.encode())
    return {"a": first, "b": second, **json.loads(text)}


@dataclass(frozen=True)
class _Scored:
    """A method that is scored."""

    #: Its name; None: that of its kind or file.
    name: str | None
    #: What the page calls it.
    label: str
    #: What the native module takes.
    native: Any


def _models(model: Any, precision: Precision | None, how: Any) -> list[_Scored]:
    """One model, or several, which go by their files."""
    several = model if isinstance(model, list | tuple) else [model]
    if not several:
        raise InputError("model is an empty list; expected one model or more")
    found = []
    for one in several:
        if isinstance(one, Predictor) and precision is not None:
            raise InputError(f"precision is of a model that is read; this one predicts in {one.precision}")
        predictor = one if isinstance(one, Predictor) else Predictor(one, precision)
        name = predictor.path if len(several) > 1 else None
        found.append(_Scored(name, predictor.path, (predictor._native, how)))
    return found


def _predictions(predictions: Any, colors: Any, commands: Any) -> list[_Scored]:
    """Clouds of any program, as an array or as its file, or several of them."""
    if isinstance(predictions, Mapping):
        if not predictions:
            raise InputError("predictions is an empty dictionary; expected clouds of one method or more")
        named = {as_text(name, "a name of predictions"): value for name, value in predictions.items()}
        return [_clouds(name, value, colors, commands) for name, value in named.items()]
    if isinstance(predictions, list | tuple) and predictions and all(isinstance(one, str | os.PathLike) for one in predictions):
        return [_clouds(None, one, colors, commands) for one in predictions]
    return [_clouds(None, predictions, colors, commands)]


def _clouds(name: str | None, predictions: Any, colors: Any, commands: Any) -> _Scored:
    """Clouds of one method."""
    label = "predictions" if name is None else f"predictions of {name}"
    if isinstance(predictions, str | os.PathLike):
        for given, value in (("colors", colors), ("commands", commands)):
            if value is not None:
                raise InputError(f"{given} beside a file of predictions; expected them in the file")
        return _Scored(name, os.fspath(predictions), os.fspath(predictions))
    clouds = as_clouds(predictions, label)
    if colors is not None:
        colors = np.ascontiguousarray(as_array(colors, "colors"))
        if colors.dtype != np.uint8 or colors.shape != clouds.shape:
            raise InputError(
                f"colors has shape {colors.shape} of {colors.dtype}; expected {clouds.shape} of uint8, as the {label}"
            )
    if commands is not None:
        rows = as_float(commands, "commands", ("rows", "numbers")).astype(np.float32)
        if len(rows) != len(clouds):
            raise InputError(f"commands has {len(rows)} rows; expected {len(clouds)}, one for each cloud of the {label}")
        commands = rows
    return _Scored(name, "arrays", (clouds, colors, commands))

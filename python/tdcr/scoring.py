"""Scores of predicted clouds beside trivial predictors and the sampling floor; data sets beside each other."""

from __future__ import annotations

import json
import os
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
    model: Predictor | PathLike | None = None,
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
    sampling floor; as ``tdcr eval``.

    Args:
        model: The model, its file, or the folder of its run; ``"run"`` by default.
        data: The data set, or its folder.
        predictions: Clouds to score instead of a model's: shape (T, N, 3), world frame (m), one for each test command in the
            order of the test split; or an NPZ file of ``points``, and maybe ``rgb`` and ``commands``.
        colors: Colours of ``predictions``, shape (T, N, 3), uint8, if they have any.
        commands: Conditions of ``predictions``, shape (T, D), which are checked against the test split's.
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
        ``network_quantiles`` and the ``worst`` test commands.

    Raises:
        InputError: For clouds that do not fit, more points than there are, and a report that is no ``.html`` file in a folder
            that is there.
        DataError: For a data set that cannot be read.
        TrainError: For a model that cannot be read, or is of another robot than the data set.
    """
    scored: Any
    if predictions is None:
        for name, value in (("colors", colors), ("commands", commands)):
            if value is not None:
                raise InputError(f"{name} is of predictions; a model is scored")
        if isinstance(model, Predictor):
            if precision is not None:
                raise InputError(f"precision is of a model that is read; this one predicts in {model.precision}")
            predictor = model
        else:
            predictor = Predictor("run" if model is None else model, precision)
        name = predictor.path
        how = sampler_options(sampler, sampler_steps, sampler_power, sampler_tolerance, sampler_denoise, sampler_spare)
        scored = (predictor._native, how)
    else:
        of_model = {
            "model": model,
            "sampler": sampler,
            "sampler_steps": sampler_steps,
            "sampler_power": sampler_power,
            "sampler_tolerance": sampler_tolerance,
            "sampler_denoise": sampler_denoise,
            "sampler_spare": sampler_spare,
            "precision": precision,
        }
        for name, value in of_model.items():
            if value is not None:
                raise InputError(f"{name} is of a model; predictions are scored")
        scored = _scored(predictions, colors, commands)
        name = scored if isinstance(scored, str) else "arrays"
    options = {
        "points": maybe_count(points, "points"),
        "emd_points": maybe_count(emd_points, "emd_points"),
        "tests": None if tests is None else as_count(tests, "tests"),
        "seed": as_seed(seed),
    }
    listed = as_count(worst, "worst")
    page = None if report is None else as_file(report, "report", ".html")
    text, html = _tdcr.evaluate(
        scored, folder_of(data), json.dumps(options), listed, None if page is None else name, progress=progress
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


def _scored(predictions: Any, colors: Any, commands: Any) -> Any:
    """Clouds of any program, as arrays or as their file."""
    if isinstance(predictions, str | os.PathLike):
        for name, value in (("colors", colors), ("commands", commands)):
            if value is not None:
                raise InputError(f"{name} beside a file of predictions; expected them in the file")
        return os.fspath(predictions)
    clouds = as_clouds(predictions, "predictions")
    if colors is not None:
        colors = np.ascontiguousarray(as_array(colors, "colors"))
        if colors.dtype != np.uint8 or colors.shape != clouds.shape:
            raise InputError(
                f"colors has shape {colors.shape} of {colors.dtype}; expected {clouds.shape} of uint8, as the predictions"
            )
    if commands is not None:
        rows = as_float(commands, "commands", ("rows", "numbers")).astype(np.float32)
        if len(rows) != len(clouds):
            raise InputError(f"commands has {len(rows)} rows; expected {len(clouds)}, one for each cloud")
        commands = rows
    return clouds, colors, commands

"""Robots calibrated on recordings of what they did."""

from __future__ import annotations

import json
import os
import tomllib
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tdcr import _tdcr
from tdcr._arrays import Floats, Progress, as_count, as_flag, as_texts, maybe_number
from tdcr._dictionary import as_table, in_its_words
from tdcr._files import as_file, as_path, write_whole
from tdcr._results import Result
from tdcr.data import PathLike
from tdcr.robot import Robot, RobotLike, as_robot


@dataclass(frozen=True, eq=False, repr=False)
class Replayed(Result):
    """A recording beside what the calibrated robot says of it.

    Attributes:
        times: When each row was recorded, shape (rows,) (s).
        patterns: The motion that each row belongs to.
        lines: The line of each row in its file; of clouds the number of the sample, from 0.
        pulls: What the servos reported, shape (rows, tendons) (m or N).
        measured: Measured markers, shape (rows, markers, 3), world frame (m); NaN where not measured. There are none beside
            clouds.
        predicted: The same points by the calibrated robot; NaN where it did not settle.
    """

    times: Floats
    patterns: tuple[str, ...]
    lines: tuple[int, ...]
    pulls: Floats
    measured: Floats
    predicted: Floats


@dataclass(frozen=True, eq=False, repr=False)
class RecordingCalibration(Result):
    """A robot calibrated on a recording.

    Attributes:
        robot: The calibrated robot.
        columns: The column map with what was found of servos and markers.
        train_rmse: Root mean square distance of the markers from where the robot says, mean offset aligned, or of the clouds'
            points from its surface (m).
        validation_rmse: The same of the other recording, if there was one.
        parameters: What was found: ``name``, ``value``, ``interval`` (95 %), ``unit`` and so on of each unknown.
        found: All that ``tdcr calibrate --json`` prints.
        train: The recording that it was fitted to.
        validation: The other one.
    """

    robot: Robot
    columns: dict[str, Any]
    train_rmse: float
    validation_rmse: float | None
    parameters: tuple[dict[str, Any], ...]
    found: dict[str, Any]
    train: Replayed
    validation: Replayed | None
    _columns_text: str

    def save(self, path: PathLike) -> None:
        """Writes the robot file ``path`` (.toml) and, beside it, the column map ``NAME.columns.toml``.

        Raises:
            InputError: For a name that does not end in ``.toml``, or a folder that is not there.
        """
        file = as_file(path, "path", ".toml")
        self.robot.save(file)
        write_whole(Path(file).with_suffix(".columns.toml"), self._columns_text.encode())


def calibrate_recording(
    robot: RobotLike,
    data: PathLike,
    columns: PathLike | Mapping[str, Any] | None = None,
    *,
    validate: PathLike | None = None,
    fit: Sequence[str] | None = None,
    priors: PathLike | Mapping[str, Mapping[str, Any]] | None = None,
    loss: float | None = None,
    starts: int = 1,
    seed: int = 0,
    skip_bad_rows: bool = False,
    report: PathLike | None = None,
    progress: Progress | None = None,
) -> RecordingCalibration:
    """Calibrates a robot on a recording of what its servos and markers did, or on clouds of it; as ``tdcr calibrate``.

    The guide is :doc:`/sim-to-real`.

    Args:
        robot: The robot as it was designed, or what :class:`tdcr.Robot` makes one of.
        data: The recording: a table of markers (CSV with a header), the folder of a data set, whose train split is fitted to, or
            the log of a capture (``.mcap``).
        columns: Which column holds what: a TOML file, or a dictionary of the same keys. Data sets and logs need none.
        validate: Another recording with the same columns, or of clouds where ``data`` has clouds, to validate the calibrated
            robot on; where not given, of a data set its val and test splits.
        fit: Groups of unknowns; those of the default ones that the robot has, where none are given. ``[]`` fits nothing,
            ``["default", "friction"]`` friction besides the default ones. With ``"servo_map"``, which servo pulls which tendon,
            and which way, is found first; with the default ones only where ``columns`` is clearly wrong, and so is the frame of
            the recording.
        priors: What is known of unknowns before the fit, by the name of a group or of an unknown as ``parameters`` has it: a TOML
            file, or a dictionary from the name to ``spread`` (standard deviation, of factors and gains a share), ``bounds``
            (lowest and highest value), ``value`` (the mean, where the fit starts) and ``unit`` (which is compared); what is not
            said is as the robot and the groups have it.
        loss: Distance (m) beyond which a residual counts less than by its square; a fortieth of the robot's length.
        starts: Starts of the fit: the robot's own values, then others at random.
        seed: Seed of the random starts.
        skip_bad_rows: Leave out rows that cannot be used, with a warning; without it, they are named and refused.
        report: The page to write (.html).
        progress: Is called with the number of steps done since its last call.

    Raises:
        DataError: For a recording that cannot be read, or has bad rows.
        InputError: For a column map that does not fit or is missing, priors of nothing that is fitted, or a recording that says
            too little.
    """
    robot = as_robot(robot)
    text, chosen = as_table(columns, "columns")
    believed, known = as_table(priors, "priors")
    options = {
        "fit": None if fit is None else as_texts(fit, "fit"),
        "loss": maybe_number(loss, "loss"),
        "starts": as_count(starts, "starts", 1, 65535),
        "seed": as_count(seed, "seed"),
        "skip_bad_rows": as_flag(skip_bad_rows, "skip_bad_rows"),
        "priors": known,
    }
    page = None if report is None else os.fspath(as_file(report, "report", ".html"))
    other = None if validate is None else as_path(validate, "validate")
    with in_its_words(text, "columns: "), in_its_words(believed, "priors: "):
        native = _tdcr.calibrate_recording(robot._native, as_path(data, "data"), chosen, other, page, options, progress)
    for note in native.notes:
        warnings.warn(note, stacklevel=2)
    found = json.loads(native.found)
    return RecordingCalibration(
        robot=Robot._of(native.robot),
        columns=tomllib.loads(native.columns),
        train_rmse=found["train_rmse"],
        validation_rmse=found["validation_rmse"],
        parameters=tuple(found["parameters"]),
        found=found,
        train=_replayed(native.train),
        validation=None if native.validation is None else _replayed(native.validation),
        _columns_text=native.columns,
    )


def _replayed(native: _tdcr.ReplayedRecording) -> Replayed:
    return Replayed(
        native.times,
        tuple(native.patterns),
        tuple(native.lines),
        native.pulls,
        native.measured,
        native.predicted,
    )

"""Robots calibrated on recordings."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from by_command_line import command_line

import tdcr
from tdcr.errors import DataError, InputError

OPENCR = Path(__file__).parents[3] / "examples/opencr"
ROBOT, COLUMNS = OPENCR / "robot.toml", OPENCR / "columns.toml"
PULLS = OPENCR / "real_robot_v4_tendon_pull.csv"


def test_a_calibration_is_that_of_the_command_line(tmp_path: Path) -> None:
    groups = ["pretension", "lag", "base_pose"]
    steps: list[int] = []
    page = tmp_path / "page.html"
    fit = tdcr.calibrate_recording(str(ROBOT), PULLS, COLUMNS, fit=groups, report=page, progress=steps.append)
    out = tmp_path / "by_command_line.toml"
    files = ["--data", PULLS, "--columns", COLUMNS, "--out", out]
    said = command_line("calibrate", "--robot", ROBOT, *files, "--fit", ",".join(groups))
    assert fit.found == said and fit.train_rmse == said["train_rmse"] < said["uncalibrated_rmse"]
    assert sum(steps) > 0 and "<svg" in page.read_text()
    mine = tmp_path / "mine.toml"
    fit.save(mine)
    assert mine.read_text() == out.read_text()
    assert mine.with_suffix(".columns.toml").read_text() == out.with_suffix(".columns.toml").read_text()
    # The arrays have the figure in them.
    missed = fit.train.predicted - fit.train.measured
    missed -= np.nanmean(missed, axis=0)
    assert np.sqrt(np.nanmean((missed**2).sum(-1))) == pytest.approx(fit.train_rmse, rel=1e-9)
    assert fit.train.pulls.shape == (134, 9) and fit.train.times.shape == (134,) == (len(fit.train.patterns),)
    assert fit.validation is None and fit.train.lines[0] == 2


def test_columns_may_be_a_dictionary_and_servos_may_be_found() -> None:
    columns = tomllib.loads(COLUMNS.read_text())
    given = [servo["column"] for servo in columns["servos"]]
    columns["servos"].reverse()
    robot = tdcr.Robot(str(ROBOT))
    with pytest.warns(UserWarning, match="servo_map among what is fitted finds which"):
        tdcr.calibrate_recording(robot, PULLS, columns, fit=[])
    found = tdcr.calibrate_recording(robot, PULLS, columns, validate=PULLS, fit=["servo_map"])
    assert [servo["column"] for servo in found.columns["servos"]] == given
    assert found.validation_rmse == found.train_rmse and found.parameters == ()


def test_clouds_of_a_data_set_need_no_columns(tmp_path: Path) -> None:
    data = tmp_path / "data"
    tdcr.collect("2m", data, samples=10, points=100)
    fit = tdcr.calibrate_recording("2m", data, fit=[])
    assert fit.found == command_line("calibrate", "--robot", "2m", "--data", data, "--fit", "none")
    assert fit.found["measured"] == "clouds" and fit.train_rmse < 1e-3 and fit.validation_rmse is not None
    assert fit.train.measured.shape == (8, 0, 3) and fit.train.pulls.shape == (8, 6)
    assert set(fit.train.patterns) == {"train"} and fit.train.lines == tuple(range(8))


def test_what_cannot_be_used_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match='fit has "gravitation"; expected some of spool_radius'):
        tdcr.calibrate_recording("2m", PULLS, COLUMNS, fit=["gravitation"])
    with pytest.raises(InputError, match="9 servos; expected one"):
        tdcr.calibrate_recording("2m", PULLS, COLUMNS)
    with pytest.raises(InputError, match="it is a table, which needs a column map"):
        tdcr.calibrate_recording(str(ROBOT), PULLS)
    with pytest.raises(DataError, match=r"there is no data set in"):
        tdcr.calibrate_recording("2m", tmp_path)
    with pytest.raises(DataError, match=r"cannot read .*nowhere\.csv"):
        tdcr.calibrate_recording(str(ROBOT), tmp_path / "nowhere.csv", COLUMNS)
    with pytest.raises(InputError, match=r"expected a name that ends in \.html"):
        tdcr.calibrate_recording(str(ROBOT), PULLS, COLUMNS, report=tmp_path / "page.pdf")


def test_priors_are_a_dictionary_or_a_file(tmp_path: Path) -> None:
    file = tmp_path / "priors.toml"
    file.write_text('["lag"]\nvalue = 0.3\nspread = 0.001\nunit = "min"\n')
    columns = tomllib.loads(COLUMNS.read_text())
    unit = "s" if "time" in columns else "min"
    file.write_text(file.read_text().replace("min", unit))
    priors = {"lag": {"value": 0.3, "spread": np.float64(0.001), "unit": unit}}

    def lag(given: object) -> float:
        fit = tdcr.calibrate_recording(str(ROBOT), PULLS, columns, fit=["lag"], priors=given)  # type: ignore[arg-type]
        return float(fit.parameters[0]["value"])

    assert lag(priors) == lag(file) == pytest.approx(0.3, abs=0.01)
    assert lag({"lag": {"bounds": (0.0, 0.2), "value": 0.1}}) <= 0.2
    for wrong, says in (
        ({"mass": {"spread": 1.0}}, r"^priors: mass: nothing of this name is fitted; expected one of lag$"),
        ({"lag": {"bounds": [1.0, 0.0]}}, r"^priors: lag\.bounds: \[1, 0\] are no bounds"),
        ({"lag": {"spread": float("nan")}}, r"^priors: lag\.spread is nan; expected a finite number"),
        ({"lag": {"sigma": 1.0}}, "unknown field `sigma`"),
        ({"lag": 1.0}, r"lag.*expected a dictionary"),
    ):
        with pytest.raises(InputError, match=says):
            lag(wrong)
    file.write_text("[lag]\nspread = -1.0\n")
    with pytest.raises(InputError, match=r"priors\.toml: lag\.spread: -1 is no spread"):
        lag(file)

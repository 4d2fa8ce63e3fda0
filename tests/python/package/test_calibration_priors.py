"""Calibrations at rest beside what is known of the unknowns before, against SciPy."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

import tdcr
from tdcr.errors import DataError, InputError
from tdcr.inverse import Calibration

ROBOT = tdcr.Robot("2m")
GAINS = [f"gain[{t}]" for t in range(6)]
DENSITIES = ["density[0]", "density[1]"]
UNKNOWNS = {"gain": GAINS, "density": DENSITIES}
ERROR = 3e-4
COMMANDS = ROBOT.random_commands(12, seed=5)


def with_values(values: Any) -> tdcr.Robot:
    gain, density = map(float, values)
    return ROBOT.with_values(dict.fromkeys(GAINS, gain) | dict.fromkeys(DENSITIES, density))


def measured(payload: float = 0.0) -> NDArray[np.float64]:
    """Tips of a robot that is softer and heavier than the first, with errors."""
    tips = tdcr.settle_batch(with_values([440.0, 31.0]), COMMANDS, payload=payload).tips
    return tips + np.random.default_rng(2).normal(scale=ERROR, size=tips.shape)


def calibrate(priors: Any, error: float | None = ERROR, payload: float = 0.0) -> Calibration:
    tips = measured(payload)[:, np.newaxis]
    return tdcr.calibrate(ROBOT, UNKNOWNS, COMMANDS, tips, payload=payload, priors=priors, error=error)


def derivative(function: Callable[[NDArray[np.float64]], NDArray[np.float64]], x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Central differences of eighth order."""
    weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    columns = []
    for unit in np.eye(len(x)):
        step = 1e-2 * x @ unit
        differences = [w * (function(x + k * step * unit) - function(x - k * step * unit)) for k, w in weights.items()]
        columns.append(sum(differences) / step)
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("payload", [0.0, 0.02])
def test_values_and_errors_are_scipys_with_a_row_for_each_prior(payload: float) -> None:
    priors = {"density": {"value": 30.0, "spread": 4.0, "unit": "kg/m³"}, "gain": {"spread": np.float64(50.0)}}
    tips = measured(payload)

    def residuals(x: NDArray[np.float64]) -> NDArray[np.float64]:
        found = tdcr.settle_batch(with_values(x), COMMANDS, payload=payload).tips
        return np.append(((found - tips) / ERROR).ravel(), [(x[0] - 500.0) / 50.0, (x[1] - 30.0) / 4.0])

    def by_unknowns(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return derivative(residuals, x)

    ends = dict.fromkeys(("ftol", "xtol", "gtol"), 1e-15)
    best = least_squares(residuals, [450.0, 30.0], jac=by_unknowns, x_scale=[500.0, 30.0], **ends)
    jacobian = derivative(residuals, best.x)
    covariance = np.linalg.inv(jacobian.T @ jacobian)
    deviations = np.sqrt(np.diag(covariance))
    fit = calibrate(priors, payload=payload)
    assert fit.state == "converged" and [f.kind for f in fit.findings] == ["identified"] * 2
    np.testing.assert_allclose([f.value for f in fit.findings], best.x, rtol=1e-6)
    np.testing.assert_allclose([f.standard_error for f in fit.findings], deviations, rtol=1e-6)
    np.testing.assert_allclose(fit.correlations[0, 1], covariance[0, 1] / deviations.prod(), rtol=1e-6)
    for finding in fit.findings:
        width = 1.959963984540054 * finding.standard_error
        np.testing.assert_allclose(finding.interval, [finding.value - width, finding.value + width], rtol=1e-12)
    assert fit.degrees_of_freedom == 36 + 2 - 2
    np.testing.assert_allclose(fit.noise, ERROR * np.sqrt(2.0 * best.cost / 36), rtol=1e-6)
    np.testing.assert_allclose(fit.residual_rms, ERROR * np.sqrt(np.mean(residuals(best.x)[:36] ** 2)), rtol=1e-6)


def test_a_prior_makes_known_what_measurements_leave_open() -> None:
    # Without a known payload, they tell the ratio of gain and density.
    alone = calibrate(None, error=None)
    assert [(f.kind, f.confounded_with) for f in alone.findings] == [("confounded", ("density",)), ("confounded", ("gain",))]
    gain, density = calibrate({"gain": {"value": 440.0, "spread": 2.0}}).findings
    assert gain.kind == density.kind == "identified" and gain.prior_only and not density.prior_only
    assert gain.standard_error == pytest.approx(2.0, rel=1e-3) and gain.value == pytest.approx(440.0, rel=1e-4)
    assert density.value == pytest.approx(31.0, abs=4.0 * density.standard_error)
    # A sure prior holds its value, an unsure one changes nothing.
    assert calibrate({"gain": {"value": 470.0, "spread": 1e-9}}).findings[0].value == pytest.approx(470.0, rel=1e-7)
    free, unsure = (calibrate(priors, payload=0.02) for priors in (None, {"gain": {"value": 470.0, "spread": 1e9}}))
    for one, other in zip(free.findings, unsure.findings, strict=True):
        assert one.value == pytest.approx(other.value, rel=1e-8)
        assert one.standard_error == pytest.approx(other.standard_error, rel=1e-8) and not other.prior_only


def test_priors_are_a_dictionary_or_a_file(tmp_path: Path) -> None:
    file = tmp_path / "priors.toml"
    file.write_text('[gain]\nvalue = 440.0\nspread = 5.0\nunit = "N/m"\n[density]\nbounds = [20.0, 28.0]\n', encoding="utf-8")
    priors = {"gain": {"value": 440.0, "spread": 5.0, "unit": "N/m"}, "density": {"bounds": (20.0, np.float64(28.0))}}
    fit = calibrate(priors)
    gain, density = fit.findings
    for path in (file, str(file)):
        other = calibrate(path)
        assert other.robot == fit.robot and other.findings[0] == gain
    assert fit.state == "at bound" and (gain.kind, density.kind) == ("identified", "at bound")
    assert density.value == pytest.approx(28.0, rel=1e-12) and fit.robot.value("density[0]") == density.value
    with pytest.raises(DataError, match=r"cannot read .*nowhere\.toml"):
        calibrate(tmp_path / "nowhere.toml")
    file.write_text("[gain]\nspread = -1.0\n")
    with pytest.raises(InputError, match=r"priors\.toml: gain\.spread: -1 is no spread; expected a finite number above 0$"):
        calibrate(file)


@pytest.mark.parametrize(
    ("priors", "error", "says"),
    [
        ({"mass": {"spread": 1.0}}, ERROR, r"^priors: mass: nothing of this name is fitted; expected one of gain, density$"),
        ({"gain": {"spread": 0.0}}, ERROR, r"^priors: gain\.spread: 0 is no spread; expected a finite number above 0$"),
        ({"gain": {"spread": float("inf")}}, ERROR, r"^priors: gain\.spread is inf; expected a finite number$"),
        ({"density": {"value": -1.0}}, ERROR, r"^priors: density\.value: -1 cannot be its value; expected a finite number, 0 or"),
        ({"gain": {"unit": "N/mm"}}, ERROR, r'^priors: gain\.unit: "N/mm" is not its unit, which is "N/m"$'),
        ({"gain": {"bounds": [2.0, 1.0]}}, ERROR, r"^priors: gain\.bounds: \[2, 1\] are no bounds"),
        ({"gain": {"bounds": [1.0, 2.0]}}, ERROR, r"gain\.bounds: 500, where the fit of `gain` starts, is not within \[1, 2\]$"),
        ({"gain": {"sigma": 1.0}}, ERROR, r"unknown field `sigma`, expected one of `value`, `spread`, `bounds`, `unit`"),
        ({"gain": 1.0}, ERROR, r"^gain: priors: .*expected a dictionary$|gain.*expected a dictionary"),
        ({3: {"spread": 1.0}}, ERROR, r"^priors has the key 3; expected texts$"),
        (["gain"], ERROR, r"^priors is \['gain'\]; expected a path$"),
        (
            {"gain": {"spread": 5.0}},
            None,
            r"^priors: gain\.spread: it is weighed against .*; expected `error`, their standard dev",
        ),
        (None, 0.0, r"^error is 0; expected a finite number above 0, the standard deviation of a measured coordinate \(m\)$"),
        (None, float("nan"), r"^error is nan; expected finite numbers$"),
        (None, "small", r"^error has entries of type <U5; expected real numbers$"),
    ],
)
def test_what_cannot_be_known_is_refused(priors: Any, error: Any, says: str) -> None:
    with pytest.raises(InputError, match=says):
        calibrate(priors, error)

"""Stability under loads without a potential: what Python says, against a column's matrices by NumPy."""

from __future__ import annotations

import numpy as np
import pytest

import tdcr
from tdcr.errors import NotSettledError
from tdcr.statics import EXAMINED, STABILITY

LENGTH, DISCS, YOUNGS, RADIUS, DENSITY = 0.5, 25, 5e10, 1e-3, 7800.0
STIFFNESS = YOUNGS * np.pi * RADIUS**4 / 4


def column(relaxation: float) -> tdcr.Robot:
    """Beck's column, whose joints are damped by the rod's relaxation time (s)."""
    pitch = LENGTH / DISCS
    return tdcr.Robot(
        {
            "name": "column",
            "gravity": [0.0, 0.0, 0.0],
            "routing": "base",
            "base": {"position": [0.0, 0.0, 0.0], "holes": [], "hole_height": 0.0},
            "modules": [
                {
                    "discs": DISCS,
                    "length": LENGTH,
                    "joint_below": pitch / 2,
                    "radius": 0.004,
                    "half_height": 0.0025,
                    "mass": {"density": 0.0},
                    "holes": [],
                    "damping": 0.0,
                    "armature": 0.0,
                    "rod": {
                        "youngs": YOUNGS,
                        "poisson": 0.3,
                        "radius": RADIUS,
                        "density": DENSITY,
                        "damping": {"bending": relaxation, "torsion": relaxation},
                    },
                }
            ],
        }
    )


def follower(load: float) -> tdcr.Loads:
    """A push along the tip, which turns with it, in units of E I / L^2."""
    force = (0.0, 0.0, -load * STIFFNESS / LENGTH**2)
    return tdcr.Loads(wrenches=(tdcr.Wrench(disc=DISCS - 1, force=force, frame="disc"),))


def fastest(load: float, relaxation: float) -> complex:
    """The rate with the largest real part (1/s) of a plane chain of links in small motions."""
    pitch = LENGTH / DISCS
    mass = DENSITY * np.pi * RADIUS**2 * pitch
    force = load * STIFFNESS / LENGTH**2
    # The piece of rod that each disc carries: from its joint half a pitch below to the next, or to the tip.
    tops = pitch * np.arange(1, DISCS + 1)
    joints = tops - pitch / 2
    below, above = joints, np.append(joints[1:], LENGTH)
    masses, centres = mass * (above - below) / pitch, (above + below) / 2
    turned = np.tril(np.ones((DISCS, DISCS)))
    moved = np.tril(centres[:, None] - joints[None, :])
    about = masses * ((above - below) ** 2 / 12 + RADIUS**2 / 4)
    inertia = moved.T @ (masses[:, None] * moved) + turned.T @ (about[:, None] * turned)
    links = np.append(np.diff(joints), tops[-1] - joints[-1])
    stiffness = np.eye(DISCS) * STIFFNESS / pitch
    damping = relaxation * stiffness
    stiffness = stiffness - force * turned.T @ (links[:, None] * turned) + force * np.outer(tops[-1] - joints, np.ones(DISCS))
    zero, one = np.zeros((DISCS, DISCS)), np.eye(DISCS)
    below_ = np.linalg.solve(inertia, np.hstack([-stiffness, -damping]))
    rates = np.linalg.eigvals(np.vstack([np.hstack([zero, one]), below_]))
    return complex(rates[np.argmax(rates.real)])


@pytest.mark.parametrize(("load", "relaxation"), [(15.0, 1e-4), (21.0, 0.0), (21.0, 1e-4), (25.0, 1e-4), (40.0, 0.0)])
def test_a_column_flutters_as_numpy_says(load: float, relaxation: float) -> None:
    settled = tdcr.settle(column(relaxation), np.zeros(0), loads=follower(load))
    assert settled.stability == "flutter" and settled.examined == "motion"
    assert settled.converged == (relaxation == 0.0)
    if relaxation > 0.0:
        with pytest.raises(NotSettledError, match="flutter"):
            settled.check()
    expected = fastest(load, relaxation)
    assert settled.growth[0] == pytest.approx(expected.real, rel=1e-3)
    assert settled.growth[1] == pytest.approx(abs(expected.imag) / (2 * np.pi), rel=1e-4)


@pytest.mark.parametrize(("load", "relaxation"), [(9.0, 1e-4), (15.0, 0.0), (19.0, 0.0)])
def test_a_column_stands_below_its_load(load: float, relaxation: float) -> None:
    settled = tdcr.settle(column(relaxation), np.zeros(0), loads=follower(load))
    assert settled.converged and settled.stability == "stable" and settled.examined == "motion"
    assert not settled.growth.any()
    assert tdcr.settle(column(relaxation), np.zeros(0)).examined == "energy"


def test_rows_have_codes() -> None:
    robot = column(0.0)
    batch = tdcr.settle_batch([robot] * 2, np.zeros((2, 0)), loads=[follower(5.0), follower(30.0)])
    assert [STABILITY[code] for code in batch.stability] == ["stable", "flutter"]
    assert [EXAMINED[code] for code in batch.examined] == ["motion", "motion"]
    assert batch.growth.shape == (2, 2) and batch.growth[1, 0] > 1.0

"""The listed test cases of the statics: MuJoCo finds no force there, and tdcr settles there."""

import pathlib
import tomllib

import mujoco
import numpy as np
import pytest
from mujoco_statics import force, place
from paper_robots import ROBOTS, model

FILE = pathlib.Path(__file__).parents[2] / "sim/tests/data/cases.toml"
CASES = [case for case in tomllib.loads(FILE.read_text())["case"] if case["robot"] in ROBOTS]


def load(m, d, wrenches):
    """Applies a case's wrenches to MuJoCo's data, whose bodies 2, 3, ... are the discs."""
    for wrench in wrenches:
        body = wrench["disc"] + 2
        turn = d.xmat[body].reshape(3, 3) if wrench["frame"] == "disc" else np.eye(3)
        d.xfrc_applied[body, :3] += turn @ wrench["force"]
        d.xfrc_applied[body, 3:] += turn @ wrench["moment"]


def written(wrench):
    """A wrench as an option of the command line."""
    numbers = ",".join(str(number) for number in wrench["force"] + wrench["moment"])
    return f"--wrench={wrench['disc']}:{numbers}@{wrench['frame']}"


@pytest.fixture(params=CASES, ids=lambda case: case["name"])
def case(request):
    return request.param


@pytest.fixture
def listed(case):
    """MuJoCo's model and data in the case's listed pose, under its command and loads."""
    m = model(case["robot"])
    d = place(m, case["orientations"], case["command"], case.get("payload", 0.0))
    load(m, d, case.get("wrenches", []))
    mujoco.mj_forward(m, d)
    return m, d


def test_mujoco_finds_no_force_in_a_listed_pose(case, listed):
    m, d = listed
    assert np.abs(force(m, d)).max() <= 1e-9
    np.testing.assert_allclose(d.xpos[2:], case["positions"], atol=1e-11)


def test_tdcr_settles_in_a_listed_pose(case, listed, settle):
    if not case.get("from_straight", True):
        pytest.skip("the command line starts from the straight pose")
    _, d = listed
    wrenches = [written(wrench) for wrench in case.get("wrenches", [])]
    ours = settle(case["robot"], case["command"], case.get("payload", 0.0), wrenches)
    apart = np.linalg.norm(np.array(ours["positions"]) - case["positions"], axis=1)
    assert apart.max() <= case["tolerance"]
    np.testing.assert_allclose(ours["tendon_lengths"], d.ten_length, atol=case["tolerance"])
    np.testing.assert_allclose(ours["tendon_tensions"], -d.actuator_force, atol=1e-3)

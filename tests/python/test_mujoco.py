"""Settled poses against MuJoCo: its forces vanish there, and its own way leads there."""

import mujoco
import numpy as np
import pytest
from mujoco_statics import force, place, refine
from paper_robots import ROBOTS, model


def commands(robot, rng, count):
    return rng.uniform(0.0, 0.04, size=(count, 3 * ROBOTS[robot][0]))


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("payload", [0.0, 0.02])
def test_mujoco_finds_no_force_at_our_equilibria(robot, payload, settle, rng):
    m = model(robot)
    for command in commands(robot, rng, 20):
        ours = settle(robot, command, payload)
        assert ours["converged"] and ours["residual"] <= 1e-9 and ours["smallest_stiffness"] > 0
        d = place(m, ours["orientations"], command, payload)
        assert np.abs(force(m, d)).max() <= 1e-9
        np.testing.assert_allclose(d.xpos[2:], ours["positions"], atol=1e-12)
        np.testing.assert_allclose(d.ten_length, ours["tendon_lengths"], atol=1e-12)
        np.testing.assert_allclose(-d.actuator_force, ours["tendon_tensions"], atol=1e-9)


@pytest.mark.parametrize("robot", ROBOTS)
def test_mujoco_stepped_and_refined_comes_to_our_equilibria(robot, settle, rng):
    m = model(robot)
    for command in commands(robot, rng, 2):
        ours = np.array(settle(robot, command)["positions"])
        d = mujoco.MjData(m)
        d.ctrl[:] = command
        for _ in range(5_000):
            mujoco.mj_step(m, d)
        stepped = np.linalg.norm(d.xpos[-1] - ours[-1])
        refine(m, d)
        refined = np.abs(d.xpos[2:] - ours).max()
        assert refined <= 1e-7, f"{refined} m apart; after stepping, {stepped} m"


def test_the_payload_bends_as_in_mujoco(settle, rng):
    m = model("3m")
    command = commands("3m", rng, 1)[0]
    unloaded, loaded = settle("3m", command), settle("3m", command, 0.03)
    d = place(m, unloaded["orientations"], command, 0.0)
    for payload in np.linspace(0.003, 0.03, 10):  # soft modes: Newton's method goes there in steps
        d.xfrc_applied[-1, 2] = -9.81 * payload
        refine(m, d)
    np.testing.assert_allclose(d.xpos[2:], loaded["positions"], atol=1e-7)

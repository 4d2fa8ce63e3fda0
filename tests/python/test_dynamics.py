"""Motion against MuJoCo: the same commands lead the same way, and steps have the same derivatives."""

import json
import pathlib

import mujoco
import numpy as np
import pytest
from paper_robots import ROBOTS, mjcf, model


def moving_commands(robot, steps, rng):
    """Smooth commands that sweep each tendon's range, one per step (m)."""
    tendons = 3 * ROBOTS[robot][0]
    rate, phase = rng.uniform(1.0, 8.0, tendons), rng.uniform(0.0, 2 * np.pi, tendons)
    time = 0.002 * np.arange(steps)[:, None]
    return 0.02 + 0.018 * np.sin(rate * time + phase)


def with_payload(robot, mass):
    """The robot with a point mass on its distal disc."""
    disc = 5 * ROBOTS[robot][0] - 1
    ball = f'<body name="payload"><inertial pos="0 0 0" mass="{mass!r}" diaginertia="1e-14 1e-14 1e-14"/></body>'
    start = mjcf(robot).index(f'<site name="s{disc}_0"')
    return mujoco.MjModel.from_xml_string(mjcf(robot)[:start] + ball + mjcf(robot)[start:])


def roll(m, commands):
    d = mujoco.MjData(m)
    path = []
    for command in commands:
        d.ctrl[:] = command
        mujoco.mj_step(m, d)
        mujoco.mj_kinematics(m, d)
        path.append(d.xpos.copy())
    return d, np.array(path)


@pytest.fixture
def simulate(tdcr, tmp_path):
    """Simulates a sequence of commands; returns the final state and the path of the discs (m)."""

    def run(robot, commands, *options):
        file, out = tmp_path / "commands.csv", tmp_path / "path.csv"
        file.write_text("\n".join(",".join(repr(float(x)) for x in row) for row in commands))
        final = tdcr("simulate", "--robot", robot, "--commands", file, "--out", out, *options)
        rows = np.loadtxt(out, delimiter=",", skiprows=1)
        return final, rows[:, 1:].reshape(len(rows), -1, 3)

    return run


@pytest.mark.parametrize("robot", ROBOTS)
def test_semi_implicit_steps_are_mujocos(robot, simulate, rng):
    commands = moving_commands(robot, 1_000, rng)
    final, ours = simulate(robot, commands)
    d, path = roll(model(robot), commands)
    travelled = np.abs(np.diff(path[:, -1], axis=0)).sum()
    assert travelled > 0.1
    np.testing.assert_allclose(ours, path[:, 2:], rtol=0, atol=1e-10)
    np.testing.assert_allclose(np.ravel(final["rotations"]), d.qpos, rtol=0, atol=1e-9)
    np.testing.assert_allclose(final["velocity"], d.qvel, rtol=0, atol=1e-8)


@pytest.mark.parametrize("robot", ["2m", "5m"])
def test_a_payload_has_inertia_as_in_mujoco(robot, simulate, rng):
    commands = moving_commands(robot, 1_000, rng)
    _, ours = simulate(robot, commands, "--payload", 0.03)
    _, path = roll(with_payload(robot, 0.03), commands)
    np.testing.assert_allclose(ours, path[:, 2:-1], rtol=0, atol=1e-10)


def test_runge_kutta_is_as_mujocos(simulate, rng):
    """Both are fourth-order methods on the rotation group, equal but for terms of higher order."""
    commands = moving_commands("3m", 1_000, rng)
    _, ours = simulate("3m", commands, "--integrator", "runge-kutta4")
    m = model("3m")
    m.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    _, path = roll(m, commands)
    np.testing.assert_allclose(ours, path[:, 2:], rtol=0, atol=1e-10)


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_linearisation_is_mujocos_finite_difference(robot, simulate, rng, tmp_path):
    commands = moving_commands(robot, 300, rng)
    final, _ = simulate(robot, commands, "--linearise", tmp_path / "step.json")
    ours = json.loads((tmp_path / "step.json").read_text())
    m = model(robot)
    d = mujoco.MjData(m)
    d.qpos[:], d.qvel[:], d.ctrl[:] = np.ravel(final["rotations"]), final["velocity"], commands[-1]
    a, b = np.zeros((2 * m.nv, 2 * m.nv)), np.zeros((2 * m.nv, m.nu))
    # Central differences of 1e-6: rounding of 1e-16 in the state leaves 1e-10, amplified by the gains in B.
    mujoco.mjd_transitionFD(m, d, 1e-6, True, a, b, None, None)
    assert np.abs(a - np.eye(2 * m.nv)).max() > 0.01 and np.abs(b).max() > 0.1
    np.testing.assert_allclose(ours["a"], a, rtol=0, atol=1e-8)
    np.testing.assert_allclose(ours["b"], b, rtol=0, atol=1e-8)


def rubbing_by_mujoco(m, commands, coefficient, stiffness):
    """The motion with MuJoCo's inertias and the capstan law at each hole, written here anew, explicit; and the heat (J)."""
    d = mujoco.MjData(m)
    wraps = [m.wrap_objid[a : a + n] for a, n in zip(m.tendon_adr, m.tendon_num, strict=True)]
    gain = m.actuator_gainprm[:, 0].copy()
    m.actuator_gainprm[:], m.actuator_biasprm[:] = 0.0, 0.0
    deflections, before = [np.zeros(len(sites) - 2) for sites in wraps], [None] * len(wraps)
    heat, path = 0.0, []
    jacobians = np.zeros((m.nsite, 3, m.nv))
    for command in commands:
        mujoco.mj_forward(m, d)
        for site in {site for sites in wraps for site in sites}:
            mujoco.mj_jacSite(m, d, jacobians[site], None, site)
        d.qfrc_applied[:] = 0.0
        for t, sites in enumerate(wraps):
            spans = np.diff(d.site_xpos[sites], axis=0)
            lengths = np.linalg.norm(spans, axis=1)
            ways = spans / lengths[:, None]
            slopes = np.einsum("ki,kij->kj", ways, np.diff(jacobians[sites], axis=0))
            tensions = [gain[t] * (lengths.sum() - command[t])]
            shortened = np.zeros(len(lengths)) if before[t] is None else before[t] - lengths
            before[t] = lengths
            for hole in range(len(sites) - 2):
                moved = shortened[hole + 1 :].sum()
                angle = np.arccos(np.clip(ways[hole] @ ways[hole + 1], -1.0, 1.0))
                pull = max(tensions[-1], 0.0)
                trial = stiffness * (deflections[t][hole] + moved)
                force = np.clip(trial, pull * (1.0 - np.exp(coefficient * angle)), pull * (1.0 - np.exp(-coefficient * angle)))
                heat += force * (trial - force) / stiffness
                deflections[t][hole] = force / stiffness
                tensions.append(tensions[-1] - force)
            d.qfrc_applied -= np.array(tensions) @ slopes
        mujoco.mj_step(m, d)
        mujoco.mj_kinematics(m, d)
        path.append(d.xpos.copy())
    return np.array(path), heat


def test_friction_of_tendons_is_the_law_in_mujocos_motion(simulate, tmp_path):
    """MuJoCo has no such friction: forces of the law lead its motion, explicit there and implicit here, both of first order."""
    coefficient, stiffness = 0.25, 1e4
    standard = (pathlib.Path(__file__).parents[2] / "sim/robots/2m.toml").read_text()
    friction = f"friction = {{ coefficient = {coefficient}, contact_stiffness = {stiffness} }}"
    rough = tmp_path / "rough.toml"
    rough.write_text(standard.replace("range = [0.0, 0.04]", f"range = [0.0, 0.04], {friction}"))
    off = []
    for dt in (2e-4, 1e-4):
        commands = np.full((round(0.5 / dt), 6), 0.02)
        commands[:, 0], commands[:, 4] = 0.001, 0.01
        m = model("2m")
        m.opt.timestep = dt
        _, smooth = roll(m, commands)
        path, heat = rubbing_by_mujoco(m, commands, coefficient, stiffness)
        _, ours = simulate(rough, commands, "--dt", dt)
        # The friction matters.
        assert np.abs(path - smooth).max() > 3e-3
        assert heat > 1e-3
        off.append(np.abs(ours - path[:, 2:]).max())
    assert off[1] < 2e-5, off
    assert 1.7 < off[0] / off[1] < 2.3, off

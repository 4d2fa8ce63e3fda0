"""Models that tdcr writes, in MuJoCo: they load, and MuJoCo computes in them what it computes in ours of independent make."""

import json
import pathlib

import mujoco
import numpy as np
import pytest
from mujoco_statics import force
from paper_robots import ROBOTS, model

ROOT = pathlib.Path(__file__).parents[2]
BY_HAND = ROOT / "sim/tests/data/by_hand/robot.xml"

# One of each: a tilted base, joints below the discs, masses of both kinds, a bent backbone, drives of all kinds.
EVERYTHING = """
name = "everything"
gravity = [1.0, -2.0, -9.0]
routing = "base"
[base]
position = [0.1, 0.2, 0.3]
orientation = [0.9, 0.3, -0.1, 0.2]
holes = [[0.01, 0.0], [-0.005, 0.008]]
hole_height = -0.01
[[modules]]
discs = 2
first_offset = 0.02
pitch = 0.03
joint_below = 0.012
radius = 0.015
half_height = 0.004
mass = { density = [800.0, 700.0] }
holes = [[0.01, 0.0], [-0.005, 0.008]]
damping = 0.1
armature = 0.01
backbone = { bending = [0.3, 0.3], torsion = 0.3, rest = [0.2, -0.1, 0.3] }
tendons = { drive = { gain = 400.0 }, axial_stiffness = 1200.0, range = [0.0, 0.05], pull = "tension_only" }
[[modules]]
discs = 2
first_offset = 0.025
pitch = 0.02
radius = 0.012
half_height = 0.003
mass = { rigid = { mass = 0.002, inertia = [1e-7, 2e-7, 2.5e-7] } }
holes = [[0.01, 0.0], [-0.005, 0.008]]
damping = [0.05, 0.06]
armature = [0.001, 0.002]
tendons = { drive = "tension", range = [0.0, 8.0] }
[[routes]]
through = [["base", 0], [1, 1], [3, 0]]
tendon = { drive = "length", axial_stiffness = 900.0, range = [0.0, 0.2] }
[cameras]
count = 3
radius = 0.5
height = 0.4
pitch = 0.3
fovy = 40.0
resolution = [320, 240]
"""


# The paper's two modules on a rod of spring steel, 1.3 mm across, in pieces of 17 mm: joints of 2 to 11 degrees.
ROD = "armature = {armature}\nbackbone = {{ bending = [1.6, 1.6], torsion = {torsion} }}"
BENT = [0.005, 0.03, 0.02, 0.0, 0.04, 0.02]


@pytest.fixture
def on_a_rod(tdcr, tmp_path):
    """Writes the file of the 2m robot on a rod."""

    def write(torsion, armature, damping):
        text = tdcr("export", "--format", "toml")["text"]
        assert text.count("armature = 0.01") == text.count("damping = 0.1") == 2
        text = text.replace("armature = 0.01", ROD.format(armature=armature, torsion=torsion))
        file = tmp_path / "rod.toml"
        file.write_text(text.replace("damping = 0.1", f"damping = {damping}"))
        return file

    return write


@pytest.fixture
def exported(tdcr):
    def run(robot, *options):
        return mujoco.MjModel.from_xml_string(tdcr("export", "--robot", robot, *options)["text"])

    return run


@pytest.fixture
def everything(tmp_path, exported):
    file = tmp_path / "robot.toml"
    file.write_text(EVERYTHING)
    return exported(file)


def poses(m, rng, count=5):
    """MuJoCo data of a model in random states."""
    d = mujoco.MjData(m)
    for _ in range(count):
        mujoco.mj_resetData(m, d)
        mujoco.mj_integratePos(m, d.qpos, rng.normal(0, 0.3, m.nv), 1.0)
        d.qvel[:] = rng.normal(0, 1, m.nv)
        low, high = m.actuator_ctrlrange.T
        d.ctrl[:] = rng.uniform(low, high)
        mujoco.mj_forward(m, d)
        yield d


def assert_same_model(a, b, rng):
    """Fails unless two models of the same bodies have the same masses, and move alike from random states."""
    assert (a.nbody, a.nu, a.nv) == (b.nbody, b.nu, b.nv)
    for name in ["body_mass", "body_inertia", "dof_damping", "dof_armature", "jnt_stiffness", "actuator_ctrlrange"]:
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=1e-12, err_msg=name)
    db = mujoco.MjData(b)
    for da in poses(a, rng):
        db.qpos[:], db.qvel[:], db.ctrl[:] = da.qpos, da.qvel, da.ctrl
        mujoco.mj_forward(b, db)
        for name in ["xipos", "ten_length", "actuator_force", "qfrc_actuator", "qfrc_passive", "qfrc_bias", "qacc"]:
            ours, theirs = getattr(da, name), getattr(db, name)
            np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("base", [[], ["--base"]])
def test_exported_robots_move_as_those_written_from_the_papers_numbers(robot, base, exported, rng):
    assert_same_model(exported(robot, *base), model(robot), rng)


@pytest.mark.parametrize("robot", ROBOTS)
def test_stored_models_are_loaded(robot, rng):
    for file in [f"{robot}.xml", f"{robot}_base.xml"]:
        assert_same_model(mujoco.MjModel.from_xml_path(str(ROOT / "models_xml" / file)), model(robot), rng)
    urdf, ours = mujoco.MjModel.from_xml_path(str(ROOT / "models_xml" / f"{robot}.urdf")), model(robot)
    discs = [urdf.body(f"disc{i}").id for i in range(ours.njnt)]
    np.testing.assert_allclose(urdf.body_mass[discs], ours.body_mass[2:], rtol=1e-12)
    # MuJoCo sorts the moments of inertia that it reads from URDF.
    moments = [np.sort(inertia, axis=1) for inertia in (urdf.body_inertia[discs], ours.body_inertia[2:])]
    np.testing.assert_allclose(*moments, rtol=1e-9)
    # Turned alike, three revolute joints x, y, z are one ball joint: R = Rx Ry Rz.
    a, b = mujoco.MjData(urdf), mujoco.MjData(ours)
    a.qpos[:] = rng.uniform(-1, 1, urdf.nq)
    for disc, angles in enumerate(a.qpos.reshape(-1, 3)):
        mujoco.mju_euler2Quat(b.qpos[4 * disc : 4 * disc + 4], angles, "xyz")
    mujoco.mj_kinematics(urdf, a)
    mujoco.mj_kinematics(ours, b)
    np.testing.assert_allclose(a.xpos[discs], b.xpos[2:], atol=1e-12)


def test_a_payload_weighs_on_the_tip(exported, rng):
    mass = 0.02
    loaded, bare = exported("2m", "--payload", mass), exported("2m")
    tip = bare.body("disc9").id
    b = mujoco.MjData(bare)
    for a in poses(loaded, rng):
        b.qpos[:] = a.qpos
        b.qvel[:] = a.qvel[:] = 0
        mujoco.mj_forward(loaded, a)
        mujoco.mj_forward(bare, b)
        weight = np.zeros(bare.nv)
        mujoco.mj_applyFT(bare, b, np.array([0, 0, -9.81 * mass]), np.zeros(3), b.xpos[tip], tip, weight)
        np.testing.assert_allclose(-a.qfrc_bias, -b.qfrc_bias + weight, atol=1e-12)


def test_joints_and_springs_are_where_the_specification_has_them(everything):
    m, d = everything, mujoco.MjData(everything)
    rest = np.zeros(4)
    mujoco.mju_axisAngle2Quat(rest, np.array([0.2, -0.1, 0.3]) / np.sqrt(0.14), np.sqrt(0.14))
    straight = np.zeros(4)
    mujoco.mju_negQuat(straight, rest)
    np.testing.assert_allclose(m.jnt_stiffness, [0.3, 0.3, 0, 0])
    # MuJoCo counts a stiff joint's turn from its rest.
    d.qpos[:] = np.concatenate([straight, straight, [1, 0, 0, 0], [1, 0, 0, 0]])
    mujoco.mj_forward(m, d)
    base, up = np.array([0.1, 0.2, 0.3]), d.xmat[1].reshape(3, 3)[:, 2]
    heights = np.cumsum([0.02, 0.03, 0.025, 0.02])
    np.testing.assert_allclose(d.xpos[2:], base + np.outer(heights, up), atol=1e-12)
    joints = heights - [0.012, 0.012, 0, 0]
    np.testing.assert_allclose(d.xanchor, base + np.outer(joints, up), atol=1e-12)
    # The spring turns the straight joint to its rest: 0.3 times the rest's rotation vector.
    np.testing.assert_allclose(d.qfrc_spring[:6], 0.3 * np.tile([0.2, -0.1, 0.3], 2), atol=1e-12)


def test_drives_pull_as_the_specification_has_them(everything, rng):
    m = everything
    gain = 400.0 * 1200.0 / 1600.0
    for d in poses(m, rng):
        elastic = np.maximum(gain * (d.ten_length[:2] - d.ctrl[:2]), 0)
        by_length = 900.0 * (d.ten_length[4:] - d.ctrl[4:])
        tensions = np.concatenate([elastic, d.ctrl[2:4], by_length])
        moment = np.zeros((m.nu, m.nv))
        mujoco.mju_sparse2dense(moment, d.actuator_moment, d.moment_rownnz, d.moment_rowadr, d.moment_colind)
        # A tension is minus the force on the tendon's length; motors have their gear of -1 in their moment.
        gear = m.actuator_gear[:, 0]
        np.testing.assert_allclose(-gear * d.actuator_force, tensions, atol=1e-9)
        np.testing.assert_allclose(d.qfrc_actuator, moment.T @ (-tensions / gear), atol=1e-9)


def test_cameras_look_as_ours_do(everything):
    d = mujoco.MjData(everything)
    mujoco.mj_forward(everything, d)
    np.testing.assert_allclose(everything.cam_fovy, 40.0)
    for k in range(3):
        turn = 2 * np.pi * k / 3
        out = np.array([np.sin(turn), -np.cos(turn), 0])
        np.testing.assert_allclose(d.cam_xpos[k], 0.5 * out + [0, 0, 0.4], atol=1e-12)
        x, y, z = d.cam_xmat[k].reshape(3, 3).T
        np.testing.assert_allclose(-z, [*(-np.cos(0.3) * out[:2]), -np.sin(0.3)], atol=1e-12)
        np.testing.assert_allclose(x, [np.cos(turn), np.sin(turn), 0], atol=1e-12)
        assert y[2] > 0


def test_a_model_written_by_hand_is_read_as_mujoco_reads_it(exported, rng):
    theirs, ours = mujoco.MjModel.from_xml_path(str(BY_HAND)), exported(BY_HAND)
    assert ours.nv == theirs.nv
    theirs_d, bodies = mujoco.MjData(theirs), [theirs.body("lower").id, theirs.body("upper").id]
    np.testing.assert_allclose(ours.body_mass[2:], theirs.body_subtreemass[bodies] - [theirs.body_subtreemass[bodies[1]], 0])
    for d in poses(ours, rng):
        theirs_d.qpos[:], theirs_d.qvel[:], theirs_d.ctrl[:] = d.qpos, d.qvel, -d.ctrl
        mujoco.mj_forward(theirs, theirs_d)
        for name in ["ten_length", "qfrc_actuator", "qfrc_passive", "qfrc_bias", "qacc"]:
            np.testing.assert_allclose(getattr(d, name), getattr(theirs_d, name), rtol=1e-9, atol=1e-12, err_msg=name)


def at_the_keyframe(m):
    d = mujoco.MjData(m)
    mujoco.mj_resetDataKeyframe(m, d, m.key("settled").id)
    mujoco.mj_forward(m, d)
    return d


@pytest.mark.parametrize("robot", [*ROBOTS, "rod"])
@pytest.mark.parametrize("integrator", ["euler", "implicitfast", "implicit", "rk4"])
def test_a_model_reset_to_its_keyframe_stays_there(robot, integrator, exported, on_a_rod):
    options = []
    if robot == "rod":
        robot, options = on_a_rod(1.23, 1e-7, 1e-4), ["--command", ",".join(map(str, BENT))]
    m = exported(robot, "--integrator", integrator, *options)
    d = at_the_keyframe(m)
    before = d.xpos.copy()
    d.qvel[:] = 1e-9
    for _ in range(2000):
        mujoco.mj_step(m, d)
    assert np.abs(d.qvel).max() < 1e-3
    np.testing.assert_allclose(d.xpos, before, atol=1e-7)


@pytest.mark.parametrize("integrator", ["euler", "implicitfast", "implicit"])
def test_mujoco_leaves_the_pose_at_steps_beyond_the_limit_alone(integrator, exported, on_a_rod, tdcr):
    """The limit that the refusal names is MuJoCo's own, to a hundredth."""
    robot = on_a_rod(1.23, 1e-7, 1e-4)
    m = exported(robot, "--integrator", integrator)
    assert m.opt.timestep < 0.002

    def is_accepted(dt):
        try:
            exported(robot, "--integrator", integrator, "--dt", dt)
            return True
        except AssertionError:
            return False

    low, high = m.opt.timestep, 0.002
    assert is_accepted(low) and not is_accepted(high)
    while high > 1.003 * low:
        dt = (low * high) ** 0.5
        low, high = (dt, high) if is_accepted(dt) else (low, dt)

    def fastest(dt):
        d = at_the_keyframe(m)
        m.opt.timestep = dt
        d.qvel[:] = np.random.default_rng(0).normal(0, 1e-7, m.nv)
        for _ in range(4000):
            mujoco.mj_step(m, d)
            if not np.abs(d.qvel).max() < 1e-2:
                return np.inf
        return np.abs(d.qvel).max()

    assert fastest(0.99 * low) < 1e-4
    assert fastest(1.01 * high) == np.inf


# Softer in torsion, as a round rod is, stiffer, as a helical spring is, and much stiffer.
@pytest.mark.parametrize("torsion, tolerance", [(1.23, 1e-8), (1.84, 1e-5), (4.8, 2e-4)])
def test_a_rod_that_bends_unlike_it_twists_settles_where_ours_does(torsion, tolerance, exported, on_a_rod, tdcr):
    command = ",".join(map(str, BENT))
    robot = on_a_rod(torsion, 0.01, 0.1)
    m, settled = exported(robot), tdcr("settle", "--robot", robot, "--command", command)
    d = mujoco.MjData(m)
    d.ctrl[:] = BENT
    for _ in range(30000):
        mujoco.mj_step(m, d)
    assert np.abs(d.qvel).max() < 1e-9
    np.testing.assert_allclose(d.xpos[2:], settled["positions"], atol=tolerance)
    # Not for want of bending: the tip is well aside.
    assert np.hypot(*d.xpos[-1][:2]) > 0.01


CAMERAS = """<mujoco><worldbody>
<camera pos="0.4 0 0.1" mode="targetbody" target="d1"/>
<camera pos="0.4 0.1 0.1" mode="targetbodycom" target="d0"/>
<camera pos="0.4 0.1 0.1" mode="trackcom" euler="90 0 0"/>
<camera pos="0.4 0.1 0.1" mode="track" zaxis="1 -0.3 0.2"/>
<camera pos="0.4 0.1 0.1" mode="trackcom" euler="90 10 0" target="d1"/>
<camera pos="0 0 0.5" mode="targetbody" target="base"/>
<camera pos="0.2 -0.3 0.1" axisangle="1 0 0 80"/>
<body name="base" pos="0.1 0 0" euler="0 0 30"><geom type="box" size=".02 .02 .02" contype="0" conaffinity="0"/>
<camera pos="0.4 0 0.1" mode="targetbodycom" target="base"/>
<camera pos="0.4 0 0.1" mode="trackcom" xyaxes="0 1 0 0 0 1"/>
<body name="d0" pos="0 0 0.05" euler="10 0 0"><joint type="ball" stiffness="0.1"/>
<geom type="cylinder" size=".015 .002" contype="0" conaffinity="0"/>
<body name="d1" pos="0 0 0.05"><joint type="ball" stiffness="0.1"/>
<geom type="cylinder" size=".015 .002" density="3000" contype="0" conaffinity="0"/>
</body></body></body></worldbody></mujoco>"""


def test_cameras_of_a_model_are_where_mujoco_has_them_at_the_start(tdcr, tmp_path):
    file = tmp_path / "cameras.xml"
    file.write_text(CAMERAS)
    model = mujoco.MjModel.from_xml_string(CAMERAS)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    cameras = json.loads(tdcr("export", "--robot", file, "--format", "json")["text"])["cameras"]
    assert len(cameras) == model.ncam == 9
    for index, camera in enumerate(cameras):
        np.testing.assert_allclose(camera["position"], data.cam_xpos[index], atol=1e-12)
        matrix = np.zeros(9)
        mujoco.mju_quat2Mat(matrix, np.array(camera["aim"]["orientation"]))
        # MuJoCo's cameras look along -z with y up, ours along z with y down.
        expected = data.cam_xmat[index].reshape(3, 3) @ np.diag([1.0, -1.0, -1.0])
        np.testing.assert_allclose(matrix.reshape(3, 3), expected, atol=1e-12)


def test_three_hinges_rest_where_ball_joints_do(exported, on_a_rod):
    at = {}
    for robot, command in (("2m", "0.034,0.007,0.001,0.026,0.015,0.019"), (on_a_rod(1.2, 1e-3, 1e-3), ",".join(map(str, BENT)))):
        for joints in ("ball", "hinges"):
            m = exported(robot, "--joints", joints, "--command", command)
            assert m.njnt == m.nv if joints == "hinges" else m.njnt < m.nv
            d = mujoco.MjData(m)
            mujoco.mj_resetDataKeyframe(m, d, 0)
            assert np.abs(force(m, d)).max() < 1e-7
            at[joints] = d.xpos[2:].copy()
        apart = np.linalg.norm(at["ball"] - at["hinges"], axis=1).max()
        # Without springs the same poses; on the rod 0.14 mm, as energies differ by the fourth power of the angles.
        assert apart < 1e-8 if robot == "2m" else 1e-5 < apart < 3e-4, apart

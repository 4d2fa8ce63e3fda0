"""Robots mounted on an arm in MuJoCo: the part that `tdcr export --attach` writes, by `MjSpec.attach`."""

import mujoco
import numpy as np
import pytest

ARM = """
<mujoco model="arm">
  <compiler angle="degree"/>
  <option timestep="0.0005" gravity="0 0 -9.81"/>
  <default><geom contype="1" conaffinity="1" density="500" rgba="0.5 0.5 0.5 1"/><site size="0.05"/></default>
  <worldbody>
    <body name="upper" pos="0 0 0.5">
      <joint name="shoulder" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03"/>
      <body name="fore" pos="0.3 0 0">
        <joint name="elbow" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0.25 0 0" size="0.025"/>
        <site name="flange" pos="0.28 0 0" euler="0 90 0"/>
      </body>
    </body>
  </worldbody>
  <actuator><position name="shoulder" joint="shoulder" kp="10"/><position name="elbow" joint="elbow" kp="10"/></actuator>
</mujoco>
"""
ANGLES = [0.4, -0.7]


@pytest.fixture
def mounted(tdcr):
    """An arm with a robot on its flange."""

    def mount(robot, *options):
        part = mujoco.MjSpec.from_string(tdcr("export", "--robot", robot, "--attach", "", *options)["text"])
        arm = mujoco.MjSpec.from_string(ARM)
        arm.attach(part, site=arm.site("flange"), prefix="tdcr/")
        return arm.compile()

    return mount


def test_a_mounted_robot_keeps_its_names_and_the_arm_its_own(mounted):
    model = mounted("2m")
    assert model.nu == 2 + 6 and model.ntendon == 6 and model.ncam == 0
    assert [model.actuator(k).name for k in (0, 1, 2, 7)] == ["shoulder", "elbow", "tdcr/tendon0", "tdcr/tendon5"]
    base = model.body("tdcr/base")
    assert model.body(base.parentid[0]).name == "fore"
    assert model.opt.timestep == 0.0005
    # Defaults of the one do not act on the other.
    assert model.geom(0).contype[0] == 1 and model.site("flange").size[0] == 0.05
    disc = model.body("tdcr/disc0").geomadr[0]
    assert model.geom(disc).contype[0] == 0 and model.site("tdcr/disc0_0").size[0] == 0.001
    assert model.tendon_width[0] == 0.0005


def test_names_may_have_a_prefix_in_the_file_too(tdcr):
    part = mujoco.MjModel.from_xml_string(tdcr("export", "--robot", "3m", "--attach", "left/")["text"])
    bodies = [part.body(k).name for k in range(1, part.nbody)]
    assert bodies == ["left/base", *(f"left/disc{k}" for k in range(15))]
    assert part.actuator(8).name == part.tendon(8).name == "left/tendon8"
    np.testing.assert_array_equal(part.body("left/base").pos, 0.0)


def test_forces_in_a_mounted_robot_are_those_of_one_whose_base_is_so_posed(tdcr, mounted, tmp_path):
    """Bias forces (gravity, velocities), masses and tendons, in random states of the robot, the arm at rest."""
    model = mounted("2m", "--payload", "0.02")
    data = mujoco.MjData(model)
    data.qpos[:2] = ANGLES
    mujoco.mj_kinematics(model, data)
    base = data.body("tdcr/base")
    alone = tdcr("export", "--robot", "2m", "--format", "toml")["text"]
    posed = f"position = {base.xpos.tolist()}\norientation = {base.xquat.tolist()}"
    assert alone.count("position = [0.0, 0.0, 0.174]") == 1
    file = tmp_path / "posed.toml"
    file.write_text(alone.replace("position = [0.0, 0.0, 0.174]", posed))
    own = mujoco.MjModel.from_xml_string(tdcr("export", "--robot", file, "--payload", "0.02")["text"])
    other = mujoco.MjData(own)

    rng = np.random.default_rng(3)
    robot = model.nv - own.nv
    assert robot == 2
    for _ in range(5):
        mujoco.mj_resetData(own, other)
        mujoco.mj_integratePos(own, other.qpos, rng.normal(0, 0.3, own.nv), 1.0)
        other.qvel[:] = rng.normal(0, 1, own.nv)
        other.ctrl[:] = rng.uniform(*own.actuator_ctrlrange.T)
        mujoco.mj_forward(own, other)
        data.qpos[2:], data.qvel[2:], data.ctrl[2:] = other.qpos, other.qvel, other.ctrl
        mujoco.mj_forward(model, data)
        discs = [f"disc{k}" for k in range(10)]
        for disc in discs:
            np.testing.assert_allclose(data.body(f"tdcr/{disc}").xpos, other.body(disc).xpos, atol=1e-12)
        np.testing.assert_allclose(data.ten_length, other.ten_length, atol=1e-12)
        for name in ("qfrc_bias", "qfrc_actuator", "qfrc_passive"):
            ours, theirs = getattr(data, name)[robot:], getattr(other, name)
            np.testing.assert_allclose(ours, theirs, atol=1e-10 * max(1.0, np.abs(theirs).max()), err_msg=name)


def test_a_mounted_robot_bends_its_arm_by_its_weight(mounted):
    model = mounted("2m")
    data = mujoco.MjData(model)
    data.ctrl[2:] = 0.02
    mujoco.mj_forward(model, data)
    bare = mujoco.MjModel.from_xml_string(ARM)
    without = mujoco.MjData(bare)
    mujoco.mj_forward(bare, without)
    discs = [model.body(f"tdcr/disc{k}").id for k in range(10)]
    weights = 9.81 * model.body_mass[discs]
    # About the shoulder, whose axis is y: a weight at x turns by its lever.
    moment = (weights * data.xipos[discs, 0]).sum()
    assert moment > 0
    np.testing.assert_allclose(abs(data.qfrc_bias[0] - without.qfrc_bias[0]), moment, rtol=1e-9)

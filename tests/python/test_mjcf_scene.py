"""Scenes in MuJoCo models: MuJoCo finds our contacts in what we write, and we read what it lets touch."""

import pathlib
import re
import warnings

import mujoco
import numpy as np
import pytest

import tdcr

POST = tdcr.Obstacle.cylinder("post", 0.01, 0.4, position=(-0.06, 0.0, 0.25), friction=0.4)
SHAPES = [
    POST,
    tdcr.Obstacle.half_space("floor", position=(0.0, 0.0, -0.02), orientation=(0.99, 0.05, -0.02, 0.0)),
    tdcr.Obstacle.box("wall", (0.02, 0.3, 0.4), position=(0.075, 0.0, 0.2), orientation=(0.99, 0.0, 0.05, 0.1)),
    tdcr.Obstacle.sphere("ball", 0.04, position=(0.03, -0.09, 0.24)),
    tdcr.Obstacle.capsule("rail", 0.006, 0.2, position=(0.0, 0.062, 0.26), orientation=(0.7071, 0.0, 0.7071, 0.0)),
]
COMMANDS = [
    [0.034, 0.007, 0.001, 0.026, 0.015, 0.019],
    [0.004, 0.03, 0.022, 0.02, 0.01, 0.03],
    [0.02, 0.005, 0.035, 0.03, 0.02, 0.01],
    [0.03, 0.012, 0.014, 0.005, 0.03, 0.02],
]


def model_of(text: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return model, data


def written(robot: str, scene: tdcr.Scene, command: list[float]) -> str:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return tdcr.Robot(robot).to_mjcf(scene=scene, command=command)


def name_of(model: mujoco.MjModel, geom: int) -> str:
    return mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, geom) or f"disc{model.geom_bodyid[geom] - 2}"


@pytest.mark.parametrize("command", COMMANDS)
def test_mujoco_finds_the_contacts_of_our_equilibria(command: list[float]) -> None:
    scene = tdcr.Scene(SHAPES)
    settled = tdcr.settle("2m", command, scene=scene)
    assert settled.converged and len(settled.contacts) > 0
    model, data = model_of(written("2m", scene, command))
    first = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "disc0")
    # Pressed in by the compliance (1e-6 m/N), by less than what is only near.
    found = {}
    for contact in data.contact[: data.ncon]:
        bodies = model.geom_bodyid[contact.geom]
        obstacle = name_of(model, contact.geom[0 if bodies[0] == 0 else 1])
        found.setdefault((int(bodies.max()) - first, obstacle), []).append(float(contact.dist))
    ours = {}
    for contact, obstacle in enumerate(settled.contacts.obstacle_names):
        ours.setdefault((int(settled.contacts.disc[contact]), obstacle), []).append(float(settled.contacts.gap[contact]))
    assert found.keys() == ours.keys()
    for pair, gaps in ours.items():
        np.testing.assert_allclose(min(found[pair]), min(gaps), rtol=0, atol=2e-9)


def test_mujoco_comes_to_rest_where_we_do() -> None:
    scene = tdcr.Scene(SHAPES)
    for command in COMMANDS[:2]:
        settled = tdcr.settle("2m", command, scene=scene)
        model, data = model_of(written("2m", scene, command))
        start = data.body("disc9").xpos.copy()
        np.testing.assert_allclose(start, settled.positions[-1], rtol=0, atol=1e-9)
        for _ in range(int(3.0 / model.opt.timestep)):
            mujoco.mj_step(model, data)
        assert np.abs(data.qvel).max() < 1e-3
        assert np.linalg.norm(data.body("disc9").xpos - start) < 1e-3


def test_a_robot_written_among_obstacles_reads_back_as_itself_and_they_as_theirs(tmp_path: pathlib.Path) -> None:
    corners = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]
    mesh = {"vertices": corners, "triangles": [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]}
    part = tdcr.Obstacle._of({"name": "part", "mesh": mesh, "position": (0.2, 0.1, 0.0)})
    scene = tdcr.Scene([*SHAPES, part])
    file = tmp_path / "robot.xml"
    file.write_text(written("2m", scene, COMMANDS[0]))
    plain = tmp_path / "plain.xml"
    plain.write_text(tdcr.Robot("2m").to_mjcf(command=COMMANDS[0]))
    robot = tdcr.Robot(file)
    assert any("beads of their own" in note for note in robot.notes)
    assert robot.to_dict() == tdcr.Robot(plain).to_dict()
    with pytest.warns(UserWarning, match="compliance of 1e-6"):
        read = tdcr.Scene.load(file)
    assert read.names == scene.names
    for one, other in zip(read, scene, strict=True):
        assert one.kind == other.kind and one.friction == other.friction
        np.testing.assert_allclose(one.position, other.position, atol=1e-15)
        turn = np.asarray(other.orientation) / np.linalg.norm(other.orientation)
        np.testing.assert_allclose(one.orientation, turn, atol=1e-12)
        if one.kind != "mesh":
            for name, value in other.size.items():
                np.testing.assert_allclose(one.size[name], value, rtol=1e-15)
    again, ours = (tdcr.settle("2m", COMMANDS[0], scene=one) for one in (read, scene))
    np.testing.assert_allclose(again.positions, ours.positions, atol=1e-9)


def test_discs_that_touch_in_mujoco_are_those_that_touch_here() -> None:
    """Curled up, the tip of 5m presses discs below; neighbours overlap, and touch in neither."""
    robot = tdcr.Robot("5m")
    low, high = robot.command_ranges.T
    scene = tdcr.Scene([])
    for pull, tendon in [(0.9, 0), (1.0, 1)]:
        command = high.copy()
        command[tendon::3] += pull * (low - high)[tendon::3]
        settled = tdcr.settle(robot, command, scene=scene)
        assert settled.converged and len(settled.contacts) > 0
        model, data = model_of(written("5m", scene, command.tolist()))
        first = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "disc0")
        bodies = model.geom_bodyid[data.contact.geom[: data.ncon]] - first
        found = {tuple(sorted(pair)) for pair in bodies.tolist()}
        assert found == set(zip(settled.contacts.disc.tolist(), settled.contacts.other_disc.tolist(), strict=True))


def test_what_has_no_counterpart_in_mujoco_is_warned_of() -> None:
    pipe = tdcr.Obstacle.pipe("tube", 0.05, 0.2, position=(0.0, 0.0, 0.3))
    heavy = tdcr.Obstacle.sphere("brick", 0.01, position=(0.3, 0.0, 0.0), mass=0.2)
    with pytest.warns(UserWarning) as said:
        text = tdcr.Robot("2m").to_mjcf(scene=tdcr.Scene([pipe, heavy]))
    texts = [str(one.message) for one in said]
    assert any("`tube`: left out: MuJoCo has no pipes" in one for one in texts)
    # What has a mass moves there, too.
    assert not any("`brick`" in one for one in texts)
    assert re.search(r'<body name="brick"[^>]*>\s*<freejoint', text)
    assert any("solref" in one for one in texts)
    model, _ = model_of(text)
    assert mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, "brick") >= 0
    assert mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, "tube") == -1


BY_HAND = """
<mujoco>
  <asset>
    <mesh name="wedge" vertex="0 0 0  1 0 0  0 1 0  0 0 1" scale="0.1 0.1 0.1"/>
  </asset>
  <default>
    <geom contype="0" conaffinity="0"/>
    <default class="thing"><geom contype="4" conaffinity="4" friction="0.3 0 0"/></default>
  </default>
  <worldbody>
    <geom name="floor" class="thing" type="plane" size="1 1 0.1" margin="0.001"/>
    <geom name="seen" type="box" size="0.1 0.1 0.1"/>
    <geom name="other" type="sphere" size="0.1" contype="8" conaffinity="8"/>
    <geom name="egg" class="thing" type="ellipsoid" size="0.1 0.1 0.2" pos="0.5 0 0"/>
    <geom name="wedge" class="thing" type="mesh" mesh="wedge" pos="0.3 0 0"/>
    <geom name="paired" type="sphere" size="0.02" pos="0.2 0 0.1"/>
    <body name="shelf" pos="0 0.2 0.1" euler="0 0 90">
      <geom name="board" class="thing" type="box" size="0.1 0.05 0.005"/>
      <body name="away"><geom name="excluded" class="thing" type="capsule" fromto="0 0 0 0 0 0.1" size="0.01"/></body>
    </body>
    <body name="disc0" pos="0 0 0.05">
      <joint type="ball" stiffness="0.1" pos="0 0 -0.02"/>
      <geom name="one" type="cylinder" size="0.02 0.005" density="500" contype="4" conaffinity="4" friction="0.7 0 0"/>
      <site name="a" pos="0.01 0 0"/>
      <body name="disc1" pos="0 0 0.03">
        <joint type="ball" stiffness="0.1" pos="0 0 -0.01"/>
        <geom name="two" type="cylinder" size="0.02 0.005" density="500"/>
        <site name="b" pos="0.01 0 0"/>
      </body>
    </body>
  </worldbody>
  <contact>
    <pair geom1="two" geom2="paired" friction="0.2 0.2 0 0 0"/>
    <exclude body1="away" body2="disc0"/>
  </contact>
</mujoco>
"""


def test_what_mujoco_lets_touch_is_the_scene_and_the_rest_is_warned_of(tmp_path: pathlib.Path) -> None:
    file = tmp_path / "model.xml"
    file.write_text(BY_HAND)
    mujoco.MjModel.from_xml_string(BY_HAND)
    with pytest.warns(UserWarning) as said:
        scene = tdcr.Scene.load(file)
    texts = "\n".join(str(one.message) for one in said)
    assert scene.names == ("floor", "wedge", "paired", "board")
    assert [one.kind for one in scene] == ["half_space", "mesh", "sphere", "box"]
    # MuJoCo takes the larger friction of the two, but for a pair's own.
    assert [one.friction for one in scene] == [0.7, 0.7, 0.2, 0.7]
    np.testing.assert_allclose(scene["board"].position, [0.0, 0.2, 0.1], atol=1e-15)
    np.testing.assert_allclose(scene["board"].orientation, [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)], atol=1e-12)
    np.testing.assert_allclose(scene["board"].size["size"], [0.2, 0.1, 0.01])
    np.testing.assert_allclose(np.max(scene["wedge"].size["vertices"], axis=0), 0.1)
    for name, words in [
        ("floor", "margin of 0.001 m is left out"),
        ("floor", "touches 1 of 2 bodies in MuJoCo"),
        ("other", "nothing that moves touches it"),
        ("excluded", "nothing that moves touches it"),
        ("egg", "no obstacles of type ellipsoid"),
    ]:
        assert any(name in line and words in line for line in texts.splitlines()), (name, words, texts)
    assert "seen" not in texts


def test_a_model_whose_contacts_are_off_has_no_obstacles(tmp_path: pathlib.Path) -> None:
    file = tmp_path / "model.xml"
    file.write_text(BY_HAND.replace("<asset>", '<option><flag contact="disable"/></option><asset>'))
    with pytest.warns(UserWarning, match="switches contacts off"):
        assert len(tdcr.Scene.load(file)) == 0

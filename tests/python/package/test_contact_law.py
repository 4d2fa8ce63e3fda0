"""Laws of contact in motion: MuJoCo's beside MuJoCo, the spring and damper beside its formula, in files."""

from __future__ import annotations

import pickle
import re
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from ball_chain import BALLS, RADIUS
from by_command_line import command_line

import tdcr
from tdcr import Compliant, Impedance, Obstacle, Scene
from tdcr.errors import DynamicsError, InputError, SceneError

COMMAND = np.array([0.034, 0.007, 0.001, 0.026, 0.015, 0.019])
POST = Obstacle.cylinder("post", 0.01, 0.4, position=(-0.06, 0.0, 0.25), friction=0.4)
AROUND = Scene(
    [
        Obstacle.half_space("wall", position=(0.05, 0.0, 0.0), orientation=(0.5**0.5, 0.0, -(0.5**0.5), 0.0), friction=0.2),
        Obstacle.sphere("ball", 0.03, position=(-0.02, 0.07, 0.26)),
        Obstacle.capsule("rod", 0.01, 0.2, position=(-0.05, -0.03, 0.25)),
        Obstacle.box("block", (0.04, 0.05, 0.06), position=(0.0, -0.07, 0.28), orientation=(0.9, 0.1, 0.3, 0.2)),
    ]
)
"""An obstacle of each shape that both have, each at a side of the robot."""


def by_mujoco(robot: str, scene: Scene, commands: Any) -> tuple[Any, int]:
    """Positions of the discs after each command, from the straight pose, and in how many steps there were contacts."""
    text = tdcr.Robot(robot).to_mjcf(scene=scene, dt=0.002, command=commands[0])
    text, count = re.subn("<option ", "<option solver='Newton' iterations='200' tolerance='0' ", text)
    assert count == 1
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    discs = [data.body(f"disc{disc}") for disc in range(tdcr.Robot(robot).discs)]
    positions, touching = [], 0
    for command in commands:
        data.ctrl[:] = command
        mujoco.mj_step(model, data)
        touching += data.ncon > 0
        mujoco.mj_kinematics(model, data)
        positions.append([disc.xpos.copy() for disc in discs])
    return np.array(positions), touching


@pytest.mark.parametrize("law", [Impedance(), Impedance(solref=(0.01, 0.8), solimp=(0.8, 0.97, 0.002, 0.4, 3.0))])
@pytest.mark.parametrize("robot", ["2m", "3m"])
def test_a_motion_under_mujocos_law_is_mujocos(robot: str, law: Impedance) -> None:
    times, tendons = 0.002 * np.arange(600)[:, np.newaxis], np.arange(tdcr.Robot(robot).tendons) % 3
    commands = 0.02 + 0.018 * np.sin(3.0 * times + 2.1 * tendons) * np.minimum(2.0 * times, 1.0)
    scene = AROUND.with_contact_law(law)
    theirs, touching = by_mujoco(robot, scene, commands)
    ours = tdcr.simulate(robot, commands, scene=scene, start="straight", dt=0.002)
    assert touching > 60
    # Of the test in Rust, `trajectories_with_contacts_are_mujocos_step_by_step`.
    assert np.linalg.norm(ours.positions - theirs, axis=-1).max() <= 1e-8
    assert ours.contacts is not None and set(ours.contacts.sliding) == {"free"}
    # Another law is another motion; rows and single steps are under the scene's.
    usual = tdcr.simulate(robot, commands, scene=AROUND, start="straight", dt=0.002)
    assert np.abs(usual.positions - ours.positions).max() > 1e-6
    rows = tdcr.rollout(robot, commands[np.newaxis].repeat(2, axis=0), scene=[AROUND, scene], start="straight", dt=0.002)
    np.testing.assert_array_equal(rows.positions[0], usual.positions)
    np.testing.assert_array_equal(rows.positions[1], ours.positions)
    moving = tdcr.MovingRobot(robot, dt=0.002, scene=scene)
    moving.start_at(tdcr.State.straight(tdcr.Robot(robot)), commands[0])
    for command in commands[:100]:
        moving.step(command)
    np.testing.assert_array_equal(moving.positions, ours.positions[99])


@pytest.mark.parametrize("relaxation", [0.0, 1e-3, 5e-3])
def test_a_pressed_surface_comes_back_in_its_relaxation_time(relaxation: float) -> None:
    compliance, dt = 1e-4, 1e-3
    floor = Obstacle.half_space("wall", position=(0.01, 0.0, 0.0), orientation=(0.5**0.5, 0.0, -(0.5**0.5), 0.0))
    scene = Scene([tdcr.Obstacle._of(floor._fields() | {"compliance": compliance})])
    if relaxation != 1e-3:
        scene = scene.with_contact_law(Compliant(relaxation))
    moving = tdcr.MovingRobot(BALLS, dt=dt, scene=scene)
    moving.reset([0.13, 0.13, 0.13])
    compared = 0
    for _ in range(300):
        before = moving.positions.copy()
        moving.step([0.112, 0.13, 0.13])
        assert moving.contacts is not None
        for disc, force, gap in zip(moving.contacts.disc, moving.contacts.force, moving.contacts.gap, strict=True):
            # The wall's surface is at x = 0.01 m, each disc one ball.
            start = 0.01 - before[disc, 0] - RADIUS
            expected = -(gap + relaxation * (gap - start) / dt) / compliance
            assert force[0] == pytest.approx(-expected, rel=1e-6, abs=1e-9) and not force[1:].any()
            compared += 1
    assert compared > 50


def test_laws_are_part_of_scenes_and_their_files(tmp_path: Path) -> None:
    scene = Scene([POST])
    assert scene.contact_law == Compliant() == Compliant(1e-3)
    for law in (Compliant(0.0), Impedance(), Impedance(solref=[0.01, 2])):
        other = scene.with_contact_law(law)
        assert other.contact_law == law and other != scene and other.with_contact_law(Compliant()) == scene
        other.save(tmp_path / "scene.toml")
        again = [Scene.load(tmp_path / "scene.toml"), Scene.from_json(other.to_json()), pickle.loads(pickle.dumps(other))]
        assert all(one == other and one.contact_law == law for one in again)
        assert other.moved("post", (0, 0, 1)).contact_law == other.with_self_contact(None).contact_law == law
    (tmp_path / "scene.toml").write_text("contact_law = { impedance = {} }\n[[obstacle]]\nsphere = { radius = 0.1 }\n")
    assert Scene.load(tmp_path / "scene.toml").contact_law == Impedance()
    # At rest it changes nothing.
    rest = tdcr.settle("2m", COMMAND, scene=scene)
    assert tdcr.settle("2m", COMMAND, scene=scene.with_contact_law(Impedance())) == rest


def test_the_command_line_takes_the_law_of_the_scene(tmp_path: Path) -> None:
    scene = Scene([POST]).with_contact_law(Impedance())
    scene.save(tmp_path / "scene.toml")
    commands = np.tile(COMMAND, (150, 1))
    np.savetxt(tmp_path / "commands.csv", commands, delimiter=",")
    options = ["--commands", tmp_path / "commands.csv", "--scene", tmp_path / "scene.toml"]
    found = command_line("simulate", "--robot", "2m", *options)
    ours = tdcr.simulate("2m", commands, scene=scene, start="straight", dt=0.002)
    assert ours.contacts is not None and len(ours.contacts) > 0 and len(found["contacts"]) > 0
    np.testing.assert_allclose(found["positions"], ours.positions[-1], atol=1e-9)


def test_what_no_law_has_is_refused_and_derivatives_by_name(tmp_path: Path) -> None:
    scene = Scene([POST])
    for wrong, says in [
        (Compliant(-1.0), r"contact_law.compliant.relaxation` is -1; expected a time from 0 to 1 s"),
        (Impedance(solref=(0.0, 1.0)), r"contact_law.impedance.solref` is \[0.0, 1.0\]; expected a time constant"),
        (Impedance(solimp=(0.9, 0.95, -1.0, 0.5, 2.0)), r"solimp` is .*; expected five finite numbers, none below 0"),
    ]:
        with pytest.raises(SceneError, match=says):
            scene.with_contact_law(wrong)
    with pytest.raises(InputError, match=r"solref has shape \(3,\); expected \(2,\)"):
        Impedance(solref=(1, 2, 3))
    with pytest.raises(InputError, match="contact_law is 'mujoco'; expected a tdcr.Compliant or a tdcr.Impedance"):
        scene.with_contact_law("mujoco")  # type: ignore[arg-type]
    (tmp_path / "scene.toml").write_text("contact_law = { mujoco = {} }\n")
    with pytest.raises(SceneError, match="compliant"):
        Scene.load(tmp_path / "scene.toml")
    mujocos = scene.with_contact_law(Impedance())
    commands, robot = COMMAND[np.newaxis, np.newaxis], tdcr.Robot("2m")
    says = "under MuJoCo's law.*expected a scene whose contact law is compliant"
    with pytest.raises(DynamicsError, match=says):
        tdcr.rollout_vjp(robot, commands, np.zeros((1, 1, 10, 3)), scene=mujocos)
    with pytest.raises(DynamicsError, match=says):
        tdcr.rollout_jvp(robot, commands, tdcr.RolloutRates(payload=np.ones(1)), scene=mujocos)
    with pytest.raises(DynamicsError, match=says):
        tdcr.linearise(robot, tdcr.State.straight(robot), COMMAND, scene=mujocos)
    torch = pytest.importorskip("torch")
    from tdcr.torch import rollout

    ramp = torch.tensor(np.tile(COMMAND, (100, 1)), requires_grad=True)
    start = torch.tensor(tdcr.State.straight(robot).configuration)
    positions, *_ = rollout(robot, ramp, start, scene=mujocos)
    with pytest.raises(DynamicsError, match=says):
        positions[-1].sum().backward()

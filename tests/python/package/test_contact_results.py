"""What results say of contacts: sliding beside Coulomb's law, stiffness beside the energy's Hessian, the shape of beads."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from ball_chain import BALLS, COMMAND, COMPLIANCE, PAYLOAD, RADIUS, SCENE, derivative, energy, gaps

import tdcr
from tdcr.errors import ContactError

FRICTION = 0.3
WALL = tdcr.Obstacle.half_space(
    "wall", position=(0.04, 0.0, 0.0), orientation=(0.5**0.5, 0.0, -(0.5**0.5), 0.0), friction=FRICTION, compliance=1e-5
)
AMONG = tdcr.Scene([WALL])


def in_share(contacts: tdcr.Contacts) -> Any:
    """Of each contact with the wall its force along it, as a share of what friction bears."""
    along = np.linalg.norm(contacts.force[:, 1:], axis=1)
    return along / (FRICTION * -contacts.force[:, 0])


def test_contacts_slip_where_coulomb_says_and_stick_elsewhere() -> None:
    settler = tdcr.Settler("2m", AMONG)
    command = np.full(6, 0.03)
    seen = set()
    for pulled in np.concatenate([np.linspace(0.03, 0.012, 37), np.linspace(0.012, 0.02, 17)]):
        command[0] = pulled
        contacts = settler.follow(command).check().contacts
        assert contacts is not None
        share = in_share(contacts)
        slips = contacts.sliding == "slips"
        assert set(contacts.sliding) <= {"sticks", "slips", "free"}
        np.testing.assert_allclose(share[slips], 1.0, atol=1e-6)
        assert (share[contacts.sliding == "sticks"] <= 1.0 + 1e-9).all()
        assert (share[contacts.sliding == "free"] < 1e-9).all()
        seen |= set(contacts.sliding.tolist())
    assert {"sticks", "slips"} <= seen
    # Without a path there is no friction; in motion there is.
    alone = tdcr.settle("2m", command, scene=AMONG).check().contacts
    assert alone is not None and set(alone.sliding) == {"free"}
    motion = tdcr.simulate("2m", np.tile(command, (40, 1)), scene=AMONG, start="settled", frame_skip=5)
    assert motion.contacts is not None and len(motion.contacts) and set(motion.contacts.sliding) <= {"sticks", "slips"}


def test_the_smallest_stiffness_is_that_of_the_hessian_with_contacts() -> None:
    settled = tdcr.settle(BALLS, COMMAND, PAYLOAD, scene=SCENE).check()
    assert settled.contacts is not None and len(settled.contacts) > 0
    vectors = np.array([rotation_vector(q) for q in settled.configuration])
    found = tdcr.smallest_stiffness(BALLS, COMMAND, PAYLOAD, scene=SCENE)
    assert found.shape == (1,)
    np.testing.assert_allclose(found[0], softest(vectors, pressed=True), rtol=1e-5)
    free = tdcr.settle(BALLS, COMMAND, PAYLOAD).check()
    expected = softest(np.array([rotation_vector(q) for q in free.configuration]), pressed=False)
    np.testing.assert_allclose(tdcr.smallest_stiffness(BALLS, COMMAND, PAYLOAD), [expected], rtol=1e-5)
    assert found[0] != pytest.approx(expected, rel=1e-3) and expected > 0.0
    # Rows are those of single calls, and what does not settle has none.
    rows = np.stack([COMMAND, COMMAND + np.array([0.002, 0.0, 0.0])])
    several = tdcr.smallest_stiffness(BALLS, rows, PAYLOAD, scene=[SCENE, SCENE])
    assert several[0] == found[0] and several[1] != found[0]
    wrench = np.zeros((2, 10, 6))
    wrench[1, 9, 3] = 10.0
    commands = np.tile([0.034, 0.007, 0.001, 0.026, 0.015, 0.019], (2, 1))
    stiffness = tdcr.smallest_stiffness("2m", commands, wrench=wrench)
    assert stiffness[0] > 0.0 and np.isnan(stiffness[1])
    with pytest.raises(ContactError, match="row 1: .*moment"):
        tdcr.smallest_stiffness("2m", commands, wrench=wrench, scene=AMONG)


def rotation_vector(quaternion: Any) -> Any:
    """Of a quaternion (w, x, y, z) of a turn that is not 0."""
    w, *v = quaternion
    size = np.linalg.norm(v)
    return 2.0 * np.arctan2(size, w) / size * np.array(v)


def softest(vectors: Any, pressed: bool) -> float:
    """Smallest eigenvalue of the energy's Hessian by turns of the joints, at an equilibrium."""

    def gradient(turns: Any) -> Any:
        slope = derivative(energy, turns)
        if pressed:
            depths = np.minimum(gaps(turns), 0.0)
            slope = slope + depths / COMPLIANCE @ derivative(gaps, turns)
        return slope

    at = vectors.ravel()
    hessian = np.array([(gradient(at + step) - gradient(at - step)) / 2e-6 for step in 1e-6 * np.eye(12)])
    # From changes of rotation vectors to turns: the inverse of the right Jacobian of SO(3), which vanishing gradients allow.
    by_turns = np.zeros((12, 12))
    for joint, vector in enumerate(vectors):
        x, y, z = vector
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        angle = np.linalg.norm(vector)
        curve = 1 / angle**2 - (1 + np.cos(angle)) / (2 * angle * np.sin(angle))
        part = slice(3 * joint, 3 * joint + 3)
        by_turns[part, part] = np.eye(3) + cross / 2 + curve * cross @ cross
    turned = by_turns.T @ hessian @ by_turns
    return float(np.linalg.eigvalsh((turned + turned.T) / 2).min())


def test_the_shape_error_is_that_of_beads_about_discs() -> None:
    # A cylinder as tall as wide reaches farthest beyond its one ball at its rim.
    settled = tdcr.settle(BALLS, COMMAND, PAYLOAD, scene=SCENE).contacts
    assert settled is not None
    assert settled.shape_error == pytest.approx((2**0.5 - 1) * RADIUS, rel=1e-12)
    robot = tdcr.Robot("2m")
    commands = np.full((2, 6), 0.03)
    commands[1, 0] = 0.015
    batch = tdcr.settle_batch(robot, commands, scene=AMONG)
    assert batch.contacts is not None and batch.contacts.shape_error.shape == (2,)
    assert batch[1].contacts == tdcr.settle(robot, commands[1], scene=AMONG).contacts
    assert batch[[1]].contacts.shape_error.tolist() == [batch.contacts.shape_error[1]]
    moving = tdcr.MovingRobot(robot, scene=AMONG)
    path = tdcr.FrictionPath(robot, scene=AMONG).start(commands[0]).equilibrium
    among = tdcr.inverse.ShapeController(robot, scene=AMONG, samples=3, starts=1)
    reached = among.reach(tdcr.inverse.Target(position=batch[1].tip))
    for contacts in (moving.contacts, path.contacts, reached.equilibrium.contacts):
        assert contacts is not None
        # 3.8 mm, as the guide has it.
        assert contacts.shape_error == batch.contacts.shape_error[0] == pytest.approx(3.8e-3, abs=5e-5)
    assert pickle.loads(pickle.dumps(batch[1])) == batch[1]

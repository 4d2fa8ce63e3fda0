"""Paths with friction of tendons and of obstacles together."""

from __future__ import annotations

import numpy as np
import pytest

import tdcr
from tdcr.errors import ContactError

ROUGH = {"coefficient": 0.1, "contact_stiffness": 1e5}
WALL = tdcr.Obstacle.half_space("wall", position=(0.04, 0.0, 0.0), orientation=(0.5**0.5, 0.0, -(0.5**0.5), 0.0), friction=0.3)
SCENE = tdcr.Scene([WALL])


def rough() -> tdcr.Robot:
    spec = tdcr.Robot("2m").to_dict()
    for module in spec["modules"]:
        module["backbone"] = {"bending": [0.2, 0.2], "torsion": 0.2}
        module["tendons"]["friction"] = ROUGH
    return tdcr.Robot(spec)


def test_a_path_among_obstacles_has_contacts_and_both_frictions() -> None:
    robot = rough()
    commands = np.full((4, 6), 0.03)
    commands[:, 0] = [0.03, 0.02, 0.01, 0.02]
    free = tdcr.FrictionPath(robot).follow(commands)
    states = tdcr.FrictionPath(robot, scene=SCENE).follow(commands)
    assert states[0].equilibrium.tip == pytest.approx(free[0].equilibrium.tip, abs=1e-9)
    assert free[2].equilibrium.contacts is None
    pressed = states[2].equilibrium.contacts
    assert pressed is not None and len(pressed.disc) > 0
    assert all(state.equilibrium.converged for state in states)
    across = np.linalg.norm(pressed.force[:, 1:], axis=1)
    assert np.all(across <= 0.3 * -pressed.force[:, 0] + 1e-6) and np.any(across > 0.01)
    assert states[2].equilibrium.tip[0] < free[2].equilibrium.tip[0] - 0.005
    assert states[3].dissipated > states[2].dissipated > 0.0


def test_loads_without_a_potential_are_refused_by_name() -> None:
    robot = rough()
    loads = tdcr.Loads(wrenches=(tdcr.Wrench(4, moment=(0.0, 0.01, 0.0)),))
    with pytest.raises(ContactError, match="wrench on disc 4"):
        tdcr.FrictionPath(robot, scene=SCENE).start(np.full(6, 0.03), loads)

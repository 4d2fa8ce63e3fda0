"""Equilibria in scenes: against SciPy's constrained minimum of the energy, and themselves."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ball_chain import (
    BALL,
    BALLS,
    COMMAND,
    COMPLIANCE,
    PAYLOAD,
    RADIUS,
    SCENE,
    derivative,
    energy,
    gaps,
    place,
)
from scipy.optimize import minimize

import tdcr
from tdcr import Obstacle, Scene
from tdcr.errors import CommandError, ContactError, InputError, SceneError, SensitivityError

ROBOT = tdcr.Robot("2m")
POSTS = Scene(
    [
        Obstacle.sphere("left", 0.02, position=(-0.06, 0.02, 0.28)),
        Obstacle.sphere("right", 0.03, position=(0.07, -0.01, 0.26)),
        Obstacle.half_space("ceiling", position=(0.0, 0.0, 0.37), orientation=(0.0, 1.0, 0.0, 0.0)),
    ]
)
COMMANDS = ROBOT.random_commands(40, seed=2)


def test_an_equilibrium_is_the_constrained_minimum_of_the_energy_that_scipy_finds() -> None:
    found = tdcr.settle(BALLS, COMMAND, PAYLOAD, scene=SCENE).check()
    contacts = found.contacts
    assert contacts is not None and set(contacts.obstacle_names) == {"ball", "wall"} and not contacts.weak.any()
    # Minimise over turns and forces f = s / sqrt(C): surfaces give way by C f, which stores C f^2 / 2.
    root = np.sqrt(COMPLIANCE)
    solved = minimize(
        lambda x: energy(x[:12]) + x[12:] @ x[12:] / 2,
        np.zeros(20),
        jac=lambda x: np.concatenate([derivative(energy, x[:12]), x[12:]]),
        constraints={
            "type": "ineq",
            "fun": lambda x: gaps(x[:12]) + root * x[12:],
            "jac": lambda x: np.hstack([derivative(gaps, x[:12]), root * np.eye(8)]),
        },
        method="SLSQP",
        options={"ftol": 1e-16, "maxiter": 1000},
    )
    positions = np.array(place(solved.x[:12])[0][1:])
    assert np.abs(found.positions - positions).max() < 1e-7
    forces = np.zeros((4, 2))
    forces[contacts.disc, contacts.obstacle] = np.linalg.norm(contacts.force, axis=1)
    np.testing.assert_allclose(forces.ravel(), solved.x[12:] / root, atol=1e-3)
    # What is said of contacts is so: the gap of each, its point on the surface, its force along the normal.
    own = gaps(turns_of(found)).reshape(4, 2)[contacts.disc, contacts.obstacle]
    np.testing.assert_allclose(contacts.gap, own, atol=1e-12)
    below = found.positions[contacts.disc] - contacts.normal * (RADIUS + contacts.gap)[:, None]
    np.testing.assert_allclose(contacts.point, below, atol=1e-12)
    strength = (contacts.force * contacts.normal).sum(axis=1)
    np.testing.assert_allclose(contacts.force, contacts.normal * strength[:, None], atol=1e-12)
    np.testing.assert_allclose(-contacts.gap, COMPLIANCE * strength, rtol=1e-3)
    assert contacts.penetration == pytest.approx(-contacts.gap.min(), abs=1e-12) and contacts.complementarity < 1e-8
    assert len(contacts) == len(contacts.disc) and contacts.row is None


def turns_of(found: tdcr.Equilibrium) -> Any:
    """Rotation vectors of a configuration."""
    w, v = found.configuration[:, :1], found.configuration[:, 1:]
    size = np.linalg.norm(v, axis=1, keepdims=True)
    return (2 * np.arctan2(size, w) * v / np.where(size == 0, 1, size)).ravel()


def test_without_obstacles_nothing_is_different() -> None:
    plain, empty = tdcr.settle_batch(ROBOT, COMMANDS), tdcr.settle_batch(ROBOT, COMMANDS, scene=Scene())
    assert plain.contacts is None and empty.contacts is not None and len(empty.contacts) == 0
    for name in plain._by_rows:
        assert np.array_equal(getattr(plain, name), getattr(empty, name)), name
    one, same = tdcr.settle(ROBOT, COMMANDS[0]), tdcr.settle(ROBOT, COMMANDS[0], scene=Scene([]))
    assert one.contacts is None and same.contacts is not None
    assert np.array_equal(one.positions, same.positions)
    jacobian = tdcr.jacobian(ROBOT, COMMANDS[:3])
    np.testing.assert_allclose(tdcr.jacobian(ROBOT, COMMANDS[:3], scene=Scene()), jacobian, rtol=1e-12, atol=1e-12)


def test_rows_are_those_of_single_solves_for_any_number_of_threads() -> None:
    threads = tdcr.threads()
    told: list[int] = []
    try:
        tdcr.set_threads(1)
        rows = tdcr.settle_batch(ROBOT, COMMANDS, scene=POSTS, progress=told.append)
        tdcr.set_threads(3)
        assert tdcr.settle_batch(ROBOT, COMMANDS, scene=POSTS) == rows
    finally:
        tdcr.set_threads(threads)
    assert sum(told) == len(COMMANDS)
    contacts = rows.contacts
    assert contacts is not None and contacts.row is not None and len(contacts) > 10
    assert (np.diff(contacts.row) >= 0).all() and contacts.penetration.shape == (len(COMMANDS),)
    for row, command in enumerate(COMMANDS):
        assert tdcr.settle(ROBOT, command, scene=POSTS) == rows[row]
    some = [7, 3, 3, 0]
    taken = rows[some].contacts
    assert taken is not None
    for place_, row in enumerate(some):
        assert rows[some][place_] == rows[row]
    assert rows[2:2].contacts is not None and len(rows[2:2]) == 0
    assert pickle.loads(pickle.dumps(rows)) == rows


def test_rows_may_have_scenes_of_their_own() -> None:
    scenes = [POSTS.moved("right", (x, -0.01, 0.26)) for x in (0.065, 0.07, 0.08)]
    rows = tdcr.settle_batch(ROBOT, COMMANDS[:3], scene=scenes)
    for row, scene in enumerate(scenes):
        assert rows[row] == tdcr.settle(ROBOT, COMMANDS[row], scene=scene)
    with pytest.raises(InputError, match="there are 2 scenes; expected one, or 3, one for each row"):
        tdcr.settle_batch(ROBOT, COMMANDS[:3], scene=scenes[:2])
    with pytest.raises(InputError, match="the scene of row 1 has obstacles"):
        tdcr.settle_batch(ROBOT, COMMANDS[:2], scene=[POSTS, SCENE])


def test_a_settler_goes_on_from_its_last_equilibrium_and_from_where_it_was_pickled() -> None:
    path = COMMAND + np.linspace(0, 1, 6)[:, None] * [0.004, 0.0, -0.003]
    followed = tdcr.follow(BALLS, path, PAYLOAD, scene=SCENE)
    assert followed.converged.all() and followed.contacts is not None and len(followed.contacts) >= 6
    settler = tdcr.Settler(BALLS, SCENE)
    copied = copy.deepcopy(settler)
    for row, command in enumerate(path):
        assert settler.follow(command, payload=PAYLOAD) == followed[row]
        # A copy goes on from the same configuration, but for rounding.
        found = copied.follow(command, payload=PAYLOAD)
        np.testing.assert_allclose(found.positions, followed[row].positions, atol=1e-9)
        assert found.contacts is not None
        copied = [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))][row % 2](copied)
    np.testing.assert_allclose(settler.settle(path[-1], payload=PAYLOAD).positions, found.positions, atol=1e-8)
    again = settler.settle_from(found.configuration, path[-1], payload=PAYLOAD)
    np.testing.assert_allclose(again.positions, found.positions, atol=1e-8)
    assert again.contacts is not None and settler.scene is SCENE


def test_what_is_wrong_is_named(tmp_path: Path) -> None:
    cases: list[tuple[Any, str]] = [
        (
            lambda: Scene([Obstacle.sphere("ball", -1.0)]),
            "obstacle 0 `ball`: field `sphere.radius` is -1; expected a length above 0",
        ),
        (lambda: Scene([BALL, BALL]), "obstacles 0 and 1 are both named `ball`"),
        (lambda: Scene([Obstacle.half_space("floor", mass=1.0)]), "field `mass` is 1; expected none of a half space"),
        (lambda: Scene([Obstacle.sphere("ball", 0.1, compliance=-1e-6)]), "field `compliance`"),
        (lambda: Obstacle.sphere("ball", 0.1, position=(1, 2)), "position of obstacle 'ball' has shape"),
        (lambda: Obstacle.sphere("ball", float("nan")), "radius of obstacle 'ball'"),
        (lambda: Obstacle.sphere("ball", 0.1, colour=(1, 2, 3)), r"obstacle 'ball' is given \['colour'\]; expected position"),
        (lambda: Obstacle.sphere("ball", 0.1, color=(1, 2, 300)), "expected three whole numbers from 0 to 255"),
        (lambda: Obstacle.pipe("pipe", 0.1), "expected one of them"),
        (lambda: Scene("shelf.toml"), "`Scene.load` of a file"),
        (lambda: Scene([3]), "obstacle 0 is 3; expected a tdcr.Obstacle"),
        (lambda: Scene([Obstacle.mesh("part", tmp_path / "none.stl")]), "none.stl"),
        (lambda: Scene.load(tmp_path / "none.toml"), "scene file .*none.toml: it cannot be read"),
        (lambda: SCENE.moved("bell", (0, 0, 0)), "no obstacle 'bell'; expected one of ball, wall"),
        (lambda: SCENE.moved(2, (0, 0, 0)), "obstacle 2 of 2; expected a name, or a number from 0"),
        (lambda: SCENE.moved(0, orientation=(0, 0, 0, 0)), "not all 0"),
        (lambda: tdcr.obstacle_jacobian(BALLS, COMMAND, "bell", scene=SCENE), "no obstacle 'bell'"),
    ]
    for attempt, message in cases:
        with pytest.raises(SceneError, match=message):
            attempt()
    (tmp_path / "scene.toml").write_text("[[obstacle]]\nball = 3\n", encoding="utf-8")
    with pytest.raises(SceneError, match="obstacle 0"):
        Scene.load(tmp_path / "scene.toml")
    inside = SCENE.moved("ball", (0.0, 0.0, 0.1))
    with pytest.raises(ContactError, match='disc 0 starts inside obstacle "ball"'):
        tdcr.settle(BALLS, COMMAND, scene=inside)
    with pytest.raises(ContactError, match='row 0: disc 0 starts inside obstacle "ball"'):
        tdcr.settle_batch(BALLS, [COMMAND, COMMAND], scene=inside)
    moment = tdcr.Loads(wrenches=(tdcr.Wrench(2, moment=(0, 1e-3, 0)),))
    with pytest.raises(ContactError, match="row 1: the wrench on disc 2 is a moment or turns with its disc"):
        tdcr.settle_batch(BALLS, [COMMAND, COMMAND], loads=[tdcr.Loads(), moment], scene=SCENE)
    # The question is told to be wrong even where failures are not.
    with pytest.raises(ContactError, match="the wrench on disc 2"):
        tdcr.jacobian(BALLS, COMMAND, loads=moment, scene=SCENE, on_failure="nan")
    with pytest.raises(InputError, match="scene is None; expected a tdcr.Scene"):
        tdcr.scene_vjp(BALLS, [COMMAND], np.zeros((1, 4, 3)), scene=None)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="scene is 3; expected a tdcr.Scene"):
        tdcr.settle(BALLS, COMMAND, scene=3)  # type: ignore[arg-type]
    with pytest.raises(CommandError):
        tdcr.settle(BALLS, COMMAND + 1, scene=SCENE)
    assert (
        issubclass(SceneError, InputError) and issubclass(ContactError, InputError) and issubclass(SensitivityError, RuntimeError)
    )


def test_cameras_see_obstacles() -> None:
    found = tdcr.settle(ROBOT, COMMANDS[0], scene=POSTS)
    without, among = tdcr.render(ROBOT, found), tdcr.render(ROBOT, found, scene=POSTS)
    assert all((view.mask < 40_000).all() for view in without)
    assert {int(one) for view in among for one in np.unique(view.mask) if one >= 40_000} == {40_000, 40_001, 40_002}


def test_a_robot_that_curls_up_touches_itself() -> None:
    robot = tdcr.Robot("5m")
    command = np.tile([0.04, 0.0, 0.0], 5)
    alone = tdcr.Scene()
    assert alone.self_contact == 1e-6
    found = tdcr.settle(robot, command, scene=alone)
    contacts = found.contacts
    assert contacts is not None and len(contacts) > 0
    assert (contacts.obstacle == -1).all() and set(contacts.obstacle_names) == {None}
    assert (contacts.other_disc > contacts.disc + 1).all()
    # Forces push along the normals, by the compliance times the overlap.
    np.testing.assert_allclose((contacts.force * contacts.normal).sum(1) * 1e-6, -contacts.gap, rtol=1e-6, atol=1e-10)

    through = alone.with_self_contact(None)
    assert through.self_contact is None and tdcr.Scene.from_json(through.to_json()) == through
    passed = tdcr.settle(robot, command, scene=through)
    assert passed.contacts is not None and len(passed.contacts) == 0
    np.testing.assert_array_equal(passed.positions, tdcr.settle(robot, command).positions)
    soft = tdcr.settle(robot, command, scene=alone.with_self_contact(1e-4)).contacts
    assert soft is not None and soft.penetration > contacts.penetration
    with pytest.raises(SceneError, match=r"self_contact.compliance` is -1"):
        alone.with_self_contact(-1.0)


def test_discs_rub_in_motion_and_along_paths() -> None:
    robot, command = tdcr.Robot("5m"), np.tile([0.04, 0.0, 0.0], 5)
    smooth, rough = tdcr.Scene(), tdcr.Scene().with_self_contact(1e-6, 0.4)
    assert smooth.self_friction == 0.0 and rough.self_friction == 0.4 and rough.self_contact == 1e-6
    assert tdcr.Scene.from_json(rough.to_json()) == rough != smooth
    moving = tdcr.MovingRobot(robot, scene=rough)
    moving.start_at(tdcr.State.straight(robot), command)
    words: set[str] = set()
    for _ in range(200):
        moving.step(command, frame_skip=5)
        contacts = moving.contacts
        normal = (contacts.force * contacts.normal).sum(1)
        across = np.linalg.norm(contacts.force - normal[:, None] * contacts.normal, axis=1)
        assert (across <= 0.4 * normal + 1e-5 * normal.max(initial=0.0)).all()
        words |= set(contacts.sliding)
    assert "slips" in words
    curling = [np.tile([0.02 + by, 0.02 - by, 0.02 - by], 5) for by in np.linspace(0.0, 0.018, 60)]
    path = tdcr.follow(robot, curling, scene=rough)
    assert path.converged.all() and path.contacts is not None
    assert {"sticks", "slips"} <= set(path.contacts.sliding)
    assert (path.contacts.other_disc >= 0).all()
    led = tdcr.FrictionPath(robot, scene=rough).follow(curling[-20:])
    last = led[-1].equilibrium
    assert last.converged and last.contacts is not None and set(last.contacts.sliding) <= {"sticks", "slips"}
    with pytest.raises(SceneError, match=r"self_contact.friction` is -1"):
        smooth.with_self_contact(1e-6, -1.0)


def test_a_motion_in_a_scene_comes_to_rest_where_the_robot_settles() -> None:
    scene = Scene([Obstacle.cylinder("post", 0.01, 0.4, position=(-0.06, 0.0, 0.25), friction=0.1)])
    command = np.array([0.034, 0.007, 0.001, 0.026, 0.015, 0.019])
    options = {"scene": scene, "start": "settled", "integrator": "implicit-euler", "frame_skip": 5}
    motion = tdcr.simulate("2m", np.tile(command, (20, 1)), **options)
    settled = tdcr.settle("2m", command, scene=scene)
    assert motion.contacts is not None and settled.contacts is not None
    assert np.abs(motion.positions[-1] - settled.positions).max() < 1e-8
    last = motion.contacts.row == 19
    assert last.any()
    assert np.allclose(motion.contacts.force[last].sum(axis=0), settled.contacts.force.sum(axis=0), atol=1e-6)
    assert set(motion.contacts.obstacle_names) == {"post"}

    moving = tdcr.MovingRobot("2m", integrator="implicit-euler", frame_skip=5, scene=scene)
    moving.reset(command)
    for _ in range(20):
        moving.step(command)
    assert np.array_equal(moving.positions, motion.positions[-1])
    assert moving.contacts is not None
    assert np.array_equal(moving.contacts.force, motion.contacts.force[last])
    twin = pickle.loads(pickle.dumps(moving))
    for robot in (moving, twin):
        robot.step(command * 0.9)
    assert np.array_equal(twin.positions, moving.positions)
    assert tdcr.simulate("2m", command[np.newaxis]).contacts is None
    assert tdcr.MovingRobot("2m").contacts is None

    with pytest.raises(tdcr.errors.DynamicsError, match="take no contacts"):
        tdcr.simulate("2m", command[np.newaxis], scene=scene, integrator="runge-kutta4")
    inside = Scene([Obstacle.sphere("ball", 0.05, position=(0.0, 0.0, 0.3))])
    with pytest.raises(ContactError, match="ball"):
        tdcr.simulate("2m", command[np.newaxis], scene=inside)

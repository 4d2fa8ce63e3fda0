"""Plans from Python: the command line's, held to what the package settles; deployments along curves."""

from __future__ import annotations

import numpy as np
import pytest

import tdcr

ROBOT = tdcr.Robot("2m")
FROM = np.array([0.034, 0.007, 0.001, 0.026, 0.015, 0.019])
TO = np.array([0.007, 0.001, 0.034, 0.019, 0.015, 0.026])
SCENE = tdcr.Scene([tdcr.Obstacle.sphere("ball", 0.02, position=(-0.05, 0.09, 0.29))])


def test_a_plan_is_what_the_robot_settles_in_step_by_step() -> None:
    plan = tdcr.plan(ROBOT, SCENE, from_=FROM, to=TO, clearance=0.003)
    assert (plan.commands[0] == FROM).all() and (plan.commands[-1] == TO).all()
    assert (plan.clearances >= 0.003).all() and not plan.insertions.any()
    settler = tdcr.Settler(ROBOT, scene=SCENE)
    for command, positions, tensions in zip(plan.commands, plan.positions, plan.tensions, strict=True):
        settled = settler.follow(command)
        assert settled.contacts is not None and len(settled.contacts.gap) == 0
        np.testing.assert_allclose(settled.positions, positions, atol=1e-6)
        np.testing.assert_allclose(settled.tensions, tensions, atol=1e-4)
    again = tdcr.plan(ROBOT, SCENE, from_=FROM, to=TO, clearance=0.003)
    assert (again.commands == plan.commands).all()


def test_a_plan_ends_with_the_tip_at_a_point_and_the_base_inserted() -> None:
    goal = tdcr.settle(ROBOT, TO).tip
    plan = tdcr.plan(ROBOT, from_=FROM, tip=goal)
    np.testing.assert_allclose(plan.tips[-1], goal, atol=1e-5)
    assert np.isinf(plan.clearances).all()
    moved = tdcr.plan(ROBOT, from_=FROM, to=TO, insertion=(0.0, 0.05), to_insertion=0.04)
    assert moved.insertions[0] == 0.0
    assert moved.insertions[-1] == pytest.approx(0.04)
    np.testing.assert_allclose(moved.tips[-1], goal + np.array([0.0, 0.0, 0.04]), atol=1e-5)


def test_what_cannot_be_planned_says_why() -> None:
    with pytest.raises(tdcr.errors.PlanError, match="at the start tendon"):
        tdcr.plan(ROBOT, from_=FROM, to=TO, max_tension=0.1)
    with pytest.raises(tdcr.errors.PlanError, match="no command was found"):
        tdcr.plan(ROBOT, from_=FROM, tip=(1.0, 0.0, 0.0))
    with pytest.raises(tdcr.errors.InputError, match="exactly one"):
        tdcr.plan(ROBOT, from_=FROM)


def test_a_deployment_keeps_the_tip_on_the_curve_and_the_body_near_it() -> None:
    angles = np.linspace(0.0, 0.8, 41)
    curve = 0.2 * np.stack([1.0 - np.cos(angles), 0.0 * angles, np.sin(angles)], axis=1)
    robot = tdcr.Robot("examples/three-segments.toml")
    deployed = tdcr.follow_the_leader(robot, curve, stages=10)
    assert deployed.commands.shape == (10, robot.tendons)
    assert deployed.tip_errors.max() < 1e-9
    assert deployed.deviations.mean() < 0.01 * 0.1865
    np.testing.assert_allclose(deployed.positions[-1, -1], curve[-1], atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(deployed.base_orientations, axis=1), 1.0)
    with pytest.raises(tdcr.errors.InputError, match="expected 0.1865 m at most"):
        tdcr.follow_the_leader(robot, 2.0 * curve)
    for stages in (1, 2**50):
        with pytest.raises(tdcr.errors.InputError, match=f"{stages}"):
            tdcr.follow_the_leader(robot, curve, stages=stages)


def test_plans_and_deployments_tell_how_far_they_are_and_stop_where_that_raises() -> None:
    angles = np.linspace(0.0, 0.5, 21)
    curve = 0.3 * np.stack([1.0 - np.cos(angles), 0.0 * angles, np.sin(angles)], axis=1)
    robot = tdcr.Robot("examples/three-segments.toml")
    told: list[int] = []
    tdcr.follow_the_leader(robot, curve, stages=5, progress=told.append)
    assert sum(told) == 18
    told.clear()
    plan = tdcr.plan(ROBOT, SCENE, from_=FROM, to=TO, progress=told.append)
    assert 0 <= sum(told) <= plan.nodes

    def stop(_: int) -> None:
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        tdcr.follow_the_leader(robot, curve, stages=400, progress=stop)


def test_a_deployment_among_obstacles_bears_what_the_robot_settles_with_there() -> None:
    angles = np.linspace(0.0, 0.8, 41)
    curve = 0.2 * np.stack([1.0 - np.cos(angles), 0.0 * angles, np.sin(angles)], axis=1)
    robot = tdcr.Robot("examples/three-segments.toml")
    scene = tdcr.Scene([tdcr.Obstacle.sphere("ball", 0.02, position=(0.082, 0.0, 0.142))])
    free = tdcr.follow_the_leader(robot, curve, stages=8)
    among = tdcr.follow_the_leader(robot, curve, stages=8, scene=scene)
    assert not free.contact_forces.any() and among.contact_forces[0] == 0.0 and among.contact_forces[-1] > 1e-3
    there = robot.to_dict()
    there["base"] |= {"position": among.base_positions[-1].tolist(), "orientation": among.base_orientations[-1].tolist()}
    without = tdcr.settle(there, among.commands[-1])
    settler = tdcr.Settler(tdcr.Robot(there), scene=scene)
    found = settler.settle_from(without.configuration, among.commands[-1])
    assert found.contacts is not None
    np.testing.assert_allclose(found.positions, among.positions[-1], atol=1e-6)
    force = np.linalg.norm(found.contacts.force, axis=1).sum()
    np.testing.assert_allclose(force, among.contact_forces[-1], rtol=1e-3)

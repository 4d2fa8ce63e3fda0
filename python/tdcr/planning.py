"""Motions among obstacles (:func:`plan`), and along curves (:func:`follow_the_leader`)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from tdcr import _tdcr
from tdcr._arrays import Floats, Progress, as_choice, as_count, as_float, as_number
from tdcr._results import Result
from tdcr.errors import InputError
from tdcr.loads import Loads, one_load
from tdcr.robot import RobotLike, as_robot
from tdcr.scene import Scene, as_scene, nothing


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Result):
    """A motion, by steps to be gone in a straight line from one command to the next.

    Attributes:
        commands: Of each step, from the start to the goal, shape (steps, tendons) (m or N).
        insertions: How far the base is moved along its axis, shape (steps,) (m); 0 of one that stands.
        positions: Origins of the discs, world frame, shape (steps, discs, 3) (m).
        clearances: Distance of the discs from the nearest obstacle at least, shape (steps,) (m); infinite without obstacles.
        tensions: Of the tendons, shape (steps, tendons) (N).
        nodes: Places that the search reached.
        settled: Equilibria that were solved for.
        seconds: Time that it took (s).
    """

    commands: Floats
    insertions: Floats
    positions: Floats
    clearances: Floats
    tensions: Floats
    nodes: int
    settled: int
    seconds: float

    @property
    def tips(self) -> Floats:
        """Origins of the tip disc, world frame, shape (steps, 3) (m)."""
        tips: Floats = self.positions[:, -1]
        return tips


def plan(
    robot: RobotLike,
    scene: Scene | None = None,
    *,
    from_: Any,
    to: Any = None,
    tip: Any = None,
    payload: Any = None,
    loads: Loads | None = None,
    clearance: float = 0.002,
    min_tension: float | None = None,
    max_tension: float | None = None,
    insertion: Any = None,
    to_insertion: float = 0.0,
    seed: int = 0,
    nodes: int = 100_000,
    seconds: float = 10.0,
    progress: Progress | None = None,
) -> Plan:
    """Finds a motion from one command to another, or to a place of the tip, clear of obstacles and without jumps.

    All along it the robot is in equilibria of one branch. Its discs keep a clearance from obstacles, between the steps, too, and
    do not touch each other. Start and goal are equilibria that the robot settles in from the straight pose.

    Args:
        robot: The robot, or what :class:`tdcr.Robot` makes one of.
        scene: The obstacles around it.
        from_: Command to start from, shape (tendons,) (m or N).
        to: Command to end at, shape (tendons,) (m or N).
        tip: In its place: where the tip disc's origin is to end, shape (3,) (m), under any command.
        payload: Mass hung from the last disc (kg).
        loads: Other loads, in place of the payload.
        clearance: Least distance of the discs from obstacles (m).
        min_tension, max_tension: Least and largest tension of a tendon (N); None for no limit.
        insertion: Least and largest distance of the base, along its axis, from where the robot has it (m), shape (2,), for a base
            that moves, too. A plan starts at 0.
        to_insertion: Where the base is to end (m), with ``to``.
        seed: Of the search. For one seed the plan is the same, unless time ends the search.
        nodes: Places that the search reaches at most.
        seconds: Time that the search takes at most (s).
        progress: Is called with the number of places reached since its last call.

    Raises:
        PlanError: Where no motion is found, with the reason; or the robot may not be at the start or at the goal.
        InputError: For values that make no sense.
    """
    robot = as_robot(robot)
    if (to is None) == (tip is None):
        raise InputError(f"{'neither' if to is None else 'both'} of `to` and `tip` given; expected exactly one of them")
    shape = (robot.tendons,)
    return Plan(
        *_tdcr.plan(
            robot._native,
            (nothing() if scene is None else as_scene(scene))._native,
            one_load(loads, payload)._native,
            as_float(from_, "from_", shape),
            None if to is None else as_float(to, "to", shape),
            as_number(to_insertion, "to_insertion"),
            None if tip is None else as_float(tip, "tip", (3,)).tolist(),
            as_number(clearance, "clearance"),
            (
                -math.inf if min_tension is None else as_number(min_tension, "min_tension"),
                math.inf if max_tension is None else as_number(max_tension, "max_tension"),
            ),
            None if insertion is None else as_float(insertion, "insertion", (2,)).tolist(),
            as_count(seed, "seed"),
            as_count(nodes, "nodes", 1),
            as_number(seconds, "seconds"),
            progress,
        )
    )


@dataclass(frozen=True, eq=False, repr=False)
class Deployment(Result):
    """A deployment along a curve, by stages from the tip at the curve's start to the tip at its end.

    Attributes:
        arc_lengths: Of the curve at the tip, shape (stages,) (m).
        commands: Shape (stages, tendons) (m or N).
        base_positions: Of the base, world frame, shape (stages, 3) (m).
        base_orientations: Of the base, shape (stages, 4) (w, x, y, z).
        positions: Origins of the discs, world frame, shape (stages, discs, 3) (m).
        deviations: Mean distance from the curve up to the tip's place, of what is as far from the tip at most, shape (stages,)
            (m).
        tip_errors: Distance of the tip from its place, shape (stages,) (m).
        contact_forces: Sum of the forces of contacts, shape (stages,) (N).
    """

    arc_lengths: Floats
    commands: Floats
    base_positions: Floats
    base_orientations: Floats
    positions: Floats
    deviations: Floats
    tip_errors: Floats
    contact_forces: Floats


def follow_the_leader(
    robot: RobotLike,
    curve: Any,
    *,
    scene: Scene | None = None,
    base: str = "free",
    stages: int = 40,
    payload: Any = None,
    loads: Loads | None = None,
    progress: Progress | None = None,
) -> Deployment:
    """Deploys a robot along a curve so that its body stays where its tip has gone; the base moves, too.

    Args:
        robot: The robot, or what :class:`tdcr.Robot` makes one of. Where its base is does not matter.
        curve: Points of the curve from its start on, world frame, shape (points, 3) (m). It is no longer than the robot.
        scene: Obstacles around it, which it may touch.
        base: ``"free"``, as a manipulator carries it: the tip is then exactly on the curve; or ``"carriage"``, along the
            direction in which the curve begins.
        stages: Of equal length.
        payload: Mass hung from the last disc (kg).
        loads: Other loads, in place of the payload.
        progress: Is called with the number of steps done since its last call; there are 13 before the first stage.

    Raises:
        InputError: For a curve that is none, or longer than the robot.
        PlanError: Where the robot does not settle on the way.
    """
    robot = as_robot(robot)
    return Deployment(
        *_tdcr.follow_the_leader(
            robot._native,
            (nothing() if scene is None else as_scene(scene))._native,
            one_load(loads, payload)._native,
            as_float(curve, "curve", ("points", 3)),
            as_choice(base, "base", ("free", "carriage")),
            as_count(stages, "stages", 2),
            progress,
        )
    )

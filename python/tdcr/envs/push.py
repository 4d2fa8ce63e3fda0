"""The task of pushing an object to a place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tdcr._arrays import Floats
from tdcr.envs.obstructed import across, surroundings, widest
from tdcr.envs.tasks import Infos, Reach, Rngs, Terms, norms
from tdcr.envs.world import Observed, World
from tdcr.errors import InputError
from tdcr.obstacles import Obstacle

_TABLE, _OBJECT = (200, 170, 90), (60, 110, 200)
_TOP = 0.4
"""Height of the table over the base, in lengths of the robot, as are all sizes here."""
_THICKNESS, _DEPTH, _BREADTH = 0.1, 1.4, 3.0
"""Of the table; the second is away from the robot."""
_CLEAR = 0.23
"""Room between a straight robot and the table's edge."""
_BEHIND = 0.13
"""From the table's edge to where the object stands at first."""
_RADIUS, _HEIGHT = 0.1, 0.3
"""Of the object, a cylinder that stands."""
_FRICTION = 0.5
_UPRIGHT = np.cos(np.deg2rad(5.0))

_LARGEST = (2.0,) * 6 + (1.0,) * 4 + (20.0,) * 3 + (50.0,) * 3
"""Bounds of the goal and of the object's place, quaternion, velocity and angular velocity."""


class Push(Reach):
    """An object to a place: a cylinder that stands on a table beside the robot, which bends over the table to push it.

    The goal is a place of the object's centre on the table, farther from the robot than where the object stands at first. It is
    observed with the object: place of its centre, quaternion, velocity (lengths of the robot a second), and angular velocity
    (rad/s). Drawn from ranges of ``randomise`` are ``"way"``, from the object to the goal (lengths of the robot); ``"bearing"``,
    the angle in which the object stands to one side of the table's middle (rad); ``"turn"``, the angle of the way to one side of
    straight away from the robot (rad); and ``"object_mass"`` (kg). Of the angles the side is drawn, too.

    The reward is minus the distance of object and goal, and as the term ``reach`` minus that from the place behind the object
    where a disc pushes it towards the goal to the nearest disc, both in lengths of the robot. Episodes start with the robot
    in the middle of its tendons' ranges.
    """

    measurable = False
    in_scenes = True
    in_motion = True
    ranges: ClassVar[Mapping[str, tuple[float, float]]] = {
        "way": (0.08, 0.16),
        "bearing": (0.0, 0.3),
        "turn": (0.0, 0.3),
        "object_mass": (0.01, 0.03),
    }
    terms = ("distance", "reach")

    def __init__(self, world: World) -> None:
        if not world.settings.dynamics:
            raise InputError("the task is to push an object, and objects stand while robots settle; expected dynamics=True")
        super().__init__(world)
        gravity = np.asarray(world.robot.to_dict().get("gravity", (0.0, 0.0, 0.0)), dtype=np.float64)
        if not -gravity @ world.axis > _UPRIGHT * np.linalg.norm(gravity):
            raise InputError(
                f"robot {world.robot.name!r} points along {_rounded(world.axis)} under the gravity {_rounded(gravity)} m/s²; "
                "the table beside it has to be level: expected a robot that stands upright"
            )
        self.width = len(_LARGEST)
        self.goal = np.zeros((world.count, self.width), dtype=np.float32)
        self._first, self._second = across(world.axis)
        self._edge = widest(world) + _CLEAR * world.length
        self._disc = widest(world)
        self._table = self._build_table()

    def bounds(self) -> Observed:
        return np.asarray(_LARGEST, dtype=np.float32)

    def check_ranges(self) -> None:
        ranges = self.world.draws.ranges
        for name, most, what in (("way", 0.5, "lengths of the robot"), ("bearing", 0.7, "rad"), ("turn", 0.7, "rad")):
            low, high = ranges[name]
            if high > most:
                raise InputError(f"randomise[{name!r}] is ({low}, {high}); expected {most} {what} at most")
        low, high = ranges["object_mass"]
        if not low > 0.0:
            raise InputError(f"randomise['object_mass'] is ({low}, {high}); expected masses above 0 kg")

    def parts(self) -> dict[str, slice]:
        return {
            "object": slice(3, 6),
            "object_quaternion": slice(6, 10),
            "object_velocity": slice(10, 13),
            "object_rates": slice(13, 16),
        }

    def draw(self, rows: Sequence[int], rngs: Rngs) -> None:
        world, drawn = self.world, self.world.draws.values
        away = self._edge + _BEHIND * world.length
        height = (_TOP + 0.5 * _HEIGHT) * world.length
        for row, rng in zip(rows, rngs, strict=True):
            sides = rng.choice((-1.0, 1.0), 2)
            bearing = sides[0] * drawn["bearing"][row]
            start = world.origin + height * world.axis + away * self._towards(bearing)
            goal = start + drawn["way"][row] * world.length * self._towards(bearing + sides[1] * drawn["turn"][row])
            self.goal[row, :3] = world.scaled(goal)
            thing = Obstacle.cylinder(
                "object",
                _RADIUS * world.length,
                _HEIGHT * world.length,
                position=start,
                orientation=self._table.orientation,
                friction=_FRICTION,
                color=_OBJECT,
                mass=float(drawn["object_mass"][row]),
            )
            world.surround(row, surroundings(world, [self._table, thing]))

    def start(self, rows: Sequence[int], rngs: Rngs) -> None:
        self.world.settle_in_the_middle(rows)

    def goals(self, steps: NDArray[np.int64]) -> Observed:
        world, things = self.world, self._objects()
        states = np.column_stack([world.scaled(things[:, :3]), things[:, 3:7], things[:, 7:10] / world.length, things[:, 10:13]])
        self.goal[:, 3:] = np.clip(states, -self.bounds()[3:], self.bounds()[3:])
        return self.goal

    def assess(self, observed: Observed, goals: Observed) -> tuple[Floats | Terms, Infos]:
        world = self.world
        at = self._objects()[:, :3]
        left = world.unscaled(goals[:, :3]) - at
        distance = norms(left)
        # At the goal there is no side to push from: the place where the nearest disc should be moves into the object.
        reach = _RADIUS * world.length + self._disc
        behind = at - reach * left / np.maximum(distance, self.tolerance)[:, None]
        gap = norms(world.simulation.positions() - behind[:, None]).min(axis=1)
        terms = {"distance": -distance / world.length, "reach": -gap / world.length}
        return terms, {**self.info(distance), "gap": gap, "object_position": at}

    def targets(self, row: int, step: int) -> Floats:
        return self.world.unscaled(self.goal[row, :3].reshape(1, 3))

    def _objects(self) -> Floats:
        """The pushed object of each row, shape (count, 16): it is the last of its scene."""
        objects: Floats = self.world.simulation.objects()[:, -1]
        return objects

    def _towards(self, angle: float) -> Floats:
        """The level unit vector at an angle (rad) from the table's middle."""
        return np.asarray(np.cos(angle) * self._first + np.sin(angle) * self._second)

    def _build_table(self) -> Obstacle:
        world = self.world
        thickness, depth, breadth = (share * world.length for share in (_THICKNESS, _DEPTH, _BREADTH))
        middle = world.origin + (_TOP * world.length - 0.5 * thickness) * world.axis + (self._edge + 0.5 * depth) * self._first
        turn = _quaternion(np.column_stack([self._first, self._second, world.axis]))
        return Obstacle.box(
            "table", (depth, breadth, thickness), position=middle, orientation=turn, friction=_FRICTION, color=_TABLE
        )


def _rounded(vector: Floats) -> tuple[float, ...]:
    return tuple(np.round(vector, 3).tolist())


def _quaternion(turn: Floats) -> Floats:
    """The quaternion (w, x, y, z) of a rotation matrix: the eigenvector of the largest eigenvalue (Bar-Itzhack 2000)."""
    (a, b, c), (d, e, f), (g, h, i) = turn
    quadratic = np.array(
        [
            [a + e + i, h - f, c - g, d - b],
            [h - f, a - e - i, b + d, c + g],
            [c - g, b + d, e - a - i, f + h],
            [d - b, c + g, f + h, i - a - e],
        ]
    )
    vector: Floats = np.linalg.eigh(quadratic)[1][:, -1]
    return vector

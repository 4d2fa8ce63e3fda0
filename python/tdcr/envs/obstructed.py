"""Tasks among obstacles that are drawn anew for each episode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from tdcr._arrays import Floats, as_count, as_number
from tdcr.envs.tasks import Infos, Reach, Rngs, Task, Terms, norms
from tdcr.envs.world import Observed, World
from tdcr.errors import ContactError, InputError
from tdcr.obstacles import Obstacle
from tdcr.scene import Scene

_BALLS = (60, 110, 200)
_TUBE = (200, 170, 90)
_ROOM = 0.02
"""Room that a straight robot has between balls, in its lengths."""
_ENTERED = 0.15
"""How much of the straight robot is in a tube where an episode starts, in lengths of the robot."""
_BEYOND = 0.05
"""Length of a tube beyond its goal, in lengths of the robot."""
_CORNERS = 8
"""Corners of a tube's axis, which are rounded off."""


def surroundings(world: World, obstacles: Sequence[Obstacle]) -> Scene:
    """Obstacles beside those of the world's own scene, and what that says of the robot's contact with itself."""
    own = world.settings.scene
    names = {obstacle.name for obstacle in obstacles}
    for taken in () if own is None else (obstacle.name for obstacle in own.obstacles if obstacle.name in names):
        raise InputError(f"scene has an obstacle {taken!r}, as the task itself has; expected another name")
    scene = Scene([*(() if own is None else own.obstacles), *obstacles])
    return scene if own is None else scene.with_self_contact(own.self_contact, own.self_friction)


def across(axis: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors at right angles to another, and to each other."""
    least = np.eye(3)[np.abs(axis).argmin()]
    first = np.cross(axis, least)
    first /= np.linalg.norm(first)
    return first, np.cross(axis, first)


def widest(world: World) -> float:
    """Largest radius of a disc (m)."""
    return max(float(module["radius"]) for module in world.robot.to_dict()["modules"])


class ReachObstacle(Reach):
    """The tip to a point among balls, whose places and sizes are drawn for each episode.

    The goal is where the robot settles among them under a random command. It is observed with the balls: centre and radius of
    each, in lengths of the robot. The straight robot touches none. Their radius is drawn from the range ``"ball_radius"`` of
    ``randomise`` (lengths of the robot).

    Args:
        obstacles: How many balls.
    """

    measurable = False
    in_scenes = True
    ranges: ClassVar[Mapping[str, tuple[float, float]]] = {"ball_radius": (0.08, 0.2)}

    def __init__(self, world: World, obstacles: int = 4) -> None:
        self.obstacles = as_count(obstacles, "obstacles", 1, 1000)
        super().__init__(world)
        self.width = 3 + 4 * self.obstacles
        self.goal = np.zeros((world.count, self.width), dtype=np.float32)
        self._widest = widest(world)

    def check_ranges(self) -> None:
        low, high = self.world.draws.ranges["ball_radius"]
        if not 0.0 < low <= high <= 1.0:
            raise InputError(f"randomise['ball_radius'] is ({low}, {high}); expected lengths of the robot above 0, 1 at most")

    def parts(self) -> dict[str, slice]:
        return {"obstacles": slice(3, self.width)}

    def draw(self, rows: Sequence[int], rngs: Rngs) -> None:
        world = self.world
        for row, rng in zip(rows, rngs, strict=True):
            balls = self._balls(rng)
            self.goal[row, 3:] = np.column_stack([world.scaled(balls[:, :3]), balls[:, 3] / world.length]).ravel()
            named = [Obstacle.sphere(f"ball {k}", ball[3], position=ball[:3], color=_BALLS) for k, ball in enumerate(balls)]
            world.surround(row, surroundings(world, named))
        world.settle_anywhere(rows, rngs)
        rows = list(rows)
        self.goal[rows, :3] = world.scaled(world.simulation.positions()[rows, -1])

    def _balls(self, rng: np.random.Generator) -> Floats:
        """Centres and radii of balls around the straight robot, shape (obstacles, 4) (m)."""
        world = self.world
        first, second = across(world.axis)
        balls = np.empty((self.obstacles, 4))
        for ball in balls:
            radius = world.length * rng.uniform(*world.draws.ranges["ball_radius"])
            height, angle = world.length * rng.uniform(0.3, 1.1), rng.uniform(0.0, 2.0 * np.pi)
            nearest = self._widest + radius + _ROOM * world.length
            away = rng.uniform(nearest, nearest + 0.5 * world.length)
            ball[:3] = world.origin + height * world.axis + away * (np.cos(angle) * first + np.sin(angle) * second)
            ball[3] = radius
        return balls

    def targets(self, row: int, step: int) -> Floats:
        return self.world.unscaled(self.goal[row, :3].reshape(1, 3))


class Insert(Task):
    """The robot into a bent tube, in which its tip is: its base moves along its axis, by the last entry of an action.

    A tube bends by an angle of the range ``"bend"`` of ``randomise`` (rad), in a direction that is drawn. It is wider than the
    robot by ``clearance`` of the widest disc's radius; the goal is ``depth`` deep in it. Points along its axis, from the mouth
    to the goal, are observed. There is no way past the tube: its mouth is a hole in a wall.

    The reward is minus the distance that the tip has still to go along the axis, with that by which it is farther from the axis
    than a disc can be in the tube, in lengths of the robot.

    Args:
        depth: Length of the tube's axis to the goal, in lengths of the robot.
        clearance: By how much the tube is wider than the widest disc, as a share of that.
        points: Points of the axis that are observed.
    """

    insertion = 0.6
    in_scenes = True
    ranges: ClassVar[Mapping[str, tuple[float, float]]] = {"bend": (0.5, 1.5)}
    terms = ("distance",)

    def __init__(self, world: World, depth: float = 0.5, clearance: float = 0.3, points: int = 6) -> None:
        count = as_count(points, "points", 2, 1000)
        if not 0.0 < as_number(depth, "depth") <= 0.6:
            raise InputError(f"depth is {depth}; expected lengths of the robot above 0, 0.6 at most")
        if not 0.0 < as_number(clearance, "clearance") <= 10.0:
            raise InputError(f"clearance is {clearance}; expected a share of the disc's radius above 0, 10 at most")
        super().__init__(world, 3 * count)
        self._depth, self._play = depth * world.length, clearance * widest(world)
        self._radius = widest(world) + self._play
        self._points = count
        # Of each tube's axis, from before its mouth to the goal.
        self._axes: Floats = np.zeros((world.count, _CORNERS + 2, 3))

    def check_ranges(self) -> None:
        steepest = self.world.draws.ranges["bend"][1]
        if self._depth < 1.2 * self._radius * steepest:
            most = self._depth / (1.2 * self._radius)
            tube = f"a tube of {self._radius:.4f} m radius and {self._depth:.4f} m length"
            raise InputError(f"randomise['bend'] reaches {steepest} rad in {tube}; expected {most:.3f} rad at most")

    def draw(self, rows: Sequence[int], rngs: Rngs) -> None:
        world = self.world
        first, second = across(world.axis)
        for row, rng in zip(rows, rngs, strict=True):
            bend, angle = world.draws.values["bend"][row], rng.uniform(0.0, 2.0 * np.pi)
            side = np.cos(angle) * first + np.sin(angle) * second
            beyond = self._depth + _BEYOND * world.length
            tube = self._along(bend / self._depth, side, np.linspace(0.0, beyond, _CORNERS))
            named = Obstacle.pipe("tube", self._radius, path=tube, color=_TUBE)
            world.surround(row, surroundings(world, [named]))
            inside = np.linspace(0.0, self._depth, _CORNERS)
            before = np.array([-1.0 * world.length])
            self._axes[row] = self._along(bend / self._depth, side, np.concatenate([before, inside, [self._depth]]))
            goals = self._along(bend / self._depth, side, np.linspace(0.0, self._depth, self._points))
            self.goal[row] = world.scaled(goals).ravel()

    def _along(self, curvature: float, side: Floats, arc: Floats) -> Floats:
        """Points of a tube's axis at arc lengths from its mouth, shape (points, 3) (m): an arc to ``side``, before it a line."""
        world = self.world
        top = (1.0 - _ENTERED) * world.length
        turn = curvature * np.maximum(arc, 0.0)
        # sin(x) / x and (1 - cos(x)) / x, also at 0.
        ahead = np.where(arc > 0.0, arc * np.sinc(turn / np.pi), arc)
        aside = np.where(arc > 0.0, 0.5 * arc * turn * np.sinc(0.5 * turn / np.pi) ** 2, 0.0)
        return np.asarray(world.origin + (top + ahead)[:, None] * world.axis + aside[:, None] * side)

    def start(self, rows: Sequence[int], rngs: Rngs) -> None:
        """With the tip in the mouth of a tube in which the robot settles.

        Raises:
            InputError: Where a part of the straight robot is in the tube's wall.
        """
        by_row = dict(zip(rows, rngs, strict=True))
        try:
            self.world.settle_in_the_middle(rows, lambda again: self.draw(again, [by_row[row] for row in again]))
        except ContactError as error:
            # A slender robot, straight at first, in a tube that bends.
            raise InputError(f"{error}, or less of randomise['bend'], or more clearance") from error

    def assess(self, observed: Observed, goals: Observed) -> tuple[Floats | Terms, Infos]:
        world = self.world
        tips = world.unscaled(world.tips(observed))
        starts, ways = self._axes[:, :-1], np.diff(self._axes, axis=1)
        lengths = norms(ways)
        # The nearest point of each piece of the axis, as a share of it; the last piece has no length.
        squares = np.maximum(lengths**2, 1e-300)
        shares = np.clip(np.einsum("rki,rki->rk", tips[:, None] - starts, ways) / squares, 0.0, 1.0)
        aside = norms(tips[:, None] - starts - shares[..., None] * ways)
        piece = aside.argmin(axis=1)
        row = np.arange(world.count)
        gone = np.cumsum(lengths, axis=1) - lengths
        left = lengths.sum(axis=1) - gone[row, piece] - shares[row, piece] * lengths[row, piece]
        off = np.maximum(aside[row, piece] - self._play, 0.0)
        distance = left + off
        told = {"depth": self._depth - left, "insertion": world.commands[:, -1].copy()}
        return {"distance": -distance / world.length}, {**self.info(distance), **told}

"""Tasks: what is asked of the robots, what of that is observed, and what is rewarded, on batches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tdcr import _tdcr
from tdcr._arrays import Floats, as_array, as_count, as_float
from tdcr.envs.world import Observed, World
from tdcr.errors import InputError, NotSettledError
from tdcr.statics import follow

Rngs = Sequence[np.random.Generator]
"""A generator for each row."""

Infos = dict[str, NDArray[Any]]
"""What is told besides, by name: one entry for each row."""

Terms = dict[str, Floats]
"""Terms of the reward by name, before they are weighted, shape (count,) each."""

_TOLERANCE = 0.05
"""Distance that counts as success, in lengths of the robot, where none is given."""
_PATHS = 100
"""Paths that are drawn until one settles."""


class Task:
    """What is asked of each row of a :class:`~tdcr.envs.world.World`; subclass it for a task of your own.

    Attributes:
        goal_based: Whether observations are dictionaries with ``achieved_goal`` and ``desired_goal``, which then are tips.
        measurable: Whether it asks for nothing but what a rig's cameras tell: the tip.
        ranges: Ranges where ``randomise`` has none: of the names that simulated worlds know, and of others, which are the task's
            own and are drawn into ``world.draws.values``.
        insertion: How far bases are inserted along their axes, in lengths of the robot, where they move.
        in_scenes: Whether it puts obstacles around each row, by ``world.surround``.
        in_motion: Whether robots move in time where ``dynamics`` is not given.
        terms: Names of the reward's terms.
        options: Names of what ``reset(options=...)`` may ask for besides what all tasks take, which :meth:`asked` reads.
        width: Entries of the goal in an observation.
        tolerance: Distance that counts as success (m).
    """

    goal_based: ClassVar[bool] = False
    measurable: ClassVar[bool] = False
    ranges: ClassVar[Mapping[str, tuple[float, float]]] = {}
    insertion: ClassVar[float | None] = None
    in_scenes: ClassVar[bool] = False
    in_motion: ClassVar[bool] = False
    terms: ClassVar[tuple[str, ...]] = ("task",)
    options: ClassVar[tuple[str, ...]] = ()

    def __init__(self, world: World, width: int) -> None:
        given = world.settings.tolerance
        self.world, self.width = world, width
        self.tolerance = _TOLERANCE * world.length if given is None else given
        self.goal: Observed = np.zeros((world.count, width), dtype=np.float32)

    def bounds(self) -> Observed:
        """Largest absolute value of each entry of the goal, shape (width,)."""
        return np.full(self.width, 2.0, dtype=np.float32)

    def check_ranges(self) -> None:
        """Refuses ranges of ``randomise`` that the task cannot have, by an :class:`~tdcr.errors.InputError`."""

    def parts(self) -> dict[str, slice]:
        """Where parts of the goal are in it, by names for ``layout``."""
        return {}

    def draw(self, rows: Sequence[int], rngs: Rngs) -> None:
        """Draws what is asked of some rows from now on, each from its generator alone. They are settled anew afterwards."""
        raise NotImplementedError

    def asked(self, options: Mapping[str, Any]) -> Observed | None:
        """First entries of goals that the options of a reset ask for, shape (count, entries), as they are observed, in place of
        those that are drawn; ``None`` where they ask for none."""
        return None

    def start(self, rows: Sequence[int], rngs: Rngs) -> None:
        """Lets some rows settle where their episodes start."""
        self.world.settle_anywhere(rows, rngs)

    def goals(self, steps: NDArray[np.int64]) -> Observed:
        """What is asked of each row after ``steps``, shape (count, width), as it is observed."""
        return self.goal

    def assess(self, observed: Observed, goals: Observed) -> tuple[Floats | Terms, Infos]:
        """Rewards, shape (count,), or their terms, and what is told besides: ``distance`` (m) and ``is_success`` at least."""
        raise NotImplementedError

    def targets(self, row: int, step: int) -> Floats:
        """Points to draw into pictures of a row, shape (points, 3) (m)."""
        return self.world.unscaled(self.goal[row].reshape(-1, 3))

    def info(self, distance: Floats) -> Infos:
        """The usual information."""
        return {"distance": distance, "is_success": distance < self.tolerance}


def norms(vectors: NDArray[Any]) -> Floats:
    """Lengths of vectors along the last axis."""
    wide = np.asarray(vectors, dtype=np.float64)
    norms: Floats = np.sqrt(np.einsum("...i,...i->...", wide, wide))
    return norms


class Reach(Task):
    """The tip to a point: the tip of the robot settled under a random command, or ``options["goal"]`` of a reset, world frame
    (m), shape (3,) or (num_envs, 3).

    The reward is minus the distance in lengths of the robot.
    """

    measurable = True
    options = ("goal",)
    terms: ClassVar[tuple[str, ...]] = ("distance",)

    def __init__(self, world: World) -> None:
        super().__init__(world, 3)

    def draw(self, rows: Sequence[int], rngs: Rngs) -> None:
        self.world.settle_anywhere(rows, rngs)
        rows = list(rows)
        self.goal[rows] = self.world.scaled(self.world.simulation.positions()[rows, -1])

    def asked(self, options: Mapping[str, Any]) -> Observed | None:
        if "goal" not in options:
            return None
        world, bounds = self.world, self.bounds()[:3]
        given = as_array(options["goal"], "options['goal']")
        goals = as_float(given, "options['goal']", (3,) if given.ndim == 1 else (world.count, 3))
        places = world.scaled(np.broadcast_to(goals, (world.count, 3)))
        if (np.abs(places) > bounds).any():
            row, axis = (int(k) for k in np.argwhere(np.abs(places) > bounds)[0])
            found, middle, reach = world.unscaled(places)[row, axis], world.origin[axis], bounds[axis] * world.length
            raise InputError(
                f"options['goal'] has {'xyz'[axis]} = {found:.6g} m; expected {middle - reach:.3f} to {middle + reach:.3f} m, "
                f"{bounds[axis]:.0f} lengths of the robot from its base"
            )
        return places.astype(np.float32)

    def assess(self, observed: Observed, goals: Observed) -> tuple[Floats | Terms, Infos]:
        apart = norms(self.world.tips(observed) - goals[:, :3])
        return {"distance": -apart}, self.info(apart * self.world.length)


class ReachGoal(Reach):
    """The tip to a point, with the goal beside what is achieved. The reward is 0 within the tolerance, and else -1."""

    goal_based = True
    terms = ("goal",)

    def compute_reward(self, achieved: Any, desired: Any, info: Any = None) -> Floats:
        """Reward for having achieved a goal, for any number of leading axes: shapes (..., 3) in, (...) out."""
        return (self.distance(achieved, desired) < self.tolerance).astype(np.float64) - 1.0

    def distance(self, achieved: Any, desired: Any) -> Floats:
        """Distance (m) between goals."""
        return norms(np.asarray(achieved) - np.asarray(desired)) * self.world.length

    def assess(self, observed: Observed, goals: Observed) -> tuple[Floats | Terms, Infos]:
        tips = self.world.tips(observed)
        return {"goal": self.compute_reward(tips, goals)}, self.info(self.distance(tips, goals))


class ReachGoalDense(ReachGoal):
    """The same with the reward of :class:`Reach`."""

    def compute_reward(self, achieved: Any, desired: Any, info: Any = None) -> Floats:
        return -self.distance(achieved, desired) / self.world.length


class Payload(Reach):
    """The tip to a point while an unknown payload hangs from it, which is told but not observed."""

    ranges: ClassVar[Mapping[str, tuple[float, float]]] = {"payload": (0.0, 0.03)}

    def info(self, distance: Floats) -> Infos:
        return {**super().info(distance), "payload": self.world.payloads.copy()}


class Shape(Task):
    """The whole robot to a shape: the poses of all discs, or the cloud that cameras see, under a random command.

    Poses are rewarded by minus the mean distance of the discs (in lengths of the robot) and minus the mean angle between
    their orientations (in half turns). Clouds are by minus the distance ``sqrt(CD / 2)`` in lengths of the robot, with the
    Chamfer distance ``CD`` (m²).
    """

    terms = ("distance", "angle")

    def __init__(self, world: World, target: str = "poses") -> None:
        if target not in ("poses", "cloud"):
            raise InputError(f"target is {target!r}; expected 'poses' or 'cloud'")
        self.of_clouds = target == "cloud"
        self._discs = world.robot.discs
        super().__init__(world, 3 * world.settings.points if self.of_clouds else 7 * self._discs)
        self._clouds = np.zeros((world.count, world.settings.points, 3), dtype=np.float32)

    def bounds(self) -> Observed:
        largest = super().bounds()
        if not self.of_clouds:
            largest[3 * self._discs :] = 1.0
        return largest

    def draw(self, rows: Sequence[int], rngs: Rngs) -> None:
        world, rows, places = self.world, list(rows), 3 * self._discs
        world.settle_anywhere(rows, rngs)
        if self.of_clouds:
            self._clouds[rows] = clouds = world.clouds(rows)
            self.goal[rows] = np.clip(world.scaled(clouds).reshape(len(rows), -1), -2.0, 2.0)
            return
        self.goal[rows, :places] = world.scaled(world.simulation.positions()[rows]).reshape(len(rows), -1)
        self.goal[rows, places:] = world.simulation.quaternions()[rows].reshape(len(rows), -1)

    def assess(self, observed: Observed, goals: Observed) -> tuple[Floats | Terms, Infos]:
        world = self.world
        if self.of_clouds:
            chamfer = _tdcr.chamfer_rows(world.clouds(), self._clouds)
            distance = np.sqrt(0.5 * chamfer)
            return {"distance": -distance / world.length}, {**self.info(distance), "chamfer": chamfer}
        places, turns = np.split(goals, [3 * self._discs], axis=1)
        apart = world.scaled(world.simulation.positions()) - places.reshape(world.count, -1, 3)
        # The angle between two orientations is twice that between their quaternions, of whichever sign.
        cosines = np.einsum("...i,...i->...", world.simulation.quaternions(), turns.reshape(world.count, -1, 4))
        angle = (2.0 * np.arccos(np.minimum(np.abs(cosines), 1.0))).mean(axis=1)
        shares = norms(apart).mean(axis=1)
        return {"distance": -shares, "angle": -angle / np.pi}, {**self.info(shares * world.length), "angle": angle}

    def targets(self, row: int, step: int) -> Floats:
        if self.of_clouds:
            return np.asarray(self._clouds[row], dtype=np.float64)
        return self.world.unscaled(self.goal[row, : 3 * self._discs].reshape(-1, 3))


class Track(Task):
    """The tip along a path: that of the settled robot along a closed, smooth path of commands that an episode goes once.

    The path of commands is ``(1/3) sum_i (1 + cos(2 pi (s - i/3))) c_i`` of three random commands. The next ``preview``
    points of the tip are observed; the reward is minus the distance to the first of them, in lengths of the robot.
    """

    terms = ("distance",)

    def __init__(self, world: World, preview: int = 4) -> None:
        self.preview = as_count(preview, "preview", 1, 1000)
        super().__init__(world, 3 * self.preview)
        self._points = world.settings.episode_length + 1
        self._path: Observed = np.zeros((world.count, self._points, 3), dtype=np.float32)
        self._first: Floats = np.zeros((world.count, world.tendons))
        phase = np.arange(self._points)[:, None] / (self._points - 1) - np.arange(3) / 3.0
        self._shares = (1.0 + np.cos(2.0 * np.pi * phase)) / 3.0

    def draw(self, rows: Sequence[int], rngs: Rngs) -> None:
        world = self.world
        for row, rng in zip(rows, rngs, strict=True):
            for _ in range(_PATHS):
                path = world.clip(self._shares @ np.stack([world.draw_command(rng) for _ in range(3)]))
                settled = follow(world.robot_of(row), path, payload=world.payloads[row], scene=world.scene_of(row))
                if settled.converged.all():
                    break
            else:
                raise NotSettledError(f"robot {world.robot.name!r} settles along none of {_PATHS} random paths of commands")
            self._path[row] = world.scaled(settled.tips)
            self._first[row] = path[0]

    def start(self, rows: Sequence[int], rngs: Rngs) -> None:
        """At the start of the path."""
        rows = list(rows)
        self.world.settle(rows, self._first[rows])

    def goals(self, steps: NDArray[np.int64]) -> Observed:
        ahead = steps[:, None] + np.arange(self.preview)
        # A path is closed: its last point is its first.
        points: Observed = self._path[np.arange(self.world.count)[:, None], ahead % (self._points - 1)]
        return points.reshape(self.world.count, -1)

    def assess(self, observed: Observed, goals: Observed) -> tuple[Floats | Terms, Infos]:
        apart = norms(self.world.tips(observed) - goals[:, :3])
        return {"distance": -apart}, self.info(apart * self.world.length)

    def targets(self, row: int, step: int) -> Floats:
        ahead = (step + np.arange(self.preview)) % (self._points - 1)
        return self.world.unscaled(self._path[row, ahead])

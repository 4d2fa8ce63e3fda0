"""The simulated robots of a batch of environments: how actions drive them, and what is seen of them."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from tdcr import _tdcr
from tdcr._arrays import Floats, as_count, as_number
from tdcr.envs.draws import Draws
from tdcr.errors import InputError, NotSettledError
from tdcr.robot import Robot
from tdcr.scene import Scene, as_scene, nothing

if TYPE_CHECKING:
    from tdcr.rig import Rig

Observed = NDArray[np.float32]
"""Observations, float32."""

Bools = NDArray[np.bool_]
"""Flags."""

OBSERVATIONS = ("state", "tip", "cloud")
ACTIONS = ("increment", "absolute")
_ATTEMPTS = 100
"""Commands, or surroundings, that are drawn for a robot until one settles."""
_LARGEST_PLACE, _LARGEST_RATE, _LARGEST_VELOCITY, _LARGEST_TENSION = 2.0, 50.0, 20.0, 1000.0
"""Bounds of what is observed, as `python/src/env/row.rs` has them."""


@dataclass(frozen=True)
class Settings:
    """What environments take besides their task: see :class:`tdcr.envs.TendonRobotEnv`."""

    robot: str | os.PathLike[str] | Mapping[str, Any] | Robot = "2m"
    dynamics: bool = False
    randomise: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    observation: Literal["state", "tip", "cloud"] = "state"
    frame_skip: int = 20
    timestep: float = 0.002
    episode_length: int = 100
    rate: float = 0.1
    tolerance: float | None = None
    points: int = 256
    rig: str | os.PathLike[str] | Rig | None = None
    scene: Scene | None = None
    contact_cost: float = 0.0
    action: Literal["increment", "absolute"] = "increment"
    tension_range: tuple[float, float] | None = None
    observe_tensions: bool = False
    weights: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, word, known in (("observation", self.observation, OBSERVATIONS), ("action", self.action, ACTIONS)):
            if word not in known:
                raise InputError(f"{name} is {word!r}; expected one of {', '.join(known)}")
        if self.observe_tensions and self.observation == "cloud":
            raise InputError("observe_tensions is of the observations 'state' and 'tip'; expected one of these, or False")
        as_count(self.frame_skip, "frame_skip", 1, 10**6)
        as_count(self.episode_length, "episode_length", 1, 10**9)
        as_count(self.points, "points", 1, 10**5)
        for name, value in (("timestep", self.timestep), ("rate", self.rate), ("tolerance", self.tolerance)):
            if value is not None and not as_number(value, name) > 0.0:
                raise InputError(f"{name} is {value}; expected a number above 0")

        if self.scene is not None:
            as_scene(self.scene)
        if not as_number(self.contact_cost, "contact_cost") >= 0.0:
            raise InputError(f"contact_cost is {self.contact_cost}; expected a number of 0 or more")
        if not isinstance(self.weights, Mapping):
            raise InputError(f"weights is {self.weights!r}; expected a dictionary from terms of the reward to numbers")
        for name, weight in self.weights.items():
            as_number(weight, f"weights[{name!r}]")

    @property
    def render_fps(self) -> float:
        """Pictures of a second, one for each step: in the robot's time, where it moves in time."""
        if not self.dynamics:
            return 25
        rate = round(1.0 / (self.timestep * self.frame_skip), 6)
        return int(rate) if rate.is_integer() else rate

    def of_robot(self, robot: Robot) -> Settings:
        """The same for another robot."""
        return replace(self, robot=robot)


class World:
    """``count`` simulated robots, driven by actions and seen as observations.

    Attributes:
        robot: The robot that is not randomised.
        length: Length of its backbone (m), in which places are observed.
        origin: Its base (m), from which they are observed.
        axis: Direction of its straight backbone, a unit vector in world axes.
        draws: What each reset draws.
        commands: Of each row, shape (count, entries): of its tendons (m or N), then of a base that moves, its insertion (m).
        changes: By how much they changed in the last step, in shares of what they may, shape (count, entries).
        steps: Steps since the last reset, shape (count,).
        layout: Where each quantity is in an observation, by name.
        low, high: Bounds of an observation.
    """

    def __init__(
        self,
        count: int,
        settings: Settings,
        of_task: Sequence[str] = (),
        insertion: float | None = None,
        in_scenes: bool = False,
    ) -> None:
        """Robots with ranges that a task has besides, whose bases are inserted by up to ``insertion`` of their lengths, each in a
        scene of its own where they are ``in_scenes``."""
        if insertion is not None and settings.dynamics:
            raise InputError("the task moves the base, which stands while a robot moves in time; expected dynamics=False")
        self.count, self.settings = count, settings
        self.robot = robot = _driven_by_tension(Robot(settings.robot), settings.tension_range)
        self.origin: Floats = np.asarray(robot.to_dict()["base"].get("position", [0.0] * 3), dtype=np.float64)
        joints = np.vstack([self.origin, robot.straight_positions])
        self.length = float(np.linalg.norm(np.diff(joints, axis=0), axis=1).sum())
        self.axis: Floats = (joints[-1] - joints[0]) / np.linalg.norm(joints[-1] - joints[0])
        self.draws = Draws(count, robot, settings.randomise, of_task)
        self.insertion = None if insertion is None else insertion * self.length
        self._robots = [robot] * count
        self._scenes: list[Scene | None] = [settings.scene] * count
        self._touches = in_scenes or settings.scene is not None
        ranges = [*robot.command_ranges, *([] if self.insertion is None else [(0.0, self.insertion)])]
        self._low, self._high = np.ascontiguousarray(np.asarray(ranges).T)
        self._change = settings.rate * (self._high - self._low)
        self._middle: Floats = np.concatenate([robot.mean_command, np.zeros(len(ranges) - robot.tendons)])
        self.commands: Floats = np.tile(self._middle, (count, 1))
        self.changes: Floats = np.zeros_like(self.commands)
        self.steps: NDArray[np.int64] = np.zeros(count, dtype=np.int64)
        # Actions of the last steps, the newest first.
        self._late: Floats = np.zeros((count, 0, len(ranges)))
        self.simulation = self._simulate()
        self.layout, bounds = _layout(robot, settings, self.insertion is not None)
        self.width = len(bounds)
        self.high: Observed = np.asarray(bounds, dtype=np.float32)
        self.low: Observed = -self.high
        self._whole = settings.observation == "state"
        self._clouds: NDArray[np.float32] | None = None

    def _simulate(self) -> _tdcr.BatchSimulation:
        settings = self.settings
        scenes = [(nothing() if scene is None else scene)._native for scene in self._scenes]
        return _tdcr.BatchSimulation(
            [robot._native for robot in self._robots],
            settings.timestep if settings.dynamics else None,
            settings.frame_skip,
            tuple(self.origin.tolist()),
            self.length,
            scenes if self._touches else None,
            None if self.insertion is None else (0.0, self.insertion),
        )

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "simulation": self.simulation.state()}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        """Robots that go on, to the last bit, where the old ones were."""
        self.__dict__.update(saved)
        self.simulation = self._simulate()
        self.simulation.restore(saved["simulation"])

    @property
    def tendons(self) -> int:
        """Number of tendons."""
        return self.robot.tendons

    @property
    def entries(self) -> int:
        """Entries of an action: of the tendons, and of a base that moves."""
        return len(self._low)

    @property
    def payloads(self) -> Floats:
        """Payload of each row (kg), shape (count,)."""
        return self.draws.values["payload"]

    def randomise(self, rows: Sequence[int], rngs: Sequence[np.random.Generator]) -> None:
        """Draws parameters for some rows, which must then be settled; the draws of a row are of its generator alone."""
        for row, rng in zip(rows, rngs, strict=True):
            if values := self.draws.draw(row, rng):
                self._robots[row] = self.robot.with_values(values)
                self.simulation.set_robot(row, self._robots[row]._native)

    def surround(self, row: int, scene: Scene) -> None:
        """Puts the obstacles of a scene around a row, in place of those of before. It must then be settled."""
        self._scenes[row] = scene
        self.simulation.set_scene(row, scene._native)

    def scene_of(self, row: int) -> Scene | None:
        """The obstacles around a row."""
        return self._scenes[row]

    def robot_of(self, row: int) -> Robot:
        """The robot of a row, with the parameters that were drawn for it."""
        return self._robots[row]

    def draw_command(self, rng: np.random.Generator) -> Floats:
        """A command, uniform in the box of the tendons' ranges."""
        command: Floats = self._low + (self._high - self._low) * rng.random(self.entries)
        return command

    def clip(self, commands: Floats) -> Floats:
        """Commands within the tendons' ranges, in place."""
        np.maximum(commands, self._low, out=commands)
        np.minimum(commands, self._high, out=commands)
        return commands

    def settle_anywhere(self, rows: Sequence[int], rngs: Sequence[np.random.Generator]) -> None:
        """Lets some rows settle under random commands, with nothing left of what was before.

        Raises:
            NotSettledError: If a robot settles under none of many commands.
        """
        pending = list(zip(rows, rngs, strict=True))
        for _ in range(_ATTEMPTS):
            commands = np.stack([self.draw_command(rng) for _, rng in pending])
            failed = self.settle([row for row, _ in pending], commands)
            pending = [pair for pair, bad in zip(pending, failed, strict=True) if bad]
            if not pending:
                return
        raise NotSettledError(
            f"robot {self.robot.name!r} settles under none of {_ATTEMPTS} random commands; expected one that does: look at "
            "its file, or at the ranges of `randomise`"
        )

    def settle(self, rows: list[int], commands: Floats) -> Bools:
        """Lets some rows settle under commands, with nothing left of what was before; returns which of them failed."""
        self._clouds = None
        self.commands[rows] = commands
        return self.simulation.reset(rows, commands, self.payloads[rows])

    def settle_in_the_middle(self, rows: Sequence[int], redraw: Callable[[list[int]], None] | None = None) -> None:
        """Lets some rows settle in the middle of their tendons' ranges, their bases where their files have them.

        Args:
            rows: The rows.
            redraw: Draws anew what is around those that do not settle, which are then tried again.

        Raises:
            NotSettledError: If one does not.
        """
        rows = list(rows)
        for _ in range(_ATTEMPTS if redraw else 1):
            failed = self.settle(rows, np.tile(self._middle, (len(rows), 1)))
            rows = [row for row, bad in zip(rows, failed, strict=True) if bad]
            if not rows:
                return
            if redraw:
                redraw(rows)
        raise NotSettledError(f"robot {self.robot.name!r} does not settle in the middle of its tendons' ranges")

    def begin(self, rows: Sequence[int]) -> None:
        """Is called where episodes of some rows begin, after robots have settled where they start."""
        rows = list(rows)
        self.steps[rows] = 0
        self.changes[rows] = 0.0
        longest = self.draws.longest_delay
        if self._late.shape[1] < longest:
            more = np.zeros((self.count, longest - self._late.shape[1], self.entries))
            self._late = np.concatenate([self._late, more], axis=1)
        # Until an action arrives commands stay what they are.
        staying = 0.0 if self.settings.action == "increment" else self._shares()[rows][:, None]
        self._late[rows] = staying

    def drive(self, actions: Any) -> Bools:
        """Advances all rows by actions, shape (count, entries); returns which have failed."""
        commands = self._driven(actions)
        failed = self.simulation.advance(commands, None, self.draws.forces(self.steps))
        self.changes = (commands - self.commands) / np.where(self._change > 0.0, self._change, 1.0)
        self.commands, self._clouds = commands, None
        self.steps += 1
        return failed

    def _driven(self, actions: Any) -> Floats:
        """The commands that actions, shape (count, entries), lead to."""
        actions = np.asarray(actions, dtype=np.float64)
        if actions.shape != self.commands.shape:
            raise InputError(f"the actions have shape {actions.shape}; expected {self.commands.shape}")
        actions = self._delayed(np.minimum(np.maximum(actions, -1.0), 1.0))
        if self.settings.action == "increment":
            commands = self._change * actions
        else:
            asked = self._low + 0.5 * (actions + 1.0) * (self._high - self._low)
            commands = np.minimum(np.maximum(asked - self.commands, -self._change), self._change)
        commands += self.commands
        return self.clip(commands)

    def _delayed(self, actions: Floats) -> Floats:
        """The actions that arrive now."""
        if not self._late.shape[1]:
            return actions
        past = np.concatenate([actions[:, None], self._late], axis=1)
        self._late = past[:, :-1].copy()
        arrived: Floats = past[np.arange(self.count), self.draws.values["delay"].astype(np.int64)]
        return arrived

    def observe(self, extra: int = 0) -> Observed:
        """A new array of observations, shape (count, width + extra); what is extra is not set."""
        observed: Observed = np.empty((self.count, self.width + extra), dtype=np.float32)
        if self.settings.observation != "cloud":
            self.simulation.observe(observed, self._whole, self.settings.observe_tensions)
            return observed
        observed[:, : self.entries] = self._shares()
        self._put_clouds(observed)
        return observed

    def _shares(self) -> Floats:
        """Commands as they are observed: -1 to 1 over their ranges."""
        span = np.where(self._high > self._low, self._high - self._low, 1.0)
        shares: Floats = 2.0 * (self.commands - self._low) / span - 1.0
        return shares

    def blur(self, observed: Observed) -> None:
        """Adds noise to what is measured of the rows, all but commands, in place."""
        measured = slice(self.entries, self.width)
        if self.draws.values["noise"].any():
            self.draws.add_noise(observed[:, measured], self.steps)
            np.clip(observed[:, measured], self.low[measured], self.high[measured], out=observed[:, measured])

    def _put_clouds(self, observed: Observed) -> None:
        places = self.scaled(self.clouds()).reshape(self.count, -1)
        observed[:, self.entries : self.width] = np.clip(places, -_LARGEST_PLACE, _LARGEST_PLACE)

    def scaled(self, positions: NDArray[Any]) -> NDArray[Any]:
        """Positions (m), last axis of 3, as they are observed: from the base, in lengths of the robot."""
        scaled: NDArray[Any] = (positions - self.origin) / self.length
        return scaled

    def unscaled(self, places: NDArray[Any]) -> Floats:
        """The inverse of :meth:`scaled`."""
        return np.asarray(places, dtype=np.float64) * self.length + self.origin

    def tips(self, observed: Observed) -> Observed:
        """Places of the tips, shape (count, 3), as they are observed; ``observed`` is what :meth:`observe` gave."""
        where = self.layout.get("tip")
        if where is not None:
            return observed[:, where]
        return self.scaled(self.simulation.positions()[:, -1]).astype(np.float32)

    def touch(self) -> dict[str, NDArray[Any]]:
        """What the robots touch in a scene, by name, as :class:`tdcr.envs.TendonRobotEnv` has it; nothing without a scene."""
        if not self._touches:
            return {}
        return dict(zip(("contacts", "contact_max", "contact_force", "disc_forces"), self.simulation.touch(), strict=True))

    def clouds(self, rows: list[int] | None = None) -> NDArray[np.float32]:
        """What the cameras see of some rows, or of all, shape (rows, points, 3) (m)."""
        if rows is not None:
            return self.simulation.clouds(rows, self.settings.points)
        if self._clouds is None:
            self._clouds = self.simulation.clouds(list(range(self.count)), self.settings.points)
        return self._clouds

    def picture(
        self, row: int, size: tuple[int, int], camera: int, targets: Floats, radius: float
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Colours and depth (m) of a picture of (width, height) by one of a row's cameras, with balls at ``targets`` (m)."""
        return self.simulation.render(row, size[0], size[1], camera, targets, radius)

    def close(self) -> None:
        """Lets go of what the world drives."""


def _driven_by_tension(robot: Robot, tension_range: tuple[float, float] | None) -> Robot:
    """The robot, or the same with all tendons driven by tensions of a range (N)."""
    if tension_range is None:
        return robot
    try:
        low, high = (as_number(end, "tension_range") for end in tension_range)
    except (TypeError, ValueError) as error:
        raise InputError(f"tension_range is {tension_range!r}; expected (low, high) (N): {error}") from None
    if not 0.0 <= low < high:
        raise InputError(f"tension_range is ({low}, {high}); expected 0 <= low < high (N)")

    def driven(part: Any) -> Any:
        if isinstance(part, list):
            return [driven(one) for one in part]
        if not isinstance(part, dict):
            return part
        if "drive" in part and "range" in part:
            return {**part, "drive": "tension", "range": [low, high]}
        return {name: driven(one) for name, one in part.items()}

    return Robot(driven(robot.to_dict()))


def _layout(robot: Robot, settings: Settings, moves_base: bool) -> tuple[dict[str, slice], list[float]]:
    """Where each quantity is in an observation, and the largest absolute value of each entry."""
    discs, moves = robot.discs, settings.dynamics
    parts = [("command", robot.tendons, 1.0)]
    parts += [("insertion", 1, 1.0)] if moves_base else []
    if settings.observation == "state":
        parts += [("positions", 3 * discs, _LARGEST_PLACE), ("quaternions", 4 * discs, 1.0)]
        parts += [("rates", 3 * discs, _LARGEST_RATE)] if moves else []
    elif settings.observation == "tip":
        parts += [("tip", 3, _LARGEST_PLACE), ("axis", 3, 1.0)]
        parts += [("velocity", 3, _LARGEST_VELOCITY)] if moves else []
    else:
        parts += [("cloud", 3 * settings.points, _LARGEST_PLACE)]
    parts += [("tensions", robot.tendons, _LARGEST_TENSION)] if settings.observe_tensions else []
    layout, bounds = {}, list[float]()
    for name, width, largest in parts:
        layout[name] = slice(len(bounds), len(bounds) + width)
        bounds += [largest] * width
    if "positions" in layout:
        end = layout["positions"].stop
        layout["tip"] = slice(end - 3, end)
    return layout, bounds

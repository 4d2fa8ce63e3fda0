"""The simulated robots of a batch of environments: how actions drive them, and what is seen of them."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from tdcr import _tdcr
from tdcr._arrays import Floats, as_count, as_number
from tdcr.errors import InputError, NotSettledError
from tdcr.robot import Robot
from tdcr.scene import Scene, as_scene

if TYPE_CHECKING:
    from tdcr.rig import Rig

Observed = NDArray[np.float32]
"""Observations, float32."""

Bools = NDArray[np.bool_]
"""Flags."""

OBSERVATIONS = ("state", "tip", "cloud")
_ATTEMPTS = 100
"""Commands that are drawn for a robot until one settles."""
_LARGEST_PLACE, _LARGEST_RATE, _LARGEST_VELOCITY = 2.0, 50.0, 20.0
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

    def __post_init__(self) -> None:
        if self.observation not in OBSERVATIONS:
            raise InputError(f"observation is {self.observation!r}; expected one of {', '.join(OBSERVATIONS)}")
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
        if self.contact_cost and self.scene is None:
            raise InputError(f"contact_cost is {self.contact_cost} without a scene; expected `scene`, or 0")

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
        payloads: Payload of each row (kg), shape (count,).
        layout: Where each quantity is in an observation, by name.
        low, high: Bounds of an observation.
    """

    def __init__(self, count: int, settings: Settings) -> None:
        self.count, self.settings = count, settings
        self.robot = robot = Robot(settings.robot)
        self.origin: Floats = np.asarray(robot.to_dict()["base"].get("position", [0.0] * 3), dtype=np.float64)
        joints = np.vstack([self.origin, robot.straight_positions])
        self.length = float(np.linalg.norm(np.diff(joints, axis=0), axis=1).sum())
        self.ranges = _ranges(robot, settings.randomise)
        self.payloads: Floats = np.zeros(count)
        self._robots = [robot] * count
        self._low, self._high = np.ascontiguousarray(robot.command_ranges.T)
        self._change = settings.rate * (self._high - self._low)
        self.commands: Floats = np.tile(robot.mean_command, (count, 1))
        self.simulation = self._simulate()
        self.layout, bounds = _layout(robot, settings)
        self.width = len(bounds)
        self.high: Observed = np.asarray(bounds, dtype=np.float32)
        self.low: Observed = -self.high
        self._whole = settings.observation == "state"
        self._clouds: NDArray[np.float32] | None = None

    def _simulate(self) -> _tdcr.BatchSimulation:
        settings = self.settings
        return _tdcr.BatchSimulation(
            [robot._native for robot in self._robots],
            settings.timestep if settings.dynamics else None,
            settings.frame_skip,
            tuple(self.origin.tolist()),
            self.length,
            None if settings.scene is None else settings.scene._native,
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
        """Number of tendons: entries of an action."""
        return self.robot.tendons

    def randomise(self, rows: Sequence[int], rngs: Sequence[np.random.Generator]) -> None:
        """Draws parameters for some rows, which must then be settled; the draws of a row are of its generator alone."""
        for row, rng in zip(rows, rngs, strict=True):
            values = {name: float(rng.uniform(low, high)) for name, (low, high) in self.ranges.items()}
            self.payloads[row] = values.pop("payload", 0.0)
            if values:
                self._robots[row] = self.robot.with_values(values)
                self.simulation.set_robot(row, self._robots[row]._native)

    def robot_of(self, row: int) -> Robot:
        """The robot of a row, with the parameters that were drawn for it."""
        return self._robots[row]

    def draw_command(self, rng: np.random.Generator) -> Floats:
        """A command, uniform in the box of the tendons' ranges."""
        command: Floats = self._low + (self._high - self._low) * rng.random(self.tendons)
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

    def begin(self) -> None:
        """Is called where episodes begin, after robots have settled where they start."""

    def drive(self, actions: Any) -> Bools:
        """Advances all rows by actions, shape (count, tendons); returns which have failed."""
        commands = self._driven(actions)
        failed = self.simulation.advance(commands)
        self.commands, self._clouds = commands, None
        return failed

    def _driven(self, actions: Any) -> Floats:
        """The commands that actions, shape (count, tendons), lead to."""
        actions = np.asarray(actions, dtype=np.float64)
        if actions.shape != self.commands.shape:
            raise InputError(f"the actions have shape {actions.shape}; expected {self.commands.shape}")
        commands = np.minimum(np.maximum(actions, -1.0), 1.0)
        commands *= self._change
        commands += self.commands
        return self.clip(commands)

    def observe(self, extra: int = 0) -> Observed:
        """A new array of observations, shape (count, width + extra); what is extra is not set."""
        observed: Observed = np.empty((self.count, self.width + extra), dtype=np.float32)
        if self.settings.observation != "cloud":
            self.simulation.observe(observed, self._whole)
            return observed
        observed[:, : self.tendons] = self._shares()
        self._put_clouds(observed)
        return observed

    def _shares(self) -> Floats:
        """Commands as they are observed: -1 to 1 over their ranges."""
        span = np.where(self._high > self._low, self._high - self._low, 1.0)
        shares: Floats = 2.0 * (self.commands - self._low) / span - 1.0
        return shares

    def _put_clouds(self, observed: Observed) -> None:
        places = self.scaled(self.clouds()).reshape(self.count, -1)
        observed[:, self.tendons : self.width] = np.clip(places, -_LARGEST_PLACE, _LARGEST_PLACE)

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
        if self.settings.scene is None:
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


def _ranges(robot: Robot, randomise: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    """Checked ranges of parameters: names that the robot has, and values that it can take."""
    ranges = {}
    for name, ends in randomise.items():
        try:
            low, high = (as_number(end, f"randomise[{name!r}]") for end in ends)
        except (TypeError, ValueError) as error:
            raise InputError(f"randomise[{name!r}] is {ends!r}; expected (low, high): {error}") from None
        if not low <= high:
            raise InputError(f"randomise[{name!r}] is ({low}, {high}); expected low <= high")
        least, _ = _tdcr.parameter_bounds(name)
        if low < least:
            raise InputError(f"randomise[{name!r}] is ({low}, {high}); expected values of {least:g} or more")
        if name != "payload":
            for end in (low, high):
                robot.with_values({name: end})
        ranges[name] = (low, high)
    robot.check_parameters([name for name in ranges if name != "payload"])
    return ranges


def _layout(robot: Robot, settings: Settings) -> tuple[dict[str, slice], list[float]]:
    """Where each quantity is in an observation, and the largest absolute value of each entry."""
    discs, moves = robot.discs, settings.dynamics
    parts = [("command", robot.tendons, 1.0)]
    if settings.observation == "state":
        parts += [("positions", 3 * discs, _LARGEST_PLACE), ("quaternions", 4 * discs, 1.0)]
        parts += [("rates", 3 * discs, _LARGEST_RATE)] if moves else []
    elif settings.observation == "tip":
        parts += [("tip", 3, _LARGEST_PLACE), ("axis", 3, 1.0)]
        parts += [("velocity", 3, _LARGEST_VELOCITY)] if moves else []
    else:
        parts += [("cloud", 3 * settings.points, _LARGEST_PLACE)]
    layout, bounds = {}, list[float]()
    for name, width, largest in parts:
        layout[name] = slice(len(bounds), len(bounds) + width)
        bounds += [largest] * width
    if "positions" in layout:
        end = layout["positions"].stop
        layout["tip"] = slice(end - 3, end)
    return layout, bounds

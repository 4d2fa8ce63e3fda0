"""A robot on a rig as the world of one environment: actions move servos, and cameras see what comes of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tdcr._arrays import Floats
from tdcr.envs.world import Bools, Observed, Settings, World
from tdcr.errors import InputError, RigError
from tdcr.rig import Measured, Rig
from tdcr.robot import Robot
from tdcr.statics import settle


class RigWorld(World):
    """One robot on a rig. Goals are drawn with the simulator; what is observed is measured.

    An episode starts in the home pose. An action that would leave the servos' limits, or under which the simulator finds a
    tendon slack or overloaded, moves nothing.

    Attributes:
        rig: The rig.
    """

    def __init__(self, count: int, settings: Settings, rig: Rig) -> None:
        if count != 1:
            raise InputError(f"num_envs is {count} with a rig; expected 1")
        if settings.dynamics or settings.randomise:
            raise InputError("`dynamics` and `randomise` are of simulated robots; expected neither with a rig")
        if settings.scene is not None:
            raise InputError("`scene` is of simulated robots; expected none with a rig")
        if settings.observe_tensions or settings.tension_range is not None:
            raise InputError("`observe_tensions` and `tension_range` are of simulated robots; expected neither with a rig")
        if settings.observation == "state":
            raise InputError("observation is 'state', which a rig does not see; expected 'tip' or 'cloud'")
        super().__init__(1, settings)
        self.rig = rig
        self._tension = rig.tension
        self._measured: Measured | None = None

    def __getstate__(self) -> dict[str, Any]:
        raise InputError("an environment on a rig cannot be copied or pickled, as there is one robot; expected a simulated one")

    def draw_command(self, rng: np.random.Generator) -> Floats:
        """A command that the rig's settings allow."""
        return self.rig.draw(int(rng.integers(2**63)))

    def begin(self, rows: Sequence[int]) -> None:
        """Brings the robot home."""
        self.rig.engage()
        self.rig.go_home()
        self._look()
        super().begin(rows)

    def drive(self, actions: Any) -> Bools:
        """Moves the robot by an action, shape (1, tendons), unless its tendons would not survive that."""
        before, commands = self.commands, self._driven(actions)
        if self._allowed(commands[0]):
            self.rig.move_to(commands[0])
        self._look()
        self.changes = (self.commands - before) / np.where(self._change > 0.0, self._change, 1.0)
        self.steps += 1
        return np.zeros(1, dtype=np.bool_)

    def observe(self, extra: int = 0) -> Observed:
        """A new array of observations, shape (1, width + extra); what is extra is not set."""
        measured = self._seen()
        observed: Observed = np.empty((1, self.width + extra), dtype=np.float32)
        observed[:, : self.tendons] = self._shares()
        if self.settings.observation == "cloud":
            self._put_clouds(observed)
            return observed
        observed[0, self.layout["tip"]] = np.clip(self.scaled(measured.tip), self.low[0], self.high[0])
        observed[0, self.layout["axis"]] = measured.axis
        return observed

    def tips(self, observed: Observed) -> Observed:
        """The place of the tip, shape (1, 3), as it is observed."""
        return self.scaled(self._seen().tip)[np.newaxis].astype(np.float32)

    def clouds(self, rows: list[int] | None = None) -> NDArray[np.float32]:
        """What the cameras see, shape (1, points, 3) (m)."""
        seen = self._seen().cloud.points
        # Spread over the whole cloud, with points again where there are too few.
        where = np.linspace(0, len(seen) - 1, self.settings.points).round().astype(np.int64)
        return seen[where][np.newaxis]

    def picture(
        self, row: int, size: tuple[int, int], camera: int, targets: Floats, radius: float
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Colours and depth (m) that a camera of the rig saw last, in its own size."""
        views = self._seen().pictures.views
        if camera >= len(views):
            raise InputError(f"camera {camera}; the rig has {len(views)}")
        return views[camera].color, views[camera].depth

    def close(self) -> None:
        """Takes the tension from the tendons."""
        self.rig.release()

    def _look(self) -> None:
        commanded = self.rig.commanded
        if commanded is None:
            raise RigError("the rig's motors are off; expected an environment that was reset, and no other user of the rig")
        self.commands = commanded[np.newaxis]
        self._measured = self.rig.measure()

    def _seen(self) -> Measured:
        if self._measured is None:
            raise InputError("the environment was not reset; expected a call of reset first")
        return self._measured

    def _allowed(self, command: Floats) -> bool:
        low, high = self._tension
        settled = settle(self.robot, command)
        held = bool(settled.converged and (settled.tensions >= low).all() and (settled.tensions <= high).all())
        return held and self.rig.within_limits(command)


def world(count: int, settings: Settings, of_task: Sequence[str], insertion: float | None, in_scenes: bool) -> World:
    """The world of environments: simulated, or a rig; :class:`World` has the arguments."""
    if settings.rig is None:
        return World(count, settings, of_task, insertion, in_scenes)
    if insertion is not None or in_scenes:
        raise InputError(
            "a rig's base and surroundings stay as they are; expected a task of reaching, without obstacles of its own"
        )
    rig = settings.rig if isinstance(settings.rig, Rig) else Rig(settings.rig)
    tendons = Robot(settings.robot).tendons
    if rig.robot.tendons != tendons:
        raise InputError(f"the rig has {rig.robot.tendons} tendons; expected {tendons}, as the environment's robot has")
    return RigWorld(count, settings.of_robot(rig.robot), rig)

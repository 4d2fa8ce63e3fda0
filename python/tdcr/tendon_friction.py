"""Paths of equilibria with friction between tendons and holes: what a robot does depends on where it came from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from tdcr import _tdcr
from tdcr._arrays import Floats, Progress, as_float, as_number, as_progress, as_rows
from tdcr._results import Result
from tdcr.contact import Contacts
from tdcr.loads import Loads, one_load
from tdcr.robot import RobotLike, as_robot
from tdcr.scene import Scene, as_scene
from tdcr.statics import Equilibria, Equilibrium


@dataclass(frozen=True, eq=False, repr=False)
class TendonProfile(Result):
    """One tendon from the servo to its fastened end, through ``h`` holes.

    Attributes:
        lengths: Of each segment, shape (h - 1,) (m).
        tensions: Of each segment, shape (h - 1,) (N).
        wrap_angles: At each interior hole, shape (h - 2,) (rad).
        deflections: Of the contact at each interior hole, positive when friction holds the tendon back from moving towards the
            servo, shape (h - 2,) (m).
        slip: Of each interior hole: ``"sticks"``, ``"to servo"`` or ``"to end"``.
    """

    lengths: Floats
    tensions: Floats
    wrap_angles: Floats
    deflections: Floats
    slip: tuple[str, ...]


def tendon_profiles(tendons: Sequence[_tdcr._Profile]) -> tuple[TendonProfile, ...]:
    """Profiles of numbers from the native module."""
    return tuple(TendonProfile(*tendon[:4], tuple(tendon[4])) for tendon in tendons)


@dataclass(frozen=True, eq=False, repr=False)
class FrictionState(Result):
    """Where a path has come to.

    Attributes:
        equilibrium: Where the robot rests; tensions are those at the servos.
        tendons: Each tendon along its route.
        dissipated: Energy turned into heat at the holes since the start (J).
        stored: Elastic energy in the sticking contacts (J).
        snapped: Energy lost in snaps since the start (J).
        servo_work: Work done on the tendons at their servos since the start (J).
        snaps: Snaps since the start: motions too fast for quasi-statics.
        substeps: Substeps since the last command.
    """

    equilibrium: Equilibrium
    tendons: tuple[TendonProfile, ...]
    dissipated: float
    stored: float
    snapped: float
    servo_work: float
    snaps: int
    substeps: int


class FrictionPath:
    """Leads a robot along a sequence of commands, with the friction of its file in its tendons' holes.

    Args:
        robot: The robot.
        resolution: Largest turn of a joint in one substep (rad).
        scene: What is around the robot: it touches that with the friction of each obstacle, and itself with that of
            ``Scene.with_self_contact``; states have its contacts (``state.equilibrium.contacts``).
    """

    def __init__(self, robot: RobotLike, resolution: float = 0.02, *, scene: Scene | None = None) -> None:
        self.robot = as_robot(robot)
        self.scene = None if scene is None else as_scene(scene)
        around = None if self.scene is None else self.scene._native
        self._native = _tdcr.FrictionPath(self.robot._native, as_number(resolution, "resolution"), around)

    def start(self, command: Any, loads: Loads | None = None, *, payload: Any = None) -> FrictionState:
        """Starts anew from the equilibrium without friction under a command, shape (tendons,) (m or N), with loads or a payload
        (kg)."""
        return self._state(*self._native.start(self._command(command), one_load(loads, payload)._native))

    def advance(self, command: Any, loads: Loads | None = None, *, payload: Any = None) -> FrictionState:
        """Goes on along the straight line to a command; the first time, starts there.

        Look at the ``converged`` of its equilibrium: where a command could not be reached, the state is the last on the way.
        """
        return self._state(*self._native.advance(self._command(command), one_load(loads, payload)._native))

    def follow(
        self, commands: Any, loads: Loads | None = None, progress: Progress | None = None, *, payload: Any = None
    ) -> list[FrictionState]:
        """Advances along rows of commands, shape (rows, tendons) (m or N)."""
        rows = as_rows(commands, "commands", self.robot.tendons, f"one for each tendon of robot {self.robot.name!r}")
        states, progress = [], as_progress(progress)
        for row in rows:
            states.append(self.advance(row, loads, payload=payload))
            if progress is not None:
                progress(1)
        return states

    def _command(self, command: Any) -> Floats:
        return as_float(command, "command", (self.robot.tendons,))

    def _state(
        self,
        equilibrium: _tdcr.EquilibriumRows,
        tendons: Sequence[_tdcr._Profile],
        account: tuple[float, float, float, float, int, int],
        touched: _tdcr.ContactRows | None,
    ) -> FrictionState:
        profiles = tendon_profiles(tendons)
        found = Equilibria._of(equilibrium)[0]
        if self.scene is not None and touched is not None:
            found = replace(found, contacts=Contacts._of_one(touched, self.scene))
        return FrictionState(found, profiles, *account)

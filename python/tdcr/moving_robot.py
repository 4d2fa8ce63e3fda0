"""One robot in motion, step by step."""

from __future__ import annotations

from typing import Any

from tdcr import _tdcr
from tdcr._arrays import Floats, as_count, as_float, as_number
from tdcr.contact import Contacts
from tdcr.dynamics import Integrator, State, native_steps, one_state
from tdcr.errors import ContactError
from tdcr.loads import Loads, one_load
from tdcr.objects import Objects, object_states
from tdcr.robot import RobotLike, as_robot
from tdcr.scene import Scene, as_scene
from tdcr.tendon_friction import TendonProfile, tendon_profiles


class MovingRobot:
    """A robot in motion, step by step. It can be copied and pickled, state and all. With objects a copy goes on as the first but
    for rapier's tolerance: the impulses from which its search begins are not kept.

    What is read of it are copies: they stay as they are when the robot moves on.

    Friction of tendons in their holes, if the robot's file has it, acts in motion by the law of :class:`tdcr.FrictionPath`, whose
    states slow motions come to.

    Args:
        robot: The robot, of ``n`` discs and ``t`` tendons, or what :class:`tdcr.Robot` makes one of.
        dt: Time step (s). One that is too long for the robot is refused by the first :meth:`step`, or by :meth:`reset`.
        integrator: How a step is taken.
        frame_skip: Time steps for which a command holds.
        scene: Obstacles around the robot, which have friction, and how its discs touch each other. Those with a mass move: they
            are :attr:`objects`. The integrator is one of the two of first order.
    """

    def __init__(
        self,
        robot: RobotLike,
        dt: float = 0.002,
        integrator: Integrator = "semi-implicit-euler",
        frame_skip: int = 1,
        scene: Scene | None = None,
    ) -> None:
        self.robot = robot = as_robot(robot)
        self.dt, self.integrator = as_number(dt, "dt"), integrator
        self.frame_skip = as_count(frame_skip, "frame_skip", 1)
        self.scene = None if scene is None else as_scene(scene)
        native_scene = None if self.scene is None else self.scene._native
        self._native = _tdcr.MovingRobot(robot._native, native_steps(dt, integrator, frame_skip), native_scene)
        self.start_at(State.straight(robot))

    def reset(self, command: Any, loads: Loads | None = None, *, payload: Any = None) -> None:
        """Starts anew at rest in the equilibrium of a command, shape (t,) (m or N), whatever was before. Objects are where the
        scene has them, and held there while the robot settles.

        Args:
            command: One entry for each tendon.
            loads: Loads, or none.
            payload: Point mass on the last disc (kg), in place of ``loads``.

        Raises:
            NotSettledError: If the robot does not settle.
            DynamicsError: If the time step is too long for the robot: small motions about the equilibrium would grow.
        """
        self._native.reset(self._take(command), one_load(loads, payload)._native)

    def start_at(self, state: State, command: Any = None) -> None:
        """Starts anew in a state, objects where the scene has them and servos come to ``command``. Until the next step, tensions
        are those under ``command``; under the mean one if it is not given."""
        configuration, velocity = one_state(self.robot, state)
        self._native.start_at(configuration, velocity, self._take(self.robot.mean_command if command is None else command))

    def step(self, command: Any, loads: Loads | None = None, *, payload: Any = None, frame_skip: int | None = None) -> None:
        """Moves on under a command, shape (t,) (m or N), for ``frame_skip`` time steps. Loads as of :meth:`reset`.

        Raises:
            DynamicsError: If the motion diverges: the state is then the last one that was computed. Also, by the first step from
                a start, if the time step is too long for the robot: small motions about the start would grow.
        """
        skip = self.frame_skip if frame_skip is None else as_count(frame_skip, "frame_skip", 1)
        self._native.step(self._take(command), one_load(loads, payload)._native, skip)

    @property
    def time(self) -> float:
        """Time since the start (s)."""
        return self._native.time

    @property
    def state(self) -> State:
        """Configuration and velocity."""
        return State(self.configuration, self.velocity)

    @property
    def positions(self) -> Floats:
        """Origin of each disc, shape (n, 3), world frame (m)."""
        return self._native.positions

    @property
    def tip(self) -> Floats:
        """Origin of the last disc, shape (3,), world frame (m)."""
        tip: Floats = self.positions[-1]
        return tip

    @property
    def quaternions(self) -> Floats:
        """Orientation (w, x, y, z) of each disc, shape (n, 4), world frame."""
        return self._native.quaternions

    @property
    def configuration(self) -> Floats:
        """Rotation (w, x, y, z) of each disc relative to the body below, shape (n, 4)."""
        return self._native.configuration

    @property
    def velocity(self) -> Floats:
        """Rates of the joints in the discs' own frames, shape (n, 3) (rad/s)."""
        return self._native.velocity

    @property
    def lengths(self) -> Floats:
        """Length of each tendon, shape (t,) (m)."""
        return self._native.lengths

    @property
    def tensions(self) -> Floats:
        """Tension of each tendon, shape (t,), positive when it pulls (N). Where a length is commanded of an inextensible tendon,
        that of the last time step; 0 before the first from a state."""
        return self._native.tensions

    @property
    def acting(self) -> Floats:
        """The command that acts on the tendons, shape (t,) (m or N): the last one given, unless the robot file has servos with a
        lag or a largest rate, which follow it late."""
        return self._native.acting

    @property
    def tendons(self) -> tuple[TendonProfile, ...]:
        """Each tendon along its route after the last time step, with what friction does in its holes; none of a robot whose file
        has no friction. From a start on no contact in a hole is loaded."""
        return tendon_profiles(self._native.tendon_profiles())

    @property
    def dissipated(self) -> float:
        """Energy that friction has turned into heat in the tendons' holes since the start (J), or since the robot was copied."""
        return self._native.dissipated

    @property
    def contacts(self) -> Contacts | None:
        """What the robot touched in the last time step, in a scene; None without one. Forces are means over the time step and act
        at its begin; gaps are those at its end. After a reset, what it touches at rest."""
        return None if self.scene is None else Contacts._of_one(self._native.contacts(), self.scene)

    @property
    def objects(self) -> Objects | None:
        """Where the scene's objects are and how they move; None without a scene, and empty where no obstacle has a mass."""
        return None if self.scene is None else Objects._of(self.scene.objects, self._native.objects())

    def place_objects(self, objects: Objects) -> None:
        """Places the objects where they were when :attr:`objects` was read, of a robot in the same scene. The robot stays.

        Raises:
            InputError: For objects of another scene, or in states that none can have.
            ContactError: For objects that have a part of the robot inside.
        """
        before = self.objects
        self._place(objects)
        try:
            self._native.check_outside()
        except ContactError:
            self._place(before)
            raise

    def _place(self, objects: Objects | None) -> None:
        names = () if self.scene is None else self.scene.objects
        self._native.place_objects(object_states(objects, names))

    def _take(self, command: Any) -> Floats:
        return as_float(command, "command", (self.robot.tendons,))

    def __getstate__(self) -> dict[str, Any]:
        return {
            "arguments": (self.robot, self.dt, self.integrator, self.frame_skip, self.scene),
            "state": (self.configuration, self.velocity, self.acting),
            "clock": self._native.clock,
            "deflections": [tendon.deflections.tolist() for tendon in self.tendons],
            "objects": self.objects,
        }

    def __setstate__(self, saved: dict[str, Any]) -> None:
        self.__init__(*saved["arguments"])  # type: ignore[misc]
        configuration, velocity, command = saved["state"]
        self._native.resume_at(configuration, velocity, self._take(command), saved["clock"])
        if deflections := saved.get("deflections"):
            self._native.set_deflections(deflections)
        if (objects := saved.get("objects")) is not None and len(objects):
            self._place(objects)

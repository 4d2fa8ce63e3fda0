"""From targets to commands (:func:`shape`), and from measured positions to a robot's parameters (:func:`calibrate`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from tdcr import _tdcr
from tdcr._arrays import (
    Floats,
    as_count,
    as_float,
    as_floats,
    as_list,
    as_number,
    as_place,
    as_several,
    as_text,
    as_texts,
    maybe_number,
)
from tdcr._dictionary import as_table, in_its_words
from tdcr._results import Result
from tdcr.contact import Contacts
from tdcr.data import PathLike
from tdcr.errors import InputError
from tdcr.loads import Loads, one_load
from tdcr.robot import Robot, RobotLike, as_robot
from tdcr.scene import Scene, as_scene, nothing
from tdcr.statics import Equilibria, Equilibrium, Rows


@dataclass(frozen=True, eq=False, repr=False)
class Target(Result):
    """Where or how a disc should be, in the world frame: exactly one of position, direction and orientation.

    Attributes:
        disc: The disc, from 0 at the base; ``-1`` is the last.
        position: Its origin there (m).
        direction: Its z axis, along the backbone, in this direction (x, y, z).
        orientation: Turned so (w, x, y, z).
        lever: What an error of one radian counts as (m).
        weight: Of its squared error among those of the other targets.
    """

    disc: int = -1
    position: Any = None
    direction: Any = None
    orientation: Any = None
    lever: float = 0.1
    weight: float = 1.0

    def _native(self, robot: Robot) -> tuple[int, str, list[float], float, float]:
        disc = as_place(self.disc, "disc of a target", robot.discs)
        goals = {"position": self.position, "direction": self.direction, "orientation": self.orientation}
        given = {kind: goal for kind, goal in goals.items() if goal is not None}
        if len(given) != 1:
            raise InputError(f"a target has {sorted(given) or 'nothing'}; expected exactly one of {sorted(goals)}")
        ((kind, goal),) = given.items()
        numbers = as_float(goal, f"{kind} of a target", (4 if kind == "orientation" else 3,))
        if kind != "position" and not numbers.any():
            raise InputError(f"the {kind} of a target is 0; expected {'a rotation' if len(numbers) == 4 else 'a direction'}")
        return disc, kind, numbers.tolist(), as_number(self.lever, "lever"), as_number(self.weight, "weight")


@dataclass(frozen=True, eq=False, repr=False)
class Press(Result):
    """A normal force with which a robot presses on an obstacle.

    While the robot does not touch the obstacle, its distance from there adds to the error.

    Attributes:
        obstacle: The obstacle's name, or its number in the scene: a fixed one.
        force: The force (N), above 0.
        disc: The disc that presses, from 0 at the base; ``-1`` is the last. None for the sum over all.
        lever: What an error of one newton counts as (m).
        weight: Of its squared error among those of targets.
    """

    obstacle: str | int
    force: float
    disc: int | None = None
    lever: float = 0.1
    weight: float = 1.0

    def _native(self, robot: Robot, scene: Scene) -> tuple[int, int | None, float, float, float]:
        disc = None if self.disc is None else as_place(self.disc, "disc of a press", robot.discs)
        numbers = (as_number(self.force, "force"), as_number(self.lever, "lever"), as_number(self.weight, "weight"))
        return scene.find(self.obstacle), disc, *numbers


@dataclass(frozen=True, eq=False, repr=False)
class ShapeSolution(Result):
    """The best command found.

    Attributes:
        command: Within the tendons' ranges, shape (tendons,) (m or N).
        equilibrium: Where the robot settles under it; in a scene with its contacts.
        errors: Distance left to each target (m).
        outcome: ``"reached"``; ``"unreachable"``, where nothing near the command comes nearer; ``"too near"``, where no command
            was found that keeps the clearance asked for; ``"stalled"`` otherwise.
        active: Tendons that a bound keeps from coming nearer, each with ``"low"`` or ``"high"``.
        gap: The most that the distance could still fall by, were it linear (m).
        steps: Steps tried.
        forces: Normal force of each :class:`Press` asked for (N).
        obstacles: Obstacles that keep the robot away by the clearance asked for, by name, each with the disc and by how many
            metres the distance would fall for each metre less of clearance.
        nearest: The nearest obstacle of those that a clearance is asked for from, by name, with the disc and their gap (m).
    """

    command: Floats
    equilibrium: Equilibrium
    errors: Floats
    outcome: str
    active: tuple[tuple[int, str], ...]
    gap: float
    steps: int
    forces: Floats
    obstacles: tuple[tuple[str, int, float], ...]
    nearest: tuple[str, int, float] | None


@dataclass(frozen=True, eq=False, repr=False)
class PathPoint(Result):
    """One point of a path of targets.

    Attributes:
        solution: The command, as near to the last one as can be.
        arrival: ``"first"``; ``"followed"``, along one branch without a jump; ``"switched"``, by a jump to another branch.
        via: Commands on the way from the last point, shape (k, tendons).
        command_change: Largest change of a command's entry (m or N).
        disc_change: Largest way of a disc (m).
    """

    solution: ShapeSolution
    arrival: str
    via: Floats
    command_change: float
    disc_change: float


class ShapeController:
    """Finds commands for targets of one robot; settles its samples once for any number of targets.

    Args:
        robot: The robot, or what :class:`tdcr.Robot` makes one of.
        loads: Loads on it.
        tolerance: Largest error of a target that counts as met (m).
        samples: Commands drawn to find starts among.
        seed: Seed of these draws.
        starts: Starts at most.
        max_steps: Steps of one descent at most.
        scene: Obstacles around the robot, which settles among them: solutions have its contacts.

    Raises:
        ContactError: In a scene, for a straight robot inside an obstacle, and for loads that are moments or turn with their disc.
    """

    def __init__(
        self,
        robot: RobotLike,
        loads: Loads | None = None,
        *,
        tolerance: float = 1e-6,
        samples: int = 255,
        seed: int = 0,
        starts: int = 12,
        max_steps: int = 300,
        scene: Scene | None = None,
    ) -> None:
        self.robot = as_robot(robot)
        self.scene = nothing() if scene is None else as_scene(scene)
        self._native = _tdcr.ShapeController(
            self.robot._native,
            self.scene._native,
            one_load(loads)._native,
            as_number(tolerance, "tolerance"),
            as_count(samples, "samples", 0, 10**7),
            as_count(seed, "seed", 0, 2**64 - 1),
            as_count(starts, "starts", 1, 10**7),
            as_count(max_steps, "max_steps", 1, 10**9),
        )

    def reach(
        self,
        targets: Target | Sequence[Target] = (),
        *,
        press: Press | Sequence[Press] = (),
        clearance: float | None = None,
    ) -> ShapeSolution:
        """The command under which the robot comes nearest to the targets, and presses on obstacles or keeps clear of them.

        Args:
            targets: Targets for its discs. None are needed where it presses.
            press: Forces on obstacles, whose errors are added to those of the targets.
            clearance: Least distance of the robot's beads (m) from all obstacles that it is not to press on; at 0 it touches
                none. It is kept first: of the commands that keep it, the one is sought that comes nearest.

        Raises:
            InputError: For a target or a force that makes no sense, and for a clearance below 0 or without obstacles.
            SceneError: For a force on an obstacle that is not there.
        """
        presses = [one._native(self.robot, self.scene) for one in as_several(press, "press", Press)]
        distance = None if clearance is None else as_number(clearance, "clearance")
        return _solution(self._native.reach(self._targets(targets), presses, distance), self.scene)

    def path(self, start: Any = None) -> ShapePath:
        """A path of targets without jumps; from where the robot settles under the command ``start``, if that is given."""
        start = None if start is None else as_float(start, "start", (self.robot.tendons,))
        return ShapePath(self, self._native.path(start))

    def _targets(self, targets: Target | Sequence[Target]) -> list[tuple[int, str, list[float], float, float]]:
        several = as_several(targets, "targets", Target)
        return [target._native(self.robot) for target in several]


class ShapePath:
    """A path of targets that a robot is led along: made by :meth:`ShapeController.path`."""

    def __init__(self, controller: ShapeController, native: _tdcr.ShapePath) -> None:
        self._controller, self._native = controller, native

    def follow(self, targets: Target | Sequence[Target]) -> PathPoint:
        """The command for the path's next targets."""
        solution, arrival, via, command_change, disc_change = self._native.follow(self._controller._targets(targets))
        return PathPoint(_solution(solution, self._controller.scene), arrival, via, command_change, disc_change)


def shape(
    robot: RobotLike,
    targets: Target | Sequence[Target] = (),
    payload: Any = None,
    *,
    loads: Loads | None = None,
    press: Press | Sequence[Press] = (),
    clearance: float | None = None,
    **search: Any,
) -> ShapeSolution:
    """The command under which a robot comes nearest to targets: :class:`ShapeController` for one question.

    Args:
        robot: The robot, or what :class:`tdcr.Robot` makes one of.
        targets: Targets for its discs.
        payload: Mass hung from the last disc (kg).
        loads: Other loads, in place of the payload.
        press: Forces on obstacles of the ``scene``, as of :meth:`ShapeController.reach`.
        clearance: Least distance from them (m), as of :meth:`ShapeController.reach`.
        search: As of :class:`ShapeController`, the ``scene`` among them.
    """
    return ShapeController(robot, one_load(loads, payload), **search).reach(targets, press=press, clearance=clearance)


@dataclass(frozen=True)
class Finding:
    """What measurements say of an unknown.

    Attributes:
        name: Of the unknown.
        kind: ``"identified"``; ``"confounded"`` with others; ``"undetermined"``, lost in the errors of measurement; ``"no
            effect"``; ``"at bound"`` of what a robot can have, or of the bounds given.
        value: Its value, if it was found.
        standard_error: Of the value.
        interval: 95 % confidence interval.
        confounded_with: Names of the others.
        prior_only: Whether it is identified by its prior, of whose spread the measurements leave 70 % or more.
    """

    name: str
    kind: str
    value: float
    standard_error: float
    interval: tuple[float, float]
    confounded_with: tuple[str, ...]
    prior_only: bool = False


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Result):
    """A calibrated robot.

    Attributes:
        robot: The robot with the values found.
        findings: Of each unknown, in order.
        correlations: Of the estimates' errors, shape (unknowns, unknowns).
        noise: Standard deviation of the errors of measurement (m), as the residuals say.
        degrees_of_freedom: Measured coordinates and priors with a spread, less directions fitted.
        condition: Of the Jacobian with columns of length 1; from about 30 on, unknowns blur each other.
        state: ``"converged"``, ``"at bound"`` or ``"halted"``.
        residual_rms: Root mean square of the residuals (m).
        steps: Steps tried.
    """

    robot: Robot
    findings: tuple[Finding, ...]
    correlations: Floats
    noise: float
    degrees_of_freedom: int
    condition: float
    state: str
    residual_rms: float
    steps: int


def calibrate(
    robot: RobotLike,
    unknowns: Sequence[str] | Mapping[str, Sequence[str]],
    commands: Any,
    positions: Any,
    *,
    discs: Sequence[int] | None = None,
    payload: Any = None,
    wrench: Any = None,
    loads: Loads | Sequence[Loads] | None = None,
    priors: PathLike | Mapping[str, Mapping[str, Any]] | None = None,
    error: float | None = None,
) -> Calibration:
    """Finds the values of unknowns that explain measured positions best, by least squares.

    The guide is :doc:`/sim-to-real`.

    Args:
        robot: The robot with first values.
        unknowns: Names of parameters, or a dictionary from a name to the parameters that share one value: for example
            ``{"gain": [f"gain[{t}]" for t in range(6)]}``.
        commands: Shape (rows, tendons) (m or N).
        positions: Measured origins of discs, shape (rows, measured discs, 3), world frame (m); NaN where not measured.
        discs: Which discs were measured; the last one, or all, where that is clear from the shape.
        payload, wrench, loads: As of :func:`tdcr.settle_batch`.
        priors: What is known of unknowns before the fit, by their names: a TOML file, or a dictionary from the name to ``spread``
            (standard deviation of a normal prior), ``value`` (its mean, and where the fit starts; as the robot has it where not
            given), ``bounds`` (lowest and highest value) and ``unit`` (which is compared), all in the unknown's unit.
        error: Standard deviation of the errors of a measured coordinate (m), which spreads are weighed against; where not given,
            and no prior has a spread, it is found from the residuals.

    Raises:
        InputError: For measurements that do not fit, a robot that does not settle with its first values, priors of nothing that
            is sought, and a spread without ``error``.
        ParameterError: For a parameter that the robot does not have.
    """
    robot = as_robot(robot)
    groups = _groups(unknowns)
    rows = Rows.of(robot, commands, payload, wrench, loads)
    measured = as_floats(positions, "positions")
    count = measured.shape[1] if measured.ndim == 3 else -1
    if discs is None:
        known = {1: [robot.discs - 1], robot.discs: list(range(robot.discs))}
        if count not in known:
            raise InputError(
                f"positions has shape {measured.shape}, and discs are not given; expected `discs`, which were measured"
            )
        discs = known[count]
    discs = as_list(discs, "discs")
    if measured.shape != (len(rows.commands), len(discs), 3):
        raise InputError(f"positions has shape {measured.shape}; expected {(len(rows.commands), len(discs), 3)}")
    chosen = [as_place(disc, "disc", robot.discs) for disc in discs]
    names = list(groups)
    text, believed = as_table(priors, "priors")
    size = maybe_number(error, "error")
    with in_its_words(text, "priors: "):
        fit = _tdcr.calibrate(list(groups.items()), rows.argument(), chosen, measured, believed, size)
    findings = tuple(
        Finding(name, kind, value, deviation, (low, high), tuple(names[k] for k in others), prior_only)
        for name, (kind, value, deviation, (low, high), others, prior_only) in zip(names, fit.findings, strict=True)
    )
    return Calibration(
        Robot._of(fit.robot),
        findings,
        fit.correlations,
        fit.noise,
        fit.degrees_of_freedom,
        fit.condition,
        fit.state,
        fit.residual_rms,
        fit.steps,
    )


def _groups(unknowns: Any) -> dict[str, list[str]]:
    """Unknowns by their names, each with the parameters that share its value."""
    if isinstance(unknowns, Mapping):
        return {as_text(name, "a name in unknowns"): as_texts(group, f"unknowns[{name!r}]") for name, group in unknowns.items()}
    return {name: [name] for name in as_texts(unknowns, "unknowns")}


def _solution(found: _tdcr._Solution, scene: Scene) -> ShapeSolution:
    command, rows, errors, outcome, active, gap, steps, touched, forces, obstacles, nearest = found
    equilibrium = Equilibria._of(rows)[0]
    if touched is not None:
        equilibrium = replace(equilibrium, contacts=Contacts._of_one(touched, scene))

    def named(obstacle: int, disc: int, number: float) -> tuple[str, int, float]:
        return scene.names[obstacle], disc, number

    return ShapeSolution(
        command,
        equilibrium,
        errors,
        outcome,
        tuple(active),
        gap,
        steps,
        forces,
        tuple(named(*one) for one in obstacles),
        None if nearest is None else named(*nearest),
    )

"""Closed loop: a tip led along a path by a controller, on a simulated robot, a rig or a plant of one's own (:func:`track`)."""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from tdcr import _tdcr
from tdcr._arrays import Floats, as_count, as_float, as_floats, as_number, as_text
from tdcr._files import as_path
from tdcr._results import Result
from tdcr.data import PathLike
from tdcr.errors import DataError, InputError
from tdcr.rig import Rig
from tdcr.robot import Robot, RobotLike, as_robot
from tdcr.scene import Scene, as_scene, nothing


class Plant(Protocol):
    """What :func:`track` needs of a robot: any object with these three methods."""

    def period(self) -> float:
        """Time from one command to the next (s)."""
        ...

    def measure(self) -> Mapping[str, Any]:
        """What the sensors say now: ``"tip"``, the distal disc's origin (3 numbers, m, world frame), ``"cloud"``, points of the
        robot's surface without its base, shape (n, 3) (m), ``"tensions"`` (N) and ``"lengths"`` (m) of the tendons. Each may be
        missing, None or NaN where a sensor says nothing."""
        ...

    def command(self, command: Floats) -> None:
        """Commands the tendons, shape (tendons,) (m or N), and returns when a period has passed."""
        ...


@dataclass(frozen=True, eq=False, repr=False)
class Tracking(Result):
    """A run along a path, one row a period; those of the approach have times below 0.

    Attributes:
        times: From the path's start, shape (periods,) (s).
        targets: Where the tip was to be, shape (periods, 3) (m).
        tips: Where it was, shape (periods, 3) (m); NaN where that is not known.
        commands: Shape (periods, tendons) (m or N).
        tensions: As measured, shape (periods, tendons) (N); NaN where they were not.
        unknowns: Names of what was estimated.
        estimates: Their values, shape (periods, unknowns).
        deviations: Standard deviations of these.
        open_loop: Times (s) and errors (m) of the open loop on the same robot, shape (periods, 2); None of a plant of one's own.
        summary: What ``tdcr track --json`` prints: ``rms_error`` (m), ``rms_error_percent`` of the length,
            ``trials`` (m, of each), ``rms_error_open_loop`` (m), ``unidentified``, ``incidents``, ``stopped`` and more.
    """

    times: Floats
    targets: Floats
    tips: Floats
    commands: Floats
    tensions: Floats
    unknowns: tuple[str, ...]
    estimates: Floats
    deviations: Floats
    open_loop: Floats | None
    summary: dict[str, Any]


def track(
    robot: RobotLike,
    path: Any,
    *,
    plant: Plant | Rig | None = None,
    controller: str = "resolved-rate",
    diameter: float = 0.06,
    duration: float = 20.0,
    centre: Any = None,
    period: float | None = None,
    approach: float = 4.0,
    rate: float | None = None,
    tension: Any = None,
    truth: RobotLike | None = None,
    scene: Scene | None = None,
    truth_scene: Scene | None = None,
    payload: float = 0.0,
    friction: float = 0.0,
    backlash: float = 0.0,
    gain_error: float = 0.0,
    delay: float = 0.0,
    noise: float | str = 0.0,
    tension_noise: float | None = None,
    timestep: float | None = None,
    start: Any = None,
    trials: int = 1,
    seed: int = 0,
    report: PathLike | None = None,
) -> Tracking:
    """Leads a robot's tip along a path by a controller; as ``tdcr track``. The guide is :doc:`/control`.

    Args:
        robot: The robot, as the controller models it.
        path: ``"circle"``, ``"eight"``, ``"square"``, ``"lissajous"``, or rows of t, x, y, z, shape (n, 4) (s, m, world frame).
        plant: A robot of one's own, or a :class:`Rig`, whose robot is ``robot``: it moves within the rig's limits, is seen by its
            cameras, and its tension is released at the end. Without one it is simulated, and differs from the model as the
            arguments from ``truth`` on say; those are for simulated robots only, but for ``payload`` of a simulated rig.
        controller: ``"inverse"`` (open loop), ``"resolved-rate"``, ``"mpc"``, or ``"moving-mpc"`` for a robot that swings.
        diameter: Width of a curve that is named (m).
        duration: Time in which it is run through (s).
        centre: Its centre, shape (3,) (m); where the robot reaches it unless given.
        period: Time between commands (s), 0.05 unless given; of a rig 0.1, to the nearest multiple of its ``motion.period``; a
            plant of one's own has its own.
        approach: Time before the path in which the tip is led to its first point (s).
        rate: Largest change of a command in a second (m/s or N/s); half of each tendon's range unless given.
        tension: Smallest and largest tension that commands may lead to, shape (2,) (N).
        truth: The simulated robot; ``robot`` unless given.
        scene: Obstacles around the robot, in the controller's model and in truth. The model of ``moving-mpc`` has none, of which
            it warns. With a rig they are in the model alone; where
            none are given, the model has those of the rig's own ``[scene]``.
        truth_scene: Obstacles around the simulated robot in place of ``scene``, which the model has.
        payload: Mass hung from its tip that the controller does not know of (kg).
        friction: Coefficient of friction of its tendons in their holes.
        backlash: Play between each servo and its tendon, its whole width (m or N).
        gain_error: Share by which each spool pulls too much or too little, by a sign drawn for each.
        delay: Time from a command to when the tendons get it (s).
        noise: Standard deviation of the tip's measured coordinates (m); or ``"d435"``: only clouds are measured, of the cameras
            of the robot's file, which are D435s.
        tension_noise: Standard deviation of measured tensions (N), 0 unless given; beside ``"d435"`` they are not measured then.
        timestep: Time step of a robot in motion (s); without it the robot is always at rest.
        start: What the tendons of ``plant`` are commanded now, shape (tendons,); the model's command for the path's first point
            unless given.
        trials: Trials of the path, one after another: each corrects the path that the controller is given by the errors of the
            last one. The last trial is returned.
        seed: Seed of noise, of the signs of ``gain_error``, and of the search for the first command.
        report: An HTML page to write: error, path, commands, tensions, estimated payload.

    Raises:
        InputError: For paths, plants and numbers that are none; what a plant raises is raised again.
        RigError: Where something goes wrong with a rig; its tension is released then.
        DataError: For a page that cannot be written.
    """
    model = as_robot(robot)
    page = None if report is None else as_path(report, "report")
    way = _path(model, path, centre, as_number(diameter, "diameter"), as_number(duration, "duration"))
    named = as_text(controller, "controller")
    number = as_count(seed, "seed", 0, 2**64 - 1)
    settings = (
        None if period is None else _positive(period, "period"),
        _not_negative(approach, "approach"),
        None if rate is None else as_number(rate, "rate"),
        None if tension is None else as_float(tension, "tension", (2,)).tolist(),
        as_count(trials, "trials", 1, 1000),
    )
    known = (nothing() if scene is None else as_scene(scene))._native
    if scene is not None and controller == "moving-mpc":
        warnings.warn("the model of moving-mpc has no obstacles: those of scene are around the robot alone", stacklevel=2)
    differs = {
        "payload": payload,
        "friction": friction,
        "backlash": backlash,
        "gain_error": gain_error,
        "delay": delay,
        "noise": 0.0 if isinstance(noise, str) else noise,
        "tension_noise": 0.0 if tension_noise is None else tension_noise,
    }
    numbers = {name: _not_negative(value, name) for name, value in differs.items()}
    seen = as_text(noise, "noise") if isinstance(noise, str) else repr(numbers["noise"])
    step = None if timestep is None else _positive(timestep, "timestep")
    if isinstance(plant, Rig):
        given = {"truth": truth, "truth_scene": truth_scene, "timestep": step, "start": start}
        _simulated_only(numbers, {"payload"}, seen, given)
        around = None if scene is None else known
        text, rows, html = _tdcr.track_rig(plant._native, around, way, numbers["payload"], named, settings, number)
        _write(page, html)
        return _tracking(text, rows, None)
    if plant is not None:
        _simulated_only(numbers, set(), seen, {"truth": truth, "truth_scene": truth_scene, "timestep": step})
        return _on_plant(plant, model, known, way, start, named, settings, number, page)
    if start is not None:
        raise InputError("start is given without a plant: a simulated robot starts at the path's first point")
    true = model if truth is None else as_robot(truth)
    if true.tendons != model.tendons:
        raise InputError(f"truth has {true.tendons} tendons, and robot {model.tendons}; expected as many")
    text, rows, open_loop, html = _tdcr.track_simulated(
        model._native,
        true._native,
        known,
        known if truth_scene is None else as_scene(truth_scene)._native,
        way,
        named,
        settings,
        (
            numbers["payload"],
            numbers["friction"],
            numbers["backlash"],
            numbers["gain_error"],
            numbers["delay"],
            seen,
            None if tension_noise is None else numbers["tension_noise"],
            step,
        ),
        number,
    )
    _write(page, html)
    return _tracking(text, rows, open_loop)


def _simulated_only(numbers: dict[str, float], allowed: set[str], seen: str, others: dict[str, Any]) -> None:
    """Refuses what says how a simulated robot differs from its model, beside a plant that does so by itself."""
    given = [name for name, value in numbers.items() if value != 0.0 and name not in allowed]
    given += ["noise"] if seen == "d435" else []
    given += [name for name, value in others.items() if value is not None]
    if given:
        raise InputError(f"{', '.join(given)}: these are of simulated robots; leave them out beside plant")


def _on_plant(
    plant: Plant,
    model: Robot,
    scene: _tdcr.Scene,
    way: _tdcr.TipPathOf,
    start: Any,
    controller: str,
    settings: tuple[float | None, float, float | None, list[float] | None, int],
    seed: int,
    page: str | None,
) -> Tracking:
    for name in ("period", "measure", "command"):
        if not callable(getattr(plant, name, None)):
            raise InputError(f"plant is {plant!r}; expected an object with the methods period, measure and command")
    first = None if start is None else as_float(start, "start", (model.tendons,))
    text, rows, html = _tdcr.track_plant(plant, model._native, scene, way, first, controller, settings, seed)
    _write(page, html)
    return _tracking(text, rows, None)


def _path(robot: Robot, path: Any, centre: Any, diameter: float, duration: float) -> _tdcr.TipPathOf:
    if isinstance(path, str):
        middle = None if centre is None else as_float(centre, "centre", (3,)).tolist()
        return _tdcr.TipPathOf.curve(robot._native, path, middle, diameter, duration)
    rows = as_floats(path, "path")
    if rows.ndim != 2 or rows.shape[1] != 4:
        raise InputError(f"path has shape {rows.shape}; expected rows of t, x, y, z, or the name of a curve")
    return _tdcr.TipPathOf.rows(rows)


def _positive(value: Any, name: str) -> float:
    number = as_number(value, name)
    if number <= 0.0:
        raise InputError(f"{name} is {number}; expected a number above 0")
    return number


def _not_negative(value: Any, name: str) -> float:
    number = as_number(value, name)
    if number < 0.0:
        raise InputError(f"{name} is {number}; expected a number, 0 or above")
    return number


def _write(page: str | None, html: str) -> None:
    if page is None:
        return
    try:
        Path(page).write_text(html, encoding="utf-8")
    except OSError as error:
        raise DataError(f"cannot write {page}: {error.strerror}") from error


def _tracking(text: str, rows: tuple[Floats, ...], open_loop: Floats | None) -> Tracking:
    times, targets, tips, commands, tensions, estimates, deviations = rows
    summary: dict[str, Any] = json.loads(text)
    return Tracking(
        times=times,
        targets=targets,
        tips=tips,
        commands=commands,
        tensions=tensions,
        unknowns=tuple(found["name"] for found in summary["estimated"]),
        estimates=estimates,
        deviations=deviations,
        open_loop=open_loop,
        summary=summary,
    )

"""tdcr as a solver of cosseratbench: one rod that hangs from, or is clamped at, its start.

An element of length ``h`` has its joint in the middle, of stiffness ``E I / h`` and ``G J / h``; a pinned rod has a joint that
turns freely at its start besides. The chain keeps its length, and has neither shear nor contact. Quasi-static scenarios are
solved for their equilibrium; motions are stepped by the implicit midpoint rule, which keeps a linear motion's energy.
"""

from __future__ import annotations

import json
import math
from importlib.metadata import version
from itertools import pairwise
from typing import Any

import numpy as np
from cosseratbench.solver import Diverged
from cosseratbench.trajectory import Trajectory
from numpy.typing import NDArray

import tdcr

Floats = NDArray[np.float64]

STEP = 2e-3
"""Longest time step (s)."""


class Tdcr:
    """A solver of cosseratbench.

    Args:
        time_step_scale: Multiplies the time step.
    """

    name = "tdcr"
    capabilities: frozenset[Any] = frozenset()
    backend_version = version("tdcr")

    def __init__(self, time_step_scale: float = 1.0) -> None:
        self.time_step_scale = float(time_step_scale)

    def settings(self, scenario: Any, *, n_elements: int, n_frames: int) -> dict[str, Any]:
        """The numerical choices for a run, as JSON values."""
        if scenario.quasi_static:
            return {"method": "equilibrium by Newton's method"}
        return {"integrator": "implicit-midpoint", "time_step": self._steps(scenario, n_frames)[1]}

    def run(self, scenario: Any, *, n_elements: int, n_frames: int) -> Trajectory:
        """Simulates ``scenario`` with ``n_elements`` elements.

        Raises:
            NotImplementedError: For what the chain does not model: a second rod, an end that is held or driven, contact.
            Diverged: Where the robot does not settle, or the motion diverges.
        """
        rod = _only_rod(scenario)
        nodes, directors = rod.nodes(n_elements), rod.directors(n_elements)
        pinned = rod.start.value == "pinned"
        base = _frames(nodes, directors)[0]
        robot = tdcr.Robot.from_json(json.dumps(_robot(rod, scenario.gravity, n_elements, base, nodes[0])))
        x, y, z = np.sum([load.force for load in rod.loads], axis=0) if rod.loads else np.zeros(3)
        loads = tdcr.Loads(wrenches=(tdcr.Wrench(robot.discs - 1, force=(float(x), float(y), float(z))),))
        times = np.linspace(0.0, scenario.duration, n_frames)
        start = _state(nodes, directors, pinned)
        if scenario.quasi_static:
            found = tdcr.Settler(robot).settle_from(start.configuration, [], loads)
            if not found.converged:
                raise Diverged(f"no equilibrium: a residual of {found.residual:.1e} N m is left")
            # Where it is at rest, from the second frame on.
            positions = np.repeat(found.positions[None], n_frames - 1, axis=0)
            turns = np.repeat(found.quaternions[None], n_frames - 1, axis=0)
        else:
            substeps, dt = self._steps(scenario, n_frames)
            try:
                motion = tdcr.simulate(
                    robot,
                    np.zeros((n_frames - 1, 0)),
                    loads=loads,
                    start=start,
                    dt=dt,
                    frame_skip=substeps,
                    integrator="implicit-midpoint",
                )
            except tdcr.TdcrError as error:
                raise Diverged(str(error)) from error
            positions, turns = motion.positions, motion.quaternions
        # A pinned rod has one body more, from the pin to the first joint, which ends within the first element.
        bodies = slice(1, None) if pinned else slice(0, None)
        moved = np.concatenate([np.broadcast_to(nodes[0], (n_frames - 1, 1, 3)), positions[:, bodies]], axis=1)
        first = turns[:, :1] if pinned else np.broadcast_to(_quaternion(base), (n_frames - 1, 1, 4))
        axes = _x_axes(np.concatenate([first, turns[:, bodies]], axis=1))
        later = _across(np.diff(moved, axis=1), axes[:, :-1] + axes[:, 1:])
        return Trajectory(times, (np.concatenate([nodes[None], moved]),), (np.concatenate([directors[None], later]),))

    def _steps(self, scenario: Any, n_frames: int) -> tuple[int, float]:
        """Steps for each frame, and their length (s)."""
        frame = scenario.duration / (n_frames - 1)
        steps = max(1, math.ceil(frame / (STEP * self.time_step_scale)))
        return steps, frame / steps


def _only_rod(scenario: Any) -> Any:
    """The rod of a scenario that a chain can stand for."""
    if len(scenario.rods) != 1:
        raise NotImplementedError(f"the scenario has {len(scenario.rods)} rods; tdcr moves one")
    rod = scenario.rods[0]
    if scenario.obstacles or scenario.self_contact:
        raise NotImplementedError("contact of the rod; this adapter has none")
    if rod.start.value == "free" or rod.end.value != "free":
        raise NotImplementedError(f"the rod's start is {rod.start.value}, its end {rod.end.value}; tdcr holds the start alone")
    if rod.start_motion is not None:
        raise NotImplementedError("the rod's start is driven; tdcr holds it still")
    if any(load.at.value != "end" for load in rod.loads):
        raise NotImplementedError("a load acts at the start, which is held")
    return rod


def _robot(rod: Any, gravity: Any, n: int, base: Floats, origin: Floats) -> dict[str, Any]:
    """The robot file of a rod of ``n`` elements."""
    h, material = rod.length / n, rod.material
    line, section = material.density * rod.area, rod.radius**2 / 4.0
    bend = material.youngs_modulus * rod.second_moment_of_area / h
    twist = 2.0 * material.shear_modulus * rod.second_moment_of_area / h

    def body(length: float, centre: float) -> dict[str, Any]:
        mass = line * length
        across = mass * (length**2 / 12.0 + section)
        return {"rigid": {"mass": mass, "inertia": [across, across, 2.0 * mass * section], "centre_of_mass": centre}}

    def module(discs: int, offset: float, joint: float, mass: Any, elastic: bool) -> dict[str, Any]:
        shape = {"discs": discs, "first_offset": offset, "pitch": h, "joint_below": joint, "holes": []}
        joints = {"backbone": {"bending": [bend, bend], "torsion": twist}} if elastic else {}
        return shape | joints | {"mass": mass, "radius": rod.radius, "half_height": h / 4.0, "damping": 0.0, "armature": 0.0}

    free = rod.start.value == "pinned"
    # From the pin to the first joint; then an element's length about each disc, and half of one at the end.
    first = [module(1, h / 2.0, h / 2.0, body(h / 2.0, -h / 4.0), False)] if free else []
    inner = [module(1, h / 2.0 if free else h, h / 2.0, body(h, 0.0), True)] if n > 1 else []
    inner += [module(n - 2, h, h / 2.0, body(h, 0.0), True)] if n > 2 else []
    last = module(1, h if n > 1 or not free else h / 2.0, h / 2.0, body(h / 2.0, -h / 4.0), True)
    pose = {"position": origin.tolist(), "orientation": _quaternion(base).tolist(), "holes": [], "hole_height": 0.0}
    modules = [*first, *inner, last]
    return {"name": "rod", "gravity": [float(g) for g in gravity], "routing": "base", "base": pose, "modules": modules}


def _state(nodes: Floats, directors: Floats, pinned: bool) -> tdcr.State:
    """The chain along ``nodes``, at rest."""
    frames = _frames(nodes, directors)
    # Links lie along the rod at the nodes: from the first node's frame to each one's, by what lies before it.
    links = frames if not pinned else np.concatenate([frames[:1], frames])
    relative = [a.T @ b for a, b in pairwise(links)]
    return tdcr.State(np.array([_quaternion(turn) for turn in relative]))


def _frames(nodes: Floats, directors: Floats) -> Floats:
    """Frame of the cross-section at each node, shape (n + 1, 3, 3): z along the rod, x along the directors beside it."""
    elements = np.diff(nodes, axis=0)
    elements = elements / np.linalg.norm(elements, axis=1, keepdims=True)
    beside = [np.concatenate([a[:1], a[:-1] + a[1:], a[-1:]]) for a in (elements, directors)]
    z = beside[0] / np.linalg.norm(beside[0], axis=1, keepdims=True)
    x = _across(z, beside[1])
    return np.stack([x, np.cross(z, x), z], axis=-1)


def _across(along: Floats, directions: Floats) -> Floats:
    """The unit vectors of the parts of ``directions`` across ``along``."""
    along = along / np.linalg.norm(along, axis=-1, keepdims=True)
    across = directions - (directions * along).sum(-1, keepdims=True) * along
    unit: Floats = across / np.linalg.norm(across, axis=-1, keepdims=True)
    return unit


def _x_axes(q: Floats) -> Floats:
    """First axes of frames by their quaternions (w, x, y, z)."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    return np.stack([1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)], axis=-1)


def _quaternion(turn: Floats) -> Floats:
    """Quaternion (w, x, y, z) of a rotation matrix (Bar-Itzhack, 2000: an eigenvector)."""
    t = turn
    k = np.array(
        [
            [t[0, 0] + t[1, 1] + t[2, 2], t[2, 1] - t[1, 2], t[0, 2] - t[2, 0], t[1, 0] - t[0, 1]],
            [t[2, 1] - t[1, 2], t[0, 0] - t[1, 1] - t[2, 2], t[1, 0] + t[0, 1], t[2, 0] + t[0, 2]],
            [t[0, 2] - t[2, 0], t[1, 0] + t[0, 1], t[1, 1] - t[0, 0] - t[2, 2], t[2, 1] + t[1, 2]],
            [t[1, 0] - t[0, 1], t[2, 0] + t[0, 2], t[2, 1] + t[1, 2], t[2, 2] - t[0, 0] - t[1, 1]],
        ]
    )
    q = np.asarray(np.linalg.eigh(k)[1][:, -1], dtype=np.float64)
    return q if q[0] >= 0.0 else np.negative(q)

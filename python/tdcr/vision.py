"""What cameras see of a robot: images (:func:`render`) and point clouds (:func:`cloud`)."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from tdcr import _tdcr
from tdcr._arrays import Floats, Progress, as_array, as_count, as_flag, as_number, as_quaternions, as_texts, maybe_text
from tdcr._files import as_path
from tdcr._results import Result
from tdcr.errors import InputError
from tdcr.loads import Loads
from tdcr.robot import Robot, RobotLike, as_robot
from tdcr.scene import Scene, as_scene


class Configured(Protocol):
    """Anything with a configuration: an equilibrium, a state of a motion."""

    @property
    def configuration(self) -> Floats:
        """Rotations (w, x, y, z) of the joints, shape (n, 4)."""


@dataclass(frozen=True, eq=False, repr=False)
class View(Result):
    """One picture of an RGB-D camera.

    Attributes:
        color: Shape (height, width, 3), 8-bit RGB, black on background.
        depth: Along the optical axis, shape (height, width) (m); 0 where there is none.
        mask: What each pixel shows, shape (height, width): 0 background, 1 base, 2 payload, 4 rod, 10,000 and more discs,
            20,000 and more tendons,
            40,000 and more obstacles of a scene.
        matrix: Camera matrix, shape (3, 3) (pixels).
        distortion: Coefficients k1, k2, p1, p2, k3 as OpenCV has them, shape (5,).
        position: Centre of projection, world frame, shape (3,) (m).
        quaternion: Orientation (w, x, y, z) of the camera's frame (x right, y down, z forward) in the world, shape (4,).
    """

    color: NDArray[np.uint8]
    depth: NDArray[np.float32]
    mask: NDArray[np.uint16]
    matrix: Floats
    distortion: Floats
    position: Floats
    quaternion: Floats


@dataclass(frozen=True, eq=False, repr=False)
class Cloud(Result):
    """Points of a robot's surface.

    Attributes:
        points: Shape (points, 3), world frame (m).
        colors: Shape (points, 3), 8-bit RGB.
    """

    points: NDArray[np.float32]
    colors: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.points)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the cloud as a PLY file."""
        _tdcr.save_ply(as_path(path, "path"), self.points, self.colors)


def render(
    robot: RobotLike,
    at: Configured | Any,
    *,
    base: bool = False,
    base_mesh: str | os.PathLike[str] | None = None,
    show: Sequence[Literal["payload", "tendons"]] = (),
    payload: float = 0.0,
    noise: Literal["d435"] | None = None,
    seed: int = 0,
    index: int = 0,
    scene: Scene | None = None,
) -> list[View]:
    """Pictures of a robot by its own cameras.

    Args:
        robot: The robot.
        at: An equilibrium, or another state with a configuration, or rotations (w, x, y, z) of the joints, shape (n, 4).
        base: Shows the robot's base.
        base_mesh: Shows a base of your own: an STL file in the frame of the robot's base (m).
        show: What to show besides the discs.
        payload: Mass of the payload that is shown (kg).
        noise: Simulates the faults of a real depth camera.
        seed: Seed of the faults.
        index: Number of the picture: pictures of one seed differ by it.
        scene: Obstacles that are shown, and hide what is behind them.
    """
    robot = as_robot(robot)
    if unknown := set(as_texts(show, "show")) - {"payload", "tendons"}:
        raise InputError(f"show has {sorted(unknown)}; expected 'payload' or 'tendons'")
    views = _tdcr.render(
        robot._native,
        _configuration(robot, at, "at"),
        Loads(payload=payload)._native,
        as_flag(base, "base"),
        None if base_mesh is None else as_path(base_mesh, "base_mesh"),
        "payload" in show,
        "tendons" in show,
        maybe_text(noise, "noise"),
        as_count(seed, "seed", 0, 2**64 - 1),
        as_count(index, "index"),
        None if scene is None else as_scene(scene)._native,
    )
    return [as_view(view) for view in views]


def cloud(
    robot: RobotLike,
    at: Configured | Any,
    *,
    base: bool = False,
    voxel: float = 0.002,
    noise: Literal["d435"] | None = None,
    seed: int = 0,
    index: int = 0,
    scene: Scene | None = None,
) -> Cloud:
    """The fused cloud of a robot, as its cameras see it: one point in each voxel.

    Args:
        robot: The robot.
        at: As of :func:`render`.
        base: Shows the robot's base.
        voxel: Edge of the voxels (m).
        noise: Simulates the faults of a real depth camera.
        seed: Seed of the faults.
        index: Number of the picture.
        scene: Obstacles that hide what is behind them. They are not in the cloud; the robot is where ``at`` says.
    """
    return clouds(robot, [at], base=base, voxel=voxel, noise=noise, seed=seed, first=index, scene=scene)[0]


def clouds(
    robot: RobotLike,
    at: Sequence[Configured | Any] | Any,
    *,
    base: bool = False,
    voxel: float = 0.002,
    noise: Literal["d435"] | None = None,
    seed: int = 0,
    first: int = 0,
    scene: Scene | None = None,
    progress: Progress | None = None,
) -> list[Cloud]:
    """Clouds of a robot in several configurations, on all threads: the ``k``-th is picture ``first + k``.

    Args:
        at: A sequence of what :func:`cloud` takes, or equilibria of a batch.
        robot, base, voxel, noise, seed, scene: As of :func:`cloud`.
        first: Number of the first picture.
        progress: Is called with the number of clouds done since its last call.
    """
    robot = as_robot(robot)
    several = at.configuration if hasattr(at, "configuration") else at
    if not isinstance(several, Iterable) or isinstance(several, str):
        raise InputError(f"at is {at!r}; expected a sequence of states, or equilibria of a batch")
    configurations = [_configuration(robot, one, f"at[{k}]") for k, one in enumerate(several)]
    seen = _tdcr.clouds(
        robot._native,
        configurations,
        as_flag(base, "base"),
        as_number(voxel, "voxel"),
        maybe_text(noise, "noise"),
        as_count(seed, "seed", 0, 2**64 - 1),
        as_count(first, "first"),
        None if scene is None else as_scene(scene)._native,
        progress,
    )
    return [Cloud(points, colors) for points, colors in seen]


def _configuration(robot: Robot, at: Any, name: str) -> Floats:
    rotations = at.configuration if hasattr(at, "configuration") else as_array(at, name)
    return as_quaternions(rotations, name, (robot.discs, 4))


def as_view(view: _tdcr.View) -> View:
    """A picture of the native module."""
    fx, fy, cx, cy = view.intrinsics
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    distortion = np.array(view.distortion)
    return View(view.color, view.depth, view.mask, matrix, distortion, view.position, view.quaternion)

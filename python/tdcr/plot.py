"""Figures: robots, clouds and workspaces on Matplotlib axes of your own.

Each function draws onto the axes that it is given, makes them to scale with units in their labels, and returns the artists, so
that everything can be changed afterwards::

    figure = plt.figure()
    ax = figure.add_subplot(projection="3d")
    tdcr.plot.robot(ax, robot, tdcr.settle(robot, command))

Matplotlib is an optional dependency: ``pip install ".[plot]"``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np

from tdcr._arrays import Floats, as_array, as_choice, as_float, as_number, as_quaternions
from tdcr._geometry import Geometry, rotate
from tdcr.errors import InputError, MissingPackageError
from tdcr.robot import Robot, RobotLike, as_robot

try:
    from matplotlib.animation import FuncAnimation
    from matplotlib.axes import Axes
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection  # type: ignore[import-untyped]
    from mpl_toolkits.mplot3d.axes3d import Axes3D  # type: ignore[import-untyped]
except ImportError as error:
    raise MissingPackageError("tdcr.plot needs Matplotlib, which is not installed: pip install matplotlib") from error

Unit = Literal["m", "mm"]
"""Unit of the axes."""

COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#F0E442", "#000000")
"""Eight colours that people with any colour vision can tell apart (Okabe and Ito 2008)."""

COLORMAP = "cividis"
"""Colours of values: as bright for any colour vision (Nuñez, Anderton and Renslow 2018)."""

_SCALES: dict[str, float] = {"m": 1.0, "mm": 1e3}

_RIM = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
"""Angles of the corners that a disc's rim is drawn with."""


_MOST_PICTURES = 100_000
"""Most pictures of an animation."""


class Posed(Protocol):
    """Anything with the poses of a robot's discs: an equilibrium, a robot in motion."""

    @property
    def positions(self) -> Floats:
        """Origin of each disc, shape (n, 3), world frame (m)."""

    @property
    def quaternions(self) -> Floats:
        """Orientation (w, x, y, z) of each disc, shape (n, 4), world frame."""


@dataclass(frozen=True)
class RobotArtists:
    """What :func:`robot` drew.

    Attributes:
        backbone: Line from the base through the origins of the discs (``Line3D``).
        discs: A round face for each disc (``Poly3DCollection``).
        tendons: A line for each tendon from hole to hole (``Line3DCollection``); ``None`` where they are not drawn.
    """

    backbone: Any
    discs: Any
    tendons: Any


def robot(
    ax: Axes3D,
    robot: RobotLike,
    at: Posed | tuple[Any, Any],
    *,
    color: Any = None,
    alpha: float = 0.35,
    tendons: bool = True,
    label: str | None = None,
    unit: Unit = "mm",
) -> RobotArtists:
    """Draws a robot: backbone, discs as circles, tendons from hole to hole.

    Args:
        ax: Axes with ``projection="3d"``.
        robot: The robot, of ``n`` discs.
        at: An equilibrium or another object with poses; or positions, shape (n, 3) (m), and quaternions (w, x, y, z), shape
            (n, 4), of the discs.
        color: Of all of it; a colour for each module where it is not given.
        alpha: Opacity of the discs.
        tendons: Whether tendons are drawn.
        label: In legends.
        unit: Of the axes.

    Raises:
        InputError: For axes that are flat, or poses that are not of one robot like this.
    """
    had_data = _had_data(ax)
    scale = _scale(unit)
    robot = as_robot(robot)
    positions, quaternions = at if isinstance(at, tuple) else (at.positions, at.quaternions)
    positions = as_float(positions, "positions", (robot.discs, 3))
    quaternions = as_quaternions(quaternions, "quaternions", (robot.discs, 4))
    body = _Body.of(robot, scale)
    colors = [color if color is not None else COLORS[module % len(COLORS)] for module in body.geometry.module]
    spine, rims, paths = body.at(positions, quaternions)

    discs = Poly3DCollection(rims, facecolors=colors, edgecolors=colors, linewidths=0.8, alpha=alpha)
    ax.add_collection3d(discs)
    spine_color = "0.15" if color is None else color
    (backbone,) = ax.plot(*spine.T, color=spine_color, linewidth=1.8, label=label)
    lines = None
    if tendons:
        lines = Line3DCollection(paths, colors=spine_color, linewidths=0.6)
        ax.add_collection3d(lines)
    _fit(ax, np.vstack([spine, rims.reshape(-1, 3), *(paths if tendons else [])]), unit, had_data)
    return RobotArtists(backbone, discs, lines)


_draw = robot
"""The same by another name, for functions whose argument ``robot`` is."""


@dataclass(frozen=True)
class _Body:
    """What is drawn of a robot, by its geometry and the number of units in a metre."""

    geometry: Geometry
    scale: float
    corners: Floats

    @classmethod
    def of(cls, robot: Robot, scale: float) -> _Body:
        geometry = Geometry.of(robot.to_dict())
        circle = np.stack([np.cos(_RIM), np.sin(_RIM), np.zeros_like(_RIM)], axis=1)
        return cls(geometry, scale, geometry.radius[:, np.newaxis, np.newaxis] * circle)

    def at(self, positions: Floats, quaternions: Floats) -> tuple[Floats, Floats, list[Floats]]:
        """Backbone, shape (n + 1, 3), rims of the discs, (n, corners, 3), and tendons of a pose, in the axes' unit."""
        scale, geometry = self.scale, self.geometry
        rims = scale * (positions[:, np.newaxis] + rotate(quaternions[:, np.newaxis], self.corners))
        paths = [scale * path for path in geometry.tendon_paths(positions, quaternions)]
        return scale * np.vstack([geometry.base, positions]), rims, paths

    def reach(self, positions: Floats, quaternions: Floats) -> Floats:
        """The corners of a box about a pose, shape (2, 3)."""
        spine, rims, _ = self.at(positions, quaternions)
        points = np.vstack([spine, rims.reshape(-1, 3)])
        return np.stack([points.min(axis=0), points.max(axis=0)])


class Moving(Protocol):
    """Anything with the poses of a robot's discs one after another: a motion, equilibria along a path."""

    @property
    def positions(self) -> Floats:
        """Origin of each disc, shape (frames, n, 3), world frame (m)."""

    @property
    def quaternions(self) -> Floats:
        """Orientation (w, x, y, z) of each disc, shape (frames, n, 4), world frame."""


def animate(
    ax: Axes3D,
    robot: RobotLike,
    along: Moving | tuple[Any, Any],
    *,
    times: Any = None,
    fps: float = 25.0,
    speed: float = 1.0,
    trace: bool = True,
    color: Any = None,
    alpha: float = 0.35,
    tendons: bool = True,
    unit: Unit = "mm",
) -> FuncAnimation:
    """Animates a robot: a motion in its own time, or a path pose by pose.

    Keep the result as long as it is to run. It is a file by ``.save("motion.gif")``, or ``.save("motion.mp4")`` where FFmpeg is
    installed; in a notebook it is shown by ``IPython.display.HTML(animation.to_jshtml())``. ::

        figure = plt.figure()
        ax = figure.add_subplot(projection="3d")
        motion = tdcr.simulate(robot, commands)
        tdcr.plot.animate(ax, robot, motion).save("motion.gif")

    Args:
        ax: Axes with ``projection="3d"``. They are fitted to all that the robot goes through.
        robot: The robot, of ``n`` discs, or what :class:`tdcr.Robot` makes one of.
        along: A motion, equilibria of a batch, or another object with poses; or positions, shape (T, n, 3) (m), and quaternions
            (w, x, y, z), shape (T, n, 4), of the discs.
        times: Time of each pose, shape (T,), rising (s); those of a motion where they are not given. Without times each pose is
            a picture.
        fps: Pictures of a second.
        speed: Seconds of the motion in a second of the animation.
        trace: Whether a line shows where the tip was.
        color, alpha, tendons: As of :func:`robot`.
        unit: Of the axes.

    Raises:
        InputError: For axes that are flat, and poses, times or rates that do not fit; a motion that failed has poses only up to
            its failure.
    """
    robot = as_robot(robot)
    positions, quaternions = along if isinstance(along, tuple) else (along.positions, along.quaternions)
    positions = as_float(positions, "positions", ("poses", robot.discs, 3))
    quaternions = as_quaternions(quaternions, "quaternions", (len(positions), robot.discs, 4))
    if len(positions) == 0:
        raise InputError("there are no poses; expected at least one")
    times = getattr(along, "times", None) if times is None else times
    shown, clock = _pictures(times, len(positions), _above_zero(fps, "fps"), _above_zero(speed, "speed"))

    # All places that anything gets to, so that the axes stand still.
    artists = _draw(ax, robot, (positions[shown[0]], quaternions[shown[0]]), color=color, alpha=alpha, tendons=tendons, unit=unit)
    body = _Body.of(robot, _scale(unit))
    _fit(ax, np.vstack([body.reach(positions[k], quaternions[k]) for k in shown]), unit, True)
    tips = body.scale * positions[:, -1]
    line = ax.plot(*tips[:1].T, color=COLORS[5], linewidth=1.2)[0] if trace else None

    def draw(picture: int) -> list[Any]:
        place = shown[picture]
        spine, rims, paths = body.at(positions[place], quaternions[place])
        artists.backbone.set_data_3d(*spine.T)
        artists.discs.set_verts(rims)
        if artists.tendons is not None:
            artists.tendons.set_segments(paths)
        if line is not None:
            line.set_data_3d(*tips[: place + 1].T)
        ax.set_title(f"t = {clock[place]:.2f} s" if clock is not None else f"pose {place + 1} of {len(positions)}")
        return [artists.backbone, artists.discs, artists.tendons, line, ax.title]

    draw(0)
    return FuncAnimation(ax.figure, draw, frames=len(shown), interval=1e3 / fps, repeat=True)


def _above_zero(value: Any, name: str) -> float:
    number = as_number(value, name)
    if not number > 0.0:
        raise InputError(f"{name} is {number}; expected a number above 0")
    return number


def _pictures(times: Any, poses: int, fps: float, speed: float) -> tuple[Any, Floats | None]:
    """Numbers of the poses that are shown one after another, and the time of each pose, if there are times."""
    if times is None:
        return np.arange(poses), None
    clock = as_float(times, "times", (poses,))
    if (np.diff(clock) <= 0.0).any():
        raise InputError("times do not rise; expected each later than the one before")
    count = max(1, int(np.ceil((clock[-1] - clock[0]) * fps / speed - 1e-9)) + 1)
    if count > _MOST_PICTURES:
        raise InputError(
            f"{count} pictures, of {clock[-1] - clock[0]:.3g} s at {fps:g} a second and speed {speed:g}; expected at most "
            f"{_MOST_PICTURES}"
        )
    wanted = np.minimum(clock[0] + np.arange(count) * speed / fps, clock[-1])
    # The pose whose time is the nearest.
    after = np.searchsorted(clock, wanted).clip(1, max(1, poses - 1)).clip(max=poses - 1)
    before = np.maximum(after - 1, 0)
    return np.where(clock[after] - wanted < wanted - clock[before], after, before), clock


def cloud(
    ax: Axes3D,
    cloud: Any,
    *,
    color: Any = None,
    values: Any = None,
    size: float = 1.0,
    label: str | None = None,
    unit: Unit = "mm",
) -> Any:
    """Draws a point cloud.

    Args:
        ax: Axes with ``projection="3d"``.
        cloud: A :class:`tdcr.Cloud`, a sample of a data set, or points, shape (points, 3), world frame (m).
        color: Of all points; the cloud's own colours where it is not given and the cloud has some.
        values: A number for each point, such as its error, shape (points,), shown by colour in its place: give the result to
            ``figure.colorbar``.
        size: Area of a point (points²).
        label: In legends.
        unit: Of the axes.

    Returns:
        The points (``Path3DCollection``). They are pixels in vector graphics, which stay small so.
    """
    had_data = _had_data(ax)
    points = as_float(getattr(cloud, "points", cloud), "cloud", ("points", 3)) * _scale(unit)
    colors = getattr(cloud, "colors", None)
    if values is None and color is None and colors is not None:
        color = as_array(colors, "colors") / 255.0
    look = _look(color, values, len(points))
    drawn = ax.scatter(*points.T, s=size, linewidths=0, depthshade=False, rasterized=True, label=label, **look)
    _fit(ax, points, unit, had_data)
    return drawn


def workspace(
    ax: Axes | Axes3D,
    tips: Any,
    *,
    plane: Literal["xy", "xz", "yz"] = "xz",
    color: Any = None,
    values: Any = None,
    size: float = 2.0,
    label: str | None = None,
    unit: Unit = "mm",
) -> Any:
    """Draws where a robot's tip gets to.

    Args:
        ax: Axes, flat or with ``projection="3d"``.
        tips: Equilibria of a batch, of which those that have not converged are left out; motions; or tips, shape (..., 3),
            world frame (m).
        plane: Axes of the world that flat axes show, to the right and up.
        color: Of all tips.
        values: A number for each tip, such as its payload, shown by colour; of the shape of the tips but for the last axis.
        size: Area of a tip (points²).
        label: In legends.
        unit: Of the axes.

    Returns:
        The tips (``PathCollection``, or ``Path3DCollection`` in space).
    """
    as_choice(plane, "plane", ("xy", "xz", "yz"))
    given = as_array(getattr(tips, "tips", tips), "tips")
    if given.ndim == 0:
        raise InputError("tips has shape (); expected (..., 3)")
    leading = given.shape[:-1]
    if hasattr(tips, "converged"):
        kept = tips.converged
    else:
        # Motions that failed are not numbers from there on.
        kept = np.isfinite(given).all(axis=-1) if hasattr(tips, "failures") else np.ones(leading, dtype=np.bool_)
    places = as_float(given[kept], "tips", ("tips", 3)) * _scale(unit)
    if values is not None:
        values = as_float(values, "values", leading)[kept]
    look = _look(color, values, len(places))
    if isinstance(ax, Axes3D):
        had_data = _had_data(ax)
        drawn = ax.scatter(*places.T, s=size, linewidths=0, rasterized=True, label=label, **look)
        _fit(ax, places, unit, had_data)
        return drawn
    across, up = ("xyz".index(axis) for axis in plane)
    flat = ax.scatter(places[:, across], places[:, up], s=size, linewidths=0, rasterized=True, label=label, **look)
    ax.set_xlabel(f"{plane[0]} ({unit})")
    ax.set_ylabel(f"{plane[1]} ({unit})")
    ax.set_aspect("equal")
    return flat


def _look(color: Any, values: Any, count: int) -> dict[str, Any]:
    """Colours of a scatter, by values if there are any."""
    if values is None:
        return {"c": COLORS[0] if color is None else color}
    if color is not None:
        raise InputError("color and values are both given; expected one of them")
    return {"c": as_float(values, "values", (count,)), "cmap": COLORMAP}


def _scale(unit: str) -> float:
    """Number of units in a metre."""
    if unit not in _SCALES:
        raise InputError(f"unit is {unit!r}; expected 'm' or 'mm'")
    return _SCALES[unit]


def _had_data(ax: Any) -> bool:
    """Whether there is something on axes, which have to be in space."""
    if not isinstance(ax, Axes3D):
        raise InputError(f'ax is {type(ax).__name__}; expected axes with projection="3d"')
    return bool(ax.has_data())


def _fit(ax: Axes3D, points: Floats, unit: Unit, had_data: bool) -> None:
    """Makes room for points, beside what was there before if there was anything; to scale, with labels."""
    ax.auto_scale_xyz(*points.T, had_data=had_data)
    limits = np.array([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()])
    spans = np.ptp(limits, axis=1)
    # A robot is slim: without room beside it, the labels of two axes would lie upon each other.
    missing = np.maximum(0.6 * np.max(spans) - spans, 0.0) / 2.0
    for extend, (low, high), more in zip((ax.set_xlim, ax.set_ylim, ax.set_zlim), limits, missing, strict=True):
        # `auto=None`: axes that fit themselves to what is drawn go on doing so.
        extend(low - more, high + more, auto=None)
    # To scale; a bit smaller than the axes, whose labels would not fit into many figures.
    ax.set_box_aspect(spans + 2.0 * missing, zoom=0.78)
    ax.locator_params(nbins=4)
    ax.set_xlabel(f"x ({unit})")
    ax.set_ylabel(f"y ({unit})")
    ax.set_zlabel(f"z ({unit})")

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

from tdcr._arrays import Floats, as_array, as_choice, as_float, as_quaternions
from tdcr._geometry import Geometry, rotate
from tdcr.errors import InputError, MissingPackageError
from tdcr.robot import Robot

try:
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
    robot: Robot,
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
    positions, quaternions = at if isinstance(at, tuple) else (at.positions, at.quaternions)
    positions = as_float(positions, "positions", (robot.discs, 3))
    quaternions = as_quaternions(quaternions, "quaternions", (robot.discs, 4))
    geometry = Geometry.of(robot)
    colors = [color if color is not None else COLORS[module % len(COLORS)] for module in geometry.module]

    circle = np.stack([np.cos(_RIM), np.sin(_RIM), np.zeros_like(_RIM)], axis=1)
    corners = geometry.radius[:, np.newaxis, np.newaxis] * circle
    rims = scale * (positions[:, np.newaxis] + rotate(quaternions[:, np.newaxis], corners))
    discs = Poly3DCollection(rims, facecolors=colors, edgecolors=colors, linewidths=0.8, alpha=alpha)
    ax.add_collection3d(discs)

    spine = scale * np.vstack([geometry.base, positions])
    spine_color = "0.15" if color is None else color
    (backbone,) = ax.plot(*spine.T, color=spine_color, linewidth=1.8, label=label)

    lines = None
    reach = [spine, rims.reshape(-1, 3)]
    if tendons:
        paths = [scale * path for path in geometry.tendon_paths(positions, quaternions)]
        lines = Line3DCollection(paths, colors=spine_color, linewidths=0.6)
        ax.add_collection3d(lines)
        reach += paths
    _fit(ax, np.vstack(reach), unit, had_data)
    return RobotArtists(backbone, discs, lines)


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

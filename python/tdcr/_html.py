"""What notebooks show of robots, equilibria and data sets: a small drawing beside a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from tdcr._arrays import Floats
from tdcr._geometry import Geometry, rotate

if TYPE_CHECKING:
    from tdcr.data import Dataset
    from tdcr.robot import Robot
    from tdcr.statics import Equilibrium

MODULES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
"""Colours of modules, which people with any colour vision can tell apart (Okabe and Ito 2008)."""

_HEIGHT = 220.0
"""Height of a drawing (px)."""
_MARGINS = (46.0, 10.0, 12.0, 38.0)
"""Space at the left, right, top and bottom for labels (px)."""
_POINTS = 1000
"""Points of a cloud that are drawn."""


@dataclass(frozen=True)
class Lines:
    """Lines, shapes (points, 3) (mm), of a colour and a width (px)."""

    paths: Sequence[Floats]
    color: str
    width: float = 1.0


@dataclass(frozen=True)
class Dots:
    """Points, shape (points, 3) (mm), each of a colour, with a radius (px)."""

    points: Floats
    colors: Sequence[str]
    radius: float = 1.5


def of_robot(robot: Robot) -> str:
    """A robot in the straight pose."""
    geometry, straight = Geometry.of(robot.to_dict()), robot.straight_positions
    quaternions = np.tile(geometry.base_quaternion, (robot.discs, 1))
    circle = np.linspace(0.0, 2.0 * np.pi, 25)
    rim = np.stack([np.cos(circle), np.sin(circle), np.zeros_like(circle)], axis=1)
    marks: list[Lines | Dots] = [Lines([1e3 * path for path in geometry.tendon_paths(straight, quaternions)], "#888888", 0.7)]
    for module in np.unique(geometry.module):
        discs = np.flatnonzero(geometry.module == module)
        rims = [1e3 * (straight[k] + rotate(quaternions[k], geometry.radius[k] * rim)) for k in discs]
        marks.append(Lines(rims, MODULES[module % len(MODULES)], 1.5))
    spine = np.vstack([geometry.base, straight])
    marks.append(Lines([1e3 * spine], "#222222", 1.5))
    length = np.linalg.norm(np.diff(spine, axis=0), axis=1).sum()
    rows = [
        ("Robot", robot.name),
        ("Modules", str(len(np.unique(geometry.module)))),
        ("Discs", str(robot.discs)),
        ("Tendons", str(robot.tendons)),
        ("Length", f"{1e3 * length:.1f} mm"),
        *_commands(robot),
    ]
    return _page("Straight pose", _drawing(marks), rows)


def of_equilibrium(settled: Equilibrium) -> str:
    """An equilibrium: the backbone through the origins of the discs."""
    places = 1e3 * settled.positions
    marks: list[Lines | Dots] = [Lines([places], MODULES[0], 2.0), Dots(places, ["#222222"] * len(places), 2.0)]
    tip = ", ".join(f"{x:.2f}" for x in places[-1])
    rows = [
        ("Settled", "yes" if settled.converged else "no"),
        ("Stability", settled.stability),
        ("Residual", f"{settled.residual:.1e} N m"),
        ("Newton steps", str(settled.iterations)),
        ("Tip (x, y, z)", f"({tip}) mm"),
        ("Tensions", _range(settled.tensions, "N")),
        ("Tendon lengths", _range(1e3 * settled.lengths, "mm")),
    ]
    return _page("Origins of the discs", _drawing(marks) if np.isfinite(places).all() else "", rows)


def of_data(data: Dataset) -> str:
    """A data set, with its first cloud."""
    name, split = next((name, data.split(name)) for name in ("train", "val", "test") if len(data.split(name)))
    sample = split[0]
    kept = np.linspace(0, len(sample.points) - 1, min(_POINTS, len(sample.points))).astype(int)
    colors = ["#" + bytes(color).hex() for color in sample.colors[kept]]
    marks = [Dots(1e3 * sample.points[kept].astype(np.float64), colors, 1.0)]
    rows = [
        ("Data set", data.path),
        ("Robot", "not known" if data.robot is None else data.robot.name),
        *((part, f"{len(data.split(part))} samples") for part in ("train", "val", "test")),
        ("Points of a cloud", str(data.points)),
    ]
    units = data.condition_units
    ranges = zip(data.normalisation.condition_min, data.normalisation.condition_max, units, strict=True)
    by_unit: dict[str | None, list[float]] = {}
    for low, high, unit in ranges:
        by_unit.setdefault(unit, []).extend((float(low), float(high)))
    names = {"m": "Commands", "N": "Commands", "kg": "Payload", None: "Conditions"}
    rows += [(names[unit], _range(np.array(ends), unit or "")) for unit, ends in by_unit.items()]
    return _page(f"Sample 0 of {name}", _drawing(marks), rows)


def _commands(robot: Robot) -> list[tuple[str, str]]:
    ranges = {}
    for unit in dict.fromkeys(robot.command_units):
        chosen = [k for k, other in enumerate(robot.command_units) if other == unit]
        ranges[unit] = _range(robot.command_ranges[chosen], unit)
    return [("Commands", text) for text in ranges.values()]


def _range(values: Any, unit: str) -> str:
    if np.size(values) == 0:
        return "none"
    low, high = np.min(values), np.max(values)
    return f"{low:.4g} to {high:.4g} {unit}".rstrip()


def _page(caption: str, drawing: str, rows: Sequence[tuple[str, str]]) -> str:
    cells = "".join(
        f'<tr><th style="text-align:left">{escape(name)}</th><td style="text-align:left">{escape(value)}</td></tr>'
        for name, value in rows
    )
    figure = f'<figure style="margin:0">{drawing}<figcaption>{escape(caption)}</figcaption></figure>' if drawing else ""
    return f'<div style="display:flex;gap:1.5em;align-items:flex-start;flex-wrap:wrap">{figure}<table>{cells}</table></div>'


def _drawing(marks: Sequence[Lines | Dots]) -> str:
    """Two views to scale as SVG: from the front (x to the right, z up) and from the side (y to the right)."""
    everything = np.vstack([p for mark in marks for p in (mark.paths if isinstance(mark, Lines) else [mark.points])])
    low, high = everything.min(axis=0), everything.max(axis=0)
    tall = max(float(high[2] - low[2]), 1e-6)
    pad = 0.04 * tall
    scale = (_HEIGHT - _MARGINS[2] - _MARGINS[3]) / (tall + 2.0 * pad)
    parts, left = [], 0.0
    for axis in (0, 1):
        # A straight robot is slim: some room beside it for the labels.
        middle, half = 0.5 * (low[axis] + high[axis]), max(0.5 * (high[axis] - low[axis]) + pad, 0.3 * tall)
        view = _View(axis, (middle - half, middle + half), (low[2] - pad, high[2] + pad), scale, left + _MARGINS[0])
        parts += [view.frame(), *(view.draw(mark) for mark in marks)]
        left += _MARGINS[0] + 2.0 * half * scale + _MARGINS[1]
    style = 'font-family="sans-serif" font-size="10" fill="#222222"'
    size = f'width="{left:.0f}" height="{_HEIGHT:.0f}" viewBox="0 0 {left:.0f} {_HEIGHT:.0f}"'
    ground = '<rect width="100%" height="100%" fill="#ffffff"/>'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} {style}>{ground}{"".join(parts)}</svg>'


@dataclass(frozen=True)
class _View:
    """A view along a horizontal axis of the world: limits (mm), pixels in a millimetre, and where it begins (px)."""

    axis: int
    across: tuple[float, float]
    up: tuple[float, float]
    scale: float
    left: float

    def pixels(self, points: Floats) -> Floats:
        x = self.left + (points[:, self.axis] - self.across[0]) * self.scale
        y = _MARGINS[2] + (self.up[1] - points[:, 2]) * self.scale
        return np.stack([x, y], axis=1)

    def draw(self, mark: Lines | Dots) -> str:
        if isinstance(mark, Dots):
            spots = zip(self.pixels(mark.points), mark.colors, strict=True)
            return "".join(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{mark.radius}" fill="{color}"/>' for (x, y), color in spots)
        paths = (" ".join(f"{x:.1f},{y:.1f}" for x, y in self.pixels(path)) for path in mark.paths)
        style = f'fill="none" stroke="{mark.color}" stroke-width="{mark.width}" stroke-linejoin="round"'
        return "".join(f'<polyline points="{path}" {style}/>' for path in paths)

    def frame(self) -> str:
        """Frame, ticks and names of the axes."""
        wide, tall = ((high - low) * self.scale for low, high in (self.across, self.up))
        top, bottom, name = _MARGINS[2], _MARGINS[2] + tall, "xy"[self.axis]
        parts = [
            f'<rect x="{self.left:.1f}" y="{top:.1f}" width="{wide:.1f}" height="{tall:.1f}" fill="none" stroke="#bbbbbb"/>',
            f'<text x="{self.left + wide / 2:.1f}" y="{bottom + 30:.1f}" text-anchor="middle">{name} (mm)</text>',
            f'<text transform="translate({self.left - 36:.1f},{top + tall / 2:.1f}) rotate(-90)" '
            'text-anchor="middle">z (mm)</text>',
        ]
        for value in _ticks(*self.across):
            x = self.left + (value - self.across[0]) * self.scale
            parts.append(f'<path d="M{x:.1f} {bottom:.1f}v4" stroke="#bbbbbb"/>')
            parts.append(f'<text x="{x:.1f}" y="{bottom + 16:.1f}" text-anchor="middle">{value:g}</text>')
        for value in _ticks(*self.up):
            y = top + (self.up[1] - value) * self.scale
            parts.append(f'<path d="M{self.left:.1f} {y:.1f}h-4" stroke="#bbbbbb"/>')
            parts.append(f'<text x="{self.left - 7:.1f}" y="{y + 3.5:.1f}" text-anchor="end">{value:g}</text>')
        return "".join(parts)


def _ticks(low: float, high: float) -> list[float]:
    """Round numbers between two ends, about four."""
    rough = (high - low) / 4.0
    power = 10.0 ** np.floor(np.log10(rough))
    step = next(power * factor for factor in (1.0, 2.0, 5.0, 10.0) if power * factor >= rough)
    first, last = int(np.ceil(low / step)), int(np.floor(high / step))
    return [round(number * step, 9) for number in range(first, last + 1)]

"""Where the discs' rims and the tendons' holes of a robot are: what drawings need, read from the fields of its file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tdcr._arrays import Floats

BASE = -1
"""Number of the base among the bodies; discs count from 0."""


@dataclass(frozen=True)
class Geometry:
    """Dimensions of a robot of ``n`` discs.

    Attributes:
        base: Origin of the base, shape (3,), world frame (m).
        base_quaternion: Orientation (w, x, y, z) of the base in the world.
        module: Module of each disc, shape (n,).
        radius: Radius of each disc, shape (n,) (m).
        routes: For each tendon the bodies that it passes, from the servo on, and the place of its hole in each body's frame,
            shapes (h,) and (h, 3) (m).
    """

    base: Floats
    base_quaternion: Floats
    module: Any
    radius: Floats
    routes: list[tuple[Any, Floats]]

    @classmethod
    def of(cls, fields: Mapping[str, Any]) -> Geometry:
        """Reads them from the fields of a robot's file, as :meth:`tdcr.Robot.to_dict` has them."""
        base, modules = fields["base"], fields["modules"]
        module = np.repeat(np.arange(len(modules)), [m["discs"] for m in modules])
        orientation = np.array(base.get("orientation", [1.0, 0.0, 0.0, 0.0]))
        holes = _Holes(base, modules, module, from_base=fields["routing"] == "base")
        return cls(
            np.array(base["position"]),
            # Normalised on use, as files have it.
            orientation / np.linalg.norm(orientation),
            module,
            np.array([modules[m]["radius"] for m in module]),
            [*holes.of_modules(), *(holes.of_route(route["through"]) for route in fields.get("routes", []))],
        )

    def tendon_paths(self, positions: Floats, quaternions: Floats) -> list[Floats]:
        """The holes of each tendon in the world, from the servo on, shapes (h, 3) (m), from the poses of the discs."""
        origins = np.vstack([self.base, positions])
        orientations = np.vstack([self.base_quaternion, quaternions])
        return [origins[bodies + 1] + rotate(orientations[bodies + 1], places) for bodies, places in self.routes]


@dataclass(frozen=True)
class _Holes:
    """Holes of all bodies. Those of a module are turned by its clocking, in every body that its tendons pass."""

    base: dict[str, Any]
    modules: list[dict[str, Any]]
    module: Any
    from_base: bool

    def of_modules(self) -> list[tuple[Any, Floats]]:
        """Routes of the modules' own tendons."""
        routes = []
        for index, module in enumerate(self.modules):
            if module.get("tendons") is None:
                continue
            discs = np.flatnonzero(self.module == index)
            first = BASE if self.from_base else discs[0] - 1
            bodies = np.arange(first, discs[-1] + 1)
            for hole in range(len(_pattern(module["holes"]))):
                places = [self._place(body, hole, module.get("clocking", 0.0)) for body in bodies]
                routes.append((bodies, np.array(places)))
        return routes

    def of_route(self, through: list[list[Any]]) -> tuple[Any, Floats]:
        """A tendon with a route of its own: a list of [body, number of the hole]."""
        bodies = [BASE if body == "base" else int(body) for body, _ in through]
        places = []
        for body, (_, number) in zip(bodies, through, strict=True):
            copy, hole = divmod(number, len(self._pattern_of(body)))
            places.append(self._place(body, hole, self._clockings(body)[copy]))
        return np.array(bodies), np.array(places)

    def _place(self, body: int, hole: int, clocking: float) -> list[float]:
        x, y = self._pattern_of(body)[hole]
        cos, sin = np.cos(clocking), np.sin(clocking)
        height = self.base["hole_height"] if body == BASE else 0.0
        return [cos * x - sin * y, sin * x + cos * y, height]

    def _pattern_of(self, body: int) -> Floats:
        return _pattern((self.base if body == BASE else self.modules[self.module[body]])["holes"])

    def _clockings(self, body: int) -> list[float]:
        """Angles by which the copies of a body's pattern are turned: its own first, then those of modules above (rad)."""
        own = None if body == BASE else int(self.module[body])
        above = 0 if own is None else own + 1
        passing = self.modules[above:] if self.from_base else self.modules[above : above + 1]
        angles = [0.0 if own is None else self.modules[own].get("clocking", 0.0)]
        return list(dict.fromkeys(angles + [module.get("clocking", 0.0) for module in passing]))


def _pattern(holes: Any) -> Floats:
    """Holes, shape (holes, 2) (m), from a list of them or a circle."""
    if isinstance(holes, dict):
        angles = np.array(holes["angles"])
        pattern: Floats = holes["radius"] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        return pattern
    return np.array(holes)


def rotate(quaternions: Floats, vectors: Floats) -> Floats:
    """Vectors, shape (..., 3), turned by unit quaternions (w, x, y, z), shape (..., 4)."""
    w, axis = quaternions[..., :1], quaternions[..., 1:]
    # q v q* = v + 2 w (a x v) + 2 a x (a x v), for q = (w, a).
    cross = np.cross(axis, vectors)
    turned: Floats = vectors + 2.0 * (w * cross + np.cross(axis, cross))
    return turned

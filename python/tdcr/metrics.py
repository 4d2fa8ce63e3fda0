"""Distances between clouds.

Clouds have the shape (N, 3), in metres; many pairs have the shape (B, N, 3) and are compared on all threads. They are compared as
float32, in which predictors and data sets have them, and computed in float64.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tdcr import _tdcr
from tdcr._arrays import Floats, Progress, as_array, as_count, as_flag, as_float
from tdcr._results import Result
from tdcr.errors import InputError


@dataclass(frozen=True, eq=False, repr=False)
class Emd(Result):
    """Matchings of two clouds of ``N`` points, and the proof of how near to optimal they are.

    Attributes:
        value: Mean distance (m), or mean squared distance (m²), of matched points; shape () of one pair, (B,) of many.
        gap: Duality gap, in the unit of ``value``, of its shape: no matching whatever is below ``value - gap``. Zero but for
            rounding where the matching is exact.
        matching: Index in the second cloud of the partner of each point of the first: a permutation, shape (N,) or (B, N).
    """

    value: Floats
    gap: Floats
    matching: NDArray[np.int64]

    def __float__(self) -> float:
        return float(self.value)


def chamfer(p: Any, q: Any, progress: Progress | None = None) -> Floats:
    """Chamfer distances (m²): ``1/|P| sum_p min_q |p - q|^2 + 1/|Q| sum_q min_p |q - p|^2`` (Fan, Su and Guibas, CVPR 2017,
    averaged over the points of each cloud).

    Args:
        p: Points (m), shape (N, 3) or (B, N, 3).
        q: Points (m), shape (M, 3) or (B, M, 3).
        progress: Is called with the number of pairs compared since its last call.

    Returns:
        Shape () for a pair, (B,) for many.

    Raises:
        InputError: For an empty cloud, and for points that are not finite.
    """
    first, second, single = _pairs(p, q)
    distances = _tdcr.chamfer_rows(first, second, progress=progress)
    return distances[0] if single else distances


def emd(p: Any, q: Any, *, squared: bool = False, progress: Progress | None = None) -> Emd:
    """Earth mover's distances, exactly: the least mean distance of any one-to-one matching of the points (Rubner, Tomasi and
    Guibas, IJCV 2000).

    Args:
        p: Points (m), shape (N, 3) or (B, N, 3).
        q: Points (m), of the same shape.
        squared: Whether squared distances are matched: the squared 2-Wasserstein distance (m²).
        progress: Is called with the number of pairs matched since its last call.

    Raises:
        InputError: For empty clouds, clouds of different sizes, and points that are not finite.
    """
    return _emd(p, q, squared, None, progress)


def emd_approximate(p: Any, q: Any, group: int, *, squared: bool = False, progress: Progress | None = None) -> Emd:
    """Earth mover's distances with a certified bound, many times faster than :func:`emd`.

    Groups of about ``group`` neighbours are matched exactly by their centroids, then their points among themselves. The least
    mean distance lies between ``value - gap`` and ``value``.

    Args:
        p: Points (m), shape (N, 3) or (B, N, 3).
        q: Points (m), of the same shape.
        group: Points in a group, at least 1: more is faster and less exact.
        squared: Whether squared distances are matched.
        progress: Is called with the number of pairs matched since its last call.

    Raises:
        InputError: As :func:`emd`.
    """
    return _emd(p, q, squared, as_count(group, "group", 1), progress)


def _emd(p: Any, q: Any, squared: bool, group: int | None, progress: Progress | None) -> Emd:
    first, second, single = _pairs(p, q)
    found = _tdcr.emd_rows(first, second, as_flag(squared, "squared"), group, progress=progress)
    return Emd(*(values[0] for values in found)) if single else Emd(*found)


def _pairs(p: Any, q: Any) -> tuple[NDArray[np.float32], NDArray[np.float32], bool]:
    """Pairs of clouds, and whether there is one alone."""
    axes = [as_array(cloud, name).ndim for cloud, name in ((p, "p"), (q, "q"))]
    if axes[0] != axes[1]:
        raise InputError(f"p has {axes[0]} axes and q has {axes[1]}; expected two clouds, or as many of each")
    first, second = (as_clouds(cloud, name) for cloud, name in ((p, "p"), (q, "q")))
    if len(first) != len(second):
        raise InputError(f"p has {len(first)} clouds and q has {len(second)}; expected as many")
    return first, second, axes[0] == 2


def as_clouds(clouds: Any, name: str) -> NDArray[np.float32]:
    """Clouds, shape (B, N, 3), of one or many."""
    array = as_array(clouds, name)
    shape = ("points", 3) if array.ndim == 2 else ("clouds", "points", 3)
    floats = as_float(array, name, shape).astype(np.float32)
    return floats if floats.ndim == 3 else floats[np.newaxis]

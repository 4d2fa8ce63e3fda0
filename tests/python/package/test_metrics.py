"""Distances between clouds from Python."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

import tdcr
from tdcr.errors import InputError
from tdcr.metrics import chamfer, emd, emd_approximate


@pytest.fixture(scope="module")
def clouds() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    return rng.normal(size=(3, 150, 3)).astype(np.float32), rng.normal(size=(3, 150, 3)).astype(np.float32)


def test_the_chamfer_distance_is_its_definition(clouds: tuple[np.ndarray, np.ndarray]) -> None:
    p, q = clouds[0], clouds[1][:, :70]
    found = chamfer(p, q)
    for row in range(3):
        squared = cdist(p[row], q[row]) ** 2
        expected = squared.min(1).mean() + squared.min(0).mean()
        assert found[row] == pytest.approx(expected, rel=1e-12)
        assert float(chamfer(p[row], q[row])) == found[row]
        assert float(chamfer(q[row].tolist(), p[row].astype(float))) == pytest.approx(found[row], rel=1e-12)


@pytest.mark.parametrize("squared", [False, True])
def test_the_earth_movers_distance_is_scipys(clouds: tuple[np.ndarray, np.ndarray], squared: bool) -> None:
    p, q = clouds
    found = emd(p, q, squared=squared)
    assert found.matching.shape == (3, 150)
    for row in range(3):
        cost = cdist(p[row], q[row]) ** (2 if squared else 1)
        rows, columns = linear_sum_assignment(cost)
        expected = cost[rows, columns].mean()
        assert found.value[row] == pytest.approx(expected, rel=1e-12)
        assert 0.0 <= found.gap[row] < 1e-10 * expected
        assert cost[np.arange(150), found.matching[row]].mean() == pytest.approx(expected, rel=1e-12)
        single = emd(p[row], q[row], squared=squared)
        assert float(single) == found.value[row]
        assert np.array_equal(single.matching, found.matching[row])


def test_an_approximate_matching_bounds_the_exact_one(clouds: tuple[np.ndarray, np.ndarray]) -> None:
    p, q = clouds
    exact = emd(p, q)
    for group in (1, 2, 8):
        found = emd_approximate(p, q, group)
        assert (found.value >= exact.value - 1e-12).all()
        assert (found.value - found.gap <= exact.value + 1e-12).all()
        assert all(sorted(matching) == list(range(150)) for matching in found.matching)
    single = emd_approximate(p[0], q[0], 1)
    assert float(single.gap) < 1e-12 and float(single) == pytest.approx(exact.value[0], rel=1e-12)


def test_progress_counts_pairs_and_may_stop(clouds: tuple[np.ndarray, np.ndarray]) -> None:
    done: list[int] = []
    emd(*clouds, progress=done.append)
    assert sum(done) == 3

    def stop(_: int) -> None:
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        emd(*clouds, progress=stop)


def test_clouds_that_cannot_be_compared_are_named(clouds: tuple[np.ndarray, np.ndarray]) -> None:
    p, q = clouds

    def refused(match: str, metric: Any, *arguments: Any) -> None:
        with pytest.raises(InputError, match=match):
            metric(*arguments)

    refused("p has 2 axes and q has 3", chamfer, p[0], q)
    refused("p has 3 clouds and q has 2", chamfer, p, q[:2])
    refused(r"q has shape \(150, 2\); expected \(points, 3\)", chamfer, p[0], q[0, :, :2])
    refused(r"p\[0\]\[4\]\[1\] is nan", emd, np.where(np.arange(1350).reshape(3, 150, 3) == 13, np.nan, p), q)
    refused("the clouds hold 150 and 149 points", emd, p[0], q[0, 1:])
    refused("row 0: the clouds hold 150 and 149 points", emd, p, q[:, 1:])
    refused("the second cloud is empty", chamfer, p[0], q[0, :0])
    refused("group is 0; expected 1", emd_approximate, p, q, 0)
    assert tdcr.metrics.chamfer(p[:0], q[:0]).shape == (0,)

"""The distances that the Rust tests of the metrics compare with are SciPy's, and those of POT (Python Optimal
Transport), whose network simplex shares nothing with SciPy's assignment."""

import importlib.util
import json
import pathlib

import numpy as np
import ot
import pytest
from scipy.spatial.distance import cdist

DATA = pathlib.Path(__file__).parents[2] / "learn/tests/data"
CASES = json.loads((DATA / "metrics_scipy.json").read_text())

spec = importlib.util.spec_from_file_location("metrics_scipy", DATA / "metrics_scipy.py")
scipy_side = importlib.util.module_from_spec(spec)
spec.loader.exec_module(scipy_side)


def test_no_case_is_missing():
    assert len(CASES) == 11


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"])
def test_stored_distances_are_what_scipy_computes(case):
    p, q = (scipy_side.metres(np.array(case[side])) for side in "pq")
    np.testing.assert_allclose(case["chamfer"], scipy_side.chamfer(p, q), rtol=1e-12)
    part = scipy_side.chamfer(p, q[: len(q) // 3])
    np.testing.assert_allclose(case["chamfer_part"], part, rtol=1e-12)
    np.testing.assert_allclose(case["emd"], scipy_side.assignment(cdist(p, q)), rtol=1e-12)
    squared = scipy_side.assignment(cdist(p, q, "sqeuclidean"))
    np.testing.assert_allclose(case["emd_squared"], squared, rtol=1e-12)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"])
def test_stored_distances_are_what_pot_computes(case):
    p, q = (scipy_side.metres(np.array(case[side])) for side in "pq")
    squared = ot.dist(p, q, "sqeuclidean")
    chamfer = squared.min(axis=0).mean() + squared.min(axis=1).mean()
    np.testing.assert_allclose(case["chamfer"], chamfer, rtol=1e-9)
    for key, cost in (("emd", ot.dist(p, q, "euclidean")), ("emd_squared", squared)):
        # No weights are uniform weights: the optimum is then at a bijection (Birkhoff).
        value = ot.emd2([], [], cost, numItermax=10_000_000)
        np.testing.assert_allclose(case[key], value, rtol=1e-9, err_msg=key)

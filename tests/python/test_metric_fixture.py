"""The distances that the Rust tests of the metrics compare with are SciPy's."""

import importlib.util
import json
import pathlib

import numpy as np
from scipy.spatial.distance import cdist

DATA = pathlib.Path(__file__).parents[2] / "learn/tests/data"


def test_stored_distances_are_what_scipy_computes():
    spec = importlib.util.spec_from_file_location("metrics_scipy", DATA / "metrics_scipy.py")
    scipy_side = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(scipy_side)
    cases = json.loads((DATA / "metrics_scipy.json").read_text())
    assert len(cases) == 6
    for case in cases:
        p, q = (scipy_side.metres(np.array(case[side])) for side in "pq")
        np.testing.assert_allclose(case["chamfer"], scipy_side.chamfer(p, q), rtol=1e-12)
        np.testing.assert_allclose(case["emd"], scipy_side.assignment(cdist(p, q)), rtol=1e-12)
        squared = scipy_side.assignment(cdist(p, q, "sqeuclidean"))
        np.testing.assert_allclose(case["emd_squared"], squared, rtol=1e-12)

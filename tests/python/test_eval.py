"""What `tdcr eval` says of single test commands, computed again by SciPy and POT from the clouds themselves."""

import h5py
import numpy as np
import ot
import pytest
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

POINTS = 400


def read_ply(path):
    """Positions of a binary PLY of `float x, y, z` and `uchar red, green, blue`."""
    header, body = path.read_bytes().split(b"end_header\n", 1)
    fields = [tuple(line.split()[1:]) for line in header.decode().splitlines() if line.startswith("property")]
    kinds = {"float": "<f4", "uchar": "u1"}
    points = np.frombuffer(body, [(name, kinds[kind]) for kind, name in fields])
    return np.stack([points[axis] for axis in "xyz"], axis=1).astype(float)


@pytest.fixture(scope="module")
def scored(tdcr, tmp_path_factory):
    """A data set, a model trained on it for a moment, and what eval says of it."""
    folder = tmp_path_factory.mktemp("eval")
    data, run = folder / "data", folder / "run"
    tdcr("collect", "--samples", 40, "--points", POINTS, "--payload", "0:0.03", "--out", data)
    size = ["--width", 16, "--depth", 2, "--embedding", 16, "--steps", 40, "--validate-every", 20]
    model = tdcr("train", *size, "--data", data, "--out", run)["model"]
    points = ["--points", POINTS, "--emd-points", POINTS]
    return data, model, tdcr("eval", "--model", model, "--data", data, *points, "--worst", 4)


def test_scores_of_every_test_are_those_of_scipy_and_pot(tdcr, tmp_path, scored):
    data, model, scores = scored
    with h5py.File(data / "test/shard-00000.h5") as file:
        truths, commands, payloads = (file[name][()] for name in ("data", "motors", "payload"))
    assert sorted(worst["test"] for worst in scores["worst"]) == [0, 1, 2, 3]
    for worst in scores["worst"]:
        test, file = worst["test"], tmp_path / "cloud.ply"
        condition = np.float32([*worst["command"], worst["payload"]])
        np.testing.assert_array_equal(condition, commands[test])
        np.testing.assert_array_equal(condition[-1], np.ravel(payloads[test])[0])
        # Noise of test k has the seed of the evaluation plus k; all points are compared, in whichever order.
        *motors, payload = map(float, condition)
        command = ["--command", ",".join(map(repr, motors)), "--payload", payload]
        tdcr("predict", "--model", model, *command, "--points", POINTS, "--seed", test, "--out", file)
        prediction, truth = read_ply(file), truths[test].astype(float)
        cost, squared = cdist(prediction, truth), cdist(prediction, truth, "sqeuclidean")
        chamfer = squared.min(axis=0).mean() + squared.min(axis=1).mean()
        np.testing.assert_allclose(worst["cd"], chamfer, rtol=1e-9)
        for key, matrix in (("emd", cost), ("emd_squared", squared)):
            np.testing.assert_allclose(worst[key], matrix[linear_sum_assignment(matrix)].mean(), rtol=1e-9)
            np.testing.assert_allclose(worst[key], ot.emd2([], [], matrix, numItermax=10_000_000), rtol=1e-9)


def test_quantiles_are_numpys(scored):
    scores = scored[2]
    shares = {"min": 0, "p5": 0.05, "p25": 0.25, "median": 0.5, "p75": 0.75, "p95": 0.95, "max": 1}
    for key in ("cd", "emd", "emd_squared"):
        values = [worst[key] for worst in scores["worst"]]
        expected = {name: np.quantile(values, share) for name, share in shares.items()}
        assert scores["network_quantiles"][key] == pytest.approx(expected, rel=1e-12)

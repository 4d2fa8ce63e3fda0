"""Reference values of tests/metrics.rs, by SciPy: writes metrics_scipy.json beside this file.

    pip install numpy scipy
    python metrics_scipy.py

Each case holds two clouds of equal size in units of 0.1 mm (integers, so that both sides read the
same points: metres are `float32(integer) * float32(1e-4)`), and
  chamfer       m^2, of the clouds,
  chamfer_part  m^2, of the first cloud and the first third of the second,
  emd           m, and emd_squared, m^2: mean cost of the optimal assignment.
"""

import json
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

POINTS = 200


def tube(rng, bend, points=POINTS):
    """Surface samples (m) of a tube 0.3 m long and 40 mm wide, bent by `bend` rad to an arc."""
    angle = bend * rng.random(points)
    around = 2 * np.pi * rng.random(points)
    x, y = 0.02 * np.cos(around), 0.02 * np.sin(around)
    radius = 0.3 / bend
    return np.stack(
        [radius * (1 - np.cos(angle)) + x * np.cos(angle), y, (radius - x) * np.sin(angle)], axis=1
    )


def repeated(rng, cloud):
    """`POINTS` draws from the first 20 points."""
    return cloud[rng.integers(0, 20, POINTS)]


def clusters(rng, near):
    """Two balls of 2 mm, 1 m apart, the first of `near` points."""
    ball = rng.normal(0, 2e-3, (POINTS, 3))
    ball[near:, 0] += 1
    return ball


def collapsed(cloud):
    """The cloud with every other point moved onto its first."""
    cloud = cloud.copy()
    cloud[::2] = cloud[0]
    return cloud


def lattice(rng):
    """Corners of a lattice of 20 mm: points, distances and their sums repeat."""
    return 0.02 * rng.integers(0, 5, (POINTS, 3))


def metres(cloud):
    return (np.float32(cloud) * np.float32(1e-4)).astype(np.float64)


def chamfer(p, q):
    return np.mean(cKDTree(q).query(p)[0] ** 2) + np.mean(cKDTree(p).query(q)[0] ** 2)


def assignment(cost):
    return cost[linear_sum_assignment(cost)].mean()


def case(name, p, q):
    p, q = (np.rint(cloud * 1e4).astype(int) for cloud in (p, q))
    x, y = metres(p), metres(q)
    return {
        "name": name,
        "p": p.tolist(),
        "q": q.tolist(),
        "chamfer": chamfer(x, y),
        "chamfer_part": chamfer(x, y[: len(y) // 3]),
        "emd": assignment(cdist(x, y)),
        "emd_squared": assignment(cdist(x, y, "sqeuclidean")),
    }


def main():
    rng = np.random.default_rng(7)
    straight = tube(rng, 1e-3)
    line = np.zeros((POINTS, 3))
    line[:, 0] = 0.3 * rng.random(POINTS)
    cases = [
        case("two samples of one surface", straight, tube(rng, 1e-3)),
        case("bent against straight", straight, tube(rng, 1.5)),
        case("blob against surface", rng.normal([0, 0, 0.15], 0.05, (POINTS, 3)), straight),
        case("duplicates", repeated(rng, straight), repeated(rng, tube(rng, 0.3))),
        case("far apart", straight, tube(rng, 0.2) + [1.0, -0.5, 0.0]),
        case("collinear", line, 3 * line**2),
        case("clusters that share out unequally", clusters(rng, 150), clusters(rng, 60)),
        case("half of the points in one place", straight, collapsed(tube(rng, 0.8))),
        case("lattice", lattice(rng), lattice(rng)),
        case("coplanar", line + tube(rng, 0.5) * [0, 1, 0], tube(rng, 0.5) * [1, 1, 0]),
        case("1,000 points", tube(rng, 0.3, 1000), tube(rng, 1.2, 1000)),
    ]
    path = Path(__file__).with_suffix(".json")
    lines = [json.dumps(c, separators=(",", ":")) for c in cases]
    path.write_text("[\n" + ",\n".join(lines) + "\n]\n")


if __name__ == "__main__":
    main()

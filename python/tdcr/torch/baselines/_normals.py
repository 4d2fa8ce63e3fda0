"""Normals of the points of a cloud: local planes, oriented outwards along a spanning tree (Hoppe et al. 1992)."""

import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import numpy.typing as npt

from tdcr.torch.baselines._method import load

Floats = npt.NDArray[np.float64]
Floats32 = npt.NDArray[np.float32]

#: Neighbours that a plane is fitted to, the point itself with them, and how far off they may be (m).
NEIGHBOURS, RADIUS = 40, 0.03

#: Neighbours of a point in the graph along which signs are carried.
EDGES = 12

#: Clouds below which starting processes takes longer than the work.
FEW = 128

#: Directions in which a surface is looked at from outside: to the 26 neighbours of a cell.
DIRECTIONS = np.array([d for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)], dtype=np.float64) - 1.0


def normals_of(cloud: Floats, chosen: npt.NDArray[np.int64]) -> Floats:
    """Outward unit normals (M, 3) of the chosen points (M,) of a cloud (N, 3) (m), of the planes through their neighbours."""
    points = cloud[chosen]
    neighbours, known = nearest(cloud, points, NEIGHBOURS)
    # Covariance of the neighbours of every point; its eigenvector of the smallest eigenvalue is the plane's normal.
    apart = np.where(known[..., None], cloud[neighbours] - points[:, None], 0.0)
    count = known.sum(axis=1)[:, None]
    mean = apart.sum(axis=1) / count
    covariances = np.matmul(apart.transpose(0, 2, 1), apart) / count[..., None] - mean[:, :, None] * mean[:, None, :]
    planes: Floats = np.linalg.eigh(covariances)[1][:, :, 0]
    return oriented(points, planes, *nearest(points, points, EDGES))


def nearest(cloud: Floats, points: Floats, count: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
    """Indices (M, K) of the points of a cloud (N, 3) that are nearest to points (M, 3), and which are within the radius."""
    spatial = load("scipy.spatial", "the normals of VSM")
    distances, found = spatial.cKDTree(cloud).query(points, k=range(1, min(count, len(cloud)) + 1), distance_upper_bound=RADIUS)
    known = np.isfinite(distances)
    return np.where(known, found, 0), known


def oriented(points: Floats, normals: Floats, neighbours: npt.NDArray[np.int64], known: npt.NDArray[np.bool_]) -> Floats:
    """The normals with signs that agree between neighbours, outwards on each connected part of the surface.

    Signs are carried along the minimum spanning tree whose edges are shortest where normals are most nearly parallel (Hoppe et
    al. 1992, section 3.3). A part's common sign is that which looks outwards at its extreme points.
    """
    graph = load("scipy.sparse.csgraph", "the normals of VSM")
    sparse = load("scipy.sparse", "the normals of VSM")
    size = len(points)
    rows = np.repeat(np.arange(size), neighbours.shape[1])[known.ravel()]
    columns = neighbours.ravel()[known.ravel()]
    # A weight of zero would be no edge.
    weights = 1.0 - np.abs((normals[rows] * normals[columns]).sum(axis=1)) + 1e-6
    edges = sparse.csr_matrix((weights, (rows, columns)), shape=(size, size))
    parts, part = graph.connected_components(edges, directed=False)
    # One more vertex is joined to a point of each part, so that one search visits all.
    roots = np.unique(part, return_index=True)[1]
    tree = graph.minimum_spanning_tree(edges.maximum(edges.T)).tocoo()
    rows, columns = np.concatenate([tree.row, np.full(parts, size)]), np.concatenate([tree.col, roots])
    whole = sparse.csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(size + 1, size + 1))
    parents = graph.breadth_first_order(whole, size, directed=False)[1][:size]
    parents[roots] = roots
    # Products of the signs up to the root, by doubling the part of the path that is known.
    signs = np.where((normals * normals[parents]).sum(axis=1) < 0.0, -1.0, 1.0)
    while not np.array_equal(parents, parents[parents]):
        signs, parents = signs * signs[parents], parents[parents]
    found = normals * signs[:, None]
    for root in range(parts):
        members = np.flatnonzero(part == root)
        extreme = members[(points[members] @ DIRECTIONS.T).argmax(axis=0)]
        if (found[extreme] * DIRECTIONS).sum() < 0.0:
            found[members] *= -1.0
    return found


def surfaces_of(clouds: Floats32, count: int, seed: int, scale: float) -> tuple[Floats32, Floats32]:
    """Points (B, M, 3) of clouds (B, N, 3) in units of `scale` (m), a random subset of at most `count`, and their normals.

    Many clouds are shared among as many processes as there are processors.
    """
    jobs = [(cloud, count, [seed, k], scale) for k, cloud in enumerate(clouds)]
    if len(clouds) < FEW:
        found = [surface_of(job) for job in jobs]
    else:
        with ProcessPoolExecutor(os.cpu_count(), get_context("spawn")) as pool:
            found = list(pool.map(surface_of, jobs, chunksize=16))
    points, normals = zip(*found, strict=True)
    return np.stack(points), np.stack(normals)


def surface_of(job: tuple[Floats32, int, list[int], float]) -> tuple[Floats32, Floats32]:
    """Points (M, 3) of a cloud (N, 3) and their normals."""
    cloud, count, seed, scale = job
    chosen = np.random.default_rng(seed).permutation(len(cloud))[:count]
    return cloud[chosen], normals_of(cloud.astype(np.float64) * scale, chosen).astype(np.float32)

"""Points of the zero level of a signed distance in a cube: coarse to fine cells, marching cubes, uniform by area."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from tdcr.torch.baselines._method import load

Floats = npt.NDArray[np.float64]

#: Nodes of the grid along an edge of the cube, and of a block that is evaluated as a whole or not at all.
NODES, BLOCK = 128, 4

#: A block is evaluated where its centre is nearer to the level than its farthest node, times this: distances that a network
#: learned are not exact.
SAFETY = 2.0


@dataclass(frozen=True)
class Grid:
    """Values of a signed distance on the part of a grid that its level may cross."""

    #: Values at nodes (I, J, K); beyond the blocks at the level, that of the block's centre.
    values: npt.NDArray[np.float32]
    #: First node of the part.
    first: npt.NDArray[np.int64]
    #: Half the edge of the cube.
    half: float
    #: Points (M, 3) of the cube by the absolute value there, smallest first: what stands for a level where there is none.
    closest: Floats

    @classmethod
    def of(cls, level: Callable[[Tensor], Tensor], half: float) -> Self:
        """The grid of a function of points (M, 3) in the cube of half edge `half`, with values (M,) on the CPU."""
        spacing = 2.0 * half / (NODES - 1)
        blocks = NODES // BLOCK
        middle = torch.arange(blocks) * BLOCK + (BLOCK - 1) / 2
        centers = torch.stack(torch.meshgrid(middle, middle, middle, indexing="ij"), dim=-1)
        coarse = level(centers.reshape(-1, 3) * spacing - half).reshape(blocks, blocks, blocks)
        # To the nodes of the neighbouring blocks too, as cells reach there.
        reach = SAFETY * spacing * 3**0.5 * (BLOCK + 1) / 2
        near = coarse.abs() < reach
        order = coarse.flatten().abs().argsort()
        closest = (centers.reshape(-1, 3)[order] * spacing - half).double().numpy()
        chosen = near.nonzero()
        if not len(chosen):
            return cls(np.zeros((0, 0, 0), np.float32), np.zeros(3, np.int64), half, closest)
        low = (chosen.amin(dim=0) - 1).clamp(min=0)
        high = (chosen.amax(dim=0) + 2).clamp(max=blocks)
        own = torch.arange(BLOCK)
        inner = torch.stack(torch.meshgrid(own, own, own, indexing="ij"), dim=-1).reshape(-1, 3)
        nodes = chosen[:, None] * BLOCK + inner
        fine = level(nodes.reshape(-1, 3) * spacing - half)
        part = coarse[low[0] : high[0], low[1] : high[1], low[2] : high[2]]
        values = part.repeat_interleave(BLOCK, 0).repeat_interleave(BLOCK, 1).repeat_interleave(BLOCK, 2)
        at = (nodes - low * BLOCK).reshape(-1, 3)
        values[at[:, 0], at[:, 1], at[:, 2]] = fine
        return cls(values.numpy(), (low * BLOCK).numpy(), half, closest)

    def triangles(self) -> Floats:
        """Triangles (T, 3, 3) of the level: those of connected parts that do not come near the cube's boundary."""
        if not self.values.size or self.values.min() >= 0.0 or self.values.max() <= 0.0:
            return np.zeros((0, 3, 3))
        measure = load("skimage.measure", "the baseline VSM", "scikit-image")
        sparse = load("scipy.sparse", "the baseline VSM", "scipy")
        graph = load("scipy.sparse.csgraph", "the baseline VSM", "scipy")
        vertices, faces, _, _ = measure.marching_cubes(self.values, 0.0)
        vertices = vertices + self.first
        pairs = np.concatenate([faces[:, :2], faces[:, 1:]])
        joined = sparse.coo_matrix((np.ones(len(pairs), np.int8), pairs.T), shape=(len(vertices), len(vertices)))
        parts, part = graph.connected_components(joined, directed=False)
        outermost = ((vertices < 1.0) | (vertices > NODES - 2.0)).any(axis=1)
        kept = np.ones(parts, dtype=bool)
        kept[part[outermost]] = False
        found: Floats = vertices[faces[kept[part[faces[:, 0]]]]] * (2.0 * self.half / (NODES - 1)) - self.half
        return found


def sample(grid: Grid, count: int, seed: int) -> Floats:
    """Points (`count`, 3) of the level, uniform by area; where there is none, the centres of blocks that are closest to one."""
    triangles = grid.triangles()
    edges = triangles[:, 1:] - triangles[:, :1]
    areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    total = areas.cumsum()
    if not len(total) or total[-1] <= 0.0:
        return np.resize(grid.closest, (count, 3))
    numbers = np.random.default_rng(seed)
    which = np.searchsorted(total, numbers.random(count) * total[-1], side="right").clip(max=len(areas) - 1)
    # Uniform in a parallelogram, folded into its triangle.
    u = numbers.random((count, 2))
    u = np.where(u.sum(axis=1, keepdims=True) > 1.0, 1.0 - u, u)
    found: Floats = triangles[which, 0] + (u[:, :, None] * edges[which]).sum(axis=1)
    return found

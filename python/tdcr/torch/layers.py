"""What the networks of this package share: shapes, features of time, FiLM, and clouds in grids of voxels.

Shapes of tensors: B clouds of N points of C numbers (3, or 6 with colours), r voxels per edge of a grid.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, cast

import torch
from torch import Tensor, nn

CHANNELS = {"xyz": 3, "xyz-rgb": 6}

#: A network's shape, as the header of a model file has it.
Shape = Mapping[str, Any]


def head_of(shape: Shape) -> Shape:
    """The part of a shape that all networks have."""
    return cast(Shape, shape.get("head", shape))


def channels_of(shape: Shape) -> int:
    """Numbers of a point: 3, or 6 with colours."""
    return CHANNELS[head_of(shape).get("channels", "xyz")]


def octaves_of(shape: Shape) -> int:
    """Octaves of the Fourier features of a point's position."""
    return int(head_of(shape).get("octaves", 0))


def point_inputs_of(shape: Shape) -> int:
    """Numbers of a point that the input layer takes: its own, and its Fourier features."""
    return channels_of(shape) + 6 * octaves_of(shape)


def point_inputs(x: Tensor, octaves: int) -> Tensor:
    """Points (B, N, C) with their Fourier features (B, N, C + 6 K): sin(2^k pi x), then cos(2^k pi x), for each octave k."""
    inputs = [x]
    sine, cosine = (math.pi * x[..., :3]).sin(), (math.pi * x[..., :3]).cos()
    for _ in range(octaves):
        inputs += [sine, cosine]
        # The double angle, as in Rust: rounding grows alike.
        sine, cosine = 2 * sine * cosine, 1 - 2 * sine * sine
    return torch.cat(inputs, dim=-1)


def time_kind_of(shape: Shape) -> str:
    """What a network sees of the flow time: `plain`, or `late` in files that say so."""
    return str(head_of(shape).get("time_features", "plain"))


def time_features(t: Tensor, count: int, kind: str = "plain") -> Tensor:
    """Features (B, count) of flow times (B,): cosines, then sines.

    Of the kind `late`, half of the angles are of -ln(1 - t + 0.001), which tells the last hundredths of the flow apart.
    """
    half = count // 2
    late = half // 2 if kind == "late" else 0
    plain = half - late
    steps = torch.arange(half, dtype=torch.float64, device=t.device)
    time = t.double()[:, None]
    angles = time * torch.exp(-math.log(1e4) / plain * steps[:plain])
    if late:
        noise = -torch.log(1 - time + 1e-3)
        angles = torch.cat([angles, 2 * noise * torch.exp(-math.log(40) / late * steps[:late])], dim=1)
    return torch.cat([angles.cos(), angles.sin()], dim=1).to(t)


def film(layer: nn.Module, normalised: Tensor, e: Tensor) -> Tensor:
    """(1 + gamma(e)) * normalised + beta(e); features last."""
    gamma, beta = layer(e)[:, None].chunk(2, dim=-1)
    modulated: Tensor = (1 + gamma) * normalised + beta
    return modulated


def voxel_coordinates(x: Tensor, resolution: int, slack: float = 0.0) -> Tensor:
    """Coordinates (B, N, 3) in the grid, in [0, r - 1], as PVCNN normalises them; its cube is wider by `slack` than the ball
    about the points' mean that holds them."""
    x = x[..., :3].detach()
    x = x - x.mean(dim=1, keepdim=True)
    diameter: Tensor = 2 * torch.linalg.vector_norm(x, dim=2, keepdim=True).amax(dim=1, keepdim=True) + slack
    return ((x / diameter + 0.5) * resolution).clamp(0, resolution - 1)


def flat_index(voxel: Sequence[Tensor], resolution: int) -> Tensor:
    """Index of a voxel (x, y, z) in a grid that is stored as z, y, x."""
    x, y, z = voxel
    return (z * resolution + y) * resolution + x


def average(h: Tensor, coordinates: Tensor, resolution: int) -> Tensor:
    """Mean (B, C, r, r, r) of the features (B, N, C) of the points nearest to each voxel."""
    # Sums of many points need more digits than the operands of products under autocast.
    h = h.to(torch.promote_types(h.dtype, torch.float32))
    index = flat_index(coordinates.round().long().unbind(-1), resolution)
    clouds, _, channels = h.shape
    total = h.new_zeros(clouds, resolution**3, channels)
    total = total.scatter_add(1, index[..., None].expand_as(h), h)
    count = h.new_zeros(clouds, resolution**3).scatter_add(1, index, torch.ones_like(h[..., 0]))
    mean = total / count.clamp(min=1)[..., None]
    return mean.transpose(1, 2).reshape(clouds, channels, resolution, resolution, resolution)


def interpolate(grid: Tensor, coordinates: Tensor) -> Tensor:
    """Features (B, N, C) trilinear between the eight voxels about each point."""
    resolution = grid.shape[-1]
    rows = grid.flatten(2).transpose(1, 2)
    below = coordinates.floor()
    fraction = (coordinates - below).unbind(-1)
    ends = [(axis, (axis + 1).clamp(max=resolution - 1)) for axis in below.long().unbind(-1)]
    result = torch.zeros_like(coordinates[..., :1])
    for corner in range(8):
        up = [corner >> axis & 1 for axis in range(3)]
        shares = [f if end else 1 - f for f, end in zip(fraction, up, strict=True)]
        weight = (shares[0] * shares[1] * shares[2])[..., None]
        voxel = [axis[end] for axis, end in zip(ends, up, strict=True)]
        index = flat_index(voxel, resolution)[..., None].expand(-1, -1, rows.shape[-1])
        result = result + weight * rows.gather(1, index)
    return result

"""The velocity networks of model files as `torch.nn.Module`s: the paper's MLP and Hybrid.

Their parameters bear the names of a model file's tensors, but for convolutions, which a file stores as
(z, y, x, outputs, inputs): :func:`to_file` and :func:`from_file` permute them. Layers of concatenated features are kept
as their shares: a layer of [x | e] is a layer of x without bias plus a layer of e. New networks have the initial weights
of `tdcr train`, drawn from torch's generator: PyTorch's own, with shares of a layer drawn as one layer, and zeros where
FiLM and the context come in.

Shapes of tensors: B clouds of N points of C numbers (3, or 6 with colours), D values of a condition; positions, times and
conditions in the normalised units of the model file.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, cast

import torch
from torch import Tensor, nn
from torch.nn import functional as F

CHANNELS = {"xyz": 3, "xyz-rgb": 6}

#: A network's shape, as the header of a model file has it.
Shape = Mapping[str, Any]


class Dense(nn.Linear):
    """A linear layer that starts uniform in +-1/sqrt(fan_in), its inputs unless it is a share of a larger layer."""

    def __init__(self, inputs: int, outputs: int, *, bias: bool = True, fan_in: float | None = None) -> None:
        # `nn.Linear` resets its parameters when it is made.
        self.fan_in = inputs if fan_in is None else fan_in
        super().__init__(inputs, outputs, bias=bias)

    def reset_parameters(self) -> None:
        """Draws the initial weights."""
        bound = 1 / math.sqrt(self.fan_in)
        for value in self.parameters():
            nn.init.uniform_(value, -bound, bound)


def zero(inputs: int, outputs: int) -> Dense:
    """A linear layer that starts at zero."""
    return Dense(inputs, outputs, fan_in=math.inf)


class Velocity(nn.Module):
    """What both networks share: the embedding e = SiLU(time(phi(t))) + SiLU(condition(c))."""

    def __init__(self, embedding: int, condition_dim: int) -> None:
        super().__init__()
        self.time = Dense(embedding, embedding)
        self.condition = Dense(condition_dim, embedding)

    def embed(self, t: Tensor, c: Tensor) -> Tensor:
        """Embedding (B, E) of the flow times (B,) and the conditions (B, D)."""
        half = self.time.in_features // 2
        rates = torch.exp(-math.log(1e4) / half * torch.arange(half, dtype=torch.float64, device=t.device)).to(t)
        angles = t[:, None] * rates
        features = torch.cat([angles.cos(), angles.sin()], dim=1)
        return F.silu(self.time(features)) + F.silu(self.condition(c))


def film(layer: nn.Module, normalised: Tensor, e: Tensor) -> Tensor:
    """(1 + gamma(e)) * normalised + beta(e); features last."""
    gamma, beta = layer(e)[:, None].chunk(2, dim=-1)
    modulated: Tensor = (1 + gamma) * normalised + beta
    return modulated


class Block(nn.Module):
    """Residual block of the point-wise layers."""

    def __init__(self, width: int, embedding: int) -> None:
        super().__init__()
        self.film = zero(embedding, 2 * width)
        self.norm = nn.LayerNorm(width)
        self.linear = Dense(width, width)

    def forward(self, h: Tensor, e: Tensor) -> Tensor:
        """Features (B, N, H) after the block."""
        h = film(self.film, self.norm(h), e)
        return h + cast(Tensor, self.linear(F.silu(h)))


def point_inputs_of(shape: Shape) -> int:
    """Numbers of a point that the input layer takes: its own, and its Fourier features."""
    return channels_of(shape) + 6 * int(shape.get("octaves", 0))


class PointLayers:
    """The layers that act on every point: shared by the MLP and the Hybrid's head."""

    def add_point_layers(self, inputs: int, shape: Shape) -> None:
        """Adds them, for points of `inputs` numbers."""
        width, embedding = shape["width"], shape["embedding"]
        self.octaves = int(shape.get("octaves", 0))
        self.shift = Dense(embedding, width, fan_in=inputs + embedding)
        self.input = Dense(inputs, width, bias=False, fan_in=inputs + embedding)
        self.blocks = nn.ModuleList(Block(width, embedding) for _ in range(shape["depth"] - 1))
        self.output = Dense(width, channels_of(shape))

    def point_inputs(self, x: Tensor) -> Tensor:
        """Points (B, N, C) with their Fourier features (B, N, C + 6 K): sin(2^k pi x), then cos(2^k pi x), for each octave k."""
        parts = [x]
        for octave in range(self.octaves):
            angles = math.pi * 2**octave * x[..., :3]
            parts += [angles.sin(), angles.cos()]
        return torch.cat(parts, dim=-1) if self.octaves else x

    def point_velocities(self, x: Tensor, e: Tensor) -> Tensor:
        """Velocities (B, N, C) of points (B, N, inputs)."""
        h = self.input(x) + self.shift(e)[:, None]
        for block in self.blocks:
            h = block(h, e)
        return cast(Tensor, self.output(F.silu(h)))


class Mlp(Velocity, PointLayers):
    """u(x_i, t | c), every point alone."""

    def __init__(self, shape: Shape) -> None:
        super().__init__(shape["embedding"], shape["condition_dim"])
        self.add_point_layers(point_inputs_of(shape), shape)

    def forward(self, x: Tensor, t: Tensor, c: Tensor) -> Tensor:
        """Velocities (B, N, C) of points (B, N, C) at flow times (B,) under conditions (B, D)."""
        return self.point_velocities(self.point_inputs(x), self.embed(t, c))


class Head(nn.Module, PointLayers):
    """The Hybrid's point-wise layers."""

    def __init__(self, inputs: int, shape: Shape) -> None:
        super().__init__()
        self.add_point_layers(inputs, shape)


def group_norm(channels: int) -> nn.GroupNorm:
    """GroupNorm with 8 groups, or the largest of 4, 2, 1 that divides the channels."""
    return nn.GroupNorm(math.gcd(8, channels), channels)


def over_points(norm: nn.Module, h: Tensor) -> Tensor:
    """GroupNorm of point features (B, N, C)."""
    return cast(Tensor, norm(h.transpose(1, 2))).transpose(1, 2)


class Squeeze(nn.Module):
    """Gains per channel from the means over the voxels."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        hidden = max(1, channels // 8)
        self.reduce = Dense(channels, hidden, bias=False)
        self.expand = Dense(hidden, channels, bias=False)

    def forward(self, grid: Tensor) -> Tensor:
        """The grid (B, C, r, r, r), each channel times its gain."""
        gains = torch.sigmoid(self.expand(F.relu(self.reduce(grid.mean(dim=(2, 3, 4))))))
        return gains[:, :, None, None, None] * grid


def voxel_coordinates(x: Tensor, resolution: int) -> Tensor:
    """Coordinates (B, N, 3) in the grid, in [0, r - 1], as PVCNN normalises them."""
    x = x[..., :3].detach()
    x = x - x.mean(dim=1, keepdim=True)
    diameter: Tensor = 2 * torch.linalg.vector_norm(x, dim=2, keepdim=True).amax(dim=1, keepdim=True)
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


class PvBlock(nn.Module):
    """Point-voxel convolution, then a shared MLP under FiLM, residual."""

    def __init__(self, channels: int, resolution: int, embedding: int) -> None:
        super().__init__()
        self.resolution = resolution
        self.convs = nn.ModuleList(nn.Conv3d(channels, channels, 3, padding=1) for _ in range(2))
        self.conv_norms = nn.ModuleList(group_norm(channels) for _ in range(2))
        self.squeeze = Squeeze(channels)
        self.point = Dense(channels, channels)
        self.point_norm = group_norm(channels)
        self.linear = Dense(channels, channels)
        self.norm = group_norm(channels)
        self.film = zero(embedding, 2 * channels)

    def forward(self, h: Tensor, coordinates: Tensor, e: Tensor) -> Tensor:
        """Features (B, N, C) after the block."""
        grid = average(h, coordinates, self.resolution)
        for conv, norm in zip(self.convs, self.conv_norms, strict=True):
            grid = F.silu(norm(conv(grid)))
        v = interpolate(self.squeeze(grid), coordinates)
        v = v + F.silu(over_points(self.point_norm, self.point(h)))
        return h + F.silu(film(self.film, over_points(self.norm, self.linear(v)), e))


class Stage(nn.Module):
    """A projection and the blocks at one resolution."""

    def __init__(self, project: Dense, resolution: int, blocks: int, embedding: int) -> None:
        super().__init__()
        self.resolution = resolution
        self.project = project
        channels = project.out_features
        self.blocks = nn.ModuleList(PvBlock(channels, resolution, embedding) for _ in range(blocks))


class Context(nn.Module):
    """What a point learns from the cloud about it, (B, N, features)."""

    def __init__(self, shape: Shape, embedding: int, inputs: int) -> None:
        super().__init__()
        stages, joined, features = shape["stages"], shape["joined"], shape["features"]
        channels = [stage["channels"] for stage in stages]
        # The layer that joins the stages' outputs and the last one's maximum, and the first stage's layer of [x | e].
        all_joined, first = sum(channels) + channels[-1], inputs + embedding
        self.gate = shape["gate"]
        self.from_embedding = zero(embedding, features)
        self.shift = Dense(embedding, channels[0], fan_in=first)
        self.stages = nn.ModuleList()
        for k, stage in enumerate(stages):
            before = channels[k - 1] if k else inputs
            project = Dense(before, channels[k], bias=k > 0, fan_in=before if k else first)
            self.stages.append(Stage(project, stage["resolution"], shape["blocks"], embedding))
        self.joins = nn.ModuleList(Dense(c, joined, bias=False, fan_in=all_joined) for c in channels)
        self.join_maximum = Dense(channels[-1], joined, fan_in=all_joined)
        self.join_norm = group_norm(joined)
        self.output = zero(joined, features)

    def forward(self, x: Tensor, t: Tensor, e: Tensor) -> Tensor:
        """Context of the points (B, N, C) at flow times (B,) with embeddings (B, E)."""
        h, joined = x, torch.zeros_like(x[..., :1])
        for k, (stage, join) in enumerate(zip(self.stages, self.joins, strict=True)):
            assert isinstance(stage, Stage)
            coordinates = voxel_coordinates(x, stage.resolution)
            h = stage.project(h)
            if k == 0:
                h = h + self.shift(e)[:, None]
            for block in stage.blocks:
                h = block(h, coordinates, e)
            joined = joined + join(h)
        joined = joined + self.join_maximum(h.amax(dim=1))[:, None]
        local = self.output(F.silu(over_points(self.join_norm, joined)))
        weight = torch.sigmoid(self.gate["steepness"] * (t - self.gate["centre"]))[:, None, None]
        context: Tensor = weight * local + (1 - weight) * self.from_embedding(e)[:, None]
        return context


class Hybrid(Velocity):
    """u(x_i, t | c), points with a context."""

    def __init__(self, shape: Shape) -> None:
        head, context = shape["head"], shape["context"]
        super().__init__(head["embedding"], head["condition_dim"])
        channels = channels_of(head)
        self.context = Context(context, head["embedding"], channels)
        self.head = Head(point_inputs_of(head) + context["features"], head)

    def forward(self, x: Tensor, t: Tensor, c: Tensor) -> Tensor:
        """Velocities (B, N, C) of points (B, N, C) at flow times (B,) under conditions (B, D)."""
        e = self.embed(t, c)
        inputs = torch.cat([self.head.point_inputs(x), self.context(x, t, e)], dim=-1)
        return self.head.point_velocities(inputs, e)


def head_of(shape: Shape) -> Shape:
    """The part of a shape that both networks have."""
    return cast(Shape, shape.get("head", shape))


def channels_of(shape: Shape) -> int:
    """Numbers of a point: 3, or 6 with colours."""
    return CHANNELS[head_of(shape).get("channels", "xyz")]


def network(shape: Shape) -> Mlp | Hybrid:
    """The network of a shape, as a model file's header has it, with initial weights from torch's generator."""
    return Hybrid(shape) if "context" in shape else Mlp(shape)


def from_file(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """A state dict of a model file's tensors."""
    return {n: v.permute(3, 4, 0, 1, 2) if v.dim() == 5 else v for n, v in tensors.items()}


def to_file(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """A model file's tensors of a state dict."""
    permuted = {n: v.permute(2, 3, 4, 0, 1) if v.dim() == 5 else v for n, v in tensors.items()}
    return {name: value.contiguous() for name, value in permuted.items()}

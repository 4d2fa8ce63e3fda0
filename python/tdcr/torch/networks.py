"""The velocity networks of model files as `torch.nn.Module`s: the paper's MLP, and the Hybrid with this project's layers.

Their parameters bear the names of a model file's tensors, but for convolutions, which a file stores as
(z, y, x, outputs, inputs): :func:`to_file` and :func:`from_file` permute them. Layers of concatenated features are kept
as their shares: a layer of [x | e] is a layer of x without bias plus a layer of e. New networks have the initial weights
of `tdcr train`, drawn from torch's generator: PyTorch's own, with shares of a layer drawn as one layer, and zeros where
FiLM and the context come in. The authors' own Hybrid is in `pvcnn`.

Shapes of tensors: B clouds of N points of C numbers (3, or 6 with colours), D values of a condition; positions, times and
conditions in the normalised units of the model file.
"""

import math
from collections.abc import Mapping
from typing import Any, cast

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tdcr.torch import pvcnn
from tdcr.torch.layers import (
    Shape,
    average,
    channels_of,
    film,
    interpolate,
    octaves_of,
    point_inputs,
    point_inputs_of,
    time_features,
    time_kind_of,
    voxel_coordinates,
)
from tdcr.torch.pvcnn import PvcnnHybrid


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


class ConditionBlock(nn.Module):
    """Residual block of the condition, once per cloud: the point-wise layers' without FiLM."""

    def __init__(self, embedding: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(embedding)
        self.linear = Dense(embedding, embedding)

    def forward(self, h: Tensor) -> Tensor:
        """Features (B, E) after the block."""
        h = self.norm(h)
        return h + cast(Tensor, self.linear(F.silu(h)))


class Velocity(nn.Module):
    """What both networks share: the embedding e = SiLU(time(phi(t))) + SiLU(blocks(condition(c)))."""

    def __init__(self, head: Shape) -> None:
        super().__init__()
        embedding = head["embedding"]
        self.time_kind = time_kind_of(head)
        self.time = Dense(embedding, embedding)
        self.condition = Dense(head["condition_dim"], embedding)
        self.condition_blocks = nn.Sequential(*(ConditionBlock(embedding) for _ in range(head.get("condition_blocks", 0))))

    def embed(self, t: Tensor, c: Tensor) -> Tensor:
        """Embedding (B, E) of the flow times (B,) and the conditions (B, D)."""
        features = time_features(t, self.time.in_features, self.time_kind)
        return F.silu(self.time(features)) + F.silu(self.condition_blocks(self.condition(c)))


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


class PointLayers:
    """The layers that act on every point: shared by the MLP and the Hybrid's head."""

    def add_point_layers(self, inputs: int, shape: Shape) -> None:
        """Adds them, for points of `inputs` numbers."""
        width, embedding = shape["width"], shape["embedding"]
        self.octaves = octaves_of(shape)
        self.shift = Dense(embedding, width, fan_in=inputs + embedding)
        self.input = Dense(inputs, width, bias=False, fan_in=inputs + embedding)
        self.blocks = nn.ModuleList(Block(width, embedding) for _ in range(shape["depth"] - 1))
        self.output = Dense(width, channels_of(shape))

    def point_velocities(self, x: Tensor, e: Tensor) -> Tensor:
        """Velocities (B, N, C) of points (B, N, inputs)."""
        h = self.input(x) + self.shift(e)[:, None]
        for block in self.blocks:
            h = block(h, e)
        return cast(Tensor, self.output(F.silu(h)))


class Mlp(Velocity, PointLayers):
    """u(x_i, t | c), every point alone."""

    def __init__(self, shape: Shape) -> None:
        super().__init__(shape)
        self.add_point_layers(point_inputs_of(shape), shape)

    def forward(self, x: Tensor, t: Tensor, c: Tensor) -> Tensor:
        """Velocities (B, N, C) of points (B, N, C) at flow times (B,) under conditions (B, D)."""
        return self.point_velocities(point_inputs(x, self.octaves), self.embed(t, c))


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
        super().__init__(head)
        channels = channels_of(head)
        self.context = Context(context, head["embedding"], channels)
        self.head = Head(point_inputs_of(head) + context["features"], head)

    def forward(self, x: Tensor, t: Tensor, c: Tensor) -> Tensor:
        """Velocities (B, N, C) of points (B, N, C) at flow times (B,) under conditions (B, D)."""
        e = self.embed(t, c)
        inputs = torch.cat([point_inputs(x, self.head.octaves), self.context(x, t, e)], dim=-1)
        return self.head.point_velocities(inputs, e)


def network(shape: Shape) -> Mlp | Hybrid | PvcnnHybrid:
    """The network of a shape, as a model file's header has it, with initial weights from torch's generator."""
    if "context" not in shape:
        return Mlp(shape)
    return PvcnnHybrid(shape) if shape["context"].get("layers") == "pvcnn" else Hybrid(shape)


@torch.no_grad()
def start_as_authors(module: Mlp | Hybrid | PvcnnHybrid) -> None:
    """Draws initial weights as the authors do: time and condition normal with deviation 0.02, input layer and blocks of the
    point-wise layers Kaiming normal, their FiLM's weights PyTorch's default; all of these biases zero."""
    embeddings: list[Any]
    hidden: list[Any]
    films: list[Any]
    if isinstance(module, PvcnnHybrid):
        blocks: list[Any] = list(module.head.blocks)
        embeddings = [module.head.t_proj, module.head.c_proj, module.ctx_net.t_proj, module.ctx_net.c_proj]
        hidden = [module.head.input, *(block[1] for block in blocks)]
        films = [modulation.affine for modulation in module.head.films]
    else:
        embeddings, points = [module.time, module.condition], module.head if isinstance(module, Hybrid) else module
        hidden = [points.input, points.shift, *(block.linear for block in [*module.condition_blocks, *points.blocks])]
        films = [block.film for block in points.blocks]
    for layer in embeddings:
        nn.init.normal_(layer.weight, std=0.02)
    for layer in hidden:
        nn.init.normal_(layer.weight, std=math.sqrt(2 / getattr(layer, "fan_in", layer.in_features)))
    for layer in films:
        bound = 1 / math.sqrt(layer.in_features)
        nn.init.uniform_(layer.weight, -bound, bound)
    for layer in [*embeddings, *hidden, *films]:
        if layer.bias is not None:
            nn.init.zeros_(layer.bias)


def load_file(module: Mlp | Hybrid | PvcnnHybrid, tensors: Mapping[str, Tensor]) -> None:
    """Puts a model file's tensors into a network of its shape.

    Raises:
        RuntimeError: where they do not fit.
    """
    known = pvcnn.from_file(module, tensors) if isinstance(module, PvcnnHybrid) else from_file(tensors)
    module.load_state_dict(known)


def file_tensors(module: nn.Module) -> dict[str, Tensor]:
    """A model file's tensors of one of `tdcr`'s networks."""
    return pvcnn.to_file(module) if isinstance(module, PvcnnHybrid) else to_file(module.state_dict())


def from_file(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """A state dict of a model file's tensors."""
    return {n: v.permute(3, 4, 0, 1, 2) if v.dim() == 5 else v for n, v in tensors.items()}


def to_file(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """A model file's tensors of a state dict."""
    permuted = {n: v.permute(2, 3, 4, 0, 1) if v.dim() == 5 else v for n, v in tensors.items()}
    return {name: value.contiguous() for name, value in permuted.items()}

"""The authors' Hybrid as a `torch.nn.Module`, under the names of their checkpoints.

Its point-voxel parts are those of PVCNN (Liu et al., NeurIPS 2019), with BatchNorm: in training over all clouds of a batch, in
predictions by running averages. Its state dict is that of their published model; :func:`to_file` and :func:`from_file` carry
it to model files and back, where layers have the names of this project, those of concatenated features are kept as their
shares, and convolutions are (z, y, x, outputs, inputs).
"""

import math
from collections.abc import Iterator, Mapping
from typing import cast

import torch
from torch import Tensor, nn

from tdcr.errors import InputError
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

#: What the voxels' cube is wider than the ball of the points.
SLACK = 1e-6


def group_norm(channels: int) -> nn.GroupNorm:
    """The authors' GroupNorm, of gcd(32, C) groups."""
    return nn.GroupNorm(math.gcd(32, channels), channels)


class SharedMlp(nn.Module):
    """A layer on every point with BatchNorm and ReLU; features (B, C, N)."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(nn.Conv1d(inputs, outputs, 1), nn.BatchNorm1d(outputs), nn.ReLU())

    def forward(self, h: Tensor) -> Tensor:
        """Features (B, outputs, N)."""
        return cast(Tensor, self.layers(h))


class SqueezeExcitation(nn.Module):
    """Each channel of a grid (B, C, r, r, r) times a gain from the means over the voxels."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        hidden = max(1, channels // 8)
        layers = [nn.Linear(channels, hidden, bias=False), nn.ReLU(), nn.Linear(hidden, channels, bias=False), nn.Sigmoid()]
        self.fc = nn.Sequential(*layers)

    def forward(self, grid: Tensor) -> Tensor:
        """The grid."""
        gains: Tensor = self.fc(grid.mean(dim=(2, 3, 4)))
        return gains[:, :, None, None, None] * grid


class PvConv(nn.Module):
    """Point-voxel convolution of features (B, C, N)."""

    def __init__(self, channels: int, resolution: int) -> None:
        super().__init__()
        self.resolution = resolution
        layers: list[nn.Module] = []
        for _ in range(2):
            layers += [
                nn.Conv3d(channels, channels, 3, padding=1),
                nn.BatchNorm3d(channels, eps=1e-4),
                nn.LeakyReLU(0.1),
            ]
        self.voxel_layers = nn.Sequential(*layers, SqueezeExcitation(channels))
        self.point_features = SharedMlp(channels, channels)

    def forward(self, h: Tensor, coordinates: Tensor) -> Tensor:
        """Features (B, C, N)."""
        # PVCNN's grids have the axes x, y, z.
        grid = average(h.transpose(1, 2), coordinates, self.resolution).permute(0, 1, 4, 3, 2)
        grid = self.voxel_layers(grid).permute(0, 1, 4, 3, 2)
        voxels = interpolate(grid, coordinates).transpose(1, 2)
        return voxels + cast(Tensor, self.point_features(h))


class Film(nn.Module):
    """A norm under scale 1 + gamma and shift beta, affine in the embedding."""

    def __init__(self, norm: nn.Module, channels: int, embedding: int) -> None:
        super().__init__()
        self.norm = norm
        self.affine = nn.Linear(embedding, 2 * channels)


class Block(nn.Module):
    """p = post(pvconv(h)), then p + FiLM(GN(p)); features (B, C, N). FiLM starts at gamma = beta = 0."""

    def __init__(self, channels: int, resolution: int, embedding: int) -> None:
        super().__init__()
        self.pvconv = PvConv(channels, resolution)
        self.post = SharedMlp(channels, channels)
        self.film = Film(group_norm(channels), channels, embedding)
        zero(self.film.affine)

    def forward(self, h: Tensor, coordinates: Tensor, e: Tensor) -> Tensor:
        """Features (B, C, N) after the block."""
        p: Tensor = self.post(self.pvconv(h, coordinates))
        return p + film(self.film.affine, self.film.norm(p).transpose(1, 2), e).transpose(1, 2)


class Stage(nn.Module):
    """A projection and the blocks at one resolution."""

    def __init__(self, inputs: int, channels: int, resolution: int, blocks: int, embedding: int) -> None:
        super().__init__()
        self.resolution = resolution
        self.proj = SharedMlp(inputs, channels)
        self.blocks = nn.ModuleList(Block(channels, resolution, embedding) for _ in range(blocks))


class Embedded(nn.Module):
    """What head and context both have: an embedding SiLU(t_proj(phi(t))) + SiLU(c_proj(c))."""

    def __init__(self, head: Shape) -> None:
        super().__init__()
        self.time_kind = time_kind_of(head)
        self.t_proj = nn.Linear(head["embedding"], head["embedding"])
        self.c_proj = nn.Linear(head["condition_dim"], head["embedding"])

    def embed(self, t: Tensor, c: Tensor) -> Tensor:
        """Embedding (B, E) of the flow times (B,) and the conditions (B, D)."""
        features = time_features(t, self.t_proj.in_features, self.time_kind)
        return nn.functional.silu(self.t_proj(features)) + nn.functional.silu(self.c_proj(c))


class Context(Embedded):
    """What a point learns from the cloud about it, (B, N, features)."""

    def __init__(self, shape: Shape, head: Shape, inputs: int) -> None:
        super().__init__(head)
        embedding = head["embedding"]
        stages, features, joined = shape["stages"], shape["features"], shape["joined"]
        self.gate = shape["gate"]
        channels = [stage["channels"] for stage in stages]
        self.stages = nn.ModuleList()
        for stage, before in zip(stages, [embedding + inputs, *channels[:-1]], strict=True):
            self.stages.append(Stage(before, stage["channels"], stage["resolution"], shape["blocks"], embedding))
        last = channels[-1]
        self.global_mlp = nn.Sequential(nn.Linear(last, last), nn.SiLU(), nn.Linear(last, last))
        self.head_pre = nn.Conv1d(sum(channels) + last, joined, 1)
        self.head_norm = group_norm(joined)
        self.head_out = nn.Conv1d(joined, features, 1)
        zero(self.head_out)
        self.ctx_from_emb = nn.Sequential(nn.Linear(embedding, features))

    def forward(self, x: Tensor, t: Tensor, c: Tensor) -> Tensor:
        """Context of the points (B, N, C) at flow times (B,) under conditions (B, D)."""
        e = self.embed(t, c)
        # As the authors have it: in the precision of the weights also under autocast.
        with torch.autocast(x.device.type, enabled=False):
            own = e.to(self.t_proj.weight.dtype)
            points = x.to(own.dtype).transpose(1, 2)
            h = torch.cat([own[:, :, None].expand(-1, -1, x.shape[1]), points], dim=1)
            outputs = []
            for stage in self.stages:
                assert isinstance(stage, Stage)
                coordinates = voxel_coordinates(x, stage.resolution, SLACK)
                h = stage.proj(h)
                for block in stage.blocks:
                    h = block(h, coordinates, own)
                outputs.append(h)
        maximum = self.global_mlp(h.amax(dim=2))
        joined = torch.cat([*outputs, maximum[:, :, None].expand_as(h)], dim=1)
        local = self.head_out(nn.functional.silu(self.head_norm(self.head_pre(joined)))).transpose(1, 2)
        weight = torch.sigmoid(self.gate["steepness"] * (t - self.gate["centre"]))[:, None, None]
        context: Tensor = weight * local + (1 - weight) * self.ctx_from_emb(e)[:, None]
        return context


class Head(Embedded):
    """The layers that act on every point and its context: the authors' MLP."""

    def __init__(self, inputs: int, shape: Shape) -> None:
        width, embedding = shape["width"], shape["embedding"]
        super().__init__(shape)
        self.input = nn.Linear(inputs + embedding, width)
        count = shape["depth"] - 1
        self.films = nn.ModuleList(Film(nn.LayerNorm(width), width, embedding) for _ in range(count))
        self.blocks = nn.ModuleList(nn.Sequential(nn.SiLU(), nn.Linear(width, width)) for _ in range(count))
        self.out = nn.Sequential(nn.SiLU(), nn.Linear(width, channels_of(shape)))
        for modulation in self.films:
            zero(cast(Film, modulation).affine)

    def forward(self, x: Tensor, t: Tensor, c: Tensor) -> Tensor:
        """Velocities (B, N, C) of points with their context (B, N, inputs)."""
        e = self.embed(t, c)
        h = self.input(torch.cat([x, e[:, None].expand(-1, x.shape[1], -1)], dim=-1))
        for modulation, block in zip(self.films, self.blocks, strict=True):
            assert isinstance(modulation, Film)
            h = film(modulation.affine, modulation.norm(h), e)
            h = h + block(h)
        return cast(Tensor, self.out(h))


class PvcnnHybrid(nn.Module):
    """u(x_i, t | c), points with a context: the authors' network.

    Raises:
        tdcr.errors.InputError: for a shape with blocks of the condition, of which it has none.
    """

    def __init__(self, shape: Shape) -> None:
        super().__init__()
        if blocks := shape["head"].get("condition_blocks", 0):
            raise InputError(f"condition_blocks is {blocks}, expected 0 with pvcnn layers")
        head, context, channels = shape["head"], shape["context"], channels_of(shape)
        self.shape = shape
        self.ctx_net = Context(context, head, channels)
        self.octaves = octaves_of(head)
        self.head = Head(point_inputs_of(head) + context["features"], head)

    def forward(self, x: Tensor, t: Tensor, c: Tensor) -> Tensor:
        """Velocities (B, N, C) of points (B, N, C) at flow times (B,) under conditions (B, D)."""
        context = self.ctx_net(x, t, c)
        return cast(Tensor, self.head(torch.cat([point_inputs(x, self.octaves), context.to(x.dtype)], dim=-1), t, c))


def zero(layer: nn.Linear | nn.Conv1d) -> None:
    """Lets a layer start at zero."""
    for value in layer.parameters():
        nn.init.zeros_(value)


def layer_names(shape: Shape) -> Iterator[tuple[str, str]]:
    """The layers by their names in model files and in the authors' checkpoints, but for those of concatenated features."""
    yield from [("time", "head.t_proj"), ("condition", "head.c_proj"), ("head.output", "head.out.1")]
    for k in range(shape["head"]["depth"] - 1):
        ours, film_layer = f"head.blocks.{k}", f"head.films.{k}"
        yield from [(f"{ours}.film", f"{film_layer}.affine"), (f"{ours}.norm", f"{film_layer}.norm")]
        yield f"{ours}.linear", f"{ours}.1"
    for ours, theirs in {
        "time": "t_proj",
        "condition": "c_proj",
        "from_embedding": "ctx_from_emb.0",
        "global.0": "global_mlp.0",
        "global.1": "global_mlp.2",
        "join": "head_pre",
        "join_norm": "head_norm",
        "output": "head_out",
    }.items():
        yield f"context.{ours}", f"ctx_net.{theirs}"
    for s in range(len(shape["context"]["stages"])):
        ours_stage, their_stage = f"context.stages.{s}", f"ctx_net.stages.{s}"
        yield f"{ours_stage}.project_norm", f"{their_stage}.proj.layers.1"
        if s > 0:
            yield f"{ours_stage}.project", f"{their_stage}.proj.layers.0"
        for b in range(shape["context"]["blocks"]):
            for ours, theirs in {
                "convs.0": "pvconv.voxel_layers.0",
                "conv_norms.0": "pvconv.voxel_layers.1",
                "convs.1": "pvconv.voxel_layers.3",
                "conv_norms.1": "pvconv.voxel_layers.4",
                "squeeze.reduce": "pvconv.voxel_layers.6.fc.0",
                "squeeze.expand": "pvconv.voxel_layers.6.fc.2",
                "point": "pvconv.point_features.layers.0",
                "point_norm": "pvconv.point_features.layers.1",
                "linear": "post.layers.0",
                "linear_norm": "post.layers.1",
                "norm": "film.norm",
                "film": "film.affine",
            }.items():
                yield f"{ours_stage}.blocks.{b}.{ours}", f"{their_stage}.blocks.{b}.{theirs}"


#: Layers of concatenated features in a checkpoint: their shares in a model file in the order of their inputs, and which of
#: these has the bias.
JOINT = {
    "head.input": (("head.input", "head.shift"), "head.shift"),
    "ctx_net.stages.0.proj.layers.0": (("context.shift", "context.stages.0.project"), "context.shift"),
}

#: The tensors that a layer or norm may have.
PARTS = ("weight", "bias", "running_mean", "running_var")


def to_file(network: PvcnnHybrid) -> dict[str, Tensor]:
    """The tensors of a model file."""
    state = network.state_dict()
    tensors = {}
    for ours, theirs in layer_names(network.shape):
        for part in PARTS:
            value = state.get(f"{theirs}.{part}")
            if value is None:
                continue
            if value.dim() == 5:
                value = value.permute(4, 3, 2, 0, 1)
            tensors[f"{ours}.{part}"] = value.flatten(1) if value.dim() == 3 else value
    sizes = {"head.shift": network.shape["head"]["embedding"], "context.shift": network.shape["head"]["embedding"]}
    for theirs, (shares, biased) in JOINT.items():
        weight = state[f"{theirs}.weight"].flatten(1)
        own = sizes[biased]
        widths = [own if share == biased else weight.shape[1] - own for share in shares]
        for share, value in zip(shares, weight.split(widths, dim=1), strict=True):
            tensors[f"{share}.weight"] = value
        tensors[f"{biased}.bias"] = state[f"{theirs}.bias"]
    return {name: value.contiguous() for name, value in tensors.items()}


def from_file(network: PvcnnHybrid, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The network's state dict of a model file's tensors; a tensor that has no place keeps its name."""
    state, left = {}, dict(tensors)
    for ours, theirs in layer_names(network.shape):
        for part in PARTS:
            if f"{ours}.{part}" in left:
                value = left.pop(f"{ours}.{part}")
                state[f"{theirs}.{part}"] = value.permute(3, 4, 2, 1, 0) if value.dim() == 5 else value
    for theirs, (shares, biased) in JOINT.items():
        names = [f"{share}.weight" for share in shares]
        if all(name in left for name in names) and f"{biased}.bias" in left:
            state[f"{theirs}.weight"] = torch.cat([left.pop(name) for name in names], dim=1)
            state[f"{theirs}.bias"] = left.pop(f"{biased}.bias")
    # Matrices of layers that are 1 x 1 convolutions here.
    shapes = {name: value.shape for name, value in network.state_dict().items()}
    for name, value in state.items():
        if len(shapes.get(name, ())) == value.dim() + 1:
            state[name] = value[..., None]
    return state | left

"""The velocity networks as PyTorch modules, and tdcr's model files to them and back.

    pip install torch safetensors
    python networks.py run/model.safetensors          # what the file holds

The modules follow the paper's Sec. Method; their parameters bear the names of the file's tensors.
Layers of concatenated features are kept as their shares: a layer of [x | e] is a layer of x without
bias plus a layer of e. Convolutions are stored as (z, y, x, outputs, inputs) and permuted on loading.
"""

import json
import math
import sys

import torch
from safetensors import safe_open
from safetensors.torch import save_file
from torch import nn
from torch.nn import functional as F

CHANNELS = {"xyz": 3, "xyz-rgb": 6}


class Embedding(nn.Module):
    """e = SiLU(time(phi(t))) + SiLU(condition(c)), mixed into the networks below."""

    def __init__(self, embedding, condition_dim):
        super().__init__()
        self.time = nn.Linear(embedding, embedding)
        self.condition = nn.Linear(condition_dim, embedding)

    def embed(self, t, c):
        half = self.time.in_features // 2
        rates = torch.exp(-math.log(1e4) / half * torch.arange(half, dtype=torch.float64)).to(t)
        angles = t[:, None] * rates
        features = torch.cat([angles.cos(), angles.sin()], dim=1)
        return F.silu(self.time(features)) + F.silu(self.condition(c))


def film(layer, normalised, e):
    """(1 + gamma(e)) * normalised + beta(e); features last."""
    gamma, beta = layer(e)[:, None].chunk(2, dim=-1)
    return (1 + gamma) * normalised + beta


class Block(nn.Module):
    """Residual block of the point-wise layers."""

    def __init__(self, width, embedding):
        super().__init__()
        self.film = nn.Linear(embedding, 2 * width)
        self.norm = nn.LayerNorm(width)
        self.linear = nn.Linear(width, width)

    def forward(self, h, e):
        h = film(self.film, self.norm(h), e)
        return h + self.linear(F.silu(h))


class PointLayers:
    """The layers that act on every point: shared by the MLP and the Hybrid's head."""

    def add_point_layers(self, inputs, shape):
        width, embedding = shape["width"], shape["embedding"]
        self.shift = nn.Linear(embedding, width)
        self.input = nn.Linear(inputs, width, bias=False)
        self.blocks = nn.ModuleList(Block(width, embedding) for _ in range(shape["depth"] - 1))
        self.output = nn.Linear(width, CHANNELS[shape.get("channels", "xyz")])

    def point_velocities(self, x, e):
        h = self.input(x) + self.shift(e)[:, None]
        for block in self.blocks:
            h = block(h, e)
        return self.output(F.silu(h))


class Mlp(Embedding, PointLayers):
    """u(x_i, t | c), every point alone."""

    def __init__(self, shape):
        super().__init__(shape["embedding"], shape["condition_dim"])
        self.add_point_layers(CHANNELS[shape.get("channels", "xyz")], shape)

    def forward(self, x, t, c):
        return self.point_velocities(x, self.embed(t, c))


class Head(nn.Module, PointLayers):
    def __init__(self, inputs, shape):
        super().__init__()
        self.add_point_layers(inputs, shape)


def group_norm(channels):
    return nn.GroupNorm(math.gcd(8, channels), channels)


def over_points(norm, h):
    """GroupNorm of point features (B, N, C)."""
    return norm(h.transpose(1, 2)).transpose(1, 2)


class Squeeze(nn.Module):
    """Gains per channel from the means over the voxels."""

    def __init__(self, channels):
        super().__init__()
        hidden = max(1, channels // 8)
        self.reduce = nn.Linear(channels, hidden, bias=False)
        self.expand = nn.Linear(hidden, channels, bias=False)

    def forward(self, grid):
        gains = torch.sigmoid(self.expand(F.relu(self.reduce(grid.mean(dim=(2, 3, 4))))))
        return gains[:, :, None, None, None] * grid


def voxel_coordinates(x, resolution):
    """Coordinates (B, N, 3) in the grid, in [0, r - 1], as PVCNN normalises them."""
    x = x[..., :3].detach()
    x = x - x.mean(dim=1, keepdim=True)
    diameter = 2 * x.norm(dim=2, keepdim=True).amax(dim=1, keepdim=True)
    return ((x / diameter + 0.5) * resolution).clamp(0, resolution - 1)


def flat_index(voxel, resolution):
    """Index of a voxel (.., 3) with axes x, y, z in a grid that is stored as z, y, x."""
    return (voxel[..., 2] * resolution + voxel[..., 1]) * resolution + voxel[..., 0]


def average(h, coordinates, resolution):
    """Mean (B, C, r, r, r) of the features (B, N, C) of the points nearest to each voxel."""
    index = flat_index(coordinates.round().long(), resolution)
    clouds, _, channels = h.shape
    total = h.new_zeros(clouds, resolution**3, channels)
    total = total.scatter_add(1, index[..., None].expand_as(h), h)
    count = h.new_zeros(clouds, resolution**3).scatter_add(1, index, torch.ones_like(h[..., 0]))
    mean = total / count.clamp(min=1)[..., None]
    return mean.transpose(1, 2).reshape(clouds, channels, resolution, resolution, resolution)


def interpolate(grid, coordinates):
    """Features (B, N, C) trilinear between the eight voxels about each point."""
    resolution = grid.shape[-1]
    rows = grid.flatten(2).transpose(1, 2)
    below = coordinates.floor()
    fraction = coordinates - below
    result = 0
    for corner in range(8):
        up = torch.tensor([corner >> axis & 1 for axis in range(3)])
        weight = torch.where(up.bool(), fraction, 1 - fraction).prod(dim=-1)
        voxel = (below.long() + up).clamp(max=resolution - 1)
        index = flat_index(voxel, resolution)[..., None].expand(-1, -1, rows.shape[-1])
        result = result + weight[..., None] * rows.gather(1, index)
    return result


class PvBlock(nn.Module):
    """Point-voxel convolution, then a shared MLP under FiLM, residual."""

    def __init__(self, channels, resolution, embedding):
        super().__init__()
        self.resolution = resolution
        self.convs = nn.ModuleList(nn.Conv3d(channels, channels, 3, padding=1) for _ in range(2))
        self.conv_norms = nn.ModuleList(group_norm(channels) for _ in range(2))
        self.squeeze = Squeeze(channels)
        self.point = nn.Linear(channels, channels)
        self.point_norm = group_norm(channels)
        self.linear = nn.Linear(channels, channels)
        self.norm = group_norm(channels)
        self.film = nn.Linear(embedding, 2 * channels)

    def forward(self, h, coordinates, e):
        grid = average(h, coordinates, self.resolution)
        for conv, norm in zip(self.convs, self.conv_norms):
            grid = F.silu(norm(conv(grid)))
        v = interpolate(self.squeeze(grid), coordinates)
        v = v + F.silu(over_points(self.point_norm, self.point(h)))
        return h + F.silu(film(self.film, over_points(self.norm, self.linear(v)), e))


class Stage(nn.Module):
    def __init__(self, inputs, channels, resolution, blocks, embedding, first):
        super().__init__()
        self.resolution = resolution
        self.project = nn.Linear(inputs, channels, bias=not first)
        self.blocks = nn.ModuleList(
            PvBlock(channels, resolution, embedding) for _ in range(blocks)
        )


class Context(nn.Module):
    """What a point learns from the cloud about it, (B, N, features)."""

    def __init__(self, shape, embedding, inputs):
        super().__init__()
        channels = [stage["channels"] for stage in shape["stages"]]
        self.gate = shape["gate"]
        self.from_embedding = nn.Linear(embedding, shape["features"])
        self.shift = nn.Linear(embedding, channels[0])
        self.stages = nn.ModuleList(
            Stage(before, stage["channels"], stage["resolution"], shape["blocks"], embedding, k == 0)
            for k, (before, stage) in enumerate(zip([inputs, *channels], shape["stages"]))
        )
        self.joins = nn.ModuleList(nn.Linear(c, shape["joined"], bias=False) for c in channels)
        self.join_maximum = nn.Linear(channels[-1], shape["joined"])
        self.join_norm = group_norm(shape["joined"])
        self.output = nn.Linear(shape["joined"], shape["features"])

    def forward(self, x, t, e):
        h, joined = x, 0
        for k, (stage, join) in enumerate(zip(self.stages, self.joins)):
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
        return weight * local + (1 - weight) * self.from_embedding(e)[:, None]


class Hybrid(Embedding):
    """u(x_i, t | c), points with a context."""

    def __init__(self, shape):
        head, context = shape["head"], shape["context"]
        super().__init__(head["embedding"], head["condition_dim"])
        channels = CHANNELS[head.get("channels", "xyz")]
        self.context = Context(context, head["embedding"], channels)
        self.head = Head(channels + context["features"], head)

    def forward(self, x, t, c):
        e = self.embed(t, c)
        return self.head.point_velocities(torch.cat([x, self.context(x, t, e)], dim=-1), e)


def network(shape):
    """The network of a shape, as a model file's header has it."""
    return Hybrid(shape) if "context" in shape else Mlp(shape)


def loss(velocities, targets, color_weight=0.05):
    """Mean squared error of the positions' velocities, plus that of the colours', weighted."""
    error = (velocities - targets) ** 2
    colour = color_weight * error[..., 3:].mean() if error.shape[-1] > 3 else 0
    return error[..., :3].mean() + colour


def to_module(tensors):
    """A state dict of a file's tensors."""
    return {n: v.permute(3, 4, 0, 1, 2) if v.dim() == 5 else v for n, v in tensors.items()}


def to_file(tensors):
    """A file's tensors of a state dict."""
    permuted = {n: v.permute(2, 3, 4, 0, 1) if v.dim() == 5 else v for n, v in tensors.items()}
    return {name: value.contiguous() for name, value in permuted.items()}


def load(path):
    """Network and header of a model file that `tdcr train` wrote."""
    with safe_open(path, "pt") as file:
        header = json.loads(file.metadata()["tdcr"])
        tensors = {name: file.get_tensor(name) for name in file.keys()}
    module = network(header["content"]["shape"])
    module.load_state_dict(to_module(tensors))
    return module, header


def save(path, module, header):
    """Writes a model file that `tdcr predict` reads."""
    save_file(to_file(module.state_dict()), path, {"tdcr": json.dumps(header)})


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python networks.py MODEL.safetensors")
    loaded, description = load(sys.argv[1])
    print(json.dumps(description["content"]["shape"], indent=2))
    print(loaded)
    print(sum(value.numel() for value in loaded.parameters()), "parameters")

"""The authors' Hybrid, written in plain PyTorch from its description and from nothing of tdcr: names, order and shapes of its
tensors are those of the published checkpoints. Run as a script, it writes paper_hybrid.safetensors beside it, which
tests/net_pvcnn.rs compares the Rust network with:

    pip install .[torch]
    python paper_hybrid.py

The file has a network of few channels with random weights and random running averages, as a model file names and orders them
(tdcr.torch.pvcnn.to_file), clouds with colours, and the velocities that this module has for them in f64, stored as f32.
"""

import json
import math
from pathlib import Path

import torch
from safetensors import safe_open
from safetensors.torch import save_file
from torch import nn

PATH = Path(__file__).with_suffix(".safetensors")
SHAPE = {
    "head": {"width": 12, "depth": 3, "embedding": 8, "condition_dim": 2, "channels": "xyz-rgb"},
    "context": {
        "layers": "pvcnn",
        "stages": [
            {"channels": 12, "resolution": 6},
            {"channels": 16, "resolution": 4},
            {"channels": 20, "resolution": 3},
        ],
        "blocks": 2,
        "joined": 20,
        "features": 5,
        "gate": {"centre": 0.75, "steepness": 4.0},
    },
}
# The published sizes.
PAPER = {
    "head": {"width": 512, "depth": 6, "embedding": 256, "condition_dim": 6, "condition_blocks": 0, "octaves": 0, "time_features": "plain", "channels": "xyz"},
    "context": {
        "layers": "pvcnn",
        "stages": [
            {"channels": 80, "resolution": 24},
            {"channels": 112, "resolution": 16},
            {"channels": 112, "resolution": 8},
        ],
        "blocks": 2,
        "joined": 112,
        "features": 64,
        "gate": {"centre": 0.97, "steepness": 12.0},
    },
}
CLOUDS, POINTS = 3, 60


def shared_mlp(inputs, outputs):
    module = nn.Module()
    module.layers = nn.Sequential(nn.Conv1d(inputs, outputs, 1), nn.BatchNorm1d(outputs), nn.ReLU())
    return module


def groups(channels):
    return nn.GroupNorm(math.gcd(channels, 32), channels)


class Film(nn.Module):
    def __init__(self, norm, embedding, channels):
        super().__init__()
        self.norm, self.affine = norm, nn.Linear(embedding, 2 * channels)


class Squeeze(nn.Module):
    def __init__(self, channels):
        super().__init__()
        few = channels // 8
        self.fc = nn.Sequential(
            nn.Linear(channels, few, bias=False), nn.ReLU(), nn.Linear(few, channels, bias=False), nn.Sigmoid()
        )

    def forward(self, grid):
        return grid * self.fc(grid.mean(-1).mean(-1).mean(-1)).view(*grid.shape[:2], 1, 1, 1)


class PVConv(nn.Module):
    def __init__(self, channels, resolution):
        super().__init__()
        self.resolution = resolution
        self.voxel_layers = nn.Sequential(
            nn.Conv3d(channels, channels, 3, stride=1, padding=1),
            nn.BatchNorm3d(channels, eps=1e-4),
            nn.LeakyReLU(0.1),
            nn.Conv3d(channels, channels, 3, stride=1, padding=1),
            nn.BatchNorm3d(channels, eps=1e-4),
            nn.LeakyReLU(0.1),
            Squeeze(channels),
        )
        self.point_features = shared_mlp(channels, channels)

    def forward(self, f, xyz):
        """Features (B, C, N) of points at xyz (B, 3, N)."""
        r = self.resolution
        centred = xyz - xyz.mean(2, keepdim=True)
        places = centred / (2 * centred.norm(dim=1, keepdim=True).max(dim=2, keepdim=True).values + 1e-6) + 0.5
        places = torch.clamp(places * r, 0, r - 1)
        grids = [self.voxelise(features, torch.round(place).long()) for features, place in zip(f, places)]
        grids = self.voxel_layers(torch.stack(grids))
        back = torch.stack([self.devoxelise(grid, place) for grid, place in zip(grids, places)])
        return back + self.point_features.layers(f)

    def voxelise(self, features, voxels):
        """The mean (C, r, r, r), axes x, y, z, of the features (C, N) in each voxel."""
        r = self.resolution
        flat = voxels[0] * r * r + voxels[1] * r + voxels[2]
        one_of = torch.nn.functional.one_hot(flat, r**3).to(features)
        means = features @ one_of / one_of.sum(0).clamp(min=1)
        return means.view(-1, r, r, r)

    def devoxelise(self, grid, place):
        """Trilinear (C, N) as a sum of hats over all voxels, by axis."""
        at = torch.arange(self.resolution).to(place)
        hats = (1 - (place[:, :, None] - at).abs()).clamp(min=0)
        return torch.einsum("cxyz,nx,ny,nz->cn", grid, *hats)


class Block(nn.Module):
    def __init__(self, channels, resolution, embedding):
        super().__init__()
        self.pvconv = PVConv(channels, resolution)
        self.post = shared_mlp(channels, channels)
        self.film = Film(groups(channels), embedding, channels)

    def forward(self, f, xyz, e):
        p = self.post.layers(self.pvconv(f, xyz))
        gamma, beta = self.film.affine(e)[:, :, None].chunk(2, dim=1)
        return p + (self.film.norm(p) * (1 + gamma) + beta)


class Stage(nn.Module):
    def __init__(self, inputs, channels, resolution, blocks, embedding):
        super().__init__()
        self.proj = shared_mlp(inputs, channels)
        self.blocks = nn.ModuleList(Block(channels, resolution, embedding) for _ in range(blocks))


def embed(module, t, c):
    half = module.t_proj.in_features // 2
    angles = torch.stack([t * math.exp(-math.log(10000) * k / half) for k in range(half)], dim=1)
    phi = torch.cat([torch.cos(angles), torch.sin(angles)], dim=1)
    return nn.functional.silu(module.t_proj(phi)) + nn.functional.silu(module.c_proj(c))


class ContextNet(nn.Module):
    def __init__(self, shape, head, channels):
        super().__init__()
        embedding, stages, blocks = head["embedding"], shape["stages"], shape["blocks"]
        widths = [stage["channels"] for stage in stages]
        self.gate = shape["gate"]
        self.t_proj, self.c_proj = nn.Linear(embedding, embedding), nn.Linear(head["condition_dim"], embedding)
        inputs = [embedding + channels, *widths[:-1]]
        self.stages = nn.ModuleList(
            Stage(before, stage["channels"], stage["resolution"], blocks, embedding) for before, stage in zip(inputs, stages)
        )
        self.global_mlp = nn.Sequential(nn.Linear(widths[-1], widths[-1]), nn.SiLU(), nn.Linear(widths[-1], widths[-1]))
        self.head_pre = nn.Conv1d(sum(widths) + widths[-1], shape["joined"], 1)
        self.head_norm = groups(shape["joined"])
        self.head_out = nn.Conv1d(shape["joined"], shape["features"], 1)
        self.ctx_from_emb = nn.Sequential(nn.Linear(embedding, shape["features"]))

    def forward(self, x, t, c):
        e, points = embed(self, t, c), x.transpose(1, 2)
        f = torch.cat([e[:, :, None].expand(-1, -1, x.shape[1]), points], dim=1)
        outputs = []
        for stage in self.stages:
            f = stage.proj.layers(f)
            for block in stage.blocks:
                f = block(f, points[:, :3], e)
            outputs.append(f)
        g = self.global_mlp(f.max(dim=2).values)
        joined = torch.cat([*outputs, g[:, :, None].expand(-1, -1, x.shape[1])], dim=1)
        local = self.head_out(nn.functional.silu(self.head_norm(self.head_pre(joined)))).transpose(1, 2)
        a = torch.sigmoid(self.gate["steepness"] * (t - self.gate["centre"]))[:, None, None]
        return a * local + (1 - a) * self.ctx_from_emb(e)[:, None]


class Head(nn.Module):
    def __init__(self, inputs, shape, outputs):
        super().__init__()
        width, embedding, count = shape["width"], shape["embedding"], shape["depth"] - 1
        self.t_proj, self.c_proj = nn.Linear(embedding, embedding), nn.Linear(shape["condition_dim"], embedding)
        self.input = nn.Linear(inputs + embedding, width)
        self.films = nn.ModuleList(Film(nn.LayerNorm(width), embedding, width) for _ in range(count))
        self.blocks = nn.ModuleList(nn.Sequential(nn.SiLU(), nn.Linear(width, width)) for _ in range(count))
        self.out = nn.Sequential(nn.SiLU(), nn.Linear(width, outputs))

    def forward(self, x, t, c):
        e = embed(self, t, c)[:, None]
        h = self.input(torch.cat([x, e.expand(-1, x.shape[1], -1)], dim=-1))
        for film, block in zip(self.films, self.blocks):
            gamma, beta = film.affine(e).chunk(2, dim=-1)
            h = film.norm(h) * (1 + gamma) + beta
            h = h + block(h)
        return self.out(h)


class PaperHybrid(nn.Module):
    def __init__(self, shape):
        super().__init__()
        head, context = shape["head"], shape["context"]
        channels = {"xyz": 3, "xyz-rgb": 6}[head["channels"]]
        self.ctx_net = ContextNet(context, head, channels)
        self.head = Head(channels + context["features"], head, channels)

    def forward(self, x, t, c):
        return self.head(torch.cat([x, self.ctx_net(x, t, c)], dim=-1), t, c)


def randomise(module, generator):
    """No tensor keeps a special value: weights that keep features of order 1, norms about 1, running averages as after training,
    and squeezed features that are positive, where ReLU lets them through."""
    for name, value in module.state_dict().items():
        if name.endswith("num_batches_tracked"):
            continue
        bound = 1.5 / math.sqrt(value[0].numel()) if value.dim() > 1 else 0.3
        value.uniform_(-bound, bound, generator=generator)
        if value.dim() == 1 and name.endswith(("weight", "running_var")):
            value.add_(1)
        if name.endswith("fc.0.weight"):
            value.abs_()
    return module.eval()


def batch(shape, clouds, points, generator):
    """Points (B, N, C), flow times (B,) and conditions (B, D)."""
    channels = {"xyz": 3, "xyz-rgb": 6}[shape["head"]["channels"]]
    return (
        0.5 * torch.randn(clouds, points, channels, generator=generator),
        torch.linspace(0.3, 0.95, clouds),
        torch.rand(clouds, shape["head"]["condition_dim"], generator=generator),
    )


def velocities(module, inputs):
    """In f64."""
    with torch.no_grad():
        found = module.double()(*(value.double() for value in inputs)).float()
    module.float()
    return found


def read():
    """Tensors as stored."""
    with safe_open(PATH, "pt") as file:
        return json.loads(file.metadata()["shape"]), {name: file.get_tensor(name) for name in file.keys()}


def main():
    from tdcr.torch import network, pvcnn

    generator = torch.Generator().manual_seed(19)
    module = randomise(PaperHybrid(SHAPE), generator)
    inputs = batch(SHAPE, CLOUDS, POINTS, generator)
    ours = network(SHAPE)
    ours.load_state_dict(module.state_dict())
    tensors = {f"weight.{name}": value for name, value in pvcnn.to_file(ours).items()}
    tensors |= dict(zip(("batch.points", "batch.times", "batch.conditions"), inputs))
    tensors["velocities"] = velocities(module, inputs)
    save_file({name: value.contiguous() for name, value in tensors.items()}, PATH, {"shape": json.dumps(SHAPE)})


if __name__ == "__main__":
    main()

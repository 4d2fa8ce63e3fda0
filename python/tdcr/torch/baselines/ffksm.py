"""Free-form kinematic self-models (Hu, Lin and Lipson, "Teaching robots to build simulations of themselves", 2025).

A network gives density s and visibility v of a point x under a command c. Composited along the ray of a pixel, they are the
pixel of a mask, which is all that it learns from. With distances d_k between samples,

    a_k = 1 - exp(-s_k d_k / d),   mask = sum_k v_k a_k prod_{j < k} (1 - a_j),

where d is the spacing of samples along the longest ray, the unit of density.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar, Self

import torch
from torch import Tensor, nn
from torch.nn import functional

from tdcr.errors import InputError
from tdcr.torch.baselines._method import Method, Settings, Training
from tdcr.torch.baselines.views import Views

#: Octaves of sines and cosines of a position.
OCTAVES = 10

#: Samples along a ray.
SAMPLES = 64

#: What an error in a pixel that shows the robot counts more than one in another.
MASK_WEIGHT = 30.0

#: Cells of the grid that is searched for the surface, along the longest edge of the workspace.
CELLS = 128

#: Opacity of a sample inside the robot.
INSIDE = 0.5

#: What the box around all clouds is widened by, relative to its longest edge.
MARGIN = 0.03

#: Points of one query of the network.
QUERY = 1 << 20


class Field(nn.Module):
    """Density (unit: 1 / spacing of samples) and visibility of points under commands."""

    def __init__(self, condition_dim: int, width: int) -> None:
        super().__init__()
        self.position = nn.Linear(3 + 6 * OCTAVES, width)
        self.command = nn.Linear(condition_dim, width)
        # The layer that the two are joined in, in two parts: the command's is evaluated once for all points.
        self.join_position = nn.Linear(width, width)
        self.join_command = nn.Linear(width, width, bias=False)
        self.last = nn.Sequential(nn.ReLU(), nn.Linear(width, 32), nn.ReLU(), nn.Linear(32, 2))
        head = self.last[-1]
        assert isinstance(head, nn.Linear)
        with torch.no_grad():
            # Empty space at first, transparent enough for gradients to reach what lies behind.
            head.bias.copy_(torch.tensor([-5.0, 2.0]))

    def forward(self, points: Tensor, conditions: Tensor) -> tuple[Tensor, Tensor]:
        """Densities and visibilities (B, N) of points (B, N, 3), in the data's units, under conditions (B, D)."""
        position = functional.relu(self.position(octaves(points)))
        command = functional.relu(self.command(2 * conditions - 1))
        joined = self.join_position(position) + self.join_command(command)[:, None]
        raw = self.last(joined).to(points.dtype)
        return functional.softplus(raw[..., 0]), torch.sigmoid(raw[..., 1])


class Ffksm(Method):
    """Density and visibility of space under a command, learned from masks."""

    name: ClassVar[str] = "ffksm"
    learns_from = "masks"
    low: Tensor
    high: Tensor

    def __init__(self, condition_dim: int, width: int = 128) -> None:
        super().__init__()
        self.field = Field(condition_dim, width)
        self.sizes = {"condition_dim": condition_dim, "width": width}
        #: Corners of the box that holds all training clouds.
        self.register_buffer("low", -torch.ones(3))
        self.register_buffer("high", torch.ones(3))
        self.views: Views | None = None
        self.hits: list[Tensor] = []

    @classmethod
    def defaults(cls, device: torch.device) -> dict[str, Any]:
        """The publication's learning rate; as many rays as keep the device busy."""
        if device.type == "cuda":
            return {"batch": 64, "points": 512, "learning_rate": 5e-4, "precision": "bfloat16"}
        return {"batch": 16, "points": 64, "learning_rate": 5e-4}

    @classmethod
    def start(cls, training: Training) -> Self:
        """A network, and the workspace of the training clouds."""
        method = cls(training.clouds.condition_dim)
        rows = training.clouds.rows[..., :3]
        low, high = (end.cpu() for end in torch.aminmax(rows.reshape(-1, 3), dim=0))
        margin = MARGIN * (high - low).max()
        method.low.copy_(low - margin)
        method.high.copy_(high + margin)
        return method

    def shape(self) -> dict[str, Any]:
        """Numbers of a condition, and the width of the encoders."""
        return self.sizes

    def prepare(self, training: Training) -> None:
        """Takes the masks, and finds the pixels that see the workspace."""
        self.look_at(training.views())

    def look_at(self, views: Views) -> None:
        """Takes these pictures for training.

        Raises:
            tdcr.errors.InputError: where no camera sees the workspace.
        """
        self.views, cameras = views, views.cameras
        count = cameras.size[0] * cameras.size[1]
        camera = torch.arange(len(cameras), device=self.device).repeat_interleave(count)
        pixel = torch.arange(count, device=self.device).repeat(len(cameras))
        near, far = self.span(cameras.centres[camera], cameras.directions(camera, pixel))
        seen = far > near
        if not bool(seen.any()):
            raise InputError("no camera sees the clouds, expected pictures of the robot")
        self.hits = [camera[seen], pixel[seen]]
        #: Pixels up to each camera's last that show the robot (B, V).
        self.ends = (views.pixels < count).sum(dim=-1).cumsum(dim=-1)
        self.parts = torch.tensor([float(seen.float().mean()), 1.0 / (len(cameras) * count)], device=self.device)

    def span(self, origins: Tensor, directions: Tensor) -> tuple[Tensor, Tensor]:
        """Where rays (..., 3) enter and leave the workspace; they miss it where the second is below the first."""
        ends = torch.stack([(self.low - origins) / directions, (self.high - origins) / directions])
        near, far = ends.amin(dim=0).amax(dim=-1), ends.amax(dim=0).amin(dim=-1)
        return near.clamp(min=0.0), far

    def mask(self, conditions: Tensor, origins: Tensor, directions: Tensor, offsets: Tensor) -> Tensor:
        """Masks (B, R) along rays (B, R, 3) that meet the workspace, under conditions (B, D).

        `offsets` (B, R, SAMPLES), from 0 to 1, are the places of samples within their parts of the ray.
        """
        near, far = self.span(origins, directions)
        places = (torch.arange(SAMPLES, device=origins.device) + offsets) / SAMPLES
        lengths = (far - near).clamp(min=0.0)
        points = origins[..., None, :] + directions[..., None, :] * (near[..., None] + lengths[..., None] * places)[..., None]
        density, visibility = self.field(points.flatten(1, 2), conditions)
        # All samples stand for as much of the ray.
        depth = density.view(places.shape) * (lengths / (self.high - self.low).norm())[..., None]
        return composite(depth, visibility.view(places.shape))

    def loss(self, training: Training, step: int, numbers: torch.Generator) -> Tensor:
        """Mean of (1 + 30 mask) (predicted - mask)^2 over all pixels of all pictures of the batch's samples.

        An unbiased estimate: half of the rays are drawn from all pixels that see the workspace (the others are 0 in both), half
        from those that show the robot.
        """
        assert self.views is not None
        batch, device = training.settings.batch, self.device
        sample = torch.randint(len(self.views), (batch,), generator=numbers, device=device)
        rays = (batch, max(1, training.settings.points // 2))
        any_pixel = torch.randint(len(self.hits[0]), rays, generator=numbers, device=device)
        ends = self.ends[sample]
        total = ends[:, -1:]
        place = torch.rand(rays, generator=numbers, device=device).mul(total).long().minimum(total - 1).clamp(min=0)
        robot_camera = (place[..., None] >= ends[:, None]).sum(dim=-1).clamp(max=len(self.views.cameras) - 1)
        before = functional.pad(ends, (1, 0))[:, :-1].gather(1, robot_camera)
        robot_pixel = self.views.pixels[sample[:, None], robot_camera, place - before].long()
        camera = torch.cat([self.hits[0][any_pixel], robot_camera], dim=1)
        # A sample out of all pictures has no such pixel, and no such term.
        pixel = torch.cat([self.hits[1][any_pixel], robot_pixel], dim=1).clamp(max=math.prod(self.views.cameras.size) - 1)
        target = self.views.shown(sample[:, None], camera, pixel).float()
        directions = self.views.cameras.directions(camera, pixel)
        offsets = torch.rand(*camera.shape, SAMPLES, generator=numbers, device=device)
        found = self.mask(training.clouds.conditions[sample], self.views.cameras.centres[camera], directions, offsets)
        errors = (found - target).square()
        every, robot = errors[:, : rays[1]], errors[:, rays[1] :]
        shown = total[:, 0] * self.parts[1]
        loss: Tensor = self.parts[0] * every.mean() + MASK_WEIGHT * (robot.mean(dim=1) * shown).mean()
        return loss

    @torch.no_grad()
    def opacity(self, condition: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Opacities of samples on the points of a grid (X, Y, Z) over the workspace, its origin (3,) and its spacing ()."""
        size = self.high - self.low
        spacing = size.max() / CELLS
        counts = [int(count) for count in (size / spacing).ceil().tolist()]
        axes = [torch.arange(count, device=self.device) for count in counts]
        places = torch.stack(torch.meshgrid(*axes, indexing="ij"), dim=-1).reshape(-1, 3)
        found = []
        for part in torch.split(places, QUERY):
            density, visibility = self.field((self.low + spacing * (part + 0.5))[None], condition[None])
            found.append((visibility * -torch.expm1(-density))[0])
        return torch.cat(found).view(counts), self.low + 0.5 * spacing, spacing

    @torch.no_grad()
    def points(self, conditions: Tensor, count: int, seeds: Sequence[int]) -> Tensor:
        """Points where the opacity crosses one half between neighbours of a grid, drawn at random, and moved at random by up to
        half a cell along the two other axes where there are fewer than are asked for."""
        clouds = []
        for condition, numbers in zip(conditions, self.generators(seeds), strict=True):
            opacity, origin, spacing = self.opacity(condition)
            places, axes = crossings(opacity)
            order = torch.rand(len(places), generator=numbers, device=self.device).argsort()
            rounds = -(-count // len(places))
            chosen = order.repeat(rounds)[:count]
            moved = torch.rand(count, 3, generator=numbers, device=self.device) - 0.5
            moved = moved.scatter(1, axes[chosen][:, None], 0.0) if rounds > 1 else torch.zeros_like(moved)
            clouds.append(origin + spacing * (places[chosen] + moved))
        return torch.stack(clouds)

    def optimizer(self, settings: Settings) -> torch.optim.Optimizer:
        """Adam, in one kernel on a GPU."""
        fused = self.device.type == "cuda"
        return torch.optim.Adam(self.parameters(), lr=settings.learning_rate, fused=fused)


def octaves(points: Tensor) -> Tensor:
    """Points (..., 3) with the sines and cosines of their products with 1, 2, 4, ... (..., 3 + 6 OCTAVES)."""
    factors = 2.0 ** torch.arange(OCTAVES, device=points.device, dtype=points.dtype)
    angles = (points[..., None, :] * factors[:, None]).flatten(-2)
    return torch.cat([points, angles.sin(), angles.cos()], dim=-1)


def composite(depth: Tensor, visibility: Tensor) -> Tensor:
    """Masks (...) of rays of samples (..., K) with these optical depths and visibilities (Max 1995, absorption and emission)."""
    through = torch.exp(-(depth.cumsum(dim=-1) - depth))
    return (through * -torch.expm1(-depth) * visibility).sum(dim=-1)


def crossings(opacity: Tensor) -> tuple[Tensor, Tensor]:
    """Places (K, 3) on the edges of a grid (X, Y, Z), in cells, where the opacity crosses one half, and their axes (K,).

    Where it is nowhere so large it is half of the largest that counts, and all points of the grid where all are alike.
    """
    level = torch.minimum(opacity.new_tensor(INSIDE), 0.5 * (opacity.amax() + opacity.amin()))
    found, axes = [], []
    for axis in range(3):
        length = opacity.shape[axis] - 1
        a, b = opacity.narrow(axis, 0, length), opacity.narrow(axis, 1, length)
        corners = ((a > level) != (b > level)).nonzero()
        start, end = a[tuple(corners.T)], b[tuple(corners.T)]
        places = corners.to(opacity.dtype)
        places[:, axis] += (level - start) / (end - start)
        found.append(places)
        axes.append(torch.full((len(places),), axis, device=opacity.device))
    if not sum(len(part) for part in found):
        everywhere = torch.ones_like(opacity).nonzero()
        return everywhere.to(opacity.dtype), torch.zeros(len(everywhere), dtype=torch.long, device=opacity.device)
    return torch.cat(found), torch.cat(axes)

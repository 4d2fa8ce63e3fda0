"""VSM: signed distances under a command (Chen, Kwiatkowski, Vondrick, Lipson: Fully body visual self-modeling of robot
morphologies, Science Robotics 7, 2022).

A network of sines (SIREN, Sitzmann et al. 2020) is fitted to points and normals of the surface by the eikonal loss; a cloud is
points of its zero level, uniform by area. Its coordinates are those of a cube: the box of all training clouds is centred in it.
"""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, ClassVar, Self

import torch
from torch import Tensor, nn
from torch.nn import functional

from tdcr.torch.baselines._level import Grid, sample
from tdcr.torch.baselines._method import Method, Training, load
from tdcr.torch.baselines._normals import surfaces_of

#: Factor of the sines' arguments.
OMEGA = 30.0

#: Half the edge of the cube that the distance is learned in, and half the longest edge of the training clouds' box in it: between
#: them no surface is expected, so that what meets the cube's boundary is none.
CUBE, BOX = 0.8, 0.7

#: Points of every training cloud whose normals are found.
SURFACE_POINTS = 4096

#: Weights of the loss, and the sharpness of what keeps zeros away from points off the surface.
ON_SURFACE, OFF_SURFACE, ALONG_NORMALS, EIKONAL, SHARPNESS = 3000.0, 100.0, 100.0, 50.0, 100.0

#: Points that a level is evaluated at, at a time.
CHUNK = 1 << 17


def sine_layer(features: int, out: int, bound: float) -> nn.Linear:
    """A layer whose weights are uniform up to a bound, of a network of sines."""
    layer = nn.Linear(features, out)
    with torch.no_grad():
        layer.weight.uniform_(-bound, bound)
    return layer


class Vsm(Method):
    """f(x, command), below zero inside the robot, of points x in the cube and commands in [-1, 1]."""

    name: ClassVar[str] = "vsm"

    def __init__(self, condition_dim: int, center: Sequence[float], factor: float, features: int = 256) -> None:
        """`center` and `factor` take points in the data's units into the cube: (x - center) factor."""
        super().__init__()
        load("skimage.measure", "the baseline VSM", "scikit-image")
        load("scipy.sparse", "the baseline VSM", "scipy")
        self.condition_dim, self.factor, self.features = condition_dim, factor, features
        self.center = [float(value) for value in center]
        half, inner = features // 2, math.sqrt(6.0 / features) / OMEGA
        narrow = math.sqrt(6.0 / half) / OMEGA
        self.position = sine_layer(3, half, 1.0 / 3.0)
        first = sine_layer(condition_dim, half, 1.0 / condition_dim)
        self.command = nn.ModuleList([first, *(sine_layer(half, half, narrow) for _ in range(3))])
        self.joined = nn.ModuleList(sine_layer(2 * half, 2 * half, inner) for _ in range(3))
        self.last = sine_layer(2 * half, 1, inner)
        self.surfaces: tuple[Tensor, Tensor] | None = None

    @classmethod
    def defaults(cls, device: torch.device) -> dict[str, Any]:
        """The publication's batch and points on a GPU; fewer on a processor, for as many steps as a run needs."""
        common = {"learning_rate": 1e-4, "clip_norm": 100.0}
        if device.type == "cuda":
            return common | {"batch": 32, "points": 2400, "precision": "tf32"}
        return common | {"batch": 16, "points": 256}

    @classmethod
    def start(cls, training: Training) -> Self:
        """New weights, and the cube about the training clouds."""
        rows = training.clouds.rows[..., :3]
        low, high = rows.amin(dim=(0, 1)), rows.amax(dim=(0, 1))
        factor = BOX / (float((high - low).max()) / 2)
        return cls(training.clouds.condition_dim, ((low + high) / 2).tolist(), factor)

    def shape(self) -> dict[str, Any]:
        """Arguments of the constructor."""
        return {
            "condition_dim": self.condition_dim,
            "center": self.center,
            "factor": self.factor,
            "features": self.features,
        }

    def prepare(self, training: Training) -> None:
        """Finds the normals of the training clouds."""
        clouds = training.clouds.rows
        training.tell(f"finds the normals of {len(clouds)} clouds")
        points, normals = surfaces_of(clouds[..., :3].cpu().numpy(), SURFACE_POINTS, training.settings.seed, training.scale)
        in_cube = (torch.from_numpy(points).to(training.device) - self.center_on(training.device)) * self.factor
        self.surfaces = (in_cube, torch.from_numpy(normals).to(training.device))

    def center_on(self, device: torch.device) -> Tensor:
        """The cube's centre (3,) in the data's units."""
        return torch.tensor(self.center, device=device, dtype=self.last.weight.dtype)

    def encode(self, conditions: Tensor) -> Tensor:
        """Features (B, F / 2) of conditions (B, D) in [0, 1]."""
        features = 2.0 * conditions - 1.0
        for layer in self.command:
            features = torch.sin(OMEGA * layer(features))
        return features

    def distance(self, x: Tensor, features: Tensor) -> Tensor:
        """Signed distances (B, N) of points (B, N, 3) in the cube, under commands of these features (B, F / 2)."""
        place = torch.sin(OMEGA * self.position(x))
        # The product with the joined features is the sum of those with its halves, of which one is the same for a whole cloud.
        half = self.features // 2
        first, *others = self.joined
        assert isinstance(first, nn.Linear)
        weight = first.weight
        of_command = functional.linear(features, weight[:, half:], first.bias)[:, None]
        hidden = torch.sin(OMEGA * (functional.linear(place, weight[:, :half]) + of_command))
        for layer in others:
            hidden = torch.sin(OMEGA * layer(hidden))
        found: Tensor = self.last(hidden)[..., 0]
        return found

    def loss(self, training: Training, step: int, numbers: torch.Generator) -> Tensor:
        """The eikonal loss on points of the surface and as many in the cube."""
        assert self.surfaces is not None, "prepare comes first"
        settings, (points, normals) = training.settings, self.surfaces
        which = torch.randint(len(points), (settings.batch,), generator=numbers, device=training.device)
        count = (settings.batch, settings.points)
        places = torch.randint(points.shape[1], count, generator=numbers, device=training.device)
        anywhere = torch.rand(*count, 3, generator=numbers, device=training.device)
        surface, outward = points[which[:, None], places], normals[which[:, None], places]
        return self.eikonal(surface, outward, CUBE * (2.0 * anywhere - 1.0), training.clouds.conditions[which])

    def eikonal(self, surface: Tensor, normals: Tensor, anywhere: Tensor, conditions: Tensor) -> Tensor:
        """The loss on points (B, N, 3) of the surface, its normals (B, N, 3), points (B, N, 3) of the cube and conditions (B, D).

        Means are over all 2 N points, as in the publication of SIREN (its equation 6).
        """
        x = torch.cat([surface, anywhere], dim=1).requires_grad_()
        values = self.distance(x, self.encode(conditions))
        (slopes,) = torch.autograd.grad(values.sum(), x, create_graph=True)
        on = surface.shape[1]
        misses = ON_SURFACE * values[:, :on].abs().mean() + OFF_SURFACE * (-SHARPNESS * values[:, on:].abs()).exp().mean()
        apart = (1.0 - functional.cosine_similarity(slopes[:, :on], normals, dim=-1)).mean()
        # Not the root of zero, whose derivative is none.
        steep = (slopes.square().sum(dim=-1) + 1e-12).sqrt()
        return 0.5 * (misses + ALONG_NORMALS * apart) + EIKONAL * (steep - 1.0).abs().mean()

    @torch.no_grad()
    def points(self, conditions: Tensor, count: int, seeds: Sequence[int]) -> Tensor:
        """Points of the zero levels, uniform by area."""
        encoded = self.encode(conditions)
        clouds = []
        # While a device evaluates the next level, a thread has the triangles of the last.
        with ThreadPoolExecutor(1) as pool:
            for features, seed in zip(encoded, seeds, strict=True):

                def level(x: Tensor, features: Tensor = features) -> Tensor:
                    x = x.to(self.device, self.last.weight.dtype)
                    parts = [self.distance(x[None, k : k + CHUNK], features[None])[0] for k in range(0, len(x), CHUNK)]
                    return torch.cat(parts).float().cpu()

                grid = Grid.of(level, CUBE)
                clouds.append(pool.submit(sample, grid, count, seed))
            found = torch.stack([torch.from_numpy(cloud.result()) for cloud in clouds])
        return found.to(self.device, self.last.weight.dtype) / self.factor + self.center_on(self.device)

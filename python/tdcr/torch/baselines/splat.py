"""Kinematic 3D Gaussians (Kerbl et al. 2023; Hu, Yu and Tan, "Learning high-fidelity robot self-model with articulated 3D
Gaussian splatting", 2025).

Gaussians are fitted to the pictures of one pose, the canonical one. Bones, ellipsoids that k-means finds among them, move with
the command by a network, and each Gaussian with its bones (linear blend skinning): from the mean m and covariance S,

    m' = sum_b w_b(m) (R_b (m - c_b) + c_b + t_b),   S' = A S A^T with A = sum_b w_b(m) R_b,

where w(m) is the softmax of -1/2 the squared Mahalanobis distances to the bones plus what a small network adds. The colour of a
Gaussian is of degree 1 in the direction u that it is seen from (spherical harmonics), which turns with it:

    c = sigmoid(c_0 + C_1 A^T u).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import torch
from torch import Tensor, nn
from torch.nn import functional

from tdcr.torch.baselines._method import Method, Settings, Training
from tdcr.torch.baselines._rasterise import Gaussians, Picture, rasterise
from tdcr.torch.baselines.views import Cameras, Views

#: Bones.
BONES = 7

#: Gaussians.
COUNT = 2000

#: Steps of the fit to the canonical pose, of all its pictures.
FIT_STEPS = 1500

#: Learning rates of the fit for means (in the data's units), logarithms of scales, rotations, opacities, colours and their
#: slopes: above those of Kerbl et al. but for opacities, as it has 20 times fewer steps, which see all pictures.
RATES = {"means": 5e-4, "scales": 1e-2, "rotations": 2e-3, "opacities": 5e-2, "colors": 2e-2, "shades": 2e-2}

#: Largest standard deviation of a Gaussian, relative to the mean distance of neighbours.
LARGEST = 3.0

#: Weights of what is added to the loss of colours: masks, their long-range distance, lengths that change, the skinning network.
MASK, LONG_RANGE, ELASTIC, SKIN = 1.0, 0.02, 10.0, 1e-3

#: Neighbours whose distances are compared in the canonical pose and in another.
NEIGHBOURS = 4

#: Width and height of the pictures of a prediction, relative to those of training.
ENLARGED = 2.5

#: Edge of the voxels that a fused cloud is thinned by (m, relative to a workspace of 0.35 m).
VOXEL = 0.002 / 0.35


@dataclass(frozen=True)
class Bones:
    """What a condition makes of the bones."""

    #: Rotations (B, BONES, 3, 3).
    rotations: Tensor
    #: Translations (B, BONES, 3), in the data's units.
    translations: Tensor


@dataclass(frozen=True)
class Moved:
    """Where bones carry the Gaussians, N times."""

    #: Means (N, G, 3).
    means: Tensor
    #: Covariances (N, G, 3, 3).
    covariances: Tensor
    #: What turned them: A (N, G, 3, 3).
    matrices: Tensor

    def repeated(self, times: int) -> Moved:
        """Each so many times in a row."""
        parts = (self.means, self.covariances, self.matrices)
        return Moved(*(part.repeat_interleave(times, dim=0) for part in parts))


class Splat(Method):
    """Gaussians that bones carry."""

    name: ClassVar[str] = "splat"
    learns_from = "colours"
    bone_centres: Tensor
    bone_factors: Tensor
    neighbours: Tensor
    spacing: Tensor
    camera_rotations: Tensor
    camera_centres: Tensor
    camera_lenses: Tensor

    def __init__(self, condition_dim: int, count: int = COUNT, cameras: int = 8, size: int = 100, width: int = 256) -> None:
        super().__init__()
        self.sizes = {"condition_dim": condition_dim, "count": count, "cameras": cameras, "size": size, "width": width}
        self.means = nn.Parameter(torch.zeros(count, 3))
        self.scales = nn.Parameter(torch.zeros(count, 3))
        self.rotations = nn.Parameter(torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(count, 1))
        self.opacities = nn.Parameter(torch.full((count,), 1.5))
        self.colors = nn.Parameter(torch.zeros(count, 3))
        #: Slopes of the colours by the direction of sight (count, 3, 3).
        self.shades = nn.Parameter(torch.zeros(count, 3, 3))
        self.motion = nn.Sequential(
            *(nn.Linear(condition_dim, width), nn.SiLU(), nn.Linear(width, width), nn.SiLU()),
            *(nn.Linear(width, width), nn.SiLU(), nn.Linear(width, 9 * BONES)),
        )
        self.skin = nn.Sequential(nn.Linear(3, 64), nn.SiLU(), nn.Linear(64, BONES))
        for last in (self.motion[-1], self.skin[-1]):
            assert isinstance(last, nn.Linear)
            # All at rest at first.
            nn.init.zeros_(last.bias)
            last.weight.data.mul_(0.01)
        #: Centres of the ellipsoids (BONES, 3), and the inverses of their covariances' Cholesky factors (BONES, 3, 3).
        self.register_buffer("bone_centres", torch.zeros(BONES, 3))
        self.register_buffer("bone_factors", torch.eye(3).repeat(BONES, 1, 1))
        self.register_buffer("neighbours", torch.zeros(count, NEIGHBOURS, dtype=torch.long))
        #: Mean distance of neighbours.
        self.register_buffer("spacing", torch.ones(()))
        self.register_buffer("camera_rotations", torch.eye(3).repeat(cameras, 1, 1))
        self.register_buffer("camera_centres", torch.zeros(cameras, 3))
        self.register_buffer("camera_lenses", torch.ones(cameras, 4))
        self.views: Views | None = None

    @classmethod
    def defaults(cls, device: torch.device) -> dict[str, Any]:
        """`points` are pictures of each sample in a step."""
        batch = 32 if device.type == "cuda" else 4
        return {"batch": batch, "points": 2, "learning_rate": 1e-3, "clip_norm": 1.0}

    @classmethod
    def start(cls, training: Training) -> Self:
        """Gaussians fitted to the training sample whose command is the nearest to the middle, and bones at rest."""
        clouds = training.clouds
        canonical = int((clouds.conditions - 0.5).square().sum(dim=-1).argmin())
        views = training.views()
        method = cls(clouds.condition_dim, min(COUNT, clouds.points_per_cloud), len(views.cameras), views.cameras.size[0])
        method = method.to(training.device)
        method.look_at(views)
        numbers = torch.Generator(training.device).manual_seed(training.settings.seed)
        method.begin(clouds.rows[canonical, :, :3], numbers)
        training.tell("fits the Gaussians to one pose")
        method.fit(views, canonical, FIT_STEPS)
        method.divide(numbers)
        return method

    def shape(self) -> dict[str, Any]:
        """Numbers of a condition, of Gaussians, cameras, pixels and units."""
        return self.sizes

    def prepare(self, training: Training) -> None:
        """Takes the pictures."""
        if self.views is None:
            self.views = training.views()

    def look_at(self, views: Views) -> None:
        """Takes these pictures for training, and their cameras for predictions."""
        self.views = views
        for name in ("rotations", "centres", "lenses"):
            getattr(self, f"camera_{name}").copy_(getattr(views.cameras, name))

    @torch.no_grad()
    def begin(self, cloud: Tensor, numbers: torch.Generator) -> None:
        """Places the Gaussians on points of a cloud (N, 3), as large as these are apart, grey."""
        chosen = torch.randperm(len(cloud), generator=numbers, device=cloud.device)[: len(self.means)]
        self.means.copy_(cloud[chosen])
        distances, found = torch.cdist(self.means, self.means).topk(NEIGHBOURS + 1, largest=False)
        self.neighbours.copy_(found[:, 1:])
        self.spacing.copy_(distances[:, 1:].mean())
        self.scales.copy_(distances[:, 1:].mean(dim=1, keepdim=True).clamp(min=1e-6).log().expand(-1, 3) - math.log(2))

    def fit(self, views: Views, sample: int, steps: int = FIT_STEPS, report: Callable[[Tensor], None] | None = None) -> None:
        """Fits all of the Gaussians to the pictures of a sample, at rest, at rates that fall as those of a run."""
        camera = torch.arange(len(views.cameras), device=self.device)
        colors, masks = views.images(torch.full_like(camera, sample), camera)
        optimizer = torch.optim.Adam([{"params": [getattr(self, name)], "lr": rate} for name, rate in RATES.items()])
        first = [group["lr"] for group in optimizer.param_groups]
        for step in range(steps):
            for group, rate in zip(optimizer.param_groups, first, strict=True):
                group["lr"] = rate * self.rate(step / steps)
            picture = rasterise(self.still(views.cameras, camera), views.cameras, camera)
            error = photometric(picture, colors, masks) + self.bounds()
            optimizer.zero_grad()
            torch.autograd.backward(error)
            optimizer.step()
            if report is not None:
                report(error.detach())

    @torch.no_grad()
    def divide(self, numbers: torch.Generator, rounds: int = 50) -> None:
        """Finds the bones: Lloyd's algorithm from centres that are far apart."""
        means = self.means.detach()
        first = torch.randint(len(means), (1,), generator=numbers, device=means.device)
        centres = means[first]
        while len(centres) < BONES:
            centres = torch.cat([centres, means[torch.cdist(means, centres).amin(dim=1).argmax()][None]])
        for _ in range(rounds):
            nearest = functional.one_hot(torch.cdist(means, centres).argmin(dim=1), BONES).to(means.dtype)
            centres = nearest.T @ means / nearest.sum(dim=0).clamp(min=1)[:, None]
        nearest = functional.one_hot(torch.cdist(means, centres).argmin(dim=1), BONES).to(means.dtype)
        apart = means[:, None] - centres
        covariances = torch.einsum("gb,gbi,gbj->bij", nearest, apart, apart) / nearest.sum(dim=0).clamp(min=1)[:, None, None]
        covariances += (0.5 * self.spacing) ** 2 * torch.eye(3, device=means.device)
        self.bone_centres.copy_(centres)
        self.bone_factors.copy_(torch.linalg.inv(torch.linalg.cholesky(covariances)))

    def canonical(self) -> Tensor:
        """Covariances (G, 3, 3) in the canonical pose."""
        half = rotation_matrices(self.rotations) * self.scales.exp()[:, None]
        return half @ half.mT

    def still(self, cameras: Cameras, camera: Tensor) -> Gaussians:
        """The canonical pose, as cameras (N,) see it."""
        pictures = len(camera)
        at_rest = torch.eye(3, dtype=self.means.dtype, device=self.device).expand(pictures, len(self.means), -1, -1)
        moved = Moved(self.means.expand(pictures, -1, -1), self.canonical().expand(pictures, -1, -1, -1), at_rest)
        return self.dressed(moved, cameras, camera)

    def dressed(self, moved: Moved, cameras: Cameras, camera: Tensor) -> Gaussians:
        """Gaussians where they were moved to, a set for each of the cameras (N,) that see them."""
        sight = functional.normalize(cameras.centres[camera][:, None] - moved.means, dim=-1)
        # In the Gaussians' own frames.
        own = (moved.matrices * sight[..., None]).sum(dim=-2)
        shaded = self.colors + (self.shades * own[..., None, :]).sum(dim=-1)
        return Gaussians(moved.means, moved.covariances, torch.sigmoid(self.opacities), torch.sigmoid(shaded))

    def weights(self) -> tuple[Tensor, Tensor]:
        """Weights (G, BONES) of the bones, and what the network adds to their logarithms."""
        apart = self.means[:, None] - self.bone_centres
        distances = torch.einsum("bij,gbj->gbi", self.bone_factors, apart).square().sum(dim=-1)
        added = self.skin(self.means)
        return torch.softmax(added - 0.5 * distances, dim=-1), added

    def pose(self, conditions: Tensor) -> Bones:
        """The bones under conditions (B, D)."""
        raw = self.motion(2 * conditions - 1).to(conditions.dtype).view(-1, BONES, 9)
        # Two columns of a rotation, made orthogonal (Zhou et al., "On the continuity of rotation representations", 2019).
        first, second = raw[..., :3] + raw.new_tensor([1.0, 0, 0]), raw[..., 3:6] + raw.new_tensor([0, 1.0, 0])
        x = functional.normalize(first, dim=-1)
        y = functional.normalize(second - (second * x).sum(dim=-1, keepdim=True) * x, dim=-1)
        rotations = torch.stack([x, y, torch.linalg.cross(x, y)], dim=-1)
        return Bones(rotations, raw[..., 6:])

    def moved(self, conditions: Tensor, weights: Tensor) -> Moved:
        """Where the Gaussians are under conditions (B, D)."""
        bones = self.pose(conditions)
        matrices = torch.einsum("gb,nbij->ngij", weights, bones.rotations)
        # sum_b w_b (R_b m + q_b) with q_b = c_b + t_b - R_b c_b.
        shifts = self.bone_centres + bones.translations - (bones.rotations @ self.bone_centres[..., None])[..., 0]
        means = (matrices @ self.means[..., None])[..., 0] + torch.einsum("gb,nbi->ngi", weights, shifts)
        return Moved(means, matrices @ self.canonical() @ matrices.mT, matrices)

    def loss(self, training: Training, step: int, numbers: torch.Generator) -> Tensor:
        """Colours within the robot, masks near and far, and what keeps lengths and the skinning network in bounds."""
        assert self.views is not None
        settings, device, views = training.settings, self.device, self.views
        sample = torch.randint(len(views), (settings.batch,), generator=numbers, device=device)
        shots = min(settings.points, len(views.cameras))
        order = torch.rand(settings.batch, len(views.cameras), generator=numbers, device=device).argsort(dim=1)
        camera = order[:, :shots].flatten()
        weights, added = self.weights()
        moved = self.moved(training.clouds.conditions[sample], weights)
        stretched = self.stretch(moved.means)
        gaussians = self.dressed(moved.repeated(shots), views.cameras, camera)
        colors, masks = views.images(sample.repeat_interleave(shots), camera)
        picture = rasterise(gaussians, views.cameras, camera)
        far = long_range(picture.opacity - masks, views.cameras.size) / masks.sum(dim=-1).clamp(min=1.0)
        error = photometric(picture, colors, masks) + LONG_RANGE * far.mean()
        return error + ELASTIC * stretched + SKIN * added.square().mean() + self.bounds()

    def stretch(self, means: Tensor) -> Tensor:
        """Mean squared relative change of the distances of neighbours in means (B, G, 3) from those of the canonical pose."""
        rest = (self.means[:, None] - self.means[self.neighbours]).square().sum(dim=-1)
        now = (means[:, :, None] - means[:, self.neighbours]).square().sum(dim=-1)
        scale = self.spacing**2
        return ((now - rest) / (rest + scale)).square().mean()

    def bounds(self) -> Tensor:
        """What Gaussians are larger than allowed."""
        return functional.relu(self.scales - (LARGEST * self.spacing).log()).square().mean()

    @torch.no_grad()
    def points(self, conditions: Tensor, count: int, seeds: Sequence[int]) -> Tensor:
        """Points drawn from depth pictures, fused and thinned by voxels; moved at random within them where there are few."""
        cameras = enlarged(self.cameras(), ENLARGED)
        camera = torch.arange(len(cameras), device=self.device)
        weights, _ = self.weights()
        clouds = []
        for condition, numbers in zip(conditions, self.generators(seeds), strict=True):
            moved = self.moved(condition[None], weights)
            gaussians = self.dressed(moved.repeated(len(camera)), cameras, camera)
            cloud = fused(rasterise(gaussians, cameras, camera), cameras)
            # Nothing seen: where the Gaussians are.
            cloud = moved.means[0] if len(cloud) == 0 else cloud
            order = torch.rand(len(cloud), generator=numbers, device=self.device).argsort()
            rounds = -(-count // len(cloud))
            shaken = VOXEL * (torch.rand(count, 3, generator=numbers, device=self.device) - 0.5)
            clouds.append(cloud[order.repeat(rounds)[:count]] + (shaken if rounds > 1 else 0.0))
        return torch.stack(clouds)

    def cameras(self) -> Cameras:
        """The cameras that it was trained with."""
        size = (self.sizes["size"], self.sizes["size"])
        return Cameras(self.camera_rotations, self.camera_centres, self.camera_lenses, size)

    def optimizer(self, settings: Settings) -> torch.optim.Optimizer:
        """Adam: networks at the run's rate, Gaussians at a tenth of the rates of their fit."""
        networks = [*self.motion.parameters(), *self.skin.parameters()]
        groups: list[dict[str, Any]] = [{"params": networks, "lr": settings.learning_rate}]
        groups += [{"params": [getattr(self, name)], "lr": 0.1 * rate} for name, rate in RATES.items()]
        return torch.optim.Adam(groups, fused=self.device.type == "cuda")


def photometric(picture: Picture, colors: Tensor, masks: Tensor) -> Tensor:
    """Mean absolute error of colours (N, P, 3) within masks (N, P), and of the masks relative to their areas."""
    area = masks.sum(dim=-1).clamp(min=1.0)
    inside = ((picture.colors - colors).abs().mean(dim=-1) * masks).sum(dim=-1) / area
    outline = (picture.opacity - masks).abs().sum(dim=-1) / area
    return (inside + MASK * outline).mean()


def long_range(residual: Tensor, size: tuple[int, int]) -> Tensor:
    """Squared norms (N,) of residuals (N, P) in H^-1, in pixels to the fourth.

    For small displacements it is the quadratic Wasserstein distance of the masks (Peyré, "Comparison between W2 distance and
    H^-1 norm, and localization of Wasserstein distance", 2018): its derivative also moves what does not overlap yet.
    """
    height, width = size
    spectrum = torch.fft.rfft2(residual.view(-1, height, width))
    rows = torch.fft.fftfreq(height, device=residual.device, dtype=residual.dtype)
    columns = torch.fft.rfftfreq(width, device=residual.device, dtype=residual.dtype)
    squares = (2 * math.pi) ** 2 * (rows[:, None].square() + columns.square())
    # A difference in area has no such norm. Frequencies of real pictures count twice but for the first and last column.
    kernel = torch.where(squares > 0.0, 1.0 / squares.clamp(min=1e-12), 0.0)
    twice = torch.full_like(columns, 2.0)
    twice[0] = 1.0
    if width % 2 == 0:
        twice[-1] = 1.0
    power = spectrum.real.square() + spectrum.imag.square()
    norms: Tensor = (power * (kernel * twice)).sum(dim=(-1, -2)) / (height * width)
    return norms


def rotation_matrices(quaternions: Tensor) -> Tensor:
    """Rotation matrices (..., 3, 3) of quaternions w, x, y, z (..., 4) of any length."""
    w, x, y, z = functional.normalize(quaternions, dim=-1).unbind(dim=-1)
    rows = [
        *(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        *(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        *(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    ]
    return torch.stack(rows, dim=-1).view(*w.shape, 3, 3)


def enlarged(cameras: Cameras, factor: float) -> Cameras:
    """The same cameras with more pixels."""
    height, width = (round(factor * side) for side in cameras.size)
    fx, fy, cx, cy = cameras.lenses.unbind(dim=-1)
    across, down = width / cameras.size[1], height / cameras.size[0]
    # Pixels have their centres at whole numbers, the picture its corner at -1/2.
    lenses = torch.stack([fx * across, fy * down, (cx + 0.5) * across - 0.5, (cy + 0.5) * down - 0.5], dim=-1)
    return replace(cameras, lenses=lenses, size=(height, width))


def fused(picture: Picture, cameras: Cameras) -> Tensor:
    """Points (K, 3) in the world where pictures of all cameras have a depth, one in each voxel."""
    camera, pixel = (picture.depth > 0.0).nonzero(as_tuple=True)
    rays = cameras.directions(camera, pixel)
    forward = (rays * cameras.rotations[camera, 2]).sum(dim=-1)
    points = cameras.centres[camera] + rays * (picture.depth[camera, pixel] / forward)[:, None]
    if len(points) == 0:
        return points
    cells, members = torch.unique((points / VOXEL).floor().long(), dim=0, return_inverse=True)
    sums = points.new_zeros(len(cells), 4).index_add_(0, members, functional.pad(points, (0, 1), value=1.0))
    return sums[:, :3] / sums[:, 3:]

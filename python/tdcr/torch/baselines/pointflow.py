"""PointFlow: a continuous normalising flow of points under a command (Yang, Huang, Hao, Liu, Belongie, Hariharan: PointFlow, ICCV
2019), by maximum likelihood.

A point y of the data's space follows dy/ds = T f(y, s T, command) from the data (s = 0) to the noise (s = 1), between two
normalisations by moving averages. Its log-likelihood is that of the normal distribution at the end, plus the integral of
the divergence and the logarithms of the normalisations' factors (FFJORD, Grathwohl et al. 2019).
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, ClassVar, Self

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.utils.checkpoint import checkpoint

from tdcr.torch.baselines._method import Method, Training, load

#: Standard deviation of the noise that is added to the points of a step (m): the likelihood of points on a surface is unbounded.
JITTER = 1e-3

#: Length of the flow's time at the start; it is learned.
TIME = 0.5

#: Tolerance of the solver, absolute and relative.
TOLERANCE = 1e-3

#: Share of a batch's moments in the moving ones, and what is added to variances.
DECAY, EPSILON = 0.1, 1e-4

#: Points that are solved for at a time in a prediction.
CHUNK = 1 << 17


class Moments(nn.Module):
    """Normalisation by the moments of all points of a batch, or their moving averages outside training, and a learned scale."""

    mean: Tensor
    variance: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(3))
        self.register_buffer("variance", torch.ones(3))
        self.weight, self.bias = nn.Parameter(torch.zeros(3)), nn.Parameter(torch.zeros(3))

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Normalised points (..., 3), and the logarithm of the map's determinant."""
        if self.training:
            flat = x.reshape(-1, 3)
            mean, variance = flat.mean(dim=0), flat.var(dim=0)
            with torch.no_grad():
                self.mean.lerp_(mean, DECAY)
                self.variance.lerp_(variance, DECAY)
        else:
            mean, variance = self.mean, self.variance
        logarithm = self.weight - 0.5 * (variance + EPSILON).log()
        return (x - mean) * logarithm.exp() + self.bias, logarithm.sum()

    def inverse(self, y: Tensor) -> Tensor:
        """Points (..., 3) of normalised ones, by the moving averages."""
        return (y - self.bias) * (0.5 * (self.variance + EPSILON).log() - self.weight).exp() + self.mean


class Velocity(nn.Module):
    """f(y, t, c): concatsquash layers with tanh between them, y -> (W y + b) sigmoid(gate(t, c)) + bias(t, c)."""

    def __init__(self, context: int, widths: Sequence[int]) -> None:
        super().__init__()
        sizes = [3, *widths, 3]
        self.layers = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(sizes))
        self.gates = nn.ModuleList(nn.Linear(context + 1, size) for size in sizes[1:])
        self.biases = nn.ModuleList(nn.Linear(context + 1, size, bias=False) for size in sizes[1:])

    def forward(self, y: Tensor, directions: Tensor, time: Tensor, context: Tensor) -> tuple[Tensor, Tensor]:
        """Velocities (B, N, 3) and their derivatives (K, B, N, 3) along directions (K, B, N, 3), for contexts (B, C).

        The derivatives are carried forward beside the values, so that a loss of both needs one backward pass.
        """
        with_time = torch.cat([time.expand(len(context), 1), context], dim=1)
        # Values and derivatives go through a layer's product together.
        rows = torch.cat([y[None], directions])
        for k, (layer, gate, bias) in enumerate(zip(self.layers, self.gates, self.biases, strict=True)):
            assert isinstance(layer, nn.Linear)
            opened = torch.sigmoid(gate(with_time))[:, None]
            shift = layer.bias * opened + bias(with_time)[:, None]
            products = functional.linear(rows, layer.weight) * opened
            value, slopes = products[:1] + shift, products[1:]
            if k + 1 < len(self.layers):
                value = torch.tanh(value)
                slopes = slopes * (1.0 - value.square())
            rows = torch.cat([value, slopes])
        return rows[0], rows[1:]


class Solved(nn.Module):
    """The right-hand side that a solver calls, of points (B, N, 3) and, where there are directions (K, B, N, 3), the integral
    (B, N) of the divergence's estimate: the mean of e . (df/dy e) times K / `samples`."""

    def __init__(self, flow: "PointFlow", context: Tensor, directions: Tensor, samples: int) -> None:
        super().__init__()
        self.flow, self.context, self.directions, self.samples = flow, context, directions, samples

    def forward(self, s: Tensor, state: tuple[Tensor, ...]) -> tuple[Tensor, ...]:
        """Derivatives of the state by s in [0, 1]."""
        length = self.flow.root_time.square()
        inputs = (state[0], self.directions, s * length, self.context)
        if torch.is_grad_enabled():
            # The layers' features are computed again in the backward pass: those of all evaluations would fill a GPU.
            value, slopes = checkpoint(self.flow.velocity, *inputs, use_reentrant=False, preserve_rng_state=False)
        else:
            value, slopes = self.flow.velocity(*inputs)
        if len(state) == 1:
            return (length * value,)
        return length * value, length * (slopes * self.directions).sum(dim=(0, -1)) / self.samples


class PointFlow(Method):
    """The flow, with an encoder of commands."""

    name: ClassVar[str] = "pointflow"

    def __init__(self, condition_dim: int, scale: float, widths: Sequence[int] = (512, 512, 512), encoder: int = 128) -> None:
        """`scale` is the length that points are divided by (m), `encoder` the features of a command."""
        super().__init__()
        self.solver = load("torchdiffeq", "the baseline PointFlow")
        self.condition_dim, self.scale, self.widths, self.features = condition_dim, scale, list(widths), encoder
        self.encoder = nn.Sequential(
            nn.Linear(condition_dim, encoder), nn.SiLU(), nn.Linear(encoder, encoder), nn.SiLU(), nn.Linear(encoder, encoder)
        )
        self.before, self.after = Moments(), Moments()
        self.velocity = Velocity(encoder, widths)
        self.root_time = nn.Parameter(torch.tensor(math.sqrt(TIME)))

    @classmethod
    def defaults(cls, device: torch.device) -> dict[str, Any]:
        """Many clouds a step, of few points each, as what has to be learned is mostly the command's part."""
        common = {"learning_rate": 1e-3, "clip_norm": 5.0}
        if device.type == "cuda":
            return common | {"batch": 128, "points": 64, "precision": "tf32"}
        return common | {"batch": 32, "points": 32}

    @classmethod
    def start(cls, training: Training) -> Self:
        """New weights; the first normalisation starts at the moments of the training clouds."""
        method = cls(training.clouds.condition_dim, training.scale)
        rows = training.clouds.rows[..., :3].reshape(-1, 3)
        method.before.mean.copy_(rows.mean(dim=0))
        method.before.variance.copy_(rows.var(dim=0))
        return method

    def shape(self) -> dict[str, Any]:
        """Arguments of the constructor."""
        return {
            "condition_dim": self.condition_dim,
            "scale": self.scale,
            "widths": self.widths,
            "encoder": self.features,
        }

    def loss(self, training: Training, step: int, numbers: torch.Generator) -> Tensor:
        """Mean negative log-likelihood of a point, with Hutchinson's estimate of the divergence."""
        which, places = training.draw(numbers)
        points = training.clouds.rows[which[:, None], places, :3]
        noise = torch.randn(points.shape, generator=numbers, device=training.device)
        directions = torch.randn((1, *points.shape), generator=numbers, device=training.device)
        jittered = points + JITTER / self.scale * noise
        return -self.log_likelihood(jittered, training.clouds.conditions[which], directions).mean()

    def log_likelihood(
        self, x: Tensor, conditions: Tensor, directions: Tensor | None = None, tolerance: float = TOLERANCE
    ) -> Tensor:
        """Logarithm (B, N) of the density of points (B, N, 3) under conditions (B, D), by the data's units cubed.

        The divergence is estimated by directions (K, B, N, 3) of unit covariance (Hutchinson), or exact without any.
        """
        samples = 1 if directions is None else len(directions)
        if directions is None:
            # The trace is the sum over the axes, not a mean.
            directions = torch.eye(3, dtype=x.dtype, device=x.device)[:, None, None].expand(3, *x.shape)
        y, first = self.before(x)
        right = Solved(self, self.encoder(conditions), directions, samples)
        state = (y, torch.zeros_like(y[..., 0]))
        z, divergence = self.solve(right, state, (0.0, 1.0), tolerance)
        z, last = self.after(z)
        normal = -0.5 * (z.square() + math.log(2 * math.pi)).sum(dim=-1)
        found: Tensor = normal + divergence + first + last
        return found

    def solve(self, right: Solved, state: tuple[Tensor, ...], ends: tuple[float, float], tolerance: float) -> tuple[Tensor, ...]:
        """The state at the second of two times, by dopri5."""
        times = torch.tensor(ends, dtype=state[0].dtype, device=state[0].device)
        found = self.solver.odeint(right, state, times, rtol=tolerance, atol=tolerance, method="dopri5")
        return tuple(values[-1] for values in found)

    @torch.no_grad()
    def points(self, conditions: Tensor, count: int, seeds: Sequence[int]) -> Tensor:
        """Points of the flow from normal noise, back along it."""
        dtype = self.root_time.dtype
        noise = torch.stack(
            [torch.randn(count, 3, generator=numbers, device=self.device, dtype=dtype) for numbers in self.generators(seeds)]
        )
        together = max(1, CHUNK // count)
        starts = range(0, len(noise), together)
        conditions = conditions.to(dtype)
        return torch.cat([self.of_noise(noise[k : k + together], conditions[k : k + together]) for k in starts])

    def of_noise(self, z: Tensor, conditions: Tensor, tolerance: float = TOLERANCE) -> Tensor:
        """Points (B, N, 3) of noise (B, N, 3)."""
        right = Solved(self, self.encoder(conditions), z.new_zeros((0, *z.shape)), 1)
        (y,) = self.solve(right, (self.after.inverse(z),), (1.0, 0.0), tolerance)
        return self.before.inverse(y)

"""The flow: its path from noise to data, the loss, and the samplers, which take the steps of `tdcr predict`.

Points are in the units of the data set's normalisation, times in [0, 1] from noise to data. Shapes: B clouds of N points of
C numbers, D values of a condition.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal, Self

import numpy as np
import torch
from torch import Tensor

from tdcr.errors import InputError

#: A velocity field: points (B, N, C), flow times (B,), conditions (B, D) to velocities (B, N, C).
Field = Callable[[Tensor, Tensor, Tensor], Tensor]


#: Range of 1 - t for late flow times.
LATE_TIMES = (0.003, 0.15)


@dataclass(frozen=True)
class FlowPath:
    """Straight paths from the prior to the data: positions start as N(0, deviation^2), colours uniform in [0, 1].

    X_t = (1 - t) X_0 + t X_1 has the velocity X_1 - X_0; t is of the distribution Beta(exponent, 1). A share `late_times` of the
    times is drawn near the data instead, 1 - t log-uniform in LATE_TIMES; `prior_cut` is the distance from the origin, in
    deviations, beyond which no position starts. The defaults are the paper's.
    """

    prior_deviation: float = 0.5
    time_exponent: float = 3.0
    late_times: float = 0.0
    prior_cut: float | None = None

    @classmethod
    def of(cls, settings: Mapping[str, Any]) -> Self:
        """The path of a run's settings."""
        path = settings["path"]
        return cls(path["prior_deviation"], path["time_exponent"], path.get("late_times", 0.0), path.get("prior_cut"))

    def prior(self, shape: tuple[int, ...], generator: torch.Generator) -> Tensor:
        """Samples (..., C) of the prior, on the generator's device."""
        device = generator.device
        normal = torch.randn(*shape[:-1], 3, generator=generator, device=device)
        # Positions beyond the cut are drawn anew.
        while self.prior_cut is not None:
            beyond = torch.linalg.vector_norm(normal, dim=-1) > self.prior_cut
            if not (count := int(beyond.sum())):
                break
            normal[beyond] = torch.randn(count, 3, generator=generator, device=device)
        positions = self.prior_deviation * normal
        colors = torch.rand(*shape[:-1], shape[-1] - 3, generator=generator, device=device)
        return torch.cat([positions, colors], dim=-1)

    def times(self, count: int, generator: torch.Generator) -> Tensor:
        """Flow times (count,)."""
        uniform, choice = torch.rand(2, count, generator=generator, device=generator.device)
        least, most = map(math.log, LATE_TIMES)
        late = 1 - torch.exp(least + (most - least) * uniform)
        return torch.where(choice < self.late_times, late, uniform ** (1 / self.time_exponent))


def loss(velocities: Tensor, targets: Tensor, color_weight: float = 0.05) -> Tensor:
    """Mean squared error of the positions' velocities, plus that of the colours', weighted."""
    error = (velocities - targets) ** 2
    positions = error[..., :3].mean()
    return positions + color_weight * error[..., 3:].mean() if error.shape[-1] > 3 else positions


#: What a multistep method extrapolates (whether the data prediction, else the velocity), and its order.
MULTISTEP = {
    "euler": (False, 1),
    "adams-bashforth": (False, 2),
    "exponential": (True, 2),
    "exponential3": (True, 3),
}

METHODS = ["heun", *MULTISTEP]

#: Of the default sampler.
DENOISE, SPARE = 0.995, 0.5


@dataclass(frozen=True)
class Sampler:
    """How a velocity field is integrated from prior to data; the default is that of `tdcr predict`.

    `method` is heun (the paper's), euler, adams-bashforth, exponential or exponential3; the times of its `steps` steps are
    t_k = 1 - (1 - k / steps)^power. A last evaluation at the time `denoise` takes the points X to the data predicted there,
    X + (1 - t) u; none without. `spare` is a share of points to draw beyond those asked for: isolated and
    crowded ones are left out of a cloud, and the others moved apart along the surface. `colors` says what becomes of
    colours between steps: free, or clamped to [0, 1] after each (the paper's authors).
    """

    method: str = "exponential"
    steps: int = 16
    power: float = 2.0
    denoise: float | None = DENOISE
    spare: float = SPARE
    colors: Literal["free", "clamped"] = "free"

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise InputError(f"the sampler's method is {self.method!r}; expected one of {', '.join(METHODS)}")
        if not 1 <= self.steps <= 100_000:
            raise InputError(f"the sampler's steps are {self.steps}; expected 1 to 100000")
        if not 1 <= self.power <= 10:
            raise InputError(f"the sampler's power is {self.power}; expected 1 to 10")
        if self.denoise is not None and not 0 <= self.denoise < 1:
            raise InputError(f"the sampler's denoising time is {self.denoise}; expected 0 to below 1, or None")
        if not 0 <= self.spare <= 1:
            raise InputError(f"the sampler's share of spare points is {self.spare}; expected 0 to 1")
        if self.colors not in ("free", "clamped"):
            raise InputError(f"the sampler's colors are {self.colors!r}; expected free or clamped")

    @classmethod
    def of(cls, settings: Mapping[str, Any]) -> Self:
        """The sampler of a run's settings.

        Raises:
            tdcr.errors.InputError: where its steps are adaptive, which those of one cloud are.
        """
        sampler = settings["sampler"]
        grid = sampler["grid"]
        if grid == "uniform":
            grid = {"power": 1.0}
        if "power" not in grid:
            raise InputError(f"the model's sampler has the grid {grid}; expected fixed steps: say which Sampler to take")
        method, last = (
            sampler.get("method", "heun"),
            (sampler.get("denoise"), sampler.get("spare", 0.0), sampler.get("colors", "free")),
        )
        return cls(method, sampler["steps"], grid["power"], *last)

    def to_settings(self) -> dict[str, Any]:
        """As the settings of a run have it."""
        grid = "uniform" if self.power == 1 else {"power": self.power}
        return {
            "method": self.method,
            "steps": self.steps,
            "grid": grid,
            "denoise": self.denoise,
            "spare": self.spare,
            "colors": self.colors,
        }

    @property
    def evaluations(self) -> int:
        """Evaluations of the field."""
        return self.steps * (2 if self.method == "heun" else 1) + (self.denoise is not None)

    def drawn(self, points: int) -> int:
        """Points that are integrated for a cloud of `points`."""
        return points + math.ceil(float(np.float32(self.spare)) * points)

    def bound(self, points: Tensor) -> Tensor:
        """The points (B, N, C) after a step, their colours clamped if that is asked for."""
        if self.colors == "free":
            return points
        return torch.cat([points[..., :3], points[..., 3:].clamp(0, 1)], -1)

    def times(self) -> list[float]:
        """The times of the steps' ends, from 0 to 1, as float32 has them."""
        share = 1 - np.arange(self.steps + 1) / self.steps
        times: list[float] = (1 - share**self.power).astype(np.float32).tolist()
        return times


#: A box of positions in normalised units, beyond which no data are: its corners `min` and `max`, as a model file has them.
Reach = Mapping[str, list[float]]

#: Of data that are known by their normalisation alone.
NORMALISED: Reach = {"min": [-1.0] * 3, "max": [1.0] * 3}

#: What a box of training data is widened by on each side.
MARGIN = 0.02


def reach_of(rows: Tensor) -> Reach:
    """The box of the positions in rows (..., C), with some margin."""
    positions = rows[..., :3].reshape(-1, 3)
    return {"min": (positions.amin(0) - MARGIN).tolist(), "max": (positions.amax(0) + MARGIN).tolist()}


def bounded(reach: Reach, t: float, points: Tensor, velocities: Tensor) -> Tensor:
    """The velocities at time t, such that the data that they point at, X + (1 - t) u, lie in the box; those that do so stay."""
    if t >= 1:
        return velocities
    low, high = (points.new_tensor(reach[corner]) for corner in ("min", "max"))
    data = points[..., :3] + (1 - t) * velocities[..., :3]
    within = torch.minimum(torch.maximum(data, low), high)
    # What is not finite is an error, and to be seen as one.
    keep = (within == data) | ~data.isfinite()
    positions = torch.where(keep, velocities[..., :3], (within - points[..., :3]) / (1 - t))
    return torch.cat([positions, velocities[..., 3:]], -1)


def integrate(
    field: Field,
    points: Tensor,
    conditions: Tensor,
    sampler: Sampler | None = None,
    last: Field | None = None,
    reach: Reach | None = None,
) -> Tensor:
    """Moves samples of the prior (B, N, C) to data (B, N, C), under conditions (B, D).

    `last` is the field of the last denoising, where it is another one: a model's refinement, which then corrects its own points
    (:func:`corrected`). Where `reach` says where data are,
    velocities are bounded to point there: a learned one may carry points off from places that the training hardly knows.
    """
    sampler = sampler or Sampler()

    def velocity(t: float, x: Tensor) -> Tensor:
        u = field(x, x.new_full((len(x),), t), conditions).to(x.dtype)
        return u if reach is None else bounded(reach, t, x, u)

    times = sampler.times()
    if sampler.method == "heun":
        data = heun(velocity, points, times, sampler.bound)
    else:
        data = multistep(velocity, points, times, *MULTISTEP[sampler.method], sampler.bound)
    if sampler.denoise is None:
        return data
    field = last or field
    data = sampler.bound(data + (1 - sampler.denoise) * velocity(sampler.denoise, data))
    return data if last is None else corrected(velocity, sampler.denoise, data)


#: Displacement half of which is made in the correction of what a refinement leaves beside the surface: about half a millimetre.
HALFWAY = 1.25e-3


def corrected(velocity: Callable[[float, Tensor], Tensor], t: float, x: Tensor) -> Tensor:
    """The points x (B, N, C) after one more evaluation at the time t of the last denoising, `velocity` its field.

    With the displacement d there, positions move by d |d|^2 / (|d|^2 + HALFWAY^2): nearly all of the way where they are far off,
    hardly where they are on the surface. Colours stay.
    """
    step = (1 - t) * velocity(t, x)[..., :3]
    squared = (step**2).sum(-1, keepdim=True)
    return torch.cat([x[..., :3] + squared / (squared + HALFWAY**2) * step, x[..., 3:]], -1)


#: Points after a step from where it took them.
Bound = Callable[[Tensor], Tensor]


def heun(velocity: Callable[[float, Tensor], Tensor], x: Tensor, times: list[float], bound: Bound) -> Tensor:
    """Heun's method (improved Euler)."""
    for start, end in pairwise(times):
        h = end - start
        u = velocity(start, x)
        x = bound(x + 0.5 * h * (u + velocity(end, x + h * u)))
    return x


def multistep(
    velocity: Callable[[float, Tensor], Tensor], x: Tensor, times: list[float], of_data: bool, order: int, bound: Bound
) -> Tensor:
    """A linear multistep method: one evaluation a step.

    What is extrapolated is the polynomial through its last values, in Newton's divided differences f_0, f_1, f_2; the
    differential equation with it is solved exactly (Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I,
    Sec. III.5; for the data prediction D = X + (1 - t) u, DPM-Solver++: Lu et al., 2022). The second step adds the
    second-order term that the first one lacked.
    """
    weights = data_weights if of_data else velocity_weights
    differences: list[Tensor] = []
    past: list[float] = []
    for start, end in pairwise(times):
        if start == end:
            continue
        u = velocity(start, x)
        updated = [x + (1 - start) * u if of_data else u]
        for before, t in zip(differences[: order - 1], past, strict=False):
            updated.append((updated[-1] - before) / (start - t))
        owed = weights(past[0], start, 0.0)[1][1] if len(past) == 1 and order > 1 else 0.0
        gap = start - past[0] if past else 0.0
        differences, past = updated, [start, *past[:1]]
        keep, terms = weights(start, end, gap)
        terms = [terms[0], terms[1] + keep * owed, terms[2]]
        x = keep * x
        for weight, difference in zip(terms, differences, strict=False):
            x = x + weight * difference
        x = bound(x)
    return x


#: Weights of a step from `start` to `end`, `gap` after the evaluation before: of the points, and of f_0, f_1, f_2.
Weights = tuple[float, list[float]]


def velocity_weights(start: float, end: float, gap: float) -> Weights:
    """Of dX/dt = u(t)."""
    h = end - start
    return 1.0, [h, h * h / 2, h * h * (h / 3 + gap / 2)]


def data_weights(start: float, end: float, gap: float) -> Weights:
    """Of dX/dt = (D(t) - X) / (1 - t)."""
    h, v, v_end = end - start, 1 - start, 1 - end
    logarithm = v_end * math.log(v / v_end) if v_end > 0 else 0.0
    first = h - logarithm
    return v_end / v, [h / v, first, h * (v + v_end) - 2 * v * logarithm + gap * first]

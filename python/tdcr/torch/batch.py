"""Batches of training, and the distance that validates."""

import numpy as np
import torch
from torch import Tensor

from tdcr.torch.data import CloudSet
from tdcr.torch.flow import FlowPath
from tdcr.torch.settings import Settings

#: Purposes of random numbers.
STEP, VALIDATION, EPOCH = 1, 2, 3


def generator(device: torch.device, seed: int, purpose: int, index: int) -> torch.Generator:
    """The random numbers of a purpose: a function of these numbers and of the kind of device."""
    state = np.random.SeedSequence([seed, purpose, index]).generate_state(1, np.uint64)
    return torch.Generator(device).manual_seed(int(state[0]))


def shuffled(clouds: int, settings: Settings, step: int, device: torch.device) -> Tensor:
    """The clouds of a step in the random order of its epoch, whose last clouds are dropped where they fill no batch."""
    batch = settings["clouds"]
    epoch, place = divmod(step - 1, clouds // batch)
    order = torch.randperm(clouds, generator=generator(device, settings["seed"], EPOCH, epoch), device=device)
    return order[place * batch : (place + 1) * batch]


def draw(
    clouds: CloudSet, settings: Settings, step: int, rank: int = 0, ranks: int = 1, *, epochs: bool = False
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """The rank's part of the batch of a step: points (B, N, C) between noise and data, times (B,), conditions (B, D), and the
    velocities (B, N, C) to learn. Clouds are drawn with replacement, or in `epochs` without; points of each without."""
    device = clouds.rows.device
    numbers = generator(device, settings["seed"], STEP, step)
    batch, points = settings["clouds"], settings["points"]
    path = FlowPath.of(settings)
    if epochs:
        which = shuffled(len(clouds), settings, step, device)
    else:
        which = torch.randint(len(clouds), (batch,), generator=numbers, device=device)
    times = path.times(batch, numbers)
    order = torch.rand(batch, clouds.points_per_cloud, generator=numbers, device=device)
    noise = path.prior((batch, points, clouds.rows.shape[-1]), numbers)
    which, times, order, noise = (part[rank::ranks] for part in (which, times, order, noise))
    # The places of the largest of as many random numbers are a random subset.
    chosen = order.topk(points, dim=1).indices
    data = clouds.rows[which[:, None], chosen]
    t = times[:, None, None]
    return (1 - t) * noise + t * data, times, clouds.conditions[which], data - noise


def chamfer(a: Tensor, b: Tensor) -> float:
    """Squared Chamfer distance of two clouds (N, 3) and (M, 3): means of squared distances to the nearest point, added."""
    squared = torch.cdist(a, b, compute_mode="donot_use_mm_for_euclid_dist") ** 2
    return float(squared.amin(dim=1).mean(dtype=torch.float64) + squared.amin(dim=0).mean(dtype=torch.float64))

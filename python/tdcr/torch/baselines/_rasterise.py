"""Pictures of 3D Gaussians, differentiable by all that they are made of.

Formulas of Kerbl, Kopanas, Leimkühler and Drettakis, "3D Gaussian splatting for real-time radiance field rendering" (2023), and
of Zwicker, Pfister, van Baar and Gross, "EWA splatting" (2002), whose affine approximation of the projection they use:

    S' = J W S W^T J^T + 0.3 I,   a = min(0.99, o exp(-d^T S'^-1 d / 2)),   pixel = sum_i c_i a_i prod_{j < i} (1 - a_j),

for Gaussians in the order of their depths, those with a below 1/255 left out, until the product would fall below 1e-4.

On a processor and in single precision the native module blends (`_blend`). Elsewhere PyTorch does (`blended`): instead of tiles,
the pairs of a Gaussian and a pixel within the rectangle around its ellipse a >= 1/255 are listed and sorted by pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from tdcr.torch.baselines._blend import blend
from tdcr.torch.baselines.views import Cameras

#: Variance that the projected Gaussians are widened by (pixels squared).
DILATION = 0.3

#: Bounds of the opacity of a Gaussian in a pixel.
LEAST_OPACITY, MOST_OPACITY = 1.0 / 255.0, 0.99

#: Transmittance at which a pixel is done.
LEAST_TRANSMITTANCE = 1e-4

#: Distance from the camera's plane below which Gaussians are not seen, relative to the data's scale.
NEAR = 0.01

#: How far outside of the picture, relative to half of it, the projection is linearised at most.
CLAMP = 1.3


@dataclass(frozen=True)
class Gaussians:
    """G Gaussians in each of N pictures, in the world's frame."""

    #: Means (N, G, 3).
    means: Tensor
    #: Covariances (N, G, 3, 3).
    covariances: Tensor
    #: Opacities (G,).
    opacities: Tensor
    #: Colours (N, G, C).
    colors: Tensor


@dataclass(frozen=True)
class Projected:
    """Gaussians on the image plane of their picture."""

    #: Means (N, G, 2): column and row (pixels).
    means: Tensor
    #: Covariances (N, G, 3): xx, xy, yy (pixels squared).
    covariances: Tensor
    #: Depths (N, G).
    depths: Tensor


@dataclass(frozen=True)
class Picture:
    """N pictures of P pixels."""

    #: Colours (N, P, C), black where nothing is.
    colors: Tensor
    #: Opacities (N, P).
    opacity: Tensor
    #: Depths at which the transmittance falls to one half (N, P), without derivatives; 0 where the opacity is below that.
    depth: Tensor


def rasterise(gaussians: Gaussians, cameras: Cameras, camera: Tensor) -> Picture:
    """Pictures of Gaussians by cameras (N,), one for each of the N sets of Gaussians."""
    seen = project(gaussians.means, gaussians.covariances, cameras, camera)
    if seen.means.device.type == "cpu" and seen.means.dtype == torch.float32:
        colors, opacity, depth = blend(
            seen.means, seen.covariances, seen.depths, gaussians.opacities, gaussians.colors, *cameras.size, NEAR
        )
        return Picture(colors, opacity, depth.detach())
    return blended(seen, gaussians.opacities, gaussians.colors, cameras.size)


def blended(seen: Projected, opacities: Tensor, colors: Tensor, size: tuple[int, int]) -> Picture:
    """Pictures of `size` pixels, height and width, of Gaussians on their planes with opacities (G,) and colours (N, G, C)."""
    pictures, pixels = len(seen.depths), size[0] * size[1]
    pairs = pair(seen, opacities, size)
    # What pairs look up, in one table: mean, covariance, opacity, colour.
    shared = opacities[:, None].expand(pictures, -1, -1)
    table = torch.cat([seen.means, seen.covariances, shared, colors], dim=-1).flatten(0, 1)
    looked = table.index_select(0, pairs.row)
    opacity = footprint(looked[:, :5], looked[:, 5], pairs.place)
    channels = torch.cat([looked[:, 6:], torch.ones_like(looked[:, :1])], dim=-1)
    found, through = Blend.apply(opacity, channels, pairs.pixel, pictures * pixels)
    depth = median(seen.depths.detach().flatten(), pairs, opacity.detach(), through, pictures * pixels)
    found = found.view(pictures, pixels, -1)
    return Picture(found[..., :-1], found[..., -1], depth.view(pictures, pixels))


def project(means: Tensor, covariances: Tensor, cameras: Cameras, camera: Tensor) -> Projected:
    """Means (N, G, 3) and covariances (N, G, 3, 3) on the image planes of cameras (N,)."""
    turn, lens = cameras.rotations[camera], cameras.lenses[camera]
    local = (means - cameras.centres[camera][:, None]) @ turn.mT
    x, y, z = local.unbind(dim=-1)
    inverse = 1.0 / z.clamp(min=NEAR)
    fx, fy, cx, cy = (part[:, None] for part in lens.unbind(dim=-1))
    centres = torch.stack([fx * x * inverse + cx, fy * y * inverse + cy], dim=-1)
    # The projection is linearised within the picture, as it is far from linear at its side.
    height, width = cameras.size
    edge_x, edge_y = CLAMP * 0.5 * width / fx, CLAMP * 0.5 * height / fy
    slope_x = torch.maximum(torch.minimum(x * inverse, edge_x), -edge_x)
    slope_y = torch.maximum(torch.minimum(y * inverse, edge_y), -edge_y)
    # Rows of J W: derivatives of column and row by the position in the world.
    row_x = (fx * inverse)[..., None] * (turn[:, None, 0] - slope_x[..., None] * turn[:, None, 2])
    row_y = (fy * inverse)[..., None] * (turn[:, None, 1] - slope_y[..., None] * turn[:, None, 2])
    by_x, by_y = (covariances * row_x[..., None, :]).sum(dim=-1), (covariances * row_y[..., None, :]).sum(dim=-1)
    xx, xy, yy = (by_x * row_x).sum(dim=-1), (by_x * row_y).sum(dim=-1), (by_y * row_y).sum(dim=-1)
    return Projected(centres, torch.stack([xx + DILATION, xy, yy + DILATION], dim=-1), z)


@dataclass(frozen=True)
class Pairs:
    """M pairs of a Gaussian and a pixel that it shows in, by pixel and then by depth."""

    #: Gaussian of each, row of the N x G, int64.
    row: Tensor
    #: Pixel of each, of N x P, int64.
    pixel: Tensor
    #: Its column and row in its picture (M, 2).
    place: Tensor


@torch.no_grad()
def pair(seen: Projected, opacities: Tensor, size: tuple[int, int]) -> Pairs:
    """Lists the pairs whose opacity is 1/255 or more."""
    pictures, count = seen.depths.shape
    height, width = size
    # a >= 1/255 is an ellipse d^T S'^-1 d <= reach; its rectangle has the half sides sqrt(reach S'_xx) and sqrt(reach S'_yy).
    reach = 2.0 * (opacities / LEAST_OPACITY).clamp(min=1e-9).log()
    visible = (reach > 0.0) & (seen.depths > NEAR)
    half = (reach.clamp(min=0.0)[:, None] * seen.covariances[..., [0, 2]]).sqrt()
    bounds = seen.means.new_tensor([width - 1.0, height - 1.0])
    zero = torch.zeros_like(bounds)
    # Means far outside have no pixels; clamped, they are integers without overflow.
    low = torch.minimum(torch.maximum((seen.means - half).ceil(), zero), bounds + 1.0).long()
    high = torch.maximum(torch.minimum((seen.means + half).floor(), bounds), zero - 1.0).long()
    sides = (high - low + 1).clamp(min=0) * visible[..., None]
    order = seen.depths.argsort(dim=1, stable=True) + count * torch.arange(pictures, device=bounds.device)[:, None]
    order = order.flatten()
    sides = sides.view(-1, 2).index_select(0, order)
    numbers = sides.prod(dim=-1)
    place = torch.arange(order.numel(), device=bounds.device).repeat_interleave(numbers)
    within = torch.arange(place.numel(), device=bounds.device) - (numbers.cumsum(dim=0) - numbers).index_select(0, place)
    columns = sides[:, 0].index_select(0, place)
    v = within.div(columns, rounding_mode="floor")
    corners = low.view(-1, 2).index_select(0, order).index_select(0, place)
    where = corners + torch.stack([within - v * columns, v], dim=-1)
    row = order.index_select(0, place)
    table = torch.cat([seen.means, seen.covariances, opacities[:, None].expand(pictures, -1, -1)], dim=-1).view(-1, 6)
    looked = table.index_select(0, row)
    kept = (footprint(looked[:, :5], looked[:, 5], where.to(looked.dtype)) >= LEAST_OPACITY).nonzero()[:, 0]
    row, where = row.index_select(0, kept), where.index_select(0, kept)
    pixel = row.div(count, rounding_mode="floor") * (height * width) + where[:, 1] * width + where[:, 0]
    pixel, by_pixel = pixel.int().sort(stable=True)
    return Pairs(row.index_select(0, by_pixel), pixel.long(), where.index_select(0, by_pixel).to(seen.means.dtype))


def footprint(table: Tensor, opacities: Tensor, places: Tensor) -> Tensor:
    """Opacities (M,) of Gaussians, rows (M, 5) of mean and covariance, at places (M, 2) of their pictures."""
    x, y = (places - table[:, :2]).unbind(dim=-1)
    xx, xy, yy = table[:, 2:].unbind(dim=-1)
    power = (yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)
    return (opacities * torch.exp(-0.5 * power)).clamp(max=MOST_OPACITY)


class Blend(torch.autograd.Function):
    """Sums of channels over the pairs of each pixel, from front to back."""

    @staticmethod
    def forward(ctx: Any, opacity: Tensor, channels: Tensor, pixel: Tensor, pixels: int) -> tuple[Tensor, Tensor]:
        """Sums (`pixels`, C) of the channels (M, C) of pairs with opacities (M,) sorted by `pixel` (M,), and the
        transmittances (M,) before each pair, 0 for those behind the last that counts."""
        behind = segmented(torch.log1p(-opacity.double()), pixel)
        before = behind - torch.log1p(-opacity.double())
        counted = behind >= math.log(LEAST_TRANSMITTANCE)
        through = torch.where(counted, before.exp(), 0.0).to(opacity.dtype)
        found = channels.new_zeros(pixels, channels.shape[1]).index_add_(0, pixel, channels * (through * opacity)[:, None])
        ctx.save_for_backward(opacity, channels, pixel, through)
        ctx.mark_non_differentiable(through)
        return found, through

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, Tensor, None, None]:
        """Derivatives by opacities and channels."""
        opacity, channels, pixel, through = ctx.saved_tensors
        by_sum = gradients[0].index_select(0, pixel)
        by_weight = (by_sum * channels).sum(dim=-1)
        weight = through * opacity
        # What lies behind a pair, dimmed by it: its sum is the pixel's less all up to the pair.
        part = (weight * by_weight).double()
        dimmed = segmented(part.flip(0), pixel.flip(0)).flip(0) - part
        by_opacity = through * by_weight - torch.where(through > 0.0, dimmed / (1.0 - opacity), 0.0).to(opacity.dtype)
        return by_opacity, by_sum * weight[:, None], None, None


def segmented(values: Tensor, key: Tensor) -> Tensor:
    """Sums of values (M,) up to and with each, from the first of its run of equal keys (M,)."""
    total = values.cumsum(dim=0)
    place = torch.arange(len(key), device=key.device)
    starts = torch.ones_like(key, dtype=torch.bool)
    starts[1:] = key[1:] != key[:-1]
    first = torch.where(starts, place, 0).cummax(dim=0).values
    return total - (total - values).index_select(0, first)


def median(depths: Tensor, pairs: Pairs, opacity: Tensor, through: Tensor, pixels: int) -> Tensor:
    """Depths (`pixels`,) of the pairs at which the transmittance falls to one half or below; 0 where it does not."""
    half = (through > 0.5) & (through * (1.0 - opacity) <= 0.5)
    found = torch.where(half, depths[pairs.row], 0.0)
    # One pair of a pixel at most: all others add nothing.
    return depths.new_zeros(pixels).index_add_(0, pairs.pixel, found)

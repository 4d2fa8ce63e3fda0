"""Blending of projected Gaussians by the native module, as an operator of PyTorch: on processors, in single precision.

All cores that `tdcr.set_threads` leaves; the same for any number of them. What it computes is what `_rasterise.blended` does.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from tdcr import _tdcr

#: What `blend` and its derivatives return: colours (N, P, 3), opacities (N, P), depths (N, P); and the derivatives by means,
#: covariances, opacities and colours.
Blended = tuple[Tensor, Tensor, Tensor]
Gradient = tuple[Tensor, Tensor, Tensor, Tensor]


def _arrays(*tensors: Tensor) -> tuple[Any, ...]:
    return tuple(tensor.detach().contiguous().numpy() for tensor in tensors)


@torch.library.custom_op("tdcr::blend_gaussians", mutates_args=(), device_types="cpu")
def blend(
    means: Tensor,
    covariances: Tensor,
    depths: Tensor,
    opacities: Tensor,
    colors: Tensor,
    height: int,
    width: int,
    near: float,
) -> Blended:
    """Pictures of P = `height` x `width` pixels of Gaussians on their planes: means (N, G, 2) and covariances (N, G, 3) in
    pixels, depths (N, G), of which those beyond `near` are seen, opacities (G,) and colours (N, G, 3), all float32.

    Depths are where the transmittance falls to one half, 0 where it does not; they have no derivatives.
    """
    gaussians = _arrays(means, covariances, depths, opacities, colors)
    found, opacity, depth = _tdcr.blend_gaussians(gaussians, (width, height), near)
    return torch.from_numpy(found), torch.from_numpy(opacity), torch.from_numpy(depth)


@blend.register_fake
def _(
    means: Tensor,
    covariances: Tensor,
    depths: Tensor,
    opacities: Tensor,
    colors: Tensor,
    height: int,
    width: int,
    near: float,
) -> Blended:
    pictures, pixels = means.shape[0], height * width
    return (
        means.new_empty(pictures, pixels, 3),
        means.new_empty(pictures, pixels),
        means.new_empty(pictures, pixels),
    )


@torch.library.custom_op("tdcr::blend_gaussians_backward", mutates_args=(), device_types="cpu")
def _backward(
    by_colors: Tensor,
    by_opacity: Tensor,
    means: Tensor,
    covariances: Tensor,
    depths: Tensor,
    opacities: Tensor,
    colors: Tensor,
    height: int,
    width: int,
    near: float,
) -> Gradient:
    gaussians = _arrays(means, covariances, depths, opacities, colors)
    found = _tdcr.blend_gaussians_backward(gaussians, (width, height), near, *_arrays(by_colors, by_opacity))
    by_means, by_covariances, by_opacities, by_gaussians_colors = (torch.from_numpy(part) for part in found)
    return by_means, by_covariances, by_opacities, by_gaussians_colors


@_backward.register_fake
def _(
    by_colors: Tensor,
    by_opacity: Tensor,
    means: Tensor,
    covariances: Tensor,
    depths: Tensor,
    opacities: Tensor,
    colors: Tensor,
    height: int,
    width: int,
    near: float,
) -> Gradient:
    made = (means, covariances, opacities, colors)
    by_means, by_covariances, by_opacities, by_gaussians_colors = (part.new_empty(part.shape) for part in made)
    return by_means, by_covariances, by_opacities, by_gaussians_colors


def _keep(ctx: Any, inputs: tuple[Any, ...], output: Blended) -> None:
    ctx.save_for_backward(*inputs[:5])
    ctx.rest = inputs[5:]


def _differentiate(ctx: Any, by_colors: Tensor, by_opacity: Tensor, by_depth: Tensor) -> tuple[Tensor | None, ...]:
    by_means, by_covariances, by_opacities, by_gaussians_colors = _backward(by_colors, by_opacity, *ctx.saved_tensors, *ctx.rest)
    return by_means, by_covariances, None, by_opacities, by_gaussians_colors, None, None, None


blend.register_autograd(_differentiate, setup_context=_keep)

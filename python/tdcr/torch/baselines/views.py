"""Pictures of a data set's samples, rendered again from its recipe (robot, cameras, base, commands) instead of stored.

A picture is kept as what differs from its black background: its mask as bits, and the colours of the pixels that show the robot.
Positions are in the units of a data set: metres divided by its scale. Frames of cameras are x right, y down, z forward, and
pixel (column u, row v) is the direction ((u - cx) / fx, (v - cy) / fy, 1).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from tdcr import statics, vision
from tdcr._threads import threads
from tdcr.data import Dataset, SplitName
from tdcr.errors import DataError, InputError
from tdcr.robot import Robot

#: Width and height of the pictures that the publications train on (pixels).
PIXELS = 100


@dataclass(frozen=True)
class Cameras:
    """V cameras without distortion, of pictures of one size."""

    #: Rotations from the world to the cameras' frames (V, 3, 3).
    rotations: Tensor
    #: Centres of projection (V, 3), in the data's units.
    centres: Tensor
    #: fx, fy, cx, cy of each (V, 4), in pixels.
    lenses: Tensor
    #: Height and width (pixels).
    size: tuple[int, int]

    def __len__(self) -> int:
        return len(self.centres)

    def to(self, device: torch.device) -> Self:
        """The same on a device."""
        tensors = {name: getattr(self, name).to(device) for name in ("rotations", "centres", "lenses")}
        return replace(self, **tensors)

    def directions(self, camera: Tensor, pixel: Tensor) -> Tensor:
        """Unit directions (..., 3) in the world of the rays through pixels, row-major indices (...), of cameras (...)."""
        lens = self.lenses[camera]
        u, v = pixel % self.size[1], pixel.div(self.size[1], rounding_mode="floor")
        x, y = (u - lens[..., 2]) / lens[..., 0], (v - lens[..., 3]) / lens[..., 1]
        seen = torch.stack([x, y, torch.ones_like(x)], dim=-1)
        turned = (self.rotations[camera] * seen[..., :, None]).sum(dim=-2)
        return torch.nn.functional.normalize(turned, dim=-1)


@dataclass(frozen=True)
class Views:
    """Pictures of B samples by V cameras, of P pixels each."""

    cameras: Cameras
    #: Masks (B, V, P / 8 rounded up), uint8: bit 7 - k of byte j is pixel 8 j + k.
    bits: Tensor
    #: Pixels that show the robot (B, V, F), int32, in ascending order; P where a picture has fewer than F.
    pixels: Tensor
    #: Their colours (B, V, F, 3), uint8.
    colors: Tensor

    @classmethod
    def render(cls, folder: str | Path, split: SplitName = "train", size: int = PIXELS, samples: int | None = None) -> Self:
        """Renders the samples of a split, or its first `samples`, on all threads that `tdcr.set_threads` leaves; the same
        for any number of them.

        Raises:
            tdcr.errors.DataError: where the data set does not say how its clouds were made, or a sample does not settle.
            tdcr.errors.InputError: where the robot's cameras are not a ring of undistorted cameras.
        """
        data = Dataset(folder)
        if data.robot is None or data._subject is None:
            raise DataError(
                f"{folder}: its samples were not simulated, so there is no recipe to render pictures and masks from, and it "
                "holds none; expected a data set of `tdcr collect`, or masks of a captured one's pictures"
            )
        robot = with_pictures(data.robot, size)
        conditions = data.split(split).conditions[:samples].astype(np.float64)
        commands = conditions[:, : robot.tendons]
        payloads = conditions[:, robot.tendons] if conditions.shape[1] > robot.tendons else None
        settled = statics.settle_batch(robot, commands, payloads)
        if not settled.converged.all():
            raise DataError(f"{folder}: sample {int(np.argmin(settled.converged))} of {split} does not settle")
        base = bool(data.base)

        def compact(row: int) -> tuple[npt.NDArray[np.uint8], list[npt.NDArray[Any]], list[npt.NDArray[Any]]]:
            seen = vision.render(robot, settled.configuration[row], base=base)
            masks = np.stack([view.mask.ravel() > 0 for view in seen])
            pixels = [np.flatnonzero(mask).astype(np.int32) for mask in masks]
            colors = [view.color.reshape(-1, 3)[shown] for view, shown in zip(seen, pixels, strict=True)]
            return np.packbits(masks, axis=1), pixels, colors

        with ThreadPoolExecutor(threads()) as pool:
            found = list(pool.map(compact, range(len(commands))))
        first = vision.render(robot, settled.configuration[0], base=base)
        return cls.of_rows(found, of_views(first, data.normalisation.scale))

    @classmethod
    def of_rows(cls, rows: Sequence[tuple[Any, Any, Any]], cameras: Cameras) -> Self:
        """From each sample's packed masks (V, P / 8 rounded up), and its list for each camera of the pixels that show the robot
        (F,) and of their colours (F, 3)."""
        bits = np.stack([row[0] for row in rows])
        most = max(1, max(len(pixels) for row in rows for pixels in row[1]))
        pixels = np.full((*bits.shape[:2], most), math.prod(cameras.size), np.int32)
        colors = np.zeros((*bits.shape[:2], most, 3), np.uint8)
        for place, row in enumerate(rows):
            for camera, (shown, rgb) in enumerate(zip(row[1], row[2], strict=True)):
                pixels[place, camera, : len(shown)], colors[place, camera, : len(shown)] = shown, rgb
        return cls(cameras, torch.from_numpy(bits), torch.from_numpy(pixels), torch.from_numpy(colors))

    def __len__(self) -> int:
        return len(self.bits)

    def to(self, device: torch.device) -> Self:
        """The same on a device."""
        return replace(self, **{field.name: getattr(self, field.name).to(device) for field in fields(self)})

    def shown(self, sample: Tensor, camera: Tensor, pixel: Tensor) -> Tensor:
        """Whether pixels (...) of cameras (...) show the robot in samples (...), as 0 or 1, uint8."""
        byte = self.bits[sample, camera, pixel.div(8, rounding_mode="floor")]
        return (byte >> (7 - pixel % 8).to(torch.uint8)) & 1

    def images(self, sample: Tensor, camera: Tensor) -> tuple[Tensor, Tensor]:
        """Colours (N, P, 3) in [0, 1], black where there is no robot, and masks (N, P) of samples (N,) and cameras (N,)."""
        places, count = self.pixels[sample, camera].long(), self.cameras.size[0] * self.cameras.size[1]
        # The last pixel of the canvas takes what fills up short lists.
        canvas = torch.zeros(len(places), count + 1, 4, device=places.device)
        rgb = self.colors[sample, camera].float() / 255
        rows = torch.cat([rgb, torch.ones_like(rgb[..., :1])], dim=-1)
        canvas.scatter_(1, places[..., None].expand(-1, -1, 4), rows)
        return canvas[:, :count, :3], canvas[:, :count, 3]


def with_pictures(robot: Robot, size: int) -> Robot:
    """A robot whose cameras take square pictures of `size` pixels, with the same vertical field of view.

    Raises:
        tdcr.errors.InputError: where its cameras are not a ring without distortion.
    """
    content = robot.to_dict()
    cameras = content.get("cameras")
    if not isinstance(cameras, dict) or "fovy" not in cameras or cameras.get("distortion") is not None:
        raise InputError("the robot's cameras stand freely or are distorted, expected a ring of undistorted cameras")
    return Robot({**content, "cameras": {**cameras, "resolution": [size, size]}})


def of_views(views: list[vision.View], scale: float) -> Cameras:
    """The cameras of pictures; `scale` is the length that positions are divided by (m)."""
    rotations, centres, lenses = [], [], []
    for view in views:
        w, x, y, z = view.quaternion
        # Columns are the camera's axes in the world; its transpose turns the world into the camera's frame.
        axes = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        rotations.append(axes.T)
        centres.append(view.position / scale)
        lenses.append([view.matrix[0, 0], view.matrix[1, 1], view.matrix[0, 2], view.matrix[1, 2]])
    turned, placed, ground = (torch.from_numpy(np.array(part, dtype=np.float32)) for part in (rotations, centres, lenses))
    return Cameras(turned, placed, ground, size=(views[0].depth.shape[0], views[0].depth.shape[1]))

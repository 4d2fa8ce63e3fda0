"""Pictures of a captured data set's samples: those that its cameras took, with masks that another program or a person made.

`tdcr log pictures` writes the frames, `camera0/000000.png` for the first camera and sample 0; masks have the same names. A
picture is made small without the distortion of its lens: its pixels are means of those of a pinhole that has the camera's pose.
"""

from __future__ import annotations

import hashlib
import json
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tdcr import statics, vision
from tdcr._threads import threads
from tdcr.data import Dataset, SplitName
from tdcr.errors import DataError, InputError
from tdcr.torch.baselines.views import PIXELS, Views, of_views

#: Most samples of a large picture along an edge of a pixel of the small one.
FINEST = 8


@dataclass(frozen=True)
class Pictures:
    """Folders of a captured data set's masks and, for what learns colours, its frames."""

    masks: Path
    frames: Path | None = None

    def fingerprint(self) -> str:
        """A hash of the names and sizes of all files."""
        found = hashlib.sha256()
        for folder in filter(None, (self.masks, self.frames)):
            for file in sorted(folder.glob("camera*/*.png")):
                found.update(f"{file.relative_to(folder)} {file.stat().st_size}\n".encode())
        return found.hexdigest()

    def read(self, folder: str | Path, split: SplitName = "train", size: int = PIXELS) -> Views:
        """Views of the samples of a split of the data set in `folder`, whose longer edge has `size` pixels; black without frames.

        Raises:
            tdcr.errors.DataError: where the data set is not of `tdcr capture`, and for pictures that are missing, cannot be read,
                or have another size than the camera's.
        """
        data = Dataset(folder)
        if data.robot is None:
            raise DataError(f"{folder}: its robot and cameras are not known, expected a data set of `tdcr capture`")
        numbers = numbers_of(Path(folder), data.split(split).conditions)
        robot = data.robot
        at_rest = statics.settle(robot, robot.random_commands(1, seed=0)[0])
        cameras = [Small.of(view, size) for view in vision.render(robot, at_rest.configuration)]

        def compact(number: int) -> tuple[list[Any], list[Any], list[Any]]:
            taken = [self.picture(camera, place, number) for place, camera in enumerate(cameras)]
            pixels = [np.flatnonzero(mask).astype(np.int32) for mask, _ in taken]
            colors = [color[shown] for (_, color), shown in zip(taken, pixels, strict=True)]
            return [np.packbits(mask) for mask, _ in taken], pixels, colors

        with ThreadPoolExecutor(threads()) as pool:
            rows = list(pool.map(compact, numbers))
        return Views.of_rows(rows, of_views([camera.pinhole for camera in cameras], data.normalisation.scale))

    def picture(self, camera: Small, place: int, number: int) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.uint8]]:
        """Mask (P,) and colours (P, 3) of a sample's picture by the camera at a place."""
        name = f"camera{place}/{number:06}.png"
        mask = np.asarray(pixels_of(self.masks / name, camera).any(axis=-1))
        color = pixels_of(self.frames / name, camera) if self.frames else np.zeros((*mask.shape, 3), np.uint8)
        return camera.shrink(mask, color)


def numbers_of(folder: Path, conditions: npt.NDArray[Any]) -> list[int]:
    """The numbers under which `tdcr capture` took the samples of these conditions (B, D): it wrote their commands down."""
    journal = folder / "capture.jsonl"
    if not journal.is_file():
        raise DataError(f"{journal}: there is no such file; samples of `tdcr capture` alone have frames and masks")
    taken: dict[bytes, int] = {}
    try:
        for line in journal.read_text(encoding="utf-8").splitlines()[1:]:
            entry = json.loads(line)["entry"]
            if entry["kind"] == "sample":
                # A payload is the last number of a condition.
                loaded = [] if entry.get("payload") is None else [entry["payload"]]
                taken[np.array([*entry["command"], *loaded], np.float32).tobytes()] = int(entry["index"])
    except (ValueError, KeyError, TypeError) as error:
        raise DataError(f"{journal}: line {len(taken) + 2} or later is none of `tdcr capture`: {error}") from error
    keys = [row.astype(np.float32).tobytes() for row in conditions]
    if lost := [k for k, key in enumerate(keys) if key not in taken]:
        raise DataError(f"{journal}: has no sample of the command {conditions[lost[0]].tolist()}, which the data set has")
    return [taken[key] for key in keys]


def pixels_of(file: Path, camera: Small) -> npt.NDArray[np.uint8]:
    """The pixels (height, width, 3) of a picture of this camera."""
    from PIL import Image, UnidentifiedImageError

    if not file.is_file():
        raise DataError(f"{file}: there is no such file, expected a picture for each camera and sample")
    try:
        with Image.open(file) as image:
            found = np.asarray(image.convert("RGB"))
    except (OSError, UnidentifiedImageError) as error:
        raise DataError(f"{file}: no picture that can be read: {error}") from error
    height, width = camera.shape
    if found.shape[:2] != (height, width):
        raise DataError(f"{file}: {found.shape[1]} x {found.shape[0]} pixels, expected the camera's {width} x {height}")
    return found


@dataclass(frozen=True)
class Small:
    """How a camera's pictures are made small, and square: what is beyond the picture is black."""

    #: The pinhole that the small pictures are of.
    pinhole: vision.View
    #: Height and width of the large pictures.
    shape: tuple[int, int]
    #: Pixels of the large picture (P, S) that a pixel of the small one is the mean of, by number; its count where none.
    sources: npt.NDArray[np.int64]

    @classmethod
    def of(cls, view: vision.View, size: int) -> Small:
        """For the camera of this picture. Pixel (u, v) has its centre at integers, and lenses distort as OpenCV says."""
        if size < 1:
            raise InputError(f"size is {size}, expected 1 or more")
        height, width = view.depth.shape
        shrink = size / max(height, width)
        lens = view.matrix * shrink
        lens[:2, 2] = (view.matrix[:2, 2] + 0.5) * shrink - 0.5
        fine = min(max(math.ceil(1 / shrink), 1), FINEST)
        ticks = (np.arange(size * fine) + 0.5) / fine - 0.5
        x, y = np.meshgrid((ticks - lens[0, 2]) / lens[0, 0], (ticks - lens[1, 2]) / lens[1, 1])
        x, y = distorted(x, y, view.distortion)
        u = np.rint(view.matrix[0, 0] * x + view.matrix[0, 2]).astype(np.int64)
        v = np.rint(view.matrix[1, 1] * y + view.matrix[1, 2]).astype(np.int64)
        within = (u >= 0) & (u < width) & (v >= 0) & (v < height)
        sources = np.where(within, v * width + u, height * width)
        sources = sources.reshape(size, fine, size, fine).swapaxes(1, 2).reshape(size * size, fine * fine)
        blank = np.zeros((size, size), np.float32)
        pinhole = vision.View(
            color=np.zeros((size, size, 3), np.uint8),
            depth=blank,
            mask=blank.astype(np.uint16),
            matrix=lens,
            distortion=np.zeros(5),
            position=view.position,
            quaternion=view.quaternion,
        )
        return cls(pinhole, (height, width), sources)

    def shrink(
        self, mask: npt.NDArray[np.bool_], color: npt.NDArray[np.uint8]
    ) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.uint8]]:
        """The mask (P,), where half of a pixel or more shows the robot, and the mean colours (P, 3) of what shows it there."""
        shown = np.append(mask.ravel(), False)[self.sources]
        kept = 2 * shown.sum(axis=1) >= self.sources.shape[1]
        small = np.zeros((len(kept), 3), np.uint8)
        shown, sources = shown[kept], self.sources[kept]
        rgb = np.concatenate([color.reshape(-1, 3), np.zeros((1, 3), np.uint8)])[sources]
        small[kept] = np.rint((rgb * shown[..., None]).sum(axis=1) / shown.sum(axis=1)[:, None])
        return kept, small


def distorted(x: npt.NDArray[Any], y: npt.NDArray[Any], coefficients: npt.NDArray[Any]) -> tuple[Any, Any]:
    """Where a lens shows directions (x, y, 1): k1, k2, p1, p2, k3 of Brown and Conrady, as OpenCV has them."""
    k1, k2, p1, p2, k3 = coefficients
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    )

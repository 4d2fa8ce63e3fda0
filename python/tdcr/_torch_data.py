"""The view of a split that PyTorch's loaders take; :meth:`tdcr.data.Split.torch` makes it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
import torch.utils.data

if TYPE_CHECKING:
    from tdcr.data import Split


class SplitView(torch.utils.data.Dataset[dict[str, torch.Tensor]]):
    """The samples of a split as dictionaries of tensors, read one by one."""

    def __init__(self, split: Split, normalised: bool, colors: bool, points: int, seed: int) -> None:
        self.split = split
        self.normalised = normalised
        self.colors = colors
        self.points = points
        self.seed = seed

    def __len__(self) -> int:
        return len(self.split)

    def __getitem__(self, index: int) -> dict[str, torch.Tensor]:
        sample = self.split[index]
        condition, points, colors = sample.condition, sample.points, sample.colors
        if self.points < len(points):
            generator = np.random.default_rng([self.seed, index])
            kept = generator.permutation(len(points))[: self.points]
            points, colors = points[kept], colors[kept]
        if self.normalised:
            units = self.split.dataset.normalisation
            condition, points = units.conditions(condition), units.points(points)
        item = {"condition": torch.from_numpy(condition), "points": torch.from_numpy(points)}
        if self.colors:
            item["colors"] = torch.from_numpy(colors).float() / 255.0
        return item

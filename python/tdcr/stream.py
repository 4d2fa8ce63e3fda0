"""Fresh samples of a simulated robot: random commands, and the clouds that cameras see."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from typing import Any, Literal

import numpy as np

from tdcr import _tdcr
from tdcr._arrays import as_count, as_flag, as_number, maybe_text
from tdcr.data import MOST, Normalisation, Sample, as_payload, as_seed, as_variation
from tdcr.robot import Robot
from tdcr.scene import Scene, as_scene

LARGEST_INDEX = 2**63 - 1
"""Largest index of a sample."""


class Stream(Iterator[Sample]):
    """Samples of a simulated robot under uniformly drawn commands, made as they are asked for, without end.

    Sample ``i`` is a function of the settings and ``i`` alone, those that ``tdcr train --stream`` sees: several readers that
    take every ``stride``-th sample share a stream. A stream can be pickled, and read in forked processes.

    Args:
        robot: Anything that :class:`tdcr.Robot` takes.
        base: Whether the cameras see the robot's base.
        payload: Smallest and largest payload (kg); a tenth of the samples have none. By default conditions have no payload.
        points: Points ``N`` of a cloud.
        voxel: Edge of the voxels that thin the clouds (m).
        noise: ``"d435"`` simulates the faults of that depth camera.
        seed: Seed of commands, points and faults.
        start: Index of the first sample.
        stride: From one sample to the next.
        scene: Obstacles around the robot, which settles among them. They hide from the cameras what is behind them; the clouds
            are of the robot alone.
        vary_obstacles: Moves them anew for each sample, as of :func:`tdcr.collect`.
        reduction: How samples are reduced, as :meth:`find_reduction` finds it: each is replaced by its class's representative.

    Raises:
        RobotError: If there is no such robot.
        InputError: For settings of no stream.
        DataError: For voxels and payloads of no size.
    """

    def __init__(
        self,
        robot: str | os.PathLike[str] | Mapping[str, Any] | Robot = "2m",
        *,
        base: bool = False,
        payload: tuple[float, float] | None = None,
        points: int = 2000,
        voxel: float = 0.002,
        noise: Literal["d435"] | None = None,
        seed: int = 0,
        start: int = 0,
        stride: int = 1,
        reduction: dict[str, Any] | None = None,
        scene: Scene | None = None,
        vary_obstacles: float | tuple[float, float] | None = None,
    ) -> None:
        own = Robot(robot)
        self._settings: dict[str, Any] = {
            "robot": own,
            "base": as_flag(base, "base"),
            "payload": as_payload(payload),
            "points": as_count(points, "points", 1, MOST),
            "voxel": as_number(voxel, "voxel"),
            "noise": maybe_text(noise, "noise"),
            "seed": as_seed(seed),
            "reduction": reduction,
            "scene": None if scene is None else as_scene(scene),
            "vary_obstacles": as_variation(vary_obstacles, scene),
        }
        self._stride = as_count(stride, "stride", 1, LARGEST_INDEX)
        self._native = _tdcr.Stream(
            own._native,
            self._settings["base"],
            self._settings["payload"],
            self._settings["points"],
            self._settings["voxel"],
            noise,
            self._settings["seed"],
            as_count(start, "start", 0, LARGEST_INDEX),
            self._stride,
            None if reduction is None else json.dumps(reduction),
            None if scene is None else scene._native,
            self._settings["vary_obstacles"],
        )

    @property
    def index(self) -> int:
        """Index of the next sample."""
        return self._native.index

    @property
    def stride(self) -> int:
        """From one sample to the next."""
        return self._stride

    @property
    def points(self) -> int:
        """Points ``N`` of a cloud."""
        return int(self._settings["points"])

    @property
    def spec(self) -> dict[str, Any]:
        """All that the samples are functions of besides their index: ``recipe``, ``points`` and ``seed``."""
        spec: dict[str, Any] = json.loads(self._native.spec())
        return spec

    @property
    def provenance(self) -> dict[str, Any]:
        """What samples are of, as model files have it: ``subject`` (robot, base and payloads), ``normalisation``, and
        ``reduction`` where they are reduced."""
        provenance: dict[str, Any] = json.loads(self._native.provenance())
        return provenance

    @property
    def normalisation(self) -> Normalisation:
        """Units that hold for all samples, whichever they are: the tendons' ranges, and the reach of the straight robot."""
        units = self.provenance["normalisation"]
        return Normalisation(np.array(units["motor_min"]), np.array(units["motor_max"]), units["scale"])

    def at(self, start: int, stride: int = 1) -> Stream:
        """The same stream from sample ``start`` on, every ``stride``-th sample."""
        return Stream(**self._settings, start=start, stride=stride)

    def find_reduction(self, colors: bool = False) -> tuple[dict[str, Any], str]:
        """How samples are reduced by the robot's symmetries that they have, with or without their colours, and that in words.

        ``symmetries`` are isometries of space (``matrix``, ``translation`` (m)) that map the robot to itself, with the
        permutation ``tendons`` of its tendons; the identity is the first. Where cameras see images of the robot not quite alike,
        ``views`` has the number of each symmetry's view. The words say as well why there are no more.
        """
        found, words = self._native.find_reduction(as_flag(colors, "colors"))
        return json.loads(found), words

    def reduced(self, reduction: dict[str, Any]) -> Stream:
        """The same stream of the representatives of its samples' classes: of all images of a sample under its symmetries, the one
        whose command is the smallest in lexicographic order. The normalised condition is followed by a 1 for its view among
        zeros, where there are several."""
        return Stream(**{**self._settings, "reduction": reduction}, start=self.index, stride=self._stride)

    def __next__(self) -> Sample:
        """Makes the next sample.

        Raises:
            DataError: If the robot does not settle, or no camera sees it; the stream goes on after that sample.
        """
        return Sample(*self._native.next()[0])

    def next_normalised(self) -> Sample:
        """Makes the next sample, in the units of the normalisation: conditions in [0, 1], points divided by the scale."""
        return Sample(*self._native.next()[1])

    def __reduce__(self) -> tuple[Any, ...]:
        return _unpickle, (self._settings, self.index, self._stride)

    def __repr__(self) -> str:
        return f"Stream({self._settings['robot'].name!r}, sample {self.index})"


def _unpickle(settings: dict[str, Any], start: int, stride: int) -> Stream:
    return Stream(**settings, start=start, stride=stride)

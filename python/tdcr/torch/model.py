"""Models: a network, the units of its inputs and outputs, and the file that `tdcr predict` and `tdcr eval` read."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt
import safetensors
import safetensors.torch
import torch
from torch import Tensor, nn

from tdcr import _tdcr
from tdcr._files import as_file, write_arrays, write_whole
from tdcr.data import Dataset
from tdcr.errors import InputError, TrainError
from tdcr.torch.flow import FlowPath, Reach, Sampler, integrate
from tdcr.torch.layers import CHANNELS, Shape, channels_of
from tdcr.torch.networks import file_tensors, load_file, network
from tdcr.torch.settings import Settings

#: Version of the format that this package reads and writes.
FORMAT = 2

#: What precedes the names of the tensors of the last denoising's network.
REFINEMENT = "refinement."

#: What a file holds: one of `tdcr`'s networks, which it reads, or any other module's weights, which need their module.
KIND, OWN_KIND = "model", "torch module"


class Clouds(NamedTuple):
    """Predicted clouds."""

    #: Points (B, N, 3), world frame (m), float32.
    points: npt.NDArray[np.float32]
    #: Colours (B, N, 3), 8-bit; None where the network predicts positions alone.
    colors: npt.NDArray[np.uint8] | None


@dataclass
class Model:
    """A trained shape predictor."""

    #: Maps points (B, N, C), flow times (B,) and conditions (B, D) to velocities (B, N, C).
    network: nn.Module
    #: Its shape; None for a network of one's own.
    shape: Shape | None
    #: Whether points have colours: C is 6, else 3.
    colors: bool
    #: What it was trained on: `subject` (robot, base and payloads, or None), `normalisation`, and `reduction` where it learned
    #: representatives of symmetric commands.
    provenance: dict[str, Any]
    #: How it was trained.
    settings: Settings
    #: Step at which its weights were taken.
    step: int
    #: Their mean Chamfer distance in validation, in normalised units squared.
    validation_distance: float
    #: The network that takes the other's place in the last denoising, where `tdcr train` has learned one (its refinement).
    refinement: nn.Module | None = None
    #: Where the clouds are that it was trained on (corners `min` and `max`, normalised units), which its velocities point at;
    #: None where that is not known.
    reach: Reach | None = None
    #: What the spread of its clouds is multiplied by, to be their uncertainty; None where it was not found.
    uncertainty_factor: float | None = None

    @classmethod
    def load(cls, path: str | Path, own: nn.Module | None = None) -> Self:
        """Reads a model file of `tdcr train` or of this package, on the CPU.

        `own` is the module whose weights the file holds, for a network of one's own; its weights are replaced.

        Raises:
            tdcr.errors.TrainError: where the file is no model, of another version, or needs (or does not take) `own`.
        """
        try:
            with safetensors.safe_open(path, "pt") as file:
                header = json.loads((file.metadata() or {}).get("tdcr", "null"))
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        except safetensors.SafetensorError as error:
            raise TrainError(f"{path}: not a safetensors file: {error}") from error
        if not isinstance(header, dict) or header.get("kind") not in (KIND, OWN_KIND):
            raise TrainError(f"{path}: no model file of tdcr")
        if header["format"] != FORMAT:
            raise TrainError(f"{path}: format {header['format']}, expected {FORMAT}")
        content = header["content"]
        if "prior" in content.get("settings", {}):
            raise TrainError(f"{path}: its flow starts from a simulated surface; expected one that starts from noise")
        if (header["kind"] == OWN_KIND) != (own is not None):
            needed = "the module that its weights are of" if own is None else "no module: it holds one of tdcr's networks"
            raise TrainError(f"{path}: a file of kind {header['kind']!r}, expected {needed}")
        shape = content.pop("shape", None)
        refined = content.pop("refined", False)
        last = {name: tensors.pop(name) for name in list(tensors) if refined and name.startswith(REFINEMENT)}
        module: nn.Module
        try:
            if own is None:
                load_file(module := network(shape), tensors)
                if refined:
                    load_file(refinement := network(shape), {name.removeprefix(REFINEMENT): last[name] for name in last})
                    content["refinement"] = refinement.eval()
            else:
                (module := own).load_state_dict(tensors)
        except RuntimeError as error:
            raise TrainError(f"{path}: {error}") from error
        colors = content.pop("colors", False) if shape is None else channels_of(shape) == CHANNELS["xyz-rgb"]
        return cls(network=module.eval(), shape=shape, colors=colors, **content)

    def save(self, path: str | Path) -> None:
        """Writes the model, whole or not at all. One of `tdcr`'s networks is read by `tdcr predict` and `tdcr eval`."""
        content: dict[str, Any] = {
            "provenance": self.provenance,
            "settings": self.settings,
            "step": self.step,
            "validation_distance": self.validation_distance,
        }
        if self.shape is None:
            content["colors"] = self.colors
            tensors = self.network.state_dict()
        else:
            content["shape"] = dict(self.shape)
            tensors = {name: value.float() for name, value in file_tensors(self.network).items()}
            if self.refinement is not None:
                content["refined"] = True
                tensors |= {REFINEMENT + name: value.float() for name, value in file_tensors(self.refinement).items()}
        if self.reach is not None:
            content["reach"] = dict(self.reach)
        if self.uncertainty_factor is not None:
            content["uncertainty_factor"] = self.uncertainty_factor
        # Copies, as tensors of a file may not share memory.
        state = {name: value.detach().cpu().clone() for name, value in tensors.items()}
        kind = OWN_KIND if self.shape is None else KIND
        header = json.dumps({"format": FORMAT, "kind": kind, "content": content})
        write_whole(Path(path), safetensors.torch.save(state, {"tdcr": header}))

    def conditions(self, commands: npt.ArrayLike) -> Tensor:
        """Conditions (B, D) of commands (B, D) in physical units (m or N; a payload, kg, is the last value).

        Of a model that learned representatives of symmetric commands these are those of the representatives, and have a 1 for the
        view among zeros in the end, where there are several.
        """
        return self._conditions(commands)[0]

    def _conditions(self, commands: npt.ArrayLike) -> tuple[Tensor, list[dict[str, Any] | None]]:
        """Conditions (B, D) of the representatives, and the symmetry that leads to each, if there are any."""
        units = self.provenance["normalisation"]
        low, high = (np.array(units[end], dtype=np.float64) for end in ("motor_min", "motor_max"))
        values = np.asarray(commands, dtype=np.float64)
        if values.ndim != 2 or values.shape[1] != len(low):
            raise InputError(f"commands have the shape {values.shape}, expected (B, {len(low)})")
        if not np.isfinite(values).all():
            raise InputError("commands hold a NaN or an infinity, expected finite numbers")
        reduced = self.provenance.get("reduction")
        if reduced is not None:
            conditions, which = _tdcr.reduce(json.dumps(self.provenance), np.ascontiguousarray(values))
            return torch.from_numpy(conditions), [reduced["symmetries"][index] for index in which]
        span = np.where(high > low, high - low, 1.0)
        return torch.from_numpy(((values - low) / span).astype(np.float32)), [None] * len(values)

    @torch.no_grad()
    def predict(
        self,
        commands: npt.ArrayLike,
        points: int = 10_000,
        seed: int | Sequence[int] = 0,
        sampler: Sampler | None = None,
    ) -> Clouds:
        """A cloud of `points` points for each command (B, D) in physical units, on the device of the network.

        Noise is that of `tdcr predict --seed`: a cloud of one of `tdcr`'s networks is that of `tdcr predict` but for
        rounding, which may decide which of two points that crowd each other alike is left out, and so move those about it.
        A seed for each command gives each its own noise. The sampler is by default the one that the model was validated with.

        Raises:
            tdcr.errors.InputError: for commands of another length.
            tdcr.errors.TrainError: where the cloud is not finite.
        """
        conditions, moved = self._conditions(commands)
        seeds = [seed] * len(conditions) if isinstance(seed, int) else list(seed)
        if len(seeds) != len(conditions):
            raise InputError(f"{len(seeds)} seeds, expected one for each of the {len(conditions)} commands")
        path = FlowPath.of(self.settings)
        place = next(self.network.parameters(), torch.empty(0)).device
        sampler = sampler or Sampler.of(self.settings)
        # At other times than that which it was learned for, the network itself denoises.
        refined = self.refinement is not None and sampler.denoise == self.settings["sampler"].get("denoise")
        last = self.refinement.to(place) if self.refinement is not None and refined else None
        clouds = []
        # One by one: a cloud of many points fills a device, and few clouds of a large network fit into its memory.
        for condition, own_seed in zip(conditions, seeds, strict=True):
            drawn = sampler.drawn(points)
            noise = _tdcr.start_noise(path.prior_deviation, path.prior_cut, drawn, self.colors, own_seed)
            start = torch.from_numpy(noise)[None].to(place)
            ends = integrate(self.network, start, condition[None].to(place), sampler, last, self.reach)[0]
            rows = ends.float().cpu().numpy()
            if not np.isfinite(rows).all():
                raise TrainError("the network's cloud is not finite")
            kept, places = _tdcr.select_points(rows[:, :3].copy(), points, last is not None)
            rows = rows[kept]
            rows[:, :3] = places
            clouds.append(rows)
        rows_of_all = np.stack(clouds)
        metres = rows_of_all[..., :3].astype(np.float64) * self.provenance["normalisation"]["scale"]
        for cloud, symmetry in zip(metres, moved, strict=True):
            if symmetry is not None:
                # Back from the representative: the transpose of M undoes x -> M x + t.
                cloud[:] = (cloud - np.array(symmetry["translation"])) @ np.array(symmetry["matrix"])
        colors = np.clip(np.rint(255 * rows_of_all[..., 3:]), 0, 255).astype(np.uint8) if self.colors else None
        return Clouds(metres.astype(np.float32), colors)


def first_commands(commands: npt.NDArray[np.float32], first: int | None) -> npt.NDArray[np.float32]:
    """The first of these commands (T, D), or all."""
    if first is None:
        return commands
    if not 1 <= first <= len(commands):
        raise InputError(f"first is {first}, expected 1 to {len(commands)}, the commands that there are")
    return commands[:first]


def write_predictions(
    path: str | Path,
    model: Model,
    folder: str | Path,
    points: int = 10_000,
    seed: int = 0,
    sampler: Sampler | None = None,
    first: int | None = None,
) -> None:
    """Predicts every command of a data set's test split, or the `first` ones, into an NPZ file for `tdcr eval --predictions`.

    Test command k has the noise of `seed` + k, as in `tdcr eval --model`.

    Raises:
        tdcr.errors.InputError: for a name that does not end in .npz, a folder that is not there, more first commands than
            there are.
    """
    file = as_file(path, "path", ".npz")
    commands = first_commands(Dataset(folder).test.conditions, first)
    clouds = model.predict(commands, points, range(seed, seed + len(commands)), sampler)
    arrays: dict[str, npt.NDArray[Any]] = {"points": clouds.points, "commands": commands}
    if clouds.colors is not None:
        arrays["rgb"] = clouds.colors
    write_arrays(file, **arrays)

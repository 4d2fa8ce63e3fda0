"""Files of trained baselines, and their predictions."""

import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt
import safetensors
import safetensors.torch
import torch

from tdcr._files import as_file, write_arrays, write_whole
from tdcr.data import Dataset, Normalisation, SplitName
from tdcr.errors import InputError, TrainError
from tdcr.torch.baselines._method import Method, Settings
from tdcr.torch.baselines._registry import METHODS, method
from tdcr.torch.model import first_commands

#: Version of the format that this package reads and writes.
FORMAT = 1

#: What tells these files from models of `tdcr train`.
KIND = "baseline"

#: Letters of a method's name in a file of predictions at most.
LONGEST_NAME = 60

#: Name of the file in the folder of a run.
FILE = "model.safetensors"


@dataclass
class BaselineModel:
    """A trained baseline."""

    method: Method
    settings: Settings
    #: What it was trained on: `subject` (robot, base and payloads, or None) and `normalisation`.
    provenance: dict[str, Any]
    #: Step at which its weights were taken.
    step: int
    #: Their mean Chamfer distance in validation, in the data's units squared.
    validation_distance: float
    #: Time that training took, by the clock and of all processors (s), preparation and validation with it.
    seconds: float
    processor_seconds: float

    @classmethod
    def load(cls, path: str | Path, device: torch.device | str = "cpu") -> Self:
        """Reads a file, or that in the folder of a run.

        Raises:
            tdcr.errors.TrainError: where the file is no baseline's, damaged, of another version, or its weights do not fit.
            tdcr.errors.MissingPackageError: where a package that the method needs is not installed.
        """
        path = Path(path)
        path = path / FILE if path.is_dir() else path
        if not path.is_file():
            raise TrainError(f"{path}: there is no such file, expected a trained baseline")
        try:
            with safetensors.safe_open(path, "pt") as file:
                header = json.loads((file.metadata() or {}).get("tdcr", "null"))
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        except (safetensors.SafetensorError, ValueError) as error:
            raise TrainError(f"{path}: not a safetensors file: {error}") from error
        if not isinstance(header, dict) or header.get("kind") != KIND:
            raise TrainError(f"{path}: not the file of a baseline")
        if header.get("format") != FORMAT:
            raise TrainError(f"{path}: format {header.get('format')}, expected {FORMAT}")
        try:
            content = dict(header["content"])
            name = content.pop("method")
            if name not in METHODS:
                raise TrainError(f"{path}: of the method {name!r}, expected one of {', '.join(METHODS)}")
            module = method(name)(**content.pop("shape"))
            module.load_state_dict(tensors)
            settings = Settings(**content.pop("settings"))
            return cls(method=module.to(device).eval(), settings=settings, **content)
        except (KeyError, TypeError, RuntimeError, InputError) as error:
            if isinstance(error, TrainError):
                raise
            raise TrainError(f"{path}: its header or weights do not fit: {error}") from error

    def save(self, path: str | Path) -> None:
        """Writes the file, whole or not at all."""
        content = {
            "method": self.method.name,
            "shape": self.method.shape(),
            "settings": asdict(self.settings),
            "provenance": self.provenance,
            "step": self.step,
            "validation_distance": self.validation_distance,
            "seconds": self.seconds,
            "processor_seconds": self.processor_seconds,
        }
        # Copies, as tensors of a file may not share memory.
        state = {name: value.detach().cpu().clone() for name, value in self.method.state_dict().items()}
        header = json.dumps({"format": FORMAT, "kind": KIND, "content": content})
        write_whole(Path(path), safetensors.torch.save(state, {"tdcr": header}))

    @property
    def scale(self) -> float:
        """Length that points are divided by (m)."""
        return float(self.provenance["normalisation"]["scale"])

    def predict(self, commands: npt.ArrayLike, points: int = 10_000, seed: int | Sequence[int] = 0) -> npt.NDArray[np.float32]:
        """Clouds (B, `points`, 3), world frame (m), for commands (B, D) in physical units (m or N; a payload, kg, is last).

        A seed for each command gives each its own random numbers.

        Raises:
            tdcr.errors.InputError: for commands of another length.
            tdcr.errors.TrainError: where a cloud is not finite.
        """
        units = self.provenance["normalisation"]
        normalisation = Normalisation(np.array(units["motor_min"]), np.array(units["motor_max"]), self.scale)
        values = np.asarray(commands, dtype=np.float64)
        if values.ndim != 2 or values.shape[1] != len(normalisation.condition_min):
            raise InputError(f"commands have the shape {values.shape}, expected (B, {len(normalisation.condition_min)})")
        if not np.isfinite(values).all():
            raise InputError("commands hold a NaN or an infinity, expected finite numbers")
        if points < 1:
            raise InputError(f"points is {points}, expected 1 or more")
        seeds = [seed] * len(values) if isinstance(seed, int) else list(seed)
        if len(seeds) != len(values):
            raise InputError(f"{len(seeds)} seeds, expected one for each of the {len(values)} commands")
        conditions = torch.from_numpy(normalisation.conditions(values)).to(self.method.device)
        with torch.no_grad():
            found = self.method.points(conditions, points, seeds).double().cpu().numpy() * self.scale
        if not np.isfinite(found).all():
            raise TrainError(f"a cloud of {self.method.name} is not finite")
        return found.astype(np.float32)


def write_predictions(
    path: str | Path,
    model: BaselineModel,
    folder: str | Path,
    split: SplitName = "test",
    points: int = 10_000,
    seed: int = 0,
    name: str | None = None,
    first: int | None = None,
) -> float:
    """Predicts every command of a split of a data set, or the `first` ones, into an NPZ file for `tdcr eval --predictions`;
    returns the seconds.

    Command k has the random numbers of `seed` + k. The file also says, for the table of several methods, the `name`, by default
    the method's own, the time of all processors that training took, and the time that the prediction of a cloud took.

    Raises:
        tdcr.errors.InputError: for a name that is no text of 1 to 60 printable letters; for more commands than there are.
        tdcr.errors.TrainError: where the data set is of another robot than that which the model was trained on.
    """
    file = as_file(path, "path", ".npz")
    name = model.method.name if name is None else name
    if not (1 <= len(name) <= LONGEST_NAME and name.isprintable() and name.strip()):
        raise InputError(f"name is {name!r}, expected 1 to {LONGEST_NAME} printable letters")
    data = Dataset(folder)
    subject = model.provenance["subject"]
    if subject is not None and data._subject is not None and subject != data._subject:
        raise TrainError(f"the model was trained on {in_words(subject)}, the data set {folder} is of {in_words(data._subject)}")
    commands = first_commands(data.split(split).conditions, first)
    begun = time.perf_counter()
    clouds = model.predict(commands, points, range(seed, seed + len(commands)))
    seconds = time.perf_counter() - begun
    said = {
        "method": np.array(name, dtype="<U"),
        "training_seconds": np.array(model.processor_seconds, dtype="<f8"),
        "prediction_seconds": np.array(seconds / len(commands), dtype="<f8"),
    }
    write_arrays(file, points=clouds, commands=commands, **said)
    return seconds


def in_words(subject: dict[str, Any]) -> str:
    """A subject in a message."""
    payload = "" if subject.get("payload") is None else ", with payloads"
    return f"the robot {subject['robot']['name']} (base {subject['base']}{payload})"

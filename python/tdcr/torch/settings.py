"""Settings of a training run: those of `tdcr train`, under the same names and with the same defaults.

They are JSON as in the header of a model file; the native module has the defaults and checks the values, so that what is
written here `tdcr` reads.
"""

import json
from dataclasses import dataclass
from typing import Any, TypedDict, cast

from tdcr import _tdcr
from tdcr.errors import InputError
from tdcr.torch.layers import Shape

#: The context network with this project's layers, in the authors' sizes.
CONTEXT: dict[str, Any] = {
    "stages": [{"channels": channels, "resolution": r} for channels, r in ((80, 24), (112, 16), (112, 8))],
    "blocks": 2,
    "joined": 128,
    "features": 64,
    "gate": {"centre": 0.97, "steepness": 12.0},
}

#: Context networks by their layers: this project's, and the authors'. A shape that does not say has the first.
CONTEXTS = {"residual": CONTEXT, "pvcnn": CONTEXT | {"layers": "pvcnn", "joined": 112}}


class Settings(TypedDict):
    """What `TrainSettings` in the Rust documentation has: see there what each number is."""

    steps: int
    clouds: int
    points: int
    procedure: str
    optimizer: Any
    precision: str
    learning_rate: float
    final_learning_rate: float
    warmup_steps: int
    weight_decay: float
    clip_norm: float
    average_decay: float
    path: dict[str, Any]
    symmetry: str
    color_weight: float
    seed: int
    validate_every: int
    validation_clouds: int
    validation_points: int
    sampler: dict[str, Any]
    target: str
    patience: int | None
    spike_factor: float


def complete(changes: dict[str, Any]) -> Settings:
    """The settings with defaults for what is not given.

    Raises:
        tdcr.errors.TdcrError: for names that are none and for values out of bounds.
    """
    return cast(Settings, json.loads(_tdcr.train_settings(json.dumps(changes))))


def matrix_learning_rate(settings: Settings) -> float | None:
    """Muon's learning rate after warm-up; None under AdamW alone."""
    optimizer = settings["optimizer"]
    return None if optimizer == "adam-w" else float(optimizer["muon"]["learning_rate"])


@dataclass(frozen=True)
class Preset:
    """Sizes and settings that fit together, as `tdcr train --preset` has them."""

    name: str
    #: Features per layer.
    width: int
    #: Layers.
    depth: int
    #: Features of the embedding of time and condition.
    embedding: int
    #: Residual blocks of the condition.
    condition_blocks: int
    #: Octaves of the Fourier features of the points' positions.
    octaves: int
    #: What the network sees of the flow time: `plain` (the paper's), or `late`, which tells its last hundredths apart.
    time_features: str
    #: Optimiser steps; None where the length is in `epochs`.
    steps: int | None
    #: Times that the training set is drawn from, in as many batches as its clouds fill; None where the length is in `steps`.
    epochs: int | None
    #: Whether colours are learned, where it is not said.
    colors: bool
    #: A Hybrid's context network.
    context: dict[str, Any]
    #: Settings of an MLP and of a Hybrid, but for the length.
    networks: dict[str, dict[str, Any]]

    def shape(
        self, condition_dim: int, *, net: str = "mlp", colors: bool | None = None, context: dict[str, Any] | None = None
    ) -> Shape:
        """Shape of the network `mlp` or `hybrid` for conditions of `condition_dim` values.

        `colors` is the preset's where it is not said. `context` replaces fields of the Hybrid's context network; of other
        `layers` than the preset's, all of it is theirs.
        """
        colors = self.colors if colors is None else colors
        changes = dict(context or {})
        layers = changes.pop("layers", None)
        usual = self.context if layers is None else CONTEXTS[layers]
        head = {
            "width": self.width,
            "depth": self.depth,
            "embedding": self.embedding,
            "condition_dim": condition_dim,
            "condition_blocks": self.condition_blocks,
            "octaves": self.octaves,
            "time_features": self.time_features,
            "channels": "xyz-rgb" if colors else "xyz",
        }
        return head if net == "mlp" else {"head": head, "context": usual | changes}

    def settings(self, *, net: str = "mlp", clouds_in_set: int | None = None, **changes: Any) -> Settings:
        """Settings of a run: the preset's for this kind of network, but for what is given by the name of its field.

        Warm-up takes at most a tenth of the steps, and Muon's learning rate follows `learning_rate` in proportion. The
        preset `paper` takes epochs, so it needs `clouds_in_set`, the size of the training set, or `steps`.

        Raises:
            tdcr.errors.InputError: where the length is not known.
            tdcr.errors.TdcrError: for names that are none and for values out of bounds.
        """
        usual = self.networks[net]
        settings = usual | changes
        if "steps" not in changes:
            if self.steps is not None:
                settings["steps"] = self.steps
            elif clouds_in_set is not None and self.epochs is not None:
                settings["steps"] = self.epochs * max(1, clouds_in_set // max(1, settings["clouds"]))
            else:
                raise InputError(f"preset {self.name} takes {self.epochs} epochs of a data set: say how many steps")
        settings["warmup_steps"] = min(settings["warmup_steps"], settings["steps"] // 10)
        if "learning_rate" in changes and isinstance(settings["optimizer"], dict):
            factor = changes["learning_rate"] / usual["learning_rate"]
            settings["optimizer"] = {"muon": {"learning_rate": factor * settings["optimizer"]["muon"]["learning_rate"]}}
        return complete(settings)


def presets() -> dict[str, Preset]:
    """All presets by name; the first is the default."""
    found = (Preset(**fields) for fields in json.loads(_tdcr.presets()))
    return {preset.name: preset for preset in found}


def preset(name: str = "quick") -> Preset:
    """The preset `quick`, `laptop` or `paper`.

    Raises:
        tdcr.errors.InputError: for other names.
    """
    known = presets()
    if name not in known:
        raise InputError(f"there is no preset {name!r}; expected one of {', '.join(known)}")
    return known[name]

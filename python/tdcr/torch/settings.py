"""Settings of a training run: those of `tdcr train`, under the same names and with the same defaults.

They are JSON as in the header of a model file; the native module has the defaults and presets, resolves options and checks the
values, so that what is written here `tdcr` reads.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypedDict, cast

from tdcr import _tdcr
from tdcr._options import train_options
from tdcr.errors import InputError
from tdcr.torch.layers import Shape

#: What a shape has that does not say it.
DEFAULTS = {"condition_blocks": 0, "octaves": 0, "time_features": "plain"}


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


def resolve(options: Mapping[str, Any], clouds_in_set: int | None = None) -> tuple[dict[str, Any], Settings]:
    """Shape of the network, and settings, of a run with options of `tdcr.train`, by the rules of `tdcr train`.

    The shape's conditions have no dimension yet. The presets that take epochs need `clouds_in_set`, the size of the training
    set, or `steps`.

    Raises:
        tdcr.errors.InputError: for options that describe no run, and where its length is not known.
    """
    found = _tdcr.resolve_training(json.dumps(dict(options)), clouds_in_set)
    shape, settings = (json.loads(text) for text in found)
    if "head" in shape:
        return shape | {"head": DEFAULTS | shape["head"]}, settings
    return DEFAULTS | shape, settings


def of_conditions(shape: Mapping[str, Any], condition_dim: int) -> dict[str, Any]:
    """The shape for conditions of `condition_dim` values."""
    if "head" in shape:
        return dict(shape) | {"head": of_conditions(shape["head"], condition_dim)}
    return dict(shape) | {"condition_dim": condition_dim}


@dataclass(frozen=True)
class Preset:
    """Options that fit together, as `tdcr train --preset` has them."""

    name: str
    #: Its options for the networks `mlp` and `hybrid`, by the names of `tdcr.train`; those without a value are not its own.
    options: dict[str, dict[str, Any]]

    def shape(
        self, condition_dim: int, *, net: str = "mlp", colors: bool | None = None, context: dict[str, Any] | None = None
    ) -> Shape:
        """Shape of the network `mlp` or `hybrid` for conditions of `condition_dim` values.

        `colors` is the preset's where it is not said. `context` replaces fields of the Hybrid's context network; of other
        `layers` than the preset's, all of it is theirs.
        """
        changes = dict(context or {}) if net == "hybrid" else {}
        layers = changes.pop("layers", None)
        # Any number of steps: a shape does not depend on it.
        asked = {"preset": self.name, "net": net, "colors": colors, "layers": layers, "steps": 1}
        shape = of_conditions(resolve(asked)[0], condition_dim)
        return shape if net == "mlp" else shape | {"context": shape["context"] | changes}

    def settings(self, *, net: str = "mlp", clouds_in_set: int | None = None, **changes: Any) -> Settings:
        """Settings of a run: the preset's for this kind of network, but for what is given: options by their names, and fields
        of `Settings` that no option has by theirs.

        Warm-up takes at most a tenth of the steps, and Muon's learning rate follows `learning_rate` in proportion. The
        preset `paper` takes epochs, so it needs `clouds_in_set`, the size of the training set, or `steps`.

        Raises:
            tdcr.errors.InputError: where the length is not known.
            tdcr.errors.TdcrError: for names that are none and for values out of bounds.
        """
        known = train_options()
        options = {name: value for name, value in changes.items() if name in known}
        fields = {name: value for name, value in changes.items() if name not in known}
        _, settings = resolve({"preset": self.name, "net": net} | options, clouds_in_set)
        return complete({**settings, **fields})


def presets() -> dict[str, Preset]:
    """All presets by name; the first is the default."""
    described = json.loads(_tdcr.presets())
    return {name: Preset(name, {"mlp": mlp, "hybrid": hybrid}) for name, (mlp, hybrid) in described}


def preset(name: str = "quick") -> Preset:
    """The preset `quick`, `laptop` or `paper`.

    Raises:
        tdcr.errors.InputError: for other names.
    """
    known = presets()
    if name not in known:
        raise InputError(f"there is no preset {name!r}; expected one of {', '.join(known)}")
    return known[name]


def context_of(layers: str) -> dict[str, Any]:
    """The context network of a Hybrid with these layers, `residual` or `pvcnn`, in the authors' sizes."""
    shape, _ = resolve({"net": "hybrid", "layers": layers, "steps": 1})
    return dict(shape["context"])

"""Options of training as the native module lists them, and values of them in its words."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from tdcr import _tdcr
from tdcr._arrays import as_count, as_flag, as_number, as_text
from tdcr.data import as_seed
from tdcr.errors import InputError
from tdcr.predictor import model_file
from tdcr.robot import Robot


@dataclass(frozen=True)
class Option:
    """An option.

    Attributes:
        name: Its name.
        kind: What its values are: ``"count"``, ``"counts"``, ``"number"``, ``"flag"``, ``"choice"``, ``"text"``, ``"file"`` or
            ``"robot"``.
        placeholder: What stands for a value in a help.
        choices: All values of a ``"choice"``.
        default: Its default; None where its help says what else is taken.
        help: Its documentation.
        heading: Heading of its group; None for the first one.
    """

    name: str
    kind: str
    placeholder: str
    choices: tuple[str, ...]
    default: Any
    help: str
    heading: str | None


@cache
def train_options() -> dict[str, Option]:
    """The options of a training run, by name, in the order of ``tdcr train --help``."""
    found = json.loads(_tdcr.train_options())
    return {one["name"]: Option(**{**one, "choices": tuple(one["choices"])}) for one in found}


def as_options(given: Mapping[str, Any]) -> dict[str, Any]:
    """Options of a training run that are not None, each as the native module takes it.

    Raises:
        TypeError: For a name that is none.
        InputError: For a value of another kind.
    """
    known = train_options()
    for name in given:
        if name not in known:
            raise TypeError(f"train() got an unexpected keyword argument {name!r}")
    return {name: _as_value(value, known[name]) for name, value in given.items() if value is not None}


def _as_value(value: Any, option: Option) -> Any:
    name = option.name
    match option.kind:
        case "count":
            return as_seed(value) if name == "seed" else as_count(value, name)
        case "counts":
            return _as_counts(value, name)
        case "number":
            return as_number(value, name)
        case "flag":
            return as_flag(value, name)
        case "choice":
            return _as_choice(value, name, option.choices)
        case "file":
            return model_file(value)
        case "robot":
            return Robot(value)
        case _:
            return as_text(value, name)


def _as_choice(value: Any, name: str, choices: Iterable[str]) -> str:
    text = as_text(value, name)
    if text not in choices:
        known = ", ".join(json.dumps(choice) for choice in choices)
        raise InputError(f"{name} is {json.dumps(text)}; expected one of {known}")
    return text


def _as_counts(value: Any, name: str) -> list[int]:
    """One number for each of the three stages."""
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise InputError(f"{name} is {value!r}; expected 3 numbers, one for each stage")
    return [as_count(one, name) for one in value]

"""The methods by name, each imported when it is asked for: their optional packages are theirs alone."""

import importlib

from tdcr.errors import InputError
from tdcr.torch.baselines._method import Method

#: Module and class of every method by its name.
METHODS = {
    "vsm": ("vsm", "Vsm"),
    "pointflow": ("pointflow", "PointFlow"),
    "ffksm": ("ffksm", "Ffksm"),
    "splat": ("splat", "Splat"),
}


def method(name: str) -> type[Method]:
    """The method of this name.

    Raises:
        tdcr.errors.InputError: for other names.
        tdcr.errors.MissingPackageError: where a package that it needs is not installed.
    """
    if name not in METHODS:
        raise InputError(f"there is no baseline {name!r}; expected one of {', '.join(METHODS)}")
    module, kind = METHODS[name]
    found: type[Method] = getattr(importlib.import_module(f"tdcr.torch.baselines.{module}"), kind)
    return found

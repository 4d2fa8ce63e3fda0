"""Arrays of any library in, NumPy arrays of float64 in C order out."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from tdcr.errors import InputError

Floats = NDArray[np.float64]
"""An array of float64."""

Progress = Callable[[int], object]
"""Is called with how many rows, samples or steps were done since its last call: ``tqdm(total=...).update`` is one."""

Kind = TypeVar("Kind")

_ON_THE_CPU = (1, 3)
"""DLPack's device types of memory that the processor reads: its own, and CUDA's page-locked one."""


def as_float(value: Any, name: str, shape: Sequence[int | str]) -> Floats:
    """Returns ``value`` as a float64 array of this shape in C order.

    Args:
        value: Anything that ``numpy.from_dlpack`` or ``numpy.asarray`` takes, of real numbers.
        name: What it is called in errors.
        shape: A length for each axis, or the name of an axis of any length.

    Raises:
        InputError: For another shape or type, numbers that are not finite, and tensors that are on a GPU.
    """
    array = as_array(value, name)
    if array.shape != shape or array.dtype != np.float64 or not array.flags.c_contiguous:
        if array.dtype.kind not in "iuf":
            raise InputError(f"{name} has entries of type {array.dtype}; expected real numbers")
        fits = array.ndim == len(shape) and all(
            isinstance(wanted, str) or found == wanted for found, wanted in zip(array.shape, shape, strict=True)
        )
        if not fits:
            raise InputError(f"{name} has shape {_shape(array.shape)}; expected {_shape(shape)}")
        array = np.ascontiguousarray(array, dtype=np.float64).reshape(array.shape)
    # A sum of squares is finite where all entries are, short of an overflow: the usual case at a fraction of the cost.
    if not math.isfinite(np.vdot(array, array)) and not np.isfinite(array).all():
        where = tuple(int(k) for k in np.argwhere(~np.isfinite(array))[0])
        index = "".join(f"[{k}]" for k in where)
        raise InputError(f"{name}{index} is {array[where]}; expected finite numbers")
    floats: Floats = array
    return floats


def as_rows(value: Any, name: str, width: int, what: str) -> Floats:
    """Returns ``value`` as rows of ``width`` numbers, a single row as one row; ``what`` names the width in errors."""
    array = as_array(value, name)
    if array.ndim == 1:
        array = array[np.newaxis]
    if array.ndim == 2 and array.shape[1] != width:
        raise InputError(f"{name} has {array.shape[1]} entries a row; expected {width}, {what}")
    return as_float(array, name, ("rows", width))


def as_quaternions(value: Any, name: str, shape: Sequence[int | str]) -> Floats:
    """Returns quaternions (w, x, y, z) as an array of this shape, of unit length; refuses those that are 0."""
    quaternions = as_float(value, name, shape)
    norms: Floats = np.linalg.norm(quaternions, axis=-1, keepdims=True)
    if not (norms > 0.0).all():
        raise InputError(f"{name} has a quaternion that is 0; expected rotations (w, x, y, z)")
    # Those that are unit ones but for rounding stay what they are, to the last bit.
    return np.where(np.abs(norms - 1.0) < 1e-14, quaternions, quaternions / norms)


def as_count(value: Any, name: str, smallest: int = 0, largest: int = 2**53) -> int:
    """Returns ``value`` as a whole number within bounds."""
    try:
        count = int(value.__index__())
    except (AttributeError, TypeError):
        raise InputError(f"{name} is {value!r}; expected a whole number") from None
    if not smallest <= count <= largest:
        raise InputError(f"{name} is {count}; expected {smallest} to {largest}")
    return count


def as_number(value: Any, name: str) -> float:
    """Returns ``value`` as a finite number."""
    if type(value) is float and math.isfinite(value):
        return value
    return float(as_float(value, name, ()))


def as_choice(value: Any, name: str, choices: Sequence[str]) -> str:
    """Returns ``value``, which is one of ``choices``."""
    if not isinstance(value, str) or value not in choices:
        known = [repr(choice) for choice in choices]
        raise InputError(f"{name} is {value!r}; expected {', '.join(known[:-1])} or {known[-1]}")
    return value


def maybe_count(value: Any, name: str) -> int | None:
    """Returns ``value`` as a whole number, if there is one."""
    return None if value is None else as_count(value, name)


def maybe_number(value: Any, name: str) -> float | None:
    """Returns ``value`` as a finite number, if there is one."""
    return None if value is None else as_number(value, name)


def as_floats(value: Any, name: str) -> Floats:
    """Returns ``value`` as a float64 array of any shape in C order; its entries may be NaN."""
    array = as_array(value, name)
    if array.dtype.kind not in "iuf":
        raise InputError(f"{name} has entries of type {array.dtype}; expected real numbers")
    return np.ascontiguousarray(array, dtype=np.float64).reshape(array.shape)


def as_place(value: Any, name: str, length: int) -> int:
    """Returns ``value`` as a place among ``length``, of one that may count from the end."""
    place = as_count(value, name, -length, length - 1)
    return place % length


def as_text(value: Any, name: str) -> str:
    """Returns ``value`` if it is a text."""
    if not isinstance(value, str):
        raise InputError(f"{name} is {value!r}; expected a text")
    return value


def maybe_text(value: Any, name: str) -> str | None:
    """Returns ``value`` if it is a text, or None."""
    return None if value is None else as_text(value, name)


def as_flag(value: Any, name: str) -> bool:
    """Returns the truth of ``value``, where it has one."""
    try:
        return bool(value)
    except ValueError:
        raise InputError(f"{name} is {value!r}; expected True or False") from None


def as_list(value: Any, name: str) -> list[Any]:
    """Returns what ``value`` has one after another; texts are refused, whose letters nobody means."""
    if isinstance(value, str | bytes) or not isinstance(value, Iterable):
        raise InputError(f"{name} is {value!r}; expected a list")
    return list(value)


def as_progress(value: Any) -> Progress | None:
    """Returns ``value`` if it can be called, or is None."""
    if value is not None and not callable(value):
        raise InputError(f"progress is {value!r}; expected a function of a number")
    progress: Progress | None = value
    return progress


def as_texts(value: Any, name: str) -> list[str]:
    """Returns ``value`` as a list of texts; a single text is refused, whose letters nobody means."""
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise InputError(f"{name} is {value!r}; expected a list of texts")
    return [as_text(one, f"an entry of {name}") for one in value]


def as_several(value: Any, name: str, kind: type[Kind]) -> list[Kind]:
    """Returns one object of a class, or several, as a list."""
    several = [value] if isinstance(value, kind) else list(value) if isinstance(value, Iterable) else None
    if several is None or not all(isinstance(one, kind) for one in several):
        raise InputError(f"{name} is {value!r}; expected {kind.__name__} objects")
    return several


def as_array(value: Any, name: str) -> NDArray[Any]:
    """``value`` as an array of whatever type, without a copy where that is possible."""
    if isinstance(value, np.ndarray):
        return value
    device = getattr(value, "__dlpack_device__", None)
    if device is not None:
        kind, number = device()
        if kind not in _ON_THE_CPU:
            raise InputError(
                f"{name} is on another device (DLPack device type {int(kind)}, number {int(number)}); expected an array in "
                "the processor's memory: copy it there first, in PyTorch with `.cpu()`, in JAX with `jax.device_get`"
            )
        if getattr(value, "requires_grad", False):
            raise InputError(
                f"{name} is a tensor that requires gradients, which this function does not give; expected "
                f"`{name}.detach()`, or a function of `tdcr.torch`"
            )
        try:
            shared: NDArray[Any] = np.from_dlpack(value)
            return shared
        except (BufferError, RuntimeError, TypeError):
            # Types that DLPack lacks, such as booleans of some versions.
            pass
    try:
        return np.asarray(value)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} is not an array of numbers: {error}") from None


def _shape(shape: Sequence[int | str]) -> str:
    """A shape as Python writes it."""
    inner = ", ".join(str(length) for length in shape)
    return f"({inner},)" if len(shape) == 1 else f"({inner})"

"""What results share: they are compared by value, shown in a few lines, and their rows are taken like those of arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, Self

import numpy as np

from tdcr.errors import InputError

_SHOWN = 6
"""Entries of an array that is shown whole."""
_WIDTH = 100
"""Characters of a value."""
_LINES = 18
"""Fields that are shown, so that all of it is at most twenty lines."""


class Result:
    """Base of results, which are dataclasses (``eq=False, repr=False``).

    ``==`` compares all numbers, not-a-numbers as equal, and returns a bool; results cannot be hashed.
    """

    __hash__ = None  # type: ignore[assignment]

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(equal(getattr(self, one.name), getattr(other, one.name)) for one in fields(self) if one.compare)  # type: ignore[arg-type]

    def __repr__(self) -> str:
        shown = [one for one in fields(self) if one.repr]  # type: ignore[arg-type]
        lines = [f"    {one.name}={brief(getattr(self, one.name))}," for one in shown[:_LINES]]
        lines += ["    ..."] if len(shown) > _LINES else []
        return "\n".join([f"{type(self).__name__}(", *lines, ")"])


class Batch(Result):
    """Base of results by rows: the arrays named in ``_by_rows`` have rows as their first axis."""

    _by_rows: tuple[str, ...] = ()

    def _take(self, rows: Any) -> Self:
        """Those rows that a slice, a mask or an array of numbers names."""
        if is_row(rows):
            raise InputError(f"row {rows}; expected a slice, a mask or an array of numbers: the arrays have single rows")
        chosen = rows_of(rows, len(self))  # type: ignore[arg-type]
        taken = {one.name: getattr(self, one.name) for one in fields(self)}  # type: ignore[arg-type]
        for name in self._by_rows:
            taken[name] = None if taken[name] is None else taken[name][chosen]
        if "failures" in taken:
            places = np.arange(len(self))[chosen].tolist()  # type: ignore[arg-type]
            taken["failures"] = {k: taken["failures"][row] for k, row in enumerate(places) if row in taken["failures"]}
        return type(self)(**taken)


def is_row(index: Any) -> bool:
    """Whether an index is the number of one row, not of several."""
    return not isinstance(index, bool | np.bool_) and hasattr(index, "__index__") and np.ndim(index) == 0


def row_of(index: Any, rows: int, name: str = "row") -> int:
    """The number of a row from the start, of one that may count from the end."""
    row = int(index.__index__())
    if not -rows <= row < rows:
        raise IndexError(f"{name} {row}; expected {-rows} to {rows - 1}" if rows else f"{name} {row}; there are none")
    return row % rows


def rows_of(index: Any, rows: int) -> slice | Any:
    """A slice, or an array of the numbers of rows, of what names several rows.

    Raises:
        InputError: For a mask of another length, and for what names no rows.
        IndexError: For numbers of rows that there are not.
    """
    if isinstance(index, slice):
        return index
    numbers = np.asarray(index)
    if numbers.dtype == np.bool_:
        if numbers.shape != (rows,):
            raise InputError(f"the mask has shape {numbers.shape}; expected ({rows},), a flag for each row")
        return np.flatnonzero(numbers)
    if numbers.size == 0 and numbers.ndim == 1:
        return np.zeros(0, dtype=np.intp)
    if numbers.dtype.kind not in "iu" or numbers.ndim != 1:
        raise InputError(f"rows {index!r}; expected a number, a slice, a mask of {rows} flags, or an array of numbers")
    return np.array([row_of(row, rows) for row in numbers.tolist()], dtype=np.intp)


def equal(a: Any, b: Any) -> bool:
    """Whether two values, of arrays and what holds arrays, have the same types, shapes and numbers."""
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        a, b = np.asarray(a), np.asarray(b)
        if a.dtype.kind in "fc" and b.dtype.kind in "fc":
            return bool(np.array_equal(a, b, equal_nan=True))
        return bool(np.array_equal(a, b))
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        return len(a) == len(b) and all(equal(one, other) for one, other in zip(a, b, strict=True))
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        return a.keys() == b.keys() and all(equal(a[key], b[key]) for key in a)
    if isinstance(a, float) and isinstance(b, float) and a != a:
        return b != b
    return bool(a == b)


def brief(value: Any) -> str:
    """A value in a line: arrays of many numbers by their shape, containers of many entries by their number."""
    if isinstance(value, np.ndarray):
        if value.size > _SHOWN:
            return f"<{' x '.join(map(str, value.shape))} {value.dtype}>"
        text = np.array2string(value, separator=", ", precision=6, max_line_width=10**6).replace("\n", " ")
        return text if len(text) <= _WIDTH else f"<{' x '.join(map(str, value.shape))} {value.dtype}>"
    if isinstance(value, Result):
        return f"<{type(value).__name__}>"
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, list | tuple | dict):
        text = repr(value) if all(isinstance(one, str | int | float | bool | None) for one in _entries(value)) else ""
        if text and len(text) <= _WIDTH:
            return text
        what = {type(one).__name__ for one in _entries(value)}
        return f"<{len(value)} {what.pop() if len(what) == 1 else 'entries'}>"
    text = " ".join(repr(value).split())
    return text if len(text) <= _WIDTH else f"{text[: _WIDTH - 3]}..."


def _entries(value: Any) -> Any:
    return value.values() if isinstance(value, dict) else value

"""Dictionaries in place of files: as text for the native module, and what that refuses in the words of the dictionary."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from tdcr._files import as_path
from tdcr.errors import InputError

_PLACE = re.compile(r" at line 1 column (\d+)")
"""Where in a text of one line an error is, as the native module says it."""

_TYPES = {
    "usize": "a whole number",
    "u32": "a whole number",
    "u64": "a whole number",
    "f64": "a number",
    "f32": "a number",
    "a sequence": "a list",
    "a map": "a dictionary",
    "a string": "a text",
    "a boolean": "true or false",
    "unit": "None",
    "struct": "a dictionary",
}
"""Names of types as users of Python know them."""


def as_json(fields: Mapping[str, Any], what: str, error: type[InputError] = InputError) -> str:
    """A dictionary as JSON in one line; arrays and numbers of NumPy are lists and numbers.

    Raises:
        InputError: Or ``error``, for values that no file can hold; the message has their keys.
    """
    return json.dumps(_plain(dict(fields), "", what, error))


def as_table(given: str | os.PathLike[str] | Mapping[str, Any] | None, what: str) -> tuple[str, tuple[str] | str | None]:
    """JSON text of a dictionary, and what the native module takes of it, of a file or of none.

    Raises:
        InputError: As :func:`as_json`, or for what is no path.
    """
    if isinstance(given, Mapping):
        text = as_json(given, what)
        return text, (text,)
    return "", None if given is None else as_path(given, what)


def _plain(value: Any, path: str, what: str, error: type[InputError]) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str):
                raise error(f"{what}{': ' + path if path else ''} has the key {key!r}; expected texts")
        return {key: _plain(one, f"{path}.{key}" if path else key, what, error) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one, f"{path}[{k}]", what, error) for k, one in enumerate(value)]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, float) and not math.isfinite(value):
        raise error(f"{what}: {path} is {value}; expected a finite number")
    if value is None or isinstance(value, str | int | float):
        return value
    raise error(f"{what}: {path} is {value!r}; expected numbers, texts, lists and dictionaries")


@contextmanager
def in_its_words(text: str, what: str = "") -> Iterator[None]:
    """Errors about a place in ``text``, which :func:`as_json` wrote of ``what``, name the keys that lead there in its place."""
    try:
        yield
    except InputError as error:
        message = str(error)
        found = _PLACE.search(message)
        if found is None or not message.startswith(what):
            raise
        path = _path(text, int(found[1]))
        message = message[: found.start()] + message[found.end() :]
        message = re.sub(r"expected (" + "|".join(_TYPES) + r")( \w+)?$", lambda m: f"expected {_TYPES[m[1]]}", message)
        raise type(error)(f"{path}: {message}" if path else message) from None


def _path(text: str, column: int) -> str:
    """The keys that lead to a column (from 1) of JSON in one line."""
    # Of each open dictionary or list: its bracket, and the key or number of the value that is read.
    open_: list[tuple[str, Any]] = []
    key_comes = False
    at, end = 0, min(column, len(text)) - 1
    while at < end:
        letter = text[at]
        if letter in "{[":
            open_.append((letter, None if letter == "{" else 0))
            key_comes = letter == "{"
        elif letter in "}]" and open_:
            open_.pop()
        elif letter == "," and open_:
            bracket, place = open_[-1]
            key_comes = bracket == "{"
            open_[-1] = (bracket, None if key_comes else place + 1)
        elif letter == '"':
            word, at = json.JSONDecoder().raw_decode(text, at)
            if key_comes and at <= end:
                open_[-1] = ("{", word)
            key_comes = False
            continue
        at += 1
    if open_ and text[end] in "}]":
        # What is missing is missing in all of it.
        open_[-1] = (open_[-1][0], None)
    path = ""
    for bracket, place in open_:
        if place is not None:
            path += f"[{place}]" if bracket == "[" else f".{place}" if path else place
    return path

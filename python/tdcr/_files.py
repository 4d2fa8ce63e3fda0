"""Files that are written whole or not at all."""

from __future__ import annotations

import io
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from tdcr.errors import InputError


def as_path(path: str | os.PathLike[str], name: str) -> str:
    """A path as text."""
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"{name} is {path!r}; expected a path")
    text = os.fspath(path)
    if not isinstance(text, str) or "\0" in text:
        raise InputError(f"{name} is {path!r}; expected a path, as text without a zero byte")
    return text


def as_paths(paths: Iterable[str | os.PathLike[str]], name: str) -> list[str]:
    """Paths as texts; a single path is refused, as what is meant is a list."""
    if isinstance(paths, str | os.PathLike) or not isinstance(paths, Iterable):
        raise InputError(f"{name} is {paths!r}; expected a list of folders")
    return [as_path(path, f"an entry of {name}") for path in paths]


def as_file(path: str | os.PathLike[str], name: str, *extensions: str) -> Path:
    """A file to write, refused before the work is done where its folder is missing or its extension is another one."""
    file = Path(as_path(path, name))
    if file.suffix.lower() not in extensions:
        raise InputError(f"{name} is {os.fspath(path)!r}; expected a name that ends in {', '.join(extensions)}")
    if not file.parent.is_dir():
        raise InputError(f"{name} is {os.fspath(path)!r}, and there is no folder {os.fspath(file.parent)!r}")
    return file


def write_whole(path: Path, content: bytes) -> None:
    """Writes a file so that a crash leaves the old one or the new one, never a part."""
    with tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False) as file:
        try:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
            os.chmod(file.name, 0o644)
            os.replace(file.name, path)
        except BaseException:
            os.unlink(file.name)
            raise


def write_arrays(path: Path, **arrays: Any) -> None:
    """Writes an NPZ file of arrays, whole."""
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, **arrays)
    write_whole(path, content.getvalue())

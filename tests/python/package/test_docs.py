"""The guides say what is so: their Python runs as printed, and the reference has every public name."""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import io
import os
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import tdcr

DOCS = Path(__file__).parents[3] / "docs"

PAGES = {"start.md": ["matplotlib"], "gradients.md": ["torch", "jax"], "clusters.md": []}
"""Pages whose blocks run one after another, and the optional packages that they use."""

SCRIPT = re.compile(r"# (\w+\.py)\n")
"""First line of a block that is a file of its own."""

BLOCK = re.compile(r"^```python\n(.*?)^```\n(?:\n```text\n(.*?)^```\n)?", re.MULTILINE | re.DOTALL)
"""A block of Python, with what it prints where the page says so."""

DIRECTIVE = re.compile(r"^\.\. (?:auto|py:)?(currentmodule|module|class|exception|function|data):: ([\w.]+)", re.MULTILINE)


MODULES = ["tdcr", "tdcr.errors", "tdcr.inverse", "tdcr.lerobot", "tdcr.metrics"]

OPTIONAL = {"torch": ["torch", "h5py", "safetensors"], "jax": ["jax"], "envs": ["gymnasium"], "plot": ["matplotlib"]}
"""Modules with the optional packages that they need."""


def optional(module: str) -> ModuleType:
    """A module; a test without the packages that it needs is skipped."""
    for package in OPTIONAL.get(module.partition(".")[2], []):
        pytest.importorskip(package)
    return importlib.import_module(module)


def blocks(page: str) -> list[tuple[int, str, str]]:
    """Line, source and expected output of the blocks of a page."""
    text = (DOCS / page).read_text(encoding="utf-8")
    return [(text.count("\n", 0, found.start()) + 2, found[1], found[2] or "") for found in BLOCK.finditer(text)]


def run_script(path: Path, source: str) -> str:
    """Runs a file in a process of its own; returns what it prints."""
    path.write_text(source, encoding="utf-8")
    # The working directory is another one: a relative path to the package would not be found.
    here = os.environ | {"PYTHONPATH": str(Path(tdcr.__file__).parents[1])}
    done = subprocess.run([sys.executable, path], capture_output=True, text=True, check=False, timeout=60, env=here)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("page", PAGES)
def test_guides_run_as_printed(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for package in PAGES[page]:
        pytest.importorskip(package)
    if "matplotlib" in PAGES[page]:
        importlib.import_module("matplotlib").use("Agg")
    monkeypatch.chdir(tmp_path)
    found = blocks(page)
    assert found, page
    names: dict[str, Any] = {"__name__": "__main__"}
    for line, source, expected in found:
        if script := SCRIPT.match(source):
            assert run_script(tmp_path / script[1], source) == expected, f"{page}, line {line}"
            continue
        printed = io.StringIO()
        # Errors name the page and its line.
        code = compile("\n" * (line - 1) + source, str(DOCS / page), "exec")
        with contextlib.redirect_stdout(printed):
            exec(code, names)
        assert printed.getvalue() == expected, f"{page}, line {line}"


def documented() -> set[str]:
    """Full names that the pages of the reference have directives for."""
    names = set()
    for page in (DOCS / "python").glob("*.md"):
        module = ""
        for kind, name in DIRECTIVE.findall(page.read_text(encoding="utf-8")):
            if kind == "currentmodule":
                module = name
            elif kind != "module":
                names.add(name if name.startswith("tdcr.") else f"{module}.{name}")
    return names


@pytest.mark.parametrize("module", [*MODULES, *(f"tdcr.{name}" for name in OPTIONAL)])
def test_the_reference_has_every_public_name(module: str) -> None:
    imported = optional(module)
    found = documented()
    own = [name for name, value in vars(imported).items() if getattr(value, "__module__", None) == module]
    public = [name for name in getattr(imported, "__all__", own) if not name.startswith(("_", "as_"))]
    assert public, module
    missing = []
    for name in public:
        value = getattr(imported, name)
        # A name stands where users look for it: `tdcr.inverse.calibrate` as `tdcr.calibrate`.
        homes = {module, "tdcr", getattr(value, "__module__", module)}
        if not isinstance(value, ModuleType) and not any(f"{home}.{name}" in found for home in homes):
            missing.append(name)
    assert not missing, f"names of {module} without a directive in docs/python"


def test_what_the_reference_has_exists() -> None:
    names = documented()
    assert len(names) > 80
    for name in names:
        module, _, attribute = name.rpartition(".")
        if all(importlib.util.find_spec(package) for package in OPTIONAL.get(module.partition(".")[2], [])):
            assert hasattr(importlib.import_module(module), attribute), name

"""What several tests of the package share: a small data set, and a network trained for a moment."""

from __future__ import annotations

import webbrowser
from pathlib import Path

import pytest
from by_command_line import TINY

import tdcr


@pytest.fixture(autouse=True)
def no_window(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing opens a browser on the screen of who runs the tests; the page is served as if one had been opened."""
    monkeypatch.setattr(webbrowser, "open", lambda address: True)


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("package")


@pytest.fixture(scope="session")
def dataset(folder: Path) -> tdcr.Dataset:
    made = tdcr.collect("2m", folder / "data", samples=20, points=400, payload=(0.0, 0.03), seed=3)
    assert made is not None
    return made


@pytest.fixture(scope="session")
def run(folder: Path, dataset: tdcr.Dataset) -> tdcr.Run:
    return tdcr.train(dataset, folder / "run", steps=60, colors=True, **TINY)

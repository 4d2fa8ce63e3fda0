"""Every notebook runs from its second cell to its end, and prints what is checked in."""

import importlib.util
import re
import sys
from pathlib import Path

import pytest

pytest.importorskip("nbclient", reason="nbclient runs notebooks")
nbformat = pytest.importorskip("nbformat")

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "examples/notebooks").glob("*.ipynb"))

NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")


def runner():
    """`scripts/notebooks.py` as a module."""
    spec = importlib.util.spec_from_file_location("notebooks", ROOT / "scripts/notebooks.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["notebooks"] = module
    spec.loader.exec_module(module)
    return module


def printed(notebook):
    """What each cell prints to stdout."""
    return [
        "".join(output["text"] for output in cell.outputs if output.get("name") == "stdout")
        for cell in notebook.cells
        if cell.cell_type == "code"
    ]


def pictures(notebook):
    """How many pictures each cell shows."""
    return [
        sum("image/png" in output.get("data", {}) for output in cell.outputs)
        for cell in notebook.cells
        if cell.cell_type == "code"
    ]


def test_there_is_a_notebook_for_each_of_three_tasks():
    assert {path.stem for path in NOTEBOOKS} == {"design", "flow_model", "calibrate"}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_prints_what_is_checked_in(path):
    kept = nbformat.read(path, as_version=4)
    first = kept.cells[0]
    assert first.cell_type == "code" and "%pip install" in first.source and not first.outputs
    ran = runner().run(nbformat.read(path, as_version=4))
    assert pictures(ran) == pictures(kept) and sum(pictures(kept)) >= 1
    for now, then in zip(printed(ran), printed(kept)):
        assert NUMBER.sub("0", now) == NUMBER.sub("0", then)
        # Other processors round otherwise.
        values = [[float(number) for number in NUMBER.findall(text)] for text in (now, then)]
        assert values[0] == pytest.approx(values[1], rel=0.02, abs=1e-9)

#!/usr/bin/env python3
"""Runs the notebooks of `examples/notebooks` and keeps what they print and show: `make notebooks`.

scripts/notebooks.py            all of them
scripts/notebooks.py design     one

The first cell of each, which installs, is not run here. Outputs are written without times of day and counts of cells, so that
running them again changes little.
"""

import os
import sys
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).resolve().parent.parent / "examples/notebooks"


def run(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """The notebook with the outputs of all cells but the first, which installs. Raises where a cell does."""
    os.environ.setdefault("MPLBACKEND", "module://matplotlib_inline.backend_inline")
    install, notebook.cells = notebook.cells[0], notebook.cells[1:]
    try:
        # Named, so that no other interpreter's kernel is taken.
        NotebookClient(
            notebook, timeout=300, kernel_name="python3", record_timing=False, resources={"metadata": {"path": FOLDER}}
        ).execute()
    finally:
        notebook.cells.insert(0, install)
    return notebook


def main() -> None:
    names = sys.argv[1:] or sorted(path.stem for path in FOLDER.glob("*.ipynb"))
    for name in names:
        path = FOLDER / f"{name}.ipynb"
        started = time.monotonic()
        notebook = run(nbformat.read(path, as_version=4))
        for cell in notebook.cells:
            if cell.cell_type == "code":
                cell.execution_count = None
                # Progress bars and warnings go to stderr.
                cell.outputs = [output for output in cell.outputs if output.get("name") != "stderr"]
                for output in cell.outputs:
                    if "execution_count" in output:
                        output.execution_count = None
        nbformat.write(notebook, path)
        print(f"{path.name}: {time.monotonic() - started:.0f} s, {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()

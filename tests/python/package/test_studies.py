"""Studies from Python are those of the command line, in parts and whole."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from by_command_line import command_line

import tdcr
from tdcr.errors import DataError, InputError

STUDY: dict[str, Any] = {
    "want": ["tip", "deflection"],
    "vary": [{"what": "payload", "range": [0.0, 0.03], "steps": 3}, {"what": "command"}],
    "sample": {"count": 8},
}
TOML = """
want = ["tip", "deflection"]
vary = [{ what = "payload", range = [0.0, 0.03], steps = 3 }, { what = "command" }]
sample = { count = 8 }
"""


def files(folder: Path) -> dict[str, bytes]:
    """The files of a study that do not tell the time."""
    found = (path for path in folder.rglob("*") if path.is_file() and "parts" not in path.relative_to(folder).parts)
    return {str(p.relative_to(folder)): p.read_bytes() for p in found if p.name not in ("study.json", ".lock")}


def test_a_study_is_that_of_the_command_line(tmp_path: Path) -> None:
    file = tmp_path / "study.toml"
    file.write_text(TOML)
    by_python, by_line = tmp_path / "python", tmp_path / "line"
    steps: list[int] = []
    said = tdcr.study(STUDY, by_python, progress=steps.append)
    assert (said["rows"], said["settled"], sum(steps)) == (24, 24, 24)
    assert command_line("study", file, "--out", by_line)["rows"] == 24
    assert files(by_python) == files(by_line)
    with (by_python / "table.csv").open() as table:
        rows = list(csv.DictReader(table))
    robot = tdcr.Robot("2m")
    commands = np.array([[float(row[f"c{k} (m)"]) for k in range(6)] for row in rows])
    settled = tdcr.settle_batch(robot, commands, payload=[float(row["payload (kg)"]) for row in rows])
    tips = [[float(row[f"tip_{axis} (m)"]) for axis in "xyz"] for row in rows]
    np.testing.assert_allclose(settled.tips, tips, atol=1e-12)


def test_parts_merged_are_the_files_of_one_run(tmp_path: Path) -> None:
    whole = tmp_path / "whole"
    tdcr.study(STUDY, whole)
    parts = [tmp_path / f"part-{number}" for number in (1, 2, 3)]
    for number, part in enumerate(parts, 1):
        tdcr.study(STUDY, part, part=f"{number}/3")
    merged = tmp_path / "merged"
    assert tdcr.merge_study(parts, merged)["rows"] == 24
    assert files(merged) == files(whole)
    with pytest.raises(InputError, match="expected all parts of one study, each once"):
        tdcr.merge_study(parts[1:], merged)


def test_a_study_on_ray_is_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ray = pytest.importorskip("ray")
    # Ray joins a cluster that it finds on the machine, and another test may have one.
    monkeypatch.setenv("RAY_ADDRESS", "local")
    whole, by_ray = tmp_path / "whole", tmp_path / "ray"
    tdcr.study(STUDY, whole)
    try:
        assert tdcr.study(STUDY, by_ray, engine="ray", parts=3)["rows"] == 24
    finally:
        # Ray goes on after a study, and other tests start clusters of their own.
        ray.shutdown()
    assert files(by_ray) == files(whole)


def test_what_is_wrong_is_named(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(InputError, match=r"`want\[0\]` is \"tips\"; expected one of tip"):
        tdcr.study({"want": ["tips"]}, out)
    with pytest.raises(InputError, match="want is {1, 2}; expected numbers, texts, lists and dictionaries"):
        tdcr.study({"want": {1, 2}}, out)
    with pytest.raises(InputError, match="cannot read study"):
        tdcr.study(tmp_path / "absent.toml", out)
    with pytest.raises(InputError, match="expected None or 'ray'"):
        tdcr.study(STUDY, out, engine="dask")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="which runs all parts"):
        tdcr.study(STUDY, out, engine="ray", part="1/2")
    tdcr.study(STUDY, out)
    with pytest.raises(DataError, match="holds another study"):
        tdcr.study({**STUDY, "seed": 1}, out)
    assert json.loads((out / "study.json").read_text())["settled"] == 24


def test_a_study_in_a_scene_is_that_of_the_command_line(tmp_path: Path) -> None:
    post = tdcr.Obstacle.cylinder("post", 0.01, 0.4, position=(-0.06, 0.0, 0.25))
    scene = tdcr.Scene([post])
    scene.save(tmp_path / "post.toml")
    study = STUDY | {"want": ["tip", "contact"]}
    file = tmp_path / "study.toml"
    file.write_text('scene = "post.toml"' + TOML.replace('"deflection"', '"contact"'))
    by_python, by_line = tmp_path / "python", tmp_path / "line"
    tdcr.study(study, by_python, scene=scene)
    command_line("study", file, "--out", by_line)
    assert files(by_python) == files(by_line)
    with (by_python / "table.csv").open() as table:
        rows = list(csv.DictReader(table))
    commands = np.array([[float(row[f"c{k} (m)"]) for k in range(6)] for row in rows])
    settled = tdcr.settle_batch("2m", commands, payload=[float(row["payload (kg)"]) for row in rows], scene=scene)
    counts = np.bincount(settled.contacts.row, minlength=len(rows))
    assert [int(row["contacts"]) for row in rows] == counts.tolist() and counts.any()
    with pytest.raises(InputError, match="there is no scene"):
        tdcr.study(study, tmp_path / "other")

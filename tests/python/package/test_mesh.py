"""Obstacles that are meshes of arrays: beside boxes, and the same meshes in files."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tdcr
from tdcr import Obstacle, Scene
from tdcr.errors import SceneError

COMMAND = np.array([0.034, 0.007, 0.001, 0.026, 0.015, 0.019])
SIZE = np.array([0.04, 0.06, 0.3])
CORNERS = SIZE * (np.array([[k >> 2 & 1, k >> 1 & 1, k & 1] for k in range(8)]) - 0.5)
FACES = [
    *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5]),
    *([0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6]),
    *([0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
]
SURFACE: dict[str, Any] = {
    "position": (-0.085, 0.0, 0.25),
    "orientation": (0.99, 0.0, 0.05, 0.1),
    "compliance": 1e-5,
    "friction": 0.2,
}


def write_stl(path: Path) -> None:
    """The mesh in millimetres."""
    facets = ""
    for face in FACES:
        corners = "".join("vertex {} {} {}\n".format(*(1000.0 * CORNERS[corner])) for corner in face)
        facets += f"facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n"
    path.write_text(f"solid part\n{facets}endsolid part\n", encoding="utf-8")


def test_a_mesh_of_arrays_is_touched_as_the_same_box_and_file(tmp_path: Path) -> None:
    part = Obstacle.mesh("part", vertices=CORNERS, triangles=np.array(FACES, dtype=np.uint8), **SURFACE)
    assert part.kind == "mesh" and part.friction == 0.2 and part.size["triangles"][1] == (0, 3, 2)
    found = tdcr.settle("2m", COMMAND, scene=Scene([part])).check()
    box = tdcr.settle("2m", COMMAND, scene=Scene([Obstacle.box("part", SIZE, **SURFACE)])).check()
    assert found.contacts is not None and box.contacts is not None and len(box.contacts) > 0
    np.testing.assert_allclose(found.positions, box.positions, atol=1e-9)
    np.testing.assert_allclose(found.contacts.force.sum(axis=0), box.contacts.force.sum(axis=0), rtol=1e-6)
    write_stl(tmp_path / "part.stl")
    read = Scene([Obstacle.mesh("part", tmp_path / "part.stl", 0.001, **SURFACE)])
    np.testing.assert_allclose(tdcr.settle("2m", COMMAND, scene=read).positions, found.positions, atol=1e-6)
    in_millimetres = Obstacle.mesh("part", vertices=1000.0 * CORNERS, triangles=FACES, scale=0.001, **SURFACE)
    np.testing.assert_allclose(in_millimetres.size["vertices"], CORNERS, atol=1e-15)
    moved = tdcr.simulate("2m", np.tile(COMMAND, (50, 1)), scene=Scene([part]), start="settled")
    assert moved.contacts is not None and len(moved.contacts) > 0


def test_a_scene_with_a_mesh_of_arrays_is_saved_by_its_numbers(tmp_path: Path) -> None:
    scene = Scene([Obstacle.mesh("part", vertices=CORNERS, triangles=FACES, **SURFACE)])
    scene.save(tmp_path / "scene.toml")
    assert Scene.load(tmp_path / "scene.toml") == scene == pickle.loads(pickle.dumps(scene)) == Scene.from_json(scene.to_json())
    upright = Obstacle.mesh("part", vertices=CORNERS, triangles=FACES, friction=0.1)
    assert Scene([upright])["part"] == upright and upright.size["triangles"][0] == (0, 1, 3)
    assert "vertices" in scene.to_toml() and "file" not in scene.to_toml()
    many = Scene([Obstacle.mesh("large", vertices=np.tile(CORNERS / 3, (50_000, 1)), triangles=FACES)])
    with pytest.raises(SceneError, match="expected 16777216 at most: name large meshes by STL files"):
        many.save(tmp_path / "large.toml")
    assert not (tmp_path / "large.toml").exists()


@pytest.mark.parametrize(
    ("numbers", "says"),
    [
        ({"vertices": CORNERS}, r"mesh 'part' is given \['vertices'\]; expected `file`, or `vertices` and `triangles`"),
        ({"file": "a.stl", "vertices": CORNERS, "triangles": FACES}, "expected `file`, or `vertices` and `triangles`"),
        ({}, r"mesh 'part' is given \[\]"),
        ({"vertices": CORNERS[:, :2], "triangles": FACES}, r"vertices of obstacle 'part' has shape \(8, 2\); expected"),
        ({"vertices": CORNERS, "triangles": [[0, 1]]}, r"triangles of obstacle 'part' has shape \(1, 2\); expected"),
        ({"vertices": CORNERS * np.nan, "triangles": FACES}, r"vertices of obstacle 'part'\[0\]\[0\] is nan"),
        ({"vertices": CORNERS, "triangles": [[0, 1, -1]]}, r"'part'\[0\]\[2\] is -1; expected the number of a vertex, from 0"),
        ({"vertices": CORNERS, "triangles": [[0, 1, 1.5]]}, r"'part'\[0\]\[2\] is 1.5; expected the number of a vertex"),
        ({"vertices": CORNERS, "triangles": [[0, 1, 8]]}, r"triangle 0 of a mesh is \[0, 1, 8\]; the mesh has 8 vertices"),
        ({"vertices": np.zeros((0, 3)), "triangles": np.zeros((0, 3))}, "a mesh has no triangles; expected one at least"),
    ],
)
def test_what_is_no_mesh_is_refused(numbers: dict[str, Any], says: str) -> None:
    with pytest.raises(SceneError, match=says):
        Scene([Obstacle.mesh("part", **numbers)])

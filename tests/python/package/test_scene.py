"""Scenes: what they consist of, and that files and copies have the same."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path

import pytest

from tdcr import Obstacle, Scene


def every_kind(folder: Path) -> Scene:
    tip = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    (folder / "part.stl").write_text(f"solid part\n{tip}endsolid part\n", encoding="utf-8")
    return Scene(
        [
            Obstacle.half_space("floor"),
            Obstacle.box("box", (0.1, 0.2, 0.3), position=(1, 2, 3), orientation=(1, 1, 0, 0), friction=0.3, color=(1, 2, 3)),
            Obstacle.sphere("ball", 0.02, mass=0.1, compliance=1e-5),
            Obstacle.capsule("capsule", 0.01, 0.1),
            Obstacle.cylinder("cylinder", radius=0.01, length=0.1),
            Obstacle.pipe("pipe", 0.05, 0.3),
            Obstacle.pipe("bend", 0.05, path=[[0, 0, 0], [0, 0, 0.1], [0.05, 0, 0.2]]),
            Obstacle.mesh("part", folder / "part.stl", scale=0.001),
        ]
    )


def test_scenes_are_written_read_compared_pickled_and_moved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = every_kind(tmp_path)
    assert len(scene) == 8 and scene.names[2] == "ball" and scene["ball"] == scene[2] == scene[-6]
    assert (
        scene["ball"].size == {"radius": 0.02} and scene["ball"].mass == 0.1 and scene["bend"].size["path"][2] == (0.05, 0, 0.2)
    )
    assert repr(scene).startswith("Scene(8 obstacles: 'floor', 'box',") and repr(Scene()) == "Scene(0 obstacles)"
    assert "ball" in scene and "bell" not in scene and scene.find("floor") == 0
    assert Scene(scene) == Scene(list(scene)) == scene and Scene(scene.obstacles) is not scene
    assert (
        pickle.loads(pickle.dumps(scene)) == scene and copy.deepcopy(scene) is scene and hash(Scene(list(scene))) == hash(scene)
    )
    assert Scene.from_json(scene.to_json()) == scene
    # A file names meshes beside it, wherever it is written to.
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own").mkdir()
    scene.save("own/scene.toml")
    assert Scene.load("own/scene.toml") == scene
    Path("relative.toml").write_text("[[obstacle]]\nmesh = 'part.stl'\n", encoding="utf-8")
    loaded = Scene.load("relative.toml")
    monkeypatch.chdir(tmp_path / "own")
    assert pickle.loads(pickle.dumps(loaded)) == loaded and loaded.names == ("obstacle 0",)
    assert loaded[0].size["file"] == str(tmp_path / "part.stl")
    # Others are made of it.
    moved = scene.moved("ball", position=(0.1, 0.2, 0.3))
    assert moved["ball"].position == (0.1, 0.2, 0.3) and scene["ball"].position == (0.0, 0.0, 0.0) and moved != scene
    turned = scene.moved(1, orientation=(0, 0, 0, 2))
    assert turned["box"].orientation == (0.0, 0.0, 0.0, 1.0) and turned["box"].position == (1, 2, 3)
    assert scene.moved("box") == scene

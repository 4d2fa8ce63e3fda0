"""Scenes: what they consist of, and that files and copies have the same."""

from __future__ import annotations

import copy
import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tdcr
from tdcr import Obstacle, Scene
from tdcr.errors import SceneError


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


def test_data_sets_hold_the_scene_in_which_they_were_collected(tmp_path: Path) -> None:
    post = Obstacle.cylinder("post", 0.01, 0.4, position=(-0.06, 0.0, 0.25))
    scene = Scene([post])
    for folder, around in {"among": scene, "alone": None}.items():
        tdcr.collect("2m", tmp_path / folder, samples=10, points=300, voxel=0.004, scene=around)

    def subject(folder: str) -> dict[str, Any]:
        meta = json.loads((tmp_path / folder / "meta.json").read_text(encoding="utf-8"))
        found: dict[str, Any] = meta["origin"]["simulated"]["recipe"]["subject"]
        return found

    assert Scene.from_json(json.dumps(subject("among")["scene"])) == scene
    assert "scene" not in subject("alone")
    with pytest.raises(tdcr.TdcrError, match="cylinder.radius"):
        wider = Scene([Obstacle.cylinder("post", 0.011, 0.4, position=(-0.06, 0.0, 0.25))])
        tdcr.collect("2m", tmp_path / "among", samples=10, points=300, voxel=0.004, scene=wider)


def test_commands_for_targets_are_found_among_obstacles() -> None:
    wall = Obstacle.half_space("wall", position=(-0.05, 0.0, 0.0), orientation=(np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0))
    scene = Scene([wall])
    target = tdcr.inverse.Target(position=(0.03, 0.02, 0.33))
    found = tdcr.inverse.shape("2m", target, scene=scene)
    again = tdcr.settle("2m", found.command, scene=scene)
    np.testing.assert_allclose(found.equilibrium.positions, again.positions, atol=1e-8)


def test_a_robot_keeps_clear_of_obstacles_or_presses_on_them_as_settling_says() -> None:
    turned = (np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0)
    wall = Obstacle.half_space("wall", position=(-0.05, 0.0, 0.0), orientation=turned, compliance=1e-4)
    center, radius = np.array([0.075, 0.03, 0.29]), 0.02
    scene = Scene([wall, Obstacle.sphere("ball", radius, position=center)])
    press = tdcr.inverse.Press("wall", 0.05)
    controller = tdcr.inverse.ShapeController("2m", scene=scene)
    found = controller.reach(press=press, clearance=0.004)
    again = tdcr.settle("2m", found.command, scene=scene)
    assert found.outcome == "reached" and abs(found.forces[0] - 0.05) < 1e-5 and found.errors.shape == (0,)
    assert again.contacts is not None and set(again.contacts.obstacle_names) == {"wall"}
    # The plane's normal is x, and it gives way in proportion to the force.
    assert again.contacts.force[:, 0].sum() == pytest.approx(found.forces[0], rel=1e-6)
    assert np.maximum(-again.contacts.gap, 0.0).sum() / 1e-4 == pytest.approx(found.forces[0], rel=1e-6)
    assert found.nearest is not None and found.nearest[0] == "ball" and found.nearest[2] >= 0.004
    # The ball's middle is out of reach for the tip: it stops at the distance, or another disc does.
    kept = tdcr.inverse.shape("2m", tdcr.inverse.Target(position=center), scene=scene, clearance=0.004)
    assert kept.outcome == "unreachable" and kept.obstacles[0][0] == "ball" and kept.obstacles[0][2] > 0.0
    assert kept.nearest == ("ball", kept.obstacles[0][1], pytest.approx(0.004, abs=1e-4))
    assert np.linalg.norm(kept.equilibrium.tip - center) == pytest.approx(kept.errors[0])
    assert kept.errors[0] > radius + 0.004
    for wrong, error, says in [
        (
            {"press": press, "clearance": -1.0},
            tdcr.errors.InputError,
            "the clearance is -1 m; expected a finite distance of at least 0",
        ),
        ({"clearance": float("nan")}, tdcr.errors.InputError, "clearance"),
        ({"press": tdcr.inverse.Press("wall", -1.0)}, tdcr.errors.InputError, "finite numbers above 0"),
        ({"press": tdcr.inverse.Press("wall", 1.0, disc=10)}, tdcr.errors.InputError, "disc of a press is 10"),
        ({"press": tdcr.inverse.Press("well", 1.0)}, tdcr.errors.SceneError, "no obstacle 'well'; expected one of wall, ball"),
        ({}, tdcr.errors.InputError, "no target is given"),
    ]:
        with pytest.raises(error, match=says):
            controller.reach(**wrong)
    with pytest.raises(tdcr.errors.InputError, match="there are no obstacles"):
        tdcr.inverse.shape("2m", tdcr.inverse.Target(position=center), clearance=0.001)
    toy = Scene([Obstacle.sphere("toy", 0.01, position=(0.1, 0.0, 0.2), mass=0.1)])
    with pytest.raises(tdcr.errors.InputError, match="the obstacle can move"):
        tdcr.inverse.shape("2m", press=tdcr.inverse.Press("toy", 1.0), scene=toy)


def test_clouds_and_streams_are_of_the_robot_among_obstacles() -> None:
    post = tdcr.Obstacle.cylinder("post", 0.01, 0.4, position=(-0.06, 0.0, 0.25))
    screen = tdcr.Obstacle.box("screen", (0.3, 0.002, 0.6), position=(0.0, -0.06, 0.3))
    command = [0.034, 0.007, 0.001, 0.026, 0.015, 0.019]
    settled = tdcr.settle("2m", command, scene=tdcr.Scene([post]))
    open_view, hidden = (tdcr.cloud("2m", settled, scene=scene) for scene in (None, tdcr.Scene([screen])))
    assert 0 < len(hidden.points) < 0.9 * len(open_view.points)
    # No point is of the screen.
    apart = np.linalg.norm(hidden.points[:, None] - settled.positions[None], axis=2).min(axis=1)
    assert apart.max() < 0.04
    scene = tdcr.Scene([post])
    stream, free = tdcr.Stream(scene=scene, points=200), tdcr.Stream(points=200)
    assert tdcr.Stream(scene=scene, points=200).spec == stream.spec != free.spec
    samples = [(next(stream), next(free)) for _ in range(6)]
    assert all(np.array_equal(one.condition, other.condition) for one, other in samples)
    assert any(not np.array_equal(one.points, other.points) for one, other in samples)
    again = pickle.loads(pickle.dumps(tdcr.Stream(scene=scene, points=200)))
    assert np.array_equal(next(again).points, samples[0][0].points)


def test_smoothing_gives_gradients_by_obstacles_that_are_not_touched() -> None:
    torch = pytest.importorskip("torch")
    import tdcr.torch

    command = torch.tensor([0.034, 0.007, 0.001, 0.026, 0.015, 0.019], dtype=torch.float64)
    exact = Scene([Obstacle.cylinder("post", 0.01, 0.4, position=(-0.15, 0.0, 0.25), compliance=1e-5)])
    smooth = exact.with_smoothing(1e-4)
    assert (exact.smoothing, smooth.smoothing) == (0.0, 1e-4) and smooth != exact
    assert Scene.from_json(smooth.to_json()) == smooth and pickle.loads(pickle.dumps(smooth)) == smooth
    place = torch.tensor([one.position for one in exact], dtype=torch.float64, requires_grad=True)

    def tip(place: torch.Tensor, scene: Scene) -> torch.Tensor:
        positions, _ = tdcr.torch.settle("2m", command, scene=scene, obstacle_positions=place)
        return positions[-1].sum()

    (none,) = torch.autograd.grad(tip(place, exact), place)
    (found,) = torch.autograd.grad(tip(place, smooth), place)
    assert none.abs().max() < 1e-6 and found.abs().max() > 1e-3
    assert torch.autograd.gradcheck(lambda place: tip(place, smooth), place, eps=1e-6, atol=1e-5)
    with pytest.raises(SceneError, match=r"`smoothing` is -1; expected a number from 0 to 1 \(J\)"):
        exact.with_smoothing(-1.0)
    with pytest.raises(SceneError, match="smoothing has entries of type"):
        exact.with_smoothing("a")  # type: ignore[arg-type]

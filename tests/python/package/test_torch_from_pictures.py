"""Baselines that learn from pictures, from a data set to its scores: runs, interruptions, files, and what is refused."""

import json

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="no PyTorch here: install tests/python/requirements-torch.txt")
safetensors_torch = pytest.importorskip("safetensors.torch")

from tdcr import Robot, evaluate, export_clouds, import_clouds  # noqa: E402
from tdcr.errors import InputError  # noqa: E402
from tdcr.torch.baselines import BaselineModel, Run, Settings, ffksm, method, splat  # noqa: E402
from tdcr.torch.baselines.__main__ import main  # noqa: E402
from tdcr.torch.baselines.views import Views, with_pictures  # noqa: E402
from tdcr.torch.trainer import Interrupted  # noqa: E402

NAMES = ("ffksm", "splat")


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """Few Gaussians, few steps of their fit, a coarse grid."""
    monkeypatch.setattr(splat, "COUNT", 100)
    monkeypatch.setattr(splat, "FIT_STEPS", 1)
    monkeypatch.setattr(splat, "ENLARGED", 0.5)
    monkeypatch.setattr(ffksm, "CELLS", 16)


@pytest.mark.parametrize("name", NAMES)
def test_a_run_that_was_interrupted_ends_as_one_that_was_not(dataset, tmp_path, name):
    counts = {"batch": 2, "points": 2, "validations": 2, "validation_clouds": 1, "validation_points": 100}
    settings = Settings(**counts, learning_rate=1e-3, steps=4, seed=5)
    Run(method(name), dataset.path, tmp_path / "whole", settings).run()
    calls = iter([True])
    with pytest.raises(Interrupted):
        Run(method(name), dataset.path, tmp_path / "half", settings, interrupted=lambda: next(calls, False)).run()
    Run(method(name), dataset.path, tmp_path / "half", settings).run()
    assert (tmp_path / "half/log.csv").read_bytes() == (tmp_path / "whole/log.csv").read_bytes()
    one, two = (safetensors_torch.load_file(tmp_path / run / "model.safetensors") for run in ("half", "whole"))
    assert all(torch.equal(one[key], two[key]) for key in one)


@pytest.mark.parametrize("name", NAMES)
def test_a_method_is_trained_predicts_and_is_scored_by_commands(dataset, tmp_path, name, capsys):
    run = [name, "--data", dataset.path, "--out", str(tmp_path / "run"), "--batch", "2", "--points", "4", "--steps", "3"]
    assert main([*run, "--validation-clouds", "1", "--validation-points", "100", "--quiet", "--json", "--device", "cpu"]) == 0
    assert json.loads(capsys.readouterr().out)["method"] == name
    clouds = tmp_path / "clouds.npz"
    ask = ["predict", "--model", str(tmp_path / "run"), "--data", dataset.path, "--points", "120", "--out", str(clouds)]
    assert main([*ask, "--quiet", "--device", "cpu"]) == 0
    assert np.isfinite(evaluate(predictions=clouds, data=dataset, emd_points=50)["cd"])
    with np.load(clouds) as found:
        alone = BaselineModel.load(tmp_path / "run").predict(found["commands"][1:2], 120, seed=1)
        np.testing.assert_allclose(alone[0], found["points"][1], atol=1e-5)


def test_pictures_do_not_depend_on_how_many_are_taken(dataset):
    all_views, few = Views.render(dataset.path, size=30), Views.render(dataset.path, size=30, samples=3)
    assert torch.equal(all_views.bits[:3], few.bits)
    sample, camera = torch.tensor([2, 1]), torch.tensor([0, 7])
    for one, other in zip(all_views.images(sample, camera), few.images(sample, camera), strict=True):
        assert torch.equal(one, other)
    _, masks = few.images(sample, camera)
    pixel = torch.arange(900).expand(2, -1)
    assert torch.equal(few.shown(sample[:, None], camera[:, None], pixel).float(), masks)
    assert 0.005 < float(masks.mean()) < 0.2


def test_cameras_that_stand_freely_are_refused():
    placed = {"position": [0.0, -0.5, 0.3], "aim": {"at": [0.0, 0.0, 0.3]}, "lens": {"fovy": 45.0}, "resolution": [64, 48]}
    robot = Robot({**Robot("2m").to_dict(), "cameras": [placed]})
    with pytest.raises(InputError, match="expected a ring of undistorted cameras"):
        with_pictures(robot, 100)


@pytest.mark.parametrize("name", NAMES)
def test_data_sets_without_recipe_and_masks_are_refused(dataset, tmp_path, name, capsys):
    export_clouds(dataset, tmp_path / "clouds", "npz")
    import_clouds(tmp_path / "clouds/train", tmp_path / "imported", points=100)
    run = [
        name,
        "--data",
        str(tmp_path / "imported"),
        "--out",
        str(tmp_path / "run"),
        "--steps",
        "1",
        "--quiet",
        "--device",
        "cpu",
    ]
    assert main(run) == 1
    assert "no recipe to render pictures and masks from, and it holds none" in capsys.readouterr().err

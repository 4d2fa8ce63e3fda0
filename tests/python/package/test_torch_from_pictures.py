"""Baselines that learn from pictures, from a data set to its scores: runs, interruptions, files, and what is refused."""

import json
import shutil

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="no PyTorch here: install tests/python/requirements-torch.txt")
safetensors_torch = pytest.importorskip("safetensors.torch")

from PIL import Image  # noqa: E402

from tdcr import Robot, collect, evaluate, export_clouds, import_clouds, settle, vision  # noqa: E402
from tdcr.errors import DataError, InputError  # noqa: E402
from tdcr.torch.baselines import BaselineModel, Pictures, Run, Settings, ffksm, method, splat  # noqa: E402
from tdcr.torch.baselines.__main__ import main  # noqa: E402
from tdcr.torch.baselines.captured import Small  # noqa: E402
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


@pytest.fixture(scope="module")
def captured(tmp_path_factory):
    """A set as if `tdcr capture` had made it: with its journal, and the training samples' frames and masks by its cameras."""
    folder = tmp_path_factory.mktemp("captured")
    cameras = Robot("2m").to_dict()["cameras"]
    robot = {**Robot("2m").to_dict(), "cameras": {**cameras, "resolution": [160, 120]}}
    data = collect(robot, folder / "set", samples=10, points=200, payload=(0.0, 0.01), seed=1)
    lines = [json.dumps({"format": 1})]
    for number, (*command, payload) in enumerate(data.train.conditions.tolist(), start=7):
        entry = {"kind": "sample", "index": number, "command": command, "payload": payload}
        lines.append(json.dumps({"entry": entry}))
        settled = settle(data.robot, command, payload=payload)
        for place, view in enumerate(vision.render(data.robot, settled.configuration, base=bool(data.base))):
            for kind, pixels in (("frames", view.color), ("masks", np.uint8(255) * (view.mask > 0))):
                (folder / kind / f"camera{place}").mkdir(parents=True, exist_ok=True)
                Image.fromarray(pixels).save(folder / kind / f"camera{place}/{number:06}.png")
    (folder / "set/capture.jsonl").write_text("\n".join(lines))
    return folder


def test_pictures_of_a_capture_are_those_that_would_be_rendered(captured):
    found = Pictures(captured / "masks", captured / "frames").read(captured / "set", size=80)
    rendered = Views.render(captured / "set", size=60)
    sample, camera = torch.meshgrid(torch.arange(len(found)), torch.arange(len(found.cameras)), indexing="ij")
    color, mask = found.images(sample.ravel(), camera.ravel())
    expected = rendered.images(sample.ravel(), camera.ravel())[1].reshape(-1, 60, 60)
    # A rendered picture is square; a captured one has all that the camera saw, black below.
    mask = mask.reshape(-1, 80, 80)
    assert not mask[:, 60:].any()
    mask = mask[:, :60, 10:70]
    assert torch.minimum(mask, expected).sum() > 0.9 * torch.maximum(mask, expected).sum() > 1000
    assert color.max() > 0.3
    assert torch.allclose(found.cameras.centres, rendered.cameras.centres)
    black = Pictures(captured / "masks").read(captured / "set", size=80)
    assert torch.equal(black.bits, found.bits) and black.colors.max() == 0


def test_small_pictures_have_no_distortion():
    robot = Robot("2m")
    plain = {"position": [0.0, -0.5, 0.3], "aim": {"at": [0.12, 0.0, 0.35]}, "lens": {"fovy": 45.0}, "resolution": [320, 240]}
    bent = {**plain, "distortion": {"k1": -0.3, "k2": 0.1, "p1": 0.01, "p2": -0.02}}
    command = robot.random_commands(1, seed=3)[0]

    def small(camera):
        seen = Robot({**robot.to_dict(), "cameras": [camera]})
        view = vision.render(seen, settle(seen, command).configuration)[0]
        return Small.of(view, 100).shrink(view.mask > 0, view.color)[0], view.mask > 0

    (straight, large), (mended, folded) = small(plain), small(bent)
    assert (large != folded).sum() > 0.1 * large.sum()
    assert (straight & mended).sum() > 0.97 * (straight | mended).sum()


def test_methods_learn_from_pictures_of_a_capture_by_commands(captured, tmp_path, capsys):
    run = ["--data", str(captured / "set"), "--batch", "2", "--points", "2", "--steps", "2", "--validation-clouds", "1"]
    run += ["--validation-points", "50", "--quiet", "--json", "--device", "cpu", "--masks", str(captured / "masks")]
    assert main(["ffksm", "--out", str(tmp_path / "masks"), *run]) == 0
    assert main(["splat", "--out", str(tmp_path / "colours"), "--frames", str(captured / "frames"), *run]) == 0
    assert [json.loads(line)["steps"] for line in capsys.readouterr().out.splitlines()] == [2, 2]
    # The same folder goes on with the same pictures alone.
    assert main(["ffksm", "--out", str(tmp_path / "masks"), *run[:-2], "--seed", "0"]) == 1
    assert "cannot be resumed: pictures is" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "folders", "said"),
    [
        ("vsm", ["masks"], "vsm learns from clouds"),
        ("ffksm", ["masks", "frames"], "ffksm learns from masks alone"),
        ("splat", ["masks"], "splat learns from colours too"),
        ("splat", ["frames"], "--frames without --masks"),
    ],
)
def test_pictures_that_a_method_does_not_learn_from_are_refused(captured, tmp_path, capsys, name, folders, said):
    given = [word for folder in folders for word in (f"--{folder}", str(captured / folder))]
    run = [name, "--data", str(captured / "set"), "--out", str(tmp_path / "run"), "--steps", "1", "--quiet", "--device", "cpu"]
    assert main([*run, *given]) == 1
    assert said in capsys.readouterr().err


def test_wrong_pictures_and_journals_are_refused_by_name(captured, dataset, tmp_path):
    shutil.copytree(captured / "masks", tmp_path / "masks")
    pictures, one = Pictures(tmp_path / "masks"), tmp_path / "masks/camera1/000007.png"
    with pytest.raises(DataError, match=r"capture\.jsonl: there is no such file"):
        pictures.read(dataset.path)
    Image.new("L", (10, 20)).save(one)
    with pytest.raises(DataError, match=r"camera1/000007\.png: 10 x 20 pixels, expected the camera's"):
        pictures.read(captured / "set")
    one.write_bytes(b"no picture")
    with pytest.raises(DataError, match=r"000007\.png: no picture that can be read"):
        pictures.read(captured / "set")
    one.unlink()
    with pytest.raises(DataError, match=r"000007\.png: there is no such file"):
        pictures.read(captured / "set")
    shutil.copytree(captured / "set", tmp_path / "set")
    journal = tmp_path / "set/capture.jsonl"
    lines = journal.read_text().splitlines()
    journal.write_text("\n".join(lines[:-1]))
    with pytest.raises(DataError, match="has no sample of the command"):
        pictures.read(tmp_path / "set")
    journal.write_text("\n".join([*lines, "{"]))
    with pytest.raises(DataError, match="is none of `tdcr capture`"):
        pictures.read(tmp_path / "set")

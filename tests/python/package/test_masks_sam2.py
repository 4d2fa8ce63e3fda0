"""The example that masks pictures by SAM 2, with a predictor in SAM 2's place."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

EXAMPLE = Path(__file__).parents[3] / "examples/python/masks_sam2.py"


def example():
    spec = importlib.util.spec_from_file_location("masks_sam2", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Logits:
    """One object's logits, as a tensor on any device has them."""

    def __init__(self, array):
        self.array = array

    def __getitem__(self, key):
        return Logits(self.array[key])

    def __gt__(self, number):
        return Logits(self.array > number)

    def cpu(self):
        return self.array


class Predictor:
    """Finds a square that moves by a pixel with each picture, where a point on it was given."""

    def init_state(self, video_path):
        # SAM 2 reads JPEG files in the order of their numbers.
        frames = sorted(int(path.stem) for path in Path(video_path).glob("*.jpg"))
        assert frames == list(range(len(frames)))
        return {"count": len(frames)}

    def add_new_points_or_box(self, inference_state, frame_idx, obj_id, points, labels):
        assert points.dtype == np.float32 and points.shape == (2, 2) and labels.tolist() == [1, 0]
        inference_state["start"] = frame_idx

    def propagate_in_video(self, state, reverse=False):
        start = state["start"]
        for index in range(start, -1, -1) if reverse else range(start, state["count"]):
            logits = np.full((1, 1, 6, 8), -3.0)
            logits[0, 0, 2:4, index : index + 2] = 2.5
            yield index, [1], Logits(logits)


@pytest.fixture
def arguments(tmp_path):
    prompts = {}
    # The second camera's first sample is the sixth: a capture that was resumed.
    for camera, first in (("camera0", 0), ("camera1", 5)):
        folder = tmp_path / "frames" / camera
        folder.mkdir(parents=True)
        for sample in range(first, first + 4):
            # As `tdcr log pictures` writes them, and as other programs may.
            Image.new("RGB", (8, 6)).save(folder / f"{sample:06}.{'jpg' if first else 'png'}")
        prompts[camera] = {"sample": first + 1, "points": [[2, 3], [7, 0]], "labels": [1, 0]}
    (tmp_path / "prompts.json").write_text(json.dumps(prompts))
    paths = {"frames": "frames", "prompts": "prompts.json", "out": "masks"}
    return [word for name, path in paths.items() for word in (f"--{name}", str(tmp_path / path))]


def test_masks_are_named_by_camera_and_sample(arguments, tmp_path, capsys):
    assert example().main(arguments, load=lambda name: Predictor()) == 0
    assert capsys.readouterr().out == "camera0: 4 masks\ncamera1: 4 masks\n"
    found = sorted(str(path.relative_to(tmp_path / "masks")) for path in (tmp_path / "masks").rglob("*.png"))
    expected = [f"camera{camera}/{first + k:06}.png" for camera, first in ((0, 0), (1, 5)) for k in range(4)]
    assert found == expected
    mask = Image.open(tmp_path / "masks/camera1/000007.png")
    assert mask.mode == "L" and mask.size == (8, 6)
    array = np.asarray(mask)
    assert set(np.unique(array)) == {0, 255} and array[2:4, 2:4].min() == 255 and array.astype(bool).sum() == 4


def test_what_is_missing_is_said(arguments, tmp_path, capsys):
    assert example().main(arguments) == 1
    assert "SAM 2 is not installed here" in capsys.readouterr().err
    prompts = json.loads((tmp_path / "prompts.json").read_text())
    prompts["camera0"]["sample"] = 9
    (tmp_path / "prompts.json").write_text(json.dumps(prompts))
    assert example().main(arguments, load=lambda name: Predictor()) == 1
    assert "sample 9 of the prompts is not in" in capsys.readouterr().err

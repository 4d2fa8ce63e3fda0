"""Prediction from a model file in NumPy alone, by the section of docs/model-files.md on the network and its sampler."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import tdcr
from tdcr import _tdcr

Array = NDArray[np.float64]

COMMANDS = [[0.034, 0.007, 0.001, 0.026, 0.015, 0.019, 0.02], [0.002, 0.011, 0.03, 0.0, 0.022, 0.013, 0.0]]


class File:
    """A model file: its header and its tensors."""

    def __init__(self, path: Path) -> None:
        content = path.read_bytes()
        length = int.from_bytes(content[:8], "little")
        table, data = json.loads(content[8 : 8 + length]), content[8 + length :]
        self.header = json.loads(table.pop("__metadata__")["tdcr"])
        self.tensors = {
            name: np.frombuffer(data[slice(*entry["data_offsets"])], "<f4").reshape(entry["shape"]).astype(float)
            for name, entry in table.items()
        }

    def write(self, path: Path) -> None:
        table: dict[str, Any] = {"__metadata__": {"tdcr": json.dumps(self.header)}}
        data = b""
        for name, tensor in self.tensors.items():
            end = len(data) + 4 * tensor.size
            table[name] = {"dtype": "F32", "shape": list(tensor.shape), "data_offsets": [len(data), end]}
            data += tensor.astype("<f4").tobytes()
        head = json.dumps(table).encode()
        path.write_bytes(len(head).to_bytes(8, "little") + head + data)


@pytest.fixture(scope="module")
def model(dataset: tdcr.Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A network that learned a little, with all that a network may have, and a network of the last evaluation."""
    folder = tmp_path_factory.mktemp("again")
    sizes = {"width": 32, "depth": 3, "embedding": 32, "octaves": 3, "condition_blocks": 1}
    run = tdcr.train(dataset, folder / "run", steps=60, clouds=8, points=64, refinement_steps=0, **sizes)
    file = File(run.model)
    file.tensors |= {f"refinement.{name}": 0.97 * tensor for name, tensor in file.tensors.items()}
    file.header["content"]["refined"] = True
    file.write(folder / "model.safetensors")
    return folder / "model.safetensors"


def silu(x: Array) -> Array:
    return x / (1 + np.exp(-x))


class Again:
    """The network and its sampler."""

    def __init__(self, file: File) -> None:
        content = file.header["content"]
        self.tensors, self.shape, self.settings = file.tensors, content["shape"], content["settings"]
        self.reach = content["reach"]
        self.units, self.reduction = content["provenance"]["normalisation"], content["provenance"].get("reduction")

    def affine(self, name: str, x: Array) -> Array:
        return x @ self.tensors[f"{name}.weight"].T + self.tensors.get(f"{name}.bias", 0.0)

    def norm(self, name: str, x: Array) -> Array:
        centred = x - x.mean(-1, keepdims=True)
        scaled = centred / np.sqrt((centred**2).mean(-1, keepdims=True) + 1e-5)
        return scaled * self.tensors[f"{name}.weight"] + self.tensors[f"{name}.bias"]

    def time_features(self, t: float) -> Array:
        half = self.shape["embedding"] // 2
        if self.shape.get("time_features", "plain") == "plain":
            angles = t * 10 ** (-4 * np.arange(half) / half)
        else:
            k = np.arange(half // 2) / (half // 2)
            angles = np.concatenate([t * 10 ** (-4 * k), -2 * np.log(1 - t + 0.001) * 40.0**-k])
        return np.concatenate([np.cos(angles), np.sin(angles)])

    def velocity(self, x: Array, t: float, condition: Array, of: str = "") -> Array:
        h = self.affine(f"{of}condition", condition)
        for block in range(self.shape.get("condition_blocks", 0)):
            m = self.norm(f"{of}condition_blocks.{block}.norm", h)
            h = m + self.affine(f"{of}condition_blocks.{block}.linear", silu(m))
        e = silu(self.affine(f"{of}time", self.time_features(t))) + silu(h)
        octaves = [f(2**k * np.pi * x[:, :3]) for k in range(self.shape.get("octaves", 0)) for f in (np.sin, np.cos)]
        h = self.affine(f"{of}input", np.concatenate([x, *octaves], axis=1)) + self.affine(f"{of}shift", e)
        for block in range(self.shape["depth"] - 1):
            gamma, beta = np.split(self.affine(f"{of}blocks.{block}.film", e), 2)
            m = self.norm(f"{of}blocks.{block}.norm", h) * (1 + gamma) + beta
            h = m + self.affine(f"{of}blocks.{block}.linear", silu(m))
        u = self.affine(f"{of}output", silu(h))
        # What it points at lies in the box of the training clouds.
        low, high = self.reach["min"], self.reach["max"]
        return u if t >= 1 else (np.clip(x + (1 - t) * u, low, high) - x) / (1 - t)

    def representative(self, command: list[float]) -> tuple[Array, dict[str, Any] | None]:
        low, high = np.array(self.units["motor_min"]), np.array(self.units["motor_max"])
        scaled = lambda values: (np.array(values) - low) / np.where(high > low, high - low, 1)  # noqa: E731
        if self.reduction is None:
            return scaled(command), None
        images = []
        for number, symmetry in enumerate(self.reduction["symmetries"]):
            image = list(command)
            for i, j in enumerate(symmetry["tendons"]):
                image[j] = command[i]
            images.append((image, number))
        image, number = min(images)
        views = self.reduction.get("views", [])
        told = [float(view == views[number]) for view in range(max(views) + 1)] if views else []
        return np.concatenate([scaled(image), told]), self.reduction["symmetries"][number]

    def flow(self, x: Array, condition: Array, denoise: float) -> Array:
        sampler = self.settings["sampler"]
        assert sampler["method"] == "exponential"
        n, p = sampler["steps"], sampler["grid"]["power"]
        times = [np.float32(1 - (1 - k / n) ** p) for k in range(n + 1)]
        before, lacked = None, 0.0
        for k, (t, end) in enumerate(zip(map(float, times), map(float, times[1:]), strict=False)):
            h, v, v_end = end - t, 1 - t, 1 - end
            first = h - (v_end * np.log(v / v_end) if v_end > 0 else 0.0)
            data = x + v * self.velocity(x, t, condition)
            slope = 0.0 if before is None else (data - before[1]) / (t - before[0])
            factor = first + (v_end / v * lacked if k == 1 else 0.0)
            x = v_end / v * x + h / v * data + factor * slope
            before, lacked = (t, data), first
        last = "refinement." if denoise == sampler["denoise"] else ""
        x = x + (1 - denoise) * self.velocity(x, denoise, condition, last)
        return self.corrected(x, denoise, condition) if last else x

    def corrected(self, x: Array, t: float, condition: Array) -> Array:
        step = (1 - t) * self.velocity(x, t, condition, "refinement.")
        squared = (step**2).sum(1, keepdims=True)
        moved: Array = x + squared / (squared + 0.00125**2) * step
        return moved

    def predict(self, command: list[float], drawn: int, seed: int, denoise: float) -> Array:
        condition, symmetry = self.representative(command)
        path = self.settings["path"]
        noise = _tdcr.start_noise(path["prior_deviation"], path["prior_cut"], drawn, False, seed)
        points = self.units["scale"] * self.flow(noise.astype(float), condition, denoise)
        if symmetry is not None:
            points = (points - symmetry["translation"]) @ np.array(symmetry["matrix"])
        return points


def isolation(points: Array) -> Array:
    distances = np.sort(np.linalg.norm(points[:, None] - points[None], axis=2), axis=1)
    mean: Array = distances[:, 1:16].mean(1)
    return mean


def relaxed(points: Array) -> Array:
    distances = np.linalg.norm(points[:, None] - points[None], axis=2)
    nearest = np.argsort(distances, axis=1)[:, :16]
    last = np.sort(distances, axis=1)[:, 15]
    r = 2.5 * np.sqrt(np.pi * last**2 / 15 / (2 * np.sqrt(3)))
    about = points[nearest] - points[nearest].mean(1, keepdims=True)
    values, vectors = np.linalg.eigh(about.transpose(0, 2, 1) @ about)
    planarity = (values[:, 1] - values[:, 0]) / values[:, 2]
    normal = vectors[:, :, 0]
    x: Array = points.astype(np.float64)
    for _ in range(5):
        apart = x[:, None] - x[nearest[:, 1:]]
        d = np.linalg.norm(apart, axis=2)
        sums = (np.maximum(1 - d / r[:, None], 0)[..., None] * apart / np.maximum(d, 1e-300)[..., None]).sum(1)
        move = (planarity * r / 2)[:, None] * (sums - normal * (sums * normal).sum(1, keepdims=True))
        length = np.linalg.norm(move, axis=1)
        x = x + move * np.minimum(1, r / 4 / np.maximum(length, 1e-300))[:, None]
    return x


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("denoise", [None, 0.98])
def test_a_cloud_is_that_of_a_program_that_knows_the_documents_alone(
    model: Path, command: list[float], denoise: float | None
) -> None:
    predictor, again = tdcr.Predictor(model, "float32"), Again(File(model))
    assert again.reduction is not None
    own = again.settings["sampler"]["denoise"]
    theirs = predictor.predict(command, 300, seed=4, sampler_spare=0.0, sampler_denoise=denoise)[0]
    np.testing.assert_allclose(theirs, again.predict(command, 300, 4, own if denoise is None else denoise), atol=5e-6)


@pytest.mark.parametrize(("denoise", "count", "spare"), [(0.98, 400, 0.01), (None, 999, 0.001)])
def test_the_points_that_are_the_most_alone_go_first_and_the_others_move_apart(
    model: Path, denoise: float | None, count: int, spare: float
) -> None:
    # Of 404 points 1 % are five, and four are spare: those alone, and no crowded one. Of 1,000 corrected ones it is the one.
    options = {"sampler_spare": spare, "sampler_denoise": denoise}
    theirs = tdcr.Predictor(model, "float32").predict(COMMANDS[0], count, seed=4, **options)[0]
    again = Again(File(model))
    drawn = count + int(np.ceil(np.float32(spare) * count))
    points = again.predict(COMMANDS[0], drawn, 4, denoise or again.settings["sampler"]["denoise"])
    kept = np.sort(np.argsort(isolation(points))[:count])
    np.testing.assert_allclose(theirs, relaxed(points[kept]), atol=5e-6)

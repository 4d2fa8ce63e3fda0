"""The networks in PyTorch: the reference values of the Rust tests are theirs, and model files carry them to Rust and back."""

import math
import pathlib
import sys

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="no PyTorch here: install tests/python/requirements-torch.txt")

from tdcr import _tdcr  # noqa: E402
from tdcr.errors import TdcrError  # noqa: E402
from tdcr.torch import Model, network, preset  # noqa: E402
from tdcr.torch.networks import from_file  # noqa: E402
from tdcr.torch.settings import complete  # noqa: E402

sys.path.insert(0, str(pathlib.Path(__file__).parents[3] / "learn/tests/data"))
import networks_torch  # noqa: E402

UNITS = {"motor_min": [0.0, -1.0], "motor_max": [0.04, 1.0], "scale": 0.35}


def model(module, shape):
    provenance = {"subject": None, "normalisation": UNITS}
    return Model(module, shape, True, provenance, complete({"steps": 100, "warmup_steps": 10}), 7, 0.25)


def stored(name):
    """A tiny network with the stored weights, and its batch."""
    shapes, tensors = networks_torch.read()
    module = network(shapes[name])
    module.load_state_dict(from_file(networks_torch.part(tensors, f"{name}.weight.")))
    batch = networks_torch.part(tensors, f"{name}.batch.")
    return shapes[name], module, tuple(batch[k] for k in ("points", "times", "conditions"))


@pytest.mark.parametrize("name", ["mlp", "hybrid"])
def test_stored_velocities_and_gradients_are_what_pytorch_computes(name):
    shapes, tensors = networks_torch.read()
    params = networks_torch.part(tensors, f"{name}.weight.")
    batch = networks_torch.part(tensors, f"{name}.batch.")
    gradients = networks_torch.part(tensors, f"{name}.gradient.")
    velocities, loss, expected = networks_torch.evaluate(shapes[name], params, batch)
    np.testing.assert_allclose(tensors[f"{name}.velocities"], velocities, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(tensors[f"{name}.loss"], [loss], rtol=1e-6)
    assert gradients.keys() == expected.keys() == params.keys()
    for key, gradient in gradients.items():
        error = torch.linalg.vector_norm(gradient - expected[key])
        assert error < 1e-6 * torch.linalg.vector_norm(expected[key]), key


@pytest.mark.parametrize("name", ["mlp", "hybrid"])
def test_points_in_another_order_have_the_same_velocities(name):
    _, module, inputs = stored(name)
    module, (points, times, conditions) = module.double(), (part.double() for part in inputs)
    order = torch.randperm(points.shape[1], generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        velocities = module(points, times, conditions)
        permuted = module(points[:, order], times, conditions)
    np.testing.assert_allclose(permuted, velocities[:, order], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", ["mlp", "hybrid"])
def test_a_written_model_has_the_same_velocities_in_rust_and_comes_back(name, tmp_path):
    shape, module, inputs = stored(name)
    path = tmp_path / "model.safetensors"
    model(module, shape).save(path)
    with torch.no_grad():
        expected = module(*inputs)
    found = _tdcr.velocities(str(path), *(part.numpy() for part in inputs))
    assert np.abs(found - expected.numpy()).max() < 1e-5 * expected.abs().max()
    loaded = Model.load(path)
    assert (loaded.shape, loaded.colors, loaded.step, loaded.validation_distance) == (shape, True, 7, 0.25)
    assert loaded.provenance["normalisation"] == UNITS
    state = loaded.network.state_dict()
    assert all(torch.equal(state[key], value) for key, value in module.state_dict().items())


def test_new_networks_start_as_those_of_rust(tdcr, tmp_path):
    """Every tensor starts with the range that `tdcr train` draws it from; a run of one step has moved it by its rate alone."""
    tdcr("collect", "--samples", 10, "--points", 50, "--out", tmp_path / "data")
    size = ["--width", 48, "--depth", 3, "--embedding", 32, "--net", "hybrid", "--channels", "16,24,32"]
    run = ["--resolutions", "4,3,2", "--blocks", 1, "--steps", 1, "--learning-rate", 1e-9, "--precision", "float32"]
    data = ["--data", tmp_path / "data", "--out", tmp_path / "run"]
    theirs = Model.load(tdcr("train", *size, *run, *data)["model"])
    torch.manual_seed(0)
    ours = network(theirs.shape)
    for name, value in theirs.network.state_dict().items():
        own = ours.state_dict()[name]
        assert own.shape == value.shape
        most = [float(tensor.abs().max()) for tensor in (own, value)]
        if own.numel() >= 500 or min(most) < 1e-3:
            # The largest of 500 uniform numbers is within 2 % of the bound, but for odds of 1 in 20,000.
            np.testing.assert_allclose(*most, rtol=0.02, atol=1e-6, err_msg=name)


def test_files_that_are_no_models_are_refused(tmp_path):
    path = tmp_path / "model.safetensors"
    path.write_bytes(b"nothing")
    with pytest.raises(TdcrError, match="not a safetensors file"):
        Model.load(path)
    own = torch.nn.Linear(3, 3)
    model(own, None).save(path)
    with pytest.raises(TdcrError, match="the module that its weights are of"):
        Model.load(path)
    with pytest.raises(TdcrError, match="holds a torch module, expected a model"):
        _tdcr.velocities(str(path), np.zeros((1, 1, 6), "f4"), np.zeros(1, "f4"), np.zeros((1, 2), "f4"))
    again = Model.load(path, torch.nn.Linear(3, 3))
    assert torch.equal(again.network.weight, own.weight)


def test_presets_and_defaults_are_those_of_tdcr_train():
    paper, quick = preset("paper"), preset()
    assert (quick.name, quick.width, quick.depth, quick.embedding) == ("quick", 96, 6, 128)
    settings = paper.settings(net="hybrid", clouds_in_set=8000)
    assert settings["steps"] == 500 * math.ceil(8000 / 32)
    assert (settings["clouds"], settings["points"], settings["learning_rate"]) == (32, 20_000, 8e-4)
    assert (settings["optimizer"], settings["warmup_steps"]) == ("adam-w", 4000)
    assert settings["sampler"] == {"method": "heun", "steps": 100, "grid": "uniform", "denoise": None, "spare": 0.0}
    assert (paper.octaves, quick.octaves, settings["path"]["late_times"]) == (0, 6, 0.0)
    halved = quick.settings(learning_rate=1e-2, steps=50)
    assert halved["optimizer"]["muon"]["learning_rate"] == pytest.approx(1e-2)
    assert halved["warmup_steps"] == 5
    with pytest.raises(TdcrError, match="clouds is 0, expected at least 1"):
        quick.settings(clouds=0)
    with pytest.raises(TdcrError, match="unknown field `cluods`"):
        quick.settings(cluods=3)
    with pytest.raises(ValueError, match="takes 500 epochs"):
        paper.settings()

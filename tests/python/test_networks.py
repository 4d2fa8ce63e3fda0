"""The networks' reference values in the Rust tests are PyTorch's, and model files become modules and come back."""

import json
import pathlib
import sys

import numpy as np
import pytest

ROOT = pathlib.Path(__file__).parents[2]

try:
    import torch
except ImportError:
    pytest.skip(
        "no PyTorch here: install tests/python/requirements-torch.txt to check the networks against it",
        allow_module_level=True,
    )

sys.path[:0] = [str(ROOT / "examples/python"), str(ROOT / "learn/tests/data")]
import networks  # noqa: E402
import networks_torch  # noqa: E402


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
    shapes, tensors = networks_torch.read()
    module = networks.network(shapes[name]).double()
    params = networks_torch.part(tensors, f"{name}.weight.")
    module.load_state_dict({n: v.double() for n, v in networks.to_module(params).items()})
    batch = networks_torch.part(tensors, f"{name}.batch.")
    points, times, conditions = (batch[k].double() for k in ("points", "times", "conditions"))
    order = torch.randperm(points.shape[1], generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        velocities = module(points, times, conditions)
        permuted = module(points[:, order], times, conditions)
    np.testing.assert_allclose(permuted, velocities[:, order], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", ["mlp", "hybrid"])
def test_a_model_file_becomes_a_module_and_comes_back(name, tmp_path):
    shapes, tensors = networks_torch.read()
    params = networks_torch.part(tensors, f"{name}.weight.")
    header = {"format": 1, "kind": "model", "content": {"shape": shapes[name]}}
    module = networks.network(shapes[name])
    module.load_state_dict(networks.to_module(params))
    networks.save(tmp_path / "model.safetensors", module, header)
    loaded, found = networks.load(tmp_path / "model.safetensors")
    assert json.dumps(found) == json.dumps(header)
    state = networks.to_file(loaded.state_dict())
    assert state.keys() == params.keys()
    assert all(torch.equal(state[key], params[key]) for key in params)

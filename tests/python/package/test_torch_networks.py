"""The networks in PyTorch: the reference values of the Rust tests are theirs, and model files carry them to Rust and back."""

import math
import pathlib
import re
import sys

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="no PyTorch here: install tests/python/requirements-torch.txt")

from tdcr import _tdcr  # noqa: E402
from tdcr.errors import InputError, TdcrError  # noqa: E402
from tdcr.torch import Model, network, preset  # noqa: E402
from tdcr.torch.networks import from_file, start_as_authors  # noqa: E402
from tdcr.torch.pvcnn import from_file as authors_from_file  # noqa: E402
from tdcr.torch.settings import complete  # noqa: E402

sys.path.insert(0, str(pathlib.Path(__file__).parents[3] / "learn/tests/data"))
import networks_torch  # noqa: E402
import paper_hybrid  # noqa: E402

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


@pytest.mark.parametrize("name", ["mlp", "hybrid"])
def test_blocks_of_the_condition_are_those_of_rust(name, tmp_path):
    shape, _, batch = stored(name)
    points, times, conditions = (part.double() for part in batch)
    head = dict(shape.get("head", shape)) | {"condition_blocks": 2}
    shape = head if name == "mlp" else {**shape, "head": head}
    torch.manual_seed(1)
    module = network(shape)
    for value in module.parameters():
        torch.nn.init.normal_(value, std=0.5)
    path = tmp_path / "model.safetensors"
    model(module, shape).save(path)
    found = _tdcr.velocities(str(path), *(part.numpy() for part in batch))
    with torch.no_grad():
        expected = module.double()(points, times, conditions)
        module.condition_blocks = torch.nn.Sequential()
        without = module(points, times, conditions)
    largest = expected.abs().max()
    assert np.abs(found - expected.numpy()).max() < 1e-5 * largest
    # A hundred times what is tolerated.
    assert (expected - without).abs().max() > 1e-3 * largest


def test_the_authors_network_has_no_blocks_of_the_condition():
    shape = paper_hybrid.SHAPE | {"head": paper_hybrid.SHAPE["head"] | {"condition_blocks": 2}}
    with pytest.raises(InputError, match="condition_blocks is 2, expected 0 with pvcnn layers"):
        network(shape)


def authors(shape=paper_hybrid.SHAPE, seed=2):
    """The reference's module with random tensors, and the package's with the same."""
    reference = paper_hybrid.randomise(paper_hybrid.PaperHybrid(shape), torch.Generator().manual_seed(seed))
    module = network(shape)
    module.load_state_dict(reference.state_dict())
    return reference, module.eval()


def test_stored_velocities_of_the_authors_hybrid_are_those_of_the_reference():
    shape, tensors = paper_hybrid.read()
    assert shape == paper_hybrid.SHAPE
    module = network(shape)
    module.load_state_dict(authors_from_file(module, networks_torch.part(tensors, "weight.")))
    reference = paper_hybrid.PaperHybrid(shape).eval()
    reference.load_state_dict(module.state_dict())
    batch = [tensors[f"batch.{name}"] for name in ("points", "times", "conditions")]
    np.testing.assert_allclose(tensors["velocities"], paper_hybrid.velocities(reference, batch), rtol=1e-6, atol=1e-7)


def test_the_authors_hybrid_has_the_references_names_and_velocities_also_in_training_and_in_rust(tmp_path):
    reference, module = authors()
    described = [{n: v.shape for n, v in net.state_dict().items()} for net in (reference, module)]
    assert described[0] == described[1]
    inputs = paper_hybrid.batch(paper_hybrid.SHAPE, 3, 150, torch.Generator().manual_seed(1))
    expected = paper_hybrid.velocities(reference, inputs)
    path = tmp_path / "model.safetensors"
    model(module, paper_hybrid.SHAPE).save(path)
    loaded = Model.load(path).network
    with torch.no_grad():
        found = [module(*inputs), loaded(*inputs)]
    found.append(torch.from_numpy(_tdcr.velocities(str(path), *(part.numpy() for part in inputs))))
    for velocities in found:
        assert (velocities - expected).abs().max() < 1e-5 * expected.abs().max()
    # In training BatchNorm is of the batch, and its running averages follow.
    trained = [net.double().train() for net in (reference, module)]
    double = [part.double() for part in inputs]
    with torch.no_grad():
        of_batch = [net(*double) for net in trained]
    torch.testing.assert_close(of_batch[1], of_batch[0])
    assert (of_batch[0] - expected).abs().max() > 1e-2
    states = [net.state_dict() for net in trained]
    assert all(torch.allclose(states[1][name], value) for name, value in states[0].items())


def test_the_stages_of_the_authors_hybrid_stay_in_float32_under_autocast():
    _, module = authors()
    types = {}
    for name, part in module.named_modules():
        part.register_forward_hook(lambda _, __, out, name=name: types.update({name: out.dtype}))
    inputs = paper_hybrid.batch(paper_hybrid.SHAPE, 2, 40, torch.Generator().manual_seed(1))
    with torch.no_grad(), torch.autocast("cpu", torch.bfloat16):
        module(*inputs)
    stages = {dtype for name, dtype in types.items() if name.startswith("ctx_net.stages.")}
    assert (stages, types["head.input"]) == ({torch.float32}, torch.bfloat16)


def test_networks_by_the_authors_start_as_documented():
    shapes = [*networks_torch.SHAPES.values(), paper_hybrid.SHAPE]
    for shape in shapes:
        wide = {"width": 128, "embedding": 64}
        shape = shape | wide if "head" not in shape else shape | {"head": shape["head"] | wide}
        torch.manual_seed(3)
        module = network(shape)
        start_as_authors(module)
        state = module.state_dict()
        # Names of both kinds of module; inputs of the whole layer of [x | context | e].
        inputs = 64 + 6 + (5 if "head" in shape else 0)
        normal = {r"(time|condition|[tc]_proj)\.weight": 0.02, r"(input|shift)\.weight": math.sqrt(2 / inputs)}
        normal |= {r"blocks\.\d\.(linear|1)\.weight": math.sqrt(2 / 128)}
        found = set()
        for name, value in state.items():
            if name.startswith("context.") or ".stages." in name:
                continue
            for pattern, deviation in normal.items():
                if re.search(rf"(^|\.){pattern}$", name):
                    found.add(pattern)
                    error = 5 / math.sqrt(2 * value.numel())
                    assert abs(value.square().mean().sqrt() / deviation - 1) < error, name
                    assert state.get(name.replace("weight", "bias"), torch.zeros(1)).abs().max() == 0, name
            if re.search(r"(film|affine)\.weight$", name):
                assert 0.12 < value.abs().max() <= 0.125, name
                assert state[name.replace("weight", "bias")].abs().max() == 0, name
        assert found == set(normal)


def test_new_networks_start_as_those_of_rust(tdcr, tmp_path):
    """Every tensor starts with the range that `tdcr train` draws it from; a run of one step has moved it by its rate alone."""
    tdcr("collect", "--samples", 10, "--points", 50, "--out", tmp_path / "data")
    size = ["--width", 48, "--depth", 3, "--embedding", 32, "--net", "hybrid", "--channels", "16,24,32", "--condition-blocks", 2]
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
    sizes = [quick.options["mlp"][name] for name in ("width", "depth", "embedding")]
    assert (quick.name, *sizes) == ("quick", 96, 6, 128)
    settings = paper.settings(net="hybrid", clouds_in_set=8000)
    assert settings["steps"] == 500 * math.ceil(8000 / 32)
    assert (settings["clouds"], settings["points"], settings["learning_rate"]) == (32, 20_000, 8e-4)
    assert (settings["optimizer"], settings["warmup_steps"]) == ("adam-w", 4000)
    assert settings["sampler"] == {
        "method": "heun",
        "steps": 100,
        "grid": "uniform",
        "denoise": None,
        "spare": 0.0,
        "colors": "clamped",
    }
    octaves = [one.options["hybrid"]["octaves"] for one in (paper, quick)]
    assert (octaves, settings["path"]["late_times"]) == ([0, 6], 0.0)
    assert (settings["procedure"], quick.settings()["procedure"]) == ("authors", "project")
    # The last batch is dropped where it is not full.
    assert paper.settings(clouds_in_set=8007)["steps"] == 500 * 1000
    shape = paper.shape(6, net="hybrid", colors=False)
    assert shape == paper_hybrid.PAPER
    assert paper.shape(6, net="hybrid")["head"]["channels"] == "xyz-rgb"
    ours = paper.shape(6, net="hybrid", context={"layers": "residual", "blocks": 1})["context"]
    assert ours == quick.shape(6, net="hybrid")["context"] | {"blocks": 1}
    assert quick.shape(6, net="hybrid", context={"layers": "pvcnn"})["context"] == shape["context"]
    halved = quick.settings(learning_rate=1e-2, steps=50)
    assert halved["optimizer"]["muon"]["learning_rate"] == pytest.approx(1e-2)
    assert halved["warmup_steps"] == 5
    with pytest.raises(TdcrError, match="clouds is 0, expected at least 1"):
        quick.settings(clouds=0)
    with pytest.raises(TdcrError, match="unknown field `cluods`"):
        quick.settings(cluods=3)
    with pytest.raises(ValueError, match="takes 500 epochs"):
        paper.settings()

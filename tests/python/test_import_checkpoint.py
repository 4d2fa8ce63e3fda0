"""Checkpoints with the authors' names become model files that predict what the checkpoints' networks do."""

import json
import math
import pathlib
import sys

import numpy as np
import pytest

ROOT = pathlib.Path(__file__).parents[2]

try:
    import torch
except ImportError:
    pytest.skip(
        "no PyTorch here: install tests/python/requirements-torch.txt to convert checkpoints",
        allow_module_level=True,
    )

from torch import nn  # noqa: E402

sys.path.insert(0, str(ROOT / "examples/python"))
sys.path.insert(0, str(ROOT / "learn/tests/data"))
import import_checkpoint  # noqa: E402
import paper_hybrid  # noqa: E402
from import_checkpoint import CheckpointError, convert, read_state  # noqa: E402

from tdcr import _tdcr  # noqa: E402
from tdcr.torch import network  # noqa: E402

WIDTH, BLOCKS, EMBEDDING, MOTORS = 24, 3, 16, 4


class Film(nn.Module):
    def __init__(self, affine):
        super().__init__()
        self.norm = nn.LayerNorm(WIDTH, elementwise_affine=affine)
        self.affine = nn.Linear(EMBEDDING, 2 * WIDTH)


class Paper(nn.Module):
    """The paper's MLP, with the authors' names; of the equations, not of tdcr.torch's networks."""

    def __init__(self, channels=3, affine=True, nested=False):
        super().__init__()
        projections = [nn.Linear(EMBEDDING, EMBEDDING), nn.Linear(MOTORS, EMBEDDING)]
        if nested:
            projections = [nn.Sequential(layer, nn.SiLU()) for layer in projections]
        self.t_proj, self.c_proj = projections
        self.input = nn.Linear(channels + EMBEDDING, WIDTH)
        self.films = nn.ModuleList(Film(affine) for _ in range(BLOCKS))
        self.blocks = nn.ModuleList(nn.Sequential(nn.SiLU(), nn.Linear(WIDTH, WIDTH)) for _ in range(BLOCKS))
        self.out = nn.Sequential(nn.SiLU(), nn.Linear(WIDTH, channels))

    def forward(self, x, t, c):
        half = EMBEDDING // 2
        angles = torch.stack([t * math.exp(-math.log(10000) * k / half) for k in range(half)], dim=1)
        phi = torch.cat([torch.cos(angles), torch.sin(angles)], dim=1)
        te, ce = self.t_proj(phi), self.c_proj(c)
        if not isinstance(self.t_proj, nn.Sequential):
            te, ce = nn.functional.silu(te), nn.functional.silu(ce)
        e = (te + ce)[:, None].expand(-1, x.shape[1], -1)
        h = self.input(torch.cat([x, e], dim=-1))
        for film, block in zip(self.films, self.blocks):
            modulation = film.affine(e)
            h = film.norm(h) * (1 + modulation[..., :WIDTH]) + modulation[..., WIDTH:]
            h = h + block(h)
        return self.out(h)


def randomise(module, seed):
    """No weight keeps a special value."""
    generator = torch.Generator().manual_seed(seed)
    for parameter in module.parameters():
        parameter.data.uniform_(-0.5, 0.5, generator=generator)
    return module


def inputs(channels, clouds=2, points=30):
    generator = torch.Generator().manual_seed(9)
    return (
        torch.randn(clouds, points, channels, generator=generator),
        torch.tensor([0.2, 0.9])[:clouds],
        torch.rand(clouds, MOTORS, generator=generator),
    )


@pytest.mark.parametrize(
    "channels, affine, nested, prefix",
    [(3, True, False, ""), (6, True, True, ""), (3, False, True, "module."), (6, False, False, "module.")],
)
def test_a_converted_checkpoint_has_the_same_velocities(tmp_path, channels, affine, nested, prefix):
    paper = randomise(Paper(channels, affine, nested), 1)
    other = randomise(Paper(channels, affine, nested), 2)
    named = [{prefix + n: v for n, v in module.state_dict().items()} for module in (paper, other)]
    torch.save({"ema": named[0], "model": named[1], "epoch": 5}, tmp_path / "last.pt")
    module, shape = convert(read_state(tmp_path / "last.pt"))
    assert shape == {
        "width": WIDTH,
        "depth": BLOCKS + 1,
        "embedding": EMBEDDING,
        "condition_dim": MOTORS,
        "channels": {3: "xyz", 6: "xyz-rgb"}[channels],
    }
    data = inputs(channels)
    with torch.no_grad():
        np.testing.assert_allclose(module(*data), paper(*data), rtol=1e-5, atol=1e-5)
        assert not np.allclose(module(*data), other(*data), atol=1e-2)


def data_folder(folder):
    motors = {"min": [0.0] * MOTORS, "max": [0.04] * MOTORS, "scale": [0.04] * MOTORS}
    (folder / "global_motors_scope-all.json").write_text(json.dumps({"all": motors}))
    points = {"all": {"center": [0, 0, 0], "scale": 0.4}}
    (folder / "global_norm_scope-all_anchor-origin.json").write_text(json.dumps(points))
    return folder


def read_ply(path):
    """Positions and colours of a binary PLY file as tdcr writes it."""
    head, body = path.read_bytes().split(b"end_header\n", maxsplit=1)
    assert b"property float x" in head and b"property uchar red" in head and b"property float uncertainty" in head
    row = np.dtype([("points", "<f4", 3), ("colors", "u1", 3), ("uncertainty", "<f4")])
    rows = np.frombuffer(body, row)
    return rows["points"], rows["colors"]


def test_the_binary_predicts_with_a_converted_checkpoint(tdcr, tmp_path, monkeypatch):
    # Without weights but for the output's bias, the velocity is that: clouds move as one.
    paper = Paper(channels=6)
    velocity = [0.25, -0.5, 1.0, 3.0, -3.0, 0.0]
    with torch.no_grad():
        for parameter in paper.parameters():
            parameter.zero_()
        paper.out[1].bias.copy_(torch.tensor(velocity))
    torch.save({"model": paper.state_dict()}, tmp_path / "last.pt")
    model, cloud = tmp_path / "model.safetensors", tmp_path / "cloud.ply"
    arguments = [tmp_path / "last.pt", "--data", data_folder(tmp_path), "--out", model]
    monkeypatch.setattr(sys, "argv", ["import_checkpoint.py", *map(str, arguments)])
    import_checkpoint.main()
    options = ["--command", "0.01,0.02,0.03,0.04", "--points", 4000, "--out", cloud]
    assert tdcr("predict", "--model", model, *options)["points"] == 4000
    points, colors = read_ply(cloud)
    # The prior is centred, with deviation 0.5; everything times the scale, 0.4 m. Standard error 3 mm.
    np.testing.assert_allclose(points.mean(axis=0), 0.4 * np.array(velocity[:3]), atol=0.015)
    np.testing.assert_allclose(points.std(axis=0), 0.2, atol=0.01)
    # Colours start uniform; two channels run out of [0, 1].
    assert (colors[:, 0] == 255).all() and (colors[:, 1] == 0).all()
    np.testing.assert_allclose(colors[:, 2].mean() / 255, 0.5, atol=0.03)


def broken(state, change):
    changed = dict(state)
    change(changed)
    with pytest.raises(CheckpointError) as error:
        convert(changed)
    return str(error.value)


def test_checkpoints_that_do_not_fit_are_refused_by_name(tmp_path):
    state = Paper().state_dict()
    assert broken(state, lambda s: s.pop("out.1.weight")).startswith("no tensor `out.1.weight`")
    extra = broken(state, lambda s: s.update({"blocks.0.3.weight": torch.zeros(2)}))
    assert extra == "unknown tensors: blocks.0.3.weight"
    short = broken(state, lambda s: s.update({"films.1.affine.bias": torch.zeros(WIDTH)}))
    assert short == f"the tensor for `blocks.1.film.bias` is [{WIDTH}], expected [{2 * WIDTH}]"
    four = broken(state, lambda s: s.update({"out.1.weight": torch.zeros(4, WIDTH)}))
    assert four == "`out.1` has 4 outputs, expected 3 or 6 (with colours)"
    torch.save({"weights": state}, tmp_path / "other.pt")
    with pytest.raises(CheckpointError, match="holds weights, expected a state dict"):
        read_state(tmp_path / "other.pt")
    torch.save(Paper(), tmp_path / "pickled.pt")
    with pytest.raises(CheckpointError, match="cannot be read as plain tensors"):
        read_state(tmp_path / "pickled.pt")


def hybrid_checkpoint(folder, shape, seed=5):
    """The reference's module with random tensors, and the checkpoint of a run, whose average lacks BatchNorm's."""
    paper = paper_hybrid.randomise(paper_hybrid.PaperHybrid(shape), torch.Generator().manual_seed(seed))
    state = {f"module.{name}": value for name, value in paper.state_dict().items()}
    learned = {f"module.{name}" for name, _ in paper.named_parameters()}
    current = {name: value + 1 if name in learned else value for name, value in state.items()}
    average = {name: value for name, value in state.items() if name in learned}
    torch.save({"ema": average, "model": current, "epoch": 5}, folder / "last.pt")
    return paper


def test_the_authors_hybrid_has_its_published_number_of_parameters():
    for module in (paper_hybrid.PaperHybrid(paper_hybrid.PAPER), network(paper_hybrid.PAPER)):
        assert sum(value.numel() for value in module.parameters()) == 6_939_315


def test_a_converted_hybrid_has_the_velocities_of_the_reference(tmp_path):
    paper = hybrid_checkpoint(tmp_path, paper_hybrid.SHAPE)
    module, shape = convert(read_state(tmp_path / "last.pt"), paper_hybrid.SHAPE["context"])
    assert shape == paper_hybrid.SHAPE
    inputs = paper_hybrid.batch(shape, 3, 200, torch.Generator().manual_seed(6))
    expected = paper_hybrid.velocities(paper, inputs)
    path = tmp_path / "model.safetensors"
    units = {"motor_min": [0.0, 0.0], "motor_max": [0.04, 0.04], "scale": 0.4}
    import_checkpoint.model(module, shape, units).save(path)
    with torch.no_grad():
        found = [module(*inputs), torch.from_numpy(_tdcr.velocities(str(path), *(value.numpy() for value in inputs)))]
    for velocities in found:
        assert (velocities - expected).abs().max() < 1e-5 * expected.abs().max()


def test_the_binary_predicts_with_the_authors_hybrid(tdcr, tmp_path, monkeypatch):
    # Published resolutions, fewer channels.
    head = paper_hybrid.SHAPE["head"] | {"condition_dim": MOTORS, "channels": "xyz"}
    stages = [stage | {"channels": 16} for stage in paper_hybrid.PAPER["context"]["stages"]]
    context = paper_hybrid.PAPER["context"] | {"stages": stages, "joined": 16}
    paper = hybrid_checkpoint(tmp_path, {"head": head, "context": context})
    model, npz = tmp_path / "model.safetensors", tmp_path / "clouds.npz"
    arguments = [tmp_path / "last.pt", "--data", data_folder(tmp_path), "--out", model]
    monkeypatch.setattr(sys, "argv", ["import_checkpoint.py", *map(str, arguments)])
    import_checkpoint.main()
    command = [0.01, 0.02, 0.03, 0.04]
    (tmp_path / "commands.csv").write_text(",".join(map(str, command)))
    options = ["--points", 150, "--sampler", "heun", "--sampler-steps", 3, "--sampler-power", 1]
    tdcr("predict", "--model", model, "--commands", tmp_path / "commands.csv", *options, "--out", npz)
    # Heun's method with the reference, from the same noise.
    x = torch.from_numpy(_tdcr.start_noise(0.5, None, 150, False, 0))[None]
    condition = torch.tensor([[value / 0.04 for value in command]])
    velocity = lambda t, x: paper_hybrid.velocities(paper, (x, torch.tensor([t]), condition))  # noqa: E731
    for k in range(3):
        u = velocity(k / 3, x)
        x = x + (u + velocity((k + 1) / 3, x + u / 3)) / 6
    with np.load(npz) as clouds:
        error = np.abs(clouds["points"][0] - 0.4 * x[0].numpy()).max(axis=1)
    # But for points at an edge of a voxel, which rounding puts on either side, in PyTorch's float32 too.
    scale = 0.4 * x.abs().max().item()
    assert np.quantile(error, 0.98) < 1e-5 * scale
    assert error.max() < 1e-4 * scale


def test_hybrids_that_do_not_fit_are_refused_by_name():
    state = {name: value for name, value in paper_hybrid.PaperHybrid(paper_hybrid.SHAPE).state_dict().items()}
    state = {name: value for name, value in state.items() if not name.endswith("num_batches_tracked")}
    norm = "ctx_net.stages.1.blocks.0.pvconv.voxel_layers.4.running_var"
    assert broken(state, lambda s: s.pop(norm)).startswith(f"no tensor `{norm}`")
    more = broken(state, lambda s: s.update({"ctx_net.global_mlp.4.weight": torch.zeros(2)}))
    assert more == "unknown tensors: ctx_net.global_mlp.4.weight"
    wide = broken(state, lambda s: s.update({"ctx_net.head_norm.weight": torch.zeros(3)}))
    assert wide == "the tensor for `ctx_net.head_norm.weight` is [3], expected [20]"
    few = broken(state, lambda s: [s.pop(name) for name in list(s) if name.startswith("ctx_net.stages.2.")])
    assert few == "`ctx_net` has 2 stages, expected 3"

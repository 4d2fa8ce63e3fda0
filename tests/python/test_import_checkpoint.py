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
import import_checkpoint  # noqa: E402
from import_checkpoint import CheckpointError, convert, guess, read_state  # noqa: E402

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


HEAD = {"width": WIDTH, "depth": 3, "embedding": EMBEDDING, "condition_dim": MOTORS, "channels": "xyz-rgb"}
CONTEXT = {
    "stages": [{"channels": 8, "resolution": r} for r in (5, 4, 3)],
    "blocks": 1,
    "joined": 32,
    "gate": {"centre": 0.5, "steepness": 8.0},
}
FEATURES = 5


def hybrid():
    """A Hybrid, its weights under the authors' names as far as they are known, and the names of the rest."""
    module = randomise(network({"head": HEAD, "context": {**CONTEXT, "features": FEATURES}}), 3)
    ours, theirs, names = module.state_dict(), {}, {}
    for part in ("weight", "bias"):
        theirs[f"t_proj.0.{part}"], theirs[f"c_proj.0.{part}"] = ours[f"time.{part}"], ours[f"condition.{part}"]
        theirs[f"head.out.1.{part}"] = ours[f"head.output.{part}"]
        for i in range(2):
            block = f"head.blocks.{i}"
            theirs[f"{block}.1.{part}"] = ours[f"{block}.linear.{part}"]
            theirs[f"head.films.{i}.norm.{part}"] = ours[f"{block}.norm.{part}"]
            theirs[f"head.films.{i}.affine.{part}"] = ours[f"{block}.film.{part}"]
    theirs["head.input.weight"] = torch.cat([ours["head.input.weight"], ours["head.shift.weight"]], dim=1)
    theirs["head.input.bias"] = ours["head.shift.bias"]
    first, joins = "context.stages.0.project", "context.join"
    joint = torch.cat([ours["context.shift.weight"], ours[f"{first}.weight"]], dim=1)
    joined = [ours[f"{joins}s.{k}.weight"] for k in range(3)] + [ours[f"{joins}_maximum.weight"]]
    shares = ("context.shift", f"{joins}s.", f"{joins}_maximum")
    context = {n: v for n, v in ours.items() if n.startswith("context.") and not n.startswith(shares)}
    context |= {f"{first}.weight": joint[..., None], f"{first}.bias": ours["context.shift.bias"]}
    context |= {f"{joins}.weight": torch.cat(joined, dim=1), f"{joins}.bias": ours[f"{joins}_maximum.bias"]}
    for k, (name, value) in enumerate(context.items()):
        names[name] = f"ctx_net.layer{k}"
        theirs[f"ctx_net.layer{k}"] = value
    return module, theirs, names


def test_a_hybrid_is_converted_with_the_names_of_its_context_network():
    expected, state, names = hybrid()
    module, _ = convert(state, CONTEXT, names)
    with torch.no_grad():
        np.testing.assert_allclose(module(*inputs(6)), expected(*inputs(6)), rtol=1e-5, atol=1e-5)


def test_what_shapes_tell_needs_no_name_and_the_rest_is_asked_for():
    _, state, names = hybrid()
    told = ["context.from_embedding.weight", "context.output.weight", "context.join.bias"]
    known = {n: key for n, key in names.items() if n not in told}
    expected, _ = convert(state, CONTEXT, names)
    with pytest.raises(CheckpointError) as error:
        convert(state, CONTEXT)
    lines = str(error.value).splitlines()
    assert "say --names FILE" in lines[0]
    key = names["context.stages.1.project.weight"]
    assert f"  in the checkpoint: {key} [8, 8]" in lines
    assert "  expected: context.stages.1.project.weight [8, 8]" in lines
    assert not any(names["context.output.weight"] in line.split() for line in lines), "its shape is its own"
    module, _ = convert(state, CONTEXT, known)
    assert all(torch.equal(a, b) for a, b in zip(module.parameters(), expected.parameters()))
    with pytest.raises(CheckpointError, match="no tensor `ctx_net.absent`"):
        convert(state, CONTEXT, names | {"context.output.weight": "ctx_net.absent"})


def layers_in_other_words():
    """The Hybrid of `hybrid`, its context network's layers called otherwise, in the order in which they act."""
    module, state, names = hybrid()
    layers, words = {}, {}
    for ours, key in names.items():
        layer, _, part = ours.rpartition(".")
        words[key] = f"ctx_net.part{layers.setdefault(layer, len(layers))}.{part}"
    return module, {words.get(key, key): value for key, value in state.items()}


def test_names_are_guessed_by_order_among_layers_alike():
    expected, state = layers_in_other_words()
    names = guess(state, CONTEXT)
    assert set(names.values()) == {key for key in state if key.startswith("ctx_net.")}
    module, _ = convert(state, CONTEXT, names)
    assert all(torch.equal(a, b) for a, b in zip(module.parameters(), expected.parameters()))


def test_layers_that_the_checkpoint_has_more_of_are_not_guessed():
    _, state = layers_in_other_words()
    convolution = next(key for key in state if key.startswith("ctx_net.") and state[key].dim() == 5)
    layer = convolution.removesuffix(".weight")
    more = {f"ctx_net.more.{part}": state[f"{layer}.{part}"] for part in ("weight", "bias")}
    named = guess(state | more, CONTEXT).values()
    shape = state[convolution].shape
    assert named
    assert not [key for key in named if state[key].shape == shape]


def test_a_guess_is_written_for_the_importer_and_never_over_a_file(tmp_path, monkeypatch):
    monkeypatch.setattr(import_checkpoint, "CONTEXT", CONTEXT)
    expected, state = layers_in_other_words()
    checkpoint, names = tmp_path / "last.pt", tmp_path / "names.json"
    torch.save({"model": state}, checkpoint)
    import_checkpoint.write_guess(checkpoint, names)
    module, _ = convert(read_state(checkpoint), CONTEXT, json.loads(names.read_text()))
    assert all(torch.equal(a, b) for a, b in zip(module.parameters(), expected.parameters()))
    with pytest.raises(FileExistsError):
        import_checkpoint.write_guess(checkpoint, names)
    torch.save({"model": {"t_proj.weight": torch.zeros(2, 2)}}, checkpoint)
    with pytest.raises(CheckpointError, match="no names are needed"):
        import_checkpoint.write_guess(checkpoint, tmp_path / "other.json")


def test_the_authors_hybrid_is_refused_as_another_network():
    """By names of their release alone: no network is to be made of it."""
    state = {
        "head.t_proj.weight": torch.zeros(256, 256),
        "ctx_net.t_proj.weight": torch.zeros(256, 256),
        "ctx_net.stages.0.proj.layers.0.weight": torch.zeros(80, 259, 1),
        "ctx_net.global_mlp.0.weight": torch.zeros(112, 112),
    }
    for make in (convert, guess):
        with pytest.raises(CheckpointError, match="authors' Hybrid, which is another network"):
            make(state)

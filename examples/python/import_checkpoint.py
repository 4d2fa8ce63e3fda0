"""Makes a model file of a PyTorch checkpoint in the format of the paper's authors.

    pip install ".[torch]"
    python import_checkpoint.py last.pt --data SET --out model.safetensors
    tdcr predict --model model.safetensors --command ...

A checkpoint is what torch.save wrote of a dict with a state dict under `ema` (taken first; running averages that it lacks are
those under `model`) or `model`; names may start with `module.`. SET is the folder of the data set that the network was trained
on, with global_motors_scope-all.json and global_norm_scope-all_anchor-origin.json.

The names are those of the authors' release. The MLP's layers, with embedding e, width H, C numbers per point and D motors, are

    t_proj, c_proj      (E, E), (E, D)      into the embedding
    input               (H, C + E)          of [x | e]
    films.i.norm        (H,)                LayerNorm; the identity where it has no weight
    films.i.affine      (2 H, E)            gamma, then beta
    blocks.i.1          (H, H)
    out.1               (C, H)

The time's features are cosines, then sines. The Hybrid's are the same after `head.`, with an input of [x | context | e], and its
context network's after `ctx_net.`, as tdcr.torch.PvcnnHybrid has them. Resolutions and time gate are not in a checkpoint:
they are the published ones, 24, 16 and 8 voxels per edge, and sigmoid(12 (t - 0.97)).
"""

import argparse
import json
import re
import sys
from pathlib import Path

import torch

from tdcr.torch import Model, network
from tdcr.torch.settings import complete, context_of

MOTORS_FILE = "global_motors_scope-all.json"
POINTS_FILE = "global_norm_scope-all_anchor-origin.json"

SAMPLER = {"method": "exponential", "steps": 16, "grid": {"power": 2.0}}


class CheckpointError(Exception):
    """What is wrong with a checkpoint, and what would be right."""


def read_state(path):
    """The weights of a checkpoint by name, in float32."""
    try:
        checkpoint = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises what its unpickler raises
        raise CheckpointError(f"{path}: cannot be read as plain tensors: {error}") from error
    entries = checkpoint if isinstance(checkpoint, dict) else {}
    states = [entries.get(name) for name in ("ema", "model")]
    states = [plain(state) for state in states if isinstance(state, dict) and state]
    if not states:
        found = ", ".join(map(str, entries)) or type(checkpoint).__name__
        raise CheckpointError(f"{path}: holds {found}, expected a state dict as `ema` or `model`")
    averages = {name: value for name, value in states[-1].items() if ".running_" in name}
    return averages | states[0]


def plain(state):
    """The tensors of a state dict, their names without `module.`, and without the number of a projection's only layer."""
    tensors = {name.removeprefix("module."): value for name, value in state.items() if torch.is_tensor(value)}
    tensors = {name: value for name, value in tensors.items() if not name.endswith("num_batches_tracked")}
    return {re.sub(r"\b([tc]_proj)\.0\.", r"\1.", name): value.float() for name, value in tensors.items()}


class Weights:
    """A checkpoint's tensors, taken one by one."""

    def __init__(self, tensors):
        self.left = dict(tensors)

    def take(self, name):
        """The tensor `name`."""
        if name not in self.left:
            raise CheckpointError(f"no tensor `{name}`, expected as in the paper's networks")
        return self.left.pop(name)

    def layer(self, name):
        """Weight and bias of a linear layer."""
        return self.take(f"{name}.weight"), self.take(f"{name}.bias")


def put_layer(tensors, name, layer):
    tensors[f"{name}.weight"], tensors[f"{name}.bias"] = layer


def head_shape(state, prefix):
    """Sizes of the layers on points, whose names start with `prefix`, and numbers of context among their inputs."""
    weights = Weights(state)
    time, condition, points, output = (weights.take(f"{prefix}{n}.weight") for n in ("t_proj", "c_proj", "input", "out.1"))
    embedding, condition_dim = condition.shape
    if time.shape != (embedding, embedding):
        found = list(time.shape)
        raise CheckpointError(f"`{prefix}t_proj` is {found}, expected [{embedding}, {embedding}] as `c_proj` has it")
    channels = {3: "xyz", 6: "xyz-rgb"}.get(len(output))
    if channels is None:
        raise CheckpointError(f"`{prefix}out.1` has {len(output)} outputs, expected 3 or 6 (with colours)")
    shape = {
        "width": len(points),
        "depth": 1 + count(state, rf"{re.escape(prefix)}films\.(\d+)\."),
        "embedding": embedding,
        "condition_dim": condition_dim,
        "channels": channels,
    }
    return shape, points.shape[1] - embedding - len(output)


def count(state, pattern):
    """How many different things the first group of `pattern` finds among the names."""
    return len({match[1] for match in (re.match(pattern, name) for name in state) if match})


def mlp(state):
    """The MLP of a checkpoint's weights, and its shape."""
    shape, features = head_shape(state, "")
    if features:
        raise CheckpointError(f"`input` takes {features} numbers beside the point and the embedding, expected none")
    weights, tensors = Weights(state), {}
    put_layer(tensors, "time", weights.layer("t_proj"))
    put_layer(tensors, "condition", weights.layer("c_proj"))
    weight, bias = weights.layer("input")
    tensors["input.weight"], shift = weight.split([weight.shape[1] - shape["embedding"], shape["embedding"]], dim=1)
    put_layer(tensors, "shift", (shift, bias))
    identity = {"weight": torch.ones(shape["width"]), "bias": torch.zeros(shape["width"])}
    for i in range(shape["depth"] - 1):
        put_layer(tensors, f"blocks.{i}.film", weights.layer(f"films.{i}.affine"))
        put_layer(tensors, f"blocks.{i}.norm", (weights.left.pop(f"films.{i}.norm.{n}", v) for n, v in identity.items()))
        put_layer(tensors, f"blocks.{i}.linear", weights.layer(f"blocks.{i}.1"))
    put_layer(tensors, "output", weights.layer("out.1"))
    if weights.left:
        raise CheckpointError(f"unknown tensors: {', '.join(sorted(weights.left))}")
    return filled(shape, tensors), shape


def hybrid(state, context):
    """The authors' Hybrid of a checkpoint's weights, and its shape; resolutions and gate are those of `context`."""
    head, _ = head_shape(state, "head.")
    stages, weights = context["stages"], Weights(state)
    found = count(state, r"ctx_net\.stages\.(\d+)\.")
    if found != len(stages):
        raise CheckpointError(f"`ctx_net` has {found} stages, expected {len(stages)}")
    sizes = [len(weights.take(f"ctx_net.stages.{s}.proj.layers.0.weight")) for s in range(len(stages))]
    joined, features = (len(weights.take(f"ctx_net.{name}.weight")) for name in ("head_pre", "head_out"))
    blocks = count(state, r"ctx_net\.stages\.0\.blocks\.(\d+)\.")
    own = {"blocks": blocks, "joined": joined, "features": features}
    own["stages"] = [{"channels": size, "resolution": stage["resolution"]} for size, stage in zip(sizes, stages)]
    shape = {"head": head, "context": context | own}
    return filled(shape, state), shape


def filled(shape, tensors):
    """The network of a shape with these tensors, which are all that it has."""
    module = network(shape)
    expected = {name: value for name, value in module.state_dict().items() if not name.endswith("num_batches_tracked")}
    missing, unknown = (sorted(a.keys() - b.keys()) for a, b in ((expected, tensors), (tensors, expected)))
    if missing:
        raise CheckpointError(f"no tensor `{missing[0]}`, expected as in the paper's networks")
    if unknown:
        raise CheckpointError(f"unknown tensors: {', '.join(unknown)}")
    for name, value in expected.items():
        if tensors[name].shape != value.shape:
            found = list(tensors[name].shape)
            raise CheckpointError(f"the tensor for `{name}` is {found}, expected {list(value.shape)}")
    module.load_state_dict({name: value.contiguous() for name, value in tensors.items()})
    return module.eval()


def convert(state, context=None):
    """The network of a checkpoint's weights by name, and its shape as a model file's header has it.

    `context` are resolutions and gate of a Hybrid's context network, as in a shape: by default the published ones.
    """
    if any(name.startswith("ctx_net.") for name in state):
        return hybrid(state, context or context_of("pvcnn"))
    return mlp(state)


def normalisation(data):
    """The normalisation of the data set in the folder `data`, as a model file's header has it."""
    motors = json.loads((data / MOTORS_FILE).read_text())["all"]
    points = json.loads((data / POINTS_FILE).read_text())["all"]
    if any(points["center"]):
        raise CheckpointError(f"{POINTS_FILE}: center is {points['center']}, expected the origin")
    return {"motor_min": motors["min"], "motor_max": motors["max"], "scale": points["scale"]}


def model(module, shape, units):
    """The model of a converted network. Of the settings, those of its predictions are the authors'."""
    condition_dim = shape.get("head", shape)["condition_dim"]
    if len(units["motor_min"]) != condition_dim:
        found = len(units["motor_min"])
        raise CheckpointError(f"{MOTORS_FILE} has {found} motors, the network {condition_dim}")
    return Model(
        network=module,
        shape=shape,
        colors=shape.get("head", shape)["channels"] == "xyz-rgb",
        provenance={"subject": None, "normalisation": units},
        # Trained without late times, so without a denoising at one.
        settings=complete({"path": {"prior_deviation": 0.5, "time_exponent": 3.0}, "sampler": SAMPLER}),
        step=0,
        validation_distance=0.0,
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("--data", type=Path, required=True, help="folder of the two normalisation files")
    parser.add_argument("--out", type=Path, default=Path("model.safetensors"))
    args = parser.parse_args()
    try:
        module, shape = convert(read_state(args.checkpoint))
        converted = model(module, shape, normalisation(args.data))
    except (CheckpointError, OSError, KeyError, json.JSONDecodeError) as error:
        sys.exit(f"error: {error}")
    converted.save(args.out)
    learned = sum(value.numel() for value in module.parameters())
    print(f"{args.out}: {learned} parameters, {json.dumps(shape)}")


if __name__ == "__main__":
    main()

"""Makes a model file of a PyTorch checkpoint in the format of the paper's authors.

    pip install ".[torch]"
    python import_checkpoint.py last.pt --data SET --out model.safetensors
    tdcr predict --model model.safetensors --command ...

A checkpoint is what torch.save wrote of a dict with a state dict under `ema` (taken first) or `model`;
names may start with `module.`. SET is the folder of the data set that the network was trained on, with
global_motors_scope-all.json and global_norm_scope-all_anchor-origin.json.

The MLP's layers, with embedding e, width H, C numbers per point and D motors, are

    t_proj, c_proj      (E, E), (E, D)      into the embedding
    input               (H, C + E)          of [x | e]
    films.i.norm        (H,)                LayerNorm; the identity where it has no weight
    films.i.affine      (2 H, E)            gamma, then beta
    blocks.i.1          (H, H)
    out.1               (C, H)

The time's features are cosines, then sines. The names are those of the authors' release, and its MLP is the one here.

The authors' Hybrid is another network than ours, so its checkpoints are refused: its context network has an embedding of its
own (`ctx_net.t_proj`, `ctx_net.c_proj`), batch norms where ours has group norms (`ctx_net.stages.S.proj.layers.1`,
`ctx_net.stages.S.blocks.B.pvconv.voxel_layers.1` and `.4`), blocks of another order (`ctx_net.stages.S.blocks.B.post`), and
layers on the maximum over the points (`ctx_net.global_mlp`) that ours has not.

A Hybrid of our kind, trained elsewhere, has t_proj and c_proj, these layers as `head.`, its input of [x | context | e], and
a context network as `ctx_net.`, whose layers it may call as it likes. A tensor of it
is found by its shape where one alone has it; for all others say --names FILE, JSON from the names of tdcr.torch's networks to the
checkpoint's. `--guess FILE` writes such a file, to be looked through: layers of the same shapes, in the order in which both
networks have them. Two layers are one in the checkpoint: `context.stages.0.project`, of [e | x], and `context.join`, of the
stages' outputs and then the maximum. Where the networks differ in more than names, no file is written.
"""

import argparse
import json
import re
import sys
from pathlib import Path

import torch

from tdcr.torch import Model, network
from tdcr.torch.settings import complete

MOTORS_FILE = "global_motors_scope-all.json"
POINTS_FILE = "global_norm_scope-all_anchor-origin.json"

# Layers of concatenated features: one each in a checkpoint, the shares in this order in a model file.
JOINT = {
    "context.stages.0.project": ["context.shift", "context.stages.0.project"],
    "context.join": [*(f"context.joins.{k}" for k in range(3)), "context.join_maximum"],
}
# The share that has the bias.
BIASED = ["context.shift", "context.join_maximum"]


class CheckpointError(Exception):
    """What is wrong with a checkpoint, and what would be right."""


def read_state(path):
    """The weights of a checkpoint by name, in float32."""
    try:
        checkpoint = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises what its unpickler raises
        raise CheckpointError(f"{path}: cannot be read as plain tensors: {error}") from error
    entries = checkpoint if isinstance(checkpoint, dict) else {}
    for entry in ("ema", "model"):
        state = entries.get(entry)
        if isinstance(state, dict) and state:
            break
    else:
        found = ", ".join(map(str, entries)) or type(checkpoint).__name__
        raise CheckpointError(f"{path}: holds {found}, expected a state dict as `ema` or `model`")
    weights = {name: value for name, value in state.items() if torch.is_tensor(value)}
    return {name.removeprefix("module."): value.float() for name, value in weights.items()}


class Weights:
    """A checkpoint's tensors, taken one by one."""

    def __init__(self, tensors):
        self.left = dict(tensors)

    def find(self, *names):
        """The first of `names` that is left, or None."""
        return next((name for name in names if name in self.left), None)

    def take(self, *names):
        """The tensor with the first of `names` that is there."""
        name = self.find(*names)
        if name is None:
            raise CheckpointError(f"no tensor `{names[0]}`, expected as in the paper's networks")
        return self.left.pop(name)

    def layer(self, *names):
        """Weight and bias of a linear layer; a 1 x 1 convolution is one."""
        found = [f"{name}.weight" for name in names]
        weight = matrix(self.take(*found))
        return weight, self.take(*[f"{name}.bias" for name in names])


def matrix(weight):
    """The matrix of a linear layer or of a 1 x 1 convolution."""
    return weight.flatten(1) if weight.dim() > 2 and weight[0, 0].numel() == 1 else weight


def put_layer(tensors, name, layer):
    tensors[f"{name}.weight"], tensors[f"{name}.bias"] = layer


def embedding(weights):
    """The layers of time and condition, and their sizes."""
    tensors = {}
    put_layer(tensors, "time", weights.layer("t_proj", "t_proj.0"))
    put_layer(tensors, "condition", weights.layer("c_proj", "c_proj.0"))
    width, condition_dim = tensors["condition.weight"].shape
    if tensors["time.weight"].shape != (width, width):
        found = list(tensors["time.weight"].shape)
        raise CheckpointError(f"`t_proj` is {found}, expected [{width}, {width}] as `c_proj` has it")
    return tensors, {"embedding": width, "condition_dim": condition_dim}


def point_layers(weights, prefix, sizes):
    """The layers on points, of the names after `prefix`; their sizes; and numbers of context among the inputs."""
    tensors = {}
    blocks = {re.match(rf"{re.escape(prefix)}films\.(\d+)\.", name) for name in weights.left}
    depth = 1 + len({match[1] for match in blocks if match})
    weight, bias = weights.layer(f"{prefix}input")
    inputs = weight.shape[1] - sizes["embedding"]
    tensors[f"{prefix}input.weight"] = weight[:, :inputs]
    put_layer(tensors, f"{prefix}shift", (weight[:, inputs:], bias))
    for i in range(depth - 1):
        block, film = f"{prefix}blocks.{i}", f"{prefix}films.{i}"
        put_layer(tensors, f"{block}.film", weights.layer(f"{film}.affine"))
        width = torch.ones(weight.shape[0])
        norm = f"{film}.norm"
        gain = weights.take(f"{norm}.weight") if weights.find(f"{norm}.weight") else width
        shift = weights.take(f"{norm}.bias") if weights.find(f"{norm}.bias") else 0 * width
        put_layer(tensors, f"{block}.norm", (gain, shift))
        put_layer(tensors, f"{block}.linear", weights.layer(f"{block}.1"))
    put_layer(tensors, f"{prefix}output", weights.layer(f"{prefix}out.1"))
    outputs = tensors[f"{prefix}output.weight"].shape[0]
    channels = {3: "xyz", 6: "xyz-rgb"}.get(outputs)
    if channels is None:
        raise CheckpointError(f"`{prefix}out.1` has {outputs} outputs, expected 3 or 6 (with colours)")
    shape = {"width": weight.shape[0], "depth": depth, **sizes, "channels": channels}
    return tensors, shape, inputs - outputs


def expected_context(shape):
    """Shapes of the context network's tensors as a checkpoint has them, and those of the layers that are one there."""
    ours = {n: v for n, v in network(shape).state_dict().items() if n.startswith("context.")}
    widths = {layer: [ours.pop(f"{share}.weight").shape for share in shares] for layer, shares in JOINT.items()}
    expected = {name: tuple(value.shape) for name, value in ours.items()}
    for layer, shapes in widths.items():
        expected[f"{layer}.weight"] = (shapes[0][0], sum(shape[1] for shape in shapes))
    for biased, layer in zip(BIASED, JOINT):
        expected[f"{layer}.bias"] = expected.pop(f"{biased}.bias")
    return expected, widths


def alike(shapes):
    """Layers by the shapes of their tensors: lists of names, in the order in which they come."""
    layers, groups = {}, {}
    for name, shape in shapes.items():
        layer, _, part = name.rpartition(".")
        layers.setdefault(layer, {})[part] = tuple(shape)
    for layer, parts in layers.items():
        groups.setdefault(tuple(sorted(parts.items())), []).append(layer)
    return groups


def refuse_authors_hybrid(state):
    """The authors' Hybrid is another network, whatever its names."""
    if "ctx_net.t_proj.weight" in state or any(name.startswith("ctx_net.global_mlp.") for name in state):
        raise CheckpointError(
            "the checkpoint is of the authors' Hybrid, which is another network than the one here (batch norms, projections "
            "of its own in the context network): only their MLP can be imported"
        )


def guess(state, context=None):
    """Names of the context network's tensors, ours to the checkpoint's: layers alike in shape, in their order.

    Layers of which the checkpoint has another number are left out.
    """
    refuse_authors_hybrid(state)
    weights = Weights(state)
    _, sizes = embedding(weights)
    _, head, features = point_layers(weights, "head.", sizes)
    shape = {"head": head, "context": {**(context or CONTEXT), "features": features}}
    theirs = alike({n: matrix(v).shape for n, v in weights.left.items() if n.startswith("ctx_net.")})
    names = {}
    for parts, ours in alike(expected_context(shape)[0]).items():
        if len(ours) == len(theirs.get(parts, [])):
            for our, their in zip(ours, theirs[parts]):
                names |= {f"{our}.{part}": f"{their}.{part}" for part, _ in parts}
    return names


def context_layers(weights, shape, names):
    """The context network's tensors: those named in `names`, then those whose shape one tensor alone has."""
    theirs = {n: matrix(v) for n, v in weights.left.items() if n.startswith("ctx_net.")}
    expected, widths = expected_context(shape)
    found = {}

    def settle(ours, key):
        if key not in theirs:
            raise CheckpointError(f"--names: no tensor `{key}` for `{ours}`")
        value = theirs.pop(key)
        if tuple(value.shape) != expected[ours]:
            wrong = f"`{key}` is {list(value.shape)}, expected {list(expected[ours])} for `{ours}`"
            raise CheckpointError(wrong)
        found[ours] = value

    for ours, key in names.items():
        if ours not in expected:
            raise CheckpointError(f"--names: `{ours}` is no tensor of the context network")
        settle(ours, key)
    settled = True
    while settled:
        settled = False
        for ours in [name for name in expected if name not in found]:
            same = [n for n in expected if n not in found and expected[n] == expected[ours]]
            keys = [key for key, value in theirs.items() if tuple(value.shape) == expected[ours]]
            if len(same) == len(keys) == 1:
                settle(ours, keys[0])
                settled = True
    missing = [f"{name} {list(expected[name])}" for name in expected if name not in found]
    unknown = [f"{key} {list(value.shape)}" for key, value in theirs.items()]
    if missing or unknown:
        lines = ["the shapes of the context network do not tell which tensor is which; say --names FILE (see --guess)"]
        lines += [f"  in the checkpoint: {key}" for key in unknown]
        lines += [f"  expected: {name}" for name in missing]
        raise CheckpointError("\n".join(lines))
    for name in [name for name in weights.left if name.startswith("ctx_net.")]:
        del weights.left[name]
    for biased, (layer, shares) in zip(BIASED, JOINT.items()):
        weight, bias = found.pop(f"{layer}.weight"), found.pop(f"{layer}.bias")
        parts = weight.split([shape[1] for shape in widths[layer]], dim=1)
        found |= {f"{share}.weight": part for share, part in zip(shares, parts)}
        found[f"{biased}.bias"] = bias
    return found


# The paper's.
CONTEXT = {
    "stages": [
        {"channels": 80, "resolution": 24},
        {"channels": 112, "resolution": 16},
        {"channels": 112, "resolution": 8},
    ],
    "blocks": 2,
    "joined": 128,
    "gate": {"centre": 0.97, "steepness": 12.0},
}


def convert(state, context=None, names=None):
    """The network of a checkpoint's weights by name, and its shape as a model file's header has it.

    `context` are the sizes of a Hybrid's context network as in a shape, but for `features`: by default the paper's;
    `names` the checkpoint's names of its tensors by ours.
    """
    refuse_authors_hybrid(state)
    weights = Weights(state)
    tensors, sizes = embedding(weights)
    hybrid = any(name.startswith("head.") for name in state)
    layers, head, features = point_layers(weights, "head." if hybrid else "", sizes)
    tensors |= layers
    shape = head
    if hybrid:
        shape = {"head": head, "context": {**(context or CONTEXT), "features": features}}
        tensors |= context_layers(weights, shape, names or {})
    elif features != 0:
        raise CheckpointError(f"`input` takes {features} numbers beside the point and the embedding, expected none")
    if weights.left:
        unknown = ", ".join(sorted(weights.left))
        raise CheckpointError(f"unknown tensors: {unknown}")
    module = network(shape)
    for name, value in module.state_dict().items():
        if tensors[name].shape != value.shape:
            found, expected = list(tensors[name].shape), list(value.shape)
            raise CheckpointError(f"the tensor for `{name}` is {found}, expected {expected}")
    module.load_state_dict({name: value.contiguous() for name, value in tensors.items()})
    return module, shape


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
        settings=complete({"path": {"prior_deviation": 0.5, "time_exponent": 3.0}}),
        step=0,
        validation_distance=0.0,
    )


def write_guess(checkpoint, file):
    """Writes the names guessed for `checkpoint` to `file`, which must not exist."""
    state = read_state(checkpoint)
    if not any(name.startswith("ctx_net.") for name in state):
        raise CheckpointError(f"{checkpoint}: no tensor starts with `ctx_net.`: no names are needed")
    names = guess(state)
    named = set(names.values())
    with file.open("x") as out:
        json.dump(names, out, indent=1)
    left = [name for name in state if name.startswith("ctx_net.") and name not in named]
    print(f"{file}: {len(names)} names, by order among layers of the same shapes; look them through")
    for name in left:
        print(f"  not named: {name} {list(state[name].shape)}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("--data", type=Path, help="folder of the two normalisation files")
    parser.add_argument("--names", type=Path, help="JSON: names of the context network's tensors, ours to theirs")
    parser.add_argument("--guess", type=Path, help="writes names guessed by order here, to be checked, and no model")
    parser.add_argument("--out", type=Path, default=Path("model.safetensors"))
    args = parser.parse_args()
    if args.data is None and args.guess is None:
        parser.error("--data is missing: the folder of the data set that the network was trained on")
    try:
        if args.guess:
            write_guess(args.checkpoint, args.guess)
            return
        names = json.loads(args.names.read_text()) if args.names else {}
        module, shape = convert(read_state(args.checkpoint), names=names)
        converted = model(module, shape, normalisation(args.data))
    except (CheckpointError, OSError, KeyError, json.JSONDecodeError) as error:
        sys.exit(f"error: {error}")
    converted.save(args.out)
    count = sum(value.numel() for value in module.parameters())
    print(f"{args.out}: {count} parameters, {json.dumps(shape)}")


if __name__ == "__main__":
    main()

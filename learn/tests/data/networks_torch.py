"""Reference values of tests/net_torch.rs, by PyTorch: writes networks_torch.safetensors beside this file.

    pip install .[torch]
    python networks_torch.py

For two tiny networks (mlp, hybrid), of clouds with colours: weights, a batch, and what
the modules of tdcr.torch make of it in f64: velocities, loss, and the loss's gradient by every
weight, stored as f32. Shapes are JSON in the metadata.
"""

import json
import math
from pathlib import Path

import torch
from safetensors import safe_open
from safetensors.torch import save_file

from tdcr.torch import networks
from tdcr.torch.flow import loss as loss_of

PATH = Path(__file__).with_suffix(".safetensors")
HEAD = {"width": 12, "depth": 3, "embedding": 8, "condition_dim": 2, "channels": "xyz-rgb"}
SHAPES = {
    "mlp": HEAD,
    "hybrid": {
        "head": HEAD,
        "context": {
            "stages": [
                {"channels": 6, "resolution": 5},
                {"channels": 3, "resolution": 4},
                {"channels": 6, "resolution": 3},
            ],
            "blocks": 2,
            "joined": 16,
            "features": 5,
            "gate": {"centre": 0.75, "steepness": 4.0},
        },
    },
}
CLOUDS, POINTS = 2, 40


def weights(module, generator):
    """No weight keeps a special value, and squeezed features are positive, where ReLU has a gradient."""
    for name, value in module.named_parameters():
        bound = 2 / math.sqrt(value[0].numel()) if value.dim() > 1 else 0.5
        value.data.uniform_(-bound, bound, generator=generator)
        if "norm" in name and name.endswith("weight"):
            value.data += 1
        if name.endswith("reduce.weight"):
            value.data.abs_()
    return {n: v.detach().clone() for n, v in networks.to_file(module.state_dict()).items()}


def batch(generator):
    points = 0.5 * torch.randn(CLOUDS, POINTS, 6, generator=generator)
    return {
        "times": torch.tensor([0.3, 0.9]),
        "conditions": torch.rand(CLOUDS, HEAD["condition_dim"], generator=generator),
        "points": points,
        "targets": torch.randn(CLOUDS, POINTS, 6, generator=generator),
    }


def evaluate(shape, params, data):
    """Velocities, loss and gradients in f64."""
    module = networks.network(shape).double()
    module.load_state_dict({n: v.double() for n, v in networks.from_file(params).items()})
    inputs = [data[name].double() for name in ("points", "times", "conditions")]
    velocities = module(*inputs)
    loss = loss_of(velocities, data["targets"].double())
    loss.backward()
    gradients = networks.to_file({n: v.grad for n, v in module.named_parameters()})
    return velocities.detach(), loss.detach(), gradients


def read():
    """Shapes, weights, batches and results as stored."""
    with safe_open(PATH, "pt") as file:
        tensors = {name: file.get_tensor(name) for name in file.keys()}
        return json.loads(file.metadata()["shapes"]), tensors


def part(tensors, prefix):
    return {n.removeprefix(prefix): v for n, v in tensors.items() if n.startswith(prefix)}


def main():
    generator = torch.Generator().manual_seed(8)
    tensors = {}
    for name, shape in SHAPES.items():
        params = weights(networks.network(shape), generator)
        data = batch(generator)
        velocities, loss, gradients = evaluate(shape, params, data)
        # A gradient of nothing but rounding would compare with nothing.
        assert all(gradient.norm() > 1e-6 for gradient in gradients.values())
        tensors |= {f"{name}.weight.{key}": value for key, value in params.items()}
        tensors |= {f"{name}.batch.{key}": value for key, value in data.items()}
        tensors |= {f"{name}.gradient.{key}": value.float() for key, value in gradients.items()}
        tensors[f"{name}.velocities"] = velocities.float()
        tensors[f"{name}.loss"] = loss.float().reshape(1)
    save_file(tensors, PATH, {"shapes": json.dumps(SHAPES)})


if __name__ == "__main__":
    main()

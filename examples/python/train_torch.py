"""Trains the paper's MLP in PyTorch on a data set of `tdcr collect`, and writes a model file for `tdcr`.

    pip install torch safetensors h5py
    tdcr collect --samples 2000 --out data
    python train_torch.py data --out torch.safetensors
    tdcr eval --model torch.safetensors --data data

Action-conditioned flow matching (paper, Alg. tdcr-training): noise x0 from N(0, 0.5^2), a point x1 of a cloud, a time
t = u^(1/3) with u uniform; the network learns the velocity x1 - x0 at x = (1 - t) x0 + t x1, t and the command.
The networks are those of networks.py; their own training in Rust is `tdcr train`.
"""

import argparse
import copy
import json
import math
from pathlib import Path

import h5py
import numpy as np
import torch
from networks import loss, network, save

FORMAT = 2
DEVIATION, EXPONENT = 0.5, 3.0


def read_split(data, split):
    """Commands (B, D) and clouds (B, N, 3) in the units that networks see, of all shards of a split."""
    commands, clouds = [], []
    for path in sorted((data / split).glob("shard-*.h5")):
        with h5py.File(path) as shard:
            commands.append(shard["motors_norm"][()])
            clouds.append(shard["data_norm"][()])
    if not clouds:
        raise SystemExit(f"error: {data / split} has no shard-*.h5, expected a data set of `tdcr collect`")
    return torch.from_numpy(np.concatenate(commands)), torch.from_numpy(np.concatenate(clouds))


def draw(commands, clouds, batch, points, generator):
    """A batch: points between noise and data, their times and commands, and the velocities to learn."""
    which = torch.randint(len(clouds), (batch, 1), generator=generator)
    chosen = torch.randint(clouds.shape[1], (batch, points), generator=generator)
    data = clouds[which, chosen]
    noise = DEVIATION * torch.randn(data.shape, generator=generator)
    t = torch.rand(batch, generator=generator) ** (1 / EXPONENT)
    mix = t[:, None, None]
    return (1 - mix) * noise + mix * data, t, commands[which[:, 0]], data - noise


def learning_rate(step, args):
    """Linear warm-up, then half a cosine to 1e-6; the first step is 1."""
    if step <= args.warmup:
        return args.learning_rate * step / args.warmup
    progress = (step - args.warmup) / (args.steps - args.warmup)
    return 1e-6 + 0.5 * (args.learning_rate - 1e-6) * (1 + math.cos(math.pi * progress))


def train(module, commands, clouds, args, device):
    """Takes the steps; returns the averaged network."""
    generator = torch.Generator().manual_seed(args.seed)
    average = copy.deepcopy(module)
    optimizer = torch.optim.AdamW(module.parameters(), weight_decay=1e-4)
    for step in range(1, args.steps + 1):
        x, t, c, velocity = (part.to(device) for part in draw(commands, clouds, args.clouds, args.points, generator))
        for group in optimizer.param_groups:
            group["lr"] = learning_rate(step, args)
        error = loss(module(x, t, c), velocity)
        optimizer.zero_grad()
        error.backward()
        torch.nn.utils.clip_grad_norm_(module.parameters(), 1.0)
        optimizer.step()
        # The average follows fast at first, so that it is not held at the initial weights.
        decay = min(0.999, (1 + step) / (10 + step))
        with torch.no_grad():
            for kept, new in zip(average.parameters(), module.parameters()):
                kept.lerp_(new, 1 - decay)
        if step % 100 == 0 or step == args.steps:
            print(f"step {step} of {args.steps}: loss {error.item():.4e}", flush=True)
    return average


def header(data, shape, steps):
    """Header of a model file: what the numbers mean, and what the network is."""
    motors = json.loads((data / "global_motors_scope-all.json").read_text())["all"]
    points = json.loads((data / "global_norm_scope-all_anchor-origin.json").read_text())["all"]
    meta = data / "meta.json"
    origin = json.loads(meta.read_text())["origin"] if meta.exists() else {}
    content = {
        "provenance": {
            "subject": origin.get("simulated", {}).get("recipe", {}).get("subject"),
            "normalisation": {"motor_min": motors["min"], "motor_max": motors["max"], "scale": points["scale"]},
        },
        "shape": shape,
        "settings": {"path": {"prior_deviation": DEVIATION, "time_exponent": EXPONENT}},
        "step": steps,
        "validation_distance": 0.0,  # not validated here: see `tdcr eval`
    }
    return {"format": FORMAT, "kind": "model", "content": content}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("data", type=Path, help="folder of the data set")
    parser.add_argument("--out", type=Path, default=Path("torch.safetensors"))
    parser.add_argument("--width", type=int, default=512)
    parser.add_argument("--depth", type=int, default=6)
    parser.add_argument("--embedding", type=int, default=256)
    parser.add_argument("--steps", type=int, default=20_000)
    parser.add_argument("--clouds", type=int, default=8, help="clouds of a step")
    parser.add_argument("--points", type=int, default=2048, help="points of each, drawn anew every step")
    parser.add_argument("--learning-rate", type=float, default=3e-4)
    parser.add_argument("--warmup", type=int, default=1000, help="at most a tenth of the steps")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    args.warmup = min(args.warmup, args.steps // 10)
    torch.manual_seed(args.seed)
    commands, clouds = read_split(args.data, "train")
    sizes = {"width": args.width, "depth": args.depth, "embedding": args.embedding}
    shape = {**sizes, "condition_dim": commands.shape[1], "channels": "xyz"}
    device = "cuda" if torch.cuda.is_available() else "cpu"
    average = train(network(shape).to(device), commands, clouds, args, device)
    save(args.out, average.cpu(), header(args.data, shape, args.steps))
    print(f"{args.out}: {sum(value.numel() for value in average.parameters())} parameters")


if __name__ == "__main__":
    main()

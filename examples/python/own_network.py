"""A network of one's own in PyTorch, trained and scored beside one of tdcr's.

    tdcr collect --samples 2000 --out data
    python examples/python/own_network.py --data data --out own
    torchrun --nproc-per-node 4 examples/python/own_network.py --data data --out own      # on four GPUs

Any `torch.nn.Module` can take the network's place: `forward(x, t, c)` takes points (B, N, 3), flow times (B,) and conditions
(B, D), and returns the velocities (B, N, 3) of the points, all in the units of the data set's normalisation. The one here is
like PointNet (Qi et al., CVPR 2017): features of each point, their maximum over the cloud, and a second network that sees
both. tdcr's own sees each point alone. Both learn by the same recipe; `tdcr.evaluate` scores both by the same table, the clouds
of the network of one's own as it would those of any program (`predictions=`).
"""

import argparse
from pathlib import Path

import torch
from torch import Tensor, nn

import tdcr
from tdcr.torch import CloudSet, Trainer, distributed, network, preset, write_predictions


class PointNet(nn.Module):
    """Velocities of points from their features and the cloud's maximum of them."""

    def __init__(self, condition_dim: int, width: int) -> None:
        super().__init__()
        self.embedding = nn.Sequential(nn.Linear(condition_dim + 9, width), nn.SiLU(), nn.Linear(width, width))
        self.local = nn.Sequential(nn.Linear(3 + width, width), nn.SiLU(), nn.Linear(width, width))
        self.head = nn.Sequential(nn.Linear(3 * width, width), nn.SiLU(), nn.Linear(width, width), nn.SiLU())
        self.output = nn.Linear(width, 3)

    def forward(self, x: Tensor, t: Tensor, c: Tensor) -> Tensor:
        angles = t[:, None] * torch.pi * 2.0 ** torch.arange(4, device=t.device)
        e = self.embedding(torch.cat([c, t[:, None], angles.cos(), angles.sin()], dim=1))
        e = e[:, None].expand(-1, x.shape[1], -1)
        h = self.local(torch.cat([x, e], dim=-1))
        whole = h.amax(dim=1, keepdim=True).expand_as(h)
        return self.output(self.head(torch.cat([h, whole, e], dim=-1)))


def scores(data: Path, points: int, **what: Path) -> dict[str, float]:
    """What `tdcr eval` says of the network or of the clouds."""
    found = tdcr.evaluate(data=data, points=points, emd_points=min(points, 500), **what)
    return {key: found[key] for key in ("cd", "emd", "cd_floor")}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--data", type=Path, default=Path("data"), help="folder of the data set")
    parser.add_argument("--out", type=Path, default=Path("own"), help="folder of both runs")
    parser.add_argument("--steps", type=int, default=7000)
    parser.add_argument("--width", type=int, default=128, help="features of the network")
    parser.add_argument("--points", type=int, default=4000, help="points of a cloud that are compared")
    args = parser.parse_args()

    training, validation = (CloudSet.read(args.data, split) for split in ("train", "val"))
    quick = preset("quick")
    # Steps that suit any network: AdamW, at a usual learning rate.
    settings = quick.settings(steps=args.steps, optimizer="adamw", learning_rate=2e-3)
    torch.manual_seed(settings["seed"])
    own = PointNet(training.condition_dim, args.width)
    shape = quick.shape(training.condition_dim)
    with distributed() as device:
        runs = {
            "own": Trainer(own, training, validation, settings, args.out / "own", device=device),
            "tdcr": Trainer(network(shape), training, validation, settings, args.out / "tdcr", shape=shape, device=device),
        }
        models = {name: run.run() for name, run in runs.items()}
    if models["own"] is None:  # a rank other than the first
        return

    clouds = args.out / "clouds.npz"
    write_predictions(clouds, models["own"], args.data, args.points)
    rows = {
        "own network": scores(args.data, args.points, predictions=clouds),
        "tdcr's MLP": scores(args.data, args.points, model=args.out / "tdcr/model.safetensors"),
    }
    print(f"{'':14}{'CD (1e-4 m²)':>14}{'EMD (mm)':>10}{'CD / floor':>12}")
    for name, found in rows.items():
        print(f"{name:14}{1e4 * found['cd']:14.4f}{1e3 * found['emd']:10.2f}{found['cd'] / found['cd_floor']:12.1f}")


if __name__ == "__main__":
    main()

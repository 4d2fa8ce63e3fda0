"""How well the positions of the discs follow from so many training commands, where nothing but positions is learned.

    .venv/bin/python benches/poses.py --robot 5m --payload 0.03 --commands 2000,8000,32000

A regression in PyTorch, commands (and payloads) to the equilibrium's disc positions, without cameras and clouds: a layer of 256,
three residual blocks and an output layer, 10,000 steps of AdamW on 128 commands each. Prints a row for each number of training
commands: the tip's mean distance and the root mean square of all discs' distances (mm), on training commands and on 1,000 others,
and the latter without the worst 5 % of the commands. Takes about a minute and a half of processor time for each row.
"""

import argparse

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

import tdcr

TESTS = 1000
WIDTH, BLOCKS, BATCH, STEPS, RATE = 256, 3, 128, 10_000, 2e-3


class Block(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.norm, self.linear = nn.LayerNorm(WIDTH), nn.Linear(WIDTH, WIDTH)

    def forward(self, h: Tensor) -> Tensor:
        return h + self.linear(F.silu(self.norm(h)))


def equilibria(robot: tdcr.Robot, count: int, heaviest: float) -> tuple[Tensor, Tensor]:
    """Conditions (count, D) in [-1, 1] and disc positions (count, n, 3) (m). As training has it, module 1's commands are sorted,
    and the others permuted alike: one representative of each class of symmetric commands."""
    rng = np.random.default_rng(1)
    commands = robot.random_commands(count, seed=1)
    order = np.argsort(commands[:, :3], axis=1)
    modules = commands.reshape(count, -1, 3)
    commands = np.take_along_axis(modules, np.repeat(order[:, None], modules.shape[1], axis=1), axis=2).reshape(count, -1)
    payloads = rng.uniform(0, heaviest, count) * (rng.random(count) > 0.1)
    positions = tdcr.settle_batch(robot, commands, payloads).positions
    low, high = robot.command_ranges.T
    conditions = (2 * commands - low - high) / (high - low)
    if heaviest > 0:
        conditions = np.c_[conditions, 2 * payloads / heaviest - 1]
    return torch.tensor(conditions, dtype=torch.float32), torch.tensor(positions, dtype=torch.float32)


def fit(conditions: Tensor, positions: Tensor) -> nn.Module:
    """A network trained on these commands; its output is (positions - their mean) / their deviation."""
    torch.manual_seed(0)
    layers = [nn.Linear(conditions.shape[1], WIDTH), *(Block() for _ in range(BLOCKS)), nn.SiLU()]
    network = nn.Sequential(*layers, nn.Linear(WIDTH, positions[0].numel()))
    optimizer = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=1e-4)
    warm_up = STEPS // 20
    schedule = torch.optim.lr_scheduler.LambdaLR(
        optimizer, lambda k: min(1.0, (k + 1) / warm_up) * 0.5 * (1 + np.cos(np.pi * k / STEPS))
    )
    targets = ((positions - positions.mean(0)) / positions.std()).flatten(1)
    for _ in range(STEPS):
        rows = torch.randint(len(conditions), (BATCH,))
        loss = F.mse_loss(network(conditions[rows]), targets[rows])
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
    return network


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", default="5m")
    parser.add_argument("--payload", type=float, default=0.0, help="heaviest payload (kg); a tenth of the commands has none")
    parser.add_argument("--commands", default="2000,8000,32000", help="numbers of training commands")
    arguments = parser.parse_args()
    counts = [int(count) for count in arguments.commands.split(",")]
    conditions, positions = equilibria(tdcr.Robot(arguments.robot), TESTS + max(counts), arguments.payload)
    print("| training commands | tip | all discs | tip, other commands | all discs | without the worst 5 % |")
    print("|---|---|---|---|---|---|")
    for count in counts:
        seen = slice(TESTS, TESTS + count)
        network = fit(conditions[seen], positions[seen])
        mean, deviation = positions[seen].mean(0), positions[seen].std()
        cells = []
        for part in (seen, slice(0, TESTS)):
            with torch.no_grad():
                predicted = network(conditions[part]).unflatten(1, positions.shape[1:]) * deviation + mean
            errors = 1e3 * (predicted - positions[part]).norm(dim=2)
            squares = errors.square().mean(1)
            cells += [errors[:, -1].mean(), squares.mean().sqrt()]
        most = squares.sort().values[: round(0.95 * TESTS)]
        print(f"| {count:,} | " + " | ".join(f"{cell:.1f}" for cell in [*cells, most.mean().sqrt()]) + " |", flush=True)


if __name__ == "__main__":
    main()

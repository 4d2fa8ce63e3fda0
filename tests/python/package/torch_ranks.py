"""What `torchrun` runs for test_torch_train.py on each of two ranks: runs of tdcr.torch.train one after another.

    torchrun --nproc-per-node 2 torch_ranks.py DATA FOLDER

As PyTorch takes seconds to load, one process does all of them: a run, the same run that is told to stop on the way (the
second rank alone is) and started again, and a run on a stream whose workers are forked.
"""

import os
import pathlib
import signal
import sys

from tdcr.torch import distributed
from tdcr.torch.train import INTERRUPTED, main
from tdcr.torch.trainer import Trainer

# What pays in long runs costs short ones.
SHORT = ["--octaves", "0", "--late-times", "0", "--prior-cut", "0", "--symmetry", "none"]
SIZE = ["--width", "32", "--depth", "3", "--embedding", "32", *SHORT, "--net", "mlp", "--quiet"]
STEPS = ["--clouds", "8", "--points", "64", "--steps", "60", "--validate-every", "20", "--learning-rate", "3e-3"]
STREAM = ["--stream", "2m", "--stream-points", "80", "--window", "8", "--fresh", "0.5", "--workers", "1"]

#: Step in which the second rank is told to stop.
STOPPED = 25


def on_set(data: str | pathlib.Path, out: pathlib.Path) -> list[str]:
    """Arguments of a run on the data set."""
    return ["--data", str(data), "--out", str(out), "--optimizer", "adamw", *SIZE, *STEPS]


def on_stream(out: pathlib.Path) -> list[str]:
    """Arguments of a run on a stream."""
    short = ["--clouds", "4", "--points", "32", "--steps", "20", "--validate-every", "10"]
    return ["--out", str(out), *SIZE, *STREAM, *short]


def stop_itself(step: int) -> None:
    """Sends this process a SIGTERM in a step."""
    take_step = Trainer.take_step

    def stopping(self: Trainer, *arguments: object) -> None:
        if self.step + 1 == step:
            os.kill(os.getpid(), signal.SIGTERM)
        take_step(self, *arguments)

    Trainer.take_step = stopping


def run(data: str, folder: pathlib.Path) -> None:
    """All runs."""
    assert main(on_set(data, folder / "whole")) == 0
    assert main(on_stream(folder / "stream")) == 0
    take_step = Trainer.take_step
    if os.environ["RANK"] == "1":
        stop_itself(STOPPED)
    assert main(on_set(data, folder / "resumed")) == INTERRUPTED
    Trainer.take_step = take_step
    assert main(on_set(data, folder / "resumed")) == 0


if __name__ == "__main__":
    # One process group for all: PyTorch makes no second one under torchrun.
    with distributed("cpu"):
        run(sys.argv[1], pathlib.Path(sys.argv[2]))

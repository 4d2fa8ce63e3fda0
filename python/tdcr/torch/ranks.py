"""Processes that train together: the process group of `torchrun`."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta

import torch
from torch import distributed as dist


def group() -> tuple[int, int]:
    """Rank and number of ranks of the process group; 0 and 1 without one."""
    if dist.is_available() and dist.is_initialized():
        return dist.get_rank(), dist.get_world_size()
    return 0, 1


@contextmanager
def distributed(device: str | None = None) -> Iterator[torch.device]:
    """The process group of `torchrun`, if the process was started by it, and the device of this rank.

    A GPU of the rank's own by NCCL if there are any, else the CPU by Gloo; `device` asks for one of them.
    """
    local = int(os.environ.get("LOCAL_RANK", "0"))
    kind = device or ("cuda" if torch.cuda.is_available() else "cpu")
    place = torch.device(f"cuda:{local}" if kind == "cuda" else kind)
    if place.type == "cuda":
        torch.cuda.set_device(place)
    # Within a group that stands, as that of a script which trains several networks, it is that one.
    if int(os.environ.get("WORLD_SIZE", "1")) == 1 or dist.is_initialized():
        yield place
        return
    # Ranks wait while rank 0 validates.
    dist.init_process_group("nccl" if place.type == "cuda" else "gloo", timeout=timedelta(hours=1))
    try:
        yield place
    finally:
        dist.destroy_process_group()

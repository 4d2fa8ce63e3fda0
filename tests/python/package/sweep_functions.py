"""Functions that tests sweep; workers import them by name."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np

import tdcr


def tip(condition: tuple[str, int, float]) -> np.ndarray:
    """Tip of a robot under a random command with a payload."""
    name, seed, payload = condition
    robot = tdcr.Robot(name)
    return tdcr.settle(robot, robot.random_commands(1, seed)[0], payload).tip


def dies_once(condition: tuple[str, int]) -> int:
    """Kills its process the first time that it is called with an odd number."""
    folder, number = condition
    mark = Path(folder) / str(number)
    if number % 2 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number**2


def dies(_: int) -> int:
    """Kills its process."""
    os.kill(os.getpid(), signal.SIGKILL)
    return 0


def refuses(number: int) -> int:
    """Raises for 3."""
    if number == 3:
        raise ValueError("3 is refused")
    return number


def affinity(_: int) -> tuple[int, int]:
    """Processors that its process may run on, and threads that it computes with."""
    return len(os.sched_getaffinity(0)), tdcr.threads()


def ends(status: int) -> int:
    """Ends its process."""
    os._exit(status)


def unsendable(_: int) -> object:
    """Returns what no other process can have."""
    return (number for number in range(3))

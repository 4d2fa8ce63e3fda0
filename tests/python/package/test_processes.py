"""The package in the processes that people make: forked, spawned, interrupted."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time

import numpy as np
import pytest

import tdcr


def tips(seed: int) -> np.ndarray:
    robot = tdcr.Robot("2m")
    return tdcr.settle_batch(robot, robot.random_commands(20, seed)).tips


@pytest.mark.parametrize("method", ["fork", "spawn", "forkserver"])
def test_pools_of_processes_compute_what_the_parent_does(method: str) -> None:
    expected = [tips(seed) for seed in range(4)]
    with multiprocessing.get_context(method).Pool(2) as pool:
        found = pool.map_async(tips, range(4)).get(timeout=60.0)
    assert all(np.array_equal(a, b) for a, b in zip(expected, found, strict=True))


def test_a_child_may_fork_again() -> None:
    tips(0)

    def grandchild(pipe: object) -> None:
        pipe.send(tips(1))  # type: ignore[attr-defined]

    def child(pipe: object) -> None:
        tips(0)
        inner = multiprocessing.get_context("fork").Process(target=grandchild, args=(pipe,))
        inner.start()
        inner.join(30.0)

    here, there = multiprocessing.Pipe()
    process = multiprocessing.get_context("fork").Process(target=child, args=(there,))
    process.start()
    assert here.poll(30.0)
    assert np.array_equal(here.recv(), tips(1))
    process.join(30.0)
    assert process.exitcode == 0


def test_ctrl_c_ends_a_long_call() -> None:
    robot = tdcr.Robot("2m")
    commands = np.tile(robot.random_commands(1000), (1000, 1))
    timer = threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT))
    timer.start()
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        tdcr.settle_batch(robot, commands)
    assert time.monotonic() - began < 10.0


def test_other_threads_run_during_a_long_call() -> None:
    robot = tdcr.Robot("2m")
    commands = np.tile(robot.random_commands(1000), (20, 1))
    beats = 0
    ended = threading.Event()

    def beat() -> None:
        nonlocal beats
        while not ended.wait(0.002):
            beats += 1

    thread = threading.Thread(target=beat)
    thread.start()
    tdcr.settle_batch(robot, commands)
    ended.set()
    thread.join()
    assert beats > 5


def test_an_exception_of_the_progress_callback_ends_the_call() -> None:
    robot = tdcr.Robot("2m")

    def progress(_: int) -> None:
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        tdcr.settle_batch(robot, robot.random_commands(5000), progress=progress)


@pytest.mark.parametrize("count", [0, 5000])
def test_a_number_of_threads_that_makes_no_sense_is_refused(count: int) -> None:
    with pytest.raises(ValueError, match=f"count is {count}; expected 1 to 1024"):
        tdcr.set_threads(count)

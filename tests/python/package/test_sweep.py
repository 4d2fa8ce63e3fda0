"""Sweeps on processes and on Ray: the results of a loop, whatever dies meanwhile."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import tdcr
from tdcr.errors import InputError, SweepError

sys.path.insert(0, str(Path(__file__).parent))
import sweep_functions as functions

CONDITIONS = [(name, seed, 0.005 * seed) for name in ("2m", "3m") for seed in range(6)]


def check_engine(engine: str, folder: Path) -> None:
    done: list[int] = []
    found = tdcr.sweep(functions.tip, iter(CONDITIONS), engine, workers=2, progress=done.append)  # type: ignore[arg-type]
    expected = [functions.tip(condition) for condition in CONDITIONS]
    assert all(np.array_equal(f, e) for f, e in zip(found, expected, strict=True))
    assert sum(done) == len(CONDITIONS)
    # A killed worker is replaced, and its conditions are tried again.
    conditions = [(str(folder), number) for number in range(4)]
    assert tdcr.sweep(functions.dies_once, conditions, engine, workers=2) == [0, 1, 4, 9]  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="3 is refused"):
        tdcr.sweep(functions.refuses, range(6), engine, workers=2)  # type: ignore[arg-type]


def test_processes_give_the_results_of_a_loop(tmp_path: Path) -> None:
    check_engine("processes", tmp_path)
    with pytest.raises(SweepError, match="condition 0: the worker that had it died 2 times"):
        tdcr.sweep(functions.dies, [0], retries=1, workers=1)


def test_settings_that_make_no_sense_are_refused() -> None:
    with pytest.raises(InputError, match="engine is 'dask'; expected 'processes' or 'ray'"):
        tdcr.sweep(functions.tip, CONDITIONS, "dask")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="cpus is 0; expected 1 to 1024"):
        tdcr.sweep(functions.tip, CONDITIONS, cpus=0)
    assert tdcr.sweep(functions.tip, []) == []


SCRIPT = """
import tdcr

FACTOR = 3


class Height:
    def __init__(self, metres):
        self.metres = metres


def height(part):
    robot = tdcr.Robot("2m")
    command = robot.mean_command * part
    return Height(FACTOR * float(tdcr.settle(robot, command).tip[2]))


found = tdcr.sweep(height, [0.9, 1.0], workers=2)
print([isinstance(one, Height) and one.metres == height(part).metres for one, part in zip(found, [0.9, 1.0])])
"""
"""A script without a guard; its function uses a class and a variable of its own."""


@pytest.mark.parametrize("how", ["script", "stdin", "notebook"])
def test_functions_of_scripts_and_notebooks_are_sent_to_the_workers(how: str, tmp_path: Path) -> None:
    file = tmp_path / "script.py"
    file.write_text(SCRIPT, encoding="utf-8")
    # A notebook's main module has no file, and its code is executed piece by piece.
    notebook = f"import __main__\nexec({SCRIPT!r}, __main__.__dict__)"
    arguments = {"script": [str(file)], "stdin": [], "notebook": ["-c", notebook]}[how]
    environment = os.environ | {"PYTHONPATH": str(Path(tdcr.__file__).parents[1])}
    done = subprocess.run(
        [sys.executable, *arguments], input=SCRIPT, capture_output=True, text=True, timeout=60, env=environment, check=False
    )
    assert (done.returncode, done.stdout) == (0, "[True, True]\n"), done.stderr


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system has no affinity of processes")
def test_workers_are_as_many_as_the_process_may_run_on() -> None:
    code = """
import os, sys
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
import tdcr, tdcr._threads, tdcr.sweeps as sweeps
import sweep_functions as functions
started = []
worker = sweeps.Worker
sweeps.Worker = lambda setup: started.append(worker(setup)) or started[-1]
print(tdcr._threads.processors(), tdcr.threads(), tdcr.sweep(functions.affinity, range(4)), len(started))
"""
    paths = [str(Path(tdcr.__file__).parents[1]), str(Path(__file__).parent)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, env=environment, check=False)
    assert done.stdout == f"1 1 {[(1, 1)] * 4} 1\n", done.stderr


def test_errors_say_how_workers_died_and_where_functions_failed() -> None:
    with pytest.raises(
        SweepError, match="condition 0: .* died 1 times; the last one was killed by SIGKILL: it may need more memory"
    ):
        tdcr.sweep(functions.dies, [0], retries=0, workers=1)
    with pytest.raises(SweepError, match="condition 1: .* died 2 times; the last one ended with exit status 7"):
        tdcr.sweep(ends_at_one, [0, 1, 2], retries=1, workers=1)
    with pytest.raises(ValueError, match="3 is refused") as raised:
        tdcr.sweep(functions.refuses, range(6), workers=1)
    assert "Condition 3, in a worker" in raised.value.__notes__[0] and "in refuses" in raised.value.__notes__[0]
    with pytest.raises(InputError, match="what the function returned cannot be sent back"):
        tdcr.sweep(functions.unsendable, [0], workers=1)
    with pytest.raises(InputError, match="condition 0 cannot be sent to another process"):
        tdcr.sweep(functions.refuses, iter([(number for number in range(3))]), workers=1)


def ends_at_one(number: int) -> int:
    """Ends its process for 1 alone."""
    return functions.ends(7) if number == 1 else number


def test_an_exception_of_progress_ends_the_workers() -> None:
    def stop(_: int) -> None:
        raise KeyboardInterrupt

    before = set(children())
    with pytest.raises(KeyboardInterrupt):
        tdcr.sweep(functions.refuses, iter(int, 1), workers=2, progress=stop)
    assert set(children()) <= before


def children() -> list[str]:
    """Numbers of the processes that this one has started."""
    return (Path("/proc/self/task") / str(os.getpid()) / "children").read_text(encoding="ascii").split()


@pytest.fixture
def two_nodes(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    ray = pytest.importorskip("ray")
    cluster_utils = pytest.importorskip("ray.cluster_utils")
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    paths = [str(Path(tdcr.__file__).parents[1]), str(Path(__file__).parent)]
    monkeypatch.setenv("PYTHONPATH", ":".join(paths))
    cluster = cluster_utils.Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    try:
        cluster.add_node(num_cpus=1)
        ray.init(address=cluster.address, log_to_driver=False)
        yield
    finally:
        ray.shutdown()
        cluster.shutdown()


def test_a_ray_cluster_of_two_nodes_gives_the_results_of_a_loop(two_nodes: None, tmp_path: Path) -> None:
    check_engine("ray", tmp_path)

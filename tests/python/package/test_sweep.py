"""Sweeps on processes and on Ray: the results of a loop, whatever dies meanwhile."""

from __future__ import annotations

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

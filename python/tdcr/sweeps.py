"""Sweeps: one function over many conditions, on the cores of one machine or of a Ray cluster."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, Literal, TypeVar

from tdcr._arrays import Progress, as_count
from tdcr._tdcr import set_threads
from tdcr.errors import InputError, MissingPackageError, SweepError

Condition = TypeVar("Condition")
Result = TypeVar("Result")

Engine = Literal["processes", "ray"]

_AHEAD = 4
"""Tasks that wait for each worker: enough that none idles, few enough that conditions may be endless."""


def sweep(
    function: Callable[[Condition], Result],
    conditions: Iterable[Condition],
    engine: Engine = "processes",
    *,
    workers: int | None = None,
    cpus: int = 1,
    retries: int = 3,
    progress: Progress | None = None,
) -> list[Result]:
    """Calls ``function`` once for each condition, and returns the results in the order of the conditions.

    The results are those of ``[function(c) for c in conditions]``, whatever the engine and the number of workers. A worker
    that dies is replaced, and its conditions are tried again. Each worker computes on ``cpus`` threads.

    Args:
        function: Of one condition. Both it and the conditions are sent to other processes, so they can be pickled.
        conditions: Any number; they are drawn as workers need them.
        engine: ``"processes"`` of this machine, or tasks of ``"ray"``: of the cluster that Ray is connected to, or of one that
            it starts here. Ray is an optional dependency: ``pip install ".[ray]"``.
        workers: Number of conditions at a time; as many as there are processors for, where it is not given.
        cpus: Processors that each call uses.
        retries: How often a condition is tried again after the worker that had it died.
        progress: Is called with the number of conditions done since its last call, as ``tqdm(total=...).update``.

    Raises:
        SweepError: If a condition's worker died once more than ``retries`` allows.
        Exception: Whatever ``function`` raised first; conditions that have not begun are dropped.
    """
    cpus = as_count(cpus, "cpus", 1, 1024)
    retries = as_count(retries, "retries", 0, 1000)
    if workers is not None:
        workers = as_count(workers, "workers", 1, 100_000)
    engines = {"processes": _by_processes, "ray": _by_ray}
    if engine not in engines:
        raise InputError(f"engine is {engine!r}; expected 'processes' or 'ray'")
    results: dict[int, Result] = {}
    for index, result in engines[engine](function, iter(enumerate(conditions)), workers, cpus, retries):
        results[index] = result
        if progress is not None:
            progress(1)
    return [results[index] for index in range(len(results))]


def _by_processes(
    function: Callable[[Any], Any], conditions: Iterator[tuple[int, Any]], workers: int | None, cpus: int, retries: int
) -> Iterator[tuple[int, Any]]:
    workers = workers or max(1, (os.cpu_count() or 1) // cpus)
    # Conditions that are to be tried, again or for the first time, with how often each was.
    again: list[tuple[int, Any, int]] = []
    exhausted = False
    while not exhausted or again:
        # Spawned, not forked: a fork of a process that has threads may hang.
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(workers, context, initializer=set_threads, initargs=(cpus,)) as pool:
            running: dict[Future[Any], tuple[int, Any, int]] = {}
            try:
                while True:
                    while len(running) < _AHEAD * workers and (again or not exhausted):
                        if again:
                            index, condition, tried = again.pop()
                        else:
                            following = next(conditions, None)
                            if following is None:
                                exhausted = True
                                continue
                            (index, condition), tried = following, 0
                        task = (index, condition, tried)
                        try:
                            running[pool.submit(function, condition)] = task
                        except BrokenProcessPool:
                            again.append(task)
                            raise
                    if not running:
                        break
                    for done in wait(running, return_when=FIRST_COMPLETED).done:
                        index = running[done][0]
                        result = done.result()
                        del running[done]
                        yield index, result
            except BrokenProcessPool:
                # Which of them a worker died of is not told: all that were running are tried again.
                again += [_once_more(task, retries) for task in running.values()]
            except BaseException:
                pool.shutdown(wait=True, cancel_futures=True)
                raise


def _by_ray(
    function: Callable[[Any], Any], conditions: Iterator[tuple[int, Any]], workers: int | None, cpus: int, retries: int
) -> Iterator[tuple[int, Any]]:
    try:
        import ray
    except ImportError as error:
        raise MissingPackageError("engine 'ray' needs Ray, which is not installed: pip install ray") from error
    if not ray.is_initialized():
        ray.init(log_to_driver=False)
    workers = workers or max(1, int(ray.cluster_resources().get("CPU", 1)) // cpus)
    task = ray.remote(num_cpus=cpus, max_retries=retries)(_with_threads)
    shared = ray.put(function)
    running: dict[Any, int] = {}
    exhausted = False
    try:
        while running or not exhausted:
            while not exhausted and len(running) < _AHEAD * workers:
                following = next(conditions, None)
                if following is None:
                    exhausted = True
                else:
                    index, condition = following
                    running[task.remote(shared, cpus, condition)] = index
            if not running:
                break
            (done,), _ = ray.wait(list(running), num_returns=1)
            index = running.pop(done)
            try:
                result = ray.get(done)
            except ray.exceptions.RayTaskError as error:
                raise error.cause if isinstance(error.cause, Exception) else error from None
            except ray.exceptions.WorkerCrashedError as error:
                raise _died(index, retries + 1) from error
            yield index, result
    finally:
        for reference in running:
            ray.cancel(reference, force=True)


def _with_threads(function: Callable[[Any], Any], cpus: int, condition: Any) -> Any:
    set_threads(cpus)
    return function(condition)


def _once_more(task: tuple[int, Any, int], retries: int) -> tuple[int, Any, int]:
    index, condition, tried = task
    if tried >= retries:
        raise _died(index, tried + 1)
    return index, condition, tried + 1


def _died(index: int, times: int) -> SweepError:
    return SweepError(
        f"condition {index}: the worker that had it died {times} times; expected a function that ends: it may need more memory"
    )

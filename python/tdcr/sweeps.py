"""Sweeps: one function over many conditions, on the cores of one machine or of a Ray cluster."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection, wait
from typing import Any, Literal, TypeVar

import cloudpickle

from tdcr._arrays import Progress, as_choice, as_count, as_progress
from tdcr._threads import processors, set_threads
from tdcr._worker import Worker
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
        function: Of one condition. Both it and the conditions are sent to other processes: they are of modules that can be
            imported there, or of the script or notebook itself, with the variables that they use.
        conditions: Any number; they are drawn as workers need them.
        engine: ``"processes"`` of this machine, or tasks of ``"ray"``: of the cluster that Ray is connected to, or of one that
            it starts here. Ray is an optional dependency: ``pip install ".[ray]"``.
        workers: Number of conditions at a time; as many as there are processors for that this process may run on, where it is
            not given.
        cpus: Processors that each call uses.
        retries: How often a condition is tried again after the worker that had it died.
        progress: Is called with the number of conditions done since its last call, as ``tqdm(total=...).update``.

    Raises:
        SweepError: If a condition's worker died once more than ``retries`` allows; the message says how.
        InputError: For a function or a condition that cannot be sent to another process.
        Exception: Whatever ``function`` raised first; conditions that have not begun are dropped.
    """
    cpus = as_count(cpus, "cpus", 1, 1024)
    retries = as_count(retries, "retries", 0, 1000)
    if workers is not None:
        workers = as_count(workers, "workers", 1, 100_000)
    engines = {"processes": _by_processes, "ray": _by_ray}
    as_choice(engine, "engine", tuple(engines))
    if isinstance(conditions, str) or not isinstance(conditions, Iterable):
        raise InputError(f"conditions is {conditions!r}; expected what has them one after another")
    progress = as_progress(progress)
    if not callable(function):
        raise InputError(f"function is {function!r}; expected one that is called with a condition")
    results: dict[int, Result] = {}
    with closing(engines[engine](function, iter(enumerate(conditions)), workers, cpus, retries)) as found:
        for index, result in found:
            results[index] = result
            if progress is not None:
                progress(1)
    return [results[index] for index in range(len(results))]


@dataclass(frozen=True)
class _Task:
    """A condition, and how often it was tried."""

    index: int
    condition: bytes
    tried: int = 0


def _by_processes(
    function: Callable[[Any], Any], conditions: Iterator[tuple[int, Any]], workers: int | None, cpus: int, retries: int
) -> Generator[tuple[int, Any], None, None]:
    most = workers or max(1, processors() // cpus)
    setup = _to_bytes((function, cpus), "the function")
    tasks = (_Task(index, _to_bytes(condition, f"condition {index}")) for index, condition in conditions)
    again: list[_Task] = []
    idle: list[Worker] = []
    busy: dict[Connection, tuple[Worker, _Task]] = {}
    try:
        while True:
            # Something to do for each worker that has nothing; a new worker where there is more.
            while idle or len(busy) < most:
                task = again.pop() if again else next(tasks, None)
                if task is None:
                    break
                worker = idle.pop() if idle else Worker(setup)
                busy[worker.connection] = worker, task
                worker.send(task.condition)
            if not busy:
                return
            for ready in wait(list(busy)):
                worker, task = busy[ready]  # type: ignore[index]
                try:
                    done, result, where = worker.receive()
                except EOFError:
                    del busy[worker.connection]
                    again.append(_once_more(task, retries, worker.end()))
                    continue
                if not done:
                    result.add_note(f"Condition {task.index}, in a worker:\n\n{where}")
                    raise result
                del busy[worker.connection]
                idle.append(worker)
                yield task.index, result
    finally:
        for worker in [*idle, *(worker for worker, _ in busy.values())]:
            worker.stop()


def _to_bytes(value: Any, name: str) -> bytes:
    """A value as it is sent to a worker: what the main module defines with it."""
    try:
        sent: bytes = cloudpickle.dumps(value)
        return sent
    except Exception as error:
        raise InputError(f"{name} cannot be sent to another process: {type(error).__name__}: {error}") from error


def _by_ray(
    function: Callable[[Any], Any], conditions: Iterator[tuple[int, Any]], workers: int | None, cpus: int, retries: int
) -> Generator[tuple[int, Any], None, None]:
    try:
        import ray
    except ImportError as error:
        raise MissingPackageError("engine 'ray' needs Ray, which is not installed: pip install ray") from error
    if not ray.is_initialized():
        _connect(ray)
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
                raise _died(index, retries + 1, f"crashed: {error}") from error
            yield index, result
    finally:
        for reference in running:
            ray.cancel(reference, force=True)


def _connect(ray: Any) -> None:
    """Connects to the cluster that is running, or starts one on the processors that this process may run on."""
    if "RAY_ADDRESS" not in os.environ:
        try:
            ray.init("auto", log_to_driver=False)
        except ConnectionError:
            ray.init(num_cpus=processors(), log_to_driver=False)
        return
    ray.init(log_to_driver=False)


def _with_threads(function: Callable[[Any], Any], cpus: int, condition: Any) -> Any:
    set_threads(cpus)
    return function(condition)


def _once_more(task: _Task, retries: int, how: str) -> _Task:
    if task.tried >= retries:
        raise _died(task.index, task.tried + 1, how)
    return replace(task, tried=task.tried + 1)


def _died(index: int, times: int, how: str) -> SweepError:
    return SweepError(f"condition {index}: the worker that had it died {times} times; the last one {how}")

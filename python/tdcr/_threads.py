"""Threads that this process computes with."""

from __future__ import annotations

from tdcr import _tdcr
from tdcr._arrays import as_count


def set_threads(count: int) -> None:
    """Sets the number of threads that this process computes with, from 1 to 1024."""
    _tdcr.set_threads(as_count(count, "count", 1, 1024))


def threads() -> int:
    """Number of threads that this process computes with; where it was not set, of the processors that it may run on."""
    return _tdcr.threads()


def processors() -> int:
    """Number of processors that this process may run on: of its affinity, and of its share in its control group (cgroup)."""
    return _tdcr.processors()

"""What `torch.compile` is told of this package. To import the compiler takes seconds: this is imported where it is there already,
and nowhere else."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch


@torch.compiler.disable  # type: ignore[untyped-decorator]
def outside(function: Callable[..., Any], *arguments: Any) -> Any:
    """What the function returns, called outside the graph."""
    return function(*arguments)


@torch.compiler.assume_constant_result  # type: ignore[untyped-decorator]
def constant(function: Callable[..., Any], *arguments: Any) -> Any:
    """What the function returns, called once, where the graph is traced."""
    return function(*arguments)

"""Functions with a tangent and an adjoint as functions of PyTorch: both modes of differentiation, and ``vmap``.

The adjoint is linear in the cotangents, and its own adjoint is the tangent, and the other way; by the arguments they have no
derivatives, which would be second ones.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.autograd import Function

from tdcr._differentiable import SECOND
from tdcr.errors import SensitivityError

Tensors = Sequence[Tensor]


@dataclass(frozen=True, eq=False)
class Differentiable:
    """A function of tensors that share their leading axes, at some options.

    Attributes:
        name: What errors call it.
        value: From the arguments to the results.
        adjoint: From the cotangents of the results, the arguments, and which derivatives are wanted, to those by the arguments.
        tangent: From the changes of the arguments, and the arguments, to the changes of the results.
    """

    name: str
    value: Callable[[Tensors], Tensors]
    adjoint: Callable[[Tensors, Tensors, Sequence[bool]], Tensors]
    tangent: Callable[[Tensors, Tensors], Tensors]

    def __call__(self, *arguments: Tensor) -> tuple[Tensor, ...]:
        """The results."""
        results: tuple[Tensor, ...]
        if "torch._dynamo" in sys.modules:
            # Where there is a compiler, it would look into what is called here.
            from tdcr.torch import _traced

            results = _traced.outside(_Value.apply, self, *arguments)
        else:
            results = _Value.apply(self, *arguments)
        return results

    def refuse_second(self) -> SensitivityError:
        """What is raised where a derivative is to be differentiated."""
        return SensitivityError(SECOND.format(self.name))


class _Value(Function):
    """The function."""

    @staticmethod
    def forward(of: Differentiable, *arguments: Tensor) -> tuple[Tensor, ...]:
        return tuple(of.value(arguments))

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Any) -> None:
        ctx.of, *arguments = inputs
        ctx.results = [(result.shape, result.dtype) for result in output]
        ctx.save_for_backward(*arguments)
        ctx.save_for_forward(*arguments)
        ctx.set_materialize_grads(False)

    @staticmethod
    def backward(ctx: Any, *cotangents: Tensor | None) -> tuple[Tensor | None, ...]:
        arguments = ctx.saved_tensors
        wanted = tuple(bool(want) for want in ctx.needs_input_grad[1:])
        filled = _filled(cotangents, ctx.results, arguments)
        gradients = _Adjoint.apply(ctx.of, wanted, *filled, *arguments)
        return None, *(gradient if want else None for gradient, want in zip(gradients, wanted, strict=True))

    @staticmethod
    def jvp(ctx: Any, _: None, *changes: Tensor | None) -> tuple[Tensor, ...]:
        arguments = ctx.saved_tensors
        filled = _filled(changes, [(a.shape, a.dtype) for a in arguments], arguments)
        results: tuple[Tensor, ...] = _Tangent.apply(ctx.of, *filled, *arguments)
        return results

    @staticmethod
    def vmap(info: Any, in_dims: tuple[Any, ...], of: Differentiable, *arguments: Tensor) -> tuple[Any, Any]:
        results = _Value.apply(of, *_in_front(info, in_dims[1:], arguments))
        return results, (0,) * len(results)


class _Adjoint(Function):
    """Its adjoint: from cotangents and arguments to the derivatives by the arguments."""

    @staticmethod
    def forward(of: Differentiable, wanted: tuple[bool, ...], *inputs: Tensor) -> tuple[Tensor, ...]:
        cotangents, arguments = inputs[: -len(wanted)], inputs[-len(wanted) :]
        return tuple(of.adjoint(cotangents, arguments, wanted))

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Any) -> None:
        ctx.of, ctx.wanted, *tensors = inputs
        ctx.save_for_backward(*tensors)
        ctx.save_for_forward(*tensors)
        ctx.set_materialize_grads(False)

    @staticmethod
    def backward(ctx: Any, *changes: Tensor | None) -> tuple[Tensor | None, ...]:
        count = len(ctx.wanted)
        arguments = ctx.saved_tensors[-count:]
        if any(ctx.needs_input_grad[-count:]):
            raise ctx.of.refuse_second()
        filled = _filled(changes, [(a.shape, a.dtype) for a in arguments], arguments)
        return None, None, *_Tangent.apply(ctx.of, *filled, *arguments), *(None for _ in arguments)

    @staticmethod
    def jvp(ctx: Any, _: None, __: None, *changes: Tensor | None) -> tuple[Tensor, ...]:
        count = len(ctx.wanted)
        if any(change is not None for change in changes[-count:]):
            raise ctx.of.refuse_second()
        cotangents, arguments = ctx.saved_tensors[:-count], ctx.saved_tensors[-count:]
        filled = _filled(changes[:-count], [(c.shape, c.dtype) for c in cotangents], arguments)
        results: tuple[Tensor, ...] = _Adjoint.apply(ctx.of, ctx.wanted, *filled, *arguments)
        return results

    @staticmethod
    def vmap(
        info: Any, in_dims: tuple[Any, ...], of: Differentiable, wanted: tuple[bool, ...], *inputs: Tensor
    ) -> tuple[Any, Any]:
        results = _Adjoint.apply(of, wanted, *_in_front(info, in_dims[2:], inputs))
        return results, (0,) * len(results)


class _Tangent(Function):
    """Its tangent: from changes of the arguments, and the arguments, to the changes of the results."""

    @staticmethod
    def forward(of: Differentiable, *inputs: Tensor) -> tuple[Tensor, ...]:
        count = len(inputs) // 2
        return tuple(of.tangent(inputs[:count], inputs[count:]))

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Any) -> None:
        ctx.of, *tensors = inputs
        ctx.results = [(result.shape, result.dtype) for result in output]
        ctx.save_for_backward(*tensors)
        ctx.save_for_forward(*tensors)
        ctx.set_materialize_grads(False)

    @staticmethod
    def backward(ctx: Any, *cotangents: Tensor | None) -> tuple[Tensor | None, ...]:
        count = len(ctx.saved_tensors) // 2
        arguments = ctx.saved_tensors[count:]
        if any(ctx.needs_input_grad[1 + count :]):
            raise ctx.of.refuse_second()
        wanted = tuple(bool(want) for want in ctx.needs_input_grad[1 : 1 + count])
        filled = _filled(cotangents, ctx.results, arguments)
        return None, *_Adjoint.apply(ctx.of, wanted, *filled, *arguments), *(None for _ in arguments)

    @staticmethod
    def jvp(ctx: Any, _: None, *changes: Tensor | None) -> tuple[Tensor, ...]:
        count = len(ctx.saved_tensors) // 2
        if any(change is not None for change in changes[count:]):
            raise ctx.of.refuse_second()
        arguments = ctx.saved_tensors[count:]
        filled = _filled(changes[:count], [(a.shape, a.dtype) for a in arguments], arguments)
        results: tuple[Tensor, ...] = _Tangent.apply(ctx.of, *filled, *arguments)
        return results

    @staticmethod
    def vmap(info: Any, in_dims: tuple[Any, ...], of: Differentiable, *inputs: Tensor) -> tuple[Any, Any]:
        results = _Tangent.apply(of, *_in_front(info, in_dims[1:], inputs))
        return results, (0,) * len(results)


def _filled(changes: Sequence[Tensor | None], like: Sequence[tuple[torch.Size, torch.dtype]], arguments: Tensors) -> list[Tensor]:
    """Changes, zeros where there are none."""
    return [
        arguments[0].new_zeros(shape, dtype=dtype) if change is None else change
        for change, (shape, dtype) in zip(changes, like, strict=True)
    ]


def _in_front(info: Any, in_dims: Sequence[int | None], tensors: Tensors) -> list[Tensor]:
    """Tensors with the mapped axis as their first one, which those that lack it get."""
    return [
        tensor.expand(info.batch_size, *tensor.shape) if dim is None else tensor.movedim(dim, 0)
        for tensor, dim in zip(tensors, in_dims, strict=True)
    ]

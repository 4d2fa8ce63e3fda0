"""Functions on the host as linear maps of JAX: a tangent and an adjoint that are each other's transpose."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import ShapedArray
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

from tdcr._differentiable import SECOND
from tdcr.errors import SensitivityError

Arrays = Sequence[Any]


@dataclass(frozen=True)
class OnHost:
    """A function on the host of arrays that share their leading axes, at some options.

    Attributes:
        name: What errors call it.
        options: What its functions take besides arrays, first.
        value: From options and arguments to the results.
        adjoint: From options, cotangents of the results and arguments to the derivatives by the arguments.
        tangent: From options, changes of the arguments and arguments to the changes of the results.
        shapes: From the shapes of the arguments to those of the results.
    """

    name: str
    options: Hashable
    value: Callable[[Any, Arrays], Arrays]
    adjoint: Callable[[Any, Arrays, Arrays], Arrays]
    tangent: Callable[[Any, Arrays, Arrays], Arrays]
    shapes: Callable[[Sequence[tuple[int, ...]]], Sequence[tuple[int, ...]]]

    def results(self, arguments: Arrays) -> list[jax.ShapeDtypeStruct]:
        """Shapes and types of the results: all are of the first argument's type."""
        shapes = self.shapes([argument.shape for argument in arguments])
        return [jax.ShapeDtypeStruct(shape, arguments[0].dtype) for shape in shapes]


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def call(of: OnHost, *arguments: Any) -> Any:
    """The results of a function on the host, which has derivatives in both modes, under ``jit`` and ``vmap``."""
    return _callback(partial(of.value, of.options), of.results(arguments), arguments)


@call.defjvp
def _(of: OnHost, arguments: Arrays, changes: Arrays) -> tuple[Any, Any]:
    results = call(of, *arguments)
    return results, tuple(_TANGENT.bind(*changes, *arguments, of=of))


def _callback(function: Callable[..., Arrays], results: Arrays, *groups: Arrays) -> Any:
    """Groups of arrays handed to a function on the host."""
    ends = np.cumsum([len(group) for group in groups])[:-1].tolist()

    def on_host(*arrays: Any) -> tuple[Any, ...]:
        bounds = [0, *ends, len(arrays)]
        # Whatever the type: NumPy does not know those of 16 bits for numbers.
        wide = [np.asarray(array).astype(np.float64) for array in arrays]
        found = function(*(wide[start:end] for start, end in pairwise(bounds)))
        return tuple(np.asarray(array, dtype=result.dtype) for array, result in zip(found, results, strict=True))

    arrays = [array for group in groups for array in group]
    return jax.pure_callback(on_host, tuple(results), *arrays, vmap_method="broadcast_all")


def _tangent(*inputs: Any, of: OnHost) -> Any:
    changes, arguments = _halves(inputs)
    return _callback(partial(of.tangent, of.options), of.results(arguments), changes, arguments)


def _adjoint(*inputs: Any, of: OnHost, count: int) -> Any:
    cotangents, arguments = inputs[:count], inputs[count:]
    gradients = [jax.ShapeDtypeStruct(a.shape, a.dtype) for a in arguments]
    return _callback(partial(of.adjoint, of.options), gradients, cotangents, arguments)


def _halves(inputs: Arrays) -> tuple[Arrays, Arrays]:
    return inputs[: len(inputs) // 2], inputs[len(inputs) // 2 :]


_TANGENT, _ADJOINT = Primitive("tdcr_tangent"), Primitive("tdcr_adjoint")


def _register(primitive: Primitive, function: Callable[..., Any], linear: Callable[..., int]) -> None:
    """Gives a primitive what ``jit``, ``vmap`` and ``jvp`` ask for; the first ``linear`` of its inputs are those that it is
    linear in."""
    primitive.multiple_results = True
    primitive.def_impl(function)

    def abstract(*inputs: Any, **options: Any) -> list[Any]:
        shapes = jax.eval_shape(partial(function, **options), *(jax.ShapeDtypeStruct(i.shape, i.dtype) for i in inputs))
        return [ShapedArray(shape.shape, shape.dtype) for shape in shapes]

    def batch(inputs: Arrays, dims: Sequence[Any], **options: Any) -> tuple[Any, Any]:
        size = next(i.shape[d] for i, d in zip(inputs, dims, strict=True) if d is not None)
        fronts = [
            jnp.broadcast_to(i, (size, *i.shape)) if d is None else jnp.moveaxis(i, d, 0)
            for i, d in zip(inputs, dims, strict=True)
        ]
        results = primitive.bind(*fronts, **options)
        return results, (0,) * len(results)

    def differentiate(inputs: Arrays, changes: Arrays, **options: Any) -> tuple[Any, Any]:
        count = linear(inputs, **options)
        if any(not isinstance(change, ad.Zero) for change in changes[count:]):
            raise SensitivityError(SECOND.format(options["of"].name))
        moved = [ad.instantiate_zeros(change) for change in changes[:count]]
        return primitive.bind(*inputs, **options), primitive.bind(*moved, *inputs[count:], **options)

    primitive.def_abstract_eval(abstract)
    batching.primitive_batchers[primitive] = batch
    ad.primitive_jvps[primitive] = differentiate
    mlir.register_lowering(primitive, mlir.lower_fun(function, multiple_results=True))


def _transposed_tangent(cotangents: Arrays, *inputs: Any, of: OnHost) -> list[Any]:
    changes, arguments = _halves(inputs)
    filled = [ad.instantiate_zeros(cotangent) for cotangent in cotangents]
    gradients = _ADJOINT.bind(*filled, *arguments, of=of, count=len(filled))
    wanted = [g if ad.is_undefined_primal(c) else None for g, c in zip(gradients, changes, strict=True)]
    return [*wanted, *(None for _ in arguments)]


def _transposed_adjoint(changes: Arrays, *inputs: Any, of: OnHost, count: int) -> list[Any]:
    cotangents, arguments = inputs[:count], inputs[count:]
    filled = [ad.instantiate_zeros(change) for change in changes]
    results = _TANGENT.bind(*filled, *arguments, of=of)
    wanted = [r if ad.is_undefined_primal(c) else None for r, c in zip(results, cotangents, strict=True)]
    return [*wanted, *(None for _ in arguments)]


_register(_TANGENT, _tangent, lambda inputs, of: len(inputs) // 2)
_register(_ADJOINT, _adjoint, lambda inputs, of, count: count)
ad.primitive_transposes[_TANGENT] = _transposed_tangent
ad.primitive_transposes[_ADJOINT] = _transposed_adjoint

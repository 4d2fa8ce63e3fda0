"""Gradients of motions in PyTorch and JAX, against their own checkers."""

from __future__ import annotations

import numpy as np
import pytest

import tdcr
from tdcr.errors import DynamicsError

torch = pytest.importorskip("torch")
from tdcr.torch import functions  # noqa: E402

ROBOT = tdcr.Robot("2m")
NAMES = ["gain[0]", "density[1]", "damping[0]"]
SCALES = np.array([ROBOT.value(name) for name in NAMES])


def arrays() -> tuple[np.ndarray, ...]:
    """Two motions of three commands: commands, start, loads, and values of parameters as shares of their own."""
    rng = np.random.default_rng(1)
    settled = tdcr.settle_batch(ROBOT, ROBOT.random_commands(2, seed=8))
    wrench = rng.normal(scale=1e-3, size=(2, 10, 6)) * [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]
    velocity = rng.normal(scale=0.1, size=(2, 10, 3))
    commands = rng.uniform(0.005, 0.03, size=(2, 3, 6))
    return commands, settled.configuration, velocity, np.array([0.01, 0.02]), wrench, np.ones(3)


def weights(width: int) -> np.ndarray:
    return np.linspace(-1.0, 1.0, 10 * width).reshape(10, width)


def cost(*arguments: torch.Tensor) -> torch.Tensor:
    *inputs, shares = arguments
    values = shares * torch.from_numpy(SCALES)
    settings = {"parameters": NAMES, "values": values, "frame_skip": 2}
    positions, quaternions, rates = functions.rollout(ROBOT, *inputs, **settings)
    w, turns = (torch.from_numpy(weights(width)) for width in (3, 4))
    return (positions * w + 1e-3 * rates * w).sum((-3, -2, -1)) + 0.1 * (quaternions * turns).sum((-3, -2, -1))


def tensors() -> tuple[torch.Tensor, ...]:
    return tuple(torch.tensor(array, requires_grad=True) for array in arrays())


def test_gradients_are_those_of_finite_differences_in_a_batch_and_singly() -> None:
    inputs = tensors()
    assert torch.autograd.gradcheck(cost, inputs, eps=1e-6, atol=1e-5, rtol=1e-4, fast_mode=True)
    one = tuple(t.detach()[0].requires_grad_() if k < 5 else t for k, t in enumerate(inputs))
    assert torch.autograd.gradcheck(cost, one, eps=1e-6, atol=1e-5, rtol=1e-4, fast_mode=True)
    batch = torch.autograd.grad(cost(*inputs).sum(), inputs[:5])
    alone = torch.autograd.grad(cost(*one), one[:5])
    assert all(torch.equal(b[0], a) for b, a in zip(batch, alone, strict=True))


def test_the_operator_keeps_the_contracts_of_custom_operators_and_compiles() -> None:
    inputs = tensors()
    values = (inputs[-1] * torch.from_numpy(SCALES)).detach().requires_grad_()
    arguments = (*(t.detach().requires_grad_() for t in inputs[:-1]), values)
    arguments = (*arguments, ROBOT.to_json(), ",".join(NAMES), 0.002, 1, "raise")
    assert set(torch.library.opcheck(functions._rollout, arguments).values()) == {"SUCCESS"}
    compiled = torch.compile(cost, backend="aot_eager", fullgraph=True)
    expected = torch.autograd.grad(cost(*inputs).sum(), inputs)
    found = torch.autograd.grad(compiled(*inputs).sum(), inputs)
    assert all(torch.allclose(f, e, rtol=1e-12) for f, e in zip(found, expected, strict=True))


def test_a_motion_that_diverges_is_an_error_or_no_number() -> None:
    commands, configuration, velocity, *_ = tensors()
    fast = velocity.detach().clone()
    fast[1] = 1e4
    with pytest.raises(DynamicsError, match="row 1: step 0, .*the motion diverged"):
        functions.rollout(ROBOT, commands, configuration, fast)
    positions, _, _ = functions.rollout(ROBOT, commands, configuration, fast, on_failure="nan")
    assert positions[0].isfinite().all() and positions[1].isnan().all()
    (gradient,) = torch.autograd.grad(positions[0].sum(), commands)
    assert gradient[0].any() and not gradient[1].any()


def test_jax_has_the_same_gradients_under_jit_and_vmap() -> None:
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    from jax.test_util import check_grads

    import tdcr.jax

    def of_row(*arguments: object) -> object:
        *inputs, shares = arguments
        states = tdcr.jax.rollout(ROBOT, *inputs, parameters=NAMES, values=shares * SCALES, frame_skip=2)
        positions, quaternions, rates = states
        w, turns = weights(3), weights(4)
        return (positions * w + 1e-3 * rates * w).sum() + 0.1 * (quaternions * turns).sum()

    inputs = arrays()
    batched = jax.jit(jax.vmap(of_row, in_axes=(0, 0, 0, 0, 0, None)))
    assert np.allclose(batched(*inputs), cost(*tensors()).detach().numpy(), rtol=1e-12)
    check_grads(batched, inputs, order=1, modes=["rev"], eps=1e-6, atol=1e-5, rtol=1e-4)
    found = jax.jit(jax.grad(lambda *a: batched(*a).sum(), argnums=tuple(range(6))))(*inputs)
    leaves = tensors()
    expected = torch.autograd.grad(cost(*leaves).sum(), leaves)
    assert all(np.allclose(f, e, rtol=1e-10, atol=1e-14) for f, e in zip(found, expected, strict=True))

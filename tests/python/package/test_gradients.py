"""Gradients of equilibria in PyTorch and JAX, against their own checkers."""

from __future__ import annotations

import numpy as np
import pytest

import tdcr
from tdcr.errors import InputError, NotSettledError

torch = pytest.importorskip("torch")
from tdcr.torch import functions  # noqa: E402

ROBOT = tdcr.Robot("2m")
COMMANDS = [[0.034, 0.007, 0.001, 0.026, 0.015, 0.019], [0.01, 0.03, 0.02, 0.005, 0.03, 0.012]]
NAMES = ["gain[0]", "density[1]", "hole_radius[3]"]
SCALES = np.array([ROBOT.value(name) for name in NAMES])


def tensors() -> tuple[torch.Tensor, ...]:
    """Commands, payloads, wrenches, and values of parameters as shares of their own."""
    rng = np.random.default_rng(1)
    wrench = np.zeros((2, 10, 6))
    wrench[:, :, :3] = rng.normal(scale=1e-3, size=(2, 10, 3))
    arrays = np.array(COMMANDS), np.array([0.01, 0.02]), wrench, np.ones(3)
    return tuple(torch.tensor(array, requires_grad=True) for array in arrays)


def cost(command: torch.Tensor, payload: torch.Tensor, wrench: torch.Tensor, shares: torch.Tensor) -> torch.Tensor:
    values = shares * torch.from_numpy(SCALES)
    positions, quaternions = functions.settle(ROBOT, command, payload, wrench, parameters=NAMES, values=values)
    weights = torch.linspace(-1.0, 1.0, 30, dtype=torch.float64).reshape(10, 3)
    turns = torch.linspace(-1.0, 1.0, 40, dtype=torch.float64).reshape(10, 4)
    return (positions * weights).sum(dim=(-2, -1)) + 0.1 * (quaternions * turns).sum(dim=(-2, -1))


def test_gradients_are_those_of_finite_differences_in_a_batch_and_singly() -> None:
    inputs = tensors()
    assert torch.autograd.gradcheck(cost, inputs, eps=1e-6, atol=1e-5, rtol=1e-4, fast_mode=True)
    one = tuple(t.detach()[0].requires_grad_() if k < 3 else t for k, t in enumerate(inputs))
    assert torch.autograd.gradcheck(cost, one, eps=1e-6, atol=1e-5, rtol=1e-4, fast_mode=True)
    # Each row has the gradient that it has alone.
    batch = torch.autograd.grad(cost(*inputs).sum(), inputs[:3])
    alone = torch.autograd.grad(cost(*one), one[:3])
    assert all(torch.equal(b[0], a) for b, a in zip(batch, alone, strict=True))


def test_rows_may_have_values_of_their_own() -> None:
    command, payload, wrench, shares = tensors()
    rows = shares.detach().expand(2, 3).clone().requires_grad_()
    (by_rows,) = torch.autograd.grad(cost(command, payload, wrench, rows).sum(), rows)
    (by_shared,) = torch.autograd.grad(cost(command, payload, wrench, shares).sum(), shares)
    assert torch.allclose(by_rows.sum(dim=0), by_shared, rtol=1e-12)


def test_the_operator_keeps_the_contracts_of_custom_operators() -> None:
    command, payload, wrench, shares = (tensor.detach().clone().requires_grad_() for tensor in tensors())
    values = (shares * torch.from_numpy(SCALES)).detach().requires_grad_()
    arguments = (command, payload, wrench, values, ROBOT.to_json(), ",".join(NAMES), "raise")
    assert set(torch.library.opcheck(functions._settle, arguments).values()) == {"SUCCESS"}


def test_the_operator_is_kept_whole_by_compile() -> None:
    inputs = tensors()
    compiled = torch.compile(cost, backend="aot_eager", fullgraph=True)
    expected = torch.autograd.grad(cost(*inputs).sum(), inputs)
    found = torch.autograd.grad(compiled(*inputs).sum(), inputs)
    assert all(torch.allclose(f, e, rtol=1e-12) for f, e in zip(found, expected, strict=True))


def test_gradients_descend_to_a_target() -> None:
    target = torch.tensor(tdcr.settle(ROBOT, COMMANDS[1]).tip)
    command = torch.tensor(COMMANDS[0], dtype=torch.float32, requires_grad=True)
    optimiser = torch.optim.Adam([command], lr=5e-4)
    low, high = torch.tensor(ROBOT.command_ranges, dtype=torch.float32).T

    def distance() -> torch.Tensor:
        positions, _ = functions.settle(ROBOT, command.clamp(low, high))
        return (positions[-1] - target).norm()

    first = distance().item()
    for _ in range(150):
        optimiser.zero_grad()
        distance().backward()
        optimiser.step()
    assert distance().item() < 0.05 * first


def test_rows_that_do_not_settle_can_be_masked() -> None:
    command = torch.tensor(COMMANDS, dtype=torch.float64, requires_grad=True)
    wrench = torch.zeros(2, 10, 6, dtype=torch.float64)
    wrench[1, 9, 3] = 10.0
    with pytest.raises(NotSettledError, match="row 1: the robot has not settled"):
        functions.settle(ROBOT, command, 0.0, wrench)
    positions, _ = functions.settle(ROBOT, command, 0.0, wrench, on_failure="nan")
    assert positions[0].isfinite().all() and positions[1].isnan().all()
    (gradient,) = torch.autograd.grad(positions[0].sum(), command)
    assert gradient[0].any() and not gradient[1].any()


def test_what_does_not_fit_is_refused() -> None:
    command = torch.tensor(COMMANDS)
    with pytest.raises(InputError, match=r"values has shape None; expected \(1,\)"):
        functions.settle(ROBOT, command, parameters=["gain[0]"])
    with pytest.raises(InputError, match="command is on meta; expected a tensor in the processor's memory"):
        functions.settle(ROBOT, command.to("meta"))
    with pytest.raises(InputError, match=r"command has shape \(2, 5\); expected \(2, 6\)"):
        functions.settle(ROBOT, command[:, :5])


def test_jax_has_the_same_gradients_under_jit_and_vmap() -> None:
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    from jax.test_util import check_grads

    import tdcr.jax

    def of_row(command: object, payload: object, wrench: object, shares: object) -> object:
        settled = tdcr.jax.settle(ROBOT, command, payload, wrench, parameters=NAMES, values=shares * SCALES)
        positions, quaternions = settled
        weights = np.linspace(-1.0, 1.0, 30).reshape(10, 3)
        turns = np.linspace(-1.0, 1.0, 40).reshape(10, 4)
        return (positions * weights).sum((-2, -1)) + 0.1 * (quaternions * turns).sum((-2, -1))

    inputs = tensors()
    arrays = tuple(tensor.detach().numpy() for tensor in inputs)
    check_grads(of_row, arrays, order=1, modes=["rev"], eps=1e-6, atol=1e-5, rtol=1e-4)
    batched = jax.jit(jax.vmap(of_row, in_axes=(0, 0, 0, None)))
    assert np.allclose(batched(*arrays), cost(*inputs).detach().numpy(), rtol=1e-12)
    check_grads(batched, arrays, order=1, modes=["rev"], eps=1e-6, atol=1e-5, rtol=1e-4)
    gradient = jax.jit(jax.grad(lambda *a: batched(*a).sum(), argnums=(0, 1, 2, 3)))(*arrays)
    expected = torch.autograd.grad(cost(*inputs).sum(), inputs)
    assert all(np.allclose(g, e, rtol=1e-10, atol=1e-14) for g, e in zip(gradient, expected, strict=True))

"""Gradients of equilibria in PyTorch and JAX, against their own checkers."""

from __future__ import annotations

import numpy as np
import pytest

import tdcr
from tdcr.errors import InputError, NotSettledError, SensitivityError

torch = pytest.importorskip("torch")
from torch.autograd import forward_ad  # noqa: E402
from torch.func import grad, hessian, jacfwd, jacrev, jvp, linearize, vjp, vmap  # noqa: E402

from tdcr.torch import functions, operators  # noqa: E402

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
    assert torch.autograd.gradcheck(cost, inputs, eps=1e-6, atol=1e-5, rtol=1e-4, fast_mode=True, check_forward_ad=True)
    one = tuple(t.detach()[0].requires_grad_() if k < 3 else t for k, t in enumerate(inputs))
    assert torch.autograd.gradcheck(cost, one, eps=1e-6, atol=1e-5, rtol=1e-4, fast_mode=True, check_forward_ad=True)
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
    values = (shares * torch.from_numpy(SCALES)).detach().expand(2, 3).clone().requires_grad_()
    poses = torch.zeros(2, 0, 7, dtype=torch.float64)
    base = torch.zeros(2, 0, 7, dtype=torch.float64)
    line = torch.full((2, 3), 0.1, dtype=torch.float64, requires_grad=True)
    arguments = (command, payload, wrench, values, poses, base, line, ROBOT.to_json(), ",".join(NAMES), "raise")
    assert set(torch.library.opcheck(operators._settle, arguments).values()) == {"SUCCESS"}
    changes = tuple(argument.detach() for argument in arguments[:7])
    forward = (*changes, *changes, *arguments[7:9])
    assert set(torch.library.opcheck(operators._settle_forward, forward).values()) == {"SUCCESS"}


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
    with pytest.raises(InputError, match=r"command has shape \(2, 5\); expected \(..., 6\)"):
        functions.settle(ROBOT, command[:, :5])
    with pytest.raises(InputError, match=r"wrench has shape \(9, 6\); expected \(2, 10, 6\), or \(10, 6\) for all rows"):
        functions.settle(ROBOT, command, wrench=torch.zeros(9, 6))
    with pytest.raises(InputError, match="on_failure is 'rasie'; expected 'raise' or 'nan'"):
        functions.settle(ROBOT, command, on_failure="rasie")
    with pytest.raises(InputError, match="command has entries of type torch.complex64; expected real numbers"):
        functions.settle(ROBOT, command.to(torch.complex64))


def tips(command: torch.Tensor) -> torch.Tensor:
    return functions.settle(ROBOT, command, 0.01)[0][..., -1, :]


def test_torch_func_transforms_agree_in_both_modes_and_nested() -> None:
    command, payload, wrench, shares = (tensor.detach() for tensor in tensors())

    def near(found: object, expected: object) -> bool:
        pairs = zip(torch.utils._pytree.tree_leaves(found), torch.utils._pytree.tree_leaves(expected), strict=True)
        return all(torch.allclose(f, e, rtol=1e-9, atol=1e-13) for f, e in pairs)

    expected = torch.as_tensor(tdcr.jacobian(ROBOT, command, payload=0.01))[:, -1, :3]
    assert near(vmap(jacrev(tips))(command), expected) and near(vmap(jacfwd(tips))(command), expected)
    assert near(jacrev(tips)(command[0]), expected[0]) and near(jacfwd(tips)(command[0]), expected[0])
    for strategy in ("forward-mode", "reverse-mode"):
        found = torch.autograd.functional.jacobian(tips, command[0], vectorize=True, strategy=strategy)
        assert near(found, expected[0])
    assert near(vmap(tips)(command), tips(command))
    assert near(vmap(vmap(tips))(command.expand(3, 2, 6)), tips(command).expand(3, 2, 3))
    # By all arguments, some of which are mapped.
    leaves = tensors()
    reverse = torch.autograd.grad(cost(*leaves).sum(), leaves)
    assert near(grad(lambda *a: cost(*a).sum(), (0, 1, 2, 3))(command, payload, wrench, shares), reverse)
    each = vmap(grad(cost, (0, 1, 2, 3)), (0, 0, 0, None))(command, payload, wrench, shares)
    assert near(each[:3], reverse[:3]) and near(each[3].sum(dim=0), reverse[3])
    direction = tuple(torch.randn_like(tensor) for tensor in (command, payload, wrench, shares))
    _, forward = jvp(lambda *a: cost(*a).sum(), (command, payload, wrench, shares), direction)
    assert near(forward, sum((r * d).sum() for r, d in zip(reverse, direction, strict=True)))
    assert near(linearize(tips, command[0])[1](direction[0][0]), expected[0] @ direction[0][0])
    with forward_ad.dual_level():
        dual = forward_ad.unpack_dual(tips(forward_ad.make_dual(command, direction[0])))
    assert near(dual.tangent, (expected @ direction[0][..., None])[..., 0])
    # Products are linear in the weights: their derivative by them is the product itself.
    _, pull = vjp(tips, command)
    weights = torch.randn(2, 3, dtype=torch.float64)
    _, moved = jvp(lambda w: pull(w)[0], (weights,), (weights,))
    assert near(moved, pull(weights)[0])


def test_second_derivatives_are_refused_by_name_and_not_zero() -> None:
    command = torch.tensor(COMMANDS[0], dtype=torch.float64, requires_grad=True)

    def height(command: torch.Tensor) -> torch.Tensor:
        return tips(command)[2]

    (gradient,) = torch.autograd.grad(height(command), command, create_graph=True)
    for ask in (
        lambda: torch.autograd.grad(gradient.sum(), command),
        lambda: hessian(height)(command.detach()),
        lambda: jacrev(jacfwd(height))(command.detach()),
        lambda: jacfwd(jacfwd(height))(command.detach()),
        lambda: grad(lambda c: grad(height)(c).sum())(command.detach()),
    ):
        with pytest.raises(SensitivityError, match="second derivatives of tdcr.torch.settle are asked for"):
            ask()


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float32, torch.float64], ids=str)
def test_results_and_gradients_have_the_type_of_their_arguments(dtype: torch.dtype) -> None:
    command = torch.tensor(COMMANDS, dtype=dtype, requires_grad=True)
    found = tips(command)
    (gradient,) = torch.autograd.grad(found.sum(), command)
    assert found.dtype == gradient.dtype == dtype
    expected = tdcr.settle_batch(ROBOT, command.detach().double(), 0.01).tips
    rounded = {torch.float16: 1e-3, torch.bfloat16: 1e-2, torch.float32: 1e-6, torch.float64: 1e-15}[dtype]
    assert torch.allclose(found.detach().double(), torch.tensor(expected), rtol=rounded, atol=rounded)


def test_whole_numbers_count_as_floating_point_ones() -> None:
    pull = tdcr.Robot(ROBOT.to_dict() | {"modules": [tension_driven(module) for module in ROBOT.to_dict()["modules"]]})
    newtons = torch.tensor([2, 0, 1, 0, 1, 0])
    positions, quaternions = functions.settle(pull, newtons, payload=0, wrench=torch.zeros(10, 6, dtype=torch.int64))
    expected = tdcr.settle(pull, newtons.numpy())
    assert positions.dtype == quaternions.dtype == torch.get_default_dtype()
    assert np.allclose(positions, expected.positions, atol=1e-6) and np.ptp(expected.positions[:, 0]) > 1e-3
    values = torch.tensor([600])
    scaled, _ = functions.settle(ROBOT, torch.tensor(COMMANDS), parameters=["gain[0]"], values=values)
    assert np.allclose(scaled, tdcr.settle_batch(ROBOT.with_values({"gain[0]": 600}), COMMANDS).positions, atol=1e-6)


def tension_driven(module: dict[str, object]) -> dict[str, object]:
    return module | {"backbone": {"bending": [0.5, 0.5], "torsion": 0.5}, "tendons": {"drive": "tension", "range": [0.0, 5.0]}}


def test_forward_mode_under_compile_is_right_or_refused_and_never_zero() -> None:
    command = torch.tensor(COMMANDS[0], dtype=torch.float64)
    direction = torch.ones_like(command)
    expected = jvp(tips, (command,), (direction,))[1]
    outside = jvp(torch.compile(tips, backend="aot_eager"), (command,), (direction,))[1]
    assert torch.allclose(outside, expected, rtol=1e-12)
    torch._dynamo.reset()
    inside = torch.compile(lambda c: jvp(tips, (c,), (direction,))[1], backend="aot_eager")
    try:
        assert torch.allclose(inside(command), expected, rtol=1e-12)
    except RuntimeError as refusal:
        assert "forward mode is asked for inside `torch.compile`" in str(refusal)
    finally:
        # A trace that fails leaves its level open.
        while forward_ad._current_level >= 0:
            forward_ad.exit_dual_level()


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
    check_grads(of_row, arrays, order=1, modes=["rev", "fwd"], eps=1e-6, atol=1e-5, rtol=1e-4)
    batched = jax.jit(jax.vmap(of_row, in_axes=(0, 0, 0, None)))
    assert np.allclose(batched(*arrays), cost(*inputs).detach().numpy(), rtol=1e-12)
    check_grads(batched, arrays, order=1, modes=["rev", "fwd"], eps=1e-6, atol=1e-5, rtol=1e-4)
    gradient = jax.jit(jax.grad(lambda *a: batched(*a).sum(), argnums=(0, 1, 2, 3)))(*arrays)
    expected = torch.autograd.grad(cost(*inputs).sum(), inputs)
    assert all(np.allclose(g, e, rtol=1e-10, atol=1e-14) for g, e in zip(gradient, expected, strict=True))


def test_jax_has_both_modes_and_refuses_second_derivatives() -> None:
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    import tdcr.jax

    def tips(command: object) -> object:
        return tdcr.jax.settle(ROBOT, command, 0.01)[0][..., -1, :]

    commands = np.array(COMMANDS)
    expected = tdcr.jacobian(ROBOT, commands, payload=0.01)[:, -1, :3]
    for transform in (jax.jacfwd, jax.jacrev):
        assert np.allclose(jax.vmap(transform(tips))(commands), expected, rtol=1e-9, atol=1e-13)
        assert np.allclose(jax.jit(transform(tips))(commands[0]), expected[0], rtol=1e-9, atol=1e-13)
    _, moved = jax.jvp(tips, (commands,), (np.ones((2, 6)),))
    assert np.allclose(moved, expected.sum(axis=-1), rtol=1e-9)
    _, linear = jax.linearize(tips, commands[0])
    assert np.allclose(linear(np.ones(6)), expected[0].sum(axis=-1), rtol=1e-9)
    for ask in (jax.hessian(lambda c: tips(c)[2]), jax.jacfwd(jax.jacfwd(tips)), jax.jacrev(jax.jacrev(tips))):
        with pytest.raises(SensitivityError, match="second derivatives of tdcr.jax.settle are asked for"):
            ask(commands[0])
    with pytest.raises(InputError, match="on_failure is 'rasie'; expected 'raise' or 'nan'"):
        tdcr.jax.settle(ROBOT, commands, on_failure="rasie")
    narrow = jax.numpy.asarray(commands, jax.numpy.bfloat16)
    assert jax.grad(lambda c: tips(c).sum())(narrow).dtype == tips(narrow).dtype == jax.numpy.bfloat16
    whole = tdcr.jax.settle(ROBOT, np.zeros(6, dtype=np.int64))[0]
    assert np.allclose(whole, tdcr.settle(ROBOT, np.zeros(6)).positions)

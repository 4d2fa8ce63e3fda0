"""Gradients of motions in PyTorch and JAX, against their own checkers."""

from __future__ import annotations

import numpy as np
import pytest

import tdcr
from tdcr.errors import DynamicsError, InputError, SensitivityError

torch = pytest.importorskip("torch")
from torch.func import grad, jacfwd, jacrev, jvp, vmap  # noqa: E402

from tdcr.torch import functions, operators  # noqa: E402

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
    assert torch.autograd.gradcheck(cost, inputs, eps=1e-6, atol=1e-5, rtol=1e-4, fast_mode=True, check_forward_ad=True)
    one = tuple(t.detach()[0].requires_grad_() if k < 5 else t for k, t in enumerate(inputs))
    assert torch.autograd.gradcheck(cost, one, eps=1e-6, atol=1e-5, rtol=1e-4, fast_mode=True, check_forward_ad=True)
    batch = torch.autograd.grad(cost(*inputs).sum(), inputs[:5])
    alone = torch.autograd.grad(cost(*one), one[:5])
    assert all(torch.equal(b[0], a) for b, a in zip(batch, alone, strict=True))


def rough() -> tdcr.Robot:
    """The robot with tendons that have friction in their holes."""
    modules = ROBOT.to_dict()["modules"]
    friction = {"coefficient": 0.1, "contact_stiffness": 20000.0}
    modules = [module | {"tendons": module["tendons"] | {"friction": friction}} for module in modules]
    return tdcr.Robot(ROBOT.to_dict() | {"modules": modules})


def test_motions_with_friction_of_tendons_have_gradients_by_its_coefficients_too() -> None:
    robot = rough()
    names = ["friction[0]", "gain[1]", "friction[4]"]
    scales = torch.tensor([robot.value(name) for name in names])

    def of(commands: torch.Tensor, shares: torch.Tensor) -> torch.Tensor:
        start = [torch.from_numpy(array) for array in arrays()[1:3]]
        positions, _, _ = functions.rollout(robot, commands, *start, parameters=names, values=shares * scales, frame_skip=20)
        return (positions * torch.from_numpy(weights(3))).sum((-3, -2, -1))

    commands = torch.tensor(arrays()[0], requires_grad=True)
    shares = torch.ones(3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(of, (commands, shares), eps=1e-7, atol=1e-6, rtol=1e-4, check_forward_ad=True)
    by_commands, by_shares = torch.autograd.grad(of(commands, shares).sum(), (commands, shares))
    assert (by_shares.abs() > 1e-6).all() and (by_commands.abs() > 1e-6).any()


def test_the_operator_keeps_the_contracts_of_custom_operators_and_compiles() -> None:
    inputs = tensors()
    values = (inputs[-1] * torch.from_numpy(SCALES)).detach().expand(2, 3).clone().requires_grad_()
    poses = torch.zeros(2, 0, 7, dtype=torch.float64)
    arguments = (*(t.detach().requires_grad_() for t in inputs[:-1]), values, poses, poses.clone())
    arguments = (*arguments, torch.full((2, 3), 0.1, dtype=torch.float64, requires_grad=True))
    arguments = (*arguments, ROBOT.to_json(), ",".join(NAMES), 0.002, 1, "raise", "")
    assert set(torch.library.opcheck(operators._rollout, arguments).values()) == {"SUCCESS"}
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


def test_torch_func_transforms_agree_in_both_modes() -> None:
    inputs = tuple(tensor.detach() for tensor in tensors())
    leaves = tensors()
    reverse = torch.autograd.grad(cost(*leaves).sum(), leaves)
    each = vmap(grad(cost, tuple(range(6))), (0, 0, 0, 0, 0, None))(*inputs)
    assert all(torch.allclose(e, r, rtol=1e-9, atol=1e-13) for e, r in zip(each[:5], reverse[:5], strict=True))
    assert torch.allclose(each[5].sum(dim=0), reverse[5], rtol=1e-9)
    direction = tuple(torch.randn_like(tensor) for tensor in inputs)
    _, forward = jvp(lambda *a: cost(*a).sum(), inputs, direction)
    expected = sum((r * d).sum() for r, d in zip(reverse, direction, strict=True))
    assert torch.allclose(forward, expected, rtol=1e-8)

    def tip(command: torch.Tensor) -> torch.Tensor:
        commands = command.expand(2, 6)
        return functions.rollout(ROBOT, commands, inputs[1][0], frame_skip=2)[0][-1, -1]

    command = inputs[0][0, 0]
    forward, backward = jacfwd(tip)(command), jacrev(tip)(command)
    assert forward.any() and torch.allclose(forward, backward, rtol=1e-8, atol=1e-15)
    for strategy in ("forward-mode", "reverse-mode"):
        found = torch.autograd.functional.jacobian(tip, command, vectorize=True, strategy=strategy)
        assert torch.allclose(found, backward, rtol=1e-8, atol=1e-15)
    with pytest.raises(SensitivityError, match="second derivatives of tdcr.torch.rollout are asked for"):
        jacfwd(jacrev(tip))(inputs[0][0, 0])
    with pytest.raises(InputError, match="on_failure is 'rasie'; expected 'raise' or 'nan'"):
        functions.rollout(ROBOT, *inputs[:2], on_failure="rasie")


def test_forward_mode_is_that_of_differences_and_of_reverse_mode() -> None:
    commands, configuration, velocity, payload, wrench, _ = arrays()
    rng = np.random.default_rng(4)
    rates = tdcr.RolloutRates(*(rng.normal(size=a.shape) for a in (commands, configuration, velocity, payload, wrench)), None)
    rates = rates._replace(parameters=rng.normal(size=(2, 3)) * SCALES)
    options = {"parameters": NAMES, "wrench": wrench, "start": tdcr.State(configuration, velocity), "frame_skip": 2}
    found = tdcr.rollout_jvp(ROBOT, commands, rates, payload, **options)
    weights = [rng.normal(size=(2, 3, 10, width)) for width in (3, 4, 3)]
    forward = sum((w * f).sum() for w, f in zip(weights, (found.positions, found.quaternions, found.velocity), strict=True))
    back = tdcr.rollout_vjp(ROBOT, commands, *weights, payload, **options)
    parts = (back.commands, back.configuration, back.velocity, back.payload, back.wrench, back.parameters)
    assert forward == pytest.approx(sum((g * r).sum() for g, r in zip(parts, rates[:6], strict=True)), rel=1e-8)
    # What is not given does not change, and a row that diverges is not a number.
    alone = tdcr.rollout_jvp(ROBOT, commands, tdcr.RolloutRates(payload=np.zeros(2)), payload, start=options["start"])
    assert not alone.positions.any() and alone.failures == {}
    fast = tdcr.State(configuration, velocity + np.array([0.0, 1e4]).reshape(2, 1, 1))
    lost = tdcr.rollout_jvp(ROBOT, commands, tdcr.RolloutRates(payload=np.ones(2)), payload, start=fast)
    assert list(lost.failures) == [1] and np.isnan(lost.positions[1]).all() and np.isfinite(lost.positions[0]).all()
    with pytest.raises(InputError, match=r"rates.payload has shape \(3,\); expected \(2,\)"):
        tdcr.rollout_jvp(ROBOT, commands, tdcr.RolloutRates(payload=np.ones(3)), payload)


def test_derivatives_by_where_hinges_start_are_differences_along_their_angles() -> None:
    """A quaternion of a joint of hinges may only change along them; axes at an angle, so that a basis is not its dual."""
    hinges = [{"axis": axis, "stiffness": 0.1} for axis in ([1.0, 0.0, 0.0], [0.6, 0.8, 0.0])]
    fields = ROBOT.to_dict()
    robot = tdcr.Robot(fields | {"modules": [module | {"joint": {"hinges": hinges}} for module in fields["modules"]]})
    rng = np.random.default_rng(6)
    angles = rng.uniform(-0.1, 0.1, size=(10, 2))
    commands = rng.uniform(0.01, 0.03, size=(1, 3, 6))

    def turned(axis: list[float], angle: np.ndarray) -> np.ndarray:
        return np.concatenate([np.cos(angle / 2)[:, None], np.sin(angle / 2)[:, None] * axis], axis=1)

    def start(angles: np.ndarray) -> np.ndarray:
        (w, *a), (v, *b) = (turned(hinges[k]["axis"], angles[:, k]).T for k in (0, 1))
        first, second = np.array(a).T, np.array(b).T
        vector = w[:, None] * second + v[:, None] * first + np.cross(first, second)
        return np.concatenate([(w * v - (first * second).sum(axis=1))[:, None], vector], axis=1)

    weights = [rng.normal(size=(1, 3, 10, width)) for width in (3, 4)]

    def cost(angles: np.ndarray) -> float:
        moved = tdcr.rollout(robot, commands, start=tdcr.State(start(angles)), dt=0.001)
        assert moved.failures == {}
        return sum((w * s).sum() for w, s in zip(weights, (moved.positions, moved.quaternions), strict=True))

    direction, size = rng.normal(size=(10, 2)), 1e-5
    slope = (start(angles + size * direction) - start(angles - size * direction)) / (2.0 * size)
    expected = (cost(angles + size * direction) - cost(angles - size * direction)) / (2.0 * size)
    at = tdcr.State(start(angles))
    back = tdcr.rollout_vjp(robot, commands, *weights, start=at, dt=0.001)
    assert (back.configuration[0] * slope).sum() == pytest.approx(expected, rel=1e-6)
    ahead = tdcr.rollout_jvp(robot, commands, tdcr.RolloutRates(configuration=slope[None]), start=at, dt=0.001)
    found = sum((w * s).sum() for w, s in zip(weights, (ahead.positions, ahead.quaternions), strict=True))
    assert found == pytest.approx(expected, rel=1e-6)


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
    check_grads(batched, inputs, order=1, modes=["rev", "fwd"], eps=1e-6, atol=1e-5, rtol=1e-4)
    found = jax.jit(jax.grad(lambda *a: batched(*a).sum(), argnums=tuple(range(6))))(*inputs)
    leaves = tensors()
    expected = torch.autograd.grad(cost(*leaves).sum(), leaves)
    assert all(np.allclose(f, e, rtol=1e-10, atol=1e-14) for f, e in zip(found, expected, strict=True))

"""Loads along the backbone as inputs of PyTorch and JAX."""

from __future__ import annotations

import numpy as np
import pytest

import tdcr
from tdcr.errors import InputError

torch = pytest.importorskip("torch")

from tdcr.torch import functions  # noqa: E402

ROBOT = tdcr.Robot("2m")
COMMANDS = np.array([[0.034, 0.007, 0.001, 0.026, 0.015, 0.019], [0.01, 0.03, 0.02, 0.005, 0.03, 0.012]])
LINES = np.array([[0.3, -0.2, 0.4], [0.1, 0.2, -0.3]])
NAMES = ["pitch[0]", "gain[1]"]
SCALES = np.array([ROBOT.value(name) for name in NAMES])
POST = tdcr.Scene([tdcr.Obstacle.cylinder("post", 0.01, 0.4, position=(-0.06, 0.0, 0.25), compliance=1e-4)])
STEPS = 5


def padded(force: object) -> object:
    """Wrenches of forces without moments, which robots among obstacles do not take."""
    if isinstance(force, torch.Tensor):
        return torch.nn.functional.pad(force, (0, 3))
    import jax.numpy as jnp

    return jnp.concatenate([force, jnp.zeros_like(force)], axis=-1)


def tip(line: object, force: object, shares: object, settle: object = functions.settle, scene: object = None) -> object:
    values = shares * (torch.from_numpy(SCALES) if isinstance(shares, torch.Tensor) else SCALES)  # type: ignore[operator]
    command = torch.from_numpy(COMMANDS) if isinstance(shares, torch.Tensor) else COMMANDS
    positions, quaternions = settle(  # type: ignore[operator]
        ROBOT, command, wrench=padded(force), line=line, parameters=NAMES, values=values, scene=scene
    )
    return positions[:, -1].sum(-1) + 0.1 * quaternions[:, -1, 1]


def moved(line: object, force: object, shares: object, rollout: object = functions.rollout, scene: object = None) -> object:
    values = shares * (torch.from_numpy(SCALES) if isinstance(shares, torch.Tensor) else SCALES)  # type: ignore[operator]
    start = tdcr.settle_batch(ROBOT, COMMANDS, scene=scene).configuration  # type: ignore[arg-type]
    given = [np.repeat(COMMANDS[:, None], STEPS, axis=1), start]
    if isinstance(shares, torch.Tensor):
        given = [torch.from_numpy(array) for array in given]
    positions, _, rates = rollout(  # type: ignore[operator]
        ROBOT, *given, wrench=padded(force), line=line, parameters=NAMES, values=values, scene=scene
    )
    return 100.0 * positions[:, :, -1].sum((-2, -1)) + rates[:, -1].sum((-2, -1))


def inputs(per_command: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    shape = (2, STEPS, 10, 3) if per_command else (2, 10, 3)
    force = np.random.default_rng(1).normal(scale=1e-2, size=shape)
    return LINES.copy(), force, np.ones(len(NAMES))


def tensors(per_command: bool = False) -> tuple[torch.Tensor, ...]:
    return tuple(torch.tensor(array, requires_grad=True) for array in inputs(per_command))


def test_equilibria_and_motions_are_those_of_loads() -> None:
    loads = [tdcr.Loads(line=tuple(row)) for row in LINES]
    settled = tdcr.settle_batch(ROBOT, COMMANDS, loads=loads)
    positions, quaternions = functions.settle(ROBOT, torch.from_numpy(COMMANDS), line=torch.from_numpy(LINES))
    assert np.array_equal(positions, settled.positions) and np.array_equal(quaternions, settled.quaternions)
    commands = np.repeat(COMMANDS[:, None], STEPS, axis=1)
    expected = tdcr.rollout(ROBOT, commands, loads=loads, start=tdcr.State(settled.configuration, np.zeros((2, 10, 3))))
    places, _, _ = functions.rollout(
        ROBOT, torch.from_numpy(commands), torch.from_numpy(settled.configuration), line=torch.from_numpy(LINES)
    )
    assert np.array_equal(places, expected.positions)


@pytest.mark.parametrize("scene", [None, POST])
def test_gradients_of_equilibria_are_those_of_finite_differences(scene: tdcr.Scene | None) -> None:
    given = tensors()
    assert torch.autograd.gradcheck(
        lambda *a: tip(*a, scene=scene), given, eps=1e-6, atol=1e-5, rtol=1e-4, fast_mode=True, check_forward_ad=True
    )
    alone = (given[0], given[1].detach(), given[2].detach())
    assert torch.autograd.gradcheck(lambda *a: tip(*a, scene=scene), alone, eps=1e-6, atol=1e-6, rtol=1e-5, check_forward_ad=True)


@pytest.mark.parametrize("per_command", [False, True])
@pytest.mark.parametrize("scene", [None, POST])
def test_gradients_of_motions_are_those_of_finite_differences(per_command: bool, scene: tdcr.Scene | None) -> None:
    given = tensors(per_command)
    assert torch.autograd.gradcheck(
        lambda *a: moved(*a, scene=scene), given, eps=1e-6, atol=1e-5, rtol=1e-4, fast_mode=True, check_forward_ad=True
    )


def test_rows_have_the_gradients_that_they_have_alone_and_one_line_is_for_all() -> None:
    command = torch.from_numpy(COMMANDS)
    line = torch.tensor(LINES[0], requires_grad=True)
    (both,) = torch.autograd.grad(functions.settle(ROBOT, command, line=line)[0].sum(), line)
    rows = [torch.autograd.grad(functions.settle(ROBOT, row, line=line)[0].sum(), line)[0] for row in command]
    assert torch.allclose(both, rows[0] + rows[1], rtol=1e-12)
    with pytest.raises(InputError, match=r"line has shape \(2,\); expected \(2, 3\), or \(3,\) for all rows"):
        functions.settle(ROBOT, command, line=torch.zeros(2))


def test_torch_compile_keeps_them() -> None:
    line = torch.tensor(LINES, requires_grad=True)
    command = torch.from_numpy(COMMANDS)

    def height(line: torch.Tensor) -> torch.Tensor:
        return functions.settle(ROBOT, command, line=line)[0][:, -1, 2].sum()

    compiled = torch.compile(height, backend="aot_eager", fullgraph=True)
    (found,) = torch.autograd.grad(compiled(line), line)
    (expected,) = torch.autograd.grad(height(line), line)
    assert torch.equal(found, expected)


def test_jax_has_the_same() -> None:
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    from jax.test_util import check_grads

    import tdcr.jax

    for of, function in ((tip, tdcr.jax.settle), (moved, tdcr.jax.rollout)):
        check_grads(lambda *a: of(*a, function), inputs(), order=1, modes=["rev", "fwd"], eps=1e-6, atol=1e-5, rtol=1e-4)  # noqa: B023
        gradient = jax.jit(jax.grad(lambda *a: of(*a, function).sum(), argnums=(0, 1, 2)))(*inputs())  # type: ignore[attr-defined]  # noqa: B023
        given = tensors()
        expected = torch.autograd.grad(of(*given).sum(), given)  # type: ignore[attr-defined]
        assert all(np.allclose(g, e, rtol=1e-9, atol=1e-12) for g, e in zip(gradient, expected, strict=True))

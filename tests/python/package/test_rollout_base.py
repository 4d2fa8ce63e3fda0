"""Motions with the base elsewhere: against robot files with its pose, and differences, alone and at a post."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import tdcr
from tdcr.errors import InputError

torch = pytest.importorskip("torch")
import tdcr.torch  # noqa: E402

ROBOT = tdcr.Robot("2m")
POST = tdcr.Scene([tdcr.Obstacle.cylinder("post", 0.01, 0.4, position=(-0.06, 0, 0.25), friction=0.3, compliance=1e-4)])
LEANING = np.array([0.034, 0.007, 0.001, 0.026, 0.015, 0.019])
PLACES = np.array([[0.002, -0.003, -0.004], [-0.001, 0.001, 0.003]])
TURNS = np.array([[0.999, 0.01, -0.02, 0.03], [1.0, 0.02, 0.01, -0.01]])
WEIGHTS = np.linspace(-1.0, 1.0, 30).reshape(10, 3)
TURNED = np.linspace(1.0, -1.0, 40).reshape(10, 4)


def commands() -> Any:
    rng = np.random.default_rng(4)
    return LEANING + rng.uniform(0.0, 1e-3, size=(2, 3, 6))


def start(scene: tdcr.Scene | None) -> tdcr.State:
    """Two rows that have come to lean on the post, or to swing free."""
    states = []
    for place, turn in zip(PLACES, TURNS, strict=True):
        moving = tdcr.MovingRobot(ROBOT.with_base(place, turn), scene=scene)
        moving.reset([0.02] * 6)
        moving.step(LEANING, frame_skip=150)
        states.append(moving.state)
    return tdcr.State(np.stack([s.configuration for s in states]), np.stack([s.velocity for s in states]))


def of_file(place: Any, turn: Any) -> tdcr.Robot:
    fields = ROBOT.to_dict()
    fields["base"] |= {"position": [*map(float, place)], "orientation": [*map(float, turn / np.linalg.norm(turn))]}
    return tdcr.Robot(fields)


def test_a_motion_by_a_base_is_that_of_a_robot_file_with_its_pose() -> None:
    at = start(POST)
    given = [torch.tensor(array) for array in (commands(), at.configuration, at.velocity)]
    base = {"base_position": torch.tensor(PLACES), "base_quaternion": torch.tensor(3.0 * TURNS)}
    found = tdcr.torch.rollout(ROBOT, *given, scene=POST, frame_skip=2, **base)
    robots = [of_file(place, turn) for place, turn in zip(PLACES, TURNS, strict=True)]
    expected = tdcr.rollout(robots, commands(), start=at, scene=POST, frame_skip=2)
    np.testing.assert_allclose(found[0], expected.positions, atol=1e-12)
    np.testing.assert_allclose(found[2], expected.velocity, atol=1e-9)
    with pytest.raises(InputError, match=r"base_position has shape \(2,\); expected \(2, 3\), or \(3,\) for all rows"):
        tdcr.torch.rollout(ROBOT, *given, base_position=torch.zeros(2))


@pytest.mark.parametrize("scene", [None, POST])
def test_gradients_by_the_base_are_differences_in_both_modes(scene: tdcr.Scene | None) -> None:
    at, wrench = start(scene), np.zeros((10, 6))
    wrench[9] = [0.05, -0.02, 0.03, 0.002, 0.001, -0.001]
    fixed = [torch.tensor(array) for array in (commands(), at.configuration, at.velocity)]

    def cost(place: torch.Tensor, turn: torch.Tensor, *given: torch.Tensor) -> torch.Tensor:
        options = {"wrench": torch.tensor(wrench), "payload": 0.01, "scene": scene, "frame_skip": 2}
        motion = tdcr.torch.rollout(ROBOT, *(given or fixed), base_position=place, base_quaternion=turn, **options)
        positions, quaternions, rates = motion
        w, turned = torch.from_numpy(WEIGHTS), torch.from_numpy(TURNED)
        return (positions * w + 1e-3 * rates * w).sum((-3, -2, -1)) + 0.1 * (quaternions * turned).sum((-3, -2, -1))

    inputs = tuple(torch.tensor(array, requires_grad=True) for array in (PLACES, TURNS))
    assert torch.autograd.gradcheck(cost, inputs, eps=1e-7, atol=1e-5, rtol=1e-4, check_forward_ad=True)
    found = torch.autograd.grad(cost(*inputs).sum(), inputs)
    assert all(gradient.any() for gradient in found)
    detached = tuple(tensor.detach() for tensor in inputs)
    each = torch.func.vmap(torch.func.grad(cost, (0, 1)))(*detached, *fixed)
    assert all(torch.allclose(e, f, rtol=1e-9, atol=1e-12) for e, f in zip(each, found, strict=True))
    compiled = torch.autograd.grad(torch.compile(cost, backend="aot_eager", fullgraph=True)(*inputs).sum(), inputs)
    assert all(torch.allclose(c, f, rtol=1e-12) for c, f in zip(compiled, found, strict=True))


def test_rates_of_the_base_are_what_its_gradient_is_the_adjoint_of() -> None:
    at = start(POST)
    robots = [of_file(place, turn) for place, turn in zip(PLACES, TURNS, strict=True)]
    options = {"start": at, "scene": POST, "frame_skip": 2}
    by, direction = np.ones((2, 3, 10, 3)) * WEIGHTS, np.random.default_rng(5).normal(size=(2, 6))
    gradient = tdcr.rollout_vjp(robots, commands(), by, **options)
    assert gradient.base.shape == (2, 6) and np.array_equal(gradient[1:].base, gradient.base[1:])
    change = tdcr.rollout_jvp(robots, commands(), tdcr.RolloutRates(base=direction), **options)
    np.testing.assert_allclose((change.positions * by).sum((1, 2, 3)), (gradient.base * direction).sum(1), rtol=1e-9)
    with pytest.raises(InputError, match=r"rates.base has shape \(6,\); expected \(2, 6\)"):
        tdcr.rollout_jvp(robots, commands(), tdcr.RolloutRates(base=direction[0]), **options)


def test_jax_has_them_too() -> None:
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    from jax.test_util import check_grads

    import tdcr.jax

    at = start(POST)
    fixed = commands(), at.configuration, at.velocity

    def cost(place: object, turn: object, *given: object) -> object:
        options = {"scene": POST, "base_position": place, "base_quaternion": turn}
        positions, quaternions, rates = tdcr.jax.rollout(ROBOT, *given, frame_skip=2, **options)
        return ((positions + 1e-3 * rates) * WEIGHTS).sum() + 0.1 * (quaternions * TURNED).sum()

    rows = jax.jit(jax.vmap(cost))
    check_grads(lambda *a: rows(*a, *fixed), (PLACES, TURNS), order=1, modes=["rev", "fwd"], eps=1e-7, atol=1e-5, rtol=1e-4)

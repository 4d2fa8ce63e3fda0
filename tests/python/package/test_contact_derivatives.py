"""Derivatives of equilibria in scenes: against differences, in PyTorch and JAX too."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from ball_chain import (
    BALL,
    BALLS,
    COMMAND,
    COMPLIANCE,
    GAIN,
    PAYLOAD,
    SCENE,
    WALL,
)

import tdcr
from tdcr import Scene
from tdcr.errors import InputError


def poses(robot: tdcr.Robot, command: Any, payload: float, scene: Scene) -> Any:
    found = tdcr.settle(robot, command, payload, scene=scene).check()
    return found.positions, found.quaternions


def difference(of: Any, step: float) -> Any:
    """Change of positions and rotation vectors, shape (n, 6), by a central difference of ``of(step)``."""
    (up, q_up), (down, q_down) = of(step), of(-step)
    w, v = q_down[:, :1], -q_down[:, 1:]
    vector = q_up[:, :1] * v + w * q_up[:, 1:] + np.cross(q_up[:, 1:], v)
    sign = np.sign((q_up * q_down).sum(axis=1, keepdims=True))
    return np.hstack([up - down, 2 * sign * vector]) / (2 * step)


def close(ours: Any, differences: Any, tolerance: float = 1e-4) -> None:
    np.testing.assert_allclose(ours, differences, atol=tolerance * (1e-9 + np.abs(differences).max()))


def test_derivatives_by_command_loads_and_parameters_are_those_of_differences() -> None:
    names = ["command[0]", "command[2]", "payload", "force[2].y", "gain[1]"]
    jacobian = tdcr.jacobian(BALLS, COMMAND, names, PAYLOAD, scene=SCENE)
    assert jacobian.shape == (4, 6, 5)

    def pushed(step: float) -> Any:
        wrench = np.zeros((4, 6))
        wrench[2, 1] = step
        found = tdcr.settle(BALLS, COMMAND, PAYLOAD, wrench=wrench, scene=SCENE).check()
        return found.positions, found.quaternions

    close(jacobian[..., 0], difference(lambda h: poses(BALLS, COMMAND + h * np.eye(3)[0], PAYLOAD, SCENE), 1e-7))
    close(jacobian[..., 1], difference(lambda h: poses(BALLS, COMMAND + h * np.eye(3)[2], PAYLOAD, SCENE), 1e-7))
    close(jacobian[..., 2], difference(lambda h: poses(BALLS, COMMAND, PAYLOAD + h, SCENE), 1e-5))
    close(jacobian[..., 3], difference(pushed, 1e-4))
    with_gain = lambda h: BALLS.with_values({"gain[1]": GAIN + h})  # noqa: E731
    close(jacobian[..., 4], difference(lambda h: poses(with_gain(h), COMMAND, PAYLOAD, SCENE), 0.05))
    # Both modes are the same linear map.
    rng = np.random.default_rng(0)
    rates, by_positions, by_quaternions = rng.normal(size=(1, 5)), rng.normal(size=(1, 4, 3)), rng.normal(size=(1, 4, 4))
    change = tdcr.jvp(BALLS, [COMMAND], names, rates, PAYLOAD, scene=SCENE)
    np.testing.assert_allclose(change[0][0], jacobian[:, :3] @ rates[0], rtol=1e-9, atol=1e-12)
    gradient = tdcr.vjp(BALLS, [COMMAND], names, by_positions, by_quaternions, PAYLOAD, scene=SCENE)
    both = (by_positions * change[0]).sum() + (by_quaternions * change[1]).sum()
    assert float((gradient * rates).sum()) == pytest.approx(float(both), rel=1e-9)


def moved_robot(motion: Any) -> tdcr.Robot:
    fields = BALLS.to_dict()
    size = np.linalg.norm(motion[3:])
    axis = motion[3:] / (size if size else 1)
    fields["base"]["position"] = (np.array([0, 0, 0.05]) + motion[:3]).tolist()
    fields["base"]["orientation"] = [np.cos(size / 2), *(np.sin(size / 2) * axis)]
    return tdcr.Robot(fields)


def moved_wall(motion: Any) -> Scene:
    size = np.linalg.norm(motion[3:])
    x, y, z = np.sin(size / 2) * motion[3:] / (size if size else 1)
    left = np.array([[0, -x, -y, -z], [x, 0, -z, y], [y, z, 0, -x], [z, -y, x, 0]]) + np.cos(size / 2) * np.eye(4)
    return SCENE.moved("wall", np.array(WALL.position) + motion[:3], left @ WALL.orientation)


def test_derivatives_by_obstacles_and_base_are_those_of_differences() -> None:
    wall = tdcr.obstacle_jacobian(BALLS, COMMAND, "wall", PAYLOAD, scene=SCENE)
    base = tdcr.base_jacobian(BALLS, [COMMAND], PAYLOAD, scene=SCENE)[0]
    assert wall.shape == (4, 6, 7) and base.shape == (4, 6, 6)
    for column, unit in enumerate(np.eye(6)):
        by_wall = difference(lambda h, unit=unit: poses(BALLS, COMMAND, PAYLOAD, moved_wall(h * unit)), 1e-7)
        assert np.abs(wall[..., column] - by_wall).max() < 1e-4 * np.abs(wall[..., :6]).max()
        by_base = difference(lambda h, unit=unit: poses(moved_robot(h * unit), COMMAND, PAYLOAD, SCENE), 1e-7)
        assert np.abs(base[..., column] - by_base).max() < 1e-4 * np.abs(base).max()

    def softer(step: float) -> Any:
        return poses(BALLS, COMMAND, PAYLOAD, Scene([BALL, replace(WALL, compliance=COMPLIANCE + step)]))

    close(wall[..., 6], difference(softer, 1e-8), 1e-3)
    # The adjoint is the same linear map.
    rng = np.random.default_rng(1)
    by_positions = rng.normal(size=(1, 4, 3))
    found = tdcr.scene_vjp(BALLS, [COMMAND], by_positions, payload=PAYLOAD, scene=SCENE)
    assert len(found) == 1 and found.obstacles.shape == (1, 2, 6) and found.compliance.shape == (1, 2)
    by = by_positions[0]
    np.testing.assert_allclose(found.base[0], np.einsum("nk,nkj->j", by, base[:, :3]), rtol=1e-8, atol=1e-10)
    by_wall = np.einsum("nk,nkj->j", by, wall[:, :3])
    np.testing.assert_allclose([*found.obstacles[0, 1], found.compliance[0, 1]], by_wall, rtol=1e-8, atol=1e-10)
    # What nothing moves with: all together is a motion of the world, but for gravity along z.
    ball = tdcr.obstacle_jacobian(BALLS, COMMAND, 0, PAYLOAD, scene=SCENE)
    together = ball[..., :3] + wall[..., :3] + base[..., :3]
    np.testing.assert_allclose(together[:, :3], np.broadcast_to(np.eye(3), (4, 3, 3)), atol=1e-8)
    # Without obstacles a base that moves takes everything with it.
    free = tdcr.base_jacobian(BALLS, COMMAND, PAYLOAD)
    np.testing.assert_allclose(free[:, :3, :3], np.broadcast_to(np.eye(3), (4, 3, 3)), atol=1e-8)
    turned = difference(lambda h: poses(moved_robot([0, 0, 0, h, 0, 0]), COMMAND, PAYLOAD, Scene()), 1e-6)
    close(free[..., 3], turned)


def test_gradients_flow_in_pytorch_with_contacts_in() -> None:
    torch = pytest.importorskip("torch")
    from tdcr.torch import settle

    weights = torch.linspace(-1.0, 1.0, 12, dtype=torch.float64).reshape(4, 3)

    def cost(command: Any, payload: Any, wrench: Any) -> Any:
        positions, quaternions = settle(BALLS, command, payload, wrench, scene=SCENE)
        return (positions * weights).sum() + 0.1 * quaternions[..., 1].sum()

    wrench = torch.zeros(4, 6, dtype=torch.float64)
    wrench[2, 1] = 1e-3
    command = torch.tensor(COMMAND, requires_grad=True)
    payload = torch.tensor(PAYLOAD, dtype=torch.float64, requires_grad=True)
    fixed = lambda c, p: cost(c, p, wrench)  # noqa: E731
    assert torch.autograd.gradcheck(fixed, (command, payload), eps=1e-6, atol=1e-4, rtol=1e-3, check_forward_ad=True)
    wrench.requires_grad_()
    (by_wrench,) = torch.autograd.grad(cost(command, payload, wrench), wrench)
    assert by_wrench.abs().max() > 0
    free = torch.autograd.grad((settle(BALLS, command, payload)[0] * weights).sum(), command)[0]
    among = torch.autograd.grad((settle(BALLS, command, payload, scene=SCENE)[0] * weights).sum(), command)[0]
    assert not torch.allclose(free, among, rtol=1e-2)
    with pytest.raises(InputError, match="scene is 'wall'; expected a tdcr.Scene; tdcr.Scene.load reads"):
        settle(BALLS, command, scene="wall")


def test_poses_of_obstacles_are_inputs_of_pytorch() -> None:
    torch = pytest.importorskip("torch")
    from tdcr.torch import settle

    commands = torch.tensor(np.stack([COMMAND, COMMAND + 0.002 * np.eye(3)[0]]))
    places = torch.tensor([one.position for one in SCENE], dtype=torch.float64, requires_grad=True)
    # Not of unit length: they are normalised on use.
    turns = (2.0 * torch.tensor([one.orientation for one in SCENE], dtype=torch.float64)).requires_grad_()

    def cost(places: Any, turns: Any) -> Any:
        options = {"scene": SCENE, "obstacle_positions": places, "obstacle_quaternions": turns}
        positions, quaternions = settle(BALLS, commands, PAYLOAD, **options)
        return positions[..., 0].sum() + positions[:, 2, 1].sum() + 0.1 * quaternions[..., 2].sum()

    assert torch.autograd.gradcheck(cost, (places, turns), eps=1e-7, atol=1e-4, rtol=1e-3, check_forward_ad=True)
    same = settle(BALLS, commands, PAYLOAD, scene=SCENE, obstacle_positions=places)[0]
    assert torch.equal(same, settle(BALLS, commands, PAYLOAD, scene=SCENE)[0])
    compiled = torch.compile(cost, backend="aot_eager", fullgraph=True)
    found, expected = (torch.autograd.grad(one(places, turns), (places, turns)) for one in (compiled, cost))
    assert all(torch.allclose(f, e, rtol=1e-12) for f, e in zip(found, expected, strict=True))
    with pytest.raises(InputError, match="poses of obstacles are given without a scene"):
        settle(BALLS, commands, obstacle_positions=places)
    with pytest.raises(InputError, match="obstacle_positions has shape"):
        settle(BALLS, commands, scene=SCENE, obstacle_positions=places[:, :2])


def test_gradients_in_jax_are_rows_of_the_jacobian() -> None:
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    from tdcr.jax import settle

    gradient = jax.grad(lambda command: settle(BALLS, command, PAYLOAD, scene=SCENE)[0][-1, 0])(COMMAND)
    ours = tdcr.jacobian(BALLS, COMMAND, None, PAYLOAD, scene=SCENE)[-1, 0]
    np.testing.assert_allclose(gradient, ours, rtol=1e-7)
    places = np.array([one.position for one in SCENE])
    tip = lambda places: settle(BALLS, COMMAND, PAYLOAD, scene=SCENE, obstacle_positions=places)[0][-1, 0]  # noqa: E731
    by_places = [tdcr.obstacle_jacobian(BALLS, COMMAND, k, PAYLOAD, scene=SCENE)[-1, 0, :3] for k in range(2)]
    np.testing.assert_allclose(jax.grad(tip)(places), by_places, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(jax.jacfwd(tip)(places), by_places, rtol=1e-6, atol=1e-9)

"""Equilibria with the base elsewhere: against robot files, the same thing seen from the base, and differences."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tdcr
from tdcr import Obstacle, Robot, Scene
from tdcr.errors import InputError, RobotError

ROBOT = Robot("2m")
COMMAND = np.array([0.034, 0.007, 0.001, 0.026, 0.015, 0.019])
POST = Obstacle.cylinder("post", 0.01, 0.4, position=(-0.05, 0.0, 0.25), compliance=1e-5)
SCENE = Scene([POST])
PLACE = np.array([0.004, -0.003, -0.01])
TURN = np.array([0.995, 0.01, 0.008, 0.08])
TURN /= np.linalg.norm(TURN)
COMMANDS = np.stack([COMMAND, COMMAND + 0.001 * np.eye(6)[2]])
PLACES = np.stack([PLACE, PLACE + np.array([0.0, 0.0, 0.006])])
TURNS = np.stack([TURN, [1.0, 0.01, 0.0, 0.02]])


def from_file(place: Any, turn: Any) -> Robot:
    """The robot of the file whose base has this pose."""
    fields = ROBOT.to_dict()
    fields["base"] |= {"position": [*map(float, place)], "orientation": [*map(float, turn)]}
    return Robot(fields)


def of_wrench(moment: bool) -> np.ndarray[Any, Any]:
    """Forces on the tip, and moments."""
    wrench = np.zeros((10, 6))
    wrench[-1] = [0.05, -0.02, 0.03, *([0.01, 0.02, -0.01] if moment else [0.0, 0.0, 0.0])]
    return wrench


@pytest.mark.parametrize("scene", [None, SCENE])
def test_a_base_is_that_of_a_robot_file_with_its_pose(scene: Scene | None) -> None:
    wrench = of_wrench(moment=scene is None)
    options: dict[str, Any] = {"payload": 0.01, "wrench": wrench, "scene": scene}
    there = from_file(PLACE, TURN)
    assert ROBOT.with_base(PLACE, TURN) == there and ROBOT.with_base() == ROBOT
    assert there.with_base(position=(0, 0, 0)) == from_file((0, 0, 0), TURN)
    expected = tdcr.settle(there, COMMAND, **options).check()
    found = tdcr.settle(ROBOT, COMMAND, base_position=PLACE, base_quaternion=3 * TURN, **options)
    np.testing.assert_allclose(found.positions, expected.positions, atol=1e-12)
    assert (found.contacts is None) == (scene is None) and (scene is None or len(found.contacts) > 0)
    batch = tdcr.settle_batch(ROBOT, COMMANDS, base_position=PLACES, base_quaternion=TURNS, **options)
    for row, (command, place, turn) in enumerate(zip(COMMANDS, PLACES, TURNS, strict=True)):
        alone = tdcr.settle(from_file(place, turn), command, **options)
        np.testing.assert_allclose(batch[row].positions, alone.positions, atol=1e-12)
    # One pose for all rows, and the other part of the pose as the robot has it.
    same = tdcr.settle_batch(there, COMMANDS, base_position=PLACES[1], **options)
    assert same[1] == tdcr.settle(from_file(PLACES[1], TURN), COMMANDS[1], **options)


def test_a_base_that_moves_is_everything_else_moved_back() -> None:
    turn = Rotation.from_quat(TURN, scalar_first=True)
    found = tdcr.settle(ROBOT, COMMAND, 0.01, scene=SCENE, base_position=PLACE, base_quaternion=TURN).check()
    # Seen from the base: gravity and the obstacle are turned and moved back, the robot's own base is at the origin.
    seen = ROBOT.to_dict()
    own = seen["base"].get("orientation", [1.0, 0.0, 0.0, 0.0])
    seen["base"] |= {"position": [0.0, 0.0, 0.0], "orientation": [1.0, 0.0, 0.0, 0.0]}
    seen["gravity"] = turn.inv().apply(seen["gravity"]).tolist()
    assert own == [1.0, 0.0, 0.0, 0.0]
    post = replace(
        POST,
        position=tuple(turn.inv().apply(np.array(POST.position) - PLACE)),
        orientation=tuple((turn.inv() * Rotation.from_quat(POST.orientation, scalar_first=True)).as_quat(scalar_first=True)),
    )
    expected = tdcr.settle(Robot(seen), COMMAND, 0.01, scene=Scene([post])).check()
    assert len(expected.contacts) == len(found.contacts) > 0
    np.testing.assert_allclose(found.positions, turn.apply(expected.positions) + PLACE, atol=1e-9)
    np.testing.assert_allclose(found.contacts.force, turn.apply(expected.contacts.force), atol=1e-5)
    # Gravity does not turn along: a robot that hangs settles elsewhere than one that stands.
    hanging = tdcr.settle(ROBOT, COMMAND, 0.01, base_quaternion=(0.0, 1.0, 0.0, 0.0)).check()
    standing = tdcr.settle(ROBOT, COMMAND, 0.01).check()
    assert np.abs(hanging.tip * [1, -1, -1] - standing.tip).max() > 1e-3


def test_derivatives_by_the_base_hold_under_moments() -> None:
    wrench = of_wrench(moment=True)
    ours = tdcr.base_jacobian(ROBOT, COMMAND, wrench=wrench)

    def at(motion: Any) -> Any:
        turn = Rotation.from_rotvec(motion[3:]).as_quat(scalar_first=True)
        return tdcr.settle(ROBOT, COMMAND, wrench=wrench, base_position=motion[:3], base_quaternion=turn).check().positions

    for column, unit in enumerate(1e-5 * np.eye(6)):
        np.testing.assert_allclose(ours[:, :3, column], (at(unit) - at(-unit)) / 2e-5, atol=1e-7)
    by = np.random.default_rng(0).normal(size=(1, 10, 3))
    found = tdcr.scene_vjp(ROBOT, [COMMAND], by, wrench=wrench, scene=Scene().with_self_contact(None))
    np.testing.assert_allclose(found.base[0], np.einsum("nk,nkj->j", by[0], ours[:, :3]), rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("scene", [None, SCENE])
def test_the_base_is_an_input_of_pytorch(scene: Scene | None) -> None:
    torch = pytest.importorskip("torch")
    from torch.func import jacfwd, jacrev, vmap

    from tdcr.torch import settle

    commands = torch.tensor(COMMANDS)
    wrench = torch.tensor(of_wrench(moment=scene is None))
    places = torch.tensor(PLACES, requires_grad=True)
    # Not of unit length: they are normalised on use.
    turns = (2.0 * torch.tensor(TURNS)).requires_grad_()
    gain = torch.tensor([480.0], dtype=torch.float64)

    def poses(places: Any, turns: Any, commands: Any = commands) -> Any:
        options = {"parameters": ["gain[0]"], "values": gain, "scene": scene}
        return settle(ROBOT, commands, 0.01, wrench, base_position=places, base_quaternion=turns, **options)

    def cost(places: Any, turns: Any) -> Any:
        positions, quaternions = poses(places, turns)
        return positions[..., 0].sum() + positions[:, 4, 1].sum() + 0.1 * quaternions[..., 2].sum()

    assert torch.autograd.gradcheck(cost, (places, turns), eps=1e-6, atol=1e-5, rtol=1e-4, check_forward_ad=True)
    robot = ROBOT.with_values({"gain[0]": 480.0})
    among = {"scene": scene, "base_position": PLACES, "base_quaternion": TURNS, "wrench": wrench.numpy()}
    expected = tdcr.settle_batch(robot, COMMANDS, 0.01, **among)
    np.testing.assert_allclose(poses(places, turns)[0].detach(), expected.positions, atol=1e-12)

    def tip(place: Any, turn: Any, command: Any) -> Any:
        return poses(place, turn, command)[0][-1]

    rows = places.detach(), turns.detach(), commands
    for argument in (0, 1):
        forward, reverse = (vmap(jac(tip, argnums=argument))(*rows) for jac in (jacfwd, jacrev))
        assert torch.allclose(forward, reverse, rtol=1e-7, atol=1e-9) and forward.any()
    compiled = torch.compile(cost, backend="aot_eager", fullgraph=True)
    found, wanted = (torch.autograd.grad(one(places, turns), (places, turns)) for one in (compiled, cost))
    assert all(torch.allclose(f, e, rtol=1e-12) for f, e in zip(found, wanted, strict=True))
    # The other part of the pose is the robot's own.
    there = from_file((0.001, 0.0, 0.002), TURN)
    same = settle(there, commands, base_position=torch.tensor(PLACE), scene=scene)[0]
    np.testing.assert_allclose(same, tdcr.settle_batch(from_file(PLACE, TURN), COMMANDS, scene=scene).positions, atol=1e-12)


@pytest.mark.parametrize("scene", [None, SCENE])
def test_the_base_is_an_input_of_jax(scene: Scene | None) -> None:
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp
    from jax.test_util import check_grads

    from tdcr.jax import settle

    def tip(place: Any, turn: Any, command: Any = COMMAND) -> Any:
        positions, quaternions = settle(ROBOT, command, 0.01, scene=scene, base_position=place, base_quaternion=turn)
        return jnp.concatenate([positions[-1], 0.1 * quaternions[4]])

    check_grads(tip, (PLACE, 2 * TURN), order=1, modes=("fwd", "rev"), eps=1e-6, atol=1e-5, rtol=1e-4)
    by_rows = jax.jit(jax.vmap(jax.jacrev(tip, argnums=(0, 1))))(PLACES, TURNS, COMMANDS)
    forward = jax.vmap(jax.jacfwd(tip, argnums=(0, 1)))(PLACES, TURNS, COMMANDS)
    for found, expected in zip(by_rows, forward, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9)
    with pytest.raises(InputError, match=r"base_quaternion has shape \(3,\); expected \(2, 4\), or \(4,\) for all rows"):
        settle(ROBOT, COMMANDS, base_quaternion=PLACE)


def test_what_no_base_can_have_is_refused() -> None:
    with pytest.raises(InputError, match=r"base_position has shape \(4,\); expected \(3,\)"):
        tdcr.settle(ROBOT, COMMAND, base_position=TURN)
    with pytest.raises(InputError, match=r"base_position has shape \(3, 3\); expected \(2, 3\)"):
        tdcr.settle_batch(ROBOT, COMMANDS, base_position=np.zeros((3, 3)))
    with pytest.raises(InputError, match="base_quaternion has a quaternion that is 0"):
        tdcr.settle_batch(ROBOT, COMMANDS, base_quaternion=np.zeros((2, 4)))
    with pytest.raises(RobotError, match=r"base\.position"):
        tdcr.settle(ROBOT, COMMAND, base_position=(0.0, 0.0, 1e30))
    with pytest.raises(InputError, match="2 robots, expected 1 or 3"):
        tdcr.settle_batch([ROBOT, ROBOT], COMMANDS[[0, 1, 1]], base_position=PLACE)
    torch = pytest.importorskip("torch")
    from tdcr.torch import settle

    with pytest.raises(InputError, match=r"base_position has shape \(2, 4\); expected \(2, 3\), or \(3,\) for all rows"):
        settle(ROBOT, torch.tensor(COMMANDS), base_position=torch.tensor(TURNS))
    with pytest.raises(InputError, match="base_quaternion has a quaternion that is 0"):
        settle(ROBOT, torch.tensor(COMMANDS), base_quaternion=torch.zeros(4))

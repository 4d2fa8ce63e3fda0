"""Equilibria in scenes: against SciPy's constrained minimum of the energy, differences, and themselves."""

from __future__ import annotations

import copy
import itertools
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

import tdcr
from tdcr import Obstacle, Scene
from tdcr.errors import CommandError, ContactError, InputError, SceneError, SensitivityError

PITCH, RADIUS, GAIN, COMPLIANCE = 0.03, 0.008, 400.0, 1e-6
BENDING = [0.15, 0.2, 0.25]
HOLES = [[0.006, 0.0], [-0.003, 0.0052], [-0.003, -0.0052]]
BALLS = tdcr.Robot(
    {
        "name": "balls",
        "gravity": [0.0, 0.0, -9.81],
        "routing": "base",
        "base": {"position": [0.0, 0.0, 0.05], "holes": HOLES, "hole_height": 0.0},
        "modules": [
            {
                "discs": 4,
                "pitch": PITCH,
                "radius": RADIUS,
                "half_height": RADIUS,  # As tall as wide: its collision geometry is one ball.
                "mass": {"density": 1000.0},
                "holes": HOLES,
                "damping": 0.01,
                "armature": 1e-4,
                "backbone": {"bending": BENDING[:2], "torsion": BENDING[2]},
                "tendons": {"drive": {"gain": GAIN}, "range": [0.0, 0.2]},
            }
        ],
    }
)
COMMAND = np.array([0.08, 0.116, 0.12])
PAYLOAD = 0.02
BALL = Obstacle.sphere("ball", 0.03, position=(0.044, 0.012, 0.125), compliance=COMPLIANCE)
WALL = Obstacle.half_space("wall", position=(0.05, 0.0, 0.0), orientation=(0.7, 0.0, -0.75, 0.05), compliance=COMPLIANCE)
SCENE = Scene([BALL, WALL])

ROBOT = tdcr.Robot("2m")
POSTS = Scene(
    [
        Obstacle.sphere("left", 0.02, position=(-0.06, 0.02, 0.28)),
        Obstacle.sphere("right", 0.03, position=(0.07, -0.01, 0.26)),
        Obstacle.half_space("ceiling", position=(0.0, 0.0, 0.37), orientation=(0.0, 1.0, 0.0, 0.0)),
    ]
)
COMMANDS = ROBOT.random_commands(40, seed=2)


def turn(vector: Any) -> Any:
    """Rotation matrix of a rotation vector, which may be complex."""
    x, y, z = vector
    square = x * x + y * y + z * z
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    if abs(square) < 1e-12:
        return np.eye(3) + cross + cross @ cross / 2
    angle = np.sqrt(square)
    return np.eye(3) + np.sin(angle) / angle * cross + (1 - np.cos(angle)) / square * cross @ cross


def place(turns: Any) -> tuple[list[Any], list[Any]]:
    """Origins and rotations of the base and the discs."""
    origins, rotations = [np.array([0, 0, 0.05])], [np.eye(3)]
    for vector in turns.reshape(4, 3):
        origins.append(origins[-1] + rotations[-1] @ [0, 0, PITCH])
        rotations.append(rotations[-1] @ turn(vector))
    return origins, rotations


def energy(turns: Any) -> Any:
    """Of joints, tendons, weights and payload (J)."""
    origins, rotations = place(turns)
    mass = 1000.0 * np.pi * RADIUS**2 * 2 * RADIUS
    found = sum(mass * 9.81 * origin[2] for origin in origins[1:]) + PAYLOAD * 9.81 * origins[-1][2]
    found = found + (np.array(BENDING) * turns.reshape(4, 3) ** 2).sum() / 2
    for hole, command in zip(HOLES, COMMAND, strict=True):
        points = [origin + rotation @ [*hole, 0] for origin, rotation in zip(origins, rotations, strict=True)]
        pieces = [np.sqrt(((b - a) ** 2).sum()) for a, b in itertools.pairwise(points)]
        found = found + GAIN / 2 * (sum(pieces) - command) ** 2
    return found


def gaps(turns: Any) -> Any:
    """Of each disc from the ball and the wall (m)."""
    w, x, y, z = np.array(WALL.orientation) / np.linalg.norm(WALL.orientation)
    normal = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    found = []
    for origin in place(turns)[0][1:]:
        away = origin - BALL.position
        found += [np.sqrt((away**2).sum()) - 0.03 - RADIUS, normal @ (origin - WALL.position) - RADIUS]
    return np.array(found)


def derivative(function: Any, turns: Any) -> Any:
    """By steps along the imaginary axis, exact to rounding."""
    return np.array([np.imag(function(turns + 1e-30j * unit)) / 1e-30 for unit in np.eye(12)]).T


def test_an_equilibrium_is_the_constrained_minimum_of_the_energy_that_scipy_finds() -> None:
    found = tdcr.settle(BALLS, COMMAND, PAYLOAD, scene=SCENE).check()
    contacts = found.contacts
    assert contacts is not None and set(contacts.obstacle_names) == {"ball", "wall"} and not contacts.weak.any()
    # Minimise over turns and forces f = s / sqrt(C): surfaces give way by C f, which stores C f^2 / 2.
    root = np.sqrt(COMPLIANCE)
    solved = minimize(
        lambda x: energy(x[:12]) + x[12:] @ x[12:] / 2,
        np.zeros(20),
        jac=lambda x: np.concatenate([derivative(energy, x[:12]), x[12:]]),
        constraints={
            "type": "ineq",
            "fun": lambda x: gaps(x[:12]) + root * x[12:],
            "jac": lambda x: np.hstack([derivative(gaps, x[:12]), root * np.eye(8)]),
        },
        method="SLSQP",
        options={"ftol": 1e-16, "maxiter": 1000},
    )
    positions = np.array(place(solved.x[:12])[0][1:])
    assert np.abs(found.positions - positions).max() < 1e-7
    forces = np.zeros((4, 2))
    forces[contacts.disc, contacts.obstacle] = np.linalg.norm(contacts.force, axis=1)
    np.testing.assert_allclose(forces.ravel(), solved.x[12:] / root, atol=1e-3)
    # What is said of contacts is so: the gap of each, its point on the surface, its force along the normal.
    own = gaps(turns_of(found)).reshape(4, 2)[contacts.disc, contacts.obstacle]
    np.testing.assert_allclose(contacts.gap, own, atol=1e-12)
    below = found.positions[contacts.disc] - contacts.normal * (RADIUS + contacts.gap)[:, None]
    np.testing.assert_allclose(contacts.point, below, atol=1e-12)
    strength = (contacts.force * contacts.normal).sum(axis=1)
    np.testing.assert_allclose(contacts.force, contacts.normal * strength[:, None], atol=1e-12)
    np.testing.assert_allclose(-contacts.gap, COMPLIANCE * strength, rtol=1e-3)
    assert contacts.penetration == pytest.approx(-contacts.gap.min(), abs=1e-12) and contacts.complementarity < 1e-8
    assert len(contacts) == len(contacts.disc) and contacts.row is None


def turns_of(found: tdcr.Equilibrium) -> Any:
    """Rotation vectors of a configuration."""
    w, v = found.configuration[:, :1], found.configuration[:, 1:]
    size = np.linalg.norm(v, axis=1, keepdims=True)
    return (2 * np.arctan2(size, w) * v / np.where(size == 0, 1, size)).ravel()


def test_without_obstacles_nothing_is_different() -> None:
    plain, empty = tdcr.settle_batch(ROBOT, COMMANDS), tdcr.settle_batch(ROBOT, COMMANDS, scene=Scene())
    assert plain.contacts is None and empty.contacts is not None and len(empty.contacts) == 0
    for name in plain._by_rows:
        assert np.array_equal(getattr(plain, name), getattr(empty, name)), name
    one, same = tdcr.settle(ROBOT, COMMANDS[0]), tdcr.settle(ROBOT, COMMANDS[0], scene=Scene([]))
    assert one.contacts is None and same.contacts is not None
    assert np.array_equal(one.positions, same.positions)
    jacobian = tdcr.jacobian(ROBOT, COMMANDS[:3])
    np.testing.assert_allclose(tdcr.jacobian(ROBOT, COMMANDS[:3], scene=Scene()), jacobian, rtol=1e-12, atol=1e-12)


def test_rows_are_those_of_single_solves_for_any_number_of_threads() -> None:
    threads = tdcr.threads()
    told: list[int] = []
    try:
        tdcr.set_threads(1)
        rows = tdcr.settle_batch(ROBOT, COMMANDS, scene=POSTS, progress=told.append)
        tdcr.set_threads(3)
        assert tdcr.settle_batch(ROBOT, COMMANDS, scene=POSTS) == rows
    finally:
        tdcr.set_threads(threads)
    assert sum(told) == len(COMMANDS)
    contacts = rows.contacts
    assert contacts is not None and contacts.row is not None and len(contacts) > 10
    assert (np.diff(contacts.row) >= 0).all() and contacts.penetration.shape == (len(COMMANDS),)
    for row, command in enumerate(COMMANDS):
        assert tdcr.settle(ROBOT, command, scene=POSTS) == rows[row]
    some = [7, 3, 3, 0]
    taken = rows[some].contacts
    assert taken is not None
    for place_, row in enumerate(some):
        assert rows[some][place_] == rows[row]
    assert rows[2:2].contacts is not None and len(rows[2:2]) == 0
    assert pickle.loads(pickle.dumps(rows)) == rows


def test_rows_may_have_scenes_of_their_own() -> None:
    scenes = [POSTS.moved("right", (x, -0.01, 0.26)) for x in (0.065, 0.07, 0.08)]
    rows = tdcr.settle_batch(ROBOT, COMMANDS[:3], scene=scenes)
    for row, scene in enumerate(scenes):
        assert rows[row] == tdcr.settle(ROBOT, COMMANDS[row], scene=scene)
    with pytest.raises(InputError, match="there are 2 scenes; expected one, or 3, one for each row"):
        tdcr.settle_batch(ROBOT, COMMANDS[:3], scene=scenes[:2])
    with pytest.raises(InputError, match="the scene of row 1 has obstacles"):
        tdcr.settle_batch(ROBOT, COMMANDS[:2], scene=[POSTS, SCENE])


def test_a_settler_goes_on_from_its_last_equilibrium_and_from_where_it_was_pickled() -> None:
    path = COMMAND + np.linspace(0, 1, 6)[:, None] * [0.004, 0.0, -0.003]
    followed = tdcr.follow(BALLS, path, PAYLOAD, scene=SCENE)
    assert followed.converged.all() and followed.contacts is not None and len(followed.contacts) >= 6
    settler = tdcr.Settler(BALLS, SCENE)
    copied = copy.deepcopy(settler)
    for row, command in enumerate(path):
        assert settler.follow(command, payload=PAYLOAD) == followed[row]
        # A copy goes on from the same configuration, but for rounding.
        found = copied.follow(command, payload=PAYLOAD)
        np.testing.assert_allclose(found.positions, followed[row].positions, atol=1e-9)
        assert found.contacts is not None
        copied = [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))][row % 2](copied)
    np.testing.assert_allclose(settler.settle(path[-1], payload=PAYLOAD).positions, found.positions, atol=1e-8)
    again = settler.settle_from(found.configuration, path[-1], payload=PAYLOAD)
    np.testing.assert_allclose(again.positions, found.positions, atol=1e-8)
    assert again.contacts is not None and settler.scene is SCENE


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


def test_what_is_wrong_is_named(tmp_path: Path) -> None:
    cases: list[tuple[Any, str]] = [
        (
            lambda: Scene([Obstacle.sphere("ball", -1.0)]),
            "obstacle 0 `ball`: field `sphere.radius` is -1; expected a length above 0",
        ),
        (lambda: Scene([BALL, BALL]), "obstacles 0 and 1 are both named `ball`"),
        (lambda: Scene([Obstacle.half_space("floor", mass=1.0)]), "field `mass` is 1; expected none of a half space"),
        (lambda: Scene([Obstacle.sphere("ball", 0.1, compliance=-1e-6)]), "field `compliance`"),
        (lambda: Obstacle.sphere("ball", 0.1, position=(1, 2)), "position of obstacle 'ball' has shape"),
        (lambda: Obstacle.sphere("ball", float("nan")), "radius of obstacle 'ball'"),
        (lambda: Obstacle.sphere("ball", 0.1, colour=(1, 2, 3)), r"obstacle 'ball' is given \['colour'\]; expected position"),
        (lambda: Obstacle.sphere("ball", 0.1, color=(1, 2, 300)), "expected three whole numbers from 0 to 255"),
        (lambda: Obstacle.pipe("pipe", 0.1), "expected one of them"),
        (lambda: Scene("shelf.toml"), "`Scene.load` of a file"),
        (lambda: Scene([3]), "obstacle 0 is 3; expected a tdcr.Obstacle"),
        (lambda: Scene([Obstacle.mesh("part", tmp_path / "none.stl")]), "none.stl"),
        (lambda: Scene.load(tmp_path / "none.toml"), "scene file .*none.toml: it cannot be read"),
        (lambda: SCENE.moved("bell", (0, 0, 0)), "no obstacle 'bell'; expected one of ball, wall"),
        (lambda: SCENE.moved(2, (0, 0, 0)), "obstacle 2 of 2; expected a name, or a number from 0"),
        (lambda: SCENE.moved(0, orientation=(0, 0, 0, 0)), "not all 0"),
        (lambda: tdcr.obstacle_jacobian(BALLS, COMMAND, "bell", scene=SCENE), "no obstacle 'bell'"),
    ]
    for attempt, message in cases:
        with pytest.raises(SceneError, match=message):
            attempt()
    (tmp_path / "scene.toml").write_text("[[obstacle]]\nball = 3\n", encoding="utf-8")
    with pytest.raises(SceneError, match="obstacle 0"):
        Scene.load(tmp_path / "scene.toml")
    inside = SCENE.moved("ball", (0.0, 0.0, 0.1))
    with pytest.raises(ContactError, match='disc 0 starts inside obstacle "ball"'):
        tdcr.settle(BALLS, COMMAND, scene=inside)
    with pytest.raises(ContactError, match='row 0: disc 0 starts inside obstacle "ball"'):
        tdcr.settle_batch(BALLS, [COMMAND, COMMAND], scene=inside)
    moment = tdcr.Loads(wrenches=(tdcr.Wrench(2, moment=(0, 1e-3, 0)),))
    with pytest.raises(ContactError, match="row 1: the wrench on disc 2 is a moment or turns with its disc"):
        tdcr.settle_batch(BALLS, [COMMAND, COMMAND], loads=[tdcr.Loads(), moment], scene=SCENE)
    # The question is told to be wrong even where failures are not.
    with pytest.raises(ContactError, match="the wrench on disc 2"):
        tdcr.jacobian(BALLS, COMMAND, loads=moment, scene=SCENE, on_failure="nan")
    with pytest.raises(InputError, match="scene is None; expected a tdcr.Scene"):
        tdcr.scene_vjp(BALLS, [COMMAND], np.zeros((1, 4, 3)), scene=None)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="scene is 3; expected a tdcr.Scene"):
        tdcr.settle(BALLS, COMMAND, scene=3)  # type: ignore[arg-type]
    with pytest.raises(CommandError):
        tdcr.settle(BALLS, COMMAND + 1, scene=SCENE)
    assert (
        issubclass(SceneError, InputError) and issubclass(ContactError, InputError) and issubclass(SensitivityError, RuntimeError)
    )


def test_cameras_see_obstacles() -> None:
    found = tdcr.settle(ROBOT, COMMANDS[0], scene=POSTS)
    without, among = tdcr.render(ROBOT, found), tdcr.render(ROBOT, found, scene=POSTS)
    assert all((view.mask < 40_000).all() for view in without)
    assert {int(one) for view in among for one in np.unique(view.mask) if one >= 40_000} == {40_000, 40_001, 40_002}


def test_a_robot_that_curls_up_touches_itself() -> None:
    robot = tdcr.Robot("5m")
    command = np.tile([0.04, 0.0, 0.0], 5)
    alone = tdcr.Scene()
    assert alone.self_contact == 1e-6
    found = tdcr.settle(robot, command, scene=alone)
    contacts = found.contacts
    assert contacts is not None and len(contacts) > 0
    assert (contacts.obstacle == -1).all() and set(contacts.obstacle_names) == {None}
    assert (contacts.other_disc > contacts.disc + 1).all()
    # Forces push along the normals, by the compliance times the overlap.
    np.testing.assert_allclose((contacts.force * contacts.normal).sum(1) * 1e-6, -contacts.gap, rtol=1e-6, atol=1e-10)

    through = alone.with_self_contact(None)
    assert through.self_contact is None and tdcr.Scene.from_json(through.to_json()) == through
    passed = tdcr.settle(robot, command, scene=through)
    assert passed.contacts is not None and len(passed.contacts) == 0
    np.testing.assert_array_equal(passed.positions, tdcr.settle(robot, command).positions)
    soft = tdcr.settle(robot, command, scene=alone.with_self_contact(1e-4)).contacts
    assert soft is not None and soft.penetration > contacts.penetration
    with pytest.raises(SceneError, match=r"self_contact.compliance` is -1"):
        alone.with_self_contact(-1.0)


def test_discs_rub_in_motion_and_along_paths() -> None:
    robot, command = tdcr.Robot("5m"), np.tile([0.04, 0.0, 0.0], 5)
    smooth, rough = tdcr.Scene(), tdcr.Scene().with_self_contact(1e-6, 0.4)
    assert smooth.self_friction == 0.0 and rough.self_friction == 0.4 and rough.self_contact == 1e-6
    assert tdcr.Scene.from_json(rough.to_json()) == rough != smooth
    moving = tdcr.MovingRobot(robot, scene=rough)
    moving.start_at(tdcr.State.straight(robot), command)
    words: set[str] = set()
    for _ in range(200):
        moving.step(command, frame_skip=5)
        contacts = moving.contacts
        normal = (contacts.force * contacts.normal).sum(1)
        across = np.linalg.norm(contacts.force - normal[:, None] * contacts.normal, axis=1)
        assert (across <= 0.4 * normal + 1e-5 * normal.max(initial=0.0)).all()
        words |= set(contacts.sliding)
    assert "slips" in words
    curling = [np.tile([0.02 + by, 0.02 - by, 0.02 - by], 5) for by in np.linspace(0.0, 0.018, 60)]
    path = tdcr.follow(robot, curling, scene=rough)
    assert path.converged.all() and path.contacts is not None
    assert {"sticks", "slips"} <= set(path.contacts.sliding)
    assert (path.contacts.other_disc >= 0).all()
    led = tdcr.FrictionPath(robot, scene=rough).follow(curling[-20:])
    last = led[-1].equilibrium
    assert last.converged and last.contacts is not None and set(last.contacts.sliding) <= {"sticks", "slips"}
    with pytest.raises(SceneError, match=r"self_contact.friction` is -1"):
        smooth.with_self_contact(1e-6, -1.0)


def test_a_motion_in_a_scene_comes_to_rest_where_the_robot_settles() -> None:
    scene = Scene([Obstacle.cylinder("post", 0.01, 0.4, position=(-0.06, 0.0, 0.25), friction=0.1)])
    command = np.array([0.034, 0.007, 0.001, 0.026, 0.015, 0.019])
    options = {"scene": scene, "start": "settled", "integrator": "implicit-euler", "frame_skip": 5}
    motion = tdcr.simulate("2m", np.tile(command, (20, 1)), **options)
    settled = tdcr.settle("2m", command, scene=scene)
    assert motion.contacts is not None and settled.contacts is not None
    assert np.abs(motion.positions[-1] - settled.positions).max() < 1e-8
    last = motion.contacts.row == 19
    assert last.any()
    assert np.allclose(motion.contacts.force[last].sum(axis=0), settled.contacts.force.sum(axis=0), atol=1e-6)
    assert set(motion.contacts.obstacle_names) == {"post"}

    moving = tdcr.MovingRobot("2m", integrator="implicit-euler", frame_skip=5, scene=scene)
    moving.reset(command)
    for _ in range(20):
        moving.step(command)
    assert np.array_equal(moving.positions, motion.positions[-1])
    assert moving.contacts is not None
    assert np.array_equal(moving.contacts.force, motion.contacts.force[last])
    twin = pickle.loads(pickle.dumps(moving))
    for robot in (moving, twin):
        robot.step(command * 0.9)
    assert np.array_equal(twin.positions, moving.positions)
    assert tdcr.simulate("2m", command[np.newaxis]).contacts is None
    assert tdcr.MovingRobot("2m").contacts is None

    with pytest.raises(tdcr.errors.DynamicsError, match="take no contacts"):
        tdcr.simulate("2m", command[np.newaxis], scene=scene, integrator="runge-kutta4")
    inside = Scene([Obstacle.sphere("ball", 0.05, position=(0.0, 0.0, 0.3))])
    with pytest.raises(ContactError, match="ball"):
        tdcr.simulate("2m", command[np.newaxis], scene=inside)

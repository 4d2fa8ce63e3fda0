"""Gradients of motions through contacts, in fluids, of late servos, and by loads that vary from command to command."""

from __future__ import annotations

import numpy as np
import pytest

import tdcr
from tdcr.errors import DynamicsError, InputError

ROBOT = tdcr.Robot("2m")
POST = tdcr.Scene([tdcr.Obstacle.cylinder("post", 0.01, 0.4, position=(-0.06, 0, 0.25), friction=0.2, compliance=1e-5)])
BENT = np.array([0.034, 0.007, 0.001, 0.026, 0.015, 0.019])
STEPS = 4
START = tdcr.simulate(ROBOT, np.tile(BENT, (50, 1)), scene=POST).end


def arrays() -> tuple[np.ndarray, ...]:
    """Two motions against the post: commands, start, payloads, and wrenches of each command."""
    rng = np.random.default_rng(1)
    commands = BENT + rng.uniform(0.0, 1e-3, size=(2, STEPS, 6))
    wrench = rng.normal(scale=1e-3, size=(2, STEPS, 10, 6))
    configuration, velocity = (np.stack([array] * 2) for array in (START.configuration, START.velocity))
    return commands, configuration, velocity, np.array([1e-3, 2e-3]), wrench


def weights(width: int) -> np.ndarray:
    return np.linspace(-1.0, 1.0, 10 * width).reshape(10, width)


def test_torch_has_gradients_through_contacts_and_by_loads_that_vary() -> None:
    torch = pytest.importorskip("torch")
    import tdcr.torch

    inputs = tuple(torch.tensor(array, requires_grad=True) for array in arrays())

    def cost(*inputs: torch.Tensor) -> torch.Tensor:
        positions, _, rates = tdcr.torch.rollout(ROBOT, *inputs, scene=POST, frame_skip=2)
        w = torch.from_numpy(weights(3))
        return (positions * w + 1e-3 * rates * w).sum((-3, -2, -1))

    assert torch.autograd.gradcheck(cost, inputs, eps=1e-7, atol=1e-5, rtol=1e-4, fast_mode=True, check_forward_ad=True)
    touched = torch.autograd.grad(cost(*inputs).sum(), inputs)
    assert all(gradient.shape == tensor.shape and gradient.any() for gradient, tensor in zip(touched, inputs, strict=True))
    each = torch.func.vmap(torch.func.grad(cost, tuple(range(5))))(*(tensor.detach() for tensor in inputs))
    assert all(torch.allclose(e, t, rtol=1e-9, atol=1e-13) for e, t in zip(each, touched, strict=True))
    compiled = torch.compile(cost, backend="aot_eager", fullgraph=True)
    found = torch.autograd.grad(compiled(*inputs).sum(), inputs)
    assert all(torch.allclose(f, t, rtol=1e-12) for f, t in zip(found, touched, strict=True))


def test_jax_has_them_too() -> None:
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    from jax.test_util import check_grads

    import tdcr.jax

    def cost(*inputs: object) -> object:
        positions, _, rates = tdcr.jax.rollout(ROBOT, *inputs, scene=POST, frame_skip=2)
        return ((positions + 1e-3 * rates) * weights(3)).sum()

    check_grads(jax.jit(jax.vmap(cost)), arrays(), order=1, modes=["rev", "fwd"], eps=1e-7, atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("kind", ["fluid", "servos"])
def test_gradients_in_fluids_and_of_late_servos_are_differences(kind: str) -> None:
    fields = ROBOT.to_dict()
    servo = {"lag": 0.01, "rate": 0.5, "largest_force": 8.0}
    if kind == "fluid":
        robot = tdcr.Robot(fields | {"fluid": {"density": 998.0, "drag_coefficient": 1.1}})
    else:
        modules = [module | {"tendons": module["tendons"] | {"servo": servo}} for module in fields["modules"]]
        robot = tdcr.Robot(fields | {"modules": modules})
    commands, *_ = arrays()
    start, by = tdcr.State(START.configuration, START.velocity), weights(3) * np.ones((2, STEPS, 10, 3))
    gradient = tdcr.rollout_vjp(robot, commands, by, start=start, frame_skip=3).commands
    direction, size = np.random.default_rng(2).normal(size=commands.shape), 1e-6
    ends = [tdcr.rollout(robot, commands + s * direction, start=start, frame_skip=3).positions for s in (size, -size)]
    assert (gradient * direction).sum() == pytest.approx(((ends[0] - ends[1]) * by).sum() / (2.0 * size), rel=1e-6)


def test_wrenches_of_each_command_alike_are_one_for_all() -> None:
    commands, _, _, payload, _ = arrays()
    one = np.zeros((10, 6))
    one[9, 1] = 0.05
    each = np.broadcast_to(one, (2, STEPS, 10, 6))
    options = {"start": START, "scene": POST}
    alike, varying = (tdcr.rollout(ROBOT, commands, payload, wrench=w, **options) for w in (one, each))
    assert np.array_equal(alike.positions, varying.positions)
    simulated = tdcr.simulate(ROBOT, commands[1], payload[1], wrench=each[1], **options)
    assert np.array_equal(simulated.positions, varying.positions[1]) and len(simulated.contacts) > 0
    by = np.ones((2, STEPS, 10, 3))
    sums, parts = (tdcr.rollout_vjp(ROBOT, commands, by, payload=payload, wrench=w, **options).wrench for w in (one, each))
    assert parts.shape == each.shape and np.allclose(parts.sum(axis=1), sums, rtol=1e-9, atol=1e-15)
    free = tdcr.linearise(ROBOT, START, commands[0, 0])
    touching = tdcr.linearise(ROBOT, START, commands[0, 0], scene=POST)
    assert not np.allclose(free.a, touching.a, rtol=1e-3)
    with pytest.raises(InputError, match=r"wrench has shape \(2, 3, 10, 6\); expected \(2, 4, 10, 6\)"):
        tdcr.rollout(ROBOT, commands, wrench=each[:, :3])


def test_gradients_by_an_obstacle_are_differences() -> None:
    commands, *_ = arrays()
    by = weights(3) * np.ones((2, STEPS, 10, 3))
    found = tdcr.rollout_vjp(ROBOT, commands, by, start=START, frame_skip=2, scene=POST)

    def cost(x: float = 0.0, tilt: float = 0.0, softer: float = 0.0) -> np.ndarray:
        place = {"position": (x - 0.06, 0, 0.25), "orientation": (np.cos(tilt / 2.0), 0, np.sin(tilt / 2.0), 0)}
        post = tdcr.Obstacle.cylinder("post", 0.01, 0.4, friction=0.2, compliance=1e-5 + softer, **place)
        motions = tdcr.rollout(ROBOT, commands, start=START, frame_skip=2, scene=tdcr.Scene([post]))
        return (motions.positions * by).sum(axis=(1, 2, 3))

    unit = np.eye(6).reshape(6, 1, 1, 6) * np.ones((2, 1, 1))
    for name, size, slopes, rates in (
        ("x", 1e-7, found.obstacles[:, 0, 0], tdcr.RolloutRates(obstacles=unit[0])),
        ("tilt", 1e-6, found.obstacles[:, 0, 4], tdcr.RolloutRates(obstacles=unit[4])),
        ("softer", 1e-8, found.compliance[:, 0], tdcr.RolloutRates(compliance=np.ones((2, 1)))),
    ):
        differences = (cost(**{name: size}) - cost(**{name: -size})) / (2.0 * size)
        assert slopes.all() and slopes == pytest.approx(differences, rel=1e-4), name
        ahead = tdcr.rollout_jvp(ROBOT, commands, rates, start=START, frame_skip=2, scene=POST)
        assert (ahead.positions * by).sum(axis=(1, 2, 3)) == pytest.approx(slopes, rel=1e-9), name
    assert tdcr.rollout_vjp(ROBOT, commands, by).obstacles.shape == (2, 0, 6)


def places_and_turns() -> tuple[np.ndarray, np.ndarray]:
    """Poses of the post in each of two rows: it is moved and turned in the second. Quaternions of any length."""
    return (
        np.array([[[-0.06, 0.0, 0.25]], [[-0.05999, 0.001, 0.251]]]),
        np.array([[[2.0, 0.0, 0.0, 0.0]], [[0.5, 0.0, 1e-5, 0.1]]]),
    )


def test_each_row_may_have_a_scene_of_its_own() -> None:
    commands, *_ = arrays()
    other = POST.moved("post", places_and_turns()[0][1, 0])
    options = {"start": START, "frame_skip": 2}
    both = tdcr.rollout(ROBOT, commands, scene=[POST, other], **options)
    alone = [tdcr.rollout(ROBOT, commands[k : k + 1], scene=scene, **options) for k, scene in enumerate((POST, other))]
    assert all(np.array_equal(both.positions[k], one.positions[0]) for k, one in enumerate(alone))
    assert not np.array_equal(both.positions, tdcr.rollout(ROBOT, commands, scene=POST, **options).positions)
    # Forward mode is the adjoint of the gradient.
    rng = np.random.default_rng(3)
    weights = [rng.normal(size=(2, STEPS, 10, width)) for width in (3, 4, 3)]
    back = tdcr.rollout_vjp(ROBOT, commands, *weights, scene=[POST, other], **options)
    rates = tdcr.RolloutRates(obstacles=rng.normal(size=(2, 1, 6)), compliance=0.1 * rng.normal(size=(2, 1)))
    ahead = tdcr.rollout_jvp(ROBOT, commands, rates, scene=[POST, other], **options)
    forward = sum((w * f).sum() for w, f in zip(weights, (ahead.positions, ahead.quaternions, ahead.velocity), strict=True))
    backward = (back.obstacles * rates.obstacles).sum() + (back.compliance * rates.compliance).sum()
    assert abs(forward) > 1.0 and forward == pytest.approx(backward, rel=1e-8)
    with pytest.raises(InputError, match="there are 3 scenes; expected one, or 2, one for each row"):
        tdcr.rollout(ROBOT, commands, scene=[POST] * 3)
    heavy = tdcr.Scene([tdcr.Obstacle.cylinder("post", 0.01, 0.4, position=(-0.06, 0, 0.25), mass=0.1)])
    with pytest.raises(InputError, match=r"obstacles \[0\] of scene 1 have a mass, of scene 0 \[\]"):
        tdcr.rollout(ROBOT, commands, scene=[POST, heavy])
    with pytest.raises(InputError, match="rates.obstacles is given without a scene; expected `scene`"):
        tdcr.rollout_jvp(ROBOT, commands, rates)
    with pytest.raises(InputError, match=r"rates.obstacles has shape \(2, 2, 6\); expected \(2, 1, 6\)"):
        tdcr.rollout_jvp(ROBOT, commands, tdcr.RolloutRates(obstacles=np.ones((2, 2, 6))), scene=POST)


def test_poses_of_obstacles_are_inputs_of_motions_in_torch() -> None:
    torch = pytest.importorskip("torch")
    import tdcr.torch

    fixed = [torch.tensor(array) for array in arrays()[:3]]
    places, turns = (torch.tensor(array, requires_grad=True) for array in places_and_turns())

    def cost(commands: torch.Tensor, places: torch.Tensor, turns: torch.Tensor, *start: torch.Tensor) -> torch.Tensor:
        options = {"scene": POST, "obstacle_positions": places, "obstacle_quaternions": turns}
        positions, quaternions, rates = tdcr.torch.rollout(ROBOT, commands, *(start or fixed[1:]), frame_skip=2, **options)
        w, turned = (torch.from_numpy(weights(width)) for width in (3, 4))
        return (positions * w + 1e-3 * rates * w).sum((-3, -2, -1)) + (quaternions * turned).sum((-3, -2, -1))

    inputs = (fixed[0].clone().requires_grad_(), places, turns)
    assert torch.autograd.gradcheck(cost, inputs, eps=1e-7, atol=1e-5, rtol=1e-4, fast_mode=True, check_forward_ad=True)
    found = torch.autograd.grad(cost(*inputs).sum(), inputs)
    assert all(gradient.shape == tensor.shape and gradient.any() for gradient, tensor in zip(found, inputs, strict=True))
    detached = tuple(tensor.detach() for tensor in inputs)
    each = torch.func.vmap(torch.func.grad(cost, (0, 1, 2)))(*detached, *fixed[1:])
    assert all(torch.allclose(e, f, rtol=1e-9, atol=1e-12) for e, f in zip(each, found, strict=True))
    direction = tuple(torch.randn_like(tensor) for tensor in detached)
    _, forward = torch.func.jvp(lambda *a: cost(*a).sum(), detached, direction)
    assert torch.allclose(forward, sum((f * d).sum() for f, d in zip(found, direction, strict=True)), rtol=1e-8)
    compiled = torch.autograd.grad(torch.compile(cost, backend="aot_eager", fullgraph=True)(*inputs).sum(), inputs)
    assert all(torch.allclose(c, f, rtol=1e-12) for c, f in zip(compiled, found, strict=True))
    # Where the scene has them it is the scene, and one pose may be for all rows.
    own = torch.tensor([one.position for one in POST], dtype=torch.float64)
    scene = tdcr.torch.rollout(ROBOT, *fixed, scene=POST)[0]
    assert torch.equal(tdcr.torch.rollout(ROBOT, *fixed, scene=POST, obstacle_positions=own)[0], scene)
    with pytest.raises(InputError, match="poses of obstacles are given without a scene"):
        tdcr.torch.rollout(ROBOT, *fixed, obstacle_positions=own)
    with pytest.raises(
        InputError, match=r"obstacle_positions has shape \(1, 2\); expected \(2, 1, 3\), or \(1, 3\) for all rows"
    ):
        tdcr.torch.rollout(ROBOT, *fixed, scene=POST, obstacle_positions=own[:, :2])


def test_they_are_in_jax_too() -> None:
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    from jax.test_util import check_grads

    import tdcr.jax

    def cost(places: object, turns: object, *fixed: object) -> object:
        options = {"scene": POST, "obstacle_positions": places, "obstacle_quaternions": turns}
        positions, quaternions, rates = tdcr.jax.rollout(ROBOT, *fixed, frame_skip=2, **options)
        return ((positions + 1e-3 * rates) * weights(3)).sum() + (quaternions * weights(4)).sum()

    poses, fixed = places_and_turns(), arrays()[:3]
    of_rows = jax.jit(jax.vmap(cost))
    check_grads(lambda *a: of_rows(*a, *fixed), poses, order=1, modes=["rev", "fwd"], eps=1e-7, atol=1e-5, rtol=1e-4)
    with pytest.raises(InputError, match="poses of obstacles are given without a scene"):
        tdcr.jax.rollout(ROBOT, *fixed, obstacle_positions=poses[0])
    with pytest.raises(
        InputError, match=r"obstacle_quaternions has shape \(2, 1, 3\); expected \(2, 1, 4\), or \(1, 4\) for all"
    ):
        tdcr.jax.rollout(ROBOT, *fixed, scene=POST, obstacle_quaternions=poses[0])


def test_what_has_no_derivatives_among_obstacles_is_refused_by_name() -> None:
    commands, *_ = arrays()
    ball = tdcr.Scene([tdcr.Obstacle.sphere("ball", 0.01, position=(0.3, 0, 0.1), mass=0.1)])
    with pytest.raises(DynamicsError, match="motions of objects have no derivatives"):
        tdcr.rollout_vjp(ROBOT, commands, np.ones((2, STEPS, 10, 3)), scene=ball)
    fields = ROBOT.to_dict()
    modules = [module | {"tendons": module["tendons"] | {"drive": "length"}} for module in fields["modules"]]
    with pytest.raises(DynamicsError, match="inextensible"):
        tdcr.rollout_vjp(tdcr.Robot(fields | {"modules": modules}), np.full((2, STEPS, 6), 0.02), np.ones((2, STEPS, 10, 3)))

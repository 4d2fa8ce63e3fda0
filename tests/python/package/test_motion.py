"""Motion from Python: rollouts, single steps, and their derivatives."""

from __future__ import annotations

import copy
import json
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tdcr as package
from tdcr.errors import CommandError, DynamicsError, InputError, LoadsError, NotSettledError, ParameterError

Run = Callable[..., dict[str, Any]]


@pytest.fixture(scope="module")
def robot() -> package.Robot:
    return package.Robot("2m")


def ramps(robot: package.Robot, rows: int, length: int, seed: int = 0) -> np.ndarray:
    """Commands that go from the mean one to random ones."""
    ends = robot.random_commands(rows, seed)
    share = np.linspace(0.0, 1.0, length)[:, None]
    return robot.mean_command + share * (ends[:, None] - robot.mean_command)


def test_loads_that_vary_are_those_of_a_file_of_the_command_line(robot: package.Robot, tdcr: Run, tmp_path: Path) -> None:
    (commands,) = ramps(robot, 1, 20)
    np.savetxt(tmp_path / "commands.csv", commands, delimiter=",", fmt="%.17g")
    wrench = np.zeros((20, robot.discs, 6))
    wrench[:, 4, 0], wrench[:, 9, 5] = np.linspace(0.0, 0.2, 20), 0.01
    table = np.column_stack([wrench[:, 4, 0], wrench[:, 9, 5]])
    np.savetxt(tmp_path / "loads.csv", table, delimiter=",", fmt="%.17g", header="fx4 (N),mztip (N m)", comments="")
    files = ("--commands", tmp_path / "commands.csv", "--loads-file", tmp_path / "loads.csv", "--line-load", "0,0.1,0")
    told = tdcr("simulate", "--robot", "2m", *files, "--payload", 0.01)
    motion = package.simulate(robot, commands, wrench=wrench, loads=package.Loads(0.01, line=[0.0, 0.1, 0.0]))
    np.testing.assert_allclose(told["positions"], motion.positions[-1], rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("integrator", ["semi-implicit-euler", "runge-kutta4", "implicit-euler", "implicit-midpoint"])
def test_a_simulation_is_that_of_the_command_line(robot: package.Robot, tdcr: Run, tmp_path: Path, integrator: Any) -> None:
    (commands,) = ramps(robot, 1, 40)
    np.savetxt(tmp_path / "commands.csv", commands, delimiter=",", fmt="%.17g")
    files = ("--commands", tmp_path / "commands.csv", "--out", tmp_path / "path.csv", "--linearise", tmp_path / "ab.json")
    told = tdcr("simulate", "--robot", "2m", *files, "--payload", 0.01, "--integrator", integrator)
    motion = package.simulate(robot, commands, payload=0.01, integrator=integrator)
    path = np.loadtxt(tmp_path / "path.csv", delimiter=",", skiprows=1)
    assert np.array_equal(path[:, 1:], motion.positions.reshape(40, -1))
    assert np.allclose(path[:, 0], motion.times, rtol=1e-15)
    assert np.array_equal(told["velocity"], motion.velocity[-1].ravel())
    signs = np.sign(motion.configuration[-1, :, :1])
    assert np.array_equal(told["rotations"], motion.configuration[-1] * signs)
    matrices = json.loads((tmp_path / "ab.json").read_text())
    linear = package.linearise(robot, motion.end, commands[-1], payload=0.01)
    assert np.array_equal(matrices["a"], linear.a)
    assert np.array_equal(matrices["b"], linear.b)


def test_a_batch_is_its_rows_moved_one_by_one(robot: package.Robot) -> None:
    commands = ramps(robot, 20, 15)
    payload = np.linspace(0.0, 0.03, 20)
    wrench = np.zeros((20, 10, 6))
    wrench[:, 9, 0] = np.linspace(-0.05, 0.05, 20)
    settled = package.settle_batch(robot, commands[:, 0], payload, wrench=wrench)
    arguments: dict[str, Any] = {"integrator": "runge-kutta4", "frame_skip": 4, "dt": 0.001}
    done: list[int] = []
    batch = package.rollout(robot, commands, payload, wrench=wrench, start=settled, progress=done.append, **arguments)
    again = package.rollout(robot, commands, payload, wrench=wrench, start="settled", **arguments)
    assert sum(done) == 20 * 15
    assert len(batch) == 20 and batch.steps.tolist() == [15] * 20 and not batch.diverged.any()
    assert np.allclose(batch.times, 0.004 * np.arange(1, 16), rtol=1e-14)
    assert np.array_equal(again.positions, batch.positions)
    for row in (0, 7, 19):
        one = package.simulate(robot, commands[row], payload[row], wrench=wrench[row], start=settled[row], **arguments)
        for name in ("positions", "quaternions", "configuration", "velocity", "lengths", "tensions"):
            assert np.array_equal(getattr(one, name), getattr(batch[row], name)), name
    package.set_threads(1)
    try:
        alone = package.rollout(robot, commands, payload, wrench=wrench, start=settled, **arguments)
    finally:
        package.set_threads(2)
    assert np.array_equal(alone.velocity, batch.velocity)


def test_a_robot_stepped_by_hand_moves_as_in_a_rollout(robot: package.Robot) -> None:
    (commands,) = ramps(robot, 1, 12)
    loads = package.Loads(payload=0.02)
    expected = package.simulate(robot, commands, loads=loads, start="settled", frame_skip=5)
    moving = package.MovingRobot(robot, frame_skip=5)
    for _ in range(2):
        # A reset forgets what was before.
        moving.reset(commands[0], loads)
        settled = package.settle(robot, commands[0], loads=loads)
        assert np.array_equal(moving.configuration, settled.configuration)
        assert np.abs(moving.tensions - settled.tensions).max() < 1e-12
        for step, command in enumerate(commands):
            moving.step(command, loads)
            assert np.array_equal(moving.positions, expected.positions[step])
            assert np.array_equal(moving.quaternions, expected.quaternions[step])
            assert np.array_equal(moving.velocity, expected.velocity[step])
            assert np.array_equal(moving.lengths, expected.lengths[step])
            assert np.array_equal(moving.tensions, expected.tensions[step])
    assert moving.time == pytest.approx(12 * 5 * 0.002)
    for other in (pickle.loads(pickle.dumps(moving)), copy.deepcopy(moving)):
        assert (other.time, other.frame_skip) == (moving.time, 5)
        assert np.array_equal(other.tensions, moving.tensions)
        other.step(commands[3], loads)
        assert not np.array_equal(other.positions, moving.positions)
    first, second = package.MovingRobot(robot), package.MovingRobot(robot)
    for one, skip in ((first, 1), (second, 6)):
        one.start_at(moving.state)
        for _ in range(6 // skip):
            one.step(commands[5], loads, frame_skip=skip)
    assert np.array_equal(first.state.configuration, second.state.configuration)
    assert np.array_equal(first.tip, first.positions[-1])


def test_a_row_that_diverges_does_not_stop_the_others(robot: package.Robot) -> None:
    stiff = robot.with_values({f"gain[{t}]": 1e7 for t in range(6)})
    commands = ramps(robot, 3, 30)
    motions = package.rollout([robot, stiff, robot], commands)
    assert motions.diverged.tolist() == [False, True, False]
    assert list(motions.failures) == [1]
    # Not one step: small motions about its start would grow.
    assert motions.failures[1].startswith("steps of 0.002 s are unstable") and motions.steps.tolist() == [30, 0, 30]
    assert np.isnan(motions[1].positions).all()
    assert np.isfinite(motions.positions[[0, 2]]).all()
    assert np.array_equal(motions.positions[2], package.rollout(robot, commands[2:]).positions[0])
    gradients = package.rollout_vjp([robot, stiff, robot], commands, np.ones((3, 30, 10, 3)))
    assert list(gradients.failures) == [1]
    assert np.isnan(gradients.commands[1]).all() and np.isnan(gradients.payload[1])
    assert np.isfinite(gradients.commands[[0, 2]]).all()
    # One that swings ever faster.
    undamped = robot.with_values({"damping[0]": 0.0, "damping[1]": 0.0})
    shaken = np.random.default_rng(3).choice(robot.command_ranges[0], (2, 400, 6))
    motions = package.rollout([robot, undamped], shaken, dt=0.08, frame_skip=5)
    assert list(motions.failures) == [1]
    assert motions.failures[1].startswith("step ") and "the motion diverged" in motions.failures[1]
    steps = int(motions.steps[1])
    assert 0 < steps < 400 and np.isfinite(motions[1].positions[:steps]).all()
    assert np.isnan(motions[1].positions[steps:]).all()


def test_time_steps_that_are_too_long_are_refused_everywhere(robot: package.Robot) -> None:
    (commands,) = ramps(robot, 1, 5)
    moving = package.MovingRobot(robot, 0.5)
    refusals: list[Callable[[], Any]] = [
        lambda: package.simulate(robot, commands, dt=0.5),
        lambda: package.simulate(robot, commands, dt=0.5, start="settled"),
        lambda: package.rollout(robot, np.stack([commands] * 3), dt=0.5),
        lambda: package.rollout(robot, np.stack([commands] * 3), dt=0.5, start=package.State.straight(robot)),
        lambda: package.rollout_vjp(robot, commands[np.newaxis], np.ones((1, 5, 10, 3)), dt=0.5),
        lambda: moving.step(commands[0]),
        lambda: moving.reset(commands[0]),
    ]
    for refused in refusals:
        with pytest.raises(DynamicsError, match="steps of 0.5 s are unstable: .* unless they are below 3.4"):
            refused()
    # By an implicit integrator small motions never grow.
    assert package.simulate(robot, commands, dt=0.5, integrator="implicit-euler").times[-1] == 2.5


def unit(quaternions: np.ndarray) -> np.ndarray:
    return quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True)


def test_gradients_are_central_differences() -> None:
    """By every input of a batch of rollouts, of a cost of positions, quaternions and velocities."""
    robot = package.Robot("3m").with_values({"density[1]": 40.0})
    rng = np.random.default_rng(5)
    rows, length, n = 2, 6, robot.discs
    commands = ramps(robot, rows, length, seed=2) * 0.8 + 0.004
    start = package.State(
        unit(np.concatenate([np.ones((rows, n, 1)), rng.uniform(-0.1, 0.1, (rows, n, 3))], axis=-1)) * 1.3,
        rng.uniform(-1.0, 1.0, (rows, n, 3)),
    )
    names = ["gain[1]", "density[0]", "pitch[2]", "hole_radius[3]", "damping[1]", "armature[0]", "hole[base][2].x"]
    inputs: dict[str, np.ndarray] = {
        "commands": commands,
        "configuration": start.configuration,
        "velocity": start.velocity,
        "payload": np.array([0.01, 0.03]),
        "wrench": rng.uniform(-0.02, 0.02, (rows, n, 6)),
    }
    weights = [rng.normal(size=(rows, length, n, width)) for width in (3, 4, 3)]
    options: dict[str, Any] = {"dt": 0.001, "frame_skip": 3}

    def cost(inputs: dict[str, np.ndarray], robot: package.Robot = robot) -> np.ndarray:
        motions = package.rollout(
            robot,
            inputs["commands"],
            inputs["payload"],
            wrench=inputs["wrench"],
            start=package.State(inputs["configuration"], inputs["velocity"]),
            **options,
        )
        states = (motions.positions, motions.quaternions, motions.velocity)
        return sum((w * s).sum(axis=(1, 2, 3)) for w, s in zip(weights, states, strict=True))

    gradients = package.rollout_vjp(
        robot,
        commands,
        *weights,
        payload=inputs["payload"],
        wrench=inputs["wrench"],
        start=start,
        parameters=names,
        **options,
    )
    sizes = {"commands": 1e-4, "configuration": 1e-4, "velocity": 1e-3, "payload": 1e-4, "wrench": 1e-2}
    for name, size in sizes.items():
        found = getattr(gradients, name)
        assert found.shape == inputs[name].shape
        for _ in range(4):
            direction = rng.normal(size=found.shape)
            up, down = (cost(inputs | {name: inputs[name] + by * direction}) for by in (size, -size))
            expected = (up - down) / (2.0 * size)
            slopes = (found * direction).reshape(rows, -1).sum(axis=1)
            assert slopes == pytest.approx(expected, rel=1e-4, abs=1e-6), name
    for column, name in enumerate(names):
        value = robot.value(name)
        size = 1e-3 * abs(value)
        up, down = (cost(inputs, robot.with_values({name: value + by})) for by in (size, -size))
        assert gradients.parameters[:, column] == pytest.approx((up - down) / (2.0 * size), rel=1e-4), name
    # What is not asked for costs nothing, and rows are those of single calls.
    alone = package.rollout_vjp(
        robot,
        commands[1:],
        *(weight[1:] for weight in weights),
        payload=0.03,
        wrench=inputs["wrench"][1],
        start=package.State(start.configuration[1], start.velocity[1]),
        **options,
    )
    assert alone.parameters.shape == (1, 0)
    assert np.array_equal(alone.commands[0], gradients.commands[1])
    assert np.array_equal(alone.configuration[0], gradients.configuration[1])
    zero = package.rollout_vjp(robot, commands)
    assert not zero.commands.any() and not zero.wrench.any()


def test_a_linearised_step_is_the_step_to_first_order(robot: package.Robot) -> None:
    (commands,) = ramps(robot, 1, 20)
    state = package.simulate(robot, commands).end
    linear = package.linearise(robot, state, commands[-1])
    assert linear.a.shape == (60, 60) and linear.b.shape == (60, 6)
    pull = np.zeros(6)
    pull[2] = 1e-6

    def after(command: np.ndarray) -> np.ndarray:
        moved = package.simulate(robot, command[None], start=state)
        return np.asarray(moved.velocity[0].ravel())

    change = (after(commands[-1] + pull) - after(commands[-1] - pull)) / 2e-6
    assert linear.b[30:, 2] == pytest.approx(change, rel=1e-5, abs=1e-6)


def test_motions_may_have_no_rows_and_no_commands(robot: package.Robot) -> None:
    none = package.rollout(robot, np.zeros((0, 5, 6)))
    assert len(none) == 0 and none.positions.shape == (0, 5, 10, 3) and none.failures == {}
    short = package.rollout(robot, np.zeros((2, 0, 6)))
    assert short.positions.shape == (2, 0, 10, 3) and short.steps.tolist() == [0, 0]
    gradients = package.rollout_vjp(robot, np.zeros((2, 0, 6)))
    assert gradients.commands.shape == (2, 0, 6) and not gradients.velocity.any()


@pytest.mark.parametrize(
    ("change", "error", "says"),
    [
        ({"commands": np.full((2, 4, 5), 0.02)}, InputError, r"commands has shape \(2, 4, 5\); expected \(rows, T, 6\)"),
        ({"commands": np.full((2, 4, 6), 0.5)}, CommandError, r"row 0: step 0: command entry 1 is 0.5 m"),
        ({"dt": 0.0}, DynamicsError, "the time step is 0 s"),
        ({"frame_skip": 0}, InputError, "frame_skip is 0; expected 1 to"),
        ({"integrator": "leapfrog"}, InputError, "integrator is 'leapfrog'; expected 'semi-implicit-euler', 'runge-kutta4'"),
        ({"payload": [0.0, -1.0]}, LoadsError, "row 1: the payload is -1 kg"),
        ({"payload": [0.0, 0.0, 0.0]}, InputError, r"payload has shape \(3,\); expected \(2,\)"),
        ({"wrench": np.zeros((9, 6))}, InputError, r"wrench has shape \(9, 6\); expected \(10, 6\)"),
        ({"loads": package.Loads(wrenches=(package.Wrench(12),))}, LoadsError, "a wrench acts on disc 12"),
        ({"start": "bent"}, InputError, "start is 'bent'; expected 'straight', 'settled'"),
        ({"start": package.State(np.zeros((10, 4)))}, InputError, "configuration has a quaternion that is 0"),
        (
            {"start": package.State(np.ones((3, 10, 4)))},
            InputError,
            r"configuration has shape \(3, 10, 4\); expected \(2, 10, 4\)",
        ),
        (
            {"start": package.State(np.ones((10, 4)), np.full((10, 3), np.nan))},
            InputError,
            r"velocity\[0\]\[0\] is nan",
        ),
        ({"robot": package.Robot("3m")}, InputError, r"commands has shape \(2, 4, 6\); expected \(rows, T, 9\)"),
        ({"robot": []}, InputError, "there are no robots"),
    ],
)
def test_bad_inputs_are_refused_by_name(robot: package.Robot, change: dict[str, Any], error: type[Exception], says: str) -> None:
    arguments: dict[str, Any] = {"robot": robot, "commands": np.full((2, 4, 6), 0.02)} | change
    with pytest.raises(error, match=says):
        package.rollout(**arguments)


def test_gradients_that_there_are_not_are_refused(robot: package.Robot) -> None:
    commands = np.full((2, 4, 6), 0.02)
    with pytest.raises(InputError, match=r"by_velocity has shape \(2, 4, 10, 4\); expected \(2, 4, 10, 3\)"):
        package.rollout_vjp(robot, commands, by_velocity=np.zeros((2, 4, 10, 4)))
    with pytest.raises(ParameterError, match="no parameter"):
        package.rollout_vjp(robot, commands, parameters=["youngs[0]"])
    with pytest.raises(ParameterError, match="expected a key like gain"):
        package.rollout_vjp(robot, commands, parameters=["gain"])
    with pytest.raises(InputError, match="start is 'settled', which has no derivative here"):
        package.rollout_vjp(robot, commands, start="settled")


def test_a_start_that_does_not_settle_is_a_failure_of_its_row(robot: package.Robot) -> None:
    # A moment that no tendon balances.
    wrench = np.zeros((2, 10, 6))
    wrench[1, 9, 3] = 10.0
    motions = package.rollout(robot, np.full((2, 3, 6), 0.02), wrench=wrench, start="settled")
    assert motions.steps.tolist() == [3, 0] and list(motions.failures) == [1]
    with pytest.raises(NotSettledError):
        package.simulate(robot, np.full((3, 6), 0.02), wrench=wrench[1], start="settled")
    twist = package.Loads(wrenches=(package.Wrench(9, moment=(10.0, 0.0, 0.0)),))
    with pytest.raises(NotSettledError):
        package.MovingRobot(robot).reset(robot.mean_command, twist)


def test_servos_follow_late_hold_lengths_and_keep_on_when_pickled(tmp_path: Path) -> None:
    spec = package.Robot("2m").to_dict()

    def with_tendons(name: str, **fields: Any) -> Path:
        file = tmp_path / name
        for module in spec["modules"]:
            module["tendons"] |= fields
        file.write_text(json.dumps(spec))
        return file

    late = with_tendons("late.json", servo={"lag": 0.05, "rate": 0.1})
    file = with_tendons("servos.json", drive="length", pull="tension_only", range=[0.0, 0.2])
    robot = package.Robot(file)
    moving = package.MovingRobot(robot)
    straight = moving.lengths + np.array([0, 5e-3, 5e-3, 5e-3, 5e-3, 5e-3])
    moving.start_at(package.State.straight(robot), straight)
    goal = straight - [2e-3, 0, 0, 0, 0, 0]
    for _ in range(10):
        moving.step(goal)
    # The lag's closed form; its rate is below the largest.
    expected = goal[0] + 2e-3 * np.exp(-10 * 0.002 / 0.05)
    assert abs(moving.acting[0] - expected) < 1e-12
    # It pulls and does not push: the robot may fall to where it is slack.
    assert 0.08 < moving.lengths[0] < expected + 1e-5
    other = pickle.loads(pickle.dumps(moving))
    for one in (moving, other):
        one.step(goal)
    assert np.array_equal(moving.velocity, other.velocity) and np.array_equal(moving.acting, other.acting)
    with pytest.raises(DynamicsError, match="only steps by"):
        package.MovingRobot(robot, integrator="runge-kutta4")
    with pytest.raises(DynamicsError, match="follows its commands late"):
        package.linearise(late, package.State.straight(package.Robot(late)), package.Robot(late).mean_command)


def test_commanded_lengths_are_held_among_obstacles_as_on_the_command_line(tdcr: Run, tmp_path: Path) -> None:
    spec = package.Robot("2m").to_dict()
    for module in spec["modules"]:
        module["tendons"] |= {"drive": "length", "pull": "tension_only", "range": [0.0, 0.2]}
        module |= {"backbone": {"bending": [0.2, 0.2], "torsion": 0.2}, "damping": 0.02}
    (tmp_path / "held.json").write_text(json.dumps(spec))
    robot = package.Robot(tmp_path / "held.json")
    ends = np.array([[0.0, 0.2, 0.2, 0.2, 0.2, 0.2], [0.075, 0.2, 0.2, 0.2, 0.2, 0.2]])
    ends[0, 0] = package.MovingRobot(robot).lengths[0]
    free = package.simulate(robot, np.repeat(ends[1:], 200, axis=0), start="straight")
    tip = free.positions[-1, -1]
    ball = package.Obstacle.sphere("ball", 0.02, position=tuple(0.97 * tip))
    scene = package.Scene([ball])
    scene.save(tmp_path / "scene.toml")
    share = np.minimum(np.arange(400) / 200, 1.0)[:, None]
    commands = ends[0] + share * (ends[1] - ends[0])
    np.savetxt(tmp_path / "commands.csv", commands, delimiter=",", fmt="%.17g")
    moving = package.MovingRobot(robot, scene=scene)
    moving.start_at(package.State.straight(robot), commands[0])
    touched = 0
    for command in commands:
        moving.step(command)
        touched += len(moving.contacts)
        assert moving.lengths[0] < command[0] + 1e-6
        assert moving.tensions[0] == 0.0 or abs(moving.lengths[0] - command[0]) < 1e-6
    assert touched > 20 and moving.tensions[0] > 0.1
    motion = package.simulate(robot, commands, scene=scene)
    assert np.array_equal(motion.velocity[-1], moving.velocity)
    files = ("--commands", tmp_path / "commands.csv", "--scene", tmp_path / "scene.toml")
    told = tdcr("simulate", "--robot", tmp_path / "held.json", *files)
    assert np.array_equal(told["velocity"], motion.velocity[-1].ravel())
    impedance = scene.with_contact_law(package.Impedance())
    with pytest.raises(DynamicsError, match="not under MuJoCo's law"):
        package.MovingRobot(robot, scene=impedance)


def rough(robot: str = "2m", coefficient: float = 0.2) -> package.Robot:
    """The robot with friction of its tendons."""
    changed = package.Robot(robot).to_dict()
    for module in changed["modules"]:
        module["tendons"]["friction"] = {"coefficient": coefficient}
    return package.Robot(changed)


@pytest.mark.parametrize("integrator", ["semi-implicit-euler", "implicit-euler"])
def test_tendons_rub_in_motion_and_copies_keep_what_their_contacts_bear(integrator: Any) -> None:
    moving, smooth = package.MovingRobot(rough(), integrator=integrator), package.MovingRobot("2m", integrator=integrator)
    command = np.array([0.002, 0.02, 0.02, 0.02, 0.01, 0.02])
    for one in (moving, smooth):
        one.reset([0.02] * 6)
        one.step(command, frame_skip=100)
    assert smooth.tendons == () and smooth.dissipated == 0.0
    assert np.linalg.norm(moving.tip - smooth.tip) > 1e-3 and moving.dissipated > 0.0
    for tendon in moving.tendons:
        # Within the capstan cone of each hole.
        before, after = tendon.tensions[:-1], tendon.tensions[1:]
        pulling = before > 0.0
        ratio = np.log(after[pulling] / before[pulling])
        assert np.all(np.abs(ratio) <= 0.2 * tendon.wrap_angles[pulling] + 1e-12)
    assert {slip for tendon in moving.tendons for slip in tendon.slip} & {"to servo", "to end"}
    copies = [copy.deepcopy(moving), pickle.loads(pickle.dumps(moving))]
    for one in (moving, *copies):
        one.step(command, frame_skip=300)
    # Where it has come to rest all stick, loaded.
    assert {slip for tendon in moving.tendons for slip in tendon.slip} == {"sticks"}
    assert any(tendon.deflections.any() for tendon in moving.tendons)
    for one in copies:
        assert np.array_equal(one.positions, moving.positions) and np.array_equal(one.velocity, moving.velocity)
    # From a state alone nothing is loaded.
    other = package.MovingRobot(rough(), integrator=integrator)
    other.start_at(moving.state, [0.02] * 6)
    assert all(not tendon.deflections.any() for tendon in other.tendons) and other.dissipated == 0.0


def test_motions_with_friction_are_rolled_out_and_single_steps_are_not_linearised() -> None:
    robot = rough()
    commands = np.linspace(robot.mean_command, [0.0, 0.02, 0.02, 0.02, 0.01, 0.02], 50)
    motion = package.simulate(robot, commands)
    moving = package.MovingRobot(robot)
    moving.start_at(package.State.straight(robot), commands[0])
    for command in commands:
        moving.step(command)
    assert np.array_equal(motion.positions[-1], moving.positions)
    state = package.State.straight(robot)
    with pytest.raises(DynamicsError, match="single steps with friction of tendons in their holes have no derivatives"):
        package.linearise(robot, state, robot.mean_command)
    with pytest.raises(DynamicsError, match="tendon 1 has friction in its holes, which only steps by"):
        package.simulate(robot, commands, integrator="runge-kutta4")

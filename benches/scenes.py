"""Robots among obstacles, ours beside MuJoCo's in the same scene, in one run.

    make bench            or   .venv/bin/python benches/scenes.py

Prints a Markdown table. Random commands that touch a wall or one of two posts, one thread, medians. MuJoCo's model is
`Robot.to_mjcf` with the scene. It is at rest when its joints are slower than 1e-5 rad/s and accelerate by less than 1e-3 rad/s²,
at most 20,000 steps; its drift is how far a disc moves in 6 s from our equilibrium, on the contacts that the model gives it
there. Steps are of a robot at rest; in the second table, of one that bends over a table and pushes the first of five boxes.
"""

import statistics
import sys
import time

import mujoco
import numpy as np

import tdcr

COMMANDS = 6
MOST_STEPS = 20_000
DRIFT = 6.0
STEPS = 1_000


def scene():
    """A wall and two posts about a robot that stands."""
    return tdcr.Scene(
        [
            tdcr.Obstacle.cylinder("left", 0.01, 0.6, position=(-0.05, 0.03, 0.3)),
            tdcr.Obstacle.cylinder("right", 0.01, 0.6, position=(0.03, 0.05, 0.3)),
            tdcr.Obstacle.box("wall", (0.02, 1.0, 1.0), position=(0.08, 0.0, 0.3)),
        ]
    )


def touching(robot, around, rng):
    """Random commands that press the robot on something, and its equilibria."""
    low, high = robot.command_ranges.T
    while True:
        command = low + (high - low) * rng.random(len(low))
        found = tdcr.settle(robot, command, scene=around)
        if found.converged and len(found.contacts):
            yield command, found


def seconds(work, times):
    """Of one of so many calls."""
    work()
    began = time.perf_counter()
    for _ in range(times):
        work()
    return (time.perf_counter() - began) / times


class Theirs:
    """MuJoCo's model of a robot under a command, and its state."""

    def __init__(self, robot, around, command, discs):
        self.model = mujoco.MjModel.from_xml_string(robot.to_mjcf(scene=around, command=command.tolist()))
        self.data = mujoco.MjData(self.model)
        self.bodies = [self.data.body(f"disc{disc}") for disc in range(discs)]

    def at_our_equilibrium(self):
        mujoco.mj_resetDataKeyframe(self.model, self.data, 0)

    def rest(self):
        """Seconds from the straight pose until it is at rest, and whether it came there."""
        self.at_our_equilibrium()
        control = self.data.ctrl.copy()
        mujoco.mj_resetData(self.model, self.data)
        self.data.ctrl[:] = control
        began = time.perf_counter()
        for step in range(MOST_STEPS):
            mujoco.mj_step(self.model, self.data)
            if step > 50 and np.abs(self.data.qvel).max() < 1e-5 and np.abs(self.data.qacc).max() < 1e-3:
                return time.perf_counter() - began, True
        return time.perf_counter() - began, False

    def drift(self):
        """How far a disc moves at most from our equilibrium (m)."""
        self.at_our_equilibrium()
        mujoco.mj_forward(self.model, self.data)
        start = np.array([body.xpos.copy() for body in self.bodies])
        for _ in range(round(DRIFT / self.model.opt.timestep)):
            mujoco.mj_step(self.model, self.data)
        mujoco.mj_forward(self.model, self.data)
        return np.linalg.norm([body.xpos for body in self.bodies] - start, axis=1).max()

    def step(self):
        """Seconds of a step."""
        self.at_our_equilibrium()
        return seconds(lambda: mujoco.mj_step(self.model, self.data), STEPS)


def compare(robot, around, command, found):
    """Contacts, seconds to rest and of a step of ours and of MuJoCo's, MuJoCo's drift (m), and whether it came to rest."""
    theirs = Theirs(robot, around, command, len(found.positions))
    hold = np.tile(command, (STEPS, 1))
    ours = seconds(lambda: tdcr.settle(robot, command, scene=around), 20)
    moved = seconds(lambda: tdcr.simulate(robot, hold, scene=around, start="settled"), 1) / STEPS
    rest, came = theirs.rest()
    return len(found.contacts), ours, rest, moved, theirs.step(), theirs.drift(), came


def measure(name, around):
    """What one robot does under all commands."""
    robot, rows = tdcr.Robot(name), []
    for command, found in touching(robot, around, np.random.default_rng(1)):
        rows.append(compare(robot, around, command, found))
        print(f"  {name}: {len(rows)} of {COMMANDS} commands", file=sys.stderr)
        if len(rows) == COMMANDS:
            break
    return np.array(rows, dtype=float)


def shelf(robot):
    """A table beside a robot that stands, and five boxes on it in a row that leads away."""
    tip = robot.straight_positions[-1]
    top = tip[2] - 0.06
    boxes = (
        tdcr.Obstacle.box(f"box {k}", (0.03, 0.06, 0.05), position=(-0.062 - 0.04 * k, 0.0, top + 0.025), mass=0.02, friction=0.3)
        for k in range(5)
    )
    return tdcr.Scene([tdcr.Obstacle.box("table", (0.5, 0.4, 0.02), position=(-0.3, 0.0, top - 0.01), friction=0.3), *boxes])


def towards_boxes(robot):
    """A command that bends the robot to the boxes, from its last module on, by 80 mm if it can."""
    low, high = robot.command_ranges.T
    best, bent = robot.mean_command, 0.0
    for module in reversed(range(0, robot.tendons, 3)):
        for pulled in range(module, module + 3):
            command = best.copy()
            command[module : module + 3] = low[module : module + 3]
            command[pulled] = high[pulled]
            aside = tdcr.settle(robot, command).positions[-1][0]
            if aside < bent:
                best, bent = command, aside
        if bent < -0.08:
            break
    return best


def pushing(name):
    """Seconds of a step of ours and of MuJoCo's as a robot pushes boxes, and how far each pushes the first (m)."""
    robot = tdcr.Robot(name)
    around, ends = shelf(robot), [robot.mean_command, towards_boxes(robot)]
    shares = np.minimum(np.arange(STEPS) / (0.5 * STEPS), 1.0)
    commands = ends[0] + (ends[1] - ends[0]) * shares[:, None]
    began = time.perf_counter()
    motion = tdcr.simulate(robot, commands, scene=around, start="settled")
    ours = (time.perf_counter() - began) / STEPS
    controls = []
    for command in reversed(ends):
        theirs = Theirs(robot, around, command, len(robot.straight_positions))
        theirs.at_our_equilibrium()
        controls.append(theirs.data.ctrl.copy())
    last, first = controls
    began = time.perf_counter()
    for share in shares:
        theirs.data.ctrl[:] = first + (last - first) * share
        mujoco.mj_step(theirs.model, theirs.data)
    other = (time.perf_counter() - began) / STEPS
    starts = around["box 0"].position[0]
    return ours, other, starts - motion.objects["box 0"].position[-1, 0], starts - theirs.data.body("box 0").xpos[0]


def table(measured):
    """The measurements in Markdown."""
    lines = ["| ours / MuJoCo, ratio | " + " | ".join(measured) + " |", "|---" * (len(measured) + 1) + "|"]
    middle = {name: [statistics.median(column) for column in rows.T] for name, rows in measured.items()}
    of = [(rows, middle[name]) for name, rows in measured.items()]
    cells = [
        (
            "to rest from the straight pose (ms)",
            [f"{1e3 * m[1]:.2f} / {1e3 * m[2]:,.0f}, **{m[2] / m[1]:,.0f}x**" for _, m in of],
        ),
        ("step of 2 ms (µs)", [f"{1e6 * m[3]:.1f} / {1e6 * m[4]:.1f}, **{m[4] / m[3]:.1f}x**" for _, m in of]),
        ("contacts", [f"{m[0]:.0f}" for _, m in of]),
        ("commands of which MuJoCo came to rest", [f"{r[:, 6].sum():.0f} of {len(r)}" for r, _ in of]),
        ("MuJoCo's drift in 6 s: median, most (µm)", [f"{1e6 * m[5]:.2f}, {1e6 * r[:, 5].max():.2f}" for r, m in of]),
    ]
    lines += [f"| {work} | " + " | ".join(row) + " |" for work, row in cells]
    return "\n".join(lines)


def table_of_objects(measured):
    """The same of robots that push objects."""
    lines = ["| ours / MuJoCo, ratio | " + " | ".join(measured) + " |", "|---" * (len(measured) + 1) + "|"]
    steps = [f"{1e6 * ours:.0f} / {1e6 * theirs:.0f}, **{theirs / ours:.1f}x**" for ours, theirs, *_ in measured.values()]
    ways = [f"{1e3 * ours:.1f} / {1e3 * theirs:.1f}" for *_, ours, theirs in measured.values()]
    lines += [
        f"| step of 2 ms with five boxes (µs) | {' | '.join(steps)} |",
        f"| way of the first box (mm) | {' | '.join(ways)} |",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    tdcr.set_threads(1)
    print(f"MuJoCo {mujoco.__version__}", file=sys.stderr)
    robots = ("2m", "3m", "5m")
    print(table({name: measure(name, scene()) for name in robots}), end="\n\n")
    print(table_of_objects({name: pushing(name) for name in robots}))

"""Settling, differentiating, stepping and seeing the standard robots: ours beside MuJoCo's, in one run.

    make bench            or   .venv/bin/python benches/peers.py

Prints a Markdown table of times and ratios. MuJoCo settles by the rule of the paper's authors: step
until the joints are slower than 1e-3 rad/s and move by less than 1e-6 for 10 steps in a row, at most
10,000 steps. It has no Jacobian of settled poses; two settlings for each tendon, the price of central
differences, stand for it. Its pictures are those of its software OpenGL. Ours and MuJoCo's alternate,
and medians over the rounds are shown.
"""

import json
import os
import pathlib
import statistics
import subprocess
import sys
import time

os.environ.setdefault("MUJOCO_GL", "egl")

import mujoco
import mujoco.rollout
import numpy as np

ROOT = pathlib.Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "tests" / "python"))
from paper_robots import model  # noqa: E402

ROUNDS = 3
ROLLOUTS = 16


def ours():
    """Times of ours by robot (microseconds), and the commands that were settled."""
    command = ["cargo", "bench", "--quiet", "--locked", "--bench", "peers"]
    run = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, check=True, text=True)
    return {times["robot"]: times for times in json.loads(run.stdout)}


def settle(m, command):
    """Seconds until MuJoCo meets the settling rule, and whether it did."""
    began = time.perf_counter()
    d = mujoco.MjData(m)
    d.ctrl[:] = command
    quiet, before = 0, d.qpos.copy()
    for _ in range(10_000):
        mujoco.mj_step(m, d)
        still = np.abs(d.qvel).max() < 1e-3 and np.abs(d.qpos - before).max() < 1e-6
        quiet = quiet + 1 if still else 0
        if quiet == 10:
            break
        before[:] = d.qpos
    return time.perf_counter() - began, quiet == 10


def moving(m, steps):
    """The moving command of benches/peers.rs."""
    k, t = np.arange(steps)[:, None], np.arange(m.nu)[None, :]
    return 0.02 + 0.015 * np.sin(0.01 * k + t)


def step(m):
    """Seconds of one mj_step of 2 ms along the moving command, stepped inside the C library."""
    d = mujoco.MjData(m)
    state = np.zeros((1, mujoco.mj_stateSize(m, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    mujoco.mj_getState(m, d, state[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)
    control = moving(m, 1_000)[None]
    began = time.perf_counter()
    mujoco.rollout.rollout(m, d, state, control)
    return (time.perf_counter() - began) / 1_000


def rollout(m, threads):
    """Seconds of one step of a batch of rollouts on all processors."""
    data = [mujoco.MjData(m) for _ in range(threads)]
    state = np.zeros((ROLLOUTS, mujoco.mj_stateSize(m, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    for row in state:
        mujoco.mj_getState(m, data[0], row, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    control = np.repeat(moving(m, 500)[None], ROLLOUTS, axis=0)
    began = time.perf_counter()
    mujoco.rollout.rollout(m, data, state, control)
    return (time.perf_counter() - began) / (500 * ROLLOUTS)


def render(robot):
    """Seconds that MuJoCo takes for colour, depth and mask images of the robot's cameras."""
    m = mujoco.MjModel.from_xml_path(str(ROOT / "models_xml" / f"{robot}_base.xml"))
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    renderer = mujoco.Renderer(m, m.vis.global_.offheight, m.vis.global_.offwidth)

    def pictures():
        for camera in range(m.ncam):
            renderer.update_scene(d, camera)
            renderer.render()
            renderer.enable_depth_rendering()
            renderer.render()
            renderer.disable_depth_rendering()
            renderer.enable_segmentation_rendering()
            renderer.render()
            renderer.disable_segmentation_rendering()

    pictures()
    began = time.perf_counter()
    pictures()
    seconds = time.perf_counter() - began
    renderer.close()
    return seconds


def measure(threads):
    """Medians over the rounds: by robot and work, ours and MuJoCo's (microseconds)."""
    rounds = []
    for index in range(ROUNDS):
        print(f"round {index + 1} of {ROUNDS}", file=sys.stderr)
        mine = ours()
        rounds.append({robot: one_round(times, model(robot), threads) for robot, times in mine.items()})
    return {
        robot: {work: [statistics.median(r[robot][work][side] for r in rounds) for side in (0, 1)] for work in works}
        for robot, works in rounds[0].items()
    }


def one_round(mine, m, threads):
    settled = [settle(m, command) for command in mine["commands"]]
    met = sum(reached for _, reached in settled)
    print(f"  {mine['robot']}: MuJoCo met the rule for {met} of {len(settled)} commands", file=sys.stderr)
    rest = 1e6 * statistics.median(seconds for seconds, _ in settled)
    return {
        "settle": (mine["settle"], rest),
        "settle along a path": (mine["follow"], rest),
        "Jacobian by the command": (mine["jacobian"], 2 * m.nu * rest),
        "step of 2 ms": (mine["step"], 1e6 * step(m)),
        f"step in a batch, {threads} threads": (mine["rollout"], 1e6 * rollout(m, threads)),
        f"8 cameras of 1280 x 720, {threads} threads": (mine["render"], 1e6 * render(mine["robot"])),
    }


def table(measured):
    """The measurements in Markdown."""
    robots = list(measured)
    lines = ["| ours / MuJoCo (µs), ratio | " + " | ".join(robots) + " |", "|---" * (len(robots) + 1) + "|"]
    for work in measured[robots[0]]:
        cells = []
        for robot in robots:
            mine, theirs = measured[robot][work]
            cells.append(
                f"{mine:.1f} / {theirs:,.0f}, **{theirs / mine:,.0f}x**"
                if theirs / mine >= 100
                else f"{mine:.2f} / {theirs:.1f}, **{theirs / mine:.1f}x**"
            )
        lines.append(f"| {work} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(f"MuJoCo {mujoco.__version__}, {os.cpu_count()} processors", file=sys.stderr)
    print(table(measure(os.cpu_count())))

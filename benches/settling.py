"""What settling costs as modules are added: ours beside MuJoCo's, in one run, on one thread.

    .venv/bin/python benches/settling.py [--figure docs/gallery/cost-beside-mujoco.svg]

Runs examples/studies/settling.toml for some numbers of modules, and gives some of its commands to the same robots in MuJoCo,
which settles by the rule of the paper's authors (benches/peers.py). A command that MuJoCo has not settled within `--seconds`
counts as that long, a bound from below. All times are of the processor, so that what else runs counts little: ours a mean over
200 commands, MuJoCo's a median. Its tip is compared with ours: where it has given up, it still moves. Prints a Markdown table,
and draws it.
"""

import argparse
import csv
import os
import pathlib
import resource
import statistics
import subprocess
import sys
import tempfile
import time

import mujoco
import numpy as np

ROOT = pathlib.Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "tests" / "python"))
import paper_robots  # noqa: E402

MODULES = [1, 2, 3, 5, 8, 12, 20, 30, 40]
# Commands of two studies: the difference of their times is that of settling, and of writing a row.
FEW, MANY = 20, 220


def run(modules, count, out):
    """Processor time (s) of a study of `count` commands of a robot of `modules` modules, and its rows."""
    program = os.environ.get("TDCR", str(ROOT / "target" / "release" / "tdcr"))
    study = (ROOT / "examples" / "studies" / "settling.toml").read_text()
    study = study.replace("range = [1, 40]", f"values = [{modules}]").replace("steps = 40\n", "")
    study = study.replace("count = 50", f"count = {count}")
    folder = pathlib.Path(out) / f"{modules}-{count}"
    folder.mkdir()
    (folder / "study.toml").write_text(study)
    spent = used()
    command = [program, "study", folder / "study.toml", "--threads", "1", "--out", folder / "study", "--quiet"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    with (folder / "study" / "table.csv").open() as table:
        return used() - spent, [row for row in csv.DictReader(table) if row["status"] == "settled"]


def used():
    """Processor time of all programs that were run (s)."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def ours(modules):
    """Processor time (s) for a command of a robot of `modules` modules, and some commands with the tips that they lead to."""
    with tempfile.TemporaryDirectory() as out:
        (few, rows), (many, _) = run(modules, FEW, out), run(modules, MANY, out)
    return (many - few) / (MANY - FEW), rows


def model(modules):
    """2m with so many modules, as MuJoCo's model."""
    paper_robots.ROBOTS[str(modules)] = (modules, *paper_robots.ROBOTS["2m"][1:])
    return paper_robots.model(str(modules))


def settle(m, command, seconds):
    """Processor time (s) until MuJoCo meets the settling rule, whether it did, and where the tip is then."""
    d = mujoco.MjData(m)
    d.ctrl[:] = command
    quiet, before = 0, d.qpos.copy()
    began = time.process_time()
    for _ in range(10_000):
        mujoco.mj_step(m, d)
        still = np.abs(d.qvel).max() < 1e-3 and np.abs(d.qpos - before).max() < 1e-6
        quiet = quiet + 1 if still else 0
        if quiet == 10 or time.process_time() - began > seconds:
            break
        before[:] = d.qpos
    return time.process_time() - began, quiet == 10, d.xpos[-1].copy()


def measure(commands, seconds):
    """By number of modules: ours (s), MuJoCo's (s), how far its tip is off then (m), commands that it settled, all of them."""
    measured = {}
    for modules in MODULES:
        mine, rows = ours(modules)
        m = model(modules)
        chosen = rows[:: max(1, len(rows) // commands)][:commands]
        results = []
        for row in chosen:
            command = [float(row[f"c{k} (m)"]) for k in range(3 * modules)]
            results.append((*settle(m, command, seconds), [float(row[f"tip_{axis} (m)"]) for axis in "xyz"]))
        met = sum(reached for _, reached, _, _ in results)
        theirs = statistics.median(result[0] for result in results)
        off = statistics.median(float(np.linalg.norm(tip - expected)) for _, _, tip, expected in results)
        measured[modules] = (mine, theirs, off, met, len(results))
        said = f"{1e6 * mine:.0f} us, MuJoCo {theirs:.2f} s, settled {met} of {len(results)}"
        print(f"{modules} modules: {said}", file=sys.stderr)
    return measured


def table(measured):
    """The measurements in Markdown."""
    lines = ["| modules | ours (µs) | MuJoCo (s) | ratio | MuJoCo at rest | its tip off by (mm) |", "|---|---|---|---|---|---|"]
    for modules, (mine, theirs, off, met, of) in measured.items():
        least = "" if 2 * met > of else "> "
        ratio = f"{least}{theirs / mine:,.0f}"
        lines.append(f"| {modules} | {1e6 * mine:.0f} | {least}{theirs:.2f} | {ratio} | {met} of {of} | {1e3 * off:.1f} |")
    return "\n".join(lines)


def draw(measured, path, seconds):
    """The measurements as an SVG picture."""
    import matplotlib

    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    plt.rcParams.update({"svg.hashsalt": "tdcr", "font.size": 11, "axes.spines.top": False, "axes.spines.right": False})
    figure, axes = plt.subplots(figsize=(7.2, 4.2), layout="constrained")
    counts = list(measured)
    mine = [measured[count][0] for count in counts]
    theirs = [measured[count][1] for count in counts]
    settled = [2 * measured[count][3] > measured[count][4] for count in counts]
    axes.plot(counts, mine, "o-", color="#0072b2", label="tdcr")
    axes.plot(counts, theirs, "-", color="#d55e00", label="MuJoCo, until it stands still")
    for known, fill in ((True, "#d55e00"), (False, "white")):
        chosen = [(count, time) for count, time, told in zip(counts, theirs, settled, strict=True) if told is known]
        label = None if known else f"not still after {seconds:g} s or 10,000 steps"
        if chosen:
            axes.plot(*zip(*chosen, strict=True), "o", color="#d55e00", markerfacecolor=fill, label=label)
    axes.set(xlabel="Modules (5 discs each)", ylabel="Processor time to settle (s)", yscale="log", title="Cost of settling")
    axes.grid(visible=True, color="#dfe3e8")
    axes.legend(frameon=False)
    figure.savefig(path, metadata={"Date": None})


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--figure", help="draw the times in this file")
    parser.add_argument("--commands", type=int, default=3, help="commands of each robot that MuJoCo gets (default 3)")
    parser.add_argument("--seconds", type=float, default=60.0, help="longest that MuJoCo has for each (default 60)")
    arguments = parser.parse_args()
    print(f"MuJoCo {mujoco.__version__}, one thread", file=sys.stderr)
    measured = measure(arguments.commands, arguments.seconds)
    print(table(measured))
    if arguments.figure:
        draw(measured, arguments.figure, arguments.seconds)


if __name__ == "__main__":
    main()

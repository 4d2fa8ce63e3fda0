"""What a network learns in a given time under other settings, one changed at a time.

    python3 benches/ablation.py OUT             trains, scores, and prints the tables of docs/experiments.md
    python3 benches/ablation.py OUT --pace      times the rows' steps instead, alternating, on a machine that is else idle

OUT is a folder for data set, runs and scores. What it holds already is not made again, and an interrupted run goes on:
start the script again. Needs Python's standard library and `target/release/tdcr` (or TDCR=path); takes an hour and a half.
`--rows NAME,NAME` and `--evaluations N,N` do a part; `--seeds N` trains every row with N seeds, `--steps N` for another time,
`--tests N` scores the first N test commands alone.
"""

import argparse
import json
import os
import pathlib
import resource
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).parent.parent
TDCR = os.environ.get("TDCR", ROOT / "target/release/tdcr")

# As `tdcr demo` makes it: 1,600 training, 200 validation and 200 test commands.
DATA = ["--robot", "2m", "--samples", "2000", "--points", "10000"]
# Name: title, options of `tdcr train`, time of a step in default steps: the processor time of --pace on 2 cores.
ROWS = {
    "default": ("default: Muon, 128 clouds x 128 points, half of the times late, exponent 3", [], 1.0),
    "no-late-times": ("no late times", ["--late-times", "0"], 1.0),
    "no-cut": ("the prior with its tail", ["--prior-cut", "0"], 1.0),
    "no-octaves": ("positions without Fourier features", ["--octaves", "0"], 0.86),
    "plain-times": ("the paper's features of the flow time", ["--time-features", "plain"], 1.0),
    "condition-blocks": ("three blocks between the command and the embedding", ["--condition-blocks", "3"], 1.04),
    "more-points": ("64 clouds x 256 points", ["--clouds", "64", "--points", "256"], 0.91),
    "transport": ("optimal transport within 32 points", ["--coupling", "optimal-transport:32"], 1.34),
    "exponent-1": ("time exponent 1 (uniform times)", ["--time-exponent", "1"], 1.0),
    "exponent-2": ("time exponent 2", ["--time-exponent", "2"], 1.0),
    "exponent-5": ("time exponent 5", ["--time-exponent", "5"], 1.0),
    "no-symmetry": ("every command on its own, not one representative of six", ["--symmetry", "none"], 1.0),
    "adamw": ("AdamW", ["--optimizer", "adamw"], 0.97),
    "adamw-slow": ("AdamW, learning rate 0.003", ["--optimizer", "adamw", "--learning-rate", "0.003"], 0.97),
    "stream": ("fresh samples from the stream", ["--stream", "2m"], 0.95),
    "colors": ("with colours, weight 0.05 (the paper's)", ["--colors"], 1.0),
    "colors-0.5": ("with colours, weight 0.5", ["--colors", "--color-weight", "0.5"], 1.0),
    "colors-0.005": ("with colours, weight 0.005", ["--colors", "--color-weight", "0.005"], 1.0),
    "few-clouds": ("8 clouds x 2,048 points (the paper's kind of batch)", ["--clouds", "8", "--points", "2048"], 0.98),
}
# How the default row's network is used otherwise: options of `tdcr eval`.
USES = {
    "without the last denoising": ["--sampler-denoise", "1"],
    "with 1 % spare points, the isolated ones left out": ["--sampler-spare", "0.01"],
    "without spare points": ["--sampler-spare", "0"],
    "with 100 % spare points": ["--sampler-spare", "1"],
}
# Students of the default row: their evaluations.
STUDENTS = (4,)
EVALUATIONS = (2, 4, 8, 16, 32, 64, 100, 200)
# Title: method, exponent of the time grid, evaluations per step.
SAMPLERS = {
    "`heun`, equal steps (the paper's)": ("heun", 1, 2),
    "`heun`, power 2": ("heun", 2, 2),
    "`euler`, power 2": ("euler", 2, 1),
    "`exponential`, power 2": ("exponential", 2, 1),
    "`exponential3`, power 2": ("exponential3", 2, 1),
}
# Of adaptive steps.
TOLERANCES = (0.003, 0.002, 0.001, 0.0005, 0.0002)
ADAPTIVE = ("adams-bashforth", "exponential", "exponential3")
# Cheap, and the same for all: CD on 4,000 points. The earth mover's distances are not used.
SCORING = ["--points", "4000", "--emd-points", "64", "--worst", "0"]
# The ablation's sampler; 16 evaluations.
SAMPLER = ("exponential", 16, 2)


def tdcr(*arguments):
    """Runs the program; returns what it says as JSON."""
    command = [str(TDCR), *map(str, arguments), "--json", "--quiet"]
    print("+", *command[1:-2], file=sys.stderr, flush=True)
    return json.loads(subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout)


class Study:
    """The folder of an ablation."""

    def __init__(self, out, steps, tests):
        self.out = out
        # Test commands that are scored; all of them where it is None.
        self.tests = [] if tests is None else ["--tests", tests]
        # Of the default row, in the time that every row has.
        self.steps = steps
        self.data = out / "data"
        self.scores_file = out / "scores.json"
        self.scores = json.loads(self.scores_file.read_text()) if self.scores_file.exists() else {}

    def collect(self):
        tdcr("collect", *DATA, "--out", self.data)

    def sources(self, row):
        """Options that say where a row's clouds come from."""
        return ["--validation" if "--stream" in ROWS[row][1] else "--data", self.data]

    def train(self, row, seed=0):
        """Trains a row for its share of the time; returns its steps and the run's name."""
        _, options, pace = ROWS[row]
        steps, run = round(self.steps / pace), row if seed == 0 else f"{row}-seed-{seed}"
        # The tables are of the flow itself.
        plain = [] if "--refinement-steps" in options else ["--refinement-steps", 0]
        tdcr("train", *options, *plain, *self.sources(row), "--steps", steps, "--seed", seed, "--out", self.out / run)
        return steps, run

    def distil(self, evaluations):
        """Trains a student of the default row; returns its name."""
        name = f"student-{evaluations}"
        teacher = self.out / "default/model.safetensors"
        options = ["--evaluations", evaluations, "--out", self.out / name]
        tdcr("distill", "--model", teacher, "--data", self.data, *options)
        return name

    def score(self, run, sampler=None):
        """CD (m^2) of a run's network and of the floor; `sampler` is a method, its steps and power, or the network's own."""
        options = zip(("--sampler", "--sampler-steps", "--sampler-power"), sampler or ())
        key = " ".join(map(str, [run, *(sampler or ["own"])]))
        return self.score_with(key, run, [argument for option in options for argument in option])

    def score_adaptive(self, run, method, tolerance):
        """The same with steps of a tolerance, and the evaluations that a prediction then takes."""
        options = ["--sampler", method, "--sampler-tolerance", tolerance]
        return self.score_with(f"{run} {method} tolerance {tolerance}", run, options)

    def score_with(self, key, run, options):
        key = " ".join(map(str, [key, *self.tests]))
        if key not in self.scores:
            files = ["--model", self.out / run / "model.safetensors", "--data", self.data]
            said = tdcr("eval", *files, *SCORING, *self.tests, *options)
            self.scores[key] = {name: said[name] for name in ("cd", "cd_floor", "evaluations")}
            self.scores_file.write_text(json.dumps(self.scores, indent=1))
        return self.scores[key]


def line(*cells):
    print("|", " | ".join(map(str, cells)), "|", flush=True)


def area(score):
    return f"{score * 1e4:.3f}"


def score_line(title, steps, scores):
    """A row of the table: the mean over seeds, and the scores of each."""
    cds, floor = [score["cd"] for score in scores], scores[0]["cd_floor"]
    mean = sum(cds) / len(cds)
    each = " ".join(map(area, cds)) if len(cds) > 1 else ""
    line(title, steps, area(mean), each, f"{mean / floor:.2f}")


def ablate(study, rows, seeds):
    line("", "steps", "CD (1e-4 m²)", "of each seed", "CD / floor")
    line("---", "---", "---", "---", "---")
    for row in rows:
        runs = [study.train(row, seed) for seed in range(seeds)]
        scores = [study.score(run, SAMPLER) for _, run in runs]
        score_line(ROWS[row][0], f"{runs[0][0]:,}", scores)
        if row == "default":
            for title, options in USES.items():
                used = [study.score_with(f"{run} {title}", run, options) for _, run in runs]
                score_line(f"the same networks {title}", "", used)
    line("sampling floor", "", area(scores[0]["cd_floor"]), "", "1")


def count_evaluations(study, counts):
    line("evaluations", *counts)
    line(*["---"] * (1 + len(counts)))
    study.train("default")
    for title, (method, power, per_step) in SAMPLERS.items():
        scores = (study.score("default", (method, count // per_step, power)) for count in counts)
        line(title, *(area(score["cd"]) for score in scores))
    students = {n: study.score(study.distil(n))["cd"] for n in STUDENTS if n in counts}
    line("after `tdcr distill`", *(area(students[n]) if n in students else "" for n in counts))


def lay_steps(study, tolerances):
    line("tolerance", *tolerances)
    line(*["---"] * (1 + len(tolerances)))
    for method in ADAPTIVE:
        scores = [study.score_adaptive("default", method, tolerance) for tolerance in tolerances]
        line(f"`{method}`", *(f"{area(score['cd'])} ({score['evaluations']:.1f})" for score in scores))


def seconds(study, row, steps):
    """Wall-clock and processor time (s) of a run of `steps` steps."""
    with tempfile.TemporaryDirectory() as out:
        options = ["--steps", steps, "--validate-every", steps, "--out", out]
        began, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
        tdcr("train", *ROWS[row][1], *study.sources(row), *options)
        wall, after = time.monotonic() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def pace(study, rows, rounds=3, few=10, many=70):
    """Prints what a step of each row takes: the least over `rounds` of a long run less a short one."""
    least = {}
    for _ in range(rounds):
        for row in rows:
            for steps in (few, many):
                times = seconds(study, row, steps)
                least[row, steps] = tuple(map(min, times, least.get((row, steps), times)))
    per_step = {row: [(long - short) / (many - few) for long, short in zip(least[row, many], least[row, few])] for row in rows}
    line("", "ms per step", "of the first", "processor ms per step", "of the first")
    line(*["---"] * 5)
    for row, (wall, processor) in per_step.items():
        first = per_step[rows[0]]
        times = (f"{1e3 * wall:.1f}", f"{wall / first[0]:.2f}", f"{1e3 * processor:.1f}", f"{processor / first[1]:.2f}")
        line(row, *times)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--pace", action="store_true", help="time the rows' steps")
    parser.add_argument("--rows", default=",".join(ROWS), help="rows of the ablation, default first")
    parser.add_argument("--evaluations", default=",".join(map(str, EVALUATIONS)), help="columns of the second table")
    parser.add_argument("--seeds", type=int, default=1, help="seeds of each row of the ablation")
    parser.add_argument("--steps", type=int, default=3000, help="steps of the default row")
    parser.add_argument("--tests", type=int, help="test commands to score [default: all 200]")
    arguments = parser.parse_args()
    rows = [row for row in arguments.rows.split(",") if row]
    counts = [int(count) for count in arguments.evaluations.split(",") if count]
    study = Study(arguments.out, arguments.steps, arguments.tests)
    study.collect()
    if arguments.pace:
        pace(study, rows)
        return
    if rows:
        ablate(study, rows, arguments.seeds)
        print()
    if counts:
        count_evaluations(study, counts)
        print()
        lay_steps(study, TOLERANCES)


if __name__ == "__main__":
    main()

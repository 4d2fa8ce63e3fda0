"""How many samples a flow from a simulated surface needs, beside one from noise and beside the simulator alone.

    python3 benches/priors.py OUT     makes sets, runs and scores in the folder OUT, and prints the tables of docs/experiments.md

The data show a robot that the simulator does not know exactly: its backbone is a tenth stiffer than the model's and bent at
rest, a payload hangs from its tip, three D435 cameras with their noise see it from three sides only. Scores are those on other
commands, once on what such cameras see, once on clouds without noise. What OUT holds already is not made again. Needs Python's
standard library and `target/release/tdcr` (or TDCR=path). `--samples`, `--steps` and `--options` change the runs, `--plot FILE`
draws them (by matplotlib).
"""

import argparse
import copy
import json
import os
import pathlib
import subprocess

ROOT = pathlib.Path(__file__).parent.parent
TDCR = os.environ.get("TDCR", ROOT / "target/release/tdcr")

# Training commands; a tenth as many validate.
SAMPLES = (50, 200, 800, 4000)
STEPS = 3000
# Cheap, and the same for all: CD on 4,000 points.
SCORING = ["--points", "4000", "--emd-points", "64", "--worst", "0"]
FLOWS = {
    "flow from noise": [],
    "flow from the simulated surface": ["--coupling", "optimal-transport:32"],
}
# What scores are taken on, with the options of `tdcr collect`.
TESTS = {"as the cameras see it": ["--noise", "d435"], "without noise": []}
# Joints that are stiffer and bent (rad about y), and a tip that is heavier (15 g in its last disc, as a density).
STIFFER, BENT, HEAVIER = 1.1, 0.012, 727.0


def robots(out: pathlib.Path) -> tuple[pathlib.Path, pathlib.Path]:
    """Files of the model and of the robot that it stands for."""
    subprocess.run([TDCR, "export", "--robot", "2m", "--format", "json", "--out", out / "2m.json", "--force", "-q"], check=True)
    model = json.loads((out / "2m.json").read_text())
    model["name"] = "model"
    model["cameras"]["count"] = 3
    for module in model["modules"]:
        module["backbone"] = {"bending": [0.3, 0.3], "torsion": 0.3}
    real = copy.deepcopy(model)
    real["name"] = "reality"
    for module in real["modules"]:
        stiffness = 0.3 * STIFFER
        module["backbone"] = {"bending": [stiffness, stiffness], "torsion": stiffness, "rest": [0.0, BENT, 0.0]}
    density = real["modules"][-1]["mass"]["density"]
    discs = real["modules"][-1]["discs"]
    real["modules"][-1]["mass"]["density"] = [density] * (discs - 1) + [HEAVIER]
    paths = (out / "model.json", out / "reality.json")
    for path, robot in zip(paths, (model, real)):
        path.write_text(json.dumps(robot, indent=1))
    return paths


def scored(model: pathlib.Path, test: pathlib.Path) -> dict[str, float]:
    """CD (1e-4 m²) of a model and of what it is scored beside, on commands that no run saw."""
    command = [TDCR, "eval", "--model", model, "--data", test, *SCORING, "--json", "-q"]
    said = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    scores = {"network": said["cd"], "floor": said["cd_floor"]} | {
        key: other["cd"] for key, other in said.get("others", {}).items()
    }
    return {key: round(1e4 * (cd["mean"] if isinstance(cd, dict) else cd), 4) for key, cd in scores.items()}


def plot(rows: list[dict], path: pathlib.Path) -> None:
    """CD over training commands, a panel for each test set."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, panels = plt.subplots(1, len(TESTS), figsize=(9, 3.6), sharey=True, layout="constrained")
    for panel, test in zip(panels, TESTS, strict=True):
        for flow, color in zip(FLOWS, ("#0072b2", "#d55e00"), strict=True):
            own = [row for row in rows if row["flow"] == flow]
            cds = [row[test]["network"] for row in own]
            panel.plot([row["samples"] for row in own], cds, "o-", color=color, label=flow)
        beside = next(row[test] for row in rows if "simulator" in row[test])
        panel.axhline(beside["simulator"], color="#555555", linestyle="--", label="simulator alone")
        panel.axhline(beside["floor"], color="#555555", linestyle=":", label="sampling floor")
        panel.set(title=test, xscale="log", xlabel="training commands")
        counts = sorted({row["samples"] for row in rows})
        panel.set_xticks(counts, [str(count) for count in counts])
        panel.minorticks_off()
    panels[0].set_ylabel("Chamfer distance (1e-4 m²)")
    panels[0].set_ylim(bottom=0)
    panels[-1].legend(frameon=False)
    figure.savefig(path, dpi=130)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--samples", type=lambda text: [int(n) for n in text.split(",")], default=SAMPLES)
    parser.add_argument("--steps", type=int, default=STEPS)
    parser.add_argument("--options", type=str.split, default=[], help="more options of the flow from the surface")
    parser.add_argument("--plot", type=pathlib.Path, metavar="FILE", help="draw the scores into this file")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    model, real = robots(args.out)

    def collect(name: str, samples: int, seed: int, *options: str) -> pathlib.Path:
        folder = args.out / name
        command = [TDCR, "collect", "--robot", real, "--samples", str(samples), "--points", "4000", "--seed", str(seed)]
        subprocess.run([*command, *options, "--out", folder, "-q"], check=True)
        return folder

    tests = {test: collect(f"test-{number}", 400, 99, *options) for number, (test, options) in enumerate(TESTS.items())}
    print(f"CD x 1e4 (m2), {args.steps} steps")
    scores = []
    for count in args.samples:
        data = collect(f"data-{count}", count * 10 // 8 + 1, 1, "--noise", "d435")
        for flow, options in FLOWS.items():
            folder = args.out / f"{flow.replace(' ', '-')}-{count}-{args.steps}{''.join(args.options)}"
            start = [] if not options else ["--surface-prior", model, *options, *args.options]
            command = [TDCR, "train", "--data", data, "--out", folder, "--steps", str(args.steps)]
            subprocess.run([*command, "--validate-every", "250", *start, "-q"], check=True, stdout=subprocess.DEVNULL)
            row = {test: scored(folder / "model.safetensors", path) for test, path in tests.items()}
            scores.append({"samples": count, "flow": flow} | row)
            print(f"{count:5} {flow:32} {row}", flush=True)
            (args.out / "scores.json").write_text(json.dumps(scores, indent=1))
    if args.plot:
        plot(scores, args.plot)


if __name__ == "__main__":
    main()

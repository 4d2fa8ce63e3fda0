"""How many samples a flow from a simulated surface needs, beside one from noise and beside the simulator alone.

    python3 benches/priors.py OUT     makes sets, runs and scores in the folder OUT, and prints the table of docs/learning.md

The data show a robot that the simulator does not know exactly: its backbone is a tenth stiffer than the model's and bent at
rest, a payload hangs from its tip, three D435 cameras with their noise see it from three sides only. What OUT holds already is
not made again. Needs Python's standard library and `target/release/tdcr` (or TDCR=path). `--samples`, `--steps` and
`--options` change the runs.
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
    """CD (m²) of a model and of what it is scored beside, on clouds without noise of commands that no run saw."""
    command = [TDCR, "eval", "--model", model, "--data", test, *SCORING, "--json", "-q"]
    said = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    scores = {"network": said["cd"]} | {key: other["cd"] for key, other in said.get("others", {}).items()}
    return {key: cd["mean"] if isinstance(cd, dict) else cd for key, cd in scores.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--samples", type=lambda text: [int(n) for n in text.split(",")], default=SAMPLES)
    parser.add_argument("--steps", type=int, default=STEPS)
    parser.add_argument("--options", type=str.split, default=[], help="more options of the flow from the surface")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    model, real = robots(args.out)

    def collect(name: str, samples: int, seed: int, *options: str) -> pathlib.Path:
        folder = args.out / name
        command = [TDCR, "collect", "--robot", real, "--samples", str(samples), "--points", "4000", "--seed", str(seed)]
        subprocess.run([*command, *options, "--out", folder, "-q"], check=True)
        return folder

    test = collect("test", 400, 99)
    print(f"CD x 1e4 (m2), {args.steps} steps")
    for count in args.samples:
        data = collect(f"data-{count}", count * 10 // 8 + 1, 1, "--noise", "d435")
        for flow, options in FLOWS.items():
            folder = args.out / f"{flow.replace(' ', '-')}-{count}-{args.steps}{''.join(args.options)}"
            start = [] if not options else ["--surface-prior", model, *options, *args.options]
            command = [TDCR, "train", "--data", data, "--out", folder, "--steps", str(args.steps)]
            subprocess.run([*command, "--validate-every", "250", *start, "-q"], check=True, stdout=subprocess.DEVNULL)
            rows = scored(folder / "model.safetensors", test)
            figures = {key: round(1e4 * value, 4) for key, value in rows.items()}
            print(f"{count:5} {flow:32} {figures}", flush=True)


if __name__ == "__main__":
    main()

"""Measures `tdcr track` in a scenario like a published one: a closed planar curve of 472 mm, 121 by 131 mm, in 60 s at 10 Hz.

Published for a real tendon-driven robot of 260 mm (three motors): RMS errors of 2.02 mm by Koopman MPC, 7.21 under an input
disturbance, 8.18 beside an obstacle; by iterative learning 1.16, 1.26 and 1.24 in the first trial, 0.97, 1.15 and 1.11 in the
fifth. Here 3m (255 mm), hung by its base, is simulated, its tip measured with noise of 0.1 mm. Prints a Markdown table of RMS
errors (mm) in the first trial and, after the stroke, in the last.

    python benches/published_path.py target/release/tdcr
"""

import argparse
import json
import subprocess
import tempfile
from pathlib import Path

import numpy as np

SIZE = np.array([0.121, 0.131])
LENGTH = 0.472
ROBOT = "examples/hanging-3m.toml"
POST = """
[[obstacle]]
name = "post"
cylinder = {{ radius = 0.005, length = 0.1 }}
position = [{x}, 0.0, {z}]
orientation = [0.7071067811865476, 0.7071067811865476, 0.0, 0.0]
"""


def curve() -> np.ndarray:
    """Points of a rounded triangle of the published width, height and length about the origin, evenly apart (m)."""

    def points(lobes: float) -> np.ndarray:
        angle = np.linspace(0.0, 2.0 * np.pi, 4001)
        out = ((1.0 + lobes * np.cos(3.0 * angle)) * np.array([np.cos(angle), np.sin(angle)])).T
        return np.asarray((out - (out.max(0) + out.min(0)) / 2.0) * SIZE / np.ptp(out, axis=0))

    def along(points: np.ndarray) -> np.ndarray:
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])

    low, high = 0.0, 0.9
    for _ in range(60):
        middle = (low + high) / 2.0
        low, high = (middle, high) if along(points(middle))[-1] < LENGTH else (low, middle)
    found = points(low)
    way = along(found)
    even = np.linspace(0.0, way[-1], 601)
    return np.array([np.interp(even, way, found[:, axis]) for axis in range(2)]).T


def main() -> None:
    """Prints the table row by row."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tdcr")
    parser.add_argument("--height", type=float, default=0.38, help="of the curve's plane (m)")
    parser.add_argument("--controllers", nargs="+", default=["resolved-rate", "mpc"])
    parser.add_argument("--trials", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0, help="of noise and spools")
    parser.add_argument("--post", type=float, nargs=2, default=[0.03, 0.28], help="x and z of the obstacle (m)")
    parser.add_argument("--only", help="the rows whose names have this in them")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path, post = Path(folder, "path.csv"), Path(folder, "post.toml")
        rows = [f"{0.1 * k},{x},{y},{args.height}" for k, (x, y) in enumerate(curve())]
        path.write_text("t,x,y,z\n" + "\n".join(rows) + "\n")
        post.write_text(POST.format(x=args.post[0], z=args.post[1]))
        cases = {
            "none": [],
            "spools 10 % off, backlash 0.1 mm": ["--gain-error", "0.1", "--backlash", "1e-4"],
            "payload 20 g": ["--payload", "0.02"],
            "obstacle that the model does not have": ["--truth-scene", str(post)],
            "obstacle that the model has": ["--scene", str(post)],
        }
        names = [f"`{name}`" for name in args.controllers]
        print(f"| disturbance | in open loop | {' | '.join(names)} |\n|---|{'---|' * (1 + len(names))}")
        for case, options in cases.items():
            if args.only is not None and args.only not in case:
                continue
            cells, open_loop = [], ""
            for controller in args.controllers:
                command = [args.tdcr, "track", "--robot", ROBOT, "--path", str(path), "--period", "0.1", "--noise", "1e-4"]
                command += [*options, "--controller", controller, "--trials", str(args.trials), "--seed", str(args.seed)]
                done = subprocess.run([*command, "--json", "--quiet"], capture_output=True, text=True)
                if done.returncode != 0:
                    cells.append(done.stderr.strip())
                    continue
                found = json.loads(done.stdout)
                trials = [f"{1e3 * error:.2f}" for error in found["trials"] if error is not None]
                cells.append(" / ".join(dict.fromkeys([trials[0], trials[-1]])) + (", stopped" if found["stopped"] else ""))
                open_loop = f"{1e3 * found['rms_error_open_loop']:.2f}"
            print(f"| {case} | {open_loop} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()

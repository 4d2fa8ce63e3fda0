"""Measures `tdcr track`: RMS error of the tip in percent of the length, by controller and disturbance, as a Markdown table.

Circle of 60 mm and figure of eight in 20 s, robots hung by their bases. Cases without chance are run once, the others with each
seed: mean (largest) over the seeds. The open loop is that of the resolved-rate runs.

    python benches/tracking.py target/release/tdcr --seeds 10

`--into docs/control.md` puts the table in the place of the page's own.
"""

import argparse
import json
import subprocess
from pathlib import Path

HEADER = "| robot | path | disturbance | `inverse` | `resolved-rate` | `mpc` |\n|---|---|---|---|---|---|"
CASES = {
    "none": [],
    "payload 20 g": ["--payload", "0.02"],
    "spools 10 % off": ["--gain-error", "0.1"],
    "friction 0.2, backlash 0.1 mm": ["--friction", "0.2", "--backlash", "1e-4"],
    "delay of 2 periods": ["--delay", "0.1"],
    "noise 0.5 mm, 0.2 N": ["--noise", "5e-4", "--tension-noise", "0.2"],
}
ALL = "all but noise"
CASES[ALL] = [
    *CASES["payload 20 g"],
    *CASES["spools 10 % off"],
    *CASES["friction 0.2, backlash 0.1 mm"],
    *CASES["delay of 2 periods"],
]
BY_CHANCE = {"spools 10 % off", "noise 0.5 mm, 0.2 N", ALL}


def run(tdcr: str, robot: str, path: str, controller: str, options: list[str], seed: int) -> dict[str, float | None]:
    """What one run prints."""
    command = [tdcr, "track", "--robot", robot, "--path", path, "--controller", controller, *options, "--seed", str(seed)]
    done = subprocess.run([*command, "--json", "--quiet"], capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(command)}:\n{done.stderr.strip()}")
    found = json.loads(done.stdout)
    if found["stopped"]:
        found["rms_error_percent"] = None
    return found


def cell(values: list[float | None]) -> str:
    """Mean and largest of the runs that went to the end, and how many did not."""
    ended = [value for value in values if value is not None]
    lost = len(values) - len(ended)
    text = "stopped" if not ended else f"{sum(ended) / len(ended):.3f}"
    if len(ended) > 1:
        text += f" ({max(ended):.3f})"
    return text + (f", {lost} of {len(values)} stopped" if lost and ended else "")


def replaced(page: str, table: list[str]) -> str:
    """The page with this table in the place of its own, which ends at the first line that is none of a table."""
    before, found, after = page.partition(HEADER)
    if not found:
        raise SystemExit(f"the page has no table that begins with {HEADER.splitlines()[0]}")
    rest = after.split("\n")[1:]
    while rest and rest[0].startswith("|"):
        rest.pop(0)
    return "\n".join([before + HEADER, *table, *rest])


def main() -> None:
    """Prints the table row by row."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tdcr")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--robots", nargs="+", default=["examples/hanging-2m.toml", "examples/hanging-3m.toml"])
    parser.add_argument("--paths", nargs="+", default=["circle", "eight"])
    parser.add_argument("--into", type=Path, help="the page whose table this becomes")
    args = parser.parse_args()
    print(HEADER)
    table = []
    for robot in args.robots:
        for path in args.paths:
            for case, options in CASES.items():
                seeds = range(args.seeds if case in BY_CHANCE else 1)
                found = {
                    name: [run(args.tdcr, robot, path, name, options, seed) for seed in seeds]
                    for name in ("resolved-rate", "mpc")
                }
                scale = [
                    100 * one["rms_error_open_loop"] * one["rms_error_percent"] / (100 * one["rms_error"])
                    if one["rms_error_percent"] and one["rms_error_open_loop"] is not None
                    else None
                    for one in found["resolved-rate"]
                ]
                closed = [cell([one["rms_error_percent"] for one in runs]) for runs in found.values()]
                name = Path(robot).stem.removeprefix("hanging-")
                table.append(f"| {name} | {path} | {case} | {cell(scale)} | {closed[0]} | {closed[1]} |")
                print(table[-1], flush=True)
    if args.into:
        args.into.write_text(replaced(args.into.read_text(), table))


if __name__ == "__main__":
    main()

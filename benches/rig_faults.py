"""Captures through `tdcr servo-sim` under each of its faults, with slow cameras, and a table of what was kept.

    python benches/rig_faults.py [SAMPLES] [JOBS] [FAULT...]

Each capture has simulated servos of its own behind a pseudo-terminal, in real time, and two cameras whose pictures (of the robot
at home, from a log) come 0.6 to 1.5 s apart, while the servos' watchdog is 0.5 s. Faults of the line last; others come 100 s
after the servos began. A capture that a fault of the line ends is resumed, ten times at the most. In the table are, for each
fault, the samples that were kept, those of them that were taken after the fault came, how captures ended, and the largest
distance between a servo's goal and its position (ticks) in any kept sample. The exit status is 1 where that exceeds
`motion.arrived`, or a label is not the command at which the servos stood. JOBS captures (4) run at once: they wait most of
the time.
"""

import concurrent.futures
import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile
import time

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

ROOT = pathlib.Path(__file__).resolve().parent.parent
TDCR = os.environ.get("TDCR", ROOT / "target/release/tdcr")
SAMPLES = int(sys.argv[1]) if len(sys.argv) > 1 else 200
JOBS = int(sys.argv[2]) if len(sys.argv) > 2 else 4
COMES = 100.0
RUNS = 10
QUICK = 5.0
ARRIVED = 100
RADIUS = 0.005
LINE = ["lost=0.002", "corrupted=0.002", "duplicated=0.002", "late=0.02"]
SERVO = [
    "silent:4",
    "overheated:5",
    "overloaded:5",
    "power-cycled:6",
    "snapped:1",
    "snapped:5",
    "jammed:2",
    "jammed:4",
    "unplugged",
]
FAULTS = sys.argv[3:] or ["none", *LINE, *SERVO]


def rig(servos, cameras):
    """The example's rig with small cameras, and other links."""
    text = (ROOT / "examples/rig-sim.toml").read_text()
    end = [at for at in range(len(text)) if text.startswith("[[cameras]]", at)][2]
    text = text[:end].replace("[640, 480]", "[160, 120]")
    head, tail = text.split("[[cameras]]", 1)
    # The simulated servos stand with 2 N in every tendon.
    head = head.replace('link = "simulated"', servos).replace("home_tension = [6.0]", "home_tension = [2.0]")
    return head + "[[cameras]]" + tail.replace('link = "simulated"', cameras)


def tdcr(*arguments):
    command = [TDCR, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True)


def slow_pictures(folder, seconds):
    """A log of the robot at home, its pictures 0.6 to 1.5 s apart."""
    (folder / "memory.toml").write_text(rig('link = "simulated"', 'link = "simulated"'))
    done = tdcr(
        "capture",
        "--rig",
        folder / "memory.toml",
        "--commands",
        10,
        "--points",
        100,
        "--voxel",
        0.004,
        "--out",
        folder / "memory",
    )
    assert done.returncode == 0, done.stderr
    kept = {}
    with (folder / "memory/log.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.topic.startswith("/cameras/") or channel.topic == "/tf":
                kept.setdefault(channel.topic, []).append((schema, channel, message))
    pictures = [topic for topic in kept if topic.endswith(("/color", "/depth"))]
    with (folder / "slow.mcap").open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start("foxglove", "rig_faults")
        channels = {}

        def write(topic, message, at):
            schema, channel, _ = kept[topic][0]
            if topic not in channels:
                known = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[topic] = writer.register_channel(topic, channel.message_encoding, known, channel.metadata)
            writer.add_message(channels[topic], at, message.data, at)

        for topic in kept:
            if topic not in pictures:
                for _, _, message in kept[topic]:
                    write(topic, message, 0)
        at, number = 0.0, 0
        while at < seconds:
            # At first as fast as cameras are, while they find their exposure.
            at, number = at + (0.033 if at < QUICK else 0.6 + 0.9 * math.modf(0.618 * number)[0]), number + 1
            # Colour before depth, of each camera.
            for topic in sorted(pictures):
                write(topic, kept[topic][0][2], round(1e9 * at))
        writer.finish()
    return folder / "slow.mcap"


def samples(path):
    if not path.exists():
        return []
    entries = [json.loads(line).get("entry", {}) for line in path.read_text().splitlines()]
    last = {entry["index"]: entry for entry in entries if entry.get("kind") == "sample"}
    return list(last.values())


def run(fault, log):
    """One row of the table."""
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        (folder / "paper-robot.toml").write_text((ROOT / "examples/paper-robot.toml").read_text())
        spec = [] if fault == "none" else ["--fault", fault if fault in LINE else f"{fault}@{COMES}"]
        command = [TDCR, "servo-sim", "--robot", folder / "paper-robot.toml", "--quiet", "--seed", "7", *spec]
        servos = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        began = time.monotonic()
        stops, after, seen = [], 0, set()
        try:
            port = servos.stdout.readline().strip()
            links = f'link = {{ serial = "{port}" }}', f'link = {{ recorded = "{log}" }}'
            (folder / "rig.toml").write_text(rig(*links))
            home = tdcr("home", "--rig", folder / "rig.toml", "--here", "--no-log")
            if home.returncode:
                stops.append("home: " + home.stderr.strip().splitlines()[-1])
            for _ in range(RUNS if fault in ["none", *LINE] else 1):
                start = time.monotonic() - began
                out = folder / "data"
                size = "--commands", SAMPLES, "--points", 100, "--voxel", 0.004, "--no-log"
                done = tdcr("capture", "--rig", folder / "rig.toml", *size, "--out", out)
                for sample in samples(out / "capture.jsonl"):
                    key = sample["index"], sample["time"]
                    after += key not in seen and start + sample["time"] > COMES
                    seen.add(key)
                if done.returncode == 0:
                    break
                stops.append(done.stderr.strip().splitlines()[-1])
        finally:
            servos.kill()
            servos.wait()
        found = samples(folder / "data/capture.jsonl")
        off = max((abs(a - b) for s in found for a, b in zip(s["ticks"], s["positions"])), default=0)
        # A label and its positions give one home for each servo.
        tick = RADIUS * math.tau / 4096
        homes = [[c + p * tick for c, p in zip(s["command"], s["positions"])] for s in found]
        spread = max((max(column) - min(column) for column in zip(*homes)), default=0.0)
        return fault, len(found), after, stops, off, spread, time.monotonic() - began


def main():
    bad = False
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        (folder / "paper-robot.toml").write_text((ROOT / "examples/paper-robot.toml").read_text())
        log = slow_pictures(folder, 12.0 * SAMPLES + 120)
        print("fault              kept  after  off (ticks)  minutes  ended by", flush=True)
        with concurrent.futures.ThreadPoolExecutor(JOBS) as pool:
            for row in pool.map(lambda fault: run(fault, log), FAULTS):
                fault, kept, after, stops, off, spread, seconds = row
                shown = "-" if fault in ["none", *LINE] else after
                wrong = off > ARRIVED or spread > 1e-9
                bad |= wrong
                said = "; ".join(stops) or "its end"
                print(
                    f"{fault:18} {kept:4}  {shown:>5}  {off:11}  {seconds / 60:7.1f}  {said}{'  FALSE LABEL' if wrong else ''}",
                    flush=True,
                )
    sys.exit(bad)


if __name__ == "__main__":
    main()

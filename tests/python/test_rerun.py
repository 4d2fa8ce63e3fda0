"""Logs of a rig in Rerun: by its own reader of MCAP, and as `examples/python/log_to_rerun.py` writes them."""

import pathlib
import re
import subprocess
import sys

import pytest
from mcap.reader import make_reader

pytest.importorskip("rerun", reason="rerun-sdk reads logs")

ROOT = pathlib.Path(__file__).parents[2]
SAMPLE = ROOT / "hw/tests/data/sample.mcap"
RERUN = pathlib.Path(sys.executable).parent / "rerun"


def run(*command):
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def columns(recording):
    """Archetypes and types of messages of each entity, without those that only describe the channel."""
    found = {}
    for line in run(RERUN, "rrd", "print", "-v", recording).splitlines():
        if listed := re.search(r" - (/\S*) - .*data columns: \[(.*)\]", line):
            of_entity = found.setdefault(listed[1], set())
            for column in listed[2].split():
                kind = column.split("@", 1)[1].split(":")[0]
                if kind not in ("McapChannel", "McapSchema", "McapStatistics"):
                    of_entity.add(kind)
    return found


@pytest.fixture(scope="module")
def topics():
    with SAMPLE.open("rb") as file:
        return {channel.topic for channel in make_reader(file).get_summary().channels.values()}


def test_rerun_reads_every_channel_of_a_log(tmp_path, topics):
    run(RERUN, "mcap", "convert", SAMPLE, "-o", tmp_path / "log.rrd")
    read = columns(tmp_path / "log.rrd")
    assert topics <= set(read)
    assert all(read[topic] for topic in topics), read
    # What it has types of its own for.
    assert "Points3D" in read["/cloud"] and "TextLog" in read["/events"] and "Transform3D" in read["/tf"]
    assert "EncodedImage" in read["/cameras/0123/color"] and "Pinhole" in read["/cameras/0123/calibration"]


def test_the_example_makes_curves_of_joints_and_depth_of_depth_images(tmp_path, topics):
    recording = tmp_path / "log.rrd"
    run(sys.executable, ROOT / "examples/python/log_to_rerun.py", SAMPLE, "--out", recording)
    read = columns(recording)
    for servo in (1, 2, 3):
        for curve in ("position_rad", "velocity_rad_s", "current_A"):
            assert read[f"/servos/present/servo_{servo}/{curve}"] == {"Scalars"}
    assert read["/command/tendon0"] == {"Scalars"}
    assert any(entity.endswith("temperature_C") for entity in read)
    assert "DepthImage" in read["/cameras/0123/depth"] and "CoordinateFrame" in read["/cameras/0123/depth"]
    drawn = {topic for topic in topics for entity in read if entity == topic or entity.startswith(f"{topic}/")}
    # What describes the rig is not drawn.
    assert topics - drawn == {"/robot_description", "/servos/homes", "/servos/registers"}

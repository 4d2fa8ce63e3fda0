"""What is logged to Rerun, read back by its own reader of recordings."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tdcr
from tdcr.errors import DataError, InputError, MissingPackageError

rerun = pytest.importorskip("rerun")
chunk = pytest.importorskip("rerun.chunk", reason="reads recordings back")

ROBOT = tdcr.Robot("2m")
COMMANDS = ROBOT.random_commands(4, seed=1)


def logged(tmp_path: Path, what: Any, **options: Any) -> dict[str, dict[str, list[Any]]]:
    """Logs to a file; the columns of each entity below ``tdcr``, by component and timeline, rows in order."""
    tdcr.log_to_rerun(what, out=tmp_path / "log.rrd", **options)
    assert [file.name for file in tmp_path.iterdir() if file.name.startswith(".")] == []
    return read(tmp_path / "log.rrd")


def read(file: Path) -> dict[str, dict[str, list[Any]]]:
    found: dict[str, dict[str, list[Any]]] = {}
    for part in chunk.RrdReader(file).stream():
        if part.entity_path.startswith("/tdcr"):
            columns = found.setdefault(part.entity_path[6:], {})
            batch = part.to_record_batch()
            for name in set(batch.schema.names) - {"log_time", "log_tick"}:
                columns.setdefault(name, []).extend(batch.column(name).to_pylist())
    return found


def seconds(values: list[Any]) -> list[float]:
    return [value.total_seconds() for value in values]


def test_a_motion_is_the_robot_in_its_time(tmp_path: Path) -> None:
    motion = tdcr.simulate(ROBOT, COMMANDS, frame_skip=10)
    found = logged(tmp_path, motion, robot=ROBOT)
    discs = found["discs"]
    np.testing.assert_allclose(seconds(discs["time"]), motion.times)
    np.testing.assert_allclose(discs["Cylinders3D:centers"], motion.positions, atol=1e-7)
    # The real part last.
    np.testing.assert_allclose(np.roll(discs["Cylinders3D:quaternions"], 1, axis=-1), motion.quaternions, atol=1e-7)
    np.testing.assert_allclose(discs["Cylinders3D:radii"], [[0.02] * 10])
    np.testing.assert_allclose(discs["Cylinders3D:lengths"], [[0.017] * 10])
    (spine,) = found["backbone"]["LineStrips3D:strips"][2]
    np.testing.assert_allclose(spine[1:], motion.positions[2], atol=1e-7)
    tendons = found["tendons"]["LineStrips3D:strips"][2]
    lengths = [np.linalg.norm(np.diff(path, axis=0), axis=1).sum() for path in tendons]
    np.testing.assert_allclose(lengths, motion.lengths[2], atol=1e-6)
    for tendon in range(6):
        for name, values in (("length_m", motion.lengths), ("tension_N", motion.tensions)):
            (curve,) = np.transpose(found[f"{name}/tendon{tendon}"]["Scalars:scalars"])
            np.testing.assert_array_equal(curve, values[:, tendon])


def test_equilibria_and_batches_of_motions_go_by_rows(tmp_path: Path) -> None:
    settled = tdcr.settle_batch(ROBOT, COMMANDS)
    discs = logged(tmp_path, settled, robot=ROBOT)["discs"]
    assert discs["row"] == [0, 1, 2, 3] and len(discs["Cylinders3D:centers"]) == 4
    at = logged(tmp_path, settled, robot=ROBOT, times=[0.0, 0.5, 1.0, 2.5])["discs"]["time"]
    assert seconds(at) == [0.0, 0.5, 1.0, 2.5]
    # One equilibrium is at whatever time is set.
    one = logged(tmp_path, settled[1], robot=ROBOT)["discs"]
    np.testing.assert_allclose(one["Cylinders3D:centers"], [settled.positions[1]], atol=1e-7)
    motions = tdcr.rollout(ROBOT, COMMANDS.reshape(2, 2, 6), frame_skip=5)
    found = logged(tmp_path, motions, robot=ROBOT)
    np.testing.assert_allclose(found["row_1/discs"]["Cylinders3D:centers"], motions.positions[1], atol=1e-7)


def test_clouds_and_samples_keep_their_points_and_colours(tmp_path: Path, dataset: tdcr.Dataset) -> None:
    found = logged(tmp_path, dataset)
    assert found["cloud"]["sample"] == list(range(20))
    sample = dataset[17]
    np.testing.assert_array_equal(np.float32(found["cloud"]["Points3D:positions"][17]), sample.points)
    packed = np.array(found["cloud"]["Points3D:colors"][17], np.uint32)
    np.testing.assert_array_equal(np.stack([packed >> 24, packed >> 16 & 255, packed >> 8 & 255], axis=1), sample.colors)
    values = [found[f"condition/{k}_{unit}"]["Scalars:scalars"][17] for k, unit in enumerate("mmmmmm")]
    np.testing.assert_array_equal(np.ravel([*values, found["condition/6_kg"]["Scalars:scalars"][17]]), sample.condition)
    points = [one.points for one in dataset.val]
    plain = logged(tmp_path, points)["cloud"]
    assert plain["row"] == [0, 1] and "Points3D:colors" not in plain


def test_pictures_are_taken_by_cameras(tmp_path: Path) -> None:
    fields = ROBOT.to_dict()
    robot = tdcr.Robot(fields | {"cameras": fields["cameras"] | {"count": 2, "resolution": [64, 36]}})
    views = tdcr.render(robot, tdcr.settle(robot, COMMANDS[0]))
    found = logged(tmp_path, views)
    camera = found["camera_1"]
    np.testing.assert_allclose(camera["Transform3D:translation"], [[views[1].position]], atol=1e-7)
    np.testing.assert_allclose(np.reshape(camera["Pinhole:image_from_camera"][-1], (3, 3)).T, views[1].matrix, rtol=1e-6)
    assert "DepthImage:buffer" in found["camera_1/depth"] and "Image:buffer" in found["camera_1/color"]


def test_a_run_is_its_curves(tmp_path: Path, run: tdcr.Run) -> None:
    found = logged(tmp_path, run)
    assert found["loss"]["step"] == [10, 20, 30, 40, 50, 60]
    means = run.losses.reshape(6, 10).mean(axis=1)
    np.testing.assert_allclose(np.ravel(found["loss"]["Scalars:scalars"]), means, rtol=1e-5)
    assert found["validation_cd"]["step"] == run.validation_steps.tolist()
    assert {"gradient_norm", "learning_rate"} < found.keys() and "step" not in found
    assert found.keys() == logged(tmp_path, run.folder).keys()
    broken = tmp_path / "run"
    broken.mkdir()
    (broken / "log.csv").write_text("step,loss\nx,1\n")
    with pytest.raises(DataError, match="log.csv: not the log of a run"):
        tdcr.log_to_rerun(broken, out=tmp_path / "log.rrd")


def test_it_goes_to_the_recording_that_is_given(tmp_path: Path) -> None:
    stream = rerun.RecordingStream("mine")
    stream.save(tmp_path / "mine.rrd")
    tdcr.log_to_rerun(np.zeros((5, 3)), "tdcr/mine", recording=stream)
    stream.disconnect()
    assert len(read(tmp_path / "mine.rrd")["mine/cloud"]["Points3D:positions"][0]) == 5


def test_what_cannot_be_logged_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settled, out = tdcr.settle(ROBOT, COMMANDS[0]), tmp_path / "log.rrd"
    for message, arguments in (
        ("no recording of Rerun is active", {"robot": ROBOT}),
        ("robot is missing", {"out": out}),
        ("what has 10 discs and 6 tendons; the robot has 15 and 9", {"robot": "3m", "out": out}),
        ("ends in .rrd", {"robot": ROBOT, "out": tmp_path / "log.txt"}),
        ("entity is empty", {"robot": ROBOT, "entity": "/", "out": out}),
        ("times go with equilibria", {"robot": ROBOT, "times": [0.0], "out": out}),
    ):
        with pytest.raises(InputError, match=message):
            tdcr.log_to_rerun(settled, **arguments)
    assert not list(tmp_path.iterdir())
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(MissingPackageError, match="pip install rerun-sdk"):
        tdcr.log_to_rerun(settled, robot=ROBOT, out=out)

"""Data sets from Python: made, merged, read."""

from __future__ import annotations

import json
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from by_command_line import command_line, files

import tdcr
from tdcr.errors import DataError, InputError, RobotError


def test_a_data_set_is_that_of_the_command_line(dataset: tdcr.Dataset, folder: Path) -> None:
    out = folder / "by-command"
    options = ["--samples", 20, "--points", 400, "--payload", "0:0.03", "--seed", 3]
    command_line("collect", *options, "--out", out)
    assert files(Path(dataset.path)) == files(out)
    noisy = {"samples": 10, "points": 200, "noise": "d435", "base": True, "design": "sobol", "voxel": 0.004}
    tdcr.collect(tdcr.Robot("3m"), folder / "noisy", **noisy)
    flags = ["--samples", 10, "--points", 200, "--noise", "d435", "--base", "--design", "sobol", "--voxel", 0.004]
    command_line("collect", "--robot", "3m", *flags, "--out", folder / "noisy-by-command")
    assert files(folder / "noisy") == files(folder / "noisy-by-command")


def test_parts_merged_are_one_run(dataset: tdcr.Dataset, folder: Path) -> None:
    parts = [folder / f"part-{number}" for number in (1, 2, 3)]
    for number, part in enumerate(parts, 1):
        made = tdcr.collect("2m", part, samples=20, points=400, payload=(0.0, 0.03), seed=3, part=f"{number}/3")
        assert made is None
    done: list[int] = []
    merged = tdcr.merge(parts[::-1], folder / "merged", progress=done.append)
    assert files(Path(merged.path)) == files(Path(dataset.path))
    assert sum(done) == 2 * 3
    with pytest.raises(DataError, match="holds part 1 of 3 of a data set; merge all 3 first"):
        tdcr.Dataset(parts[0])
    with pytest.raises(DataError, match="1 of 3 parts is missing: 2"):
        tdcr.merge([parts[0], parts[2]], folder / "early")
    with pytest.raises(InputError, match="expected a list of folders"):
        tdcr.merge(str(parts[0]), folder / "early")
    assert not (folder / "early").exists()


def test_a_data_set_says_what_it_is(dataset: tdcr.Dataset) -> None:
    assert len(dataset) == 20
    assert [len(split) for split in (dataset.train, dataset.val, dataset.test)] == [16, 2, 2]
    assert dataset.robot == tdcr.Robot("2m")
    assert (dataset.points, dataset.condition_width, dataset.base) == (400, 7, False)
    assert dataset.payload == (0.0, 0.03)
    assert dataset.condition_units == ("m",) * 6 + ("kg",)
    assert dataset.meta is not None and dataset.meta["seed"] == 3
    assert dataset.check() == []
    assert repr(dataset).endswith("data': 16 train, 2 val, 2 test, 400 points a cloud)")


def test_drawings_are_those_of_the_command_line(dataset: tdcr.Dataset, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = folder / "drawn-by-command"
    for extension in (".html", ".svg", ".png"):
        file = folder / f"drawn{extension}"
        command_line("data", "view", dataset.path, "--clouds", 2, "--out", expected.with_suffix(extension))
        done: list[int] = []
        assert tdcr.data_view(dataset, file, clouds=2, progress=done.append) == file
        assert sum(done) == 20
        assert file.read_bytes() == expected.with_suffix(extension).read_bytes()
    twice = tdcr.data_view([dataset, dataset.path], folder / "twice.svg")
    assert twice.read_text(encoding="utf-8").count("data, 20 tips") == 2
    monkeypatch.chdir(folder)
    assert dataset.view() == Path("data.html") and Path("data.html").is_file()
    [info] = command_line("data", "info", dataset.path)
    assert dataset.info() == info
    for match, sets, out in [
        ("and there are 2; expected one folder", [dataset, dataset], "twice.png"),
        ("expected a name that ends in .html, .svg, .png", dataset, "data.pdf"),
        ("there is no folder 'nowhere'", dataset, "nowhere/data.html"),
        ("data is empty", [], "data.html"),
    ]:
        with pytest.raises(InputError, match=match):
            tdcr.data_view(sets, out)  # type: ignore[arg-type]
    with pytest.raises(DataError, match="there is no data set in"):
        tdcr.data_view("nowhere")


def test_arrays_are_what_h5py_reads(dataset: tdcr.Dataset) -> None:
    units = dataset.normalisation
    for name in ("train", "val", "test"):
        split = dataset.split(name)  # type: ignore[arg-type]
        with h5py.File(Path(dataset.path) / name / "shard-00000.h5") as shard:
            stored = {key: array[:] for key, array in shard.items()}
        assert np.array_equal(split.conditions, stored["motors"])
        assert np.array_equal(split.clouds, stored["data"])
        assert np.array_equal(split.colors, stored["rgb"])
        assert np.array_equal(units.conditions(split.conditions), stored["motors_norm"])
        assert np.array_equal(units.points(split.clouds), stored["data_norm"])
        assert np.allclose(units.metres(stored["data_norm"]), stored["data"], rtol=1e-6)
        assert not units.outside(split.conditions).any()
        dtypes = [array.dtype for array in split.read()]
        assert dtypes == [np.float32, np.float32, np.uint8]
    assert units.outside(split.conditions[0] + 1.0).all()


def test_samples_are_read_by_index_and_in_order(dataset: tdcr.Dataset) -> None:
    whole = np.concatenate([split.clouds for split in (dataset.train, dataset.val, dataset.test)])
    for index in (0, 15, 16, 17, 18, 19, -1, -20):
        assert np.array_equal(dataset[index].points, whole[index])
    assert np.array_equal(np.stack([sample.points for sample in dataset]), whole)
    assert np.array_equal(np.stack([sample.colors for sample in dataset.val]), dataset.val.colors)
    assert [len(s.condition) for s in dataset.test[:]] == [7, 7]
    assert np.array_equal(dataset[15:17][1].points, dataset.val[0].points)
    for index in (20, -21):
        with pytest.raises(IndexError, match=f"sample {index}; expected -20 to 19"):
            dataset[index]
    done: list[int] = []
    dataset.train.read(progress=done.append)
    assert sum(done) == 16


def loaded(split: tdcr.Split) -> Any:
    return split[1].points, pickle.loads(pickle.dumps(split.dataset)) == split.dataset


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_other_processes_read_a_data_set(dataset: tdcr.Dataset, method: str) -> None:
    splits = [dataset.train, dataset.val, dataset.test]
    with multiprocessing.get_context(method).Pool(2) as pool:
        found = pool.map_async(loaded, splits).get(timeout=60.0)
    for split, (points, same) in zip(splits, found, strict=True):
        assert same and np.array_equal(points, split[1].points)


def test_torch_loads_batches_in_workers(dataset: tdcr.Dataset) -> None:
    torch = pytest.importorskip("torch")
    view = dataset.train.torch(normalised=True, colors=True, points=100, seed=5)
    loader = torch.utils.data.DataLoader(view, batch_size=8, shuffle=True, num_workers=2)
    batches = list(loader)
    assert [tuple(batch["points"].shape) for batch in batches] == [(8, 100, 3)] * 2
    conditions = torch.cat([batch["condition"] for batch in batches])
    assert conditions.dtype == torch.float32 and conditions.min() >= 0.0 and conditions.max() <= 1.0
    assert batches[0]["colors"].min() >= 0.0 and batches[0]["colors"].max() <= 1.0
    assert max(batch["points"].norm(dim=-1).max() for batch in batches) <= 1.0 + 1e-6
    again, other = dataset.train.torch(points=100, seed=5), dataset.train.torch(points=100, seed=6)
    assert torch.allclose(view[3]["points"] * dataset.normalisation.scale, again[3]["points"])
    assert not torch.equal(again[3]["points"], other[3]["points"])
    assert torch.equal(dataset.val.torch()[1]["points"], torch.from_numpy(dataset.val[1].points))


def test_torch_is_not_imported_with_the_package() -> None:
    code = "import sys, tdcr; sys.exit('torch' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60.0)


def test_a_collection_that_is_stopped_goes_on(dataset: tdcr.Dataset, folder: Path) -> None:
    out = folder / "stopped"
    arguments: dict[str, Any] = {"samples": 20, "points": 400, "payload": (0.0, 0.03), "seed": 3}

    def stop(count: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tdcr.collect("2m", out, progress=stop, **arguments)
    with pytest.raises(DataError, match="stopped holds an unfinished data set"):
        tdcr.Dataset(out)
    timer = threading.Timer(0.05, lambda: os.kill(os.getpid(), signal.SIGINT))
    timer.start()
    done: list[int] = []
    try:
        tdcr.collect("2m", out, progress=done.append, **arguments)
        timer.join()
    except KeyboardInterrupt:
        done = []
        tdcr.collect("2m", out, progress=done.append, **arguments)
    assert sum(done) in (0, 20)
    assert files(out) == files(Path(dataset.path))


def test_arguments_that_make_no_data_set_are_named(dataset: tdcr.Dataset, folder: Path) -> None:
    def refused(error: type[Exception], match: str, **arguments: Any) -> None:
        with pytest.raises(error, match=match):
            tdcr.collect(**{"out": folder / "none", "samples": 20, "points": 400, **arguments})

    refused(InputError, "9 samples cannot be split 80/10/10", samples=9)
    refused(InputError, "points is 0; expected 1 to 10000000", points=0)
    refused(InputError, "samples is 2.5; expected a whole number", samples=2.5)
    refused(InputError, "`voxel_size` is -0.1, expected a finite length above 0", voxel=-0.1)
    # Cubes whose numbers overflow, so that a cloud is a few points, and one cube for all of a robot.
    refused(InputError, "expected a finite length above 0, from 0.000001 to 1 m", voxel=1e-12)
    refused(InputError, "expected a finite length above 0, from 0.000001 to 1 m", voxel=1e9)
    refused(InputError, r"payload has shape \(3,\); expected \(2,\)", payload=(0.0, 0.1, 0.2))
    refused(InputError, "`payload` is 0.03:0, expected MIN:MAX", payload=(0.03, 0.0))
    refused(InputError, 'design is "random"; expected one of "uniform"', design="random")
    refused(InputError, 'noise is "l515"; expected one of "d435"', noise="l515")
    refused(InputError, "`4/3` is no part, expected I/N", part="4/3")
    refused(InputError, "seed is -1; expected 0 to", seed=-1)
    refused(RobotError, "4m", robot="4m")
    refused(DataError, "holds another data set: its `origin", out=dataset.path)
    assert not (folder / "none").exists()
    with pytest.raises(DataError, match="there is no data set in"):
        tdcr.Dataset(folder / "nowhere")
    with pytest.raises(InputError, match="split 'all'; expected one of train, val, test"):
        dataset.split("all")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="points is 401; expected 1 to 400"):
        dataset.train.torch(points=401)


def test_a_damaged_sample_is_named(dataset: tdcr.Dataset, folder: Path) -> None:
    broken = folder / "broken"
    for name, content in files(Path(dataset.path)).items():
        (broken / name).parent.mkdir(parents=True, exist_ok=True)
        (broken / name).write_bytes(content)
    with h5py.File(broken / "val/shard-00000.h5", "r+") as shard:
        shard["data"][1, 7, 2] = np.nan
    opened = tdcr.Dataset(broken)
    assert np.array_equal(opened.val[0].points, dataset.val[0].points)
    with pytest.raises(DataError, match="shard-00000.h5: dataset `data`: sample 1 holds NaN"):
        opened.val[1]
    with pytest.raises(DataError, match="sample 1 holds NaN"):
        opened.check()
    meta = json.loads((broken / "meta.json").read_text())
    (broken / "meta.json").write_text(json.dumps({**meta, "format": 9}))
    with pytest.raises(DataError, match="the data set is of format 9"):
        tdcr.Dataset(broken)


def test_clouds_are_exported_and_imported_as_by_the_command_line(dataset: tdcr.Dataset, folder: Path) -> None:
    steps: list[int] = []
    assert tdcr.export_clouds(dataset, folder / "clouds", progress=steps.append) == sum(steps) == 20
    clouds = folder / "clouds/train"
    steps.clear()
    again = tdcr.import_clouds(clouds, folder / "imported", points=400, seed=2, progress=steps.append)
    assert sum(steps) == len(again)
    assert len(again) == 16
    command_line("data", "import", clouds, "--out", folder / "by_line", "--points", 400, "--seed", 2)
    assert files(folder / "imported") == files(folder / "by_line")
    with pytest.raises(InputError, match='units is "inch"; expected one of "m", "cm", "mm"'):
        tdcr.import_clouds(clouds, folder / "inches", units="inch")  # type: ignore[arg-type]
    with pytest.raises(DataError, match="nowhere"):
        tdcr.import_clouds(folder / "nowhere", folder / "empty")
    (clouds / "points.las").write_bytes(b"")
    with pytest.warns(UserWarning, match="files that end in .las were passed over"):
        tdcr.import_clouds(clouds, folder / "noted", points=400, seed=2)
    (folder / "others").mkdir()
    (folder / "others/points.xyz").write_text("1 2 3")
    with pytest.raises(DataError, match="there is no cloud to import; its files end in .xyz"):
        tdcr.import_clouds(folder / "others", folder / "empty")


def test_obstacles_that_are_moved_for_each_sample_are_part_of_its_condition(tmp_path: Path) -> None:
    post = tdcr.Obstacle.cylinder("post", 0.01, 0.4, position=(-0.06, 0.0, 0.25))
    scene = tdcr.Scene([tdcr.Obstacle.half_space("floor"), post])
    made = tdcr.collect(
        "2m", tmp_path / "set", samples=12, points=300, scene=scene, vary_obstacles=(0.02, 0.3), payload=(0.0, 0.02)
    )
    assert made is not None and made.condition_width == 6 + 6 + 1
    assert made.vary_obstacles == pytest.approx((0.02, 0.3)) and made.payload == pytest.approx((0.0, 0.02))
    assert made.condition_units == ("m",) * 6 + ("m",) * 3 + ("rad",) * 3 + ("kg",)
    touching = 0
    for sample in made.train:
        command, shift, payload = sample.condition[:6], sample.condition[6:9], sample.condition[12]
        assert np.abs(shift).max() <= 0.02 and np.abs(sample.condition[9:12]).max() <= 0.3
        turn = sample.condition[9:12].astype(np.float64)
        angle = np.linalg.norm(turn)
        quaternion = [np.cos(angle / 2.0), *(np.sin(angle / 2.0) * turn / angle)]
        moved = scene.moved("post", np.add((-0.06, 0.0, 0.25), shift), quaternion)
        settled = tdcr.settle("2m", np.clip(command.astype(np.float64), 0.0, 0.04), float(payload), scene=moved)
        touching += bool(settled.contacts is not None and len(settled.contacts.gap))
        # Points of the cloud are on the robot as it settles there.
        apart = np.linalg.norm(sample.points[:, None] - settled.positions[None], axis=2).min(axis=1)
        assert apart.max() < 0.0235
    assert touching > 0
    stream = tdcr.Stream("2m", scene=scene, vary_obstacles=0.02, points=200)
    assert next(stream).condition.shape == (9,) and stream.normalisation.condition_max.tolist()[6:] == [0.02] * 3
    with pytest.raises(InputError, match="vary_obstacles is 0.02 without obstacles"):
        tdcr.collect("2m", tmp_path / "none", samples=12, vary_obstacles=0.02)
    with pytest.raises(InputError, match="a scene with an obstacle that is not a half space"):
        tdcr.collect("2m", tmp_path / "none", samples=12, scene=tdcr.Scene(scene[:1]), vary_obstacles=0.02)

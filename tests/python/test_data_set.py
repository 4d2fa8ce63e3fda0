"""Data sets that tdcr writes, read with h5py; and the fixture that h5py wrote, made again."""

import json

import check_h5
import h5py
import numpy as np
import pytest


def test_h5py_reads_a_collected_set(tdcr, tmp_path):
    folder = tmp_path / "set"
    counts = tdcr("collect", "--samples", 20, "--points", 500, "--seed", 3, "--out", folder)
    assert (counts["train"], counts["val"], counts["test"]) == (16, 2, 2)
    check_h5.main(folder)


def test_a_collected_cloud_is_where_the_robot_settles(tdcr, settle, tmp_path):
    folder = tmp_path / "set"
    tdcr("collect", "--robot", "3m", "--samples", 10, "--points", 2000, "--out", folder)
    with h5py.File(folder / "test/shard-00000.h5") as file:
        motors, cloud = file["motors"][0], file["data"][0].astype(float)
    discs = np.array(settle("3m", motors)["positions"])
    # The nearest disc centre of every surface point is at most a corner of a disc away.
    nearest = np.linalg.norm(cloud[:, None] - discs, axis=-1).min(axis=1)
    assert nearest.max() <= np.hypot(0.020, 0.008) + 1e-6
    assert nearest.min() >= 0.008 - 1e-6


def read(folder, name):
    """An array of all shards."""
    shards = []
    for path in sorted(folder.glob("*/shard-*.h5")):
        with h5py.File(path) as file:
            shards.append(file[name][()])
    return np.concatenate(shards)


@pytest.mark.parametrize("robot,motors", [("2m", 6), ("3m", 9), ("5m", 15)])
@pytest.mark.parametrize("kind", ["no base", "base", "payload"])
def test_each_of_the_nine_data_sets_can_be_made(tdcr, tmp_path, robot, motors, kind):
    options = {"no base": [], "base": ["--base"], "payload": ["--base", "--payload", "0:0.030"]}[kind]
    folder = tmp_path / "set"
    made = tdcr("collect", "--robot", robot, *options, "--samples", 200, "--points", 500, "--out", folder)
    assert (made["train"], made["val"], made["test"]) == (160, 20, 20)
    check_h5.main(folder, payload=kind == "payload")
    conditions, clouds = read(folder, "motors"), read(folder, "data")
    assert len(np.unique(conditions, axis=0)) == 200
    assert conditions.shape[1] == motors + (kind == "payload")
    # Discs hang from the base's top at 0.174 m; of the base itself much is far below.
    below = (clouds[..., 2] < 0.08).mean()
    assert below > 0.1 if kind != "no base" else below < 0.05
    if kind == "payload":
        payloads = read(folder, "payload")
        assert payloads.min() == 0 and (payloads == 0).mean() < 0.2
        assert 0.02 < payloads.max() <= np.float32(0.03)
    # What the authors' loader does: conditions from motors_norm, points from data_norm, no other knowledge.
    normalised = read(folder, "motors_norm")
    assert normalised.min() == 0 and normalised.max() == 1 and normalised.shape == conditions.shape
    assert np.linalg.norm(read(folder, "data_norm"), axis=-1).max() <= 1 + 1e-6


def test_payload_clouds_are_where_the_robot_settles_under_the_payload(tdcr, settle, tmp_path):
    folder = tmp_path / "set"
    tdcr("collect", "--robot", "2m", "--payload", "0.02:0.03", "--samples", 10, "--points", 2000, "--out", folder)
    conditions, clouds = read(folder, "motors"), read(folder, "data").astype(float)
    loaded = np.argmax(conditions[:, -1])
    discs = np.array(settle("2m", conditions[loaded, :-1], payload=conditions[loaded, -1])["positions"])
    unloaded = np.array(settle("2m", conditions[loaded, :-1])["positions"])
    far = [np.linalg.norm(clouds[loaded][:, None] - d, axis=-1).min(axis=1).max() for d in (discs, unloaded)]
    assert far[0] <= np.hypot(0.020, 0.0085) + 1e-6 < far[1]


def test_clouds_that_numpy_writes_are_imported_and_exported_ones_read(tdcr, rng, tmp_path):
    clouds = tmp_path / "clouds"
    clouds.mkdir()
    points = rng.uniform(-1, 1, (12, 50, 3))
    colors = rng.integers(0, 256, (12, 50, 3), dtype=np.uint8)
    for k in range(12):
        (clouds / f"{k:02}.json").write_text(json.dumps({"ctrl": [k, 6000 - k]}))
        if k % 3 == 0:
            np.savez(clouds / f"{k:02}.npz", points=points[k], rgb=colors[k])
        elif k % 3 == 1:
            np.savez_compressed(clouds / f"{k:02}.npz", data=points[k].astype("f4"), rgb=colors[k])
        else:
            np.save(clouds / f"{k:02}.npy", np.concatenate([points[k], colors[k] / 255], axis=1))
    folder = tmp_path / "set"
    assert tdcr("data", "import", clouds, "--out", folder, "--points", 50)["clouds"] == 12
    check_h5.main(folder)
    motors, data, rgb = (read(folder, name) for name in ("motors", "data", "rgb"))
    for row, k in enumerate(motors[:, 0].astype(int)):
        order, expected = (np.lexsort(a.T) for a in (data[row], points[k].astype("f4")))
        np.testing.assert_array_equal(data[row][order], points[k].astype("f4")[expected])
        np.testing.assert_array_equal(rgb[row][order], colors[k][expected])
    out = tmp_path / "out"
    tdcr("data", "export", folder, "--format", "npz", "--out", out)
    with h5py.File(folder / "val/shard-00000.h5") as file, np.load(out / "val/cloud-00000.npz") as archive:
        np.testing.assert_array_equal(archive["points"], file["data"][0])
        np.testing.assert_array_equal(archive["rgb"], file["rgb"][0])

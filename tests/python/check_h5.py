"""Checks a data set's shards with h5py: `python check_h5.py FOLDER [--payload]`. Prints one line per shard; fails at the
first fault."""

import json
import pathlib
import sys

import h5py
import numpy as np


def check_shard(path, motors_all, points_all, payload):
    with h5py.File(path, "r") as file:
        arrays = {name: dataset[()] for name, dataset in file.items()}
    samples, points, _ = arrays["data"].shape
    motors = len(motors_all["min"])  # the payload counts as one
    layout = {
        "data": ((samples, points, 3), "f4"),
        "rgb": ((samples, points, 3), "u1"),
        "motors": ((samples, motors), "f4"),
        "motors_norm": ((samples, motors), "f4"),
        "data_norm": ((samples, points, 3), "f4"),
        "center": ((samples, 3), "f4"),
        "scale": ((samples,), "f4"),
    }
    if payload:
        layout["payload"] = ((samples,), "f4")
    assert set(arrays) == set(layout), sorted(arrays)
    for name, (shape, dtype) in layout.items():
        found = arrays[name]
        assert (found.shape, found.dtype) == (shape, np.dtype(dtype)), (name, found.shape, found.dtype)
        assert np.isfinite(found).all(), name
    low, scale = np.array(motors_all["min"]), np.array(motors_all["scale"])
    np.testing.assert_array_equal(arrays["center"], 0)
    np.testing.assert_allclose(arrays["scale"], points_all["scale"], rtol=1e-7)
    np.testing.assert_allclose(arrays["data_norm"] * arrays["scale"][:, None, None], arrays["data"], atol=1e-7)
    np.testing.assert_allclose(arrays["motors_norm"], (arrays["motors"] - low) / scale, atol=1e-6)
    if payload:
        np.testing.assert_array_equal(arrays["payload"], arrays["motors"][:, -1])
    return arrays


def main(folder, payload=False):
    motors_all = json.loads((folder / "global_motors_scope-all.json").read_text())["all"]
    points_all = json.loads((folder / "global_norm_scope-all_anchor-origin.json").read_text())["all"]
    assert points_all["center"] == [0, 0, 0]
    low, high, scale = (np.array(motors_all[key]) for key in ("min", "max", "scale"))
    np.testing.assert_allclose(scale, np.where(high > low, high - low, 1), rtol=1e-6)
    motors, radius, counts = [], 0, {}
    for split in ("train", "val", "test"):
        paths = sorted((folder / split).iterdir())
        assert [path.name for path in paths] == [f"shard-{k:05}.h5" for k in range(len(paths))], paths
        for path in paths:
            arrays = check_shard(path, motors_all, points_all, payload)
            motors.append(arrays["motors"])
            radius = max(radius, np.linalg.norm(arrays["data"].astype("f8"), axis=-1).max())
            counts[split] = counts.get(split, 0) + len(arrays["motors"])
            print(f"{path.relative_to(folder)}: data {arrays['data'].shape}, motors {arrays['motors'].shape}: good")
    motors = np.concatenate(motors)
    np.testing.assert_array_equal(motors.min(axis=0), low.astype("f4"))
    np.testing.assert_array_equal(motors.max(axis=0), high.astype("f4"))
    np.testing.assert_allclose(radius, points_all["scale"], rtol=1e-7)
    meta = folder / "meta.json"
    if meta.exists():
        assert sum(counts.values()) == json.loads(meta.read_text())["count"], counts


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]), payload="--payload" in sys.argv[2:])

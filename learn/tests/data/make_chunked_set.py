"""Writes chunked/ beside this file, a data set as another program would: by h5py, points and colours in gzipped chunks, no
meta.json; and latest.h5, the shard of its validation split with libver="latest" (of HDF5 2.0: chunks of layout version 5).

Sample i of a split, point k: motors[j] = 0.01 (i + j), data = (0.1 k, 0.01 i, -0.2), rgb = (k, i, 255).
"""

import json
import pathlib

import h5py
import numpy as np

POINTS, MOTORS = 5, 2
FOLDER = pathlib.Path(__file__).parent / "chunked"
COMPRESSED = {"chunks": (1, POINTS, 3), "compression": "gzip", "shuffle": True}
SAMPLES = {"train": [3, 2], "val": [1], "test": [1]}  # per shard


def samples(first, count):
    i = np.arange(first, first + count)
    motors = 0.01 * (i[:, None] + np.arange(MOTORS))
    k = np.arange(POINTS)
    ones = np.ones((count, POINTS))
    data = np.stack([0.1 * k * ones, 0.01 * i[:, None] * ones, -0.2 * ones], axis=-1)
    rgb = np.stack([k * ones, i[:, None] * ones, 255 * ones], axis=-1)
    return motors.astype("f4"), data.astype("f4"), rgb.astype("u1")


def main():
    longest = max(sum(shards) for shards in SAMPLES.values())
    motors, data, _ = samples(0, longest)
    low, high = motors.min(axis=0), motors.max(axis=0)
    scale = np.linalg.norm(data, axis=-1).max()
    FOLDER.mkdir(parents=True, exist_ok=True)
    statistics = {"min": low.tolist(), "max": high.tolist(), "scale": (high - low).tolist()}
    (FOLDER / "global_motors_scope-all.json").write_text(json.dumps({"all": statistics}))
    statistics = {"center": [0.0, 0.0, 0.0], "scale": float(scale)}
    (FOLDER / "global_norm_scope-all_anchor-origin.json").write_text(json.dumps({"all": statistics}))
    for split, shards in SAMPLES.items():
        (FOLDER / split).mkdir(exist_ok=True)
        first = 0
        for shard, count in enumerate(shards):
            motors, data, rgb = samples(first, count)
            arrays = {
                "data": data,
                "rgb": rgb,
                "motors": motors,
                "motors_norm": (motors - low) / (high - low),
                "data_norm": data / scale,
                "center": np.zeros((count, 3), "f4"),
                "scale": np.full(count, scale, "f4"),
            }
            write(FOLDER / split / f"shard-{shard:05}.h5", arrays)
            if split == "val":
                write(FOLDER.parent / "latest.h5", arrays, libver="latest")
            first += count


def write(path, arrays, **options):
    with h5py.File(path, "w", **options) as file:
        for name, array in arrays.items():
            compressed = COMPRESSED if name in ("data", "rgb") else {}
            file.create_dataset(name, data=array, **compressed)


if __name__ == "__main__":
    main()

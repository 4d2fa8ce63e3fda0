"""Data sets that tdcr writes, read with h5py; and the fixture that h5py wrote, made again."""

import pathlib
import shutil

import check_h5
import h5py
import numpy as np


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

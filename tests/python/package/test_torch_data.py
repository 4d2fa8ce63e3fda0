"""Clouds for PyTorch: shares of ranks and workers are disjoint, and streams work in forked and spawned workers."""

import itertools
import json

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="no PyTorch here: install tests/python/requirements-torch.txt")

import h5py  # noqa: E402
from torch.utils.data import DataLoader  # noqa: E402

import tdcr as package  # noqa: E402
from tdcr.errors import TdcrError  # noqa: E402
from tdcr.stream import Stream  # noqa: E402
from tdcr.torch import CloudSet, SetSamples, StreamSamples  # noqa: E402
from tdcr.torch.data import StreamWindow  # noqa: E402

#: Time within which a sample of a worker arrives (s): one that hangs fails the test.
LIMIT = 60


def stream(**settings):
    """A stream of a robot that few pixels see, quick to make."""
    robot = package.Robot("2m").to_dict()
    robot["cameras"]["resolution"] = [160, 90]
    return Stream(robot, points=30, seed=3, **settings)


def first(loader, count):
    return [(condition.numpy(), rows.numpy()) for condition, rows in itertools.islice(loader, count)]


def test_samples_of_a_stream_depend_on_the_index_alone():
    samples = list(itertools.islice(stream(), 7))
    assert [len(sample.points) for sample in samples] == 7 * [30]
    for start, stride in ((0, 3), (1, 2), (5, 1)):
        other = list(itertools.islice(stream(start=start, stride=stride), 2))
        for found, expected in zip(other, samples[start::stride], strict=False):
            for part in ("condition", "points", "colors"):
                np.testing.assert_array_equal(getattr(found, part), getattr(expected, part))
    units = stream().normalisation
    normalised = stream().next_normalised()
    np.testing.assert_array_equal(normalised.condition, units.conditions(samples[0].condition))
    np.testing.assert_array_equal(normalised.points, units.points(samples[0].points))
    ranges = package.Robot("2m").command_ranges
    np.testing.assert_array_equal([units.condition_min, units.condition_max], ranges.T)


def test_settings_of_no_stream_are_refused():
    for settings, words in (
        ({"noise": "kinect"}, "kinect"),
        ({"points": 0}, "expected 1 to"),
        ({"voxel": 0.0}, "voxel_size. is 0"),
        ({"payload": (0.2, 0.1)}, "MIN <= MAX"),
    ):
        with pytest.raises(TdcrError, match=words):
            Stream(**settings)


def test_ranks_and_workers_get_disjoint_shares_of_a_set_by_stride():
    count = 11
    clouds = CloudSet(torch.arange(count, dtype=torch.float32)[:, None], torch.zeros(count, 2, 3), {})
    for ranks, workers in ((1, 0), (2, 0), (2, 2)):
        seen = []
        for rank in range(ranks):
            dataset = SetSamples(clouds, rank=rank, ranks=ranks)
            loader = DataLoader(dataset, batch_size=None, num_workers=workers, timeout=LIMIT if workers else 0)
            own = [int(condition) for condition, _ in loader]
            assert own == list(range(rank, count, ranks))
            seen += own
        assert sorted(seen) == list(range(count))
    shuffled = SetSamples(clouds, seed=1)
    order = [int(condition) for condition, _ in shuffled]
    shuffled.set_epoch(1)
    assert sorted(order) == list(range(count))
    assert order != [int(condition) for condition, _ in shuffled] != list(range(count))


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_workers_of_every_rank_make_disjoint_shares_of_a_stream(method):
    # These make the pool of this process, of whose threads a forked child has none.
    expected = [stream().at(k).next_normalised() for k in range(8)]
    ranks, workers = (2, 2) if method == "fork" else (2, 1)
    for rank in range(ranks if method == "fork" else 1):
        dataset = StreamSamples(stream(), rank=rank, ranks=ranks)
        loader = DataLoader(dataset, batch_size=None, num_workers=workers, timeout=LIMIT, multiprocessing_context=method)
        for found, sample in zip(first(loader, 4), expected[rank::ranks], strict=True):
            np.testing.assert_array_equal(found[0], sample.condition)
            np.testing.assert_array_equal(found[1], sample.points)


@pytest.mark.parametrize("fresh", [1.0, 0.4, 3.0])
def test_a_window_slides_over_the_newest_samples(fresh):
    samples = [stream().at(k).next_normalised().condition for k in range(20)]
    window = StreamWindow(stream(), clouds=4, fresh=fresh)
    for step in (1, 2, 3, 4, 5, 2):
        start = int((step - 1) * fresh)
        found = window.at_step(step).conditions.numpy()
        expected = np.array(samples[start : start + 4])
        np.testing.assert_array_equal(found[np.lexsort(found.T)], expected[np.lexsort(expected.T)])
    halves = []
    for rank in range(2):
        half = StreamWindow(stream(), clouds=4, fresh=fresh, rank=rank, ranks=2)
        halves.append(half.at_step(3).conditions.numpy())
    both, start = np.concatenate(halves), int(2 * fresh)
    expected = np.array(samples[start : start + 4])
    np.testing.assert_array_equal(both[np.lexsort(both.T)], expected[np.lexsort(expected.T)])


def test_clouds_of_a_data_set_are_those_of_its_files(tdcr, tmp_path):
    tdcr("collect", "--samples", 10, "--points", 40, "--payload", "0:0.03", "--out", tmp_path)
    clouds = CloudSet.read(tmp_path, "train", colors=True)
    with h5py.File(tmp_path / "train/shard-00000.h5") as file:
        stored = {name: file[name][()] for name in ("data_norm", "rgb", "motors_norm", "motors")}
    np.testing.assert_allclose(clouds.rows[..., :3], stored["data_norm"], atol=1e-6)
    np.testing.assert_allclose(255 * clouds.rows[..., 3:], stored["rgb"], atol=1e-4)
    np.testing.assert_allclose(clouds.conditions, stored["motors_norm"], atol=1e-6)
    meta = json.loads((tmp_path / "meta.json").read_text())
    assert clouds.provenance["subject"] == meta["origin"]["simulated"]["recipe"]["subject"]
    doubled = clouds.provenance["normalisation"] | {"scale": 2 * clouds.provenance["normalisation"]["scale"]}
    again = CloudSet.read(tmp_path, "train", units=doubled)
    np.testing.assert_allclose(2 * again.rows, clouds.rows[..., :3], atol=1e-6)
    with pytest.raises(TdcrError, match="tset"):
        CloudSet.read(tmp_path, "tset")
    with pytest.raises(TdcrError, match="nowhere"):
        CloudSet.read(tmp_path / "nowhere")

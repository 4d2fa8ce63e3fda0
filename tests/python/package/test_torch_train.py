"""Training in PyTorch: on one rank and on two, interrupted and resumed, on a data set and on a stream."""

import csv
import errno
import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="no PyTorch here: install tests/python/requirements-torch.txt")

from tdcr import Stream, _tdcr  # noqa: E402
from tdcr.torch import CloudSet, Model, Trainer, preset, write_predictions  # noqa: E402
from tdcr.torch.batch import draw  # noqa: E402
from tdcr.torch.schedule import average_decay_at, learning_rate_at  # noqa: E402
from tdcr.torch.train import main  # noqa: E402
from tdcr.torch.trainer import Diverged, Interrupted  # noqa: E402

# Tiny networks, beside other processes: more threads than one would wait for each other.
torch.set_num_threads(1)

HERE = pathlib.Path(__file__).parent
ROOT = HERE.parents[2]
sys.path.insert(0, str(HERE))
from torch_ranks import SIZE, STEPS, on_set, on_stream  # noqa: E402


@pytest.fixture(scope="module")
def data(tdcr, tmp_path_factory):
    folder = tmp_path_factory.mktemp("torch") / "data"
    tdcr("collect", "--samples", 40, "--points", 300, "--out", folder)
    return folder


@pytest.fixture(scope="module")
def ranks(data, tmp_path_factory):
    """The folders of torch_ranks.py, run by torchrun on two ranks with Gloo."""
    folder = tmp_path_factory.mktemp("ranks")
    launcher = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "CUDA_VISIBLE_DEVICES": ""}
    command = [*launcher, HERE / "torch_ranks.py", data, folder]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, timeout=300)
    assert done.returncode == 0, done.stderr
    return folder


def log(folder):
    """Columns of a run's log."""
    with (folder / "log.csv").open() as file:
        rows = list(csv.DictReader(file))
    return {key: np.array([float(row[key] or "nan") for row in rows]) for key in rows[0]}


def same(a, b):
    """Whether two runs ended with the same bytes."""
    return all((a / name).read_bytes() == (b / name).read_bytes() for name in ("model.safetensors", "log.csv"))


def test_a_run_on_two_ranks_learns_and_is_that_on_one(data, ranks, tmp_path):
    assert main(on_set(data, tmp_path)) == 0
    one, two = log(tmp_path), log(ranks / "whole")
    assert list(two["step"]) == [10, 20, 30, 40, 50, 60]
    for key in one:
        np.testing.assert_allclose(one[key], two[key], rtol=1e-3, err_msg=key)
    # Steps see other clouds at other times, so losses scatter; the mean of a constant velocity is 0.36.
    assert two["loss"][-1] < 0.6 * two["loss"][0]
    assert two["validation_cd"][-1] < 0.5 * two["validation_cd"][1]


def test_a_run_that_was_interrupted_ends_as_one_that_was_not(ranks):
    assert same(ranks / "resumed", ranks / "whole")


def test_rust_has_the_velocities_of_the_written_network_and_scores_it(tdcr, data, ranks):
    path = ranks / "whole/model.safetensors"
    model = Model.load(path)
    generator = torch.Generator().manual_seed(4)
    points, times = torch.randn(3, 50, 3, generator=generator), torch.rand(3, generator=generator)
    conditions = torch.rand(3, model.shape["condition_dim"], generator=generator)
    with torch.no_grad():
        expected = model.network(points, times, conditions).numpy()
    found = _tdcr.velocities(str(path), points.numpy(), times.numpy(), conditions.numpy())
    assert np.abs(found - expected).max() < 1e-5 * np.abs(expected).max()
    assert model.provenance["subject"]["robot"]["name"] == "2m"
    scores = tdcr("eval", "--model", path, "--data", data, "--points", 200, "--emd-points", 50)
    assert scores["cd"] < 0.1


def test_a_stream_trains_on_ranks_with_workers_and_resumes(ranks, tmp_path):
    assert list(log(ranks / "stream")["step"]) == [10, 20]
    assert Model.load(ranks / "stream/model.safetensors").step in (10, 20)
    assert main(on_stream(tmp_path / "whole")) == 0
    # State and log of the step that an interruption leaves.
    half, whole = (on_stream(tmp_path / name) for name in ("half", "whole"))
    calls = iter([True])
    take = Trainer.__init__

    def stopped(self, *arguments, **options):
        take(self, *arguments, **(options | {"interrupted": lambda: next(calls, False)}))

    Trainer.__init__ = stopped
    try:
        assert main(half) == 130
    finally:
        Trainer.__init__ = take
    assert main(half) == 0
    assert same(tmp_path / "half", tmp_path / "whole")
    assert main(whole) == 0


def test_mixed_precision_muon_colours_and_a_hybrid_train(data, tmp_path):
    tiny = ["--channels", "8,8,8", "--resolutions", "5,4,3", "--blocks", "1", "--context", "8", "--colors"]
    small = ["--width", "32", "--depth", "2", "--embedding", "16", "--clouds", "4", "--points", "64", "--quiet"]
    run = ["--net", "hybrid", *tiny, *small, "--steps", "20", "--validate-every", "20", "--precision", "bfloat16"]
    assert main(["--data", str(data), "--out", str(tmp_path / "run"), *run]) == 0
    losses = log(tmp_path / "run")["loss"]
    assert losses[1] < losses[0]
    model = Model.load(tmp_path / "run/model.safetensors")
    assert (model.settings["precision"], model.colors) == ("bfloat16", True)
    # Another run may start from it.
    again = ["--data", str(data), "--out", str(tmp_path / "again"), *run, "--init", str(tmp_path / "run/model.safetensors")]
    assert main(again) == 0
    assert log(tmp_path / "again")["loss"][0] < losses[0]


def test_a_run_learns_representatives_and_predicts_as_the_command_line(tdcr, data, tmp_path, capsys):
    """Three tendons permuted are one task; the network is told which view of it."""
    small = ["--width", "32", "--depth", "2", "--embedding", "16", "--clouds", "4", "--points", "64", "--steps", "20"]
    for name, options in (("run", []), ("plain", ["--symmetry", "none"])):
        assert main(["--data", str(data), "--out", str(tmp_path / name), *small, *options]) == 0
    said = capsys.readouterr().err
    assert "symmetry: 6 tendon permutations (3 rotations, 3 reflections), seen in 3 views" in said
    assert "symmetry: none, as asked for" in said
    model, plain = (Model.load(tmp_path / name / "model.safetensors") for name in ("run", "plain"))
    assert (model.shape["condition_dim"], plain.shape["condition_dim"]) == (9, 6)
    assert "reduction" not in plain.provenance
    command = [0.03, 0.01, 0.02, 0.0, 0.02, 0.015]
    for trained, folder in ((model, "run"), (plain, "plain")):
        tdcr("predict", "--model", tmp_path / folder / "model.safetensors", "--precision", "float32",
             "--command", ",".join(map(str, command)), "--points", 200, "--out", tmp_path / "cloud.npz")  # fmt: skip
        with np.load(tmp_path / "cloud.npz") as file:
            expected = file["points"].reshape(-1, 3)
        found = trained.predict([command], 200).points[0]
        np.testing.assert_allclose(found, expected, atol=1e-4)
    # What is mirrored as the cameras are is seen in the same view: the cloud is mirrored.
    reflection = next(one for one in model.provenance["reduction"]["symmetries"] if one["tendons"] == [0, 2, 1, 3, 5, 4])
    mirrored = [command[k] for k in reflection["tendons"]]
    cloud, image = (model.predict([values], 200).points[0] for values in (command, mirrored))
    np.testing.assert_allclose(image, cloud @ np.array(reflection["matrix"]).T + reflection["translation"], atol=1e-6)
    # A run starts only at what learned by the same symmetries; auto takes those of the model.
    start = ["--data", str(data), *small, "--init"]
    assert main([*start, str(tmp_path / "plain/model.safetensors"), "--out", str(tmp_path / "on")]) == 0
    refused = [*start, str(tmp_path / "run/model.safetensors"), "--out", str(tmp_path / "off"), "--symmetry", "none"]
    assert main(refused) == 1
    assert "learned by other symmetries" in capsys.readouterr().err


def test_a_reduced_stream_is_that_of_representatives():
    stream = Stream(points=30, seed=3)
    reduction, words = stream.find_reduction()
    assert words.startswith("6 tendon permutations") and len(reduction["symmetries"]) == len(reduction["views"]) == 6
    reduced = stream.reduced(reduction)
    for _ in range(3):
        plain, sample = next(stream), next(reduced)
        assert (np.diff(sample.condition[:3]) >= 0).all()
        assert sorted(plain.condition) == sorted(sample.condition)
        ways = (
            np.array(one["matrix"]) @ plain.points.T + np.array(one["translation"])[:, None] for one in reduction["symmetries"]
        )
        assert min(np.abs(way.T - sample.points).max() for way in ways) < 1e-6
    told = reduced.next_normalised().condition
    assert told.shape == (9,) and sorted(told[6:]) == [0, 0, 1]
    assert reduced.provenance["reduction"] == reduction
    assert reduced.at(5).provenance["reduction"] == reduction


def test_the_authors_hybrid_trains_by_their_procedure_and_rust_predicts_with_it(tdcr, data, tmp_path):
    tiny = ["--channels", "8,16,8", "--resolutions", "5,4,3", "--blocks", "1", "--context", "8", "--no-colors"]
    small = ["--width", "32", "--depth", "2", "--embedding", "16", "--clouds", "10", "--points", "64", "--quiet"]
    length = ["--steps", "20", "--validate-every", "20", "--learning-rate", "3e-3", "--precision", "float32"]
    run = ["--data", str(data), "--preset", "paper", "--net", "hybrid", *tiny, *small, *length]
    assert main([*run, "--out", str(tmp_path)]) == 0
    entries = log(tmp_path)
    assert entries["loss"][-1] < 0.9 * entries["loss"][0]
    path = tmp_path / "model.safetensors"
    model = Model.load(path)
    assert (model.settings["procedure"], model.shape["context"]["layers"]) == ("authors", "pvcnn")
    norm = "ctx_net.stages.0.blocks.0.pvconv.voxel_layers.1.running_var"
    assert (model.network.state_dict()[norm] != 1).all()
    generator = torch.Generator().manual_seed(4)
    points, conditions = torch.randn(2, 50, 3, generator=generator), torch.rand(2, 6, generator=generator)
    times = torch.tensor([0.5, 0.98])
    with torch.no_grad():
        expected = model.network(points, times, conditions).numpy()
    found = _tdcr.velocities(str(path), points.numpy(), times.numpy(), conditions.numpy())
    assert np.abs(found - expected).max() < 1e-5 * np.abs(expected).max()
    scores = tdcr("eval", "--model", path, "--data", data, "--points", 200, "--emd-points", 50, "--sampler-steps", 5)
    assert np.isfinite(scores["cd"])
    # The trainer in Rust says where it is trained.
    binary = os.environ.get("TDCR") or str(ROOT / "target/release/tdcr")
    command = [binary, "train", *run[:-2], "--out", tmp_path / "never"]
    refused = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    assert refused.returncode == 1
    assert "python -m tdcr.torch.train" in refused.stderr


def test_an_epoch_of_the_authors_has_each_cloud_once_and_drops_what_fills_no_batch():
    clouds = CloudSet(torch.arange(11.0)[:, None], torch.zeros(11, 4, 3), {})
    settings = preset("paper").settings(steps=100, clouds=3, points=2)
    at = lambda step, **rank: draw(clouds, settings, step, epochs=True, **rank)[2].flatten().tolist()  # noqa: E731
    first, second = ([cloud for step in steps for cloud in at(step)] for steps in ((1, 2, 3), (4, 5, 6)))
    assert len(set(first)) == len(set(second)) == 9
    assert first != second
    assert sorted(at(2, rank=0, ranks=3) + at(2, rank=1, ranks=3) + at(2, rank=2, ranks=3)) == sorted(at(2))


def test_rates_and_average_of_the_authors():
    theirs = preset("paper").settings(steps=1000, warmup_steps=100)
    ours = theirs | {"procedure": "project"}
    assert learning_rate_at(theirs, 1) == theirs["learning_rate"]
    for step in (2, 50, 101, 700):
        assert learning_rate_at(theirs, step) == learning_rate_at(ours, step - 1)
    assert [average_decay_at(theirs, step) for step in (1, 500)] == [0.999, 0.999]
    assert average_decay_at(ours, 1) == 2 / 11


def test_batches_larger_than_the_set_are_refused_where_clouds_are_not_replaced(data, tmp_path):
    with pytest.raises(ValueError, match="clouds is 33, expected at most the 32 clouds of the training set"):
        trainer(data, tmp_path, changes={"procedure": "authors", "clouds": 33})


class Still(torch.nn.Module):
    """A network of one's own that has nearly nothing to learn."""

    def __init__(self):
        super().__init__()
        self.velocity = torch.nn.Linear(6, 3)

    def forward(self, x, t, c):
        return self.velocity(c)[:, None].expand_as(x)


def trainer(data, out, module=None, **options):
    training, validation = (CloudSet.read(data, split) for split in ("train", "val"))
    changes = {"steps": 60, "clouds": 4, "points": 32, "validate_every": 20, "optimizer": "adam-w"}
    settings = preset().settings(**(changes | options.pop("changes", {})))
    return Trainer(module or Still(), training, validation, settings, out, **options)


def test_a_network_of_ones_own_is_trained_and_scored(tdcr, data, tmp_path, monkeypatch):
    run = trainer(data, tmp_path)
    model = run.run()
    assert run.history.losses[-1] < run.history.losses[0]
    again = Model.load(tmp_path / "model.safetensors", Still())
    assert all(torch.equal(a, b) for a, b in zip(again.network.parameters(), model.network.parameters(), strict=True))
    write_predictions(tmp_path / "clouds.npz", again, data, points=200)
    scored = tdcr("eval", "--predictions", tmp_path / "clouds.npz", "--data", data, "--points", 200, "--emd-points", 50)
    assert scored["tests"] == 4
    assert scored["cd"] > scored["cd_floor"]
    # The first alone; a full disk leaves the file before.
    write_predictions(tmp_path / "clouds.npz", again, data, points=200, first=1)
    options = ["--data", data, "--points", 200, "--emd-points", 50, "--tests", 1]
    assert tdcr("eval", "--predictions", tmp_path / "clouds.npz", *options)["tests"] == 1
    before = (tmp_path / "clouds.npz").read_bytes()

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "no space left")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="no space left"):
        write_predictions(tmp_path / "clouds.npz", again, data, points=200)
    assert (tmp_path / "clouds.npz").read_bytes() == before


def test_patience_ends_a_run(data, tmp_path):
    run = trainer(data, tmp_path, changes={"patience": 1, "validate_every": 10, "steps": 1000, "learning_rate": 1e-12})
    run.run()
    assert run.step < 100


def test_a_run_that_diverges_stops_and_keeps_its_last_state(data, tmp_path):
    class Bursting(Still):
        steps = 0

        def forward(self, x, t, c):
            self.steps += self.training
            return super().forward(x, t, c) * (float("inf") if self.steps > 50 else 1)

    with pytest.raises(Diverged, match="the loss of step 51 is"):
        trainer(data, tmp_path, Bursting()).run()
    assert (tmp_path / "state.pt").exists()


def test_a_folder_with_another_run_is_refused(data, tmp_path):
    torch.manual_seed(0)
    trainer(data, tmp_path).run()
    torch.manual_seed(0)
    with pytest.raises(RuntimeError, match=r"learning_rate is 0\.02, expected 0\.01"):
        trainer(data, tmp_path, changes={"learning_rate": 0.01}).run()
    torch.manual_seed(1)
    with pytest.raises(RuntimeError, match="initial is"):
        trainer(data, tmp_path).run()
    (tmp_path / "state.pt").unlink()
    with pytest.raises(RuntimeError, match="would be overwritten"):
        trainer(data, tmp_path).run()
    (tmp_path / "state.pt").write_bytes(b"nothing")
    with pytest.raises(RuntimeError, match="not the state of a run"):
        trainer(data, tmp_path).run()


def test_an_interrupted_run_leaves_no_part_of_a_file(data, tmp_path):
    with pytest.raises(Interrupted):
        trainer(data, tmp_path, interrupted=lambda: True).run()
    assert sorted(path.name for path in tmp_path.iterdir()) == [".lock", "log.csv", "state.pt"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--data", "nowhere"], "nowhere"),
        (["--channels", "8,8,8"], "channels is of the net 'hybrid'"),
        (["--stream", "7m"], "7m"),
        (["--clouds", "0"], "clouds is 0"),
        (["--preset", "paper", "--stream", "2m"], "give steps"),
    ],
)
def test_wrong_arguments_are_refused_in_words(data, tmp_path, capsys, arguments, words):
    assert main(["--data", str(data), "--out", str(tmp_path), *SIZE[:-3], *STEPS[:2], *arguments]) == 1
    error = capsys.readouterr().err
    # What is said of the robot's symmetries may stand before it.
    assert error.splitlines()[-1].startswith("error: ")
    assert words in error


def test_the_example_scores_a_network_of_ones_own_beside_tdcrs(data, tmp_path):
    binary = os.environ.get("TDCR") or str(ROOT / "target/release/tdcr")
    command = [sys.executable, ROOT / "examples/python/own_network.py", "--data", data, "--out", tmp_path]
    short = ["--steps", "20", "--points", "200", "--width", "16"]
    environment = os.environ | {"TDCR": binary, "OMP_NUM_THREADS": "1"}
    done = subprocess.run([*command, *short], capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    assert [line.split()[0] for line in done.stdout.splitlines()] == ["CD", "own", "tdcr's"]


def test_importing_it_does_not_load_the_compiler():
    code = "import sys, torch; before = set(sys.modules); import tdcr.torch.baselines; print(*set(sys.modules) - before)"
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()
    assert "tdcr.torch" in loaded and "torch._dynamo" not in loaded


def test_the_package_itself_does_not_load_pytorch():
    code = "import sys, tdcr, tdcr.stream; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    missing = "import sys; sys.modules['torch'] = None\nimport tdcr.torch"
    done = subprocess.run([sys.executable, "-c", missing], capture_output=True, text=True, check=False)
    assert "pip install torch safetensors" in done.stderr.splitlines()[-1]

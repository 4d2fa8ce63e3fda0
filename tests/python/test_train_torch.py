"""The PyTorch example learns from a data set of `tdcr collect`, and `tdcr` predicts and scores with what it writes."""

import pathlib
import subprocess
import sys

import numpy as np
import pytest

ROOT = pathlib.Path(__file__).parents[2]

try:
    import torch
except ImportError:
    pytest.skip(
        "no PyTorch here: install tests/python/requirements-torch.txt to train with it",
        allow_module_level=True,
    )

sys.path.insert(0, str(ROOT / "examples/python"))
import networks  # noqa: E402
import train_torch  # noqa: E402


@pytest.fixture(scope="module")
def data(tdcr, tmp_path_factory):
    folder = tmp_path_factory.mktemp("torch") / "data"
    tdcr("collect", "--samples", 40, "--points", 500, "--out", folder)
    return folder


def run(data, out, steps):
    size = ["--width", "32", "--depth", "3", "--embedding", "32", "--clouds", "8", "--points", "128"]
    command = [sys.executable, ROOT / "examples/python/train_torch.py", data, "--out", out, "--steps", str(steps)]
    done = subprocess.run([*command, *size, "--learning-rate", "3e-3"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_example_learns_and_tdcr_reads_what_it_writes(tdcr, data, tmp_path):
    cds = {}
    for steps in (4, 400):
        model = tmp_path / f"{steps}.safetensors"
        assert f"step {steps} of {steps}" in run(data, model, steps)
        scores = tdcr("eval", "--model", model, "--data", data, "--points", 400, "--emd-points", 50)
        cds[steps] = scores["cd"]
    assert cds[400] < 0.2 * cds[4]
    module, header = networks.load(model)
    assert header["content"]["provenance"]["subject"]["robot"]["name"] == "2m"
    assert sum(value.numel() for value in module.parameters()) > 0


def test_a_batch_is_of_the_papers_path(data):
    commands, clouds = train_torch.read_split(data, "train")
    assert (len(commands), clouds.shape) == (32, (32, 500, 3))
    x, t, c, velocity = train_torch.draw(commands, clouds, 2000, 16, torch.Generator().manual_seed(1))
    ends, starts = x + (1 - t[:, None, None]) * velocity, x - t[:, None, None] * velocity
    # The ends are points of the cloud of the command, the starts noise of the prior.
    for k in range(0, 2000, 400):
        cloud = clouds[(commands == c[k]).all(dim=1)][0]
        distances = torch.cdist(ends[k], cloud, compute_mode="donot_use_mm_for_euclid_dist")
        assert distances.amin(dim=1).max() < 1e-6
    np.testing.assert_allclose([starts.mean(), starts.std()], [0, 0.5], atol=0.01)
    # u^(1/3) is Beta(3, 1): its mean is 3/4.
    np.testing.assert_allclose(t.mean(), 0.75, atol=0.02)

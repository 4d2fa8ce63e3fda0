"""The flow in PyTorch: its samplers take the steps of `tdcr predict`, and its batches are of the paper's path."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="no PyTorch here: install tests/python/requirements-torch.txt")

from tdcr.torch import CloudSet, Model, Sampler, integrate, network, preset  # noqa: E402
from tdcr.torch.batch import chamfer, draw  # noqa: E402
from tdcr.torch.schedule import SPIKE_STEPS, spike_length  # noqa: E402

COMMAND = [0.034, 0.007, 0.001, 0.026, 0.015, 0.019]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A network whose velocities differ from place to place and from time to time, as a file."""
    torch.manual_seed(3)
    shape = preset().shape(6, colors=True) | {"width": 32, "depth": 3, "embedding": 32, "octaves": 2}
    module = network(shape)
    for name, value in module.named_parameters():
        if "film" in name:
            torch.nn.init.normal_(value, std=0.1)
    provenance = {"subject": None, "normalisation": {"motor_min": [0.0] * 6, "motor_max": [0.04] * 6, "scale": 0.35}}
    model = Model(module, shape, True, provenance, preset().settings(steps=100), 1, 0.0)
    path = tmp_path_factory.mktemp("flow") / "model.safetensors"
    model.save(path)
    return path


@pytest.mark.parametrize("method", [None, "heun", "euler", "adams-bashforth", "exponential", "exponential3"])
def test_a_predicted_cloud_is_that_of_tdcr_predict(tdcr, tmp_path, written, method):
    out = tmp_path / "cloud.npz"
    command = ["--command", ",".join(map(str, COMMAND)), "--points", 300, "--seed", 5, "--precision", "float32"]
    sampler = None
    if method is not None:
        sampler = Sampler(method, steps=6, power=1.5)
        command += ["--sampler", method, "--sampler-steps", 6, "--sampler-power", 1.5]
    tdcr("predict", "--model", written, *command, "--out", out)
    theirs = np.load(out)
    ours = Model.load(written).predict([COMMAND], points=300, seed=5, sampler=sampler)
    # Metres, of clouds that extend over half a metre.
    np.testing.assert_allclose(ours.points[0], theirs["points"], atol=2e-6)
    assert np.abs(ours.colors[0].astype(int) - theirs["rgb"]).max() <= 1
    other = Model.load(written).predict([COMMAND], points=300, seed=6, sampler=sampler)
    assert np.abs(other.points[0] - theirs["points"]).max() > 0.05


@pytest.mark.parametrize("method", ["heun", "exponential"])
def test_colours_clamped_after_each_step_are_those_of_tdcr_predict(tdcr, tmp_path, written, method):
    model = Model.load(written)
    own = {}
    for colors in ("free", "clamped"):
        model.settings["sampler"] = Sampler(method, 6, 1.5, None, 0.0, colors).to_settings()
        path = tmp_path / f"{colors}.safetensors"
        model.save(path)
        out = tmp_path / f"{colors}.npz"
        command = ["--command", ",".join(map(str, COMMAND)), "--points", 300, "--seed", 5, "--precision", "float32"]
        tdcr("predict", "--model", path, *command, "--out", out)
        own[colors] = model.predict([COMMAND], points=300, seed=5)
        theirs = np.load(out)
        np.testing.assert_allclose(own[colors].points[0], theirs["points"], atol=2e-6)
        assert np.abs(own[colors].colors[0].astype(int) - theirs["rgb"]).max() <= 1
    # The network sees the colours, so clamping them takes the points elsewhere.
    assert np.abs(own["free"].points - own["clamped"].points).max() > 1e-4


@pytest.mark.parametrize(("method", "order"), [("heun", 2), ("euler", 1), ("adams-bashforth", 2), ("exponential", 2)])
def test_samplers_converge_with_their_order(method, order):
    """The exact velocity that carries N(0, a^2) to N(0, b^2) along straight paths: X_1 = X_0 b / a."""
    a, b = 0.5, 0.2

    def field(x, t, c):
        t = t[:, None, None]
        return x * (t * b * b - (1 - t) * a * a) / ((1 - t) ** 2 * a * a + t * t * b * b)

    start = torch.full((1, 1, 3), 0.5, dtype=torch.float64)
    errors = []
    for steps in (64, 128):
        end = integrate(field, start, torch.zeros(1, 1), Sampler(method, steps, denoise=None))
        errors.append(abs(float(end[0, 0, 0]) - 0.5 * b / a))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.3)


def clouds(count=40, points=50):
    generator = torch.Generator().manual_seed(1)
    rows = torch.rand(count, points, 3, generator=generator)
    conditions = torch.arange(count, dtype=torch.float32)[:, None] / count
    return CloudSet(conditions, rows, {"normalisation": {"scale": 1.0}})


def test_a_batch_is_of_the_papers_path():
    training = clouds()
    path = {"prior_deviation": 0.5, "time_exponent": 3.0}
    settings = preset().settings(steps=10, clouds=2000, points=16, path=path)
    x, t, c, velocity = draw(training, settings, 3)
    ends, starts = x + (1 - t[:, None, None]) * velocity, x - t[:, None, None] * velocity
    # The ends are different points of the cloud of the condition, the starts noise of the prior.
    for k in range(0, 2000, 400):
        cloud = training.rows[round(40 * float(c[k]))]
        distances = torch.cdist(ends[k], cloud, compute_mode="donot_use_mm_for_euclid_dist")
        assert distances.amin(dim=1).max() < 1e-6
        assert len(distances.argmin(dim=1).unique()) == 16
    np.testing.assert_allclose([starts.mean(), starts.std()], [0, 0.5], atol=0.01)
    # u^(1/3) is Beta(3, 1): its mean is 3/4.
    np.testing.assert_allclose(t.mean(), 0.75, atol=0.02)


def test_late_times_and_a_cut_prior_are_the_default():
    settings = preset().settings(steps=10, clouds=20_000, points=4)
    x, t, _, velocity = draw(clouds(), settings, 3)
    starts = x - t[:, None, None] * velocity
    assert torch.linalg.vector_norm(starts, dim=-1).max() < 2.5 * 0.5 + 1e-5
    # Half of the times are log-uniform from 0.003 to 0.15 before the data, the others Beta(3, 1).
    left = 1 - t.double()
    middle = (0.003 * 0.15) ** 0.5
    for least, most in ((0.003, middle), (middle, 0.15)):
        expected = 0.25 + 0.5 * ((1 - least) ** 3 - (1 - most) ** 3)
        share = ((left >= least) & (left < most)).double().mean().item()
        assert share == pytest.approx(expected, abs=0.015)


def test_a_last_denoising_predicts_the_data_of_its_time():
    """For the field that carries N(0, a^2) to N(0, b^2): E[X_1 | X_t = x] = x t b^2 / ((1 - t)^2 a^2 + t^2 b^2)."""
    a, b, late = 0.5, 0.2, 0.75

    def field(x, t, c):
        t = t[:, None, None]
        return x * (t * b * b - (1 - t) * a * a) / ((1 - t) ** 2 * a * a + t * t * b * b)

    start = torch.full((1, 1, 3), 0.5, dtype=torch.float64)
    plain, denoised = (integrate(field, start, torch.zeros(1, 1), Sampler(denoise=t)) for t in (None, late))
    gain = late * b * b / ((1 - late) ** 2 * a * a + late * late * b * b)
    torch.testing.assert_close(denoised, gain * plain)


def test_ranks_share_the_batch_of_one():
    settings = preset().settings(steps=10, clouds=12, points=16)
    whole = draw(clouds(), settings, 7)
    for rank in range(3):
        for part, all_of_it in zip(draw(clouds(), settings, 7, rank, 3), whole, strict=True):
            assert torch.equal(part, all_of_it[rank::3])
    assert not torch.equal(draw(clouds(), settings, 8)[0], whole[0])


def test_the_chamfer_distance_is_scipys():
    from scipy.spatial.distance import cdist

    a, b = clouds().rows[:2]
    squared = cdist(a.double(), b.double(), "sqeuclidean")
    expected = squared.min(axis=0).mean() + squared.min(axis=1).mean()
    assert chamfer(a, b) == pytest.approx(expected, rel=1e-5)


def test_a_rise_that_stays_is_a_spike_and_scatter_is_none():
    settings = preset().settings(steps=1000)
    scatter = [0.02 * (1 + (7919 * k % 101) / 60) for k in range(300)]
    assert all(spike_length(settings, scatter[:k]) < SPIKE_STEPS for k in range(300))
    assert spike_length(settings, [*scatter, 50.0, 0.02]) == 0
    assert spike_length(settings, scatter + SPIKE_STEPS * [0.4]) == SPIKE_STEPS


def test_samplers_that_are_none_are_refused():
    with pytest.raises(ValueError, match="expected one of heun, euler"):
        Sampler("rk4")
    with pytest.raises(ValueError, match="expected 1 to 100000"):
        Sampler(steps=0)
    with pytest.raises(ValueError, match="denoising time is 1"):
        Sampler(denoise=1)
    with pytest.raises(ValueError, match="spare points is -1"):
        Sampler(spare=-1)
    with pytest.raises(ValueError, match="colors are 'bounded'"):
        Sampler(colors="bounded")


@pytest.mark.parametrize("denoise", [0.995, 0.9])
def test_a_refined_model_that_knows_its_reach_predicts_as_tdcr_predict(tdcr, tmp_path, written, denoise):
    model, path = Model.load(written), tmp_path / "model.safetensors"
    model.refinement = Model.load(written).network
    with torch.no_grad():
        for value in model.refinement.parameters():
            value.mul_(0.9)
    model.reach = {"min": [-0.1, -0.2, 0.0], "max": [0.2, 0.1, 0.3]}
    clouds = {}
    for factor in (None, 2.5):
        model.uncertainty_factor = factor
        model.save(path)
        out = tmp_path / f"{factor}.npz"
        command = ["--command", ",".join(map(str, COMMAND)), "--points", 300, "--seed", 5, "--precision", "float32"]
        tdcr("predict", "--model", path, *command, "--sampler-denoise", denoise, "--out", out)
        clouds[factor] = np.load(out)
    read = Model.load(path)
    assert (read.reach, read.uncertainty_factor) == (model.reach, 2.5)
    ours = read.predict([COMMAND], points=300, seed=5, sampler=Sampler(denoise=denoise))
    # Moving points apart turns rounding into directions.
    np.testing.assert_allclose(ours.points[0], clouds[2.5]["points"], atol=5e-6)
    # Ends of the flow are inside the box, which the network without it leaves; refined at its own time alone.
    ends = Sampler(denoise=denoise, spare=0.0)
    ours = read.predict([COMMAND], points=300, seed=5, sampler=ends)
    out = tmp_path / "ends.npz"
    tdcr("predict", "--model", path, *command, "--sampler-denoise", denoise, "--sampler-spare", 0, "--out", out)
    np.testing.assert_allclose(ours.points[0], np.load(out)["points"], atol=2e-6)
    corners = np.array([model.reach["min"], model.reach["max"]]) * 0.35
    assert (ours.points[0] >= corners[0] - 1e-6).all() and (ours.points[0] <= corners[1] + 1e-6).all()
    read.reach = None
    assert np.abs(read.predict([COMMAND], points=300, seed=5, sampler=ends).points[0] - ours.points[0]).max() > 0.02
    plain = Model.load(path)
    plain.refinement = None
    unrefined = plain.predict([COMMAND], points=300, seed=5, sampler=ends).points
    assert np.array_equal(unrefined, ours.points) == (denoise != 0.995)
    np.testing.assert_allclose(clouds[2.5]["uncertainty"], 2.5 * clouds[None]["uncertainty"], rtol=1e-6)

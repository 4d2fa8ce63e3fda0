"""The paper's baselines: runs, files, VSM and PointFlow against closed forms, differences and determinants."""

import json
import sys

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="no PyTorch here: install tests/python/requirements-torch.txt")
pytest.importorskip("torchdiffeq", reason="no torchdiffeq here: install tests/python/requirements-torch.txt")
pytest.importorskip("skimage", reason="no scikit-image here: install tests/python/requirements-torch.txt")

import safetensors.torch  # noqa: E402
import scipy.stats  # noqa: E402

from tdcr import Dataset, collect, evaluate  # noqa: E402
from tdcr.errors import DataError, InputError, MissingPackageError, TrainError  # noqa: E402
from tdcr.torch.baselines import BaselineModel, Run, Settings, method, write_predictions  # noqa: E402
from tdcr.torch.baselines.__main__ import main  # noqa: E402
from tdcr.torch.baselines._level import Grid, sample, uniform  # noqa: E402
from tdcr.torch.baselines._normals import normals_of  # noqa: E402
from tdcr.torch.baselines.pointflow import PointFlow  # noqa: E402
from tdcr.torch.baselines.vsm import OMEGA, Vsm  # noqa: E402
from tdcr.torch.trainer import Interrupted  # noqa: E402

# Tiny networks, beside other processes: more threads than one would wait for each other.
torch.set_num_threads(1)

SMALL = {"vsm": (Vsm, {"features": 16}), "pointflow": (PointFlow, {"widths": [8, 8], "encoder": 4})}
"""Sizes of networks that are trained in a test."""


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    made = collect("2m", tmp_path_factory.mktemp("baselines") / "data", samples=20, points=200, seed=1)
    return made.path


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """Methods start with small networks."""
    for kind, sizes in SMALL.values():
        start = kind.start.__func__

        def started(cls, training, start=start, sizes=sizes):
            return cls(**(start(cls, training).shape() | sizes))

        monkeypatch.setattr(kind, "start", classmethod(started))


def options(data, out, name, *more):
    run = [name, "--data", str(data), "--out", str(out), "--batch", "4", "--points", "32", "--quiet"]
    return [*run, "--validations", "2", "--validation-clouds", "1", "--validation-points", "100", *more]


def flow(seed=0):
    """A small flow in double precision that moves points far: its weights are not those of a start."""
    torch.manual_seed(seed)
    found = PointFlow(2, 0.3, [8, 8], 4).double()
    with torch.no_grad():
        for value in found.velocity.parameters():
            value.mul_(2.0)
        found.before.mean.copy_(torch.tensor([0.1, -0.2, 0.3]))
        found.before.variance.copy_(torch.tensor([0.5, 1.5, 0.8]))
        found.after.mean.copy_(torch.tensor([0.2, 0.0, -0.1]))
        found.after.variance.copy_(torch.tensor([1.2, 0.7, 1.0]))
        found.before.weight.copy_(torch.tensor([0.1, 0.2, -0.1]))
        found.after.bias.copy_(torch.tensor([0.1, -0.2, 0.05]))
    return found.eval()


def assert_gradient(module, loss, rng, rtol):
    """The derivative of a loss along random directions of each of the weights is that of central differences."""
    module.zero_grad()
    loss().backward()
    for name, value in module.named_parameters():
        direction = torch.from_numpy(rng.normal(size=tuple(value.shape)))
        slope = float((value.grad * direction).sum())
        ends = []
        for step in (1e-6, -1e-6):
            with torch.no_grad():
                value.add_(step * direction)
            ends.append(float(loss().detach()))
            with torch.no_grad():
                value.sub_(step * direction)
        assert slope == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=rtol, abs=1e-6), name
    return module


def test_the_gradient_of_vsms_loss_is_that_of_differences():
    torch.manual_seed(0)
    network = Vsm(2, [0.0, 0.0, 0.0], 1.0, features=12).double()
    numbers = torch.Generator().manual_seed(1)
    surface, normals, anywhere = (torch.randn(2, 5, 3, generator=numbers).double() * 0.4 for _ in range(3))
    conditions = torch.rand(2, 2, generator=numbers).double()
    assert_gradient(network, lambda: network.eikonal(surface, normals, anywhere, conditions), np.random.default_rng(2), 1e-5)


def test_vsms_loss_is_that_of_the_publication_where_the_distance_is_a_plane():
    """Far below a sine's first bend f is linear: its value, slope and angle to the normals are known."""
    network = Vsm(1, [0.0, 0.0, 0.0], 1.0, features=4).double()
    with torch.no_grad():
        for value in network.parameters():
            value.zero_()
        network.position.weight[0, 2] = 1e-6 / OMEGA
        for layer in network.joined:
            layer.weight[0, 0] = 1.0 / OMEGA
        network.last.weight[0, 0] = 2e6  # f = 2 z
    surface = torch.tensor([[[0.1, 0.2, 0.05], [0.0, 0.0, -0.01]]]).double()
    normals = torch.tensor([[[0.0, 0.0, 1.0], [0.0, 0.6, 0.8]]]).double()
    anywhere = torch.tensor([[[0.3, 0.0, 0.02], [0.0, 0.1, -0.03]]]).double()
    found = network.eikonal(surface, normals, anywhere, torch.zeros(1, 1).double())
    misses = 3000 * (0.1 + 0.02) / 2 + 100 * (np.exp(-4.0) + np.exp(-6.0)) / 2
    expected = 0.5 * (misses + 100 * (0.0 + 0.2) / 2) + 50 * 1.0
    assert float(found.detach()) == pytest.approx(expected, rel=1e-6)


def test_the_gradient_of_pointflows_loss_is_that_of_differences():
    network = flow()
    numbers = torch.Generator().manual_seed(1)
    x, directions = torch.randn(2, 4, 3, generator=numbers).double(), torch.randn(1, 2, 4, 3, generator=numbers).double()
    conditions = torch.rand(2, 2, generator=numbers).double()
    # In training, so that the normalisations take the batch's moments, whose gradient counts.
    network.train()

    def loss():
        return -network.log_likelihood(x, conditions, directions, 1e-9).mean()

    assert_gradient(network, loss, np.random.default_rng(3), 1e-5)


def test_pointflows_likelihood_is_the_determinant_of_its_map():
    """log p(x) = log N(z) + log |det dz/dx|, where z is inverted point by point by the solver and differentiated by autograd."""
    network = flow()
    numbers = torch.Generator().manual_seed(4)
    z, conditions = torch.randn(1, 6, 3, generator=numbers).double(), torch.rand(1, 2, generator=numbers).double()
    x = network.of_noise(z, conditions, 1e-9).detach()
    found = network.log_likelihood(x, conditions, tolerance=1e-9).detach()[0]
    # The map's inverse has the inverse Jacobian: that of `of_noise`, at the z that led to x.
    for k in range(z.shape[1]):
        jacobian = torch.autograd.functional.jacobian(
            lambda one: network.of_noise(one[None, None], conditions, 1e-9)[0, 0], z[0, k]
        )
        normal = float(torch.distributions.Normal(0, 1).log_prob(z[0, k]).sum())
        assert float(found[k]) == pytest.approx(normal - float(torch.linalg.slogdet(jacobian)[1]), abs=1e-6)
    # The tolerance of training is as good as it says, and directions along the axes are the exact trace.
    rough = network.log_likelihood(x, conditions).detach()[0]
    assert (rough - found).abs().max() < 2e-2
    axes = 3**0.5 * torch.eye(3).double()[:, None, None].expand(3, *x.shape)
    estimated = network.log_likelihood(x, conditions, axes, 1e-9).detach()[0]
    np.testing.assert_allclose(estimated, found, atol=1e-6)


def test_hutchinsons_estimate_has_the_trace_as_its_mean():
    network = flow()
    numbers = torch.Generator().manual_seed(5)
    y = torch.randn(1, 1, 3, generator=numbers).double()
    context = network.encoder(torch.rand(1, 2, generator=numbers).double())
    time = torch.tensor(0.2).double()
    jacobian = torch.autograd.functional.jacobian(
        lambda one: network.velocity(one, y.new_zeros(0, 1, 1, 3), time, context)[0], y
    ).reshape(3, 3)
    directions = torch.randn(20_000, 1, 1, 3, generator=numbers).double()
    slopes = network.velocity(y, directions, time, context)[1]
    np.testing.assert_allclose(slopes.detach()[:, 0, 0], directions[:, 0, 0] @ jacobian.T, atol=1e-12)
    estimates = (slopes * directions).sum(dim=-1).detach().flatten()
    assert abs(float(estimates.mean() - jacobian.trace())) < 5 * float(estimates.std()) / 20_000**0.5


def test_pointflows_density_integrates_to_one():
    network = flow()
    conditions = torch.tensor([[0.3, 0.8]]).double()
    edge = torch.linspace(-6.0, 6.0, 49).double()
    grid = torch.stack(torch.meshgrid(edge, edge, edge, indexing="ij"), dim=-1).reshape(1, -1, 3)
    with torch.no_grad():
        density = network.log_likelihood(grid, conditions, tolerance=1e-4).exp()
    assert float(density.sum()) * 0.25**3 == pytest.approx(1.0, abs=2e-3)
    # And not only in sum: the mean of points is that of the density.
    points = network.points(conditions, 20_000, [0])[0]
    mean = (density[0, :, None] * grid[0]).sum(dim=0) * 0.25**3
    assert ((points.mean(dim=0) - mean).abs() < 5 * points.std(dim=0) / 20_000**0.5).all()


def sphere(radius, slope=0.1):
    """A network of sines of a sphere: cos(a x) + cos(a y) + cos(a z) = 3 - a^2 |x|^2 / 2 for small a; then all sines are of small
    numbers, and keep them."""
    network = Vsm(1, [0.5, 0.0, -0.25], 2.0, features=6)
    with torch.no_grad():
        for value in network.parameters():
            value.zero_()
        network.position.weight.copy_(slope / OMEGA * torch.eye(3))
        network.position.bias.fill_(np.pi / 2 / OMEGA)
        first, *others = network.joined
        first.weight[0, :3] = -1.0 / OMEGA
        first.bias[0] = (3.0 - slope**2 * radius**2 / 2.0) / OMEGA
        for layer in others:
            layer.weight[0, 0] = 1.0 / OMEGA
        # A distance has the slope 1 at its level.
        network.last.weight[0, 0] = 1.0 / (slope**2 * radius)
    return network


def test_the_points_of_a_sphere_of_sines_are_on_it_and_uniform():
    radius = 0.4
    cloud = sphere(radius).points(torch.zeros(1, 1), 20_000, [3])[0].double().numpy()
    from_center = (cloud - np.array([0.5, 0.0, -0.25])) * 2.0
    distances = np.linalg.norm(from_center, axis=1)
    # The grid's cells are 0.0126 wide: a chord of one misses the sphere by 2e-4.
    assert np.abs(distances - radius).max() < 1e-3
    # The height and the angle of a uniform point on a sphere are uniform.
    height = np.floor((from_center[:, 2] / distances + 1.0) * 5.0).clip(0, 9)
    angle = np.floor((np.arctan2(from_center[:, 1], from_center[:, 0]) / np.pi + 1.0) * 4.0).clip(0, 7)
    counts = np.bincount((8 * height + angle).astype(int), minlength=80)
    assert scipy.stats.chisquare(counts).pvalue > 1e-3


def test_points_of_triangles_are_in_them_and_uniform_by_area():
    small, large = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[2.0, 0, 0], [5, 0, 0], [2, 1, 0]])
    points = uniform(np.stack([small, large]), 20_000, np.random.default_rng(0))
    of_large = points[:, 0] >= 2.0
    # In units of the legs, corners are (0, 0), (1, 0) and (0, 1).
    legs = np.where(of_large[:, None], (points[:, :2] - [2.0, 0.0]) / [3.0, 1.0], points[:, :2])
    assert legs.min() >= 0.0 and legs.sum(axis=1).max() <= 1.0
    # 1 - (1 - a)^2 of one leg's coordinate is uniform, and so is the other's part of what that leaves.
    first, second = 1.0 - (1.0 - legs[:, 0]) ** 2, legs[:, 1] / (1.0 - legs[:, 0])
    bins = np.floor(5 * first).clip(0, 4) * 5 + np.floor(5 * second).clip(0, 4)
    counts = np.bincount((bins + 25 * of_large).astype(int), minlength=50)
    expected = 20_000 / 25 * np.repeat([0.25, 0.75], 25)
    assert scipy.stats.chisquare(counts, expected).pvalue > 1e-3


def test_a_part_at_the_boundary_is_no_surface_and_blocks_off_the_level_are_not_evaluated():
    asked = []

    def level(x):
        asked.append(len(x))
        inside = torch.linalg.vector_norm(x - torch.tensor([0.2, 0.0, 0.0]), dim=1) - 0.25
        return torch.minimum(inside, x[:, 2] + 0.7)

    points = sample(Grid.of(level, 0.8), 4000, 0)
    assert np.abs(np.linalg.norm(points - [0.2, 0.0, 0.0], axis=1) - 0.25).max() < 1e-3
    assert sum(asked) < 0.3 * 128**3
    # Where there is no level, the cells that are closest to one stand for it.
    closest = sample(Grid.of(lambda x: x.square().sum(dim=1) + 0.5, 0.8), 8, 0)
    assert np.abs(closest).max() < 0.03


def test_normals_of_a_sphere_and_of_a_bent_tube_are_outward():
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(3000, 3))
    ball /= np.linalg.norm(ball, axis=1)[:, None]
    # Half a torus: its inner side looks at its own centre line, not away from the cloud's mean.
    around, along = rng.uniform(0, 2 * np.pi, 6000), rng.uniform(0, np.pi, 6000)
    axis = np.stack([np.cos(along), np.sin(along), np.zeros_like(along)], axis=1)
    outward = np.cos(around)[:, None] * axis + np.sin(around)[:, None] * np.array([0.0, 0.0, 1.0])
    tube = 0.08 * axis + 0.02 * outward
    # Both in one cloud, as parts that are not connected.
    cloud = np.concatenate([0.03 * ball + [0.0, -0.2, 0.0], tube])
    chosen = rng.permutation(len(cloud))[:6000]
    expected = np.concatenate([ball, outward])[chosen]
    agreement = (normals_of(cloud, chosen) * expected).sum(axis=1)
    assert agreement.min() > 0.5 and np.mean(agreement) > 0.98


@pytest.mark.parametrize("name", list(SMALL))
def test_a_run_that_was_interrupted_ends_as_one_that_was_not(data, tmp_path, name):
    kind = method(name)
    settings = Settings(
        batch=4, points=32, learning_rate=1e-3, steps=30, validations=3, validation_clouds=1, validation_points=100, seed=5
    )
    Run(kind, data, tmp_path / "whole", settings).run()
    calls = iter([False, True])
    with pytest.raises(Interrupted):
        Run(kind, data, tmp_path / "half", settings, interrupted=lambda: next(calls, False)).run()
    Run(kind, data, tmp_path / "half", settings).run()
    assert (tmp_path / "half/log.csv").read_bytes() == (tmp_path / "whole/log.csv").read_bytes()
    one, two = (safetensors.torch.load_file(tmp_path / run / "model.safetensors") for run in ("half", "whole"))
    assert all(torch.equal(one[key], two[key]) for key in one)
    # Another run is not resumed here, and one that has ended takes no more steps.
    with pytest.raises(TrainError, match="settings.seed is 5, expected 6"):
        Run(kind, data, tmp_path / "half", Settings(**(vars(settings) | {"seed": 6}))).run()
    again = Run(kind, data, tmp_path / "half", settings)
    again.run()
    assert again.step == 30


@pytest.mark.parametrize("name", list(SMALL))
def test_a_method_is_trained_predicts_and_is_scored_by_commands(data, tmp_path, name, capsys):
    assert main(options(data, tmp_path / "run", name, "--steps", "20", "--json")) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["method"], said["steps"]) == (name, 20)
    header = (tmp_path / "run/log.csv").read_text().splitlines()
    assert header[0] == "step,loss,gradient_norm,learning_rate,validation_cd" and len(header) == 3
    predictions = tmp_path / "clouds.npz"
    ask = ["predict", "--model", str(tmp_path / "run"), "--data", str(data), "--points", "150", "--out", str(predictions)]
    assert main([*ask, "--quiet"]) == 0
    scores = evaluate(predictions=predictions, data=data, emd_points=50)
    assert np.isfinite(scores["cd"]) and scores["points"] == 150
    model = BaselineModel.load(tmp_path / "run")
    with np.load(predictions) as first:
        points = first["points"]
        assert str(first["method"]) == name
        assert float(first["training_seconds"]) == model.processor_seconds > 0.0
        assert 0.0 < float(first["prediction_seconds"]) < 60.0
    # Under another name beside itself.
    again = tmp_path / "again.npz"
    assert main([*ask[:-1], str(again), "--name", "once more", "--quiet"]) == 0
    both = evaluate(predictions=[predictions, again], data=data, emd_points=50)
    rows = {row["name"]: row for row in both["methods"]}
    assert rows[name]["cd"] == rows["once more"]["cd"] == scores["cd"]
    assert rows["once more"]["training_seconds"] == model.processor_seconds
    with pytest.raises(InputError, match="name is 'a\\\\nb', expected 1 to 60 printable letters"):
        write_predictions(again, model, data, name="a\nb")
    # Of the first command alone, where that alone is scored.
    assert main([*ask[:-1], str(again), "--first", "1", "--quiet"]) == 0
    of_first = evaluate(predictions=again, data=data, emd_points=50, tests=1)
    expected = evaluate(predictions=predictions, data=data, emd_points=50, tests=1)
    # PointFlow's solver takes the steps that all clouds of a batch need.
    assert of_first["cd"] == pytest.approx(expected["cd"], rel=1e-4)
    count = len(Dataset(data).test)
    with pytest.raises(InputError, match=f"1 predicted clouds, expected {count}, one for each test command"):
        evaluate(predictions=again, data=data, emd_points=50)
    with pytest.raises(InputError, match=rf"first is {count + 1}, expected 1 to {count}"):
        write_predictions(again, model, data, first=count + 1)
    # A cloud depends on its own command and seed alone.
    with np.load(predictions) as first:
        alone = model.predict(first["commands"][1:2], 150, seed=1)
    np.testing.assert_allclose(alone[0], points[1], atol=2e-3 if name == "pointflow" else 1e-5)
    assert model.provenance["subject"]["robot"]["name"] == "2m"


def test_a_run_ends_by_the_clock(data, tmp_path):
    settings = Settings(batch=2, points=16, learning_rate=1e-3, minutes=1e-4, validation_clouds=1, validation_points=50)
    run = Run(PointFlow, data, tmp_path / "run", settings)
    model = run.run()
    # It has a model however short its time was.
    assert run.step >= 1 and model.step == run.step and model.seconds >= 6e-3


def test_files_that_are_no_baselines_models_are_refused(data, tmp_path, capsys):
    assert main(options(data, tmp_path / "run", "pointflow", "--steps", "1")) == 0
    whole = tmp_path / "run/model.safetensors"
    content = whole.read_bytes()
    tensors = safetensors.torch.load(content)
    header = json.loads(safetensors.safe_open(whole, "pt").metadata()["tdcr"])

    def changed(**changes):
        return {"tdcr": json.dumps(header | {"content": header["content"] | changes})}

    del_one = {name: value for name, value in tensors.items() if name != "root_time"}
    cases = {
        "truncated": (content[: len(content) // 2], "not a safetensors file"),
        "foreign": (safetensors.torch.save(tensors, {"format": "pt"}), "not the file of a baseline"),
        "other": (safetensors.torch.save(tensors, changed(method="nerf")), "of the method 'nerf', expected one of vsm, "),
        "sizes": (safetensors.torch.save(tensors, changed(shape=header["content"]["shape"] | {"encoder": 5})), "do not fit"),
        "missing": (safetensors.torch.save(del_one, {"tdcr": json.dumps(header)}), "do not fit"),
        "newer": (safetensors.torch.save(tensors, {"tdcr": json.dumps(header | {"format": 9})}), "format 9, expected 1"),
    }
    for name, (written, message) in cases.items():
        path = tmp_path / f"{name}.safetensors"
        path.write_bytes(written)
        with pytest.raises(TrainError, match=message) as refused:
            BaselineModel.load(path)
        assert str(path) in str(refused.value)
    with pytest.raises(TrainError, match="there is no such file"):
        BaselineModel.load(tmp_path / "nothing")
    assert main(["predict", "--model", str(tmp_path / "truncated.safetensors"), "--data", str(data)]) == 1
    assert capsys.readouterr().err.startswith("error: ")


def test_inputs_that_do_not_fit_are_refused(data, tmp_path, monkeypatch):
    with pytest.raises(InputError, match="neither steps nor minutes"):
        Settings(batch=1, points=1, learning_rate=1e-3)
    for wrong in ({"steps": 0}, {"minutes": -1.0}, {"steps": 1, "batch": 0}, {"steps": 1, "learning_rate": 0.0}):
        with pytest.raises(InputError, match=f"{list(wrong)[-1]} is "):
            Settings(**({"batch": 1, "points": 1, "learning_rate": 1e-3} | wrong))
    with pytest.raises(InputError, match="no baseline 'nerf'"):
        method("nerf")
    settings = Settings(batch=1, points=8, learning_rate=1e-3, steps=1, validation_clouds=1, validation_points=50)
    with pytest.raises(DataError):
        Run(PointFlow, tmp_path / "nowhere", tmp_path / "run", settings)
    with pytest.raises(InputError, match="tf32"):
        Run(PointFlow, data, tmp_path / "run", Settings(**(vars(settings) | {"precision": "tf32"})))
    model = Run(PointFlow, data, tmp_path / "run", settings).run()
    with pytest.raises(InputError, match=r"expected \(B, 6\)"):
        model.predict([[0.0] * 5])
    with pytest.raises(InputError, match="finite"):
        model.predict([[float("nan")] * 6])
    other = collect("3m", tmp_path / "3m", samples=10, points=100)
    with pytest.raises(TrainError, match="trained on the robot 2m .* is of the robot 3m"):
        write_predictions(tmp_path / "clouds.npz", model, other.path, points=10)
    # A run's model is not overwritten by one that has no state.
    (tmp_path / "run/state.pt").unlink()
    with pytest.raises(TrainError, match="would be overwritten"):
        Run(PointFlow, data, tmp_path / "run", settings).run()
    for package, kind, arguments in (("torchdiffeq", PointFlow, (6, 0.3)), ("skimage.measure", Vsm, (6, [0.0] * 3, 1.0))):
        monkeypatch.setitem(sys.modules, package, None)
        with pytest.raises(MissingPackageError, match="which is not installed: pip install"):
            kind(*arguments)

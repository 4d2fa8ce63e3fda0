"""FFKSM: rays through a field of density, its loss over pictures, and the surface that it is searched for."""

import math
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="no PyTorch here: install tests/python/requirements-torch.txt")

from tdcr.torch import CloudSet  # noqa: E402
from tdcr.torch.baselines import Settings, Training, ffksm  # noqa: E402
from tdcr.torch.baselines.ffksm import Ffksm, composite, crossings  # noqa: E402
from tdcr.torch.baselines.views import Views  # noqa: E402
from tdcr.torch.batch import STEP, generator  # noqa: E402

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def training(dataset):
    """A small set and how little is drawn of it."""
    settings = Settings(batch=2, points=32, learning_rate=2e-3, steps=1)
    return Training(Path(dataset.path), CloudSet.read(dataset.path), settings, CPU, lambda text: None)


@pytest.fixture(scope="module")
def views(dataset):
    return Views.render(dataset.path, size=40)


@pytest.fixture
def method(training, views):
    torch.manual_seed(1)
    found = Ffksm.start(training)
    found.look_at(views)
    return found


class Fog(torch.nn.Module):
    """The same density and visibility everywhere."""

    def __init__(self, density, visibility):
        super().__init__()
        self.values = torch.nn.Parameter(torch.tensor([density, visibility]))

    def forward(self, points, conditions):
        return tuple(value.expand(points.shape[:2]) for value in self.values)


def test_fog_is_as_opaque_as_beer_and_lambert_have_it(method, training):
    density, visibility = 0.05, 0.8
    method.field = Fog(density, visibility)
    size, middle = method.high - method.low, 0.5 * (method.low + method.high)
    # Along the axes, the part of a ray within the workspace is an edge of it.
    origins = (middle - 3 * torch.eye(3))[None]
    conditions = torch.zeros(1, training.clouds.condition_dim)
    found = method.mask(conditions, origins, torch.eye(3)[None], torch.rand(1, 3, ffksm.SAMPLES))
    expected = visibility * (1 - torch.exp(-density * ffksm.SAMPLES * size / size.norm()))
    torch.testing.assert_close(found[0], expected, rtol=1e-4, atol=0)


def test_compositing_is_absorption_and_emission_sample_by_sample():
    depth = torch.rand(5, 9, dtype=torch.float64)
    visibility = torch.rand(5, 9, dtype=torch.float64)
    expected = np.zeros(5)
    for ray in range(5):
        through = 1.0
        for k in range(9):
            opacity = 1 - math.exp(-float(depth[ray, k]))
            expected[ray] += through * opacity * float(visibility[ray, k])
            through *= 1 - opacity
    np.testing.assert_allclose(composite(depth, visibility).numpy(), expected, rtol=1e-12)


def test_the_loss_drawn_by_rays_has_the_mean_of_the_loss_over_all_pixels(method, training, views):
    method.field = Fog(0.05, 0.7)
    cameras = views.cameras
    pixel = torch.arange(cameras.size[0] * cameras.size[1])
    total, conditions = 0.0, training.clouds.conditions
    for camera in range(len(cameras)):
        directions = cameras.directions(torch.tensor(camera), pixel)
        offsets = torch.full((1, len(pixel), ffksm.SAMPLES), 0.5)
        origins = cameras.centres[camera].expand(1, len(pixel), 3)
        found = method.mask(conditions[:1], origins, directions[None], offsets)[0]
        for sample in range(len(views)):
            mask = views.shown(torch.tensor(sample), torch.tensor(camera), pixel).float()
            total += float(((1 + 30 * mask) * (found.detach() - mask).square()).mean())
    expected = total / (len(cameras) * len(views))
    drawn = [method.loss(training, k, generator(CPU, 0, STEP, k)).item() for k in range(1, 401)]
    error = np.std(drawn) / math.sqrt(len(drawn))
    assert abs(np.mean(drawn) - expected) < 4 * error
    assert error < 0.03 * expected


def test_derivatives_of_the_loss_are_those_of_differences(method, training, views):
    method = method.double()
    cameras = views.cameras
    doubles = {name: getattr(cameras, name).double() for name in ("rotations", "centres", "lenses")}
    method.look_at(type(views)(type(cameras)(**doubles, size=cameras.size), views.bits, views.pixels, views.colors))
    clouds = CloudSet(training.clouds.conditions.double(), training.clouds.rows, {})
    exact = Training(training.folder, clouds, training.settings, CPU, training.tell)

    def loss():
        return method.loss(exact, 1, generator(CPU, 0, STEP, 1))

    method.zero_grad()
    loss().backward()
    for value in (method.field.position.weight, method.field.command.weight, method.field.last[-1].bias):
        direction = torch.randn_like(value)
        slope = float((value.grad * direction).sum())
        ends = []
        with torch.no_grad():
            for step in (1e-6, -1e-6):
                value.add_(step * direction)
                ends.append(loss().item())
                value.sub_(step * direction)
        assert slope == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-4, abs=1e-9)


def test_the_surface_of_a_ball_is_found_to_a_hundredth_of_a_cell():
    places = torch.stack(torch.meshgrid(*[torch.arange(41.0)] * 3, indexing="ij"), dim=-1)
    radius = (places - 20.0).norm(dim=-1)
    found, axes = crossings((0.5 + 0.1 * (12.3 - radius)).clamp(0.0, 1.0))
    # A function that is straight along each edge would be found exactly.
    assert (found - 20.0).norm(dim=-1).sub(12.3).abs().max() < 0.02
    # The projections of the ball on three planes, from both sides: one crossing a cell.
    assert len(found) == pytest.approx(6 * math.pi * 12.3**2, rel=0.02)
    whole = found.gather(1, (axes[:, None] + 1) % 3)
    assert bool((whole == whole.round()).all())


def test_a_field_without_a_surface_gives_points_of_the_workspace(method, monkeypatch):
    monkeypatch.setattr(ffksm, "CELLS", 12)
    method.field = Fog(0.05, 0.5)
    cloud = method.points(torch.zeros(1, 7), 100, [0])[0]
    assert bool(((cloud >= method.low) & (cloud <= method.high + 0.1)).all())


def test_a_cloud_is_of_its_own_seed(method, monkeypatch):
    monkeypatch.setattr(ffksm, "CELLS", 12)
    conditions = torch.rand(2, 7)
    both = method.points(conditions, 50, [4, 5])
    torch.testing.assert_close(method.points(conditions[1:], 50, [5])[0], both[1])
    assert not torch.equal(method.points(conditions[1:], 50, [6])[0], both[1])


def test_a_moment_of_training_finds_where_the_robot_is(method, training):
    optimizer = method.optimizer(training.settings)
    losses = []
    for step in range(1, 61):
        optimizer.zero_grad()
        loss = method.loss(training, step, generator(CPU, 0, STEP, step))
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    assert np.mean(losses[-10:]) < 0.7 * np.mean(losses[:10])

"""Kinematic 3D Gaussians: pictures beside a dense reference written from Kerbl et al. (2023), derivatives, bones, depth."""

import math
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="no PyTorch here: install tests/python/requirements-torch.txt")

from tdcr.torch import CloudSet  # noqa: E402
from tdcr.torch.baselines import Settings, Training, splat  # noqa: E402
from tdcr.torch.baselines._rasterise import Gaussians, pair, project, rasterise  # noqa: E402
from tdcr.torch.baselines.splat import Splat, fused, long_range  # noqa: E402
from tdcr.torch.baselines.views import Cameras, Views  # noqa: E402
from tdcr.torch.batch import STEP, chamfer, generator  # noqa: E402

CPU = torch.device("cpu")

#: Pictures of 24 x 20 pixels.
SIZE = (20, 24)


@pytest.fixture(scope="module")
def views(dataset):
    return Views.render(dataset.path, size=40)


@pytest.fixture(scope="module")
def training(dataset):
    settings = Settings(batch=2, points=2, learning_rate=1e-3, steps=1)
    return Training(Path(dataset.path), CloudSet.read(dataset.path), settings, CPU, lambda text: None)


@pytest.fixture
def method(training, views):
    """60 Gaussians on the cloud of sample 3, with bones."""
    torch.manual_seed(5)
    found = Splat(training.clouds.condition_dim, 60, size=40)
    found.look_at(views)
    numbers = torch.Generator().manual_seed(2)
    found.begin(training.clouds.rows[3, :, :3], numbers)
    found.divide(numbers)
    return found


def two_cameras(dtype=torch.float64):
    """One that looks along x of the world and one that looks down."""
    rotations = torch.tensor([[[0.0, -1, 0], [0, 0, -1], [1, 0, 0]], [[1.0, 0, 0], [0, -1, 0], [0, 0, -1]]], dtype=dtype)
    centres = torch.tensor([[-2.0, 0.1, 0.0], [0.0, 0.0, 2.2]], dtype=dtype)
    lenses = torch.tensor([[30.0, 28.0, 11.2, 9.1], [25.0, 25.0, 12.0, 9.5]], dtype=dtype)
    return Cameras(rotations, centres, lenses, SIZE)


def scattered(count=25, spread=0.5, dtype=torch.float64):
    """Gaussians in front of both cameras, one behind them and one at the side."""
    torch.manual_seed(7)
    means = spread * (2 * torch.rand(count, 3, dtype=dtype) - 1)
    means[0], means[1] = torch.tensor([-3.0, 0.0, 4.0]), torch.tensor([0.2, 1.9, 0.1])
    factors = 0.06 * torch.randn(count, 3, 3, dtype=dtype)
    covariances = factors @ factors.mT + 1e-4 * torch.eye(3, dtype=dtype)
    opacities, colors = torch.rand(count, dtype=dtype), torch.rand(count, 3, dtype=dtype)
    opacities[2], opacities[3] = 0.999, 0.003
    return Gaussians(means.expand(2, -1, -1), covariances.expand(2, -1, -1, -1), opacities, colors)


def dense(gaussians, cameras, k):
    """Colours and opacities of the picture by camera k, pixel by pixel and Gaussian by Gaussian."""
    means, covariances = gaussians.means[k].numpy(), gaussians.covariances[k].numpy()
    turn, centre = cameras.rotations[k].numpy(), cameras.centres[k].numpy()
    fx, fy, cx, cy = cameras.lenses[k].tolist()
    height, width = cameras.size
    limits = 1.3 * 0.5 * width / fx, 1.3 * 0.5 * height / fy
    found, opacity = np.zeros((height, width, 3)), np.zeros((height, width))
    seen = []
    for mean, covariance, o, color in zip(means, covariances, gaussians.opacities, gaussians.colors, strict=True):
        x, y, z = turn @ (mean - centre)
        if z <= 0.01:
            continue
        a, b = np.clip(x / z, -limits[0], limits[0]) * z, np.clip(y / z, -limits[1], limits[1]) * z
        # Kerbl et al., equation 5, with the Jacobian of Zwicker et al.
        jacobian = np.array([[fx / z, 0, -fx * a / z**2], [0, fy / z, -fy * b / z**2]])
        flat = jacobian @ turn @ covariance @ turn.T @ jacobian.T + 0.3 * np.eye(2)
        seen.append((z, np.array([fx * x / z + cx, fy * y / z + cy]), np.linalg.inv(flat), float(o), color.numpy()))
    seen.sort(key=lambda one: one[0])
    for row in range(height):
        for column in range(width):
            through = 1.0
            for _, mean, inverse, o, color in seen:
                apart = np.array([column, row]) - mean
                alpha = min(0.99, o * math.exp(-0.5 * apart @ inverse @ apart))
                if alpha < 1 / 255:
                    continue
                if through * (1 - alpha) < 1e-4:
                    break
                found[row, column] += through * alpha * color
                opacity[row, column] += through * alpha
                through *= 1 - alpha
    return found.reshape(-1, 3), opacity.ravel()


def test_pictures_are_those_of_a_loop_over_pixels_and_gaussians():
    gaussians, cameras = scattered(), two_cameras()
    picture = rasterise(gaussians, cameras, torch.arange(2))
    for k in range(2):
        colors, opacity = dense(gaussians, cameras, k)
        assert opacity.max() > 0.9 and (opacity == 0).any()
        np.testing.assert_allclose(picture.colors[k].numpy(), colors, atol=1e-12)
        np.testing.assert_allclose(picture.opacity[k].numpy(), opacity, atol=1e-12)


def test_what_lies_behind_a_wall_is_not_seen():
    cameras = two_cameras()
    # Walls one behind another: behind the third, 8e-6 of the light would be left.
    means = torch.tensor([[0.1 * k, 0.1, 0.0] for k in range(3)], dtype=torch.float64)
    walls = torch.diag(torch.tensor([1e-6, 9.0, 9.0], dtype=torch.float64)).expand(1, 3, -1, -1)
    opacities = torch.full((3,), 0.98, dtype=torch.float64)
    gaussians = Gaussians(means[None], walls, opacities, torch.eye(3, dtype=torch.float64))
    picture = rasterise(gaussians, cameras, torch.tensor([0]))
    middle = 9 * SIZE[1] + 11
    expected = torch.tensor([0.98, 0.0196, 0.0], dtype=torch.float64)
    torch.testing.assert_close(picture.colors[0, middle], expected, rtol=1e-3, atol=0)
    # Half of the light is gone at the first.
    assert float(picture.depth[0, middle]) == pytest.approx(2.0)


def test_derivatives_of_pictures_are_those_of_differences():
    given, cameras = scattered(8), two_cameras()
    torch.manual_seed(3)
    weights = torch.rand(2, SIZE[0] * SIZE[1], 4, dtype=torch.float64)

    def of(means, factors, opacities, colors):
        covariances = (factors @ factors.mT).expand(2, -1, -1, -1)
        picture = rasterise(Gaussians(means.expand(2, -1, -1), covariances, opacities, colors), cameras, torch.arange(2))
        return (weights * torch.cat([picture.colors, picture.opacity[..., None]], dim=-1)).sum()

    factors = torch.linalg.cholesky(given.covariances[0])
    # Opacities apart from the bounds, where pictures leap by 1/255.
    opacities = 0.2 + 0.6 * torch.rand(8, dtype=torch.float64)
    inputs = [value.clone().requires_grad_() for value in (given.means[0], factors, opacities, given.colors)]
    assert torch.autograd.gradcheck(of, inputs, eps=1e-7, atol=1e-4, rtol=1e-4)


def test_pictures_do_not_depend_on_threads():
    gaussians, cameras = scattered(200, dtype=torch.float32), two_cameras(torch.float32)
    threads, pictures = torch.get_num_threads(), []
    try:
        for count in (1, 2, 3):
            torch.set_num_threads(count)
            pictures.append(rasterise(gaussians, cameras, torch.arange(2)).colors)
    finally:
        torch.set_num_threads(threads)
    assert torch.equal(pictures[0], pictures[1]) and torch.equal(pictures[0], pictures[2])


def test_all_pixels_of_a_gaussian_are_listed():
    gaussians, cameras = scattered(), two_cameras()
    seen = project(gaussians.means, gaussians.covariances, cameras, torch.arange(2))
    pairs = pair(seen, gaussians.opacities, SIZE)
    height, width = SIZE
    listed = np.zeros((2, len(gaussians.opacities), height * width), bool)
    listed.reshape(-1, height * width)[pairs.row, pairs.pixel % (height * width)] = True
    rows, columns = np.mgrid[:height, :width].reshape(2, -1)
    for n in range(2):
        for g, o in enumerate(gaussians.opacities.tolist()):
            xx, xy, yy = seen.covariances[n, g].tolist()
            apart = np.stack([columns, rows]) - seen.means[n, g].numpy()[:, None]
            power = (apart * np.linalg.solve([[xx, xy], [xy, yy]], apart)).sum(axis=0)
            expected = (o * np.exp(-0.5 * power) >= 1 / 255) & (float(seen.depths[n, g]) > 0.01)
            np.testing.assert_array_equal(listed[n, g], expected)


def test_masks_show_where_the_clouds_of_the_data_set_are(training, views):
    cameras, points = views.cameras, training.clouds.rows[5, :, :3].double()
    for camera in range(len(cameras)):
        local = (points - cameras.centres[camera]) @ cameras.rotations[camera].double().T
        fx, fy, cx, cy = cameras.lenses[camera].tolist()
        u, v = (fx * local[:, 0] / local[:, 2] + cx).round(), (fy * local[:, 1] / local[:, 2] + cy).round()
        pixel = (v * cameras.size[1] + u).long()
        # At an outline a pixel's centre may lie beside the robot.
        assert float(views.shown(torch.tensor(5), torch.tensor(camera), pixel).float().mean()) > 0.8
        rays = cameras.directions(torch.tensor(camera), pixel)
        towards = torch.nn.functional.normalize(points - cameras.centres[camera], dim=-1)
        assert float((rays * towards).sum(dim=-1).min()) > math.cos(0.75 / fx)


def test_the_long_range_distance_of_a_wave_is_its_power_over_its_wave_number_squared():
    x = torch.arange(32.0, dtype=torch.float64).repeat(8)
    wave = 3.0 * torch.sin(2 * math.pi * 5 * x / 32)
    expected = 256 * 9.0 / 2 / (2 * math.pi * 5 / 32) ** 2
    assert float(long_range(wave[None], (8, 32))) == pytest.approx(expected, rel=1e-12)


def test_the_long_range_distance_grows_with_the_way_between_masks_that_do_not_overlap():
    masks = torch.zeros(4, 40, 40)
    for k in range(4):
        masks[k, 18:22, 2 + 8 * k : 6 + 8 * k] = 1
    near, middle, far = long_range((masks[1:] - masks[:1]).flatten(1), (40, 40)).tolist()
    # 8, 16 and 24 pixels apart; the picture is periodic, in which 24 are 16 the other way round.
    assert near < middle and far == pytest.approx(middle, rel=1e-5)


def test_bones_at_rest_leave_the_gaussians_where_they_are(method):
    with torch.no_grad():
        method.motion[-1].weight.zero_()
        weights, _ = method.weights()
        means, covariances = method.moved(torch.rand(2, 7), weights)
    torch.testing.assert_close(weights.sum(dim=-1), torch.ones(60))
    torch.testing.assert_close(means[1], method.means.detach(), atol=1e-6, rtol=0)
    torch.testing.assert_close(covariances[1], method.canonical().detach(), atol=1e-8, rtol=1e-4)


def test_bones_that_move_alike_move_the_robot_as_a_whole(method):
    with torch.no_grad():
        weights, _ = method.weights()
        turn = splat.rotation_matrices(torch.tensor([0.9, 0.3, -0.2, 0.1]))
        shift = torch.tensor([0.1, -0.2, 0.3])
        centres = method.bone_centres
        method.pose = lambda conditions: splat.Bones(
            turn.expand(1, splat.BONES, 3, 3), (centres @ turn.T + shift - centres)[None]
        )
        means, covariances = method.moved(torch.zeros(1, 7), weights)
        torch.testing.assert_close(means[0], method.means @ turn.T + shift, atol=1e-5, rtol=0)
        torch.testing.assert_close(covariances[0], turn @ method.canonical() @ turn.T, atol=1e-8, rtol=1e-3)
        assert float(method.stretch(means)) < 1e-6


def test_derivatives_of_the_loss_are_those_of_differences(method, training, views):
    method = method.double()
    cameras = views.cameras
    doubles = {name: getattr(cameras, name).double() for name in ("rotations", "centres", "lenses")}
    method.views = Views(Cameras(**doubles, size=cameras.size), views.bits, views.pixels, views.colors)
    clouds = CloudSet(training.clouds.conditions.double(), training.clouds.rows, {})
    exact = Training(training.folder, clouds, training.settings, CPU, training.tell)

    def loss():
        return method.loss(exact, 1, generator(CPU, 0, STEP, 1))

    loss().backward()
    for value in (method.motion[-1].bias, method.skin[-1].weight, method.colors, method.scales):
        direction = torch.randn_like(value)
        ends = []
        with torch.no_grad():
            for step in (1e-7, -1e-7):
                value.add_(step * direction)
                ends.append(loss().item())
                value.sub_(step * direction)
        assert (value.grad * direction).sum().item() == pytest.approx((ends[0] - ends[1]) / 2e-7, rel=1e-3, abs=1e-6)


def test_a_moment_of_fitting_shows_the_pose(method, training, views):
    camera = torch.arange(len(views.cameras))
    colors, masks = views.images(torch.full_like(camera, 3), camera)

    def error():
        with torch.no_grad():
            still = method.means.expand(8, -1, -1), method.canonical().expand(8, -1, -1, -1)
            picture = rasterise(method.dressed(*still), views.cameras, camera)
            squares = (picture.colors - colors).square().mean(dim=-1)
            return ((squares * masks).sum() / masks.sum()).item(), (picture.opacity - masks).abs().mean().item()

    before = error()
    method.fit(views, 3, steps=60)
    after = error()
    assert after[0] < 0.4 * before[0] and after[1] < 0.8 * before[1]
    with torch.no_grad():
        still = method.means.expand(8, -1, -1), method.canonical().expand(8, -1, -1, -1)
        cloud = fused(rasterise(method.dressed(*still), views.cameras, camera), views.cameras)
    own = training.clouds.rows[..., :3]
    assert chamfer(cloud, own[3]) < 0.3 * min(chamfer(cloud, own[k]) for k in (0, 1, 2, 4))


def test_a_cloud_is_of_its_own_seed(method):
    conditions = torch.rand(2, 7)
    both = method.points(conditions, 50, [4, 5])
    torch.testing.assert_close(method.points(conditions[1:], 50, [5])[0], both[1])
    assert not torch.equal(method.points(conditions[1:], 50, [6])[0], both[1])

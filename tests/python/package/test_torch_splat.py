"""Kinematic 3D Gaussians: pictures beside a dense reference written from Kerbl et al. (2023), derivatives, bones, depth."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="no PyTorch here: install tests/python/requirements-torch.txt")

import tdcr  # noqa: E402
from tdcr import _tdcr  # noqa: E402
from tdcr.errors import InputError  # noqa: E402
from tdcr.torch import CloudSet  # noqa: E402
from tdcr.torch.baselines import Settings, Training, splat  # noqa: E402
from tdcr.torch.baselines._blend import blend  # noqa: E402
from tdcr.torch.baselines._rasterise import NEAR, Gaussians, Projected, blended, pair, project, rasterise  # noqa: E402
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
    opacities, colors = torch.rand(count, dtype=dtype), torch.rand(2, count, 3, dtype=dtype)
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
    for mean, covariance, o, color in zip(means, covariances, gaussians.opacities, gaussians.colors[k], strict=True):
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
    gaussians = Gaussians(means[None], walls, opacities, torch.eye(3, dtype=torch.float64)[None])
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


def crowd(pictures=2, count=300, size=(45, 52)):
    """Gaussians on the planes of pictures of 52 x 45 pixels, in front of and behind each other, and weights of a function."""
    numbers = torch.Generator().manual_seed(11)

    def rand(*shape):
        return torch.rand(*shape, generator=numbers)

    means = rand(pictures, count, 2) * torch.tensor([size[1], size[0]]) * 1.2 - 5
    factors = torch.randn(pictures, count, 2, 2, generator=numbers) * 1.5
    full = factors @ factors.mT + 0.3 * torch.eye(2)
    covariances = torch.stack([full[..., 0, 0], full[..., 0, 1], full[..., 1, 1]], dim=-1)
    opacities = 0.02 + 0.975 * rand(count)
    # At its bound in its middle; never seen, as its opacity is too small.
    opacities[0], opacities[1] = 0.9999, 0.003
    # One behind another, until nothing is left of the light.
    means[:, 2:8], covariances[:, 2:8], opacities[2:8] = torch.tensor([20.2, 14.9]), torch.tensor([30.0, 5.0, 20.0]), 0.98
    made = (means, covariances, 0.5 + rand(pictures, count), opacities, rand(pictures, count, 3))
    weights = rand(pictures, size[0] * size[1], 4)
    return made, weights, size


def differentiated(found, weights, made):
    """Derivatives of a weighted sum of colours and opacities by means, covariances, opacities and colours."""
    total = (weights * torch.cat([found[0], found[1][..., None]], dim=-1)).sum()
    return torch.autograd.grad(total, [made[0], made[1], made[3], made[4]])


def test_the_native_module_blends_as_pytorch_does_and_so_do_its_derivatives():
    made, weights, size = crowd()
    single = [part.clone().requires_grad_() for part in made]
    double = [part.double().requires_grad_() for part in made]
    found = blend(*single, *size, NEAR)
    picture = blended(Projected(double[0], double[1], double[2].detach()), double[3], double[4], size)
    expected = (picture.colors, picture.opacity)
    bounds = torch.aminmax(picture.opacity.detach())
    assert float(bounds.max) > 0.999 and float(bounds.min) == 0.0
    for one, other in zip(found, (*expected, picture.depth), strict=False):
        # A pixel may stop at another Gaussian, as its transmittance is 1e-4 within rounding: less than 2e-4 of its light.
        torch.testing.assert_close(one.double(), other, atol=2e-4, rtol=0)
    gradients = differentiated(found, weights, single), differentiated(expected, weights.double(), double)
    for one, other in zip(*gradients, strict=True):
        assert float(other.abs().max()) > 0.5
        torch.testing.assert_close(one.double(), other, atol=2e-4 * float(other.abs().max()), rtol=2e-3)


def test_the_derivatives_of_the_native_module_are_those_of_double_differences():
    made, weights, size = crowd(1, 12, (14, 16))
    made = (made[0] * 0.3 + 4, made[1], made[2], 0.2 + 0.5 * made[3], made[4])
    single = [part.clone().requires_grad_() for part in made]
    slopes = differentiated(blend(*single, *size, NEAR), weights, single)
    double = [part.double() for part in made]

    def total(parts):
        picture = blended(Projected(parts[0], parts[1], parts[2]), parts[3], parts[4], size)
        return float((weights.double() * torch.cat([picture.colors, picture.opacity[..., None]], dim=-1)).sum())

    numbers = torch.Generator().manual_seed(1)
    for place, slope in zip((0, 1, 3, 4), slopes, strict=True):
        direction = torch.randn(double[place].shape, generator=numbers, dtype=torch.float64)
        ends = []
        for step in (1e-7, -1e-7):
            moved = list(double)
            moved[place] = double[place] + step * direction
            ends.append(total(moved))
        found = float((slope.double() * direction).sum())
        assert found == pytest.approx((ends[0] - ends[1]) / 2e-7, rel=2e-3, abs=2e-3), place


def test_pictures_do_not_depend_on_bands_or_threads():
    made, weights, size = crowd()
    arrays, shape = tuple(part.numpy() for part in made), (size[1], size[0])
    by_pixels = weights[..., :3].contiguous().numpy(), weights[..., 3].contiguous().numpy()

    def both(rows=None):
        pictures = _tdcr.blend_gaussians(arrays, shape, NEAR, rows)
        return pictures, _tdcr.blend_gaussians_backward(arrays, shape, NEAR, *by_pixels, rows)

    pictures, gradients = both()
    for rows in (1, 7, 1000):
        others, slopes = both(rows)
        for one, other in zip(pictures, others, strict=True):
            np.testing.assert_array_equal(one, other)
        for one, other in zip(gradients, slopes, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-4 * np.abs(one).max())
    threads = tdcr.threads()
    try:
        for count in (1, 2, 3):
            tdcr.set_threads(count)
            again = both()
            for one, other in zip(pictures + gradients, again[0] + again[1], strict=True):
                np.testing.assert_array_equal(one, other)
    finally:
        tdcr.set_threads(threads)


def test_blending_is_an_operator_of_pytorch():
    made, _, size = crowd(2, 20, (9, 12))
    differentiable = [part.clone().requires_grad_(place != 2) for place, part in enumerate(made)]
    torch.library.opcheck(blend, (*differentiable, *size, NEAR))


def test_gaussians_that_are_no_numbers_are_not_seen_and_other_shapes_are_refused():
    made, _, size = crowd(1, 30, (20, 20))
    broken = [part.clone() for part in made]
    broken[0][0, 3], broken[1][0, 4], broken[2][0, 5], broken[3][6] = math.nan, math.nan, math.nan, math.nan
    broken[0][0, 7], broken[1][0, 8] = 1e30, math.inf
    kept = [k for k in range(30) if k not in (3, 4, 5, 6, 7, 8)]
    found = blend(*broken, *size, NEAR)
    expected = blend(*(part[:, kept] for part in made[:3]), made[3][kept], made[4][:, kept], *size, NEAR)
    for one, other in zip(found, expected, strict=True):
        assert torch.equal(one, other)
    with pytest.raises(InputError, match=r"covariances has shape \[1, 29, 3\], expected \[1, 30, 3\]"):
        blend(made[0], made[1][:, :29], *made[2:], *size, NEAR)
    with pytest.raises(InputError, match="bands of 0 rows; expected 1 or more"):
        _tdcr.blend_gaussians(tuple(part.numpy() for part in made), size, NEAR, 0)


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
        moved = method.moved(torch.rand(2, 7), weights)
    torch.testing.assert_close(weights.sum(dim=-1), torch.ones(60))
    torch.testing.assert_close(moved.means[1], method.means.detach(), atol=1e-6, rtol=0)
    torch.testing.assert_close(moved.covariances[1], method.canonical().detach(), atol=1e-8, rtol=1e-4)


def test_bones_that_move_alike_move_the_robot_as_a_whole(method):
    with torch.no_grad():
        weights, _ = method.weights()
        turn = splat.rotation_matrices(torch.tensor([0.9, 0.3, -0.2, 0.1]))
        shift = torch.tensor([0.1, -0.2, 0.3])
        centres = method.bone_centres
        method.pose = lambda conditions: splat.Bones(
            turn.expand(1, splat.BONES, 3, 3), (centres @ turn.T + shift - centres)[None]
        )
        moved = method.moved(torch.zeros(1, 7), weights)
        torch.testing.assert_close(moved.means[0], method.means @ turn.T + shift, atol=1e-5, rtol=0)
        torch.testing.assert_close(moved.covariances[0], turn @ method.canonical() @ turn.T, atol=1e-8, rtol=1e-3)
        assert float(method.stretch(moved.means)) < 1e-6


def test_colours_turn_with_the_gaussians(method):
    cameras, camera = method.cameras(), torch.arange(8)
    with torch.no_grad():
        method.shades.normal_(generator=torch.Generator().manual_seed(3))
        at_rest = method.still(cameras, camera)
        turn = splat.rotation_matrices(torch.tensor([0.9, 0.3, -0.2, 0.1]))
        everywhere = turn.expand(8, 60, 3, 3)
        moved = splat.Moved(at_rest.means @ turn.T, turn @ at_rest.covariances @ turn.T, everywhere)
        around = replace(cameras, centres=cameras.centres @ turn.T, rotations=cameras.rotations @ turn.T)
        turned = method.dressed(moved, around, camera)
    torch.testing.assert_close(turned.colors, at_rest.colors, atol=1e-5, rtol=0)
    # They are not the same from all sides.
    assert float((at_rest.colors[0] - at_rest.colors[3]).abs().max()) > 0.1


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
    for value in (method.motion[-1].bias, method.skin[-1].weight, method.colors, method.shades, method.scales):
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
            picture = rasterise(method.still(views.cameras, camera), views.cameras, camera)
            squares = (picture.colors - colors).square().mean(dim=-1)
            return ((squares * masks).sum() / masks.sum()).item(), (picture.opacity - masks).abs().mean().item()

    before = error()
    method.fit(views, 3, steps=60)
    after = error()
    assert after[0] < 0.4 * before[0] and after[1] < 0.8 * before[1]
    with torch.no_grad():
        cloud = fused(rasterise(method.still(views.cameras, camera), views.cameras, camera), views.cameras)
    own = training.clouds.rows[..., :3]
    assert chamfer(cloud, own[3]) < 0.3 * min(chamfer(cloud, own[k]) for k in (0, 1, 2, 4))


def test_a_cloud_is_of_its_own_seed(method):
    conditions = torch.rand(2, 7)
    both = method.points(conditions, 50, [4, 5])
    torch.testing.assert_close(method.points(conditions[1:], 50, [5])[0], both[1])
    assert not torch.equal(method.points(conditions[1:], 50, [6])[0], both[1])

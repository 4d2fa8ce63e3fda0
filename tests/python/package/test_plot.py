"""What figures show is where the robot is: drawn data against poses, lengths and dimensions."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tdcr
from tdcr.errors import InputError

matplotlib = pytest.importorskip("matplotlib")
matplotlib.use("Agg")

import matplotlib.pyplot as plt  # noqa: E402

from tdcr import plot  # noqa: E402

ROOT = Path(__file__).parents[3]
CLOCKED = {
    "name": "clocked",
    "gravity": [0.0, 0.0, -9.81],
    "routing": "base",
    "base": {
        "position": [0.02, -0.01, 0.1],
        "orientation": [0.9, 0.3, -0.1, 0.2],
        "holes": {"radius": 0.01, "degrees": [0, 120, 240]},
        "hole_height": -0.004,
    },
    "modules": [
        {
            "discs": 3,
            "pitch": 0.016,
            "radius": radius,
            "half_height": 0.002,
            "mass": {"density": 500.0},
            "holes": {"radius": 0.01, "degrees": [0, 120, 240]},
            "clocking_degrees": clocking,
            "damping": 0.01,
            "armature": 1e-4,
            "backbone": {"bending": [0.2, 0.2], "torsion": 0.2},
            "tendons": {"drive": {"gain": 400.0}, "range": [0.0, 0.1]},
        }
        for radius, clocking in ((0.015, 0.0), (0.012, 40.0), (0.011, 80.0))
    ],
    # Holes 3 and up are the copies that are turned as the modules above.
    "routes": [{"through": [["base", 4], [1, 6], [4, 4], [8, 2]], "tendon": {"drive": "tension", "range": [0.0, 5.0]}}],
}
ROBOTS: dict[str, Any] = {
    "2m": "2m",
    "all tendons from the base": ROOT / "examples/three-segments.toml",
    "routes": ROOT / "examples/every-field.toml",
    "clocked": CLOCKED,
    "clocked, from the module below": CLOCKED | {"routing": "module_below", "routes": []},
}


@pytest.fixture
def space() -> Iterator[Any]:
    figure = plt.figure()
    yield figure.add_subplot(projection="3d")
    plt.close(figure)


@pytest.fixture
def flat() -> Iterator[Any]:
    figure, ax = plt.subplots()
    yield ax
    plt.close(figure)


def corners(discs: Any) -> np.ndarray:
    """Corners of discs that were drawn, shape (discs, corners, 3)."""
    return np.array(discs._faces)


@pytest.mark.parametrize("source", ROBOTS.values(), ids=ROBOTS.keys())
def test_tendons_are_drawn_as_long_as_they_are(space: Any, source: Any) -> None:
    robot = tdcr.Robot(source)
    settled = tdcr.settle(robot, robot.random_commands(1, seed=4)[0]).check()
    drawn = plot.robot(space, robot, settled, unit="m")
    paths = drawn.tendons._segments3d
    lengths = [np.linalg.norm(np.diff(path, axis=0), axis=1).sum() for path in paths]
    np.testing.assert_allclose(lengths, settled.lengths, atol=1e-12)


def test_discs_are_circles_about_the_backbone(space: Any) -> None:
    robot = tdcr.Robot(CLOCKED)
    settled = tdcr.settle(robot, robot.random_commands(1, seed=2)[0]).check()
    drawn = plot.robot(space, robot, settled)
    spine = np.array(drawn.backbone.get_data_3d()).T
    np.testing.assert_allclose(spine, 1e3 * np.vstack([[0.02, -0.01, 0.1], settled.positions]), atol=1e-9)
    rims = corners(drawn.discs)
    assert rims.shape == (9, 48, 3)
    offsets = rims - 1e3 * settled.positions[:, np.newaxis]
    radii = np.repeat([15.0, 12.0, 11.0], 3)
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=2), np.tile(radii[:, np.newaxis], 48), rtol=1e-9)
    # The normal of a disc is its z axis.
    w, x, y, z = settled.quaternions.T
    axes = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x**2 + y**2)], axis=1)
    np.testing.assert_allclose(np.einsum("nkc,nc->nk", offsets, axes), 0.0, atol=1e-9)


def test_axes_are_to_scale_with_units_and_show_all_that_was_drawn(space: Any) -> None:
    robot = tdcr.Robot("3m")
    batch = tdcr.settle_batch(robot, robot.random_commands(4, seed=1))
    for k in range(4):
        plot.robot(space, robot, batch[k], color=plot.COLORS[k], label=f"command {k}", tendons=False)
    labels = [space.get_xlabel(), space.get_ylabel(), space.get_zlabel()]
    assert labels == ["x (mm)", "y (mm)", "z (mm)"]
    limits = np.array([space.get_xlim(), space.get_ylim(), space.get_zlim()])
    spans = np.ptp(limits, axis=1)
    np.testing.assert_allclose(spans / spans[0], space._box_aspect / space._box_aspect[0], rtol=1e-9)
    for artist in space.collections:
        places = corners(artist).reshape(-1, 3)
        assert (places >= limits[:, 0]).all() and (places <= limits[:, 1]).all()
    assert spans.max() < 600.0
    assert [text.get_text() for text in space.legend().get_texts()] == [f"command {k}" for k in range(4)]


def test_small_robots_fill_axes_in_metres(space: Any) -> None:
    robot = tdcr.Robot("2m")
    plot.robot(space, robot, (robot.straight_positions, np.tile([1.0, 0.0, 0.0, 0.0], (10, 1))), unit="m")
    low, high = space.get_zlim()
    assert 0.15 < low < high < 0.4
    assert space.get_zlabel() == "z (m)"


def test_modules_have_colours_of_their_own(space: Any) -> None:
    robot = tdcr.Robot("2m")
    settled = tdcr.settle(robot, robot.mean_command)
    drawn = plot.robot(space, robot, settled)
    edges = [matplotlib.colors.to_hex(color) for color in drawn.discs.get_edgecolor()]
    assert set(edges) == {plot.COLORS[0].lower(), plot.COLORS[1].lower()}


def test_a_cloud_is_drawn_with_its_colours_one_colour_or_values(space: Any) -> None:
    robot = tdcr.Robot("2m")
    cloud = tdcr.cloud(robot, tdcr.settle(robot, robot.mean_command), voxel=0.01)
    own = plot.cloud(space, cloud)
    x, y, z = own._offsets3d
    np.testing.assert_allclose(np.stack([x, y, z], axis=1), 1e3 * cloud.points.astype(float))
    # Matplotlib draws points from the farthest to the nearest.
    space.figure.canvas.draw()
    np.testing.assert_allclose(own.get_facecolor()[:, :3], cloud.colors[own._z_markers_idx] / 255.0)
    one = plot.cloud(space, cloud.points, color="black")
    assert {tuple(color) for color in one.get_facecolor()} == {(0.0, 0.0, 0.0, 1.0)}
    heights = cloud.points[:, 2]
    by_value = plot.cloud(space, cloud, values=heights)
    np.testing.assert_allclose(by_value.get_array(), heights)
    with pytest.raises(InputError, match="color and values are both given"):
        plot.cloud(space, cloud, values=heights, color="black")
    with pytest.raises(InputError, match=r"values has shape \(3,\)"):
        plot.cloud(space, cloud, values=heights[:3])


def test_a_workspace_shows_what_settled(space: Any, flat: Any) -> None:
    robot = tdcr.Robot("2m")
    wrench = np.zeros((20, 10, 6))
    # Moments that no tendon balances.
    wrench[[3, 8], 9, 3] = 10.0
    batch = tdcr.settle_batch(robot, robot.random_commands(20), wrench=wrench)
    kept = batch.tips[batch.converged]
    assert len(kept) == 18
    drawn = plot.workspace(space, batch, values=np.arange(20.0))
    np.testing.assert_allclose(np.stack(drawn._offsets3d, axis=1), 1e3 * kept)
    assert drawn.get_array().tolist() == [k for k in range(20) if k not in (3, 8)]
    for plane, columns in (("xz", [0, 2]), ("yz", [1, 2]), ("xy", [0, 1])):
        shown = plot.workspace(flat, kept, plane=plane, unit="m")
        np.testing.assert_allclose(shown.get_offsets(), kept[:, columns])
        assert (flat.get_xlabel(), flat.get_ylabel()) == (f"{plane[0]} (m)", f"{plane[1]} (m)")
    assert flat.get_aspect() == 1.0


@pytest.mark.parametrize(
    ("draw", "says"),
    [
        (lambda robot, flat, space: plot.robot(flat, robot, tdcr.settle(robot, robot.mean_command)), 'projection="3d"'),
        (lambda robot, flat, space: plot.cloud(flat, np.zeros((3, 3))), 'projection="3d"'),
        (lambda robot, flat, space: plot.cloud(space, np.zeros((3, 2))), r"cloud has shape \(3, 2\)"),
        (lambda robot, flat, space: plot.workspace(flat, np.zeros((3, 3)), plane="zx"), "plane is 'zx'"),
        (lambda robot, flat, space: plot.workspace(flat, np.zeros((3, 3)), unit="cm"), "unit is 'cm'; expected 'm' or 'mm'"),
        (
            lambda robot, flat, space: plot.robot(space, tdcr.Robot("3m"), tdcr.settle(robot, robot.mean_command)),
            r"positions has shape \(10, 3\); expected \(15, 3\)",
        ),
    ],
)
def test_what_cannot_be_drawn_is_refused(flat: Any, space: Any, draw: Any, says: str) -> None:
    with pytest.raises(InputError, match=says):
        draw(tdcr.Robot("2m"), flat, space)


def test_without_matplotlib_the_error_says_what_to_install() -> None:
    code = "import sys; sys.modules['matplotlib'] = None; import tdcr; import tdcr.plot"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "MissingPackageError: tdcr.plot needs Matplotlib, which is not installed: pip install matplotlib" in done.stderr


def test_an_animation_goes_through_the_motion_in_its_time() -> None:
    robot = tdcr.Robot("2m")
    ends = robot.random_commands(2, seed=3)
    motion = tdcr.simulate(robot, np.linspace(*ends, 30), start="settled", frame_skip=10)
    for fps, speed in ((25.0, 1.0), (10.0, 0.5), (50.0, 2.0)):
        ax = plt.figure().add_subplot(projection="3d")
        shown = tdcr.plot.animate(ax, "2m", motion, fps=fps, speed=speed)
        limits = np.array([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()])
        # From the first state to the last, a picture each 1 / fps; the robot is where it was then.
        times = np.arange(motion.times[0], motion.times[-1] + speed / fps, speed / fps).clip(max=motion.times[-1])
        assert shown._save_count == len(times)
        backbone, discs, tendons, trace, title = [], [], [], [], []
        for picture in range(len(times)):
            artists = shown._func(picture)
            backbone.append(np.array(artists[0].get_data_3d()).T)
            discs.append(corners(artists[1]))
            tendons.append(np.array(artists[2]._segments3d[0]))
            trace.append(np.array(artists[3].get_data_3d()).T)
            title.append(artists[4].get_text())
        for k, time in enumerate(times):
            (place,) = np.flatnonzero([np.allclose(backbone[k][1:], 1e3 * pose, atol=1e-9) for pose in motion.positions])
            # No other state is nearer in time.
            assert abs(motion.times[place] - time) <= np.abs(motion.times - time).min() + 1e-12
            assert title[k] == f"t = {motion.times[place]:.2f} s"
            # The tip's way up to then; and nothing leaves the axes, which stand still.
            assert np.allclose(trace[k], 1e3 * motion.tip[: place + 1])
            # Rims are circles about the discs' origins.
            assert np.allclose(discs[k].mean(axis=1), 1e3 * motion.positions[place])
            assert (backbone[k] >= limits[:, 0]).all() and (backbone[k] <= limits[:, 1]).all()
        assert not np.allclose(tendons[0], tendons[-1])
        assert np.array_equal(limits, [ax.get_xlim(), ax.get_ylim(), ax.get_zlim()])
        assert (ax.get_xlabel(), ax.get_zlabel()) == ("x (mm)", "z (mm)")
        plt.close(ax.figure)


def test_an_animation_of_a_path_is_a_file_of_moving_pictures(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    robot = tdcr.Robot("2m")
    path = tdcr.follow(robot, np.linspace(*robot.random_commands(2, seed=3), 4))
    ax = plt.figure(figsize=(2, 2)).add_subplot(projection="3d")
    shown = tdcr.plot.animate(ax, robot, path, tendons=False, trace=False)
    shown.save(tmp_path / "path.gif", writer="pillow")
    with image.open(tmp_path / "path.gif") as file:
        assert file.n_frames == 4
        frames = []
        for number in range(4):
            file.seek(number)
            frames.append(np.array(file.convert("L")))
    assert all((frames[k] != frames[k + 1]).sum() > 50 for k in range(3))
    assert shown._func(3)[4].get_text() == "pose 4 of 4"
    assert "<img" in shown.to_jshtml()
    plt.close(ax.figure)


def test_animations_that_make_no_sense_are_refused() -> None:
    robot = tdcr.Robot("2m")
    path = tdcr.follow(robot, robot.random_commands(3))
    ax = plt.figure().add_subplot(projection="3d")
    for arguments, says in (
        ({"fps": 0.0}, "fps is 0.0; expected a number above 0"),
        ({"speed": -1.0}, "speed is -1.0; expected a number above 0"),
        ({"times": [0.0, 1.0]}, r"times has shape \(2,\); expected \(3,\)"),
        ({"times": [0.0, 2.0, 1.0]}, "times do not rise"),
        ({"times": [0.0, 1.0, 1e9]}, "pictures, of 1e\\+09 s at 25 a second and speed 1; expected at most 100000"),
    ):
        with pytest.raises(InputError, match=says):
            tdcr.plot.animate(ax, robot, path, **arguments)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="there are no poses"):
        tdcr.plot.animate(ax, robot, path[:0])
    with pytest.raises(InputError, match='expected axes with projection="3d"'):
        tdcr.plot.animate(plt.figure().add_subplot(), robot, path)  # type: ignore[arg-type]
    plt.close("all")

"""What our cameras see against MuJoCo's renderer: the same model, pose and cameras."""

import json

import mujoco
import numpy as np
import pytest
import scipy.spatial
from mujoco_statics import place
from paper_robots import ROBOTS
from PIL import Image

COMMANDS = 2
BACKGROUND, BASE, DISCS = 0, 1, 10_000


class Views:
    """The folder that `tdcr render` wrote."""

    def __init__(self, folder):
        self.folder = folder
        self.json = json.loads((folder / "views.json").read_text())
        self.cameras = self.json["cameras"]

    def depth(self, camera):
        return np.load(self.folder / self.cameras[camera]["depth_npy"])

    def image(self, camera, kind):
        return np.array(Image.open(self.folder / self.cameras[camera][kind]))


class MujocoEye:
    """MuJoCo's renderer of a model: depth (m, 0 on background) and the number of the geom at each pixel."""

    def __init__(self, m):
        # Facets finer than a pixel: MuJoCo draws a cylinder as a prism.
        m.vis.quality.numslices = 128
        # No blending of pixels at edges.
        m.vis.quality.offsamples = 0
        self.renderer = mujoco.Renderer(m, m.vis.global_.offheight, m.vis.global_.offwidth)
        self.option = mujoco.MjvOption()
        self.option.sitegroup[:] = 0
        self.option.tendongroup[:] = 0

    def see(self, d, camera):
        self.renderer.update_scene(d, camera, self.option)
        self.renderer.enable_depth_rendering()
        depth = self.renderer.render().copy()
        self.renderer.disable_depth_rendering()
        self.renderer.enable_segmentation_rendering()
        ids, kinds = np.moveaxis(self.renderer.render(), 2, 0)
        self.renderer.disable_segmentation_rendering()
        geoms = np.where(kinds == int(mujoco.mjtObj.mjOBJ_GEOM), ids, -1)
        return np.where(geoms >= 0, depth, 0), geoms

    def close(self):
        self.renderer.close()


@pytest.fixture
def render(tdcr, tmp_path):
    def run(robot, command, *options):
        folder = tmp_path / f"views{len(list(tmp_path.iterdir()))}"
        text = ",".join(repr(float(c)) for c in command)
        tdcr("render", "--robot", robot, "--command", text, "--out", folder, *options)
        return Views(folder)

    return run


def value_of_geom(m):
    """The value that each geom of MuJoCo's has in our masks."""
    names = [m.body(m.geom_bodyid[g]).name for g in range(m.ngeom)]
    return np.array([DISCS + int(name[4:]) if name.startswith("disc") else BASE for name in names])


@pytest.mark.parametrize("base", [[], ["--base"]], ids=["bare", "base"])
@pytest.mark.parametrize("robot", ROBOTS)
def test_all_cameras_see_what_mujoco_sees(robot, base, tdcr, settle, render, rng):
    m = mujoco.MjModel.from_xml_string(tdcr("export", "--robot", robot, *base)["text"])
    values = value_of_geom(m)
    eye = MujocoEye(m)
    for command in rng.uniform(0.0, 0.04, size=(COMMANDS, m.nu)):
        d = place(m, settle(robot, command)["orientations"], command, 0.0)
        views = render(robot, command, *base)
        assert len(views.cameras) == m.ncam == 8
        for camera in range(m.ncam):
            theirs, geoms = eye.see(d, camera)
            ours, mask = views.depth(camera), views.image(camera, "mask").astype(int)
            np.testing.assert_array_equal(ours > 0, mask != BACKGROUND)
            both, either = (ours > 0) & (theirs > 0), (ours > 0) | (theirs > 0)
            assert both.sum() / either.sum() >= 0.995, (camera, both.sum() / either.sum())
            off = np.abs(ours - theirs)[both]
            assert (off <= 2e-4).mean() >= 0.995, (camera, np.quantile(off, 0.995))
            # And it is the same disc, but for pixels at edges.
            assert (mask == values[geoms])[both].mean() >= 0.99, camera
    eye.close()


def test_images_say_the_same_in_every_format(render):
    views = render("2m", [0.034, 0.007, 0.001, 0.026, 0.015, 0.019], "--base")
    listed = {entry["value"]: entry for entry in views.json["mask"]}
    pixels = dict.fromkeys(listed, 0)
    for camera in range(8):
        depth, mask = views.depth(camera), views.image(camera, "mask")
        assert depth.dtype == np.float32 and depth.shape == (720, 1280)
        millimetres = views.image(camera, "depth_png")
        assert np.abs(millimetres - 1e3 * depth.astype(float)).max() <= 0.5001
        color = views.image(camera, "color")
        assert color.shape == (720, 1280, 3)
        np.testing.assert_array_equal(color.any(axis=2), depth > 0)
        for value, count in zip(*np.unique(mask, return_counts=True)):
            pixels[int(value)] += int(count)
    assert pixels == {value: entry["pixels"] for value, entry in listed.items()}
    assert listed[BASE]["instance"] == "base" and listed[DISCS + 9]["instance"] == "disc 9"


def test_the_cloud_is_what_the_images_show(render):
    views = render("2m", [0.034, 0.007, 0.001, 0.026, 0.015, 0.019])
    points = []
    for camera, view in enumerate(views.cameras):
        k, depth = view["intrinsics"], views.depth(camera).astype(float)
        v, u = np.nonzero(depth)
        z = depth[v, u]
        local = np.stack([(u - k["cx"]) / k["fx"] * z, (v - k["cy"]) / k["fy"] * z, z], axis=1)
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, np.array(view["orientation"]))
        points.append(local @ rotation.reshape(3, 3).T + view["position"])
    points = np.concatenate(points)
    head, body = (views.folder / "cloud.ply").read_bytes().split(b"end_header\n", 1)
    cloud = np.frombuffer(body, dtype=[("p", "<f4", 3), ("c", "u1", 3)])["p"].astype(float)
    assert len(cloud) == views.json["points"] and f"vertex {len(cloud)}\n".encode() in head
    cells = np.unique(np.floor(points.astype(np.float32).astype(float) / 0.002), axis=0)
    assert abs(len(cells) - len(cloud)) <= 3  # a point on a cell's face may round to either side
    off, _ = scipy.spatial.cKDTree(points).query(cloud)
    assert off.max() < 1e-6

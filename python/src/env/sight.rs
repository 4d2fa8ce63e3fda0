//! What cameras see of a robot of a batch: pictures, and clouds of fixed size.

use nalgebra::{Isometry3, Vector3};
use tdcr::sim::camera::{Camera, Intrinsics};
use tdcr::sim::cloud::{PointCloud, VoxelGrid};
use tdcr::sim::geometry::{Instance, Shape};
use tdcr::sim::render::{BaseVisibility, RgbdFrame, Visuals};

use super::row::Row;
use crate::errors::{Failure, Outcome};

/// Size of the pictures that clouds are made of, and of the voxels that thin them (m).
const WIDTH: u32 = 160;
const HEIGHT: u32 = 90;
const VOXEL: f64 = 0.004;
/// Longest side of a picture.
const LARGEST_SIDE: u32 = 4096;
const TARGET_COLOR: [u8; 3] = [220, 30, 30];

/// The robot's cameras with pictures of another size, in which the height of the picture shows as much as before.
fn cameras(row: &Row, width: u32, height: u32) -> Vec<Camera> {
    let mut cameras = Camera::placed(&row.robot.spec().cameras);
    for camera in &mut cameras {
        let lens = camera.intrinsics;
        let zoom = f64::from(height) / f64::from(lens.height);
        let moved = |center: f64, old: u32, new: u32| {
            (center - (f64::from(old) - 1.0) / 2.0) * zoom + (f64::from(new) - 1.0) / 2.0
        };
        camera.intrinsics = Intrinsics {
            width,
            height,
            fx: lens.fx * zoom,
            fy: lens.fy * zoom,
            cx: moved(lens.cx, lens.width, width),
            cy: moved(lens.cy, lens.height, height),
            ..lens
        };
    }
    cameras
}

/// The picture of one of the robot's cameras, with its base, tendons, payload and obstacles, and balls of `radius` (m) at `targets` (m).
pub fn picture(
    row: &Row,
    size: [u32; 2],
    camera: usize,
    targets: &[[f64; 3]],
    radius: f64,
) -> Outcome<RgbdFrame> {
    let [width, height] = size;
    if !(1..=LARGEST_SIDE).contains(&width) || !(1..=LARGEST_SIDE).contains(&height) {
        let message =
            format!("a picture of {width} x {height}; expected sides of 1 to {LARGEST_SIDE}");
        return Err(Failure::input(message));
    }
    let cameras = cameras(row, width, height);
    let Some(camera) = cameras.get(camera) else {
        let message = format!("camera {camera}; the robot has {}", cameras.len());
        return Err(Failure::input(message));
    };
    let (robot, pose) = (&row.robot, row.shown.pose());
    let mut visuals = Visuals::of_robot(robot, pose, BaseVisibility::Shown);
    visuals.add_tendons(robot, pose);
    visuals.add_payload(robot, pose, &row.loads.tip_payload());
    visuals.add_scene(row.scene_now());
    for target in targets {
        let ball = Shape::sphere(radius).map_err(|error| Failure::input(error.to_string()))?;
        let [x, y, z] = *target;
        visuals.add_obstacle(ball, Isometry3::translation(x, y, z), TARGET_COLOR);
    }
    Ok(visuals.render(camera))
}

/// Writes as many points (m) as `out` has room for, taken evenly from what all cameras see of the robot without its base,
/// behind obstacles.
/// Repeats points where they see fewer; all are the tip where they see none.
pub fn cloud(row: &Row, out: &mut [[f32; 3]]) {
    let mut visuals = Visuals::of_robot(&row.robot, row.shown.pose(), BaseVisibility::Hidden);
    visuals.add_scene(row.scene_now());
    let mut seen = PointCloud::default();
    for camera in cameras(row, WIDTH, HEIGHT) {
        let mut frame = visuals.render(&camera);
        // Obstacles hide the robot, and are not part of it.
        for (depth, instance) in frame.depth.iter_mut().zip(&frame.mask) {
            if matches!(instance, Instance::Obstacle(_)) {
                *depth = 0.0;
            }
        }
        seen.add_frame(&frame);
    }
    let seen = seen.voxel_downsample(VoxelGrid::new(VOXEL)).points;
    let count = out.len();
    let tip = row
        .shown
        .positions
        .last()
        .map_or([0.0; 3], |p: &Vector3<f64>| {
            [p.x as f32, p.y as f32, p.z as f32]
        });
    for (k, out) in out.iter_mut().enumerate() {
        *out = seen.get(k * seen.len() / count).copied().unwrap_or(tip);
    }
}

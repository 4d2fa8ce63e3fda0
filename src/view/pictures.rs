//! What the robot's cameras see, as pictures for the page.

use tdcr_sim::camera::{Camera, Intrinsics};
use tdcr_sim::geometry::Instance;
use tdcr_sim::pose::Pose;
use tdcr_sim::render::{BaseVisibility, RgbdFrame, Visuals};
use tdcr_sim::robot::{Payload, Robot};
use tdcr_sim::scene::Scene;

use super::frame::Kind;

/// Columns of a picture on the page, at the most.
const COLUMNS: u32 = 320;
/// What is behind everything, 8-bit RGB.
const BACKGROUND: [u8; 3] = [236, 239, 243];

/// A picture of each camera of the robot's file, as messages.
pub(super) fn of(robot: &Robot, scene: &Scene, pose: Pose<'_>, payload: &Payload) -> Vec<Vec<u8>> {
    let cameras = Camera::placed(&robot.spec().cameras);
    let cameras: Vec<Camera> = cameras.iter().map(coarse).collect();
    let mut seen = Visuals::of_robot(robot, pose, BaseVisibility::Shown);
    seen.add_tendons(robot, pose);
    seen.add_payload(robot, pose, payload);
    seen.add_scene(scene);
    let mut frames = Vec::new();
    seen.render_all_into(&cameras, &mut frames);
    let count = frames.len();
    let numbered = frames.iter().enumerate();
    numbered
        .map(|(index, frame)| bytes([index, count], frame))
        .collect()
}

/// The same camera with fewer pixels.
fn coarse(camera: &Camera) -> Camera {
    let fine = camera.intrinsics;
    let share = f64::from(COLUMNS.min(fine.width)) / f64::from(fine.width);
    let pixels = |count: u32| ((f64::from(count) * share).round() as u32).max(1);
    // Pixel centres are at whole numbers.
    let centre = |centre: f64| (centre + 0.5) * share - 0.5;
    Camera {
        intrinsics: Intrinsics {
            width: pixels(fine.width),
            height: pixels(fine.height),
            fx: fine.fx * share,
            fy: fine.fy * share,
            cx: centre(fine.cx),
            cy: centre(fine.cy),
            ..fine
        },
        ..camera.clone()
    }
}

/// A picture as a message: its number, how many there are, columns and rows as little-endian `f64`s, then 8-bit RGB.
fn bytes([index, count]: [usize; 2], frame: &RgbdFrame) -> Vec<u8> {
    let Intrinsics { width, height, .. } = frame.camera.intrinsics;
    let head = [
        Kind::Picture.number(),
        index as f64,
        count as f64,
        f64::from(width),
        f64::from(height),
    ];
    let mut message: Vec<u8> = head.into_iter().flat_map(f64::to_le_bytes).collect();
    let pixels = frame.color.iter().zip(&frame.mask);
    message.extend(pixels.flat_map(|(&color, instance)| match instance {
        Instance::Background => BACKGROUND,
        _ => color,
    }));
    message
}

//! What the robot's cameras see, as pictures for the page: drawn, or taken by the cameras of a rig.

use tdcr_hw::mask::Mask;
use tdcr_hw::rig::Pictures;
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
/// What is mixed into pixels that show the robot, 8-bit RGB.
const MASKED: [u8; 3] = [255, 176, 32];

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

/// Pictures of a rig's cameras as messages: what the masks take for the robot is coloured, all else is dimmed.
pub(super) fn masked(pictures: &Pictures, masks: &[Mask]) -> Vec<Vec<u8>> {
    let count = pictures.frames.len();
    let frames = pictures.frames.iter().zip(masks).enumerate();
    let messages = frames.map(|(index, (frame, mask))| {
        let shown = mask.pixels();
        let pixel = |at: usize| {
            let color = frame.value.color[at];
            match shown[at] {
                true => [0, 1, 2].map(|k| color[k].midpoint(MASKED[k])),
                false => color.map(|channel| channel / 2),
            }
        };
        thinned([index, count], mask.size(), pixel)
    });
    messages.collect()
}

/// A picture that a camera took, in fewer columns, as a message.
pub(super) fn thinned(
    place: [usize; 2],
    [width, height]: [u32; 2],
    pixel: impl Fn(usize) -> [u8; 3],
) -> Vec<u8> {
    let stride = width.div_ceil(COLUMNS).max(1);
    let mut message = head(
        Kind::Taken,
        place,
        [width.div_ceil(stride), height.div_ceil(stride)],
    );
    for row in (0..height).step_by(stride as usize) {
        let start = row as usize * width as usize;
        let columns = (start..start + width as usize).step_by(stride as usize);
        message.extend(columns.flat_map(&pixel));
    }
    message
}

/// A drawn picture as a message.
fn bytes(place: [usize; 2], frame: &RgbdFrame) -> Vec<u8> {
    let Intrinsics { width, height, .. } = frame.camera.intrinsics;
    let mut message = head(Kind::Picture, place, [width, height]);
    let pixels = frame.color.iter().zip(&frame.mask);
    message.extend(pixels.flat_map(|(&color, instance)| match instance {
        Instance::Background => BACKGROUND,
        _ => color,
    }));
    message
}

/// How the message of a picture begins: its number, how many there are, columns and rows as little-endian `f64`s; 8-bit RGB follows.
fn head(kind: Kind, [index, count]: [usize; 2], [width, height]: [u32; 2]) -> Vec<u8> {
    let numbers = [
        kind.number(),
        index as f64,
        count as f64,
        f64::from(width),
        f64::from(height),
    ];
    numbers.into_iter().flat_map(f64::to_le_bytes).collect()
}

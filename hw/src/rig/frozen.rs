//! Cameras that repeat one picture, which shows a robot that has long moved on.
//!
//! The noise of a real camera makes each picture another, but a camera without noise, in memory, sees a robot at rest the same each time,
//! and one that does not see the robot at all may always see the same. So a picture that comes again, its colours or its depth to the
//! last bit, is only that of a frozen camera where the robot has moved in sight meanwhile: where the simulated robot, under the commands
//! that the servos' positions stood for at the first and at the last of these pictures, covers other pixels. While the motors are off,
//! nobody knows where the robot is, and nothing is found. Nor is it of a recording that is played beside other servos than its own:
//! what it shows is not the robot that they move.

use std::hash::{DefaultHasher, Hash, Hasher};

use tdcr_sim::render::{BaseVisibility, RgbdFrame, Visuals};
use tdcr_sim::robot::{Loads, Robot};

use super::file::{CameraLink, RigCameraSpec, ServoLink};
use super::{Rig, RigError};
use crate::camera::{CameraError, Stamped};

/// Share of the pixels that the robot covers in either of two pictures which, where it is covered in one of them alone, says that the
/// robot has moved in sight.
const MOVED: f64 = 0.1;

/// What a camera gave last, of colours or of depth.
#[derive(Clone, Debug)]
struct Image {
    /// A number that differs between images that differ, but for one in 2^64.
    fingerprint: u64,
    /// The command (m) that the servos' positions stood for when it came first.
    first: Vec<f64>,
    /// How often it came since.
    repeats: u32,
}

impl Image {
    /// Takes the next image, under a command; says the command of its first time where it is the same again.
    fn next(
        last: &mut Option<Self>,
        fingerprint: Option<u64>,
        command: &[f64],
    ) -> Option<Vec<f64>> {
        let Some(fingerprint) = fingerprint else {
            *last = None;
            return None;
        };
        match last {
            Some(image) if image.fingerprint == fingerprint => {
                image.repeats += 1;
                Some(image.first.clone())
            }
            _ => {
                *last = Some(Self {
                    fingerprint,
                    first: command.to_vec(),
                    repeats: 0,
                });
                None
            }
        }
    }
}

/// What is known of a camera's last pictures.
#[derive(Clone, Debug, Default)]
pub(super) struct LastImages {
    color: Option<Image>,
    depth: Option<Image>,
}

impl LastImages {
    /// How often either image has come since it came first.
    fn repeats(&self) -> u32 {
        let images = [&self.color, &self.depth].into_iter().flatten();
        images.map(|image| image.repeats).max().unwrap_or(0)
    }
}

/// Of an image by its pixels; `None` where all are the same: it shows nothing, as in the dark, whether it is frozen or not.
fn fingerprint<T: Hash + PartialEq>(pixels: &[T]) -> Option<u64> {
    let (first, rest) = pixels.split_first()?;
    if rest.iter().all(|pixel| pixel == first) {
        return None;
    }
    let mut hasher = DefaultHasher::new();
    pixels.hash(&mut hasher);
    Some(hasher.finish())
}

fn fingerprints(frame: &RgbdFrame) -> [Option<u64>; 2] {
    let depth: Vec<u32> = frame.depth.iter().map(|depth| depth.to_bits()).collect();
    [fingerprint(frame.color.as_flattened()), fingerprint(&depth)]
}

impl Rig {
    /// Refuses pictures of a camera that has given them before, while the robot moved in its sight.
    ///
    /// # Errors
    /// [`CameraError::Frozen`]; as [`hold_while`](Self::hold_while).
    pub(super) fn must_be_fresh(&mut self, frames: &[Stamped<RgbdFrame>]) -> Result<(), RigError> {
        let Some(states) = self.last_states() else {
            return Ok(());
        };
        let command: Vec<f64> = states.iter().map(|state| state.command).collect();
        for (index, frame) in frames.iter().enumerate() {
            if !self.sees_its_robot(index) {
                continue;
            }
            let [color, depth] = fingerprints(&frame.value);
            let last = &mut self.last_images[index];
            let repeated = [
                Image::next(&mut last.color, color, &command),
                Image::next(&mut last.depth, depth, &command),
            ];
            let repeats = last.repeats();
            let robot = self.robot.clone();
            for before in repeated.into_iter().flatten() {
                let moved = || moved_in_sight(&robot, &frame.value, [&before, &command]);
                if self.hold_while(moved)? {
                    let serial = self.cameras[index].serial().to_owned();
                    return Err(CameraError::Frozen { serial, repeats }.into());
                }
            }
        }
        Ok(())
    }

    /// Whether a camera sees the robot that the servos move.
    fn sees_its_robot(&self, camera: usize) -> bool {
        let spec = &self.file.spec;
        let played = |camera: &RigCameraSpec| matches!(camera.link, CameraLink::Recorded(_));
        let servos_played = matches!(spec.servos.link, ServoLink::Recorded(_));
        servos_played || !spec.cameras.get(camera).is_some_and(played)
    }
}

/// Whether the simulated robot covers other pixels of a camera under one command than under another.
fn moved_in_sight(robot: &Robot, frame: &RgbdFrame, commands: [&[f64]; 2]) -> bool {
    let [Some(before), Some(now)] = commands.map(|command| covered(robot, frame, command)) else {
        return false;
    };
    let [mut seen, mut changed] = [0, 0];
    for (&before, &now) in before.iter().zip(&now) {
        seen += usize::from(before || now);
        changed += usize::from(before != now);
    }
    changed > 0 && changed as f64 >= MOVED * seen as f64
}

/// Which pixels of a camera the simulated robot covers under a command, within its ranges: servos are some ticks off their goals. `None`
/// where the simulator does not know.
fn covered(robot: &Robot, frame: &RgbdFrame, command: &[f64]) -> Option<Vec<bool>> {
    let within = command.iter().zip(robot.tendons());
    let within: Vec<f64> = within
        .map(|(command, tendon)| command.clamp(tendon.range[0], tendon.range[1]))
        .collect();
    let command = robot.command(&within).ok()?;
    let settled = robot.settle(&command, &Loads::default());
    if !settled.converged {
        return None;
    }
    let visuals = Visuals::of_robot(robot, &settled, BaseVisibility::Hidden);
    let view = visuals.render(&frame.camera);
    Some(view.depth.iter().map(|&depth| depth > 0.0).collect())
}

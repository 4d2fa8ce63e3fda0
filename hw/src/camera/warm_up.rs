//! Waiting until a camera that was just started is steady.

use std::time::Duration;

use tdcr_sim::render::RgbdFrame;

use super::{CameraError, RgbdCamera};

/// What a camera must show before its pictures are used: auto-exposure changes brightness, and with it where depth is found,
/// in the first second or so.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WarmUp {
    /// Pictures thrown away in any case.
    pub least_frames: u32,
    /// Consecutive pictures that must be alike.
    pub steady_frames: u32,
    /// Largest change from picture to picture of the mean brightness, relative to it, and of the share of pixels that have a
    /// depth.
    pub tolerance: f64,
    /// How long to wait in all.
    pub patience: Duration,
}

/// What it took to warm up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WarmedUp {
    /// Pictures thrown away.
    pub frames: u32,
    /// Time it took.
    pub took: Duration,
}

impl Default for WarmUp {
    /// 15 pictures at least, then 5 within 1 % of each other, in no more than 10 s.
    fn default() -> Self {
        Self {
            least_frames: 15,
            steady_frames: 5,
            tolerance: 0.01,
            patience: Duration::from_secs(10),
        }
    }
}

/// What is compared between pictures.
struct Look {
    /// Mean of all channels, 0 to 255.
    brightness: f64,
    /// Share of pixels with a depth.
    coverage: f64,
}

impl Look {
    fn of(frame: &RgbdFrame) -> Self {
        let pixels = frame.color.len().max(1) as f64;
        let total: u64 = (frame.color.iter().flatten()).map(|&c| u64::from(c)).sum();
        let seen = frame.depth.iter().filter(|depth| **depth > 0.0).count();
        Self {
            brightness: total as f64 / (3.0 * pixels),
            coverage: seen as f64 / pixels,
        }
    }

    /// Changes of brightness and coverage since `before`. A black picture is compared in steps of 1.
    fn change(&self, before: &Look) -> [f64; 2] {
        let relative = (self.brightness - before.brightness).abs() / before.brightness.max(1.0);
        [relative, (self.coverage - before.coverage).abs()]
    }
}

impl WarmUp {
    /// Throws pictures of a camera away until it is steady.
    ///
    /// # Errors
    /// [`CameraError::Unsteady`] where it does not become so in time, and those of the camera.
    pub fn run(&self, camera: &mut impl RgbdCamera) -> Result<WarmedUp, CameraError> {
        self.run_in_turns(camera, self.patience, &mut || Ok(()))
    }

    /// The same, in turns that are no longer than `turn`; `between` is called after each.
    ///
    /// # Errors
    /// As [`run`](Self::run), and those of `between`.
    pub fn run_in_turns<E: From<CameraError>>(
        &self,
        camera: &mut impl RgbdCamera,
        turn: Duration,
        between: &mut dyn FnMut() -> Result<(), E>,
    ) -> Result<WarmedUp, E> {
        let start = camera.clock().now();
        let deadline = start + self.patience;
        let mut frames = 0;
        let mut alike = 0;
        let mut last: Option<Look> = None;
        let mut change = [0.0; 2];
        loop {
            let now = camera.clock().now();
            let frame = camera.grab_after(now, deadline.min(now.saturating_add(turn)));
            between()?;
            let frame = match frame {
                Err(CameraError::NoFrame { .. }) if camera.clock().now() < deadline => continue,
                // A camera that gave pictures until the end of the wait was there, but not steady.
                Err(CameraError::NoFrame { serial, .. }) if frames > 0 => {
                    return Err(E::from(CameraError::Unsteady {
                        serial,
                        waited: self.patience,
                        brightness: change[0],
                        coverage: change[1],
                        tolerance: self.tolerance,
                    }));
                }
                Err(CameraError::NoFrame { serial, .. }) => {
                    return Err(E::from(CameraError::NoFrame {
                        serial,
                        waited: self.patience,
                    }));
                }
                frame => frame?,
            };
            frames += 1;
            let look = Look::of(&frame.value);
            if let Some(last) = &last {
                change = look.change(last);
                let steady = change.iter().all(|change| *change <= self.tolerance);
                alike = if steady { alike + 1 } else { 0 };
            }
            last = Some(look);
            if frames >= self.least_frames && alike >= self.steady_frames {
                let took = camera.clock().now().saturating_sub(start);
                return Ok(WarmedUp { frames, took });
            }
        }
    }
}

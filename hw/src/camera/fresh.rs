//! Cameras that repeat themselves.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::time::Duration;

use tdcr_sim::render::RgbdFrame;

use super::{CameraError, RgbdCamera, Stamped, described_by};

/// A camera whose picture freezes fails, instead of showing a robot that has long moved on.
///
/// The noise of a real camera makes each picture another. Not for cameras without noise: theirs of a robot at rest are equal.
#[derive(Debug)]
pub struct Fresh<C> {
    camera: C,
    allowed: u32,
    last: Option<u64>,
    repeats: u32,
}

impl<C: RgbdCamera> Fresh<C> {
    /// Watches `camera`, and allows it to repeat a picture `allowed` times: firmware may give one twice where it drops one.
    pub fn new(camera: C, allowed: u32) -> Self {
        Self {
            camera,
            allowed,
            last: None,
            repeats: 0,
        }
    }
}

/// A number that differs between pictures that differ, but for one in 2^64.
fn fingerprint(frame: &RgbdFrame) -> u64 {
    let mut hasher = DefaultHasher::new();
    frame.color.hash(&mut hasher);
    for depth in &frame.depth {
        depth.to_bits().hash(&mut hasher);
    }
    hasher.finish()
}

impl<C: RgbdCamera> RgbdCamera for Fresh<C> {
    described_by!(|this| this.camera);

    fn grab_after(
        &mut self,
        after: Duration,
        deadline: Duration,
    ) -> Result<Stamped<RgbdFrame>, CameraError> {
        let frame = self.camera.grab_after(after, deadline)?;
        let seen = fingerprint(&frame.value);
        self.repeats = match self.last.replace(seen) {
            Some(last) if last == seen => self.repeats + 1,
            _ => 0,
        };
        if self.repeats > self.allowed {
            return Err(CameraError::Frozen {
                serial: self.camera.serial().to_owned(),
                repeats: self.repeats,
            });
        }
        Ok(frame)
    }
}

//! RGB-D cameras: one trait, what they give, and what is done alike with all of them.
//!
//! Times are those of the rig's [`Clock`]. A camera exposes pictures in a rhythm of its own, keeps the last few, and gives each
//! of them once. [`grab_all`] takes pictures of several cameras from one moment, [`Gathering`] does so in turns, [`WarmUp`] waits until a camera that was just
//! started has found its exposure, and [`UsbVersion::warning`] says what is wrong with a slow cable.

mod forward;
mod together;
mod usb;
mod warm_up;

pub(crate) use forward::described_by;
pub use together::{Gathering, Together, grab_all};
pub use usb::UsbVersion;
pub use warm_up::{WarmUp, WarmedUp};

use std::io;
use std::sync::Arc;
use std::time::Duration;

use nalgebra::Isometry3;
use tdcr_sim::camera::Camera;
use tdcr_sim::render::RgbdFrame;
use thiserror::Error;

use crate::clock::Clock;

/// A picture and when it was taken.
#[derive(Clone, Debug)]
pub struct Stamped<T> {
    /// Time of the rig's clock.
    pub time: Duration,
    /// What was seen then.
    pub value: T,
}

/// Why a camera gave no picture.
#[non_exhaustive]
#[derive(Debug, Error)]
pub enum CameraError {
    /// Nothing came in time.
    #[error("camera {serial} gave no picture within {} ms: is it plugged in?", waited.as_millis())]
    NoFrame {
        /// Which one.
        serial: String,
        /// How long.
        waited: Duration,
    },
    /// It was there, and is no longer.
    #[error("camera {serial} is gone: plug it in again, and open it anew")]
    Unplugged {
        /// Which one.
        serial: String,
    },
    /// The same picture came again, though what it should show has changed.
    #[error(
        "camera {serial} is frozen: it gave its last picture {repeats} times more, to the last bit, while the robot moved in its \
         sight; plug it in again"
    )]
    Frozen {
        /// Which one.
        serial: String,
        /// How often the picture came after its first time.
        repeats: u32,
    },
    /// Exposure or depth went on changing after the start.
    #[error(
        "camera {serial} did not become steady within {} s: brightness changed by {:.1} % and pixels with depth by {:.1} % from \
         picture to picture; expected no more than {:.1} %: is the light flickering, or the robot moving?",
        waited.as_secs_f64(), 100.0 * brightness, 100.0 * coverage, 100.0 * tolerance
    )]
    Unsteady {
        /// Which one.
        serial: String,
        /// How long.
        waited: Duration,
        /// Last relative change of the mean brightness.
        brightness: f64,
        /// Last change of the share of pixels that have a depth.
        coverage: f64,
        /// Largest change of either that counts as steady.
        tolerance: f64,
    },
    /// The device failed.
    #[error("camera {serial} failed: {source}")]
    Device {
        /// Which one.
        serial: String,
        /// The device's error.
        source: io::Error,
    },
}

/// A camera that gives colour and depth, depth laid onto the colour image.
pub trait RgbdCamera: Send {
    /// Its serial number, by which rigs name it.
    fn serial(&self) -> &str;

    /// Intrinsics and pose (m, world) of the colour camera, as far as they are known.
    fn camera(&self) -> &Camera;

    /// The factory's transform from the depth camera's frame to the colour camera's (m): identity where depth is measured in
    /// the colour camera's frame.
    fn depth_to_color(&self) -> Isometry3<f64>;

    /// What it is plugged into; `None` where it is on no USB.
    fn usb(&self) -> Option<UsbVersion>;

    /// The clock that its times are of.
    fn clock(&self) -> &Arc<dyn Clock>;

    /// The first picture exposed at `after` or later that the camera still has and has not given yet; waits for it until
    /// `deadline`, and where that has passed gives what there is. Both are times of the camera's [`clock`](Self::clock).
    ///
    /// # Errors
    /// [`CameraError`] where none comes in time.
    fn grab_after(
        &mut self,
        after: Duration,
        deadline: Duration,
    ) -> Result<Stamped<RgbdFrame>, CameraError>;

    /// The next picture taken after this call; waits for it, but not longer than `patience`.
    ///
    /// # Errors
    /// [`CameraError`] where none comes in time.
    fn grab(&mut self, patience: Duration) -> Result<Stamped<RgbdFrame>, CameraError> {
        let now = self.clock().now();
        self.grab_after(now, now + patience)
    }
}

impl<C: RgbdCamera + ?Sized> RgbdCamera for Box<C> {
    described_by!(|this| (**this));

    fn grab_after(
        &mut self,
        after: Duration,
        deadline: Duration,
    ) -> Result<Stamped<RgbdFrame>, CameraError> {
        (**self).grab_after(after, deadline)
    }
}

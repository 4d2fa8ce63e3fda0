//! RGB-D cameras: one trait, and what they give.

use std::io;
use std::time::Duration;

use nalgebra::Isometry3;
use tdcr_sim::camera::Camera;
use tdcr_sim::render::RgbdFrame;
use thiserror::Error;

/// A picture and when it was taken.
#[derive(Clone, Debug)]
pub struct Stamped<T> {
    /// Time of the rig's clock.
    pub time: Duration,
    /// What was seen then.
    pub value: T,
}

/// Why a camera gave no picture.
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

    /// Intrinsics and pose (m, world) of the colour camera.
    fn camera(&self) -> &Camera;

    /// The factory's transform from the depth camera's frame to the colour camera's (m).
    fn depth_to_color(&self) -> Isometry3<f64>;

    /// The next picture taken after this call; waits for it, but not longer than `patience`.
    ///
    /// # Errors
    /// [`CameraError`] where none comes in time.
    fn grab(&mut self, patience: Duration) -> Result<Stamped<RgbdFrame>, CameraError>;
}

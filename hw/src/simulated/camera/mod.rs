//! RGB-D cameras in memory: they see what is in front of them at the time of exposure.

mod faults;
mod surroundings;

pub use faults::{CameraFault, CameraFaults};
pub use surroundings::table;

use std::io;
use std::sync::Arc;
use std::time::Duration;

use nalgebra::Isometry3;
use tdcr_sim::camera::Camera;
use tdcr_sim::render::{RgbdFrame, Sensor, Visuals};

use crate::camera::{CameraError, RgbdCamera, Stamped, UsbVersion};
use crate::clock::Clock;

/// What simulated cameras see.
pub trait Subject: Send {
    /// What is seen at `time` of the rig's clock. It may lie some pictures before the last one asked for; a subject that cannot
    /// go back shows what it has.
    fn visuals_at(&mut self, time: Duration) -> Visuals;
}

/// Visuals in which nothing moves.
impl Subject for Visuals {
    fn visuals_at(&mut self, _: Duration) -> Visuals {
        self.clone()
    }
}

/// Whether pictures say what each pixel shows, which real cameras do not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Labels {
    /// Pixels with a depth are [`Instance::Unknown`](tdcr_sim::geometry::Instance::Unknown).
    Hidden,
    /// Pixels are what they are.
    Shown,
}

/// What a simulated camera is.
#[derive(Clone, Debug)]
pub struct CameraSetup {
    /// Serial number.
    pub serial: String,
    /// Intrinsics and true pose.
    pub camera: Camera,
    /// The pose that it is believed to have, for example by a calibration; `None` for the true one with the extrinsic error of
    /// the sensor.
    pub believed_pose: Option<Isometry3<f64>>,
    /// Its faults.
    pub sensor: Sensor,
    /// Seed of its noise.
    pub seed: u64,
    /// Its number: cameras of one seed and different numbers have different noise.
    pub number: u64,
    /// Time between pictures; above 0.
    pub period: Duration,
    /// Time of the first picture: cameras with equal phases expose at once, as with a sync cable.
    pub phase: Duration,
    /// Time constant with which exposure and depth settle after the clock's start; zero for at once.
    pub warm_up: Duration,
    /// What it is plugged into.
    pub usb: Option<UsbVersion>,
    /// What else is in sight besides the subject.
    pub surroundings: Visuals,
    /// Whether pictures say what each pixel shows.
    pub labels: Labels,
}

impl CameraSetup {
    /// An Intel RealSense D435 at 30 pictures a second at a USB 3.2 port, with nothing else in sight.
    pub fn d435(serial: impl Into<String>, camera: Camera) -> Self {
        Self {
            serial: serial.into(),
            camera,
            believed_pose: None,
            sensor: Sensor::d435(),
            seed: 0,
            number: 0,
            period: Duration::from_nanos(33_333_333),
            phase: Duration::ZERO,
            warm_up: Duration::ZERO,
            usb: Some(UsbVersion { major: 3, minor: 2 }),
            surroundings: Visuals::default(),
            labels: Labels::Hidden,
        }
    }

    /// The same without noise, and exactly where it is believed to be.
    pub fn ideal(serial: impl Into<String>, camera: Camera) -> Self {
        Self {
            sensor: Sensor::ideal(),
            ..Self::d435(serial, camera)
        }
    }
}

/// Pictures that a camera keeps until they are taken.
const KEPT: u32 = 8;

/// A camera in memory.
pub struct SimulatedCamera {
    setup: CameraSetup,
    subject: Box<dyn Subject>,
    clock: Arc<dyn Clock>,
    faults: CameraFaults,
    /// As it is believed to be.
    believed: Camera,
    /// Number of the next picture that it may give.
    next: u64,
    /// The last picture, without faults and with labels.
    truth: Vec<RgbdFrame>,
    /// The last picture that it gave.
    last: Option<RgbdFrame>,
}

impl SimulatedCamera {
    /// A camera that looks at `subject`.
    pub fn new(setup: CameraSetup, subject: Box<dyn Subject>, clock: Arc<dyn Clock>) -> Self {
        let drawn = || {
            // The sensor draws the error of a camera's pose with each of its pictures, always the same one.
            let nothing = RgbdFrame::new(&setup.camera);
            (setup.sensor.take(&nothing, setup.seed, setup.number, 0))
                .camera
                .pose
        };
        let believed = Camera {
            intrinsics: setup.camera.intrinsics,
            pose: setup.believed_pose.unwrap_or_else(drawn),
        };
        Self {
            setup,
            subject,
            clock,
            faults: CameraFaults::default(),
            believed,
            next: 0,
            truth: Vec::new(),
            last: None,
        }
    }

    /// The switch of its faults.
    pub fn faults(&self) -> CameraFaults {
        self.faults.clone()
    }

    /// The last picture as a camera without faults would have taken it, at the camera's true pose, with what each pixel
    /// shows: what masks and calibrations are measured by.
    pub fn truth(&self) -> Option<&RgbdFrame> {
        self.truth.first()
    }

    /// When picture `index` is exposed.
    fn exposure(&self, index: u64) -> Duration {
        let period = self.setup.period.as_nanos().max(1);
        let nanoseconds = u128::from(index) * period;
        self.setup.phase + Duration::from_nanos(u64::try_from(nanoseconds).unwrap_or(u64::MAX))
    }

    /// Number of the first picture at `time` or later.
    fn first_from(&self, time: Duration) -> u64 {
        let since = time.saturating_sub(self.setup.phase).as_nanos();
        let index = since.div_ceil(self.setup.period.as_nanos().max(1));
        u64::try_from(index).unwrap_or(u64::MAX)
    }

    /// Takes picture `index`.
    fn take(&mut self, index: u64) -> Result<RgbdFrame, CameraError> {
        let time = self.exposure(index);
        let mut visuals = self.subject.visuals_at(time);
        visuals
            .solids
            .extend_from_slice(&self.setup.surroundings.solids);
        visuals.render_all_into(std::slice::from_ref(&self.setup.camera), &mut self.truth);
        let setup = &self.setup;
        let mut frame = setup
            .sensor
            .take(&self.truth[0], setup.seed, setup.number, index);
        frame.camera = self.believed.clone();
        if !setup.warm_up.is_zero() {
            settle(&mut frame, time.div_duration_f64(setup.warm_up));
        }
        match setup.labels {
            Labels::Shown => Ok(frame),
            Labels::Hidden => {
                let RgbdFrame {
                    camera,
                    color,
                    depth,
                    ..
                } = frame;
                RgbdFrame::measured(&camera, color, depth).map_err(|error| CameraError::Device {
                    serial: setup.serial.clone(),
                    source: io::Error::other(error),
                })
            }
        }
    }
}

/// What auto-exposure has reached after `constants` time constants: pictures are darker by `exp(-constants)`, and as large a
/// share of the pixels, in a regular pattern, has no depth.
fn settle(frame: &mut RgbdFrame, constants: f64) {
    /// Pixels of the pattern.
    const PATTERN: usize = 64;
    let missing = (-constants).exp();
    for channel in frame.color.iter_mut().flatten() {
        *channel = (f64::from(*channel) * (1.0 - missing)).round() as u8;
    }
    let lost = (missing * PATTERN as f64).round() as usize;
    for (index, depth) in frame.depth.iter_mut().enumerate() {
        // 29 and 64 have no common factor: each of the pattern's pixels has its turn.
        if index * 29 % PATTERN < lost {
            *depth = 0.0;
        }
    }
}

impl RgbdCamera for SimulatedCamera {
    fn serial(&self) -> &str {
        &self.setup.serial
    }

    fn camera(&self) -> &Camera {
        &self.believed
    }

    /// Identity: depth is simulated in the colour camera's frame.
    fn depth_to_color(&self) -> Isometry3<f64> {
        Isometry3::identity()
    }

    fn usb(&self) -> Option<UsbVersion> {
        self.setup.usb
    }

    fn clock(&self) -> &Arc<dyn Clock> {
        &self.clock
    }

    fn grab_after(
        &mut self,
        after: Duration,
        deadline: Duration,
    ) -> Result<Stamped<RgbdFrame>, CameraError> {
        let asked = self.clock.now();
        let kept = asked.saturating_sub(KEPT * self.setup.period);
        let first = self.first_from(after.max(kept)).max(self.next);
        for index in first.. {
            let time = self.exposure(index);
            if time > deadline.max(asked) {
                break;
            }
            match self.faults.at(time) {
                Some(CameraFault::Stalled) => continue,
                Some(CameraFault::Unplugged) => {
                    self.clock.wait_until(time);
                    let serial = self.setup.serial.clone();
                    return Err(CameraError::Unplugged { serial });
                }
                Some(CameraFault::Frozen) | None => {}
            }
            self.clock.wait_until(time);
            self.next = index + 1;
            let frozen = self.faults.at(time) == Some(CameraFault::Frozen);
            let value = match self.last.take().filter(|_| frozen) {
                Some(last) => last,
                None => self.take(index)?,
            };
            self.last = Some(value.clone());
            return Ok(Stamped { time, value });
        }
        self.clock.wait_until(deadline);
        Err(CameraError::NoFrame {
            serial: self.setup.serial.clone(),
            waited: deadline.saturating_sub(asked),
        })
    }
}

#[cfg(test)]
mod tests;

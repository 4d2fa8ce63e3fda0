//! A camera that shows again what a log has.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use nalgebra::Isometry3;
use tdcr_sim::camera::{Camera, Intrinsics};
use tdcr_sim::render::RgbdFrame;

use super::stream::{RecordedError, Stream};
use crate::camera::{CameraError, RgbdCamera, Stamped, UsbVersion};
use crate::clock::Clock;
use crate::log::{Image, LogRecord, Topic, Transform, WORLD, camera_frame};

/// A camera of a log. Pictures are those that were logged, in their order and at their times.
pub struct RecordedCamera {
    stream: Stream,
    clock: Arc<dyn Clock>,
    serial: String,
    camera: Camera,
    depth_to_color: Isometry3<f64>,
    /// The first picture that nobody has taken.
    next: Option<Stamped<RgbdFrame>>,
}

impl RecordedCamera {
    /// The camera `serial` of the log at `path`. Time 0 of `clock` is that of the log's first message.
    ///
    /// # Errors
    /// [`RecordedError`] where the log cannot be read, or has no calibration or no pose of the camera.
    pub fn open(path: &Path, serial: &str, clock: Arc<dyn Clock>) -> Result<Self, RecordedError> {
        let Setup {
            camera,
            depth_to_color,
        } = setup(path, serial)?;
        Ok(Self {
            stream: Stream::open(path)?,
            clock,
            serial: serial.to_owned(),
            camera,
            depth_to_color,
            next: None,
        })
    }

    /// Reads the next picture into `self.next`, if nothing is there.
    fn fetch(&mut self) -> Result<(), RecordedError> {
        let (color, depth) = (
            Topic::Color(self.serial.clone()),
            Topic::Depth(self.serial.clone()),
        );
        let wanted = |topic: &Topic| *topic == color || *topic == depth;
        let mut half: Option<(Duration, Image<[u8; 3]>)> = None;
        while self.next.is_none() {
            let Some((time, record)) = self.stream.next(wanted)? else {
                return Err(self.stream.ended());
            };
            match record {
                LogRecord::Color { image, .. } => half = Some((time, image)),
                LogRecord::Depth { image, .. } => {
                    let pair = half.take().filter(|(of_color, _)| *of_color == time);
                    // An image whose other half is lost is none of ours; nor is one of another size than the camera's.
                    self.next = pair
                        .and_then(|(_, color)| {
                            RgbdFrame::measured(&self.camera, color.pixels, image.pixels).ok()
                        })
                        .map(|value| Stamped { time, value });
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn device(&self, error: RecordedError) -> CameraError {
        CameraError::Device {
            serial: self.serial.clone(),
            source: error.into(),
        }
    }
}

/// What a log says of a camera.
struct Setup {
    camera: Camera,
    depth_to_color: Isometry3<f64>,
}

/// Reads `path` until it has said where the camera is and how it sees.
fn setup(path: &Path, serial: &str) -> Result<Setup, RecordedError> {
    let mut stream = Stream::open(path)?;
    let mut found: BTreeSet<String> = BTreeSet::new();
    let mut intrinsics: Option<Intrinsics> = None;
    let mut pose = None;
    let mut depth_to_color = None;
    let of_cameras = |topic: &Topic| matches!(topic, Topic::Calibration(_) | Topic::Transforms);
    while let Some((_, record)) = stream.next(of_cameras)? {
        match record {
            LogRecord::Calibration {
                serial: other,
                intrinsics: of,
            } => {
                if other == serial {
                    intrinsics = Some(of);
                }
                found.insert(other);
            }
            LogRecord::Transforms(transforms) => {
                let depth = Transform::of_depth_sensor(serial, Isometry3::identity());
                for transform in transforms {
                    if transform.parent == WORLD && transform.child == camera_frame(serial) {
                        pose = Some(transform.pose);
                    } else if (&transform.parent, &transform.child) == (&depth.parent, &depth.child)
                    {
                        depth_to_color = Some(transform.pose);
                    }
                }
            }
            _ => {}
        }
        // Logs begin with all of it.
        if let (Some(intrinsics), Some(pose), Some(depth_to_color)) =
            (intrinsics, pose, depth_to_color)
        {
            return Ok(Setup {
                camera: Camera { intrinsics, pose },
                depth_to_color,
            });
        }
    }
    let missing = |missing| RecordedError::Camera {
        path: stream.path().to_owned(),
        serial: serial.to_owned(),
        missing,
        found: found.iter().cloned().collect(),
    };
    let intrinsics = intrinsics.ok_or_else(|| missing("calibration"))?;
    let pose = pose.ok_or_else(|| missing("pose"))?;
    Ok(Setup {
        camera: Camera { intrinsics, pose },
        depth_to_color: depth_to_color.unwrap_or_default(),
    })
}

impl RgbdCamera for RecordedCamera {
    fn serial(&self) -> &str {
        &self.serial
    }

    fn camera(&self) -> &Camera {
        &self.camera
    }

    fn depth_to_color(&self) -> Isometry3<f64> {
        self.depth_to_color
    }

    fn usb(&self) -> Option<UsbVersion> {
        None
    }

    fn clock(&self) -> &Arc<dyn Clock> {
        &self.clock
    }

    fn grab_after(
        &mut self,
        after: Duration,
        deadline: Duration,
    ) -> Result<Stamped<RgbdFrame>, CameraError> {
        let began = self.clock.now();
        let latest = deadline.max(began);
        loop {
            self.fetch().map_err(|error| self.device(error))?;
            match self.next.take() {
                Some(frame) if frame.time < after => {}
                Some(frame) if frame.time <= latest => {
                    self.clock.wait_until(frame.time);
                    return Ok(frame);
                }
                later => {
                    self.next = later;
                    self.clock.wait_until(latest);
                    return Err(CameraError::NoFrame {
                        serial: self.serial.clone(),
                        waited: latest - began,
                    });
                }
            }
        }
    }
}

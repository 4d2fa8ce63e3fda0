//! RealSense cameras behind [`RgbdCamera`].

use std::fmt;
use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use nalgebra::Isometry3;
use tdcr_sim::camera::{Camera, Intrinsics};
use tdcr_sim::render::RgbdFrame;

use super::align::Aligner;
use super::error::RealSenseError;
use super::handles::{Context, Device, Frame, Pipeline, Request, api_version, now};
use super::lens;
use super::library::{self, Calls, domain, format, info, stream};
use crate::camera::{CameraError, RgbdCamera, Stamped, UsbVersion};
use crate::clock::Clock;

/// Sets of pictures that a camera keeps until they are taken.
const KEPT: i32 = 8;

/// A camera that was silent for this long is looked for among those plugged in.
const SILENCE: Duration = Duration::from_millis(500);

/// Readings of both clocks of which the closest two tell how far they are apart.
const CLOCK_READINGS: usize = 5;

/// librealsense, loaded.
pub struct RealSense {
    context: Arc<Context>,
}

/// A camera that is plugged in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RealSenseInfo {
    /// Serial number.
    pub serial: String,
    /// Name of the product.
    pub name: String,
    /// Version of its firmware.
    pub firmware: String,
    /// What it is plugged into, where librealsense knows it.
    pub usb: Option<UsbVersion>,
}

/// How a camera is opened.
#[derive(Clone, Debug, PartialEq)]
pub struct RealSenseSetup {
    /// Serial number.
    pub serial: String,
    /// Pose of its colour camera in the world (m).
    pub pose: Isometry3<f64>,
    /// Width and height of depth images (pixels).
    pub depth: [u32; 2],
    /// Width and height of colour images, and so of frames (pixels).
    pub color: [u32; 2],
    /// Pictures per second.
    pub rate: u32,
}

impl RealSenseSetup {
    /// A D435 at the size at which its depth is best, and 30 pictures a second.
    pub fn d435(serial: impl Into<String>, pose: Isometry3<f64>) -> Self {
        Self {
            serial: serial.into(),
            pose,
            depth: [848, 480],
            color: [1280, 720],
            rate: 30,
        }
    }
}

impl RealSense {
    /// Loads the library that the environment variable `REALSENSE_LIBRARY` names, or else the system's.
    ///
    /// # Errors
    /// [`RealSenseError`] where there is none, or one that is too old.
    pub fn load() -> Result<Self, RealSenseError> {
        Self::load_from(&library::named_libraries())
    }

    /// Loads these libraries in order, of which the last is librealsense.
    ///
    /// # Errors
    /// [`RealSenseError`] where one cannot be loaded, or is too old.
    pub fn load_from(libraries: &[PathBuf]) -> Result<Self, RealSenseError> {
        let calls = Calls::load(libraries)?;
        let version = api_version(&calls)?;
        let (major, minor) = (version / 10_000, version / 100 % 100);
        if major != 2 || minor < 56 {
            return Err(RealSenseError::Version { major, minor });
        }
        let context = Arc::new(Context::new(&calls)?);
        Ok(Self { context })
    }

    /// The cameras that are plugged in.
    ///
    /// # Errors
    /// [`RealSenseError::Call`] where librealsense fails.
    pub fn cameras(&self) -> Result<Vec<RealSenseInfo>, RealSenseError> {
        self.context.devices()?.iter().map(describe).collect()
    }

    /// Opens a camera and starts its streams; warns where its USB port is slow.
    ///
    /// # Errors
    /// [`RealSenseError`] where it is not plugged in, cannot stream so, or its calibration is of no use.
    pub fn open(
        &self,
        setup: &RealSenseSetup,
        clock: Arc<dyn Clock>,
    ) -> Result<RealSenseCamera, RealSenseError> {
        let mut found = Vec::new();
        for device in self.context.devices()? {
            let info = describe(&device)?;
            if info.serial == setup.serial {
                return self.start(device, info, setup, clock);
            }
            found.push(info.serial);
        }
        if found.is_empty() {
            found.push("none".to_owned());
        }
        Err(RealSenseError::NoSuchCamera {
            serial: setup.serial.clone(),
            found: found.join(", "),
        })
    }

    #[cfg(test)]
    pub(super) fn calls(&self) -> &Arc<Calls> {
        self.context.calls()
    }

    /// Starts the streams of a camera that was found.
    pub(super) fn start(
        &self,
        device: Device,
        info: RealSenseInfo,
        setup: &RealSenseSetup,
        clock: Arc<dyn Clock>,
    ) -> Result<RealSenseCamera, RealSenseError> {
        let usb = info.usb.and_then(|usb| usb.warning(&info.serial));
        if let Some(warning) = &usb {
            tracing::warn!("{warning}");
        }
        let request = |stream, format, [width, height]: [u32; 2]| {
            // Sizes that are too large for a C int are too large for a camera too.
            let [width, height, rate] =
                [width, height, setup.rate].map(|n| i32::try_from(n).unwrap_or(i32::MAX));
            Request {
                stream,
                format,
                width,
                height,
                rate,
            }
        };
        let requests = [
            request(stream::DEPTH, format::Z16, setup.depth),
            request(stream::COLOR, format::RGB8, setup.color),
        ];
        let pipeline =
            Pipeline::start(&self.context, &device, &requests, KEPT).map_err(|error| {
                let size = |[width, height]: [u32; 2]| format!("{width} x {height}");
                match error {
                    RealSenseError::Call {
                        function, message, ..
                    } if function.contains("pipeline_start") => RealSenseError::Streams {
                        serial: setup.serial.clone(),
                        depth: size(setup.depth),
                        color: size(setup.color),
                        rate: setup.rate,
                        reason: message,
                        usb: usb.map_or(String::new(), |warning| format!("; {warning}")),
                    },
                    error => error,
                }
            })?;
        let depth = lens::intrinsics("depth", &pipeline.calibration.depth)?;
        let color = lens::intrinsics("colour", &pipeline.calibration.color)?;
        let depth_to_color = lens::depth_to_color(&pipeline.calibration.depth_to_color)?;
        Ok(RealSenseCamera {
            info,
            camera: Camera {
                intrinsics: color,
                pose: setup.pose,
            },
            depth,
            depth_to_color,
            aligner: Aligner::new(depth, color, depth_to_color),
            last_heard: clock.now(),
            last_given: None,
            device_clock: None,
            clock,
            pipeline,
            device,
            context: self.context.clone(),
        })
    }
}

/// What a camera says of itself.
pub(super) fn describe(device: &Device) -> Result<RealSenseInfo, RealSenseError> {
    let text = |info| device.info(info).map(Option::unwrap_or_default);
    Ok(RealSenseInfo {
        serial: text(info::SERIAL_NUMBER)?,
        name: text(info::NAME)?,
        firmware: text(info::FIRMWARE_VERSION)?,
        usb: device
            .info(info::USB_TYPE_DESCRIPTOR)?
            .and_then(|usb| usb.parse().ok()),
    })
}

/// A RealSense camera that streams.
pub struct RealSenseCamera {
    info: RealSenseInfo,
    camera: Camera,
    depth: Intrinsics,
    depth_to_color: Isometry3<f64>,
    aligner: Aligner,
    clock: Arc<dyn Clock>,
    /// When the last picture came, or the camera was opened.
    last_heard: Duration,
    /// Time of the last picture that was given.
    last_given: Option<Duration>,
    /// Smallest difference seen between the arrival (s, rig's clock) and the stamp (s) of pictures that the camera stamps by a
    /// clock of its own.
    device_clock: Option<f64>,
    pipeline: Pipeline,
    device: Device,
    /// Last, as the others were made of it.
    context: Arc<Context>,
}

impl fmt::Debug for RealSenseCamera {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RealSenseCamera")
            .field("info", &self.info)
            .field("camera", &self.camera)
            .finish_non_exhaustive()
    }
}

impl RealSenseCamera {
    /// What the camera says of itself.
    pub fn info(&self) -> &RealSenseInfo {
        &self.info
    }

    /// Intrinsics of the depth camera.
    pub fn depth_intrinsics(&self) -> &Intrinsics {
        &self.depth
    }

    /// Time of the rig's clock at which a set of pictures was taken.
    ///
    /// librealsense stamps by the computer's clock where it knows the difference to the camera's (global time). Pictures stamped
    /// by the camera's own clock are placed so that the quickest of them arrived at once.
    fn time_of(&mut self, frame: &Frame) -> Result<Duration, RealSenseError> {
        let (stamp, stamped_by) = frame.time()?;
        let seconds = match stamped_by {
            domain::HARDWARE_CLOCK => {
                let difference = self.clock.now().as_secs_f64() - stamp.0 / 1e3;
                let least = self
                    .device_clock
                    .map_or(difference, |least| least.min(difference));
                self.device_clock = Some(least);
                stamp.0 / 1e3 + least
            }
            domain::SYSTEM_TIME | domain::GLOBAL_TIME => stamp.0 / 1e3 + self.clock_offset()?,
            other => {
                return Err(RealSenseError::Picture {
                    stream: "depth",
                    what: format!("its time is of clock {other}; expected 0, 1 or 2"),
                });
            }
        };
        // Before the clock's start there is no time.
        Ok(Duration::try_from_secs_f64(seconds).unwrap_or_default())
    }

    /// What the rig's clock is ahead of librealsense's (s).
    ///
    /// librealsense's clock is read between two readings of the rig's (as in Cristian's algorithm), and the closest two of a few
    /// count: where the thread lost its processor between them, the difference would be off by as long.
    fn clock_offset(&self) -> Result<f64, RealSenseError> {
        let (mut closest, mut offset) = (f64::INFINITY, 0.0);
        for _ in 0..CLOCK_READINGS {
            let before = self.clock.now().as_secs_f64();
            let theirs = now(self.context.calls())?.0 / 1e3;
            let after = self.clock.now().as_secs_f64();
            if after - before < closest {
                (closest, offset) = (after - before, before.midpoint(after) - theirs);
            }
        }
        Ok(offset)
    }

    /// The frame that a set of pictures is, where both are in it.
    fn frame(&self, set: &Frame) -> Result<Option<RgbdFrame>, RealSenseError> {
        let (Some(depth), Some(color)) = (set.picture(stream::DEPTH)?, set.picture(stream::COLOR)?)
        else {
            return Ok(None);
        };
        let size = |k: &Intrinsics| [k.width as usize, k.height as usize];
        let units = depth.depth_units()?;
        let depth: Vec<f32> = (depth.rows("depth", size(&self.depth), 2)?)
            .flat_map(|row| row.as_chunks::<2>().0)
            .map(|pixel| f32::from(u16::from_ne_bytes(*pixel)) * units)
            .collect();
        let color: Vec<[u8; 3]> = (color.rows("colour", size(&self.camera.intrinsics), 3)?)
            .flat_map(|row| row.as_chunks::<3>().0)
            .copied()
            .collect();
        let frame = RgbdFrame::measured(&self.camera, color, self.aligner.align(&depth));
        frame.map(Some).map_err(|error| RealSenseError::Picture {
            stream: "colour",
            what: error.to_string(),
        })
    }

    /// The first set of pictures from `after` on; `None` where none comes before `deadline`.
    fn next(
        &mut self,
        after: Duration,
        deadline: Duration,
    ) -> Result<Option<Stamped<RgbdFrame>>, RealSenseError> {
        loop {
            let patience = deadline.saturating_sub(self.clock.now());
            let Some(set) = self.pipeline.wait(patience)? else {
                return Ok(None);
            };
            self.last_heard = self.clock.now();
            let time = self.time_of(&set)?;
            if time < after || self.last_given.is_some_and(|last| time <= last) {
                continue;
            }
            // Just after the start, sets may lack a picture.
            if let Some(value) = self.frame(&set)? {
                self.last_given = Some(time);
                return Ok(Some(Stamped { time, value }));
            }
        }
    }

    /// Whether the camera was silent for long and is no longer plugged in.
    fn is_gone(&self) -> bool {
        let silent = self.clock.now().saturating_sub(self.last_heard);
        // Where librealsense cannot tell, it is not known to be gone.
        silent >= SILENCE && matches!(self.context.has(&self.device), Ok(false))
    }
}

impl RgbdCamera for RealSenseCamera {
    fn serial(&self) -> &str {
        &self.info.serial
    }

    fn camera(&self) -> &Camera {
        &self.camera
    }

    fn depth_to_color(&self) -> Isometry3<f64> {
        self.depth_to_color
    }

    fn usb(&self) -> Option<UsbVersion> {
        self.info.usb
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
        let serial = self.info.serial.clone();
        match self.next(after, deadline) {
            Ok(Some(frame)) => Ok(frame),
            Ok(None) if self.is_gone() => Err(CameraError::Unplugged { serial }),
            Ok(None) => Err(CameraError::NoFrame {
                serial,
                waited: deadline.saturating_sub(asked),
            }),
            Err(RealSenseError::Call {
                disconnected: true, ..
            }) => Err(CameraError::Unplugged { serial }),
            Err(error) => Err(CameraError::Device {
                serial,
                source: io::Error::other(error),
            }),
        }
    }
}

//! The log of what a rig does and sees.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tdcr_sim::formats::urdf;
use tdcr_sim::render::RgbdFrame;

use super::{Rig, RigError};
use crate::camera::{CameraError, RgbdCamera, Stamped, described_by};
use crate::log::{
    Event, Level, LogRecord, LogSettings, LogWriter, ServoHome, SharedLog, servo_sink,
};
use crate::servo::{Record, Ticks};

type Sink = Box<dyn FnMut(Duration, Record<'_>) + Send>;

/// A log that is written, and what turns the records of servos into its own.
struct Open {
    log: SharedLog,
    servos: Sink,
}

/// Where records of a rig's parts go, once there is a log.
#[derive(Clone, Default)]
pub(super) struct LogSlot(Arc<Mutex<Option<Open>>>);

impl LogSlot {
    fn with(&self, write: impl FnOnce(&mut Open)) {
        if let Some(open) = &mut *self.0.lock().unwrap_or_else(PoisonError::into_inner) {
            write(open);
        }
    }

    fn replace(&self, open: Option<Open>) -> Option<Open> {
        std::mem::replace(
            &mut *self.0.lock().unwrap_or_else(PoisonError::into_inner),
            open,
        )
    }

    /// A sink for the calls of a bus.
    pub fn of_servos(&self) -> impl FnMut(Duration, Record<'_>) + Send + use<> {
        let slot = self.clone();
        move |time, record| slot.with(|open| (open.servos)(time, record))
    }

    /// A record of a time of the rig's clock.
    pub fn write(&self, time: Duration, record: impl FnOnce() -> LogRecord) {
        self.with(|open| open.log.write(time, record()));
    }

    /// The log that is written, if there is one.
    pub fn log(&self) -> Option<SharedLog> {
        let mut log = None;
        self.with(|open| log = Some(open.log.clone()));
        log
    }
}

/// A camera whose pictures are logged.
pub(super) struct LoggedCamera {
    pub camera: Box<dyn RgbdCamera>,
    pub slot: LogSlot,
}

impl RgbdCamera for LoggedCamera {
    described_by!(|this| this.camera);

    fn grab_after(
        &mut self,
        after: Duration,
        deadline: Duration,
    ) -> Result<Stamped<RgbdFrame>, CameraError> {
        let frame = self.camera.grab_after(after, deadline)?;
        // Not by the slot, which servos' records go through too: it may wait.
        if let Some(log) = self.slot.log() {
            log.frame(self.camera.serial(), &frame);
        }
        Ok(frame)
    }
}

/// Bytes that a log of somebody at work with a rig leaves on its disk: some clouds of tens of thousands of points, or a run's tables.
pub const LOG_LEAVES: u64 = 16 << 20;

impl Rig {
    /// Logs from now on, in a new file `STEM.mcap`, `STEM-2.mcap` and so on of `folder`, all that servos are told and say, what
    /// cameras see, commands, and what happens; begins with the robot, the cameras and where home is. With such a log in place
    /// of servos and cameras, the same program runs again as it ran. A log that was written until now ends.
    ///
    /// The log ends while `reserve` bytes are still free on its disk, for what is worth more. Where it cannot be written on, the rig
    /// goes on without: [`finish_log`](Self::finish_log) says why.
    ///
    /// # Errors
    /// [`RigError::Log`] where it cannot be begun.
    pub fn log_in(&mut self, folder: &Path, stem: &str, reserve: u64) -> Result<PathBuf, RigError> {
        self.finish_log()?;
        let settings = LogSettings {
            reserve,
            ..LogSettings::default()
        };
        let (writer, path) = LogWriter::create_numbered(folder, stem, &*self.clock, settings)?;
        let log = SharedLog::new(writer);
        let now = self.clock.now();
        log.write(now, LogRecord::Homes(self.known_homes()));
        match urdf::export(self.robot.spec()) {
            Ok(text) => log.write(now, LogRecord::Robot(text)),
            // A robot that URDF cannot hold moves all the same.
            Err(error) => tracing::debug!("{error}"),
        }
        for camera in &self.cameras {
            let (serial, seen) = (camera.serial().to_owned(), camera.camera().clone());
            let depth_to_color = camera.depth_to_color();
            log.with(move |log| log.camera(now, &serial, &seen, depth_to_color));
        }
        self.slot.replace(Some(Open {
            servos: Box::new(servo_sink(log.clone())),
            log,
        }));
        Ok(path)
    }

    /// Ends the log, if there is one.
    ///
    /// # Errors
    /// [`RigError::Log`]: why it is not whole.
    pub fn finish_log(&mut self) -> Result<(), RigError> {
        match self.slot.replace(None) {
            Some(open) => Ok(open.log.finish()?),
            None => Ok(()),
        }
    }

    /// Writes a record of now to the log, if there is one.
    pub fn log(&self, record: impl FnOnce() -> LogRecord) {
        self.slot.write(self.clock.now(), record);
    }

    /// Writes to the log, if there is one, what happens now.
    pub fn log_event(&self, level: Level, text: impl Into<String>) {
        let event = || Event {
            level,
            source: "rig".to_owned(),
            text: text.into(),
        };
        self.log(|| LogRecord::Event(event()));
    }

    /// Asks the servos for all that they keep, for the log; nothing where there is none. One that does not answer goes
    /// without: what it says to the rest decides.
    pub(super) fn log_registers(&mut self) {
        if self.slot.log().is_some() {
            for &id in &self.ids {
                if let Err(error) = self.bus.registers(id) {
                    tracing::debug!("{error}");
                }
            }
        }
    }

    /// Homes that are written down.
    pub(super) fn known_homes(&self) -> Vec<ServoHome> {
        let known = self.ids.iter().filter_map(|&id| {
            let turns = self.turns.of(id)?;
            Some(ServoHome {
                id,
                home: Ticks(turns.home),
                last: Ticks(turns.last),
            })
        });
        known.collect()
    }
}

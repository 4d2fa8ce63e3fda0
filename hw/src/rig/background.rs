//! Recording the empty scene, against which masks tell the robot.

use std::fs;
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Duration;

use tdcr_sim::render::Scene;

use super::Pace;
use super::open::{clock, open_cameras};
use super::{RigError, RigFile};
use crate::camera::{RgbdCamera, Soak, grab_all};
use crate::clock::Clock;
use crate::log::{LogSettings, LogWriter};

impl RigFile {
    /// Records so many `pictures` of the scene by each camera in the log at `path`, which `masks.background` can then name. The robot has to be
    /// out of sight; cameras in memory do not see it. No servo is asked anything. `go_on` is asked before each picture whether to.
    ///
    /// # Errors
    /// [`RigError::Unavailable`] and [`RigError::Camera`] for cameras; [`RigError::Log`], also where `path` exists;
    /// [`RigError::Interrupted`].
    pub fn record_background(
        &self,
        path: &Path,
        pictures: usize,
        go_on: &mut dyn FnMut() -> ControlFlow<()>,
    ) -> Result<(), RigError> {
        if self.spec.cameras.is_empty() {
            let expected = "one at least: they see the empty scene";
            return Err(self.located(RigError::field("cameras", "empty", expected)));
        }
        let clock = clock(self, Pace::Computed);
        let mut cameras = open_cameras(self, || Some(Box::new(Scene::default())), &clock)?;
        for camera in &mut cameras {
            Soak::default().run(camera)?;
        }
        let log = LogWriter::create(path, &*clock, LogSettings::default())?;
        let patience = Duration::from_secs_f64(self.spec.motion.picture);
        let written = write(log, &mut cameras, &*clock, (pictures, patience), go_on);
        if written.is_err() {
            // A part of it is no background, and it was not there before.
            let _ = fs::remove_file(path);
        }
        written
    }
}

/// Writes so many pictures of each camera, for each of which one waits no longer than this.
fn write(
    mut log: LogWriter,
    cameras: &mut [Box<dyn RgbdCamera>],
    clock: &dyn Clock,
    (pictures, patience): (usize, Duration),
    go_on: &mut dyn FnMut() -> ControlFlow<()>,
) -> Result<(), RigError> {
    for camera in &*cameras {
        let (now, serial) = (clock.now(), camera.serial());
        log.camera(now, serial, camera.camera(), camera.depth_to_color())?;
    }
    for _ in 0..pictures {
        if go_on().is_break() {
            return Err(RigError::Interrupted);
        }
        let together = grab_all(cameras, clock, patience);
        for (camera, frame) in cameras.iter().zip(together.frames) {
            log.frame(camera.serial(), &frame?)?;
        }
    }
    Ok(log.finish()?)
}

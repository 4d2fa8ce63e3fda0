//! Recording the empty scene, against which masks tell the robot.

use std::fs::{self, File};
use std::io;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tdcr_base::files::TEMPORARY;
use tdcr_sim::render::Visuals;

use super::Pace;
use super::open::{clock, open_cameras};
use super::{RigError, RigFile};
use crate::camera::{RgbdCamera, WarmUp, grab_all};
use crate::clock::Clock;
use crate::log::{LogError, LogSettings, LogWriter};

impl RigFile {
    /// Records so many `pictures` of the scene by each camera in the log at `path`, which `masks.background` can then name. The robot has to be
    /// out of sight; cameras in memory see the obstacles without it. No servo is asked anything. `go_on` is asked before each picture whether to.
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
        let partial = Partial::begin(path)?;
        let clock = clock(self, Pace::Computed);
        let mut empty = Visuals::default();
        empty.add_scene(&self.simulated_scene);
        let opened = open_cameras(self, || Some(Box::new(empty.clone())), &clock)?;
        let mut cameras: Vec<_> = opened.into_iter().map(|(camera, _)| camera).collect();
        for camera in &mut cameras {
            WarmUp::default().run(camera)?;
        }
        let log = LogWriter::create(&partial.file, &*clock, LogSettings::default())?;
        let patience = Duration::from_secs_f64(self.spec.motion.picture);
        write(log, &mut cameras, &*clock, (pictures, patience), go_on)?;
        Ok(partial.commit(path)?)
    }
}

/// Logs of this process that are not whole.
static PARTIAL: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

fn partial() -> MutexGuard<'static, Vec<PathBuf>> {
    PARTIAL.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Removes logs that are not whole, as the process ends in the middle of them.
pub(super) fn discard_partial() {
    for file in partial().drain(..) {
        // It may not have been begun.
        drop(fs::remove_file(file));
    }
}

/// A log beside its place, as a part of it is no background; it goes unless it is put there.
struct Partial {
    file: PathBuf,
}

impl Partial {
    /// The file for a log at `path`, where none is.
    fn begin(path: &Path) -> Result<Self, LogError> {
        must_be_free(path)?;
        let file = path.with_added_extension(TEMPORARY);
        // What a killed process left.
        drop(fs::remove_file(&file));
        partial().push(file.clone());
        Ok(Self { file })
    }

    /// Puts the log, which is whole, at `path`.
    fn commit(self, path: &Path) -> Result<(), LogError> {
        must_be_free(path)?;
        let placed = File::open(&self.file)
            .and_then(|file| file.sync_all())
            .and_then(|()| fs::rename(&self.file, path));
        placed.map_err(|source| LogError::File {
            path: path.to_owned(),
            source,
        })
    }
}

impl Drop for Partial {
    fn drop(&mut self) {
        drop(fs::remove_file(&self.file));
        partial().retain(|file| *file != self.file);
    }
}

/// No log is written over another file.
fn must_be_free(path: &Path) -> Result<(), LogError> {
    match path.symlink_metadata() {
        Err(_) => Ok(()),
        Ok(_) => Err(LogError::File {
            path: path.to_owned(),
            source: io::Error::new(io::ErrorKind::AlreadyExists, "File exists"),
        }),
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

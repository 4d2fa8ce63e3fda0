//! What is shown, and the files that it comes from.

use std::fs::Metadata;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use tdcr_hw::rig::RigFile;
use tdcr_sim::formats::RobotFileError;
use tdcr_sim::robot::{Loads, RobotSpec};
use tdcr_sim::scene::Scene;

use super::overlays::Overlays;

/// A robot, what is around it and how it begins.
#[derive(Clone, Debug)]
pub struct Exhibit {
    /// The robot.
    pub robot: RobotSpec,
    /// What is around it.
    pub scene: Scene,
    /// What pulls at it.
    pub loads: Loads,
    /// The command that it begins with, one value for each tendon (m, or N for a tension drive); the middle of the tendons' ranges
    /// where none is given.
    pub start: Option<Vec<f64>>,
    /// Commands that the page can play.
    pub recorded: Vec<Vec<f64>>,
    /// Where the robot is from: a file is watched, and read again when it changes.
    pub source: Source,
    /// What is shown over it.
    pub overlays: Overlays,
    /// The rig that the robot is of: it is shown where the rig's servos are, and moves with them.
    pub rig: Option<RigFile>,
    /// Folder of the rig's log; none is written without.
    pub out: Option<PathBuf>,
}

/// Where a robot is from.
#[derive(Clone, Debug, Default)]
pub enum Source {
    /// It is there for good.
    #[default]
    Memory,
    /// A robot file.
    File(PathBuf),
}

impl Exhibit {
    /// A robot with nothing around it and no load.
    pub fn of(robot: RobotSpec) -> Self {
        Self {
            robot,
            scene: Scene::default(),
            loads: Loads::default(),
            start: None,
            recorded: Vec::new(),
            source: Source::Memory,
            overlays: Overlays::default(),
            rig: None,
            out: None,
        }
    }
}

/// Sees whether a robot file has changed.
pub(super) struct Watched {
    path: PathBuf,
    seen: Option<Stamp>,
}

/// What changes with a file: when it was written, and its length.
type Stamp = (Option<SystemTime>, u64);

impl Watched {
    pub fn new(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            seen: stamp(path),
        }
    }

    /// The robot of the file, or why there is none, where the file has changed since this was last asked. A file that is not there,
    /// as while an editor replaces it, has not changed.
    pub fn changed(&mut self) -> Option<Result<RobotSpec, RobotFileError>> {
        let now = stamp(&self.path)?;
        if self.seen == Some(now) {
            return None;
        }
        self.seen = Some(now);
        Some(RobotSpec::load(&self.path.to_string_lossy()))
    }
}

fn stamp(path: &Path) -> Option<Stamp> {
    let of = |metadata: Metadata| (metadata.modified().ok(), metadata.len());
    path.metadata().ok().map(of)
}

//! What is seen of the rig, for all pages.

use std::sync::Arc;
use std::time::Duration;

use serde::Serialize;
use tdcr_hw::capture::{CaptureError, Fuser};
use tdcr_hw::log::LogRecord;
use tdcr_hw::plan::Shape;
use tdcr_hw::rig::{Homing, Rig, RigError, RigFile, WinchState};
use tdcr_hw::servo::ServoId;
use tdcr_sim::cloud::{PointCloud, VoxelGrid};
use tokio::sync::watch;

use super::orders::{Orders, PageId};
use super::{Due, servos};
use crate::view::pictures;
use crate::view::recording::Servo;

/// Time between two clouds.
const CLOUDS: Duration = Duration::from_millis(1000);
/// Time between two readings of the temperatures.
const TEMPERATURES: Duration = Duration::from_millis(1000);

/// What the page may ask of the rig.
#[derive(Clone, Debug, Serialize)]
pub(in crate::view) struct RigLimits {
    name: String,
    /// Largest bend of each module (rad).
    bend: Vec<f64>,
    /// Smallest and largest tension that a module's tendons share (N).
    tension: [f64; 2],
    /// That of each module at home (N).
    rest: Vec<f64>,
    /// Number of cameras.
    cameras: usize,
}

/// What is seen of the rig.
#[derive(Clone, Debug, Default)]
pub(in crate::view) struct Seen {
    /// Who holds it.
    pub armed: Option<PageId>,
    /// Whether it moves.
    pub moving: bool,
    /// What its servos do.
    pub servos: Vec<Servo>,
    /// The command that their positions stand for (m); none where they are not known.
    pub command: Option<Vec<f64>>,
    /// What the cameras last saw, and its number.
    pub look: Option<(u64, Arc<Look>)>,
    /// What was last said, to one page or to all, and its number.
    pub said: Option<(u64, Option<PageId>, String)>,
}

/// What the cameras of the rig see.
#[derive(Clone, Debug)]
pub(in crate::view) struct Look {
    /// The robot (m, world).
    pub cloud: PointCloud,
    /// What each camera shows, and what of it is taken for the robot, as messages.
    pub pictures: Vec<Vec<u8>>,
}

/// Looks at the rig.
pub(super) struct Sight {
    pub seen: Seen,
    publisher: watch::Sender<Arc<Seen>>,
    fuser: Fuser,
    ids: Vec<ServoId>,
    temperatures: Vec<Option<f64>>,
    next_cloud: Due,
    next_temperatures: Due,
}

impl RigLimits {
    pub fn of(file: &RigFile, rest: &Shape) -> Self {
        let commands = &file.spec.commands;
        let bend = |module: usize| {
            let of_all = commands.bend.first().copied().unwrap_or_default();
            commands.bend.get(module).copied().unwrap_or(of_all)
        };
        Self {
            name: file.spec.name.clone(),
            bend: (0..rest.0.len()).map(bend).collect(),
            tension: commands.co_contraction,
            rest: rest.0.iter().map(|bend| bend.tension).collect(),
            cameras: file.spec.cameras.len(),
        }
    }
}

impl Sight {
    /// # Errors
    /// As [`Rig::masker`].
    pub fn new(rig: &mut Rig, voxel: f64) -> Result<Self, RigError> {
        let (publisher, _) = watch::channel(Arc::new(Seen::default()));
        Ok(Self {
            seen: Seen::default(),
            publisher,
            fuser: Fuser {
                grid: VoxelGrid::new(voxel),
                masker: rig.masker()?,
            },
            ids: rig.winches().iter().map(|winch| winch.id).collect(),
            temperatures: Vec::new(),
            next_cloud: Due::now(),
            next_temperatures: Due::now(),
        })
    }

    pub fn watch(&self) -> watch::Receiver<Arc<Seen>> {
        self.publisher.subscribe()
    }

    /// Tells the pages.
    pub fn publish(&self) {
        self.publisher.send_replace(Arc::new(self.seen.clone()));
    }

    /// Says something to a page, or to all.
    pub fn say(&mut self, page: Option<PageId>, text: String) {
        let number = self.seen.said.as_ref().map_or(0, |(number, ..)| number + 1);
        self.seen.said = Some((number, page, text));
        self.publish();
    }

    /// Says what was refused.
    pub fn hear(&mut self, orders: &mut Orders) {
        for (page, text) in std::mem::take(&mut orders.refused) {
            self.say(Some(page), text);
        }
    }

    /// Takes over what servos do.
    pub fn see(&mut self, states: &[WinchState]) {
        let ids: Vec<u8> = self.ids.iter().map(|id| id.get()).collect();
        self.seen.servos = servos(states, &ids, &self.temperatures);
        self.seen.command = Some(states.iter().map(|state| state.command).collect());
        self.publish();
    }

    /// Looks at a rig whose motors are off.
    pub fn look_at_rest(&mut self, rig: &mut Rig) {
        if rig
            .homing()
            .iter()
            .any(|homing| !matches!(homing, Homing::Homed(_)))
        {
            // Servos that do not answer are seen to be silent below.
            drop(rig.meet());
        }
        let states: Option<Vec<WinchState>> = (rig.state().into_iter())
            .map(|state| state.ok().flatten())
            .collect();
        self.feel(rig);
        match states {
            Some(states) => self.see(&states),
            None => {
                self.seen.servos.clear();
                self.seen.command = None;
                self.publish();
            }
        }
        if let Err(error) = self.fuse(rig) {
            self.say(None, error.to_string());
        }
    }

    /// Looks at a rig whose motors are on.
    ///
    /// # Errors
    /// As [`Rig::poll`] and [`Rig::grab`]: the motors are off then.
    pub fn look(&mut self, rig: &mut Rig) -> Result<(), CaptureError> {
        let states = rig.poll()?.to_vec();
        self.feel(rig);
        self.see(&states);
        self.fuse(rig)
    }

    /// Reads the temperatures, now and then.
    fn feel(&mut self, rig: &mut Rig) {
        if self.next_temperatures.comes(TEMPERATURES) {
            let read = rig.bus().temperatures(&self.ids);
            self.temperatures = read.into_iter().map(Result::ok).collect();
        }
    }

    /// Takes pictures and fuses them to a cloud, now and then; the servos are looked at meanwhile.
    fn fuse(&mut self, rig: &mut Rig) -> Result<(), CaptureError> {
        if rig.cameras().is_empty() || !self.next_cloud.comes(CLOUDS) {
            return Ok(());
        }
        let pictures = rig.grab()?;
        let fuser = &self.fuser;
        let look = rig.hold_while(|| {
            let masks = fuser.masks(&pictures, 0)?;
            Ok::<_, CaptureError>(Look {
                cloud: fuser.fuse_masked(&pictures, &masks)?,
                pictures: pictures::masked(&pictures, &masks),
            })
        })??;
        // Who reads clouds out of the log has them under what was measured.
        if let Some(command) = &self.seen.command {
            rig.log(|| LogRecord::Command(command.clone()));
        }
        rig.log(|| LogRecord::Cloud(look.cloud.clone()));
        let number = self.seen.look.as_ref().map_or(0, |(number, _)| number + 1);
        self.seen.look = Some((number, Arc::new(look)));
        self.publish();
        Ok(())
    }
}

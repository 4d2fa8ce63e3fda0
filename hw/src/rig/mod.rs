//! A rig: a robot with servos behind its tendons and cameras around it, opened from one file, on the desk or in memory.
//!
//! [`Rig::open`] reads `rig.toml` ([`RigSpec`]) and gives one type for any mix of simulated, recorded and real parts. Its clock
//! follows from them: virtual where all are in memory, the system's where any is real.
//!
//! A rig moves its robot only while it is [engaged](Rig::engage), which it refuses to be until every servo is
//! [homed](Rig::home_here). All that moves goes through [`Rig::step`] and [`Rig::poll`], which look at every reading, make sure
//! that goals have arrived, and release the tension where something is wrong ([`EmergencyStop`]); so do an interruption
//! ([`Rig::move_along`]), a panic (`Drop`), and [`leave`], for a process that ends without unwinding. What takes its time meanwhile
//! is done by [`Rig::hold_while`]. No goal comes past the servos' limits, whoever sends it ([`Limited`]), and a camera that gives one
//! picture over and over is found by [`Rig::grab`].
//! Where this program is killed, or the cable unplugged, the servos' own watchdog and current limit hold: they are set
//! whenever a rig is engaged.

mod background;
mod by_hand;
mod check;
mod error;
mod file;
mod frozen;
mod gauge;
mod goals;
mod hold;
mod homing;
mod leave;
mod logging;
mod masker;
mod masks;
mod motion;
mod open;
mod place;
mod pretension;
mod release;
mod settings;
mod spool;
mod stop;
#[cfg(test)]
mod tests;
mod travel;
mod turns;
mod watch;
mod winch;

pub use by_hand::{ByHand, Gauged, Turn};
pub use error::RigError;
pub use file::{
    CameraLink, RigCameraSpec, RigFile, RigScene, RigSpec, SensorModel, ServoLink, ServosSpec,
    TendonMode,
};
pub use goals::OffGoal;
pub use homing::HomingReport;
pub use leave::{leave, while_released};
pub use masks::{BackgroundSpec, ComponentsSpec, LargestSpec, MasksSpec};
pub use open::Pace;
pub use pretension::{PretensionSettings, Pretensioned};
pub use settings::{
    LostTurns, MotionSettings, Release, SafetySettings, SimulationSettings, Surroundings,
};
pub use spool::{Direction, Spool};
pub use stop::{Cause, EmergencyStop, Released};
pub use turns::{Homing, KNOWN_WITHIN, Turns, TurnsFile};
pub use winch::{Winch, WinchState};

use std::sync::Arc;
use std::time::Duration;

use tdcr_sim::render::RgbdFrame;
use tdcr_sim::robot::Robot;

use crate::camera::{RgbdCamera, Stamped};
use crate::clock::Clock;
use crate::mask::Masker;
use crate::servo::{Held, Limited, Logged, PerServo, ServoBus, ServoId, SharedLimits};
use crate::simulated::Simulator;
use crate::simulated::camera::CameraFaults;
use frozen::LastImages;
pub use logging::LOG_LEAVES;
use logging::{LogSlot, LoggedCamera};
use motion::Drive;

/// Servos, cameras and clock of a rig, however they came about.
pub struct Parts {
    /// The servos.
    pub bus: Box<dyn ServoBus>,
    /// The cameras, in the order of the rig file.
    pub cameras: Vec<Box<dyn RgbdCamera>>,
    /// What all of them wait on.
    pub clock: Arc<dyn Clock>,
    /// Where homes are kept.
    pub turns: TurnsFile,
}

/// A robot with servos and cameras.
pub struct Rig {
    file: RigFile,
    robot: Robot,
    winches: Vec<Winch>,
    ids: Vec<ServoId>,
    bus: Box<dyn ServoBus>,
    /// What servos may be told, from the last time that they were engaged: nothing before.
    limits: SharedLimits,
    cameras: Vec<Box<dyn RgbdCamera>>,
    /// What is known of the pictures of each.
    last_images: Vec<LastImages>,
    clock: Arc<dyn Clock>,
    turns: TurnsFile,
    homing: Vec<Homing>,
    drive: Drive,
    /// What tells the robot from all else, once it was asked for.
    masker: Option<Arc<dyn Masker>>,
    /// Where it is logged what servos and cameras are told and say.
    slot: LogSlot,
    /// What servos and cameras in memory are parts of.
    simulator: Option<Simulator>,
    /// What lets things go wrong with cameras in memory.
    camera_faults: Vec<Option<CameraFaults>>,
}

/// Pictures of all cameras from one moment.
#[derive(Debug)]
pub struct Pictures {
    /// One for each camera, in the order of the rig file.
    pub frames: Vec<Stamped<RgbdFrame>>,
    /// Largest difference between their times.
    pub skew: Duration,
}

impl Rig {
    /// A rig of parts that are open already. Asks no servo anything: those that were homed before are
    /// [met](Self::meet) when the rig is engaged.
    ///
    /// # Errors
    /// [`RigError::Spec`] for a robot that makes no sense.
    pub fn of_parts(file: RigFile, parts: Parts) -> Result<Self, RigError> {
        let robot = file.compile()?;
        let winches = file.winches(&robot)?;
        let Parts {
            bus,
            cameras,
            clock,
            turns,
        } = parts;
        let slot = LogSlot::default();
        let limits = SharedLimits::default();
        let bus = Held::new(Limited::new(bus, limits.clone()));
        let bus = Box::new(Logged::new(bus, clock.clone(), slot.of_servos()));
        let cameras = cameras.into_iter().map(|camera| {
            let slot = slot.clone();
            Box::new(LoggedCamera { camera, slot }) as Box<dyn RgbdCamera>
        });
        let cameras: Vec<_> = cameras.collect();
        Ok(Self {
            ids: winches.iter().map(|winch| winch.id).collect(),
            homing: vec![Homing::Never; winches.len()],
            file,
            robot,
            winches,
            bus,
            limits,
            last_images: vec![LastImages::default(); cameras.len()],
            cameras,
            clock,
            turns,
            drive: Drive::Released,
            masker: None,
            slot,
            simulator: None,
            camera_faults: Vec::new(),
        })
    }

    /// The file that it was made from.
    pub fn file(&self) -> &RigFile {
        &self.file
    }

    /// What the rig's file says.
    pub fn spec(&self) -> &RigSpec {
        &self.file.spec
    }

    /// The robot, watched by the rig's cameras.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// The servos with their spools, in the order of a command.
    pub fn winches(&self) -> &[Winch] {
        &self.winches
    }

    /// What time passes on.
    pub fn clock(&self) -> &Arc<dyn Clock> {
        &self.clock
    }

    /// The servos, for what a rig has no call of its own for. Motion belongs to [`step`](Self::step): what is sent past it is
    /// not watched. Goals beyond the servos' limits, or farther from the ones before than a step, are refused here too, and all
    /// goals before the rig is first [engaged](Self::engage).
    pub fn bus(&mut self) -> &mut dyn ServoBus {
        &mut *self.bus
    }

    /// What its servos in memory are parts of, which knows the truth and lets things go wrong; `None` for a rig on the desk.
    pub fn simulator(&self) -> Option<&Simulator> {
        self.simulator.as_ref()
    }

    /// The switches of the faults of its cameras, in their order; `None` for one that is not simulated. A rig of
    /// [parts](Self::of_parts) has none.
    pub fn camera_faults(&self) -> &[Option<CameraFaults>] {
        &self.camera_faults
    }

    /// The cameras.
    pub fn cameras(&self) -> &[Box<dyn RgbdCamera>] {
        &self.cameras
    }

    /// What tells the robot from all else in the cameras' pictures: the masks of the rig's file, read once.
    ///
    /// # Errors
    /// As [`RigFile::masker`].
    pub fn masker(&mut self) -> Result<Arc<dyn Masker>, RigError> {
        if let Some(masker) = &self.masker {
            return Ok(masker.clone());
        }
        let masker: Arc<dyn Masker> = self.file.masker()?.into();
        self.masker = Some(masker.clone());
        Ok(masker)
    }

    /// Where the servos are, one result each.
    pub fn state(&mut self) -> PerServo<Option<WinchState>> {
        let present = self.bus.present(&self.ids);
        let servos = self.winches.iter().zip(&self.homing);
        (servos.zip(present))
            .map(|((winch, homing), present)| {
                Ok(match (homing, present?) {
                    (Homing::Homed(home), present) => Some(winch.state(*home, present)),
                    _ => None,
                })
            })
            .collect()
    }
}

impl Drop for Rig {
    /// Releases the tension of a rig that is engaged, after an error or a panic, and ends its log.
    fn drop(&mut self) {
        if self.is_engaged() {
            let released = self.release_at_once();
            if !released.is_complete() {
                tracing::warn!("{released}");
            }
        }
        if let Err(error) = self.finish_log() {
            tracing::debug!("{error}");
        }
    }
}

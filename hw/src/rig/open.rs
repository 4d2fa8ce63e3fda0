//! Opening what a rig's file names.

use std::fmt::Display;
use std::path::Path;
use std::sync::Arc;

use tdcr_sim::camera::Camera;
use tdcr_sim::render::{Sensor, Visuals};

use super::file::{CameraLink, RigCameraSpec, RigFile, ServoLink};
use super::settings::Surroundings;
use super::spool::Direction;
use super::turns::TurnsFile;
use super::{Parts, Rig, RigError};
use crate::camera::RgbdCamera;
use crate::clock::{Clock, SystemClock, VirtualClock};
use crate::dynamixel::{Bus, BusSettings};
use crate::realsense::{RealSense, RealSenseSetup};
use crate::recorded::{Commands, RecordedBus, RecordedCamera, homes};
use crate::serial::{Serial, SerialSettings};
use crate::servo::ServoBus;
use crate::simulated::camera::{CameraFaults, CameraSetup, SimulatedCamera, Subject, table};
use crate::simulated::{PlantSetup, ServoSetup, Simulator, SimulatorSetup, Winding};

impl Rig {
    /// Opens the rig of a file, with all that it names. No motor is switched on.
    ///
    /// A simulated robot stands at home, so its servos are homed; real ones have to be
    /// ([`home_here`](Self::home_here), [`home_recalled`](Self::home_recalled)).
    ///
    /// # Errors
    /// [`RigError`]: what is wrong with the file, or with a part that it names.
    pub fn open(path: &Path) -> Result<Self, RigError> {
        Self::open_file(RigFile::load(path)?, Pace::Computed)
    }

    /// The same of a file that was read, and perhaps changed.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_file(file: RigFile, pace: Pace) -> Result<Self, RigError> {
        let clock = clock(&file, pace);
        let (bus, simulator): (Box<dyn ServoBus>, _) = match &file.spec.servos.link {
            ServoLink::Simulated => {
                let simulator = simulator(&file, clock.clone())?;
                let bus = Bus::new(simulator.bus(), BusSettings::default());
                (Box::new(bus), Some(simulator))
            }
            ServoLink::Serial(port) => {
                let settings = SerialSettings {
                    baud_rate: file.spec.servos.baud,
                    ..SerialSettings::default()
                };
                let port = file.resolve(port);
                let line = Serial::open(&port, settings, clock.clone());
                let line = line.map_err(|error| unavailable(&file, "servos.link", error))?;
                (Box::new(Bus::new(line, BusSettings::default())), None)
            }
            ServoLink::Recorded(log) => {
                let bus = RecordedBus::open(&file.resolve(log), clock.clone(), Commands::Compare);
                let bus = bus.map_err(|error| unavailable(&file, "servos.link", error))?;
                (Box::new(bus), None)
            }
        };
        let subject = || -> Option<Box<dyn Subject>> { Some(Box::new(simulator.clone()?)) };
        let (cameras, camera_faults) = open_cameras(&file, subject, &clock)?.into_iter().unzip();
        let beside = TurnsFile::beside(&file.path);
        let turns = match &file.spec.servos.link {
            ServoLink::Simulated => TurnsFile::in_memory(),
            ServoLink::Serial(_) => TurnsFile::open(beside)?,
            // As they were known when it was recorded, and not to be changed by it.
            ServoLink::Recorded(log) => {
                let homes = homes(&file.resolve(log));
                let homes = homes.map_err(|error| unavailable(&file, "servos.link", error))?;
                match homes.is_empty() {
                    true => TurnsFile::open(beside)?.kept_in_memory(),
                    false => TurnsFile::of_log(&homes),
                }
            }
        };
        let parts = Parts {
            bus,
            cameras,
            clock,
            turns,
        };
        let mut rig = Self::of_parts(file, parts)?;
        if simulator.is_some() {
            rig.home_here()?;
        }
        rig.simulator = simulator;
        rig.camera_faults = camera_faults;
        Ok(rig)
    }
}

/// How time passes in memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pace {
    /// As fast as it is computed, where no part is real.
    #[default]
    Computed,
    /// As on the wall, for people who watch.
    RealTime,
}

pub(super) fn clock(file: &RigFile, pace: Pace) -> Arc<dyn Clock> {
    let spec = &file.spec;
    let real = pace == Pace::RealTime
        || matches!(spec.servos.link, ServoLink::Serial(_))
        || spec
            .cameras
            .iter()
            .any(|camera| camera.link == CameraLink::Realsense);
    match real {
        true => Arc::new(SystemClock::new()),
        false => Arc::new(VirtualClock::new()),
    }
}

/// The rig's robot behind simulated servos, at home.
fn simulator(file: &RigFile, clock: Arc<dyn Clock>) -> Result<Simulator, RigError> {
    let winches = file.winches(&file.compile()?)?;
    let tension = file.spec.servos.home_tension[0];
    if winches.iter().any(|winch| winch.home_tension != tension) {
        let found = format!("{:?}", file.spec.servos.home_tension);
        let expected = "the same for all, as the servos are simulated";
        let error = RigError::field("servos.home_tension", found, expected);
        return Err(file.located(error));
    }
    let simulation = &file.spec.simulation;
    let setup = SimulatorSetup::of_robot(file.robot.clone());
    let servos = setup
        .servos
        .iter()
        .zip(&winches)
        .map(|(servo, winch)| ServoSetup {
            id: winch.id,
            winding: match winch.spool.direction {
                Direction::Up => Winding::Counterclockwise,
                Direction::Down => Winding::Clockwise,
            },
            spool_radius: winch.spool.radius,
            ..*servo
        });
    let setup = SimulatorSetup {
        servos: servos.collect(),
        plant: PlantSetup {
            tension_at_home: tension,
            scene: file.simulated_scene.clone(),
            base: file.spec.base,
            ..setup.plant.clone()
        },
        baud_rate: file.spec.servos.baud,
        seed: simulation.seed,
        ..setup
    };
    Simulator::new(&setup, clock).map_err(|error| unavailable(file, "servos.link", error))
}

/// A camera, and the switch of its faults where it is simulated.
type Opened = (Box<dyn RgbdCamera>, Option<CameraFaults>);

/// The cameras of a rig, those in memory seeing a subject.
pub(super) fn open_cameras(
    file: &RigFile,
    subject: impl Fn() -> Option<Box<dyn Subject>>,
    clock: &Arc<dyn Clock>,
) -> Result<Vec<Opened>, RigError> {
    let cameras = file.spec.cameras.iter().enumerate();
    let open = |(number, spec)| {
        open_camera(file, number, spec, subject(), clock).map_err(|error| file.located(error))
    };
    cameras.map(open).collect()
}

fn open_camera(
    file: &RigFile,
    number: usize,
    spec: &RigCameraSpec,
    subject: Option<Box<dyn Subject>>,
    clock: &Arc<dyn Clock>,
) -> Result<Opened, RigError> {
    let field = || format!("cameras[{number}].link");
    match (&spec.link, subject) {
        (CameraLink::Simulated, Some(subject)) => {
            let simulation = &file.spec.simulation;
            let surroundings = match simulation.surroundings {
                Surroundings::Nothing => Visuals::default(),
                Surroundings::Table => {
                    table(0.0).map_err(|error| RigError::unavailable(field(), error))?
                }
            };
            let setup = CameraSetup {
                sensor: spec
                    .sensor
                    .map_or_else(Sensor::ideal, |model| model.sensor()),
                seed: simulation.seed,
                number: number as u64,
                surroundings,
                ..CameraSetup::d435(spec.serial.clone(), Camera::free(&spec.camera))
            };
            let camera = SimulatedCamera::new(setup, subject, clock.clone());
            let faults = camera.faults();
            Ok((Box::new(camera), Some(faults)))
        }
        (CameraLink::Simulated, None) => Err(RigError::field(
            field(),
            "\"simulated\"",
            "\"simulated\" only where the servos are: it sees the robot behind them",
        )),
        (CameraLink::Realsense, _) => {
            let pose = Camera::free(&spec.camera).pose;
            let setup = RealSenseSetup {
                color: spec.camera.resolution,
                ..RealSenseSetup::d435(spec.serial.clone(), pose)
            };
            let camera = RealSense::load().and_then(|library| library.open(&setup, clock.clone()));
            let camera = camera.map_err(|error| RigError::unavailable(field(), error))?;
            Ok((Box::new(camera), None))
        }
        (CameraLink::Recorded(log), _) => {
            let camera = RecordedCamera::open(&file.resolve(log), &spec.serial, clock.clone());
            let camera = camera.map_err(|error| RigError::unavailable(field(), error))?;
            Ok((Box::new(camera), None))
        }
    }
}

/// A part that cannot be opened says itself why.
fn unavailable(file: &RigFile, field: &str, error: impl Display) -> RigError {
    file.located(RigError::unavailable(field, error))
}

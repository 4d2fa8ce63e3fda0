//! Devices in memory: a robot behind servos, down to the bytes on the line, and [cameras](camera) that see it.
//!
//! A [`Simulator`] holds a robot of [`tdcr_sim`], the spools and tendons that pull it, the servos that turn the spools, and the
//! line that these listen to. It speaks the device's side of Protocol 2.0 with the whole control table, so that a driver cannot
//! tell it from hardware: [`bus`](Simulator::bus) is a [`Transport`](crate::transport::Transport) in memory,
//! [`Terminal`] serves it to other programs. Everything happens at the times of a [`Clock`]: the simulator computes what has
//! happened since it was last asked. [`truth`](Simulator::truth) says what no sensor would.
//!
//! ```
//! use std::sync::Arc;
//! use std::time::Duration;
//! use tdcr_hw::clock::VirtualClock;
//! use tdcr_hw::dynamixel::{Instruction, PacketId};
//! use tdcr_hw::servo::ServoId;
//! use tdcr_hw::simulated::{Simulator, SimulatorSetup};
//! use tdcr_hw::transport::Transport;
//! use tdcr_sim::robot::RobotSpec;
//!
//! let robot = RobotSpec::standard("3m").expect("a standard robot");
//! let clock = Arc::new(VirtualClock::new());
//! let simulator = Simulator::new(&SimulatorSetup::of_robot(robot), clock)?;
//! let mut bus = simulator.bus();
//! let mut ping = Vec::new();
//! Instruction::Ping.encode(PacketId::Servo(ServoId::new(4).expect("an id")), &mut ping)?;
//! bus.write(&ping)?;
//! let mut answer = [0; 64];
//! let deadline = Duration::from_millis(20);
//! let mut count = 0;
//! while count < 14 {
//!     count += bus.read(&mut answer[count..], deadline)?;
//! }
//! assert_eq!(answer[4], 4); // The servo's id.
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # What is simplified
//!
//! Feed-forward gains have no effect. "Goal Position" stays as it was while torque is off, so that torque moves a servo to an
//! old goal where its driver does not set it first; the same holds for a goal written before. A servo answers a read of
//! several in the time that it would have if all before it had answered. Friction, inertia and thermal constants of the motors
//! are of the right size, not measured.

mod bus;
pub mod camera;
mod device;
mod fault;
mod motor;
mod plant;
mod profile;
mod spool;
mod tendon;
mod terminal;
mod wire;
mod world;

pub use bus::SimulatedBus;
pub use fault::{Fault, LATENESS, ScheduledFault, UnknownFault};
pub use plant::{FRICTIONS, PlantError, PlantSetup, STIFFNESSES};
pub use spool::{Spool, Winding};
pub use tendon::{TendonFault, TendonTruth};
pub use terminal::Terminal;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use nalgebra::Isometry3;
use tdcr_sim::render::{BaseVisibility, Visuals};
use tdcr_sim::robot::{Loads, LoadsError, Robot, RobotSpec};
use tdcr_sim::scene::Scene;
pub use tdcr_sim::simulation::Physics;
use thiserror::Error;

use crate::clock::Clock;
use crate::dynamixel::{BAUD_RATES, Model};
use crate::servo::{SPOOL_RADII, ServoId, Ticks};
use camera::Subject;
use device::Device;
use plant::Plant;
use wire::Wire;
use world::World;

/// Smallest and largest play between horn and spool (rad).
const BACKLASHES: [f64; 2] = [0.0, 1.0];

/// A servo with a spool on its horn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ServoSetup {
    /// Address on the bus.
    pub id: ServoId,
    /// Model.
    pub model: Model,
    /// Version of its firmware, which decides where the indirect items lie.
    pub firmware: u8,
    /// Which way it winds its tendon up.
    pub winding: Winding,
    /// Radius of the spool (m), to the middle of the tendon.
    pub spool_radius: f64,
    /// Play between horn and spool (rad).
    pub backlash: f64,
    /// Where its horn stands at the start, turns included, with the tension at home in the tendon. The servo itself knows the
    /// angle within a turn.
    pub home: Ticks,
}

/// What a simulator is made of.
#[derive(Clone, Debug)]
pub struct SimulatorSetup {
    /// Robot and tendons.
    pub plant: PlantSetup,
    /// One servo for each tendon, in the order of a command.
    pub servos: Vec<ServoSetup>,
    /// Bits per second of the line, one of [`BAUD_RATES`].
    pub baud_rate: u32,
    /// How long the computer's adapter may hold bytes back.
    pub latency: Duration,
    /// Seed of everything that goes wrong by chance.
    pub seed: u64,
}

impl SimulatorSetup {
    /// One XC330-M288 for each tendon of a robot, with ids from 1: 1, 2, 3 for the tendons of the first module, and so on;
    /// spools of 5 mm with a third of a degree of play, which stand at tick 2048 with 2 N in every tendon; empty space around
    /// it; 1 Mbit/s, and an adapter whose latency timer is set to 1 ms.
    pub fn of_robot(robot: RobotSpec) -> Self {
        let servos = (1..=ServoId::MAX)
            .filter_map(ServoId::new)
            .take(robot.tendon_count())
            .map(|id| ServoSetup {
                id,
                model: Model::Xc330M288,
                firmware: Model::LAST_FIRMWARE_208,
                winding: Winding::Counterclockwise,
                spool_radius: 0.005,
                backlash: f64::to_radians(1.0 / 3.0),
                home: Ticks(Ticks::PER_TURN / 2),
            })
            .collect();
        Self {
            plant: PlantSetup {
                robot,
                physics: Physics::AtRest,
                stiffness: None,
                tension_at_home: 2.0,
                scene: Scene::default(),
                base: BaseVisibility::Shown,
            },
            servos,
            baud_rate: 1_000_000,
            latency: Duration::from_millis(1),
            seed: 0,
        }
    }
}

/// Why a simulator cannot be made.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SimulatorError {
    /// A baud rate that these servos do not have.
    #[error(
        "{0} baud is none of the servos' rates: expected 9600, 57600, 115200, 1000000, 2000000, 3000000 or 4000000"
    )]
    BaudRate(u32),
    /// Two servos of one id.
    #[error("two servos have the id {0}; each needs one of its own")]
    SameId(ServoId),
    /// A spool that cannot be.
    #[error("the {what} of servo {id} is {value}; expected {low} to {high}")]
    Spool {
        /// Which servo.
        id: ServoId,
        /// Which quantity, with its unit.
        what: &'static str,
        /// Its value.
        value: f64,
        /// The smallest that it may be.
        low: f64,
        /// The largest.
        high: f64,
    },
    /// The robot.
    #[error(transparent)]
    Plant(#[from] PlantError),
}

/// How everything is, in truth, at a time.
#[derive(Clone, Debug)]
pub struct Truth {
    /// Time of the clock.
    pub time: Duration,
    /// Frames of the discs in the world (m), from the base to the tip.
    pub discs: Vec<Isometry3<f64>>,
    /// The tendons, in the order of a command.
    pub tendons: Vec<TendonTruth>,
    /// Angles of the horns since the first power-on, in ticks with their fractions.
    pub horns: Vec<f64>,
    /// Temperatures of the servos (degrees Celsius).
    pub temperatures: Vec<f64>,
    /// Whether the robot follows its tendons: `false` where the last solve has failed.
    pub settled: bool,
}

/// A simulated robot behind simulated servos. Cheap to clone: all clones are of the same one.
#[derive(Clone, Debug)]
pub struct Simulator {
    world: Arc<Mutex<World>>,
    clock: Arc<dyn Clock>,
}

impl Simulator {
    /// Servos that have run for a while, torque off, at home; time is that of `clock`.
    ///
    /// # Errors
    /// [`SimulatorError`].
    pub fn new(setup: &SimulatorSetup, clock: Arc<dyn Clock>) -> Result<Self, SimulatorError> {
        let baud_index = (BAUD_RATES.iter().position(|&rate| rate == setup.baud_rate))
            .ok_or(SimulatorError::BaudRate(setup.baud_rate))?;
        for (index, servo) in setup.servos.iter().enumerate() {
            if setup.servos[..index]
                .iter()
                .any(|other| other.id == servo.id)
            {
                return Err(SimulatorError::SameId(servo.id));
            }
            for (what, value, [low, high]) in [
                ("spool's radius (m)", servo.spool_radius, SPOOL_RADII),
                ("backlash (rad)", servo.backlash, BACKLASHES),
            ] {
                if !(low..=high).contains(&value) {
                    let id = servo.id;
                    return Err(SimulatorError::Spool {
                        id,
                        what,
                        value,
                        low,
                        high,
                    });
                }
            }
        }
        let devices: Vec<Device> = (setup.servos.iter())
            .map(|s| Device::new(s.model, s.firmware, s.id, baud_index, s.home))
            .collect();
        let spools: Vec<Spool> = (setup.servos.iter().zip(&devices))
            .map(|(s, device)| {
                Spool::new(s.spool_radius, s.backlash, s.winding, device.motor.angle)
            })
            .collect();
        let plant = Plant::new(&setup.plant, &spools)?;
        let wire = Wire::new(setup.baud_rate, setup.latency, setup.seed);
        let mut world = World::new(devices, plant, wire);
        world.start(clock.now());
        Ok(Self {
            world: Arc::new(Mutex::new(world)),
            clock,
        })
    }

    /// The line that the servos are on, in memory.
    pub fn bus(&self) -> SimulatedBus {
        SimulatedBus::new(self.clone())
    }

    /// The clock.
    pub fn clock(&self) -> &Arc<dyn Clock> {
        &self.clock
    }

    /// The robot, its tendons driven by rest lengths (m).
    pub fn robot(&self) -> Robot {
        self.world().plant.robot().clone()
    }

    /// How everything is now.
    pub fn truth(&self) -> Truth {
        let time = self.clock.now();
        let mut world = self.now();
        world.plant.refresh();
        let world = &*world;
        let pose = world.plant.pose();
        Truth {
            time,
            discs: (0..pose.positions.len())
                .map(|disc| pose.disc(disc))
                .collect(),
            tendons: world.plant.tendons(),
            horns: world.devices.iter().map(Device::horn).collect(),
            temperatures: world.devices.iter().map(|d| d.motor.temperature).collect(),
            settled: world.plant.settled(),
        }
    }

    /// Lets something go wrong now.
    pub fn inject(&self, fault: Fault) {
        let at = self.clock.now();
        self.now().schedule(ScheduledFault { fault, at });
    }

    /// Lets something go wrong later.
    pub fn schedule(&self, fault: ScheduledFault) {
        self.now().schedule(fault);
    }

    /// Ends all faults that last: noise, silence, broken tendons, the pulled cable. Servos keep their hardware errors until
    /// they are rebooted.
    pub fn repair(&self) {
        self.now().repair();
    }

    /// Loads the robot.
    ///
    /// # Errors
    /// [`LoadsError`] for loads of another robot.
    pub fn set_loads(&self, loads: Loads) -> Result<(), LoadsError> {
        self.now().plant.set_loads(loads)
    }

    /// Sets the supply voltage of all servos (V).
    pub fn set_supply(&self, voltage: f64) {
        for device in &mut self.now().devices {
            device.motor.supply = voltage.max(0.0);
        }
    }

    /// Sets a servo's temperature (degrees Celsius), as if it had worked hard; nothing for one that is not there.
    pub fn set_temperature(&self, id: ServoId, temperature: f64) {
        for device in &mut self.now().devices {
            if device.id() == id.get() {
                device.motor.temperature = temperature;
            }
        }
    }

    /// Shortens the tendon of a servo by this (m) without it, as a gear between them does that is set by hand; nothing for a
    /// servo that is not there.
    pub fn shorten(&self, id: ServoId, length: f64) {
        let mut world = self.now();
        let index = world
            .devices
            .iter()
            .position(|device| device.id() == id.get());
        if let Some(index) = index {
            world.plant.shorten(index, length);
        }
    }

    /// The world as of now.
    fn now(&self) -> MutexGuard<'_, World> {
        let now = self.clock.now();
        let mut world = self.world();
        world.advance(now);
        world
    }

    fn world(&self) -> MutexGuard<'_, World> {
        // A panic elsewhere leaves the world at some time before; there is no state that would be wrong.
        self.world.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Cameras see the robot as it was at a time, but not before it was last asked about: it does not go back.
impl Subject for Simulator {
    fn visuals_at(&mut self, time: Duration) -> Visuals {
        let now = self.clock.now();
        let mut world = self.world();
        world.advance(time.min(now));
        world.plant.refresh();
        world.plant.visuals()
    }
}

//! A simulated robot that differs from its controller's model.

use std::collections::VecDeque;

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use tdcr_sim::chain::Configuration;
use tdcr_sim::cloud::VoxelGrid;
use tdcr_sim::contact::{ContactSettler, ContactStepper};
use tdcr_sim::dynamics::{DynamicsError, Integrator, Stepper};
use tdcr_sim::inverse::recording::{Marker, Servo};
use tdcr_sim::robot::{
    Command, CommandError, CommandUnit, Drive, Loads, Robot, RobotSpec, SpecError,
};
use tdcr_sim::scene::Scene;
use tdcr_sim::simulation::{MovingRobot, Physics, Simulation, SimulationError};
use tdcr_sim::statics::Settler;
use tdcr_sim::tendon_friction::ContactPath;
use thiserror::Error;

use super::cloud::{Cameras, CloudSensor};
use super::{Measurement, Plant, PlantError, Sighting};

/// What a simulated robot is in truth.
#[derive(Clone, Debug)]
pub struct Truth {
    /// The robot. It has as many tendons as the controller's.
    pub robot: RobotSpec,
    /// What pulls at it.
    pub loads: Loads,
    /// How it follows its tendons.
    pub physics: Physics,
    /// What stands around it.
    pub scene: Scene,
    /// How each servo pulls its tendon: errors of spools, pretension, backlash.
    pub servos: Vec<Servo>,
    /// Periods from a command to when the tendons get it.
    pub delay: usize,
    /// What is measured, and how well.
    pub sensors: Sensors,
}

/// What is measured, each number with normal noise of this standard deviation.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensors {
    /// Points that are seen.
    pub markers: Vec<Marker>,
    /// Noise of each coordinate of a point (m).
    pub position: f64,
    /// Noise of a tension (N); `None` where tensions are not measured.
    pub tension: Option<f64>,
    /// Noise of a length (m); `None` where lengths are not measured.
    pub length: Option<f64>,
    /// The cameras of the robot's file; `None` where nobody looks at its clouds.
    pub cloud: Option<CloudSensor>,
}

/// Why a truth is none.
#[derive(Clone, Debug, Error)]
#[non_exhaustive]
pub enum TruthError {
    /// The robot is not valid.
    #[error(transparent)]
    Robot(#[from] SpecError),
    /// A number of servos that is not that of the tendons.
    #[error("robot `{robot}` has {tendons} tendons, and {servos} servos pull them")]
    Servos {
        /// Name of the robot.
        robot: String,
        /// Its tendons.
        tendons: usize,
        /// The servos.
        servos: usize,
    },
    /// A number that makes no sense.
    #[error("the {what} is {value}; expected a finite number, {least} or above")]
    Quantity {
        /// Which, with its unit.
        what: &'static str,
        /// Its value.
        value: f64,
        /// The smallest that it may be.
        least: f64,
    },
    /// More periods or time steps than make sense.
    #[error("the {what} is {value}; expected at most {most}")]
    TooMany {
        /// Of what.
        what: &'static str,
        /// How many.
        value: f64,
        /// The most.
        most: f64,
    },
    /// A marker on a disc that the robot does not have.
    #[error("a marker is on disc {disc}; the robot has {discs} discs, counted from 0")]
    Marker {
        /// The disc.
        disc: usize,
        /// Number of discs.
        discs: usize,
    },
    /// The first command is of another robot.
    #[error(transparent)]
    Command(#[from] CommandError),
    /// The time step cannot be taken.
    #[error(transparent)]
    Dynamics(#[from] DynamicsError),
    /// The robot does not settle under the first command.
    #[error("the robot cannot start: {0}")]
    Start(#[from] SimulationError),
}

impl Truth {
    /// The robot as its model says, its tip seen and its tensions measured without noise.
    pub fn ideal(robot: &Robot) -> Self {
        let tip = Marker {
            disc: robot.discs().len() - 1,
            place: Vector3::zeros(),
        };
        Self {
            robot: robot.spec().clone(),
            loads: Loads::default(),
            physics: Physics::AtRest,
            scene: Scene::default(),
            servos: vec![Servo::default(); robot.tendons().len()],
            delay: 0,
            sensors: Sensors {
                markers: vec![tip],
                position: 0.0,
                tension: Some(0.0),
                length: None,
                cloud: None,
            },
        }
    }

    fn check(&self, robot: &Robot) -> Result<(), TruthError> {
        let tendons = robot.tendons().len();
        if self.servos.len() != tendons {
            return Err(TruthError::Servos {
                robot: robot.spec().name.clone(),
                tendons,
                servos: self.servos.len(),
            });
        }
        let at_least = |what, value: f64, least: f64| match value.is_finite() && value >= least {
            true => Ok(()),
            false => Err(TruthError::Quantity { what, value, least }),
        };
        for servo in &self.servos {
            at_least("gain of a servo", servo.gain, 0.0)?;
            at_least("offset of a servo", servo.offset, f64::MIN)?;
            at_least("backlash of a servo", servo.backlash, 0.0)?;
        }
        if self.delay > LONGEST_DELAY {
            return Err(TruthError::TooMany {
                what: "delay in periods",
                value: self.delay as f64,
                most: LONGEST_DELAY as f64,
            });
        }
        let sensors = &self.sensors;
        at_least("noise of positions (m)", sensors.position, 0.0)?;
        at_least("noise of tensions (N)", sensors.tension.unwrap_or(0.0), 0.0)?;
        at_least("noise of lengths (m)", sensors.length.unwrap_or(0.0), 0.0)?;
        if let Some(cloud) = &sensors.cloud {
            at_least("edge of voxels (m)", cloud.voxel_size, VoxelGrid::SIZES[0])?;
        }
        let discs = robot.discs().len();
        match sensors.markers.iter().find(|marker| marker.disc >= discs) {
            Some(&Marker { disc, .. }) => Err(TruthError::Marker { disc, discs }),
            None => Ok(()),
        }
    }
}

/// The longest delay (periods), and the most time steps in a period.
const LONGEST_DELAY: usize = 10_000;
const MOST_STEPS: f64 = 1e6;

/// The longest rest length (m) and the largest tension (N) that a servo in error may come to.
fn reach(unit: CommandUnit) -> f64 {
    match unit {
        CommandUnit::Metre => 100.0,
        CommandUnit::Newton => 1e6,
    }
}

/// A simulated robot behind servos and sensors. The same seed gives the same noise.
pub struct SimulatedPlant {
    simulation: Box<dyn Simulation>,
    servos: Vec<Servo>,
    /// The command that it rested under at first, and periods from a command to when the tendons get it.
    start: Vec<f64>,
    delay: usize,
    /// Length of each tendon in the straight pose (m).
    straight: Vec<f64>,
    /// Where each servo's play stands, as a pull (m or N).
    played: Vec<f64>,
    /// Commands on their way.
    queue: VecDeque<Vec<f64>>,
    loads: Loads,
    sensors: Sensors,
    cameras: Option<Cameras>,
    period: f64,
    seed: u64,
    /// Periods since the start.
    periods: u64,
}

impl std::fmt::Debug for SimulatedPlant {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SimulatedPlant")
            .field("robot", &self.simulation.robot().spec().name)
            .field("servos", &self.servos)
            .field("period", &self.period)
            .finish_non_exhaustive()
    }
}

impl SimulatedPlant {
    /// A robot that rests under `start`, and is commanded every `period` (s).
    ///
    /// # Errors
    /// [`TruthError`].
    pub fn new(truth: &Truth, period: f64, start: &Command, seed: u64) -> Result<Self, TruthError> {
        if !(period.is_finite() && period > 0.0) {
            return Err(TruthError::Quantity {
                what: "period (s)",
                value: period,
                least: f64::MIN_POSITIVE,
            });
        }
        let robot = behind_servos(truth)?;
        truth.check(&robot)?;
        let straight = robot.tendon_kinematics(&Configuration::straight(&robot)).0;
        let mut plant = Self {
            simulation: simulation(truth, &robot, period)?,
            servos: truth.servos.clone(),
            start: start.as_slice().to_vec(),
            delay: truth.delay,
            played: pulls(&robot, &straight, start.as_slice()),
            straight,
            queue: vec![start.as_slice().to_vec(); truth.delay].into(),
            loads: truth.loads.clone(),
            cameras: (truth.sensors.cloud).map(|sensor| Cameras::new(&robot, &truth.scene, sensor)),
            sensors: truth.sensors.clone(),
            period,
            seed,
            periods: 0,
        };
        let first = plant.pulled(start.as_slice())?;
        plant.simulation.reset(&first, &plant.loads)?;
        Ok(plant)
    }

    /// The robot in truth; its commands are what the tendons get.
    pub fn robot(&self) -> &Robot {
        self.simulation.robot()
    }

    /// What pulls at it from now on.
    pub fn set_loads(&mut self, loads: Loads) {
        self.loads = loads;
    }

    /// What the tendons get where the servos are commanded `command`.
    fn pulled(&mut self, command: &[f64]) -> Result<Command, CommandError> {
        let robot = self.simulation.robot();
        let pulls = pulls(robot, &self.straight, command);
        let mut got = Vec::with_capacity(pulls.len());
        for (t, pull) in pulls.into_iter().enumerate() {
            let (servo, tendon) = (&self.servos[t], &robot.tendons()[t]);
            self.played[t] = servo.play(self.played[t], pull);
            let value = servo.command(tendon.drive, self.straight[t], self.played[t]);
            got.push(value.min(tendon.range[1]));
        }
        robot.command(&got)
    }
}

/// The robot with tendons that may be commanded what servors in error come to, and with friction where there is any.
fn behind_servos(truth: &Truth) -> Result<Robot, TruthError> {
    let mut spec = truth.robot.clone();
    for tendon in spec.tendon_specs_mut() {
        tendon.range = [0.0, reach(tendon.drive.unit())];
        if let Some(coefficient) = truth.physics.friction() {
            tendon.set_friction(coefficient);
        }
    }
    Ok(Robot::new(spec)?)
}

/// The robot that moves in periods.
fn simulation(
    truth: &Truth,
    robot: &Robot,
    period: f64,
) -> Result<Box<dyn Simulation>, TruthError> {
    let is_free = truth.scene.is_empty();
    Ok(match truth.physics {
        Physics::AtRest if is_free => Box::new(Settler::new(robot)),
        Physics::AtRest => Box::new(ContactSettler::new(robot, &truth.scene)),
        Physics::WithFriction { .. } => Box::new(ContactPath::new(robot, &truth.scene)),
        Physics::InMotion { timestep, .. } => {
            // A whole number of time steps in a period, none longer than asked for.
            let steps = (period / timestep).ceil().max(1.0);
            if !(timestep > 0.0 && steps <= MOST_STEPS) {
                return Err(TruthError::TooMany {
                    what: "number of time steps in a period",
                    value: steps,
                    most: MOST_STEPS,
                });
            }
            let stepper = Stepper::new(robot, period / steps, Integrator::ImplicitEuler)?;
            let stepper =
                ContactStepper::new(stepper, &truth.scene).map_err(SimulationError::from)?;
            Box::new(MovingRobot::among(stepper, steps as usize))
        }
    })
}

/// How far servos pull by a command (m or N), positive when they pull: from the straight pose.
fn pulls(robot: &Robot, straight: &[f64], command: &[f64]) -> Vec<f64> {
    let pull = |t: usize| match robot.tendons()[t].drive {
        Drive::Tension => command[t],
        Drive::Gain(_) | Drive::Length => straight[t] - command[t],
    };
    (0..command.len()).map(pull).collect()
}

impl Plant for SimulatedPlant {
    fn period(&self) -> f64 {
        self.period
    }

    fn measure(&mut self) -> Result<Measurement, PlantError> {
        // A stream of its own for each moment: measuring twice gives the same.
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(self.periods);
        let mut noisy = |value: f64, deviation: f64| {
            let normal: f64 = StandardNormal.sample(&mut rng);
            value + deviation * normal
        };
        let pose = self.simulation.pose();
        let sightings = (self.sensors.markers.iter())
            .map(|&marker| {
                let place = pose.disc(marker.disc) * nalgebra::Point3::from(marker.place);
                Sighting {
                    marker,
                    position: place.coords.map(|x| noisy(x, self.sensors.position)),
                }
            })
            .collect();
        let mut all = |values: &[f64], deviation: Option<f64>| {
            let deviation = deviation?;
            Some(values.iter().map(|&x| noisy(x, deviation)).collect())
        };
        let (seed, index) = (self.seed, self.periods);
        let cameras = self.cameras.as_mut();
        Ok(Measurement {
            sightings,
            cloud: cameras.map(|cameras| cameras.see(pose, seed, index)),
            tensions: all(pose.tendon_tensions, self.sensors.tension),
            lengths: all(pose.tendon_lengths, self.sensors.length),
        })
    }

    fn command(&mut self, command: &Command) -> Result<(), PlantError> {
        self.queue.push_back(command.as_slice().to_vec());
        if let Some(now) = self.queue.pop_front() {
            let got = self.pulled(&now).map_err(SimulationError::from)?;
            self.simulation.advance(&got, &self.loads)?;
        }
        self.periods += 1;
        Ok(())
    }

    fn restart(&mut self) -> Result<bool, PlantError> {
        let start = self.start.clone();
        self.queue = vec![start.clone(); self.delay].into();
        self.played = pulls(self.simulation.robot(), &self.straight, &start);
        let first = self.pulled(&start).map_err(SimulationError::from)?;
        self.simulation.reset(&first, &self.loads)?;
        Ok(true)
    }

    fn true_tip(&self) -> Option<Vector3<f64>> {
        Some(self.simulation.pose().tip().translation.vector)
    }
}

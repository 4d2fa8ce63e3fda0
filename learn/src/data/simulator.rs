//! From conditions to clouds, in simulation.

use std::time::{Duration, Instant};

use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use tdcr_sim::cloud::{Observer, PointCloud, VoxelGrid};
use tdcr_sim::contact::{Contact, ContactError, ContactSettler};
use tdcr_sim::render::{BaseVisibility, Sensor};
use tdcr_sim::robot::{CommandError, Loads, LoadsError, Robot, RobotSpec};
use tdcr_sim::scene::Scene;
use tdcr_sim::statics::Equilibrium;

use super::conditions::{PayloadRange, rng};
use super::{Condition, DataError, ObstacleVariation, Sample};

/// What clouds show: a network that learned one subject says nothing about another.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Subject {
    /// The robot, and the cameras that see it.
    pub robot: RobotSpec,
    /// Whether the cameras see the base.
    pub base: BaseVisibility,
    /// The payloads that hang from the tip; `None` where conditions have none.
    pub payload: Option<PayloadRange>,
    /// Obstacles around the robot: it settles among them, and they hide from the cameras what is behind them. Clouds show
    /// the robot alone.
    #[serde(default, skip_serializing_if = "Scene::is_empty")]
    pub scene: Scene,
    /// How far the obstacles are moved from there, anew for each sample; `None` where they stand.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub obstacles: Option<ObstacleVariation>,
}

/// Everything besides its condition that a simulated cloud depends on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// What is seen.
    pub subject: Subject,
    /// Edge of the voxel grid that thins the fused clouds (m).
    pub voxel_size: f64,
    /// Faults of the cameras; `None` where they see the truth.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor: Option<Sensor>,
}

/// The paper's robot of two modules, without its base and without payloads.
impl Default for Subject {
    fn default() -> Self {
        Self {
            robot: RobotSpec::standard(Self::ROBOT).expect("a standard robot"),
            base: BaseVisibility::Hidden,
            payload: None,
            scene: Scene::default(),
            obstacles: None,
        }
    }
}

impl Subject {
    /// Name of the robot where none is asked for.
    pub const ROBOT: &str = "2m";

    /// Numbers of a condition between the command and the payload: where the obstacles are.
    pub fn obstacle_numbers(&self) -> usize {
        self.obstacles.map_or(0, |one| one.numbers(&self.scene))
    }
}

/// The default subject, seen by perfect cameras, in voxels of 2 mm as in the paper.
impl Default for Recipe {
    fn default() -> Self {
        Self {
            subject: Subject::default(),
            voxel_size: 0.002,
            sensor: None,
        }
    }
}

impl Recipe {
    /// Refuses what no cloud can be made by.
    ///
    /// # Errors
    /// [`DataError::InvalidMeta`] for voxels without size or larger than robots, payloads that are no masses, scenes that cannot be
    /// written whole, and obstacles that cannot be moved so.
    pub fn check(&self) -> Result<(), DataError> {
        if !VoxelGrid::is_size(self.voxel_size) {
            return Err(DataError::InvalidMeta {
                field: "voxel_size",
                found: self.voxel_size.to_string(),
                expected: VoxelGrid::EXPECTED_SIZE,
            });
        }
        // Scenes of more than a record holds.
        if let Err(error) = self.subject.scene.whole_spec() {
            return Err(DataError::InvalidMeta {
                field: "scene",
                found: error.to_string(),
                expected: "a scene that can be written whole",
            });
        }
        if let Some(obstacles) = self.subject.obstacles {
            obstacles.check(&self.subject.scene)?;
        }
        self.subject.payload.map_or(Ok(()), PayloadRange::check)
    }
}

/// Why a sample could not be simulated.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SimulateError {
    /// The command does not fit the robot.
    #[error(transparent)]
    Command(#[from] CommandError),
    /// The payload is no mass.
    #[error(transparent)]
    Load(#[from] LoadsError),
    /// Among the obstacles there is nothing to settle.
    #[error(transparent)]
    Contact(#[from] ContactError),
    /// An obstacle is moved to where none can be.
    #[error("an obstacle cannot be moved so: {0}")]
    Obstacle(String),
    /// The robot did not settle.
    #[error("the robot did not settle under {condition:?}: residual {residual:e} N m")]
    NotSettled {
        /// The command (m), then the payload (kg) if there is one.
        condition: Vec<f32>,
        /// Largest gradient component (N m).
        residual: f64,
    },
    /// No camera saw the robot.
    #[error("no camera sees the robot under {condition:?}")]
    NotSeen {
        /// The command (m), then the payload (kg) if there is one.
        condition: Vec<f32>,
    },
    /// A thread that makes samples died.
    #[error("a thread that makes samples panicked")]
    Panicked,
}

/// Time that a [`Simulator`] spent.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SimulationTimes {
    /// Settling.
    pub settle: Duration,
    /// Rendering, back-projection and voxels.
    pub see: Duration,
    /// Drawing the points that are kept.
    pub sample: Duration,
}

/// Views that [`Simulator::independent_points`] draws from. Points of one view keep a voxel's distance; where an eighth of
/// the points near another is of its view, that is hardly felt.
const PHASES: usize = 8;

/// Makes samples one after another, on one thread, reusing its memory.
pub struct Simulator {
    robot: Robot,
    settler: ContactSettler,
    observer: Observer,
    sensor: Option<Sensor>,
    times: SimulationTimes,
    moving: Option<Moving>,
}

/// Obstacles that are elsewhere for each sample, and what sees them.
struct Moving {
    variation: ObstacleVariation,
    /// As the recipe has them.
    scene: Scene,
    /// Where they are.
    numbers: Vec<f32>,
}

impl Simulator {
    /// A simulator of `robot`, which is compiled from the recipe's.
    pub fn new(robot: &Robot, recipe: &Recipe) -> Self {
        Self {
            robot: robot.clone(),
            settler: ContactSettler::new(robot, &recipe.subject.scene),
            observer: Observer::new(
                robot,
                recipe.subject.base,
                VoxelGrid::new(recipe.voxel_size),
            )
            .among(&recipe.subject.scene),
            sensor: recipe.sensor,
            times: SimulationTimes::default(),
            moving: recipe.subject.obstacles.map(|variation| Moving {
                variation,
                scene: recipe.subject.scene.clone(),
                numbers: Vec::new(),
            }),
        }
    }

    /// The robot.
    pub(super) fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Moves pixels and voxels by random parts of one, as [`Observer::displace`]: what is seen from then on are other,
    /// independent samples of the same surfaces.
    pub fn displace(&mut self, rng: &mut impl Rng) {
        self.observer.displace(rng);
    }

    /// Settles the robot: under the command alone, and from there under its payload.
    ///
    /// # Errors
    /// [`SimulateError`] where the condition does not fit the robot, or the robot does not settle.
    pub fn settle(&mut self, condition: &Condition) -> Result<&Equilibrium, SimulateError> {
        let began = Instant::now();
        let command = match self.place_obstacles(condition)? {
            0 => condition.command(&self.robot)?,
            _ => condition
                .without_obstacles(&self.robot)
                .command(&self.robot)?,
        };
        let unloaded = &self
            .settler
            .settle(&command, &Loads::default())?
            .equilibrium;
        let payload = condition.payload.filter(|&mass| mass != 0.0);
        if let (Some(mass), true) = (payload, unloaded.converged) {
            let start = unloaded.configuration.clone();
            let loads = Loads::payload(mass.into())?;
            self.settler.settle_from(&start, &command, &loads)?;
        }
        let equilibrium = &self.settler.found().equilibrium;
        self.times.settle += began.elapsed();
        if equilibrium.converged {
            return Ok(equilibrium);
        }
        Err(SimulateError::NotSettled {
            condition: condition.values().collect(),
            residual: equilibrium.residual,
        })
    }

    /// Moves the obstacles to where a condition has them; how many numbers of it say so.
    fn place_obstacles(&mut self, condition: &Condition) -> Result<usize, SimulateError> {
        let Some(moving) = &mut self.moving else {
            return Ok(0);
        };
        let tendons = self.robot.tendons().len();
        let count = moving.variation.numbers(&moving.scene);
        let numbers = condition.motors.get(tendons..).unwrap_or_default();
        if numbers.len() != count {
            let (found, expected) = (condition.motors.len(), tendons + count);
            let message = format!(
                "the condition has {found} numbers before the payload, expected {expected}: {tendons} of the tendons, {count} of the obstacles"
            );
            return Err(SimulateError::Obstacle(message));
        }
        if moving.numbers != numbers {
            let scene = moving.variation.place(&moving.scene, numbers);
            let scene = scene.map_err(|error| SimulateError::Obstacle(error.to_string()))?;
            self.settler = ContactSettler::new(&self.robot, &scene);
            self.observer.surround(&scene);
            moving.numbers = numbers.to_vec();
        }
        Ok(count)
    }

    /// What the robot touches where it last settled.
    pub fn contacts(&self) -> &[Contact] {
        &self.settler.found().contacts
    }

    /// Where it last settled.
    pub fn equilibrium(&self) -> &Equilibrium {
        &self.settler.found().equilibrium
    }

    /// The true cloud of the robot under a condition, without the cameras' faults: `points` points (m, world frame),
    /// drawn with `rng`.
    ///
    /// # Errors
    /// As [`settle`](Self::settle); [`SimulateError::NotSeen`] where no camera sees anything.
    pub fn cloud(
        &mut self,
        condition: &Condition,
        points: usize,
        rng: &mut impl Rng,
    ) -> Result<PointCloud, SimulateError> {
        self.see(condition, points, rng, |observer, equilibrium| {
            observer.observe(equilibrium)
        })
    }

    /// Points (m, world frame) that are independent of each other, drawn from the surface that the cameras see of the
    /// robot under a condition, in the mean density of [`cloud`](Self::cloud) over all phases of pixels and voxels: what
    /// a perfect predictor, which draws its points one by one, makes of the condition.
    ///
    /// They are drawn from the union of several views, each in a phase of its own. The phases are left displaced.
    ///
    /// # Errors
    /// As [`cloud`](Self::cloud).
    pub fn independent_points(
        &mut self,
        condition: &Condition,
        points: usize,
        rng: &mut impl Rng,
    ) -> Result<PointCloud, SimulateError> {
        self.settle(condition)?;
        let mut union = PointCloud::default();
        for _ in 0..PHASES {
            self.displace(rng);
            let seen = self.observer.observe(&self.settler.found().equilibrium);
            union.points.extend(seen.points);
            union.colors.extend(seen.colors);
        }
        if union.is_empty() {
            return Err(SimulateError::NotSeen {
                condition: condition.values().collect(),
            });
        }
        Ok(union.sample_or_pad(points, rng))
    }

    /// All points that the cameras see of the robot under a condition, faults included, with pixels and voxels in random
    /// phases. The phases are left displaced.
    ///
    /// # Errors
    /// As [`cloud`](Self::cloud).
    pub(crate) fn view(
        &mut self,
        condition: &Condition,
        rng: &mut impl Rng,
    ) -> Result<PointCloud, SimulateError> {
        self.displace(rng);
        self.settle(condition)?;
        let equilibrium = &self.settler.found().equilibrium;
        let seen = match &self.sensor {
            None => self.observer.observe(equilibrium),
            Some(sensor) => self.observer.measure(equilibrium, sensor, rng.random(), 0),
        };
        if seen.is_empty() {
            return Err(SimulateError::NotSeen {
                condition: condition.values().collect(),
            });
        }
        Ok(seen)
    }

    /// Settles the robot and draws points of what `look` sees.
    fn see(
        &mut self,
        condition: &Condition,
        points: usize,
        rng: &mut impl Rng,
        look: impl Fn(&mut Observer, &Equilibrium) -> PointCloud,
    ) -> Result<PointCloud, SimulateError> {
        self.settle(condition)?;
        let settled = Instant::now();
        let seen = look(&mut self.observer, &self.settler.found().equilibrium);
        let looked = Instant::now();
        let cloud = seen.sample_or_pad(points, rng);
        self.times.see += looked - settled;
        self.times.sample += looked.elapsed();
        if cloud.is_empty() {
            return Err(SimulateError::NotSeen {
                condition: condition.values().collect(),
            });
        }
        Ok(cloud)
    }

    /// Sample `index` of a set or stream: `condition` and its cloud, whose points and faults follow from `seed` and
    /// `index`.
    ///
    /// # Errors
    /// As [`cloud`](Self::cloud).
    pub fn sample(
        &mut self,
        condition: Condition,
        points: usize,
        seed: u64,
        index: u64,
    ) -> Result<Sample, SimulateError> {
        let sensor = self.sensor;
        let rng = &mut points_rng(seed, index);
        let cloud = self.see(
            &condition,
            points,
            rng,
            |observer, equilibrium| match &sensor {
                None => observer.observe(equilibrium),
                Some(sensor) => observer.measure(equilibrium, sensor, seed, index),
            },
        )?;
        Ok(Sample { condition, cloud })
    }

    /// Time spent so far.
    pub fn times(&self) -> SimulationTimes {
        self.times
    }
}

/// The random stream that chooses the points of cloud `index`, apart from that of its condition.
fn points_rng(seed: u64, index: u64) -> ChaCha8Rng {
    rng(seed, index | 1 << 63)
}

impl std::ops::Sub for SimulationTimes {
    type Output = Self;

    fn sub(self, before: Self) -> Self {
        Self {
            settle: self.settle - before.settle,
            see: self.see - before.see,
            sample: self.sample - before.sample,
        }
    }
}

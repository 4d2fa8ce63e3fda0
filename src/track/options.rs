//! What a run along a path is asked for, on the command line and in Python alike.

use std::fmt;
use std::str::FromStr;

use clap::{Args, ValueEnum};
use nalgebra::{Isometry3, Translation3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_control::controller::{Controller, Inverse, MovingPredictive, Predictive, ResolvedRate};
use tdcr_control::plant::{CloudSensor, Truth, TruthError};
use tdcr_control::tip_path::{Shape, TipPath, TipPathError};
use tdcr_learn::options::cli::positive;
use tdcr_sim::chain::Configuration;
use tdcr_sim::inverse::recording::Servo;
use tdcr_sim::robot::{CommandUnit, Loads, Robot, RobotSpec};
use tdcr_sim::scene::Scene;
use tdcr_sim::simulation::Physics;

use super::TrackError;

/// Largest coefficient of friction of tendons in their holes.
const FRICTION: f64 = 2.0;
/// Most trials of a path.
pub const MOST_TRIALS: usize = 1000;
/// Time between commands of a simulated robot where nothing else is asked for (s).
const PERIOD: f64 = 0.05;

/// How a path is tracked.
#[derive(Clone, Debug, Args)]
pub struct TrackOptions {
    /// How commands are chosen
    #[arg(long, value_enum, default_value_t = ControllerName::ResolvedRate)]
    pub controller: ControllerName,
    /// Time between commands (s) [default: 0.05; of a rig 0.1, and the nearest multiple of its motion.period]
    #[arg(long, value_name = "S", value_parser = positive)]
    pub period: Option<f64>,
    /// Time before the path in which the tip is led to its first point (s); errors count from the path's start
    #[arg(long, default_value_t = 4.0, value_name = "S", value_parser = not_negative)]
    pub approach: f64,
    /// Largest change of a command in a second (m/s, or N/s for a tension drive) [default: half of a tendon's range]
    #[arg(long, value_name = "R", value_parser = positive)]
    pub rate: Option<f64>,
    /// Smallest and largest tension that commands may lead to (N) [default: 0 and no bound]
    #[arg(long, value_name = "LOW,HIGH", value_parser = pair, allow_hyphen_values = true)]
    pub tension: Option<[f64; 2]>,
    /// Trials of the path, one after another: each corrects the path that the controller is given by the errors of the last one. What
    /// is told and written is of the last trial
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = trials)]
    pub trials: usize,
    /// Seed of noise, of the signs of --gain-error, and of the search for the first command
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
}

impl Default for TrackOptions {
    fn default() -> Self {
        Self {
            controller: ControllerName::ResolvedRate,
            period: None,
            approach: 4.0,
            rate: None,
            tension: None,
            trials: 1,
            seed: 0,
        }
    }
}

impl TrackOptions {
    /// Time between commands of a simulated robot (s).
    pub fn period(&self) -> f64 {
        self.period.unwrap_or(PERIOD)
    }
}

/// A controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ControllerName {
    /// Open loop through the model
    Inverse,
    /// Damped least squares on the Jacobian at the estimated equilibrium, with integral action
    ResolvedRate,
    /// Quadratic programs over a quasi-static horizon, offset-free
    Mpc,
    /// Quadratic programs over a horizon of the robot's motion: for one that swings
    MovingMpc,
}

impl ControllerName {
    /// All of them.
    pub const ALL: [Self; 4] = [
        Self::Inverse,
        Self::ResolvedRate,
        Self::Mpc,
        Self::MovingMpc,
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Inverse => "inverse",
            Self::ResolvedRate => "resolved-rate",
            Self::Mpc => "mpc",
            Self::MovingMpc => "moving-mpc",
        }
    }

    /// The controller.
    pub fn make(self) -> Box<dyn Controller> {
        match self {
            Self::Inverse => Box::<Inverse>::default(),
            Self::ResolvedRate => Box::<ResolvedRate>::default(),
            Self::Mpc => Box::<Predictive>::default(),
            Self::MovingMpc => Box::<MovingPredictive>::default(),
        }
    }
}

/// How a simulated robot is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sight {
    /// Its tip, with noise of this standard deviation in each coordinate (m).
    Tip(f64),
    /// Clouds of the cameras of its file, which are RealSense D435s.
    D435,
}

impl Default for Sight {
    fn default() -> Self {
        Self::Tip(0.0)
    }
}

impl fmt::Display for Sight {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tip(noise) => write!(f, "the tip, noise {noise} m"),
            Self::D435 => f.write_str("clouds of D435 cameras"),
        }
    }
}

impl FromStr for Sight {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.trim() {
            "d435" => Ok(Self::D435),
            other => not_negative(other)
                .map(Self::Tip)
                .map_err(|error| format!("{error}, nor d435")),
        }
    }
}

/// What the simulated robot has otherwise than the controller's model.
#[derive(Clone, Debug, Default, Args)]
pub struct TruthOptions {
    /// Mass hung from the tip that the controller does not know of (kg)
    #[arg(long, default_value_t = 0.0, value_name = "KG", value_parser = not_negative)]
    pub payload: f64,
    /// Coefficient of friction of the tendons in their holes
    #[arg(long, default_value_t = 0.0, value_name = "MU", value_parser = not_negative)]
    pub friction: f64,
    /// Play between each servo and its tendon, its whole width (m, or N for a tension drive)
    #[arg(long, default_value_t = 0.0, value_name = "M", value_parser = not_negative)]
    pub backlash: f64,
    /// Share by which each spool pulls too much or too little from where it is calibrated, the middle of its tendon's range; its sign is
    /// drawn for each
    #[arg(long, default_value_t = 0.0, value_name = "SHARE", value_parser = share)]
    pub gain_error: f64,
    /// Time from a command to when the tendons get it (s), to the nearest period
    #[arg(long, default_value_t = 0.0, value_name = "S", value_parser = not_negative)]
    pub delay: f64,
    /// How the robot is seen: its tip, with noise of this standard deviation in each coordinate (m), or `d435`: only clouds of the cameras
    /// of its file, which are D435s
    #[arg(long, default_value = "0", value_name = "M|d435")]
    pub noise: Sight,
    /// Noise of measured tensions: standard deviation (N) [default: 0; beside d435 they are not measured]
    #[arg(long, value_name = "N", value_parser = not_negative)]
    pub tension_noise: Option<f64>,
    /// Simulate motion, by time steps of at most this (s), in place of a robot that is always at rest
    #[arg(long, value_name = "S", value_parser = positive)]
    pub timestep: Option<f64>,
}

impl TruthOptions {
    /// The simulated robot: `robot` with what differs, among the obstacles of `scene`.
    ///
    /// # Errors
    /// [`TrackError`] for a robot that is not valid, and loads that are none.
    pub fn truth(
        &self,
        robot: &RobotSpec,
        scene: Scene,
        options: &TrackOptions,
    ) -> Result<Truth, TrackError> {
        let within = |what, value: f64, high: f64| match (0.0..=high).contains(&value) {
            true => Ok(()),
            false => Err(TrackError::Option {
                what,
                value,
                low: 0.0,
                high,
            }),
        };
        within("coefficient of friction", self.friction, FRICTION)?;
        within("error of spools", self.gain_error, 1.0)?;
        within("backlash (m or N)", self.backlash, f64::MAX)?;
        within("delay (s)", self.delay, f64::MAX)?;
        let compiled = Robot::new(robot.clone()).map_err(TruthError::from)?;
        let mut truth = Truth::ideal(&compiled);
        truth.loads = Loads::payload(self.payload)?;
        truth.scene = scene;
        truth.physics = match (self.timestep, self.friction > 0.0) {
            (Some(timestep), rubs) => Physics::InMotion {
                timestep,
                friction: rubs.then_some(self.friction),
            },
            (None, true) => Physics::WithFriction {
                coefficient: self.friction,
            },
            (None, false) => Physics::AtRest,
        };
        let mut signs = ChaCha8Rng::seed_from_u64(options.seed);
        let straight = Configuration::straight(&compiled);
        let (lengths, _) = compiled.tendon_kinematics(&straight);
        truth.servos = (compiled.tendons().iter().zip(lengths))
            .map(|(tendon, length)| {
                let error = match signs.random::<bool>() {
                    true => self.gain_error,
                    false => -self.gain_error,
                };
                let middle = (tendon.range[0] + tendon.range[1]) / 2.0;
                let home = match tendon.unit() {
                    CommandUnit::Metre => length - middle,
                    CommandUnit::Newton => middle,
                };
                Servo {
                    gain: 1.0 + error,
                    offset: -error * home,
                    backlash: self.backlash / 2.0,
                }
            })
            .collect();
        truth.delay = (self.delay / options.period()).round() as usize;
        match self.noise {
            Sight::Tip(noise) => {
                truth.sensors.position = noise;
                truth.sensors.tension = Some(self.tension_noise.unwrap_or(0.0));
            }
            Sight::D435 => {
                truth.sensors.markers.clear();
                truth.sensors.cloud = Some(CloudSensor::d435());
                truth.sensors.tension = self.tension_noise;
            }
        }
        Ok(truth)
    }
}

/// A closed curve by name, about `centre` (m) or where `robot` reaches it: in the plane across the straight robot's axis, so far below
/// its tip that it can bend there; a figure of eight beside the axis, where no pose on it is straight, and so singular.
///
/// # Errors
/// [`TrackError::Path`] for sizes that are none.
pub fn closed_path(
    robot: &Robot,
    shape: Shape,
    centre: Option<[f64; 3]>,
    diameter: f64,
    duration: f64,
) -> Result<TipPath, TrackError> {
    let (positions, orientations) = Configuration::straight(robot).place(robot);
    let length: f64 = robot.arc_lengths().last().copied().unwrap_or(0.0);
    let tip = positions.len() - 1;
    let radius = diameter / 2.0;
    let (aside, below) = match shape {
        Shape::Circle | Shape::Square => (0.0, 1.8),
        Shape::Eight | Shape::Lissajous(_) => (radius, 2.2),
    };
    let rotation = orientations[tip];
    let origin = match centre {
        Some(centre) => centre.into(),
        None => {
            let from_tip = nalgebra::Vector3::new(0.0, aside, -below * radius * radius / length);
            positions[tip] + rotation * from_tip
        }
    };
    let frame = Isometry3::from_parts(Translation3::from(origin), rotation);
    Ok(TipPath::closed(shape, &frame, diameter, duration)?)
}

/// A curve by its name: `circle`, `eight`, `square`, or `lissajous`, of 3 by 2.
pub fn curve_named(name: &str) -> Option<Shape> {
    Some(match name {
        "circle" => Shape::Circle,
        "eight" => Shape::Eight,
        "square" => Shape::Square,
        "lissajous" => Shape::Lissajous([3, 2]),
        _ => return None,
    })
}

/// A path from rows of `t, x, y, z` (s, m).
///
/// # Errors
/// [`TipPathError`].
pub fn path_of_rows(rows: &[[f64; 4]]) -> Result<TipPath, TipPathError> {
    let rows: Vec<_> = (rows.iter())
        .map(|&[t, x, y, z]| (t, [x, y, z].into()))
        .collect();
    TipPath::table(&rows)
}

fn number(text: &str) -> Result<f64, String> {
    f64::from_str(text.trim()).map_err(|_| format!("`{text}` is not a number"))
}

fn not_negative(text: &str) -> Result<f64, String> {
    match number(text)? {
        value if value.is_finite() && value >= 0.0 => Ok(value),
        value => Err(format!("`{value}` is no finite number, 0 or above")),
    }
}

fn share(text: &str) -> Result<f64, String> {
    match number(text)? {
        value if (0.0..1.0).contains(&value) => Ok(value),
        value => Err(format!(
            "`{value}` is no share; expected 0 or above, and below 1"
        )),
    }
}

fn trials(text: &str) -> Result<usize, String> {
    let count = text.trim().parse().ok();
    (count.filter(|count| (1..=MOST_TRIALS).contains(count)))
        .ok_or_else(|| format!("`{text}` is no number of trials; expected 1 to {MOST_TRIALS}"))
}

fn pair(text: &str) -> Result<[f64; 2], String> {
    let numbers: Vec<f64> = text.split(',').map(number).collect::<Result<_, _>>()?;
    let found = numbers.len();
    numbers
        .try_into()
        .map_err(|_| format!("expected 2 numbers, found {found}"))
}

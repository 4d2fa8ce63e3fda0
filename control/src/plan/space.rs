//! The space that plans go through: commands as shares of their tendons' ranges, and how far the base is inserted.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::robot::{Command, CommandError, Robot, SpecError};

/// Base that moves along its own z axis as a further degree of freedom, as on a linear stage.
///
/// A robot that its base carries along settles in the same shape, so an insertion moves all discs alike.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Insertion {
    /// How far the base may be from where the robot's file has it, along its z axis (m): least and most.
    pub range: [f64; 2],
}

impl Insertion {
    /// The unit vector along which a robot's base is inserted, world axes.
    pub fn axis(robot: &Robot) -> Vector3<f64> {
        let [w, x, y, z] = robot.spec().base.orientation;
        UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)) * Vector3::z()
    }

    /// The robot with its base moved along its axis (m).
    ///
    /// # Errors
    /// [`SpecError`] for a base so far away that no robot can stand there, or not finite.
    pub fn moved(robot: &Robot, along: f64) -> Result<Robot, SpecError> {
        let mut spec = robot.spec().clone();
        let shift = Self::axis(robot) * along;
        for (place, shift) in spec.base.position.iter_mut().zip(&shift) {
            *place += shift;
        }
        Robot::new(spec)
    }
}

/// Where a plan starts or ends.
#[derive(Clone, Debug, PartialEq)]
pub struct Stance {
    /// The command (m, or N for a tension drive).
    pub command: Command,
    /// How far the base is inserted (m); 0 for a base that stands.
    pub insertion: f64,
}

impl From<Command> for Stance {
    fn from(command: Command) -> Self {
        Self {
            command,
            insertion: 0.0,
        }
    }
}

/// Coordinates of 0 to 1 for each tendon, and one for the base where it moves.
#[derive(Clone, Debug)]
pub(super) struct Space {
    robot: Robot,
    /// Least and most of each coordinate, in its unit.
    ranges: Vec<[f64; 2]>,
    /// Along which the base is inserted, world axes.
    axis: Vector3<f64>,
}

impl Space {
    pub fn new(robot: &Robot, insertion: Option<Insertion>) -> Self {
        let mut ranges: Vec<[f64; 2]> = robot.tendons().iter().map(|t| t.range).collect();
        ranges.extend(insertion.map(|insertion| insertion.range));
        Self {
            robot: robot.clone(),
            ranges,
            axis: Insertion::axis(robot),
        }
    }

    /// Number of coordinates.
    pub fn dimensions(&self) -> usize {
        self.ranges.len()
    }

    /// The coordinates of a stance.
    pub fn coordinates(&self, stance: &Stance) -> Vec<f64> {
        let values = stance.command.as_slice().iter().chain([&stance.insertion]);
        let share = |(value, [low, high]): (&f64, &[f64; 2])| match high > low {
            true => (value - low) / (high - low),
            false => 0.0,
        };
        values.zip(&self.ranges).map(share).collect()
    }

    /// The stance at coordinates.
    ///
    /// # Errors
    /// [`CommandError`] for coordinates that are not within 0 and 1.
    pub fn stance(&self, at: &[f64]) -> Result<Stance, CommandError> {
        let tendons = self.robot.tendons().len();
        let values: Vec<f64> = (0..tendons).map(|k| self.value(at, k)).collect();
        Ok(Stance {
            command: self.robot.command(&values)?,
            insertion: self.insertion(at),
        })
    }

    /// How far the discs are moved with the base at coordinates (m), world axes.
    pub fn shift(&self, at: &[f64]) -> Vector3<f64> {
        self.axis * self.insertion(at)
    }

    fn insertion(&self, at: &[f64]) -> f64 {
        let tendons = self.robot.tendons().len();
        match at.len() > tendons {
            true => self.value(at, tendons),
            false => 0.0,
        }
    }

    fn value(&self, at: &[f64], k: usize) -> f64 {
        let [low, high] = self.ranges[k];
        // Rounding must not lead beyond an end.
        (low + (high - low) * at[k]).clamp(low, high)
    }

    /// Draws coordinates uniformly.
    pub fn draw(&self, rng: &mut ChaCha8Rng, out: &mut [f64]) {
        out.iter_mut().for_each(|x| *x = rng.random());
    }
}

/// Distance of two places, squared.
pub(super) fn squared_distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum()
}

/// The place a share of the way from one to another.
pub(super) fn between(from: &[f64], to: &[f64], share: f64, out: &mut [f64]) {
    for (out, (from, to)) in out.iter_mut().zip(from.iter().zip(to)) {
        *out = from + share * (to - from);
    }
}

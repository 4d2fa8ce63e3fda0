//! What is asked of a robot: commands and payloads, and the designs by which they are chosen.

mod design;
mod permutation;
mod sobol;

pub use design::{Design, UnitPoints};

use std::collections::HashSet;
use std::fmt;

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use tdcr_sim::robot::{Command, CommandError, Robot};

use super::{DataError, ObstacleDraws};

/// Draws of one index before its conditions count as exhausted.
const MAX_DRAWS: usize = 100;

/// What a robot is under: the condition that a network predicts from.
#[derive(Clone, Debug, PartialEq)]
pub struct Condition {
    /// Command, one value per motor: tendon rest lengths or lengths (m), tensions (N), or a real robot's own units. Where obstacles are
    /// moved, their displacements follow ([`ObstacleVariation`](super::ObstacleVariation)).
    pub motors: Vec<f32>,
    /// Mass hung from the tip (kg); `None` in a data set without payloads.
    pub payload: Option<f32>,
}

impl Condition {
    /// The condition as one row of numbers, length `D`: the motors, then the payload if there is one.
    pub fn values(&self) -> impl Iterator<Item = f32> + '_ {
        self.motors.iter().copied().chain(self.payload)
    }

    /// [`values`](Self::values) in double precision, as [`Normalisation::condition`](super::Normalisation::condition)
    /// and [`Model::predict`](crate::train::Model::predict) take them.
    pub fn to_vec(&self) -> Vec<f64> {
        self.values().map(f64::from).collect()
    }

    /// The command for `robot`. A value that is an end of its tendon's range as far as `f32` can tell is that end.
    ///
    /// # Errors
    /// [`CommandError`] where the motors do not fit the robot.
    pub fn command(&self, robot: &Robot) -> Result<Command, CommandError> {
        let mut values: Vec<f64> = self.motors.iter().map(|&motor| motor.into()).collect();
        for ((value, &motor), tendon) in values.iter_mut().zip(&self.motors).zip(robot.tendons()) {
            let end = tendon.range.into_iter().find(|&end| end as f32 == motor);
            *value = end.unwrap_or(*value);
        }
        robot.command(&values)
    }

    /// The condition of `robot` alone, where obstacles are moved.
    pub(super) fn without_obstacles(&self, robot: &Robot) -> Self {
        let motors = self.motors.iter().take(robot.tendons().len());
        Self {
            motors: motors.copied().collect(),
            payload: self.payload,
        }
    }

    /// The condition's bits, which tell it from every other one.
    pub(super) fn key(&self) -> Vec<u32> {
        // Adding 0 makes a negative zero a positive one.
        self.values().map(|value| (value + 0.0).to_bits()).collect()
    }
}

/// Payloads of a data set: a tenth of them exactly 0, the others uniform in the range (paper, payload data sets).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PayloadRange {
    /// Smallest payload besides 0 (kg), 0 or above.
    pub min: f64,
    /// Largest payload (kg), above 0.
    pub max: f64,
}

impl PayloadRange {
    /// Share of the conditions whose payload is exactly 0.
    pub const ZERO_SHARE: f64 = 0.1;

    /// Says what is wrong with the range, if anything.
    pub(super) fn check(self) -> Result<(), DataError> {
        let Self { min, max } = self;
        if min.is_finite() && max.is_finite() && 0.0 <= min && min <= max && max > 0.0 {
            return Ok(());
        }
        Err(DataError::InvalidMeta {
            field: "payload",
            found: self.to_string(),
            expected: "MIN:MAX in kg with 0 <= MIN <= MAX, finite, MAX above 0",
        })
    }

    /// Whether `other` lies within this range.
    pub fn covers(self, other: Self) -> bool {
        self.min <= other.min && other.max <= self.max
    }

    /// The payload (kg) of a number uniform in `[0, 1)`.
    fn of_uniform(self, share: f64) -> f64 {
        match (share - Self::ZERO_SHARE) / (1.0 - Self::ZERO_SHARE) {
            below if below < 0.0 => 0.0,
            share => self.at(share),
        }
    }

    /// The payload (kg) at a fraction of the range.
    fn at(self, fraction: f64) -> f64 {
        self.min + (self.max - self.min) * fraction
    }
}

impl fmt::Display for PayloadRange {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        write!(out, "{}:{}", self.min, self.max)
    }
}

/// `count` conditions of `robot`, no two of them alike, by `design` and `seed`; with a payload each where `payload` is
/// given.
///
/// # Errors
/// [`DataError::InvalidMeta`] for a payload range that makes no sense; [`DataError::Design`] where the design has no such
/// number of points, or none of so many dimensions; [`DataError::NotUnique`] where the robot has too few commands.
pub fn conditions(
    robot: &Robot,
    payload: Option<PayloadRange>,
    design: Design,
    count: usize,
    seed: u64,
) -> Result<Vec<Condition>, DataError> {
    conditions_among(robot, payload, None, design, count, seed)
}

/// The same where `obstacles` are moved for each of them. Under [`Design::Uniform`] the straight robot is outside of all.
///
/// # Errors
/// As [`conditions`].
pub fn conditions_among(
    robot: &Robot,
    payload: Option<PayloadRange>,
    obstacles: Option<&ObstacleDraws>,
    design: Design,
    count: usize,
    seed: u64,
) -> Result<Vec<Condition>, DataError> {
    payload.map_or(Ok(()), PayloadRange::check)?;
    let numbers = obstacles.map_or(0, ObstacleDraws::numbers);
    let dimensions = robot.tendons().len() + usize::from(payload.is_some()) + numbers;
    let points = design.points(dimensions, count, seed)?;
    let mut seen = HashSet::with_capacity(count);
    (0..count)
        .map(|index| {
            let mut rng = rng(seed, index as u64);
            let mut draw = || match &points {
                Some(points) => placed(robot, payload, obstacles, design, &points.point(index)),
                None => uniform(robot, payload, obstacles, &mut rng),
            };
            // A design other than by chance gives the same point again.
            let draws = if points.is_some() { 1 } else { MAX_DRAWS };
            (0..draws)
                .map(|_| draw())
                .find(|condition| seen.insert(condition.key()))
                .ok_or(DataError::NotUnique { index, count })
        })
        .collect()
}

/// A condition drawn uniformly: the command from the box of the tendons' ranges, the payload and where obstacles are from theirs.
pub(super) fn uniform(
    robot: &Robot,
    payload: Option<PayloadRange>,
    obstacles: Option<&ObstacleDraws>,
    rng: &mut impl Rng,
) -> Condition {
    let command = robot.random_command(rng);
    let mut motors: Vec<f32> = command.as_slice().iter().map(|&c| c as f32).collect();
    let payload = payload.map(|range| range.of_uniform(rng.random()) as f32);
    motors.extend(obstacles.iter().flat_map(|obstacles| obstacles.draw(rng)));
    Condition { motors, payload }
}

/// The condition at a point of the unit cube.
fn placed(
    robot: &Robot,
    payload: Option<PayloadRange>,
    obstacles: Option<&ObstacleDraws>,
    design: Design,
    point: &[f64],
) -> Condition {
    let (motors, rest) = point.split_at(robot.tendons().len());
    let place = |(tendon, &share): (&tdcr_sim::robot::Tendon, &f64)| {
        let [low, high] = tendon.range;
        (low + (high - low) * share) as f32
    };
    let mass = |range: PayloadRange| match design {
        Design::Grid => range.at(rest[0]),
        _ => range.of_uniform(rest[0]),
    };
    let mut motors: Vec<f32> = robot.tendons().iter().zip(motors).map(place).collect();
    let of_obstacles = &rest[usize::from(payload.is_some())..];
    motors.extend(obstacles.iter().flat_map(|one| one.at(of_obstacles)));
    Condition {
        motors,
        payload: payload.map(|range| mass(range) as f32),
    }
}

/// The random stream of the condition with this index.
pub(super) fn rng(seed: u64, index: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(index);
    rng
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;

    const PAYLOAD: Option<PayloadRange> = Some(PayloadRange {
        min: 0.0,
        max: 0.03,
    });

    #[test]
    fn conditions_are_distinct_within_range_and_follow_from_the_seed() {
        let robot = Robot::load("2m").unwrap();
        for design in Design::ALL {
            let count = 128;
            let drawn = conditions(&robot, PAYLOAD, design, count, 5).unwrap();
            assert_eq!(
                drawn,
                conditions(&robot, PAYLOAD, design, count, 5).unwrap()
            );
            let other = conditions(&robot, PAYLOAD, design, count, 6).unwrap();
            assert_eq!(drawn == other, design == Design::Grid, "{design:?}");
            let keys: HashSet<_> = drawn.iter().map(Condition::key).collect();
            assert_eq!(keys.len(), count, "{design:?}");
            for condition in &drawn {
                assert!(condition.command(&robot).is_ok());
                assert!((0.0..=0.030_000_001).contains(&condition.payload.unwrap()));
            }
        }
    }

    #[test]
    fn a_tenth_of_the_payloads_is_zero_and_the_rest_is_uniform() {
        let robot = Robot::load("2m").unwrap();
        for (design, slack) in [
            (Design::Uniform, 0.02),
            (Design::LatinHypercube, 1e-3),
            (Design::Sobol, 1e-3),
        ] {
            let drawn = conditions(&robot, PAYLOAD, design, 4096, 1).unwrap();
            let masses: Vec<f32> = drawn.iter().map(|c| c.payload.unwrap()).collect();
            let share = |most: f32| {
                masses.iter().filter(|&&mass| mass <= most).count() as f64 / masses.len() as f64
            };
            for (mass, expected) in [(0.0, 0.1), (0.015, 0.55), (0.03, 1.0)] {
                assert!((share(mass) - expected).abs() < slack, "{design:?} {mass}");
            }
        }
    }

    /// The star discrepancy in one dimension: the largest error of the share of points below any level.
    fn discrepancy(mut levels: Vec<f32>) -> f64 {
        levels.sort_by(f32::total_cmp);
        let n = levels.len() as f64;
        let errors = levels.iter().enumerate().map(|(k, &level)| {
            let level = f64::from(level) / 0.04;
            f64::max(
                (level - k as f64 / n).abs(),
                ((k + 1) as f64 / n - level).abs(),
            )
        });
        errors.fold(0.0, f64::max)
    }

    #[test]
    fn designs_fill_every_dimension_more_evenly_than_chance() {
        let robot = Robot::load("5m").unwrap();
        let worst = |design| {
            let drawn = conditions(&robot, None, design, 1024, 3).unwrap();
            let column = |motor: usize| drawn.iter().map(|c| c.motors[motor]).collect();
            (0..15)
                .map(|motor| discrepancy(column(motor)))
                .fold(0.0, f64::max)
        };
        // One point in each of the 1024 strata, against the Kolmogorov-Smirnov scale 1 / sqrt(1024) = 0.03.
        assert!(worst(Design::LatinHypercube) <= 1.01 / 1024.0);
        assert!(worst(Design::Sobol) <= 1.01 / 1024.0);
        assert!(worst(Design::Uniform) > 0.02);
    }

    #[test]
    fn a_grid_has_every_combination_of_its_levels_once() {
        let robot = Robot::load("2m").unwrap();
        let drawn = conditions(&robot, None, Design::Grid, 729, 0).unwrap();
        let levels = [0.0, 0.02, 0.04_f32];
        for condition in &drawn {
            assert!(condition.motors.iter().all(|m| levels.contains(m)));
        }
        let keys: HashSet<_> = drawn.iter().map(Condition::key).collect();
        assert_eq!(keys.len(), 729);
        let error = conditions(&robot, None, Design::Grid, 730, 0).unwrap_err();
        assert_eq!(
            error.to_string(),
            "730 commands are no grid in 6 dimensions, expected 729 (3 levels) or 4096 (4 levels)"
        );
    }

    #[test]
    fn a_robot_with_too_few_commands_is_refused() {
        let mut spec = tdcr_sim::robot::RobotSpec::standard("2m").unwrap();
        for module in &mut spec.modules {
            let tendons = module.tendons.as_mut().unwrap();
            tendons.range = [0.02, 0.02_f64.next_up()];
        }
        let robot = Robot::new(spec).unwrap();
        let error = conditions(&robot, None, Design::Uniform, 10, 0).unwrap_err();
        assert!(matches!(
            error,
            DataError::NotUnique {
                index: 1,
                count: 10
            }
        ));
    }

    #[test]
    fn a_payload_range_that_makes_no_sense_is_named() {
        let robot = Robot::load("2m").unwrap();
        for (min, max) in [(0.03, 0.0), (-0.1, 0.1), (0.0, f64::NAN), (0.0, 0.0)] {
            let range = Some(PayloadRange { min, max });
            let error = conditions(&robot, range, Design::Uniform, 10, 0).unwrap_err();
            assert!(error.to_string().contains("`payload` is"), "{error}");
        }
    }
}

//! Obstacles that are moved anew for each sample, as part of its condition.

use std::fmt;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};
use tdcr_sim::chain::Configuration;
use tdcr_sim::geometry::Beads;
use tdcr_sim::robot::Robot;
use tdcr_sim::scene::{Obstacle, ObstacleShape, Scene, SceneError};

use super::DataError;

/// Draws of one sample's obstacles before none are found that leave the straight robot free.
const MAX_DRAWS: usize = 1000;

/// How far obstacles are moved from where a scene has them, uniformly in each number. Half spaces stay.
///
/// Each obstacle has 3 numbers of a condition, its displacement along the world's axes (m); where obstacles turn 3 more, the rotation
/// vector about its frame's origin, world axes (rad).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObstacleVariation {
    /// Largest displacement along each axis (m), above 0.
    pub shift: f64,
    /// Largest turn about each axis (rad), 0 to pi; 0 where they do not turn.
    #[serde(default)]
    pub turn: f64,
}

impl ObstacleVariation {
    /// Refuses what no obstacles of `scene` can be moved by.
    ///
    /// # Errors
    /// [`DataError::InvalidMeta`] for numbers out of their ranges, and for a scene in which nothing can be moved.
    pub fn check(self, scene: &Scene) -> Result<(), DataError> {
        let refuse = |expected| DataError::InvalidMeta {
            field: "obstacles",
            found: format!("{self} of {} obstacles", moved(scene).count()),
            expected,
        };
        let turns = (0.0..=std::f64::consts::PI).contains(&self.turn);
        if !(self.shift > 0.0 && self.shift.is_finite() && turns) {
            return Err(refuse(
                "a displacement above 0 m, and a turn of 0 to 180 degrees",
            ));
        }
        match moved(scene).next() {
            Some(_) => Ok(()),
            None => Err(refuse("a scene with an obstacle that is not a half space")),
        }
    }

    /// Numbers that the obstacles of `scene` have in a condition.
    pub fn numbers(self, scene: &Scene) -> usize {
        moved(scene).count() * self.each()
    }

    /// Ends of each number: displacements (m), turns (rad).
    pub fn ranges(self, scene: &Scene) -> Vec<[f64; 2]> {
        let (shift, turn) = ([-self.shift, self.shift], [-self.turn, self.turn]);
        let own = [shift, shift, shift, turn, turn, turn];
        moved(scene)
            .flat_map(|_| own.into_iter().take(self.each()))
            .collect()
    }

    /// `scene` with its obstacles moved by the numbers of a condition.
    ///
    /// # Errors
    /// [`SceneError`] for an obstacle that comes to be where none can be.
    ///
    /// # Panics
    /// For fewer [numbers](Self::numbers) than the scene has.
    pub fn place(self, scene: &Scene, numbers: &[f32]) -> Result<Scene, SceneError> {
        let mut rows = numbers.chunks_exact(self.each());
        let place = |obstacle: &Obstacle| {
            if !is_moved(obstacle) {
                return obstacle.clone();
            }
            let row = rows.next().expect("numbers of every obstacle");
            let vector = |at: usize| match row.get(at..at + 3) {
                Some(row) => Vector3::new(row[0].into(), row[1].into(), row[2].into()),
                None => Vector3::zeros(),
            };
            let pose = obstacle.pose;
            obstacle.clone().with_pose(Isometry3::from_parts(
                Translation3::from(pose.translation.vector + vector(0)),
                UnitQuaternion::from_scaled_axis(vector(3)) * pose.rotation,
            ))
        };
        scene.with_obstacles(scene.obstacles().iter().map(place).collect())
    }

    fn each(self) -> usize {
        if self.turn > 0.0 { 6 } else { 3 }
    }
}

impl fmt::Display for ObstacleVariation {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        write!(out, "{} m", self.shift)?;
        match self.turn {
            0.0 => Ok(()),
            turn => write!(out, " and {} degrees", turn.to_degrees()),
        }
    }
}

fn is_moved(obstacle: &Obstacle) -> bool {
    !matches!(obstacle.shape, ObstacleShape::HalfSpace)
}

fn moved(scene: &Scene) -> impl Iterator<Item = &Obstacle> {
    scene.obstacles().iter().filter(|one| is_moved(one))
}

/// Draws places of a scene's obstacles for one robot.
#[derive(Clone, Debug)]
pub struct ObstacleDraws {
    variation: ObstacleVariation,
    scene: Scene,
    ranges: Vec<[f64; 2]>,
    /// Centres of the straight robot's beads (m).
    centres: Vec<Vector3<f64>>,
}

impl ObstacleDraws {
    /// Those of `robot` in `scene`.
    ///
    /// # Errors
    /// As [`ObstacleVariation::check`].
    pub fn new(
        variation: ObstacleVariation,
        scene: &Scene,
        robot: &Robot,
    ) -> Result<Self, DataError> {
        variation.check(scene)?;
        let (positions, orientations) = Configuration::straight(robot).place(robot);
        let beads = Beads::new(robot);
        // A bead without a radius is where it presses.
        let solid = beads.as_slice().iter().filter(|bead| bead.radius > 0.0);
        Ok(Self {
            variation,
            ranges: variation.ranges(scene),
            centres: solid
                .map(|bead| positions[bead.disc] + orientations[bead.disc] * bead.centre)
                .collect(),
            scene: scene.clone(),
        })
    }

    /// How many numbers a condition has of them.
    pub fn numbers(&self) -> usize {
        self.ranges.len()
    }

    /// The numbers at a point of the unit cube.
    pub fn at(&self, point: &[f64]) -> Vec<f32> {
        let place = |([low, high], share): (&[f64; 2], &f64)| (low + (high - low) * share) as f32;
        self.ranges.iter().zip(point).map(place).collect()
    }

    /// Numbers drawn uniformly such that the straight robot is outside of all obstacles, where settling begins; the last ones drawn if
    /// none of many are so.
    pub fn draw(&self, rng: &mut impl Rng) -> Vec<f32> {
        let mut numbers = Vec::new();
        for _ in 0..MAX_DRAWS {
            let point: Vec<f64> = (0..self.numbers()).map(|_| rng.random()).collect();
            numbers = self.at(&point);
            if self.leaves_free(&numbers) {
                break;
            }
        }
        numbers
    }

    /// Whether the straight robot's beads have their centres outside of the obstacles there.
    fn leaves_free(&self, numbers: &[f32]) -> bool {
        let Ok(scene) = self.variation.place(&self.scene, numbers) else {
            return false;
        };
        let mut obstacles = scene.obstacles().iter();
        obstacles.all(|obstacle| {
            let mut centres = self.centres.iter();
            centres.all(|centre| obstacle.signed_distance(centre) >= 0.0)
        })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use std::f64::consts::FRAC_PI_2;

    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;

    fn scene() -> Scene {
        let wall = Obstacle::cuboid("wall", [0.02, 0.4, 0.5]).unwrap();
        let obstacles = vec![Obstacle::half_space("floor"), wall.at([-0.05, 0.0, 0.25])];
        Scene::new(obstacles).unwrap()
    }

    #[test]
    fn obstacles_but_half_spaces_are_moved_by_their_numbers() {
        let turning = ObstacleVariation {
            shift: 0.1,
            turn: 2.0,
        };
        let numbers = [0.01, -0.02, 0.03, 0.0, 0.0, FRAC_PI_2 as f32];
        assert_eq!(turning.numbers(&scene()), numbers.len());
        let placed = turning.place(&scene(), &numbers).unwrap();
        assert_eq!(placed.obstacles()[0].pose, scene().obstacles()[0].pose);
        let pose = placed.obstacles()[1].pose;
        let expected = Vector3::new(-0.04, -0.02, 0.28);
        assert!((pose.translation.vector - expected).norm() < 1e-7);
        assert!((pose.rotation * Vector3::x() - Vector3::y()).norm() < 1e-6);
        let still = ObstacleVariation {
            turn: 0.0,
            ..turning
        };
        assert_eq!(still.numbers(&scene()), 3);
        let pose = still.place(&scene(), &numbers[..3]).unwrap().obstacles()[1].pose;
        assert!((pose.translation.vector - expected).norm() < 1e-7);
        assert_eq!(pose.rotation, UnitQuaternion::identity());
    }

    #[test]
    fn draws_stay_within_their_ranges_and_outside_of_the_straight_robot() {
        let robot = Robot::load("2m").unwrap();
        let variation = ObstacleVariation {
            shift: 0.06,
            turn: 0.3,
        };
        let draws = ObstacleDraws::new(variation, &scene(), &robot).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut refused = 0;
        for _ in 0..300 {
            let numbers = draws.draw(&mut rng);
            assert!(draws.leaves_free(&numbers));
            let ranges = variation.ranges(&scene());
            let mut both = numbers.iter().zip(ranges);
            assert!(both.all(|(x, [low, high])| (low..=high).contains(&f64::from(*x))));
            let point: Vec<f64> = (0..6).map(|_| rng.random()).collect();
            refused += usize::from(!draws.leaves_free(&draws.at(&point)));
        }
        assert!(refused > 30, "{refused}");
    }

    #[test]
    fn what_moves_nothing_is_refused() {
        let floor = Scene::new(vec![Obstacle::half_space("floor")]).unwrap();
        let good = ObstacleVariation {
            shift: 0.1,
            turn: 0.0,
        };
        assert!(good.check(&scene()).is_ok());
        let says = |variation: ObstacleVariation, scene: &Scene| {
            variation.check(scene).unwrap_err().to_string()
        };
        assert!(says(good, &floor).contains("0.1 m of 0 obstacles"));
        for (shift, turn) in [(0.0, 0.0), (f64::NAN, 0.0), (0.1, -1.0), (0.1, 4.0)] {
            let message = says(ObstacleVariation { shift, turn }, &scene());
            assert!(message.contains("above 0 m"), "{message}");
        }
    }
}

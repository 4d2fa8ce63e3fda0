//! Commands that bring the tip to a target.

use nalgebra::Vector3;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::inverse::shape::{Outcome, Search, ShapeControlError, ShapeController, Target};
use tdcr_sim::robot::{Loads, Robot};
use tdcr_sim::statics::Settler;

use super::space::{Insertion, Stance};

/// Searches for a command at most, and commands where the robot may be that are enough.
pub(super) const MOST_SEARCHES: usize = 60;
pub(super) const ENOUGH: usize = 6;
/// Commands drawn for each search, which begins at the one that comes nearest.
const DRAWS: usize = 20;
/// Largest distance from the target (m).
const TOLERANCE: f64 = 1e-6;

/// Searches from starts drawn at random.
pub(super) struct Starts {
    controller: ShapeController,
    settler: Settler,
    loads: Loads,
    insertion: Option<Insertion>,
    axis: Vector3<f64>,
    target: Vector3<f64>,
}

impl Starts {
    pub fn new(
        robot: &Robot,
        loads: &Loads,
        insertion: Option<Insertion>,
        target: Vector3<f64>,
    ) -> Result<Self, ShapeControlError> {
        // Starts are drawn here.
        let search = Search {
            tolerance: TOLERANCE,
            samples: 0,
            starts: 1,
            ..Search::default()
        };
        Ok(Self {
            controller: ShapeController::new(robot, loads, search)?,
            settler: Settler::new(robot),
            loads: loads.clone(),
            insertion,
            axis: Insertion::axis(robot),
            target,
        })
    }

    /// What the search from the next start comes to; `None` where it does not come to the target.
    pub fn next(&mut self, rng: &mut ChaCha8Rng) -> Result<Option<Stance>, ShapeControlError> {
        let insertion = match self.insertion {
            Some(Insertion { range: [low, high] }) => low + (high - low) * rng.random::<f64>(),
            None => 0.0,
        };
        // A base that moves takes the robot along: where the target is from there.
        let target = self.target - self.axis * insertion;
        let robot = self.controller.robot();
        let tip = robot.discs().len() - 1;
        let mut nearest = None;
        for _ in 0..DRAWS {
            let command = robot.random_command(rng);
            let settled = self.settler.settle(&command, &self.loads);
            let away = (settled.positions[tip] - target).norm();
            let nearer = nearest.as_ref().is_none_or(|(least, _)| away < *least);
            if settled.converged && nearer {
                nearest = Some((away, command));
            }
        }
        let Some((_, start)) = nearest else {
            return Ok(None);
        };
        let goal = Target::tip(robot, target);
        let found = match self.controller.reach_from(&[goal], &start) {
            Ok(found) => found,
            Err(ShapeControlError::Unsettled(_)) => return Ok(None),
            Err(error) => return Err(error),
        };
        Ok((found.outcome == Outcome::Reached).then_some(Stance {
            command: found.command,
            insertion,
        }))
    }
}

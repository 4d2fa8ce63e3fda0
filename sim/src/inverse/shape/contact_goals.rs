//! What is asked of a robot and the obstacles around it, besides targets.

use crate::robot::Robot;
use crate::scene::Scene;

/// What a robot is to touch, and what not. The default asks for nothing: it may lean on any obstacle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ContactGoals {
    /// Obstacles to press on, and with which forces.
    pub presses: Vec<Press>,
    /// Least distance (m) of the robot's [`Beads`](crate::geometry::Beads) from all obstacles that it is not to press on, 0 or
    /// above: at 0 it touches none of them. `None` if it may touch them.
    pub clearance: Option<f64>,
}

/// A normal force with which the robot is to press on an obstacle. While it does not touch the obstacle, its distance from there adds to
/// the error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Press {
    /// The obstacle, by its number in the scene: a fixed one.
    pub obstacle: usize,
    /// The disc that presses, from 0 at the base; `None` for the sum over all.
    pub disc: Option<usize>,
    /// The force (N), above 0.
    pub force: f64,
    /// What an error of one newton counts as (m/N), above 0.
    pub lever: f64,
    /// Weight of its squared error among those of targets, above 0.
    pub weight: f64,
}

impl Press {
    /// About by how much a robot of 30 cm gives way (m/N), so that distance and force weigh alike.
    pub const LEVER: f64 = 0.1;

    /// The whole robot on an obstacle, with a force (N), the lever [`LEVER`](Self::LEVER) and weight 1.
    pub fn new(obstacle: usize, force: f64) -> Self {
        Self {
            obstacle,
            disc: None,
            force,
            lever: Self::LEVER,
            weight: 1.0,
        }
    }

    /// The error (m) of a force (N) at a gap (m).
    pub(super) fn error(&self, force: f64, gap: f64) -> f64 {
        self.lever * (force - self.force) - gap.max(0.0)
    }

    /// Why no such force can be had; `None` if it might.
    pub(super) fn fault(&self, robot: &Robot, scene: &Scene) -> Option<&'static str> {
        let Some(obstacle) = scene.obstacles().get(self.obstacle) else {
            return Some("the scene has no such obstacle; obstacles are counted from 0");
        };
        let above_zero = |x: f64| x > 0.0 && x.is_finite();
        if obstacle.mass.is_some() {
            Some("the obstacle can move; expected one without a mass, which is fixed")
        } else if self.disc.is_some_and(|disc| disc >= robot.discs().len()) {
            Some("the robot has no such disc; discs are counted from 0")
        } else if !(above_zero(self.force) && above_zero(self.lever) && above_zero(self.weight)) {
            Some("forces, levers and weights are finite numbers above 0")
        } else {
            None
        }
    }
}

impl ContactGoals {
    /// Numbers of the obstacles that the robot may touch, and of those that it keeps clear of.
    pub(super) fn divide(&self, scene: &Scene) -> [Vec<usize>; 2] {
        let pressed = |number: &usize| self.presses.iter().any(|press| press.obstacle == *number);
        let may_touch = |number: &usize| self.clearance.is_none() || pressed(number);
        let (touched, apart) = (0..scene.obstacles().len()).partition(may_touch);
        [touched, apart]
    }
}

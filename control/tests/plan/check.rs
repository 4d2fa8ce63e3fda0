//! Going over a plan in steps ten times as fine, with nothing of the planner.

use nalgebra::{DVector, UnitQuaternion, Vector3};
use tdcr_control::plan::{MotionPlan, PlanStep};
use tdcr_sim::geometry::Beads;
use tdcr_sim::robot::{Loads, Robot};
use tdcr_sim::scene::Scene;
use tdcr_sim::statics::Settler;

/// How much finer.
const FINER: usize = 10;

/// Distance of a robot's discs from obstacles at least (m): that of its beads, less by how much a disc differs from them.
pub fn gap(
    robot: &Robot,
    scene: &Scene,
    positions: &[Vector3<f64>],
    orientations: &[UnitQuaternion<f64>],
) -> f64 {
    let beads = Beads::new(robot);
    let mut least = f64::INFINITY;
    for bead in beads.as_slice() {
        let centre = positions[bead.disc] + orientations[bead.disc] * bead.centre;
        for obstacle in scene.obstacles() {
            least = least.min(obstacle.signed_distance(&centre) - bead.radius);
        }
    }
    least - beads.shape_error()
}

/// What a plan comes to in fine steps.
#[derive(Debug)]
pub struct Checked {
    /// Least distance from obstacles (m).
    pub clearance: f64,
    /// Largest displacement of a disc in a step (m).
    pub largest_step: f64,
    /// The same for each share of the tendons' ranges by which the command changes (m).
    pub steepest: f64,
    /// Largest distance of a disc from where the plan has it (m).
    pub off: f64,
    pub converged: bool,
}

pub fn check(robot: &Robot, scene: &Scene, plan: &MotionPlan) -> Checked {
    let mut settler = Settler::new(robot);
    let mut found = Checked {
        clearance: f64::INFINITY,
        largest_step: 0.0,
        steepest: 0.0,
        off: 0.0,
        converged: true,
    };
    let first = &plan.steps[0];
    let mut last = settler
        .settle(&first.stance.command, &Loads::default())
        .positions
        .clone();
    for pair in plan.steps.windows(2) {
        let [from, to] = [0, 1].map(|k| pair[k].stance.command.as_slice());
        for part in 1..=FINER {
            let share = part as f64 / FINER as f64;
            let values: Vec<f64> = from
                .iter()
                .zip(to)
                .map(|(a, b)| a + share * (b - a))
                .collect();
            let settled = settler.follow(&robot.command(&values).unwrap(), &Loads::default());
            found.converged &= settled.converged;
            let (places, turns) = (&settled.positions, &settled.orientations);
            found.clearance = found.clearance.min(gap(robot, scene, places, turns));
            let moved = farthest(places, &last);
            found.largest_step = found.largest_step.max(moved);
            let ranges = robot.tendons().iter().map(|t| t.range[1] - t.range[0]);
            let shares = from
                .iter()
                .zip(to)
                .zip(ranges)
                .map(|((a, b), range)| ((b - a) / range).powi(2));
            let change = shares.sum::<f64>().sqrt() / FINER as f64;
            found.steepest = found.steepest.max(moved / change);
            last.clone_from(places);
        }
        found.off = found.off.max(farthest(&last, &pair[1].positions));
    }
    found
}

/// Largest distance of two discs (m).
pub fn farthest(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).norm())
        .fold(0.0, f64::max)
}

/// The largest angle between two successive straight lines of a plan, commands in shares of the tendons' ranges (rad).
pub fn sharpest_corner(robot: &Robot, plan: &MotionPlan) -> f64 {
    let ranges: Vec<f64> = robot
        .tendons()
        .iter()
        .map(|t| t.range[1] - t.range[0])
        .collect();
    let shares = |step: &PlanStep| {
        let values = step.stance.command.as_slice().iter().zip(&ranges);
        DVector::from_iterator(ranges.len(), values.map(|(value, range)| value / range))
    };
    let places: Vec<_> = plan.steps.iter().map(shares).collect();
    let ways = places.windows(2).map(|pair| &pair[1] - &pair[0]);
    let ways: Vec<_> = ways.filter(|way| way.norm() > 1e-9).collect();
    let angles = ways.windows(2).map(|pair| pair[0].angle(&pair[1]));
    angles.fold(0.0, f64::max)
}

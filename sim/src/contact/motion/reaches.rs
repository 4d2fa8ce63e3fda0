//! How far apart a robot and what it may touch within a step are at most.
//!
//! A disc comes nearer to an obstacle by no more than the ways of both, and to another disc by no more than its way as that one sees it. So
//! each pair has a reach of its own: what is fast, such as an object that falls off its table, brings nothing else near.

use nalgebra::Vector3;

use super::coupled::Movables;
use super::objects::Objects;
use super::touch::DiscVelocities;
use crate::contact::clear::{most_apart, most_displaced};
use crate::contact::near::Neighbourhood;
use crate::contact::near_pairs::PairNeighbourhood;
use crate::geometry::Beads;
use crate::robot::Robot;

/// Reach, for the way at the velocities that are known: those with contacts may be higher.
const MARGIN: f64 = 2.0;

/// The reaches of one step.
#[derive(Clone, Debug)]
pub(super) struct Reaches {
    /// The least reach (m).
    least: f64,
    /// What the beads of each disc are within, from the centre of its joint (m).
    arms: Vec<f64>,
    /// Time in which what is within reach may touch (s).
    window: f64,
    /// Of each disc, and of each obstacle where any moves, its part of a reach (m).
    discs: Vec<f64>,
    obstacles: Vec<f64>,
}

impl Reaches {
    pub fn new(robot: &Robot, beads: &Beads, least: f64) -> Self {
        let discs = robot.discs().iter().enumerate();
        let arms = discs.map(|(disc, own)| beads.enclosing(disc) + own.origin.norm());
        Self {
            least,
            arms: arms.collect(),
            window: 0.0,
            discs: Vec::new(),
            obstacles: Vec::new(),
        }
    }

    /// Sets them by the motions of discs and objects, as far as they are known, for a time (s).
    pub fn set(
        &mut self,
        window: f64,
        motions: &DiscVelocities,
        objects: &Objects,
        movables: &Movables,
    ) {
        self.window = window;
        self.discs.clear();
        let discs = motions.0.iter().zip(&self.arms);
        let ways = discs.map(|(motion, arm)| MARGIN * window * most_displaced(motion, *arm));
        self.discs.extend(ways.map(|way| way.max(self.least)));
        objects.speeds(movables, &mut self.obstacles);
        (self.obstacles.iter_mut()).for_each(|speed| *speed *= MARGIN * window);
    }

    /// Gap within which an obstacle and a disc count (m).
    pub fn of_obstacle(&self, obstacle: usize, disc: usize) -> f64 {
        self.discs[disc] + self.obstacles.get(obstacle).unwrap_or(&0.0)
    }

    /// Gap within which two discs count (m), by their motions and the centres of their joints (m); or a larger one that is within the
    /// `distance` (m) of the two.
    pub fn of_discs(
        &self,
        discs: [usize; 2],
        distance: f64,
        motions: &DiscVelocities,
        centres: &[Vector3<f64>],
    ) -> f64 {
        let most = self.most_of(discs);
        if most <= distance {
            return most;
        }
        let way = MARGIN * self.way(discs, motions, centres);
        way.max(2.0 * self.least)
    }

    /// The reach of two discs that come towards each other (m).
    fn most_of(&self, [one, other]: [usize; 2]) -> f64 {
        self.discs[one] + self.discs[other]
    }

    /// How far two discs come nearer at most (m).
    fn way(&self, discs: [usize; 2], motions: &DiscVelocities, centres: &[Vector3<f64>]) -> f64 {
        self.window * most_apart(&motions.0, centres, discs, self.arms[discs[1]])
    }

    /// Whether all that comes to touch at these motions was found.
    pub fn cover(
        &self,
        motions: &DiscVelocities,
        centres: &[Vector3<f64>],
        (objects, movables): (&Objects, &Movables),
        found: (&Neighbourhood, Option<&PairNeighbourhood>),
    ) -> bool {
        let mut speeds = Vec::new();
        objects.speeds(movables, &mut speeds);
        let discs = motions.0.iter().zip(&self.arms);
        let ways: Vec<f64> = discs
            .map(|(motion, arm)| self.window * most_displaced(motion, *arm))
            .collect();
        let (near, pairs) = found;
        let bounds = near.bounds.iter().enumerate();
        let pairs = pairs.map_or(&[][..], |pairs| &pairs.apart);
        let mut obstacles = bounds.map(|(index, bound)| {
            let (obstacle, disc) = (index / ways.len(), index % ways.len());
            let own = speeds.get(obstacle).unwrap_or(&0.0) * self.window;
            ways[disc] + own <= bound.apart
        });
        obstacles.all(|covered| covered)
            && pairs.iter().all(|pair| {
                let [one, other] = pair.discs;
                ways[one] + ways[other] <= pair.distance
                    || self.way(pair.discs, motions, centres) <= pair.distance
            })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use crate::contact::ContactStepper;
    use crate::dynamics::{Integrator, State, Stepper};
    use crate::robot::{Loads, Robot};
    use crate::scene::{Obstacle, Scene};

    /// Number of contacts that a step counts, of a robot that stands 30 mm from a wall, its joints turning so fast (rad/s).
    fn counted(scene: &Scene, rate: f64) -> usize {
        let robot = Robot::load("5m").unwrap();
        let stepper = Stepper::new(&robot, 2e-3, Integrator::SemiImplicitEuler).unwrap();
        let mut stepper = ContactStepper::new(stepper, scene).unwrap();
        let mut state = State::straight(&robot);
        state
            .velocity
            .iter_mut()
            .step_by(3)
            .for_each(|own| *own = rate);
        let command = robot.mean_command();
        stepper
            .step(&mut state, &command, &Loads::default())
            .unwrap();
        stepper.problem.touches.len()
    }

    fn wall() -> Obstacle {
        let wall = Obstacle::cuboid("wall", [0.02, 1.0, 2.0]).unwrap();
        wall.at([0.06, 0.0, 0.3])
    }

    /// Of discs that swing side by side, and far from the wall, none touches another, nor do those near the base touch the wall.
    #[test]
    fn what_is_slow_beside_what_is_fast_stays_out() {
        let scene = Scene::new(vec![wall()]).unwrap();
        assert_eq!(counted(&scene, 0.0), 0);
        let swinging = counted(&scene, 1.0);
        // By the sum of their speeds it would be three thousand.
        assert!((1..10).contains(&swinging), "{swinging}");
    }

    #[cfg(feature = "rapier")]
    #[test]
    fn a_fast_object_brings_nothing_else_near() {
        let bullet = Obstacle::sphere("bullet", 0.01).and_then(|ball| ball.with_mass(0.01));
        let bullet = bullet.unwrap().at([0.0, 0.0, -20.0]);
        let bullet = bullet.with_velocity([0.0, 0.0, -100.0], [0.0; 3]).unwrap();
        let scene = Scene::new(vec![wall(), bullet]).unwrap();
        assert_eq!(counted(&scene, 0.0), 0);
    }
}

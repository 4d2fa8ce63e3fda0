//! Robots in motion among obstacles.

mod friction;
mod held;
mod hostile;
mod itself;
mod own_friction;
mod rest;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::contact::ContactStepper;
use tdcr_sim::dynamics::{Integrator, State, Stepper};
use tdcr_sim::robot::Robot;
use tdcr_sim::scene::Scene;

use crate::scenes;

fn among(robot: &Robot, scene: &Scene, h: f64, integrator: Integrator) -> ContactStepper {
    let stepper = Stepper::new(robot, h, integrator).unwrap();
    ContactStepper::new(stepper, scene).unwrap()
}

/// A random scene of convex obstacles and straight pipes.
fn scene(rng: &mut ChaCha8Rng, robot: &Robot) -> Scene {
    scenes::scene(rng, robot, |rng, name, place| {
        let kind = rng.random_range(0..7);
        place.plain(rng, name, kind)
    })
}

/// Orientation of each disc in the world.
pub fn orientations(robot: &Robot, state: &State) -> Vec<UnitQuaternion<f64>> {
    let [w, x, y, z] = robot.spec().base.orientation;
    let base = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    (state.configuration.0.iter())
        .scan(base, |below, q| {
            *below *= q;
            Some(*below)
        })
        .collect()
}

/// Centres of all beads (m).
fn beads(stepper: &ContactStepper, state: &State) -> Vec<Vector3<f64>> {
    let robot = stepper.robot();
    let (positions, orientations) = (state.positions(robot), orientations(robot, state));
    (stepper.beads().as_slice().iter())
        .map(|bead| positions[bead.disc] + orientations[bead.disc] * bead.centre)
        .collect()
}

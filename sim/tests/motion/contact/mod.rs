//! Robots in motion among obstacles.

mod friction;
mod hostile;
mod itself;
mod rest;
#[path = "../../statics/contact/scenes.rs"]
mod scenes;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use tdcr_sim::contact::ContactStepper;
use tdcr_sim::dynamics::{Integrator, State, Stepper};
use tdcr_sim::robot::Robot;
use tdcr_sim::scene::Scene;

fn among(robot: &Robot, scene: &Scene, h: f64, integrator: Integrator) -> ContactStepper {
    let stepper = Stepper::new(robot, h, integrator).unwrap();
    ContactStepper::new(stepper, scene).unwrap()
}

/// Orientation of each disc in the world.
fn orientations(robot: &Robot, state: &State) -> Vec<UnitQuaternion<f64>> {
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

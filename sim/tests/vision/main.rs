//! What the virtual cameras and the clouds made from them promise.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod cameras;
mod clouds;
mod pictures;
mod sensor;

use nalgebra::Vector3;
use tdcr_sim::robot::{Loads, Robot};
use tdcr_sim::statics::Equilibrium;

fn bent_robot() -> (Robot, Equilibrium) {
    let robot = Robot::load("2m").unwrap();
    let command = robot
        .command(&[0.034, 0.007, 0.001, 0.026, 0.015, 0.019])
        .unwrap();
    let equilibrium = robot.settle(&command, &Loads::default());
    (robot, equilibrium)
}

/// Distance of a world point from the surface of a disc (m).
fn distance_to_disc(
    robot: &Robot,
    equilibrium: &Equilibrium,
    disc: usize,
    point: &Vector3<f64>,
) -> f64 {
    let shape = &robot.discs()[disc];
    let local = equilibrium.orientations[disc].inverse() * (point - equilibrium.positions[disc]);
    let out = local.xy().norm() - shape.radius;
    let up = local.z.abs() - shape.half_height;
    if out <= 0.0 || up <= 0.0 {
        out.max(up).abs()
    } else {
        out.hypot(up)
    }
}

//! What paths with friction promise, checked from outside through the public interface.

mod among;
mod differentiated;
mod energy;
mod law;
mod moving;
mod paths;
mod snap;

use nalgebra::Vector3;
use tdcr_sim::robot::{Backbone, Friction, PerDisc, Robot, RobotSpec};
use tdcr_sim::tendon_friction::{FrictionState, SlipState, TendonProfile};

/// Stiffness of every joint's backbone (N m/rad).
const BACKBONE: f64 = 0.2;
/// Stiffness of the contacts (N/m).
const CONTACT: f64 = 1e5;

fn rough(coefficient: f64) -> Option<Friction> {
    Some(Friction {
        coefficient,
        contact_stiffness: CONTACT,
    })
}

/// The 2m robot on an elastic backbone, with friction in every hole.
fn rough_spec(coefficient: f64) -> RobotSpec {
    let mut spec = RobotSpec::standard("2m").unwrap();
    for module in &mut spec.modules {
        module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(BACKBONE)));
        module.tendons.as_mut().unwrap().friction = rough(coefficient);
    }
    spec
}

fn rough_robot(coefficient: f64) -> Robot {
    Robot::new(rough_spec(coefficient)).unwrap()
}

/// All tendons at 0.03 m, but the first.
fn pull_first(robot: &Robot, first: f64) -> tdcr_sim::robot::Command {
    robot
        .command(&[first, 0.03, 0.03, 0.03, 0.03, 0.03])
        .unwrap()
}

fn tip(state: &FrictionState) -> Vector3<f64> {
    *state.equilibrium.positions.last().unwrap()
}

/// Weight and backbones (J), written here again from the specification.
fn potential(robot: &Robot, state: &FrictionState) -> f64 {
    let weight: f64 = (robot.discs().iter().zip(&state.equilibrium.positions))
        .map(|(disc, position)| disc.mass * 9.81 * position.z)
        .sum();
    let joints = state.equilibrium.configuration.0.iter();
    let bends: f64 = joints.map(|q| 0.5 * BACKBONE * q.angle().powi(2)).sum();
    weight + bends
}

/// Whether each contact is within the capstan cone, and at its edge where it slips; a tendon that
/// does not pull has no friction.
fn assert_capstan(profile: &TendonProfile, coefficient: f64) {
    for (hole, contact) in profile.slip_states.iter().enumerate() {
        let [before, after] = [profile.tensions[hole], profile.tensions[hole + 1]];
        if before <= 0.0 {
            assert_eq!(before, after);
            continue;
        }
        let bound = (coefficient * profile.wrap_angles[hole]).exp();
        let (low, high) = (before / bound, before * bound);
        let rounding = 1e-13 * before;
        match contact {
            SlipState::Sticks => {
                assert!(after >= low - rounding && after <= high + rounding);
            }
            SlipState::SlipsToServo => assert!((after - low).abs() < rounding),
            SlipState::SlipsToEnd => assert!((after - high).abs() < rounding),
        }
    }
}

//! An object that the robot carries.

use nalgebra::Vector3;
use tdcr_sim::dynamics::State;
use tdcr_sim::robot::Robot;
use tdcr_sim::scene::{JointSpec, Obstacle, SliderSpec};

use super::{among, drive, towards};

/// Bent to an arch.
const LEANING: [f64; 6] = [0.034, 0.004, 0.004, 0.026, 0.017, 0.017];

/// A plate on an upright rail comes down on the robot, which bends away below it: at rest the robot presses it up with its weight.
#[test]
fn a_plate_rests_on_the_robot_with_its_weight() {
    let robot = Robot::load("2m").unwrap();
    let mass = 0.03;
    let rail = SliderSpec {
        axis: [0.0, 0.0, 1.0],
        limits: None,
        damping: 0.5,
    };
    let mut state = State::straight(&robot);
    let above = state.positions(&robot)[9].z + 0.03;
    let plate = Obstacle::cuboid("plate", [0.3, 0.3, 0.01]).unwrap();
    let plate = plate.with_mass(mass).unwrap().at([0.0, 0.0, above]);
    let plate = plate.with_joint(JointSpec::Slider(rail)).unwrap();
    let mut stepper = among(&robot, vec![plate]);
    let command = towards(&robot, &LEANING);
    drive(&mut stepper, &mut state, 20_000, command, |_, _| {});
    let contacts = stepper.contacts().iter();
    let force = -contacts.map(|one| one.force).sum::<Vector3<f64>>();
    assert!(
        (force - Vector3::z() * (mass * 9.81)).norm() < 1e-6,
        "{force}"
    );
    // Well below where it began, and on the robot: not beside it on its way down.
    let plate = &stepper.objects()[0];
    assert!(plate.pose.translation.z < above - 0.1 && plate.velocity.norm() < 1e-5);
}

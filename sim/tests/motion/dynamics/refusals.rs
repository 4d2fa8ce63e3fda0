//! What cannot be moved.

use nalgebra::{UnitQuaternion, Vector3};
use tdcr_sim::dynamics::{Integrator, Lineariser, State, Stepper};
use tdcr_sim::robot::{
    Command, Drive, Frame, Hinge, HingeJoint, Loads, MassSpec, PerDisc, Robot, RobotSpec, Wrench,
};

#[test]
fn what_cannot_be_moved_is_refused_with_the_reason() {
    let robot = Robot::load("2m").unwrap();
    let refused = |robot: &Robot, h: f64| {
        Stepper::new(robot, h, Integrator::SemiImplicitEuler)
            .unwrap_err()
            .to_string()
    };
    for h in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(refused(&robot, h).contains("expected a finite number above 0"));
        assert!(Lineariser::new(&robot, h).is_err());
    }
    let mut spec = robot.spec().clone();
    spec.modules[1].tendons.as_mut().unwrap().drive = Drive::Length;
    let inextensible = Robot::new(spec).unwrap();
    let message = Stepper::new(&inextensible, 0.002, Integrator::RungeKutta4).unwrap_err();
    assert!(message.to_string().starts_with("tendon 4 is inextensible"));
    assert!(Lineariser::new(&inextensible, 0.002).is_err());
    let mut spec = robot.spec().clone();
    (spec.modules[0].damping, spec.modules[0].armature) =
        (PerDisc::Uniform(0.0), PerDisc::Uniform(0.0));
    spec.modules[0].mass = MassSpec::Density(PerDisc::Uniform(0.0));
    let massless = Robot::new(spec).unwrap();
    assert!(refused(&massless, 0.002).starts_with("joint 0 has no armature"));

    let mut stepper = Stepper::new(&robot, 0.002, Integrator::SemiImplicitEuler).unwrap();
    let other = Robot::load("3m").unwrap();
    let mut try_step = |state: &State, command: &Command, loads: &Loads| {
        let mut after = state.clone();
        let message = stepper
            .step(&mut after, command, loads)
            .unwrap_err()
            .to_string();
        assert_eq!(&after, state);
        message
    };
    let (state, command, loads) = (
        State::straight(&robot),
        robot.mean_command(),
        Loads::default(),
    );
    let message = try_step(&State::straight(&other), &command, &loads);
    assert_eq!(
        message,
        "the configuration has 15 entries; robot `2m` needs 10"
    );
    let message = try_step(&state, &other.mean_command(), &loads);
    assert_eq!(message, "the command has 9 entries; robot `2m` needs 6");
    let beyond = loads.with_wrench(Wrench::none(10, Frame::World)).unwrap();
    let message = try_step(&state, &command, &beyond);
    assert!(message.starts_with("a wrench acts on disc 10"), "{message}");
}

/// 2m without tendons, damping and weight, on hinges about these axes.
fn on_hinges(axes: &[[f64; 3]]) -> Robot {
    let mut spec = RobotSpec::standard("2m").unwrap();
    spec.gravity = [0.0; 3];
    for module in &mut spec.modules {
        (module.tendons, module.damping) = (None, PerDisc::Uniform(0.0));
        module.joint = Some(PerDisc::Uniform(HingeJoint {
            hinges: axes.iter().map(|axis| Hinge::new(*axis, 0.0)).collect(),
            zero: [0.0; 3],
        }));
    }
    Robot::new(spec).unwrap()
}

#[test]
fn motions_end_where_hinges_have_no_angles() {
    let robot = on_hinges(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    let mut stepper = Stepper::new(&robot, 0.005, Integrator::SemiImplicitEuler).unwrap();
    let mut state = State::straight(&robot);
    state.velocity[3 * 9 + 1] = 20.0;
    let command = robot.mean_command();
    let mut steps = 0;
    let ended = loop {
        match stepper.step(&mut state, &command, &Loads::default()) {
            Ok(()) => steps += 1,
            Err(error) => break error.to_string(),
        }
        assert!(steps < 100, "a quarter turn takes about 16 steps");
    };
    assert!(steps > 10, "{steps}");
    assert!(
        ended.contains("the hinges of joint 9 turn beyond"),
        "{ended}"
    );
    assert!(ended.contains("gimbal lock"), "{ended}");
}

#[test]
fn rotations_that_hinges_cannot_have_are_refused() {
    let robot = on_hinges(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let mut stepper = Stepper::new(&robot, 0.002, Integrator::SemiImplicitEuler).unwrap();
    let mut state = State::straight(&robot);
    state.configuration.0[3] = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.0, 0.2));
    let command = robot.mean_command();
    let refused = stepper.step(&mut state, &command, &Loads::default());
    let said = refused.unwrap_err().to_string();
    assert!(
        said.starts_with("joint 3 is turned by 2.0e-1 rad from what its hinges can"),
        "{said}"
    );
}

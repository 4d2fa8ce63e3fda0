//! What cannot be moved.

use tdcr_sim::dynamics::{Integrator, Lineariser, State, Stepper};
use tdcr_sim::robot::{Command, Drive, Frame, Loads, MassSpec, PerDisc, Robot, Wrench};

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
    assert!(refused(&inextensible, 0.002).starts_with("tendon 4 is inextensible"));
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

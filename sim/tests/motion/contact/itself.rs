//! Robots in motion that touch themselves.

use nalgebra::Vector3;
use tdcr_sim::contact::{Contact, ContactSettler, ContactStepper};
use tdcr_sim::dynamics::{Integrator, State};
use tdcr_sim::robot::{Command, Loads, PerDisc, Robot, RobotSpec};
use tdcr_sim::scene::{Scene, SelfContact};

use super::{among, beads};

/// All modules pulled to one side, so that the tip curls onto the lower discs.
pub fn curling(robot: &Robot, side: usize) -> Command {
    let pull = |tendon: usize| if tendon % 3 == side { 0.036 } else { 0.004 };
    let values: Vec<f64> = (0..robot.tendons().len()).map(pull).collect();
    robot.command(&values).unwrap()
}

/// The least distance of beads of discs that are not neighbours (m).
fn clearance(stepper: &ContactStepper, state: &State) -> f64 {
    let (own, centres) = (stepper.beads().as_slice(), beads(stepper, state));
    let mut least = f64::INFINITY;
    for (one, at) in own.iter().zip(&centres) {
        for (other, place) in own.iter().zip(&centres) {
            if other.disc > one.disc + 1 {
                least = least.min((at - place).norm() - one.radius - other.radius);
            }
        }
    }
    least
}

/// The state after `steps` steps from the straight pose, and the deepest overlap on the way (m).
fn curled(stepper: &mut ContactStepper, command: &Command, steps: usize) -> (State, f64) {
    let mut state = State::straight(stepper.robot());
    let mut deepest = 0.0_f64;
    for step in 0..steps {
        (stepper.step(&mut state, command, &Loads::default())).unwrap();
        if step % 10 == 0 {
            deepest = deepest.max(-clearance(stepper, &state));
        }
    }
    (state, deepest)
}

#[test]
fn a_robot_that_curls_up_in_motion_rests_where_it_settles_and_does_not_pass_through_itself() {
    // Damped less, so that its slow modes come to rest soon.
    let mut spec = RobotSpec::standard("5m").unwrap();
    for module in &mut spec.modules {
        module.damping = PerDisc::Uniform(2e-3);
    }
    let robot = Robot::new(spec).unwrap();
    let scene = Scene::new(Vec::new()).unwrap();
    let command = curling(&robot, 0);
    let mut stepper = among(&robot, &scene, 2e-3, Integrator::ImplicitEuler);
    let (mut state, deepest) = curled(&mut stepper, &command, 300);
    assert!(stepper.unsolved() == 0 && deepest < 1e-3, "{deepest}");
    let (again, _) = curled(&mut stepper, &command, 300);
    assert_eq!(state, again);
    // Long steps lead near to rest soon.
    let mut long = among(&robot, &scene, 0.02, Integrator::ImplicitEuler);
    for _ in 0..400 {
        (long.step(&mut state, &command, &Loads::default())).unwrap();
    }
    let mut settler = ContactSettler::new(&robot, &scene);
    let found = (settler.settle_from(&state.configuration, &command, &Loads::default())).unwrap();
    assert!(found.equilibrium.converged && !found.contacts.is_empty());
    let from_rest = |state: &State| {
        let pairs = state
            .positions(&robot)
            .into_iter()
            .zip(&found.equilibrium.positions);
        pairs
            .map(|(here, there)| (here - there).norm())
            .fold(0.0, f64::max)
    };
    let near = from_rest(&state);
    // There it stays, under the same forces.
    let mut state = State::at_rest(found.equilibrium.configuration.clone());
    for _ in 0..100 {
        (stepper.step(&mut state, &command, &Loads::default())).unwrap();
    }
    let drift = from_rest(&state);
    eprintln!("{deepest:e} m deep, {near:e} m from rest, {drift:e} m of drift");
    assert!(near < 0.01 && drift < 1e-9, "{near} {drift}");
    let on = |contacts: &[Contact]| -> Vec<Vector3<f64>> {
        let mut forces = vec![Vector3::zeros(); robot.discs().len()];
        for contact in contacts {
            let other = contact.partner.disc().unwrap();
            assert!(other > contact.disc + 1);
            forces[contact.disc] += contact.force;
            forces[other] -= contact.force;
        }
        forces
    };
    for (moving, resting) in on(stepper.contacts()).iter().zip(&on(&found.contacts)) {
        assert!((moving - resting).norm() < 1e-6, "{moving} {resting}");
    }
    // Ignored, it passes through itself as without a scene.
    let ignored = (scene.with_self_contact(SelfContact::Ignored)).unwrap();
    let mut through = among(&robot, &ignored, 2e-3, Integrator::ImplicitEuler);
    assert!(curled(&mut through, &command, 300).1 > 5e-3);
}

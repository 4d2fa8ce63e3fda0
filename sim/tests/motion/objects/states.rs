//! Objects' states: taken, given, and started anew.

use tdcr_sim::dynamics::{DynamicsError, Integrator, State};
use tdcr_sim::objects::ObjectState;
use tdcr_sim::robot::{Loads, Robot};
use tdcr_sim::scene::{Obstacle, Scene};
use tdcr_sim::simulation::{MovingRobot, Simulation};

use super::{LEFT, among, drive, towards};

fn shelf_and_box() -> Vec<Obstacle> {
    let table = Obstacle::cuboid("table", [0.2, 0.3, 0.02]).unwrap();
    let table = table.with_friction(0.3).unwrap().at([-0.15, 0.0, 0.23]);
    let parcel = Obstacle::cuboid("box", [0.04, 0.04, 0.04]).unwrap();
    vec![
        table,
        parcel.with_mass(0.02).unwrap().at([-0.072, 0.0, 0.26]),
    ]
}

#[test]
fn a_motion_started_anew_is_the_same_to_the_last_bit_and_a_copy_goes_on_as_the_first() {
    let robot = Robot::load("2m").unwrap();
    let mut stepper = among(&robot, shelf_and_box());
    let run = |stepper: &mut tdcr_sim::contact::ContactStepper, state: &mut State, from: f64| {
        let command = towards(&robot, &LEFT);
        drive(stepper, state, 400, |time| command(time + from), |_, _| {});
        (state.clone(), stepper.objects().to_vec())
    };
    let mut state = State::straight(&robot);
    let first = run(&mut stepper, &mut state, 0.0);
    let (mut copy, mut copied) = (stepper.clone(), state.clone());
    let on = run(&mut stepper, &mut state, 0.8);
    assert_eq!(run(&mut copy, &mut copied, 0.8), on);
    assert_ne!(first.1, on.1);
    assert_eq!(stepper.scene().obstacles()[1].pose, on.1[0].pose);
    stepper.place_objects(None).unwrap();
    let mut state = State::straight(&robot);
    assert_eq!(run(&mut stepper, &mut state, 0.0), first);
}

#[test]
fn objects_go_on_from_states_that_were_kept_and_states_of_others_are_refused() {
    let robot = Robot::load("2m").unwrap();
    let mut stepper = among(&robot, shelf_and_box());
    let mut state = State::straight(&robot);
    let command = towards(&robot, &LEFT);
    drive(&mut stepper, &mut state, 400, &command, |_, _| {});
    let kept = stepper.objects().to_vec();
    let (mut again, mut same) = (among(&robot, shelf_and_box()), state.clone());
    again.place_objects(Some(&kept)).unwrap();
    assert_eq!(again.objects(), kept);
    for (stepper, state) in [(&mut stepper, &mut state), (&mut again, &mut same)] {
        drive(stepper, state, 200, |time| command(time + 0.8), |_, _| {});
    }
    // Rapier starts its search from other impulses: the same but for its tolerance.
    let apart =
        stepper.objects()[0].pose.translation.vector - again.objects()[0].pose.translation.vector;
    assert!(apart.norm() < 1e-4, "{apart:?}");
    let refused = stepper.place_objects(Some(&[])).unwrap_err();
    assert!(matches!(refused, DynamicsError::Objects(_)));
    assert_eq!(refused.to_string(), "0 states of objects; the scene has 1");
    let mut lost: ObjectState = kept[0];
    lost.velocity.x = f64::NAN;
    let refused = stepper
        .place_objects(Some(&[lost]))
        .unwrap_err()
        .to_string();
    assert!(refused.contains("`box` has velocity [NaN,"), "{refused}");
}

/// Without the rest a step of five such objects costs 10 of the robot's; the last bits of a box that rapier moves never rest.
#[test]
fn objects_rest_to_the_last_bit_until_something_touches_them() {
    let robot = Robot::load("2m").unwrap();
    let mut obstacles = shelf_and_box();
    let lid = Obstacle::cuboid("lid", [0.04, 0.04, 0.01]).unwrap();
    let lid = lid.with_mass(0.01).unwrap().with_friction(0.3).unwrap();
    obstacles.push(lid.at([-0.072, 0.0, 0.285]));
    let mut stepper = among(&robot, obstacles);
    let mut state = State::straight(&robot);
    let mean = robot.mean_command().as_slice().to_vec();
    drive(&mut stepper, &mut state, 250, |_| mean.clone(), |_, _| {});
    let rest = stepper.objects().to_vec();
    drive(
        &mut stepper,
        &mut state,
        50,
        |_| mean.clone(),
        |stepper, _| assert_eq!(stepper.objects(), rest),
    );
    let left = towards(&robot, &LEFT);
    drive(&mut stepper, &mut state, 400, &left, |_, _| {});
    let way = |objects: &[ObjectState], object: usize| {
        let places = [&rest, objects].map(|all| all[object].pose.translation.vector);
        (places[1] - places[0]).norm()
    };
    let moved = [0, 1].map(|object| way(stepper.objects(), object));
    assert!(moved.iter().all(|way| *way > 1e-3), "{moved:?}");
    // At the top of its flight an object is as slow.
    let mut thrown = rest.clone();
    thrown[1].pose.translation.z += 0.1;
    thrown[1].velocity = nalgebra::Vector3::from(robot.spec().gravity) * -0.002;
    stepper.place_objects(Some(&thrown)).unwrap();
    drive(&mut stepper, &mut state, 20, &left, |_, _| {});
    let fallen = thrown[1].pose.translation.z - stepper.objects()[1].pose.translation.z;
    assert!(fallen > 0.005, "{fallen}");
}

#[test]
fn a_robot_far_from_objects_moves_as_without_them_to_the_last_bit() {
    let robot = Robot::load("2m").unwrap();
    let far = shelf_and_box().into_iter().map(|one| {
        let mut one = one;
        one.pose.translation.x -= 3.0;
        one
    });
    let mut stepper = among(&robot, far.collect());
    let mut bare = among(&robot, Vec::new());
    let (mut one, mut other) = (State::straight(&robot), State::straight(&robot));
    let command = towards(&robot, &LEFT);
    drive(&mut stepper, &mut one, 200, &command, |_, _| {});
    drive(&mut bare, &mut other, 200, &command, |_, _| {});
    assert_eq!(one, other);
}

#[test]
fn a_reset_brings_objects_back() {
    let robot = Robot::load("2m").unwrap();
    let stepper =
        tdcr_sim::dynamics::Stepper::new(&robot, 2e-3, Integrator::SemiImplicitEuler).unwrap();
    let scene = Scene::new(shelf_and_box()).unwrap();
    let stepper = tdcr_sim::contact::ContactStepper::new(stepper, &scene).unwrap();
    let mut moving = MovingRobot::among(stepper, 10);
    moving
        .reset(&robot.mean_command(), &Loads::default())
        .unwrap();
    let start = moving.objects().to_vec();
    let command = robot.command(&LEFT).unwrap();
    for _ in 0..60 {
        moving.advance(&command, &Loads::default()).unwrap();
    }
    let moved = moving.objects()[0].pose.translation.vector - start[0].pose.translation.vector;
    assert!(moved.norm() > 1e-3, "{moved:?}");
    moving
        .reset(&robot.mean_command(), &Loads::default())
        .unwrap();
    assert_eq!(moving.objects(), start);
}

//! Objects that the robot holds by friction alone: dragged along, and hanging.

use nalgebra::Vector3;
use tdcr_sim::contact::{ContactStepper, Sliding};
use tdcr_sim::dynamics::State;
use tdcr_sim::robot::Robot;
use tdcr_sim::scene::{JointSpec, Obstacle, SliderSpec};

use super::{LEFT, STEP, among, drive, towards};
use crate::contact::orientations;

const FRICTION: f64 = 0.5;

/// A plate that the robot leans on, with its face at `x = -0.05` m.
fn plate() -> Obstacle {
    let plate = Obstacle::cuboid("plate", [0.01, 0.6, 0.6]).unwrap();
    let plate = plate.at([-0.055, 0.0, 0.25]);
    plate.with_friction(FRICTION).unwrap()
}

/// The same of a mass (kg), on a rail.
fn on_a_rail(mass: f64, axis: [f64; 3], damping: f64) -> Obstacle {
    let rail = SliderSpec {
        axis,
        limits: None,
        damping,
    };
    let plate = plate().with_mass(mass).unwrap();
    plate.with_joint(JointSpec::Slider(rail)).unwrap()
}

/// The robot at rest, leaning on the plate while that is fixed, and the normal force (N).
fn leaning(robot: &Robot) -> (State, f64) {
    let mut stepper = among(robot, vec![plate()]);
    let mut state = State::straight(robot);
    let press = towards(robot, &LEFT);
    drive(&mut stepper, &mut state, 2_000, press, |_, _| {});
    (state, normal(&stepper))
}

fn normal(stepper: &ContactStepper) -> f64 {
    let contacts = stepper.contacts().iter();
    contacts
        .map(|contact| contact.force.dot(&contact.normal))
        .sum()
}

/// Force on the object, world axes (N).
fn on_the_object(stepper: &ContactStepper) -> Vector3<f64> {
    let contacts = stepper.contacts().iter();
    contacts.fold(Vector3::zeros(), |sum, contact| sum - contact.force)
}

/// Fails where friction is beyond the cone of a contact in the last step, or where one slips that is within it or whose friction is not
/// against the sliding of the disc's point. The number that slip.
fn assert_coulomb(stepper: &ContactStepper, before: &State, after: &State) -> usize {
    let robot = stepper.robot();
    let [places, next] = [before, after].map(|state| state.positions(robot));
    let [turns, turned] = [before, after].map(|state| orientations(robot, state));
    let mut slipping = 0;
    for contact in stepper.contacts() {
        let normal = contact.force.dot(&contact.normal);
        let friction = contact.force - contact.normal * normal;
        let share = friction.norm() / (FRICTION * normal);
        assert!(share < 1.001, "{contact:?}");
        if contact.sliding != Sliding::Slips {
            continue;
        }
        slipping += 1;
        assert!(share > 0.999, "{contact:?}");
        // The plate's rail lets it move, not turn.
        let disc = contact.disc;
        let own = turns[disc].inverse() * (contact.point - places[disc]);
        let moved = next[disc] + turned[disc] * own - contact.point;
        let sliding = moved / STEP - stepper.objects()[0].velocity;
        let across = sliding - contact.normal * contact.normal.dot(&sliding);
        // Discs turn within a step, so that slow sliding is known less well.
        if across.norm() > 5e-3 {
            let along = friction.normalize().dot(&across.normalize());
            assert!(along < -0.99, "{along}: {across:?} {contact:?}");
        }
    }
    slipping
}

/// On a rail along `y`, beside a robot that turns that way: a light plate goes along, one that is braked or heavy is left behind.
#[test]
fn a_plate_is_dragged_along_as_far_as_friction_reaches() {
    let robot = Robot::load("2m").unwrap();
    let (rest, _) = leaning(&robot);
    // A part of the way to the command that bends a third of a turn further.
    let turned = |k: usize| LEFT[k / 3 * 3 + (k + 2) % 3];
    let aside: Vec<f64> = (0..6).map(|k| 0.85 * LEFT[k] + 0.15 * turned(k)).collect();
    let sideways = |time: f64| {
        let share = 0.5 - 0.5 * f64::cos(std::f64::consts::PI * time.min(1.0));
        let both = LEFT.iter().zip(&aside);
        both.map(|(a, b)| a + (b - a) * share).collect()
    };
    let ways = [(0.01, 0.0), (0.01, 1_000.0), (50.0, 0.0)].map(|(mass, damping)| {
        let mut stepper = among(&robot, vec![on_a_rail(mass, [0.0, 1.0, 0.0], damping)]);
        let mut state = rest.clone();
        let from = state.positions(&robot)[9].y;
        let (mut last, mut before, mut worst, mut slipping) = (0.0, rest.clone(), 0.0_f64, 0);
        drive(&mut stepper, &mut state, 500, sideways, |stepper, state| {
            slipping += assert_coulomb(stepper, &before, state);
            before.clone_from(state);
            let velocity = stepper.objects()[0].velocity.y;
            let impulse = on_the_object(stepper).y * STEP;
            let gained = mass * (velocity - last) + damping * velocity * STEP;
            worst = worst.max((gained - impulse).abs());
            last = velocity;
        });
        let way = stepper.objects()[0].pose.translation.vector.y;
        let tip = state.positions(&robot)[9].y - from;
        eprintln!(
            "{mass} kg, {damping} N s/m: {way} m, tip {tip} m, {slipping} contacts slipped, momentum within {worst:e} N s"
        );
        // Of some 1e-3 N s.
        assert!(worst < 1e-15 && slipping > 100, "{worst:e} {slipping}");
        way / tip
    });
    assert!((0.8..1.0).contains(&ways[0]), "{ways:?}");
    assert!((0.01..0.5).contains(&ways[1]), "{ways:?}");
    assert!((0.01..0.5).contains(&ways[2]), "{ways:?}");
}

/// On a rail up and down, where nothing else holds it up: the robot gives way until it bears the weight, or the plate falls past it.
#[test]
fn a_plate_hangs_by_friction_up_to_the_coefficient_times_what_presses_it() {
    let robot = Robot::load("2m").unwrap();
    let (rest, pressed) = leaning(&robot);
    for (share, hangs) in [(0.5, true), (0.9, true), (2.0, false)] {
        let mass = share * FRICTION * pressed / 9.81;
        let mut stepper = among(&robot, vec![on_a_rail(mass, [0.0, 0.0, 1.0], 0.0)]);
        let (mut state, mut before) = (rest.clone(), rest.clone());
        let (mut slipping, mut impulse) = (0, 0.0);
        drive(
            &mut stepper,
            &mut state,
            500,
            |_| LEFT.to_vec(),
            |stepper, state| {
                slipping += assert_coulomb(stepper, &before, state);
                before.clone_from(state);
                impulse += on_the_object(stepper).z * STEP;
            },
        );
        let (force, speed) = (on_the_object(&stepper).z, stepper.objects()[0].velocity.z);
        let bears = force / (mass * 9.81);
        eprintln!(
            "{share}: bears {bears} of the weight, pressed with {} N of {pressed} N, {speed} m/s, {slipping} contacts slipped",
            normal(&stepper)
        );
        let fallen = impulse / mass - 9.81 * STEP * 500.0;
        assert!((speed - fallen).abs() < 1e-9, "{speed} {fallen}");
        match hangs {
            true => assert!(
                (bears - 1.0).abs() < 1e-3 && speed.abs() < 5e-3,
                "{bears} {speed}"
            ),
            false => assert!(bears == 0.0 && speed < -2.0, "{bears} {speed}"),
        }
    }
}

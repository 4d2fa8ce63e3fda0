//! Objects that no robot touches: what rapier does with what it was given, beside closed forms.

use nalgebra::Vector3;
use tdcr_sim::dynamics::State;
use tdcr_sim::objects::ObjectState;
use tdcr_sim::robot::Robot;
use tdcr_sim::scene::{HingeSpec, JointSpec, Obstacle, SliderSpec};

use super::{STEP, among, drive, towards};

/// Far from the robot.
const AWAY: f64 = 1.0;

/// The states of the objects after each step.
fn paths(obstacles: Vec<Obstacle>, steps: usize) -> Vec<Vec<ObjectState>> {
    let robot = Robot::load("2m").unwrap();
    let mut stepper = among(&robot, obstacles);
    let mut state = State::straight(&robot);
    let mut paths = Vec::new();
    let still = towards(&robot, robot.mean_command().as_slice());
    drive(&mut stepper, &mut state, steps, still, |stepper, _| {
        paths.push(stepper.objects().to_vec());
    });
    paths
}

#[test]
fn a_ball_falls_as_far_as_the_steps_say_and_rests_on_the_floor() {
    let ball = Obstacle::sphere("ball", 0.02)
        .unwrap()
        .with_mass(0.1)
        .unwrap();
    let ball = ball
        .at([AWAY, 0.0, 0.3])
        .with_velocity([0.1, 0.0, 0.0], [0.0; 3])
        .unwrap();
    let path = paths(vec![Obstacle::half_space("floor"), ball], 500);
    // Semi-implicit Euler: v = g h k, z = z0 - g h² k (k + 1) / 2.
    for (step, states) in path.iter().enumerate().take(100) {
        let k = (step + 1) as f64;
        let z = 0.3 - 9.81 * STEP * STEP * k * (k + 1.0) / 2.0;
        let found = states[0].pose.translation.vector;
        let expected = Vector3::new(AWAY + 0.1 * STEP * k, 0.0, z);
        assert!((found - expected).norm() < 1e-12, "{step}: {found:?} {z}");
    }
    let end = &path[499][0];
    let height = end.pose.translation.vector.z;
    assert!((height - 0.02).abs() < 2e-5, "{height}");
    assert!(end.velocity.z.abs() < 1e-4, "{:?}", end.velocity);
}

#[test]
fn a_box_slides_as_far_as_friction_lets_it() {
    let floor = Obstacle::half_space("floor").with_friction(0.4).unwrap();
    let parcel = Obstacle::cuboid("box", [0.06, 0.06, 0.02]).unwrap();
    let parcel = parcel.with_mass(0.2).unwrap().at([AWAY, 0.0, 0.01]);
    let parcel = parcel.with_velocity([0.8, 0.0, 0.0], [0.0; 3]).unwrap();
    let path = paths(vec![floor, parcel], 500);
    let way = path[499][0].pose.translation.vector.x - AWAY;
    // v² / (2 F g), of the larger of the two coefficients.
    let expected = 0.64 / (2.0 * 0.4 * 9.81);
    eprintln!("way {way} m, closed form {expected} m");
    // A step more or less is 1.6 mm.
    assert!((way / expected - 1.0).abs() < 0.015, "{way} {expected}");
    assert!(path[499][0].velocity.norm() < 1e-4);
}

#[test]
fn a_door_swings_with_the_period_of_its_pendulum_and_stops_at_its_limit() {
    // A bar that hangs from a hinge about y at its upper end.
    let bar = |angle: f64, limits| {
        let bar = Obstacle::cuboid("bar", [0.01, 0.01, 0.2]).unwrap();
        let (sin, cos) = (f64::sin(angle / 2.0), f64::cos(angle / 2.0));
        let reach = [-0.1 * f64::sin(angle), 0.0, -0.1 * f64::cos(angle)];
        bar.with_mass(0.3)
            .unwrap()
            .with_orientation([cos, 0.0, sin, 0.0])
            .unwrap()
            .at([AWAY + reach[0], 0.0, 1.0 + reach[2]])
            .with_joint(JointSpec::Hinge(HingeSpec {
                axis: [0.0, 2.0, 0.0],
                anchor: [0.0, 0.0, 0.1],
                limits,
                damping: 0.0,
            }))
            .unwrap()
    };
    let start = 0.1;
    let path = paths(vec![bar(start, None)], 1_000);
    let swings: Vec<f64> = (path.iter())
        .map(|states| states[0].pose.rotation.scaled_axis().y)
        .collect();
    let crossings: Vec<usize> = (1..swings.len())
        .filter(|&k| swings[k - 1] > 0.0 && swings[k] <= 0.0)
        .collect();
    let period = (crossings[crossings.len() - 1] - crossings[0]) as f64 * STEP
        / (crossings.len() - 1) as f64;
    // I = m (l²/12 + w²/12 + l²/4); T = 2 pi sqrt(I / (m g l / 2)) (1 + a²/16).
    let inertia = (0.2_f64.powi(2) + 0.01_f64.powi(2)) / 12.0 + 0.01;
    let expected =
        std::f64::consts::TAU * (inertia / (9.81 * 0.1)).sqrt() * (1.0 + start * start / 16.0);
    eprintln!("period {period} s, closed form {expected} s");
    assert!(
        (period / expected - 1.0).abs() < 0.01,
        "{period} {expected}"
    );
    let anchor = path[999][0].pose.transform_point(&[0.0, 0.0, 0.1].into());
    assert!(
        (anchor.coords - Vector3::new(AWAY, 0.0, 1.0)).norm() < 1e-4,
        "{anchor:?}"
    );
    // It may turn back by 0.05 rad from where it starts.
    let held = paths(vec![bar(start, Some([-0.05, 0.2]))], 500);
    let lowest = (held.iter())
        .map(|states| states[0].pose.rotation.scaled_axis().y)
        .fold(1.0, f64::min);
    assert!((lowest - 0.05).abs() < 5e-3, "{lowest}");
}

#[test]
fn a_drawer_slows_down_by_its_damping_and_stops_at_its_end() {
    let drawer = |limits, damping| {
        let drawer = Obstacle::cuboid("drawer", [0.1, 0.1, 0.05]).unwrap();
        drawer
            .with_mass(0.5)
            .unwrap()
            .at([AWAY, 0.0, 0.5])
            .with_velocity([0.2, 0.0, 0.0], [0.0; 3])
            .unwrap()
            .with_joint(JointSpec::Slider(SliderSpec {
                axis: [1.0, 0.0, 0.0],
                limits,
                damping,
            }))
            .unwrap()
    };
    let path = paths(vec![drawer(None, 2.0)], 500);
    // v exp(-d t / m), x = v m / d (1 - exp(-d t / m)).
    let time = STEP * 500.0;
    let expected = 0.2 * 0.5 / 2.0 * (1.0 - (-2.0 * time / 0.5).exp());
    let found = path[499][0].pose.translation.vector - Vector3::new(AWAY, 0.0, 0.5);
    eprintln!("way {} m, closed form {expected} m", found.x);
    assert!(
        (found.x / expected - 1.0).abs() < 0.01,
        "{found:?} {expected}"
    );
    assert!(found.y.abs() + found.z.abs() < 1e-5, "{found:?}");
    let held = paths(vec![drawer(Some([-0.1, 0.03]), 0.0)], 500);
    let farthest = (held.iter())
        .map(|states| states[0].pose.translation.vector.x)
        .fold(0.0, f64::max);
    assert!((farthest - AWAY - 0.03).abs() < 1e-3, "{farthest}");
}

//! Simulated robots behind servos and sensors.

use tdcr_control::plant::{Measurement, Plant, SimulatedPlant, Truth, TruthError};
use tdcr_sim::robot::{Loads, Robot};
use tdcr_sim::simulation::Physics;

use super::{PERIOD, hanging};

fn plant(robot: &Robot, change: impl Fn(&mut Truth)) -> SimulatedPlant {
    let mut truth = Truth::ideal(robot);
    change(&mut truth);
    SimulatedPlant::new(&truth, PERIOD, &robot.mean_command(), 7).unwrap()
}

/// Commands that pull the first tendon by `pulls` (m) beyond the mean.
fn commanded(plant: &mut SimulatedPlant, robot: &Robot, pulls: &[f64]) -> Vec<Measurement> {
    let measure = |pull: &f64| {
        let mut command = robot.mean_command().as_slice().to_vec();
        command[0] -= pull;
        plant.command(&robot.command(&command).unwrap()).unwrap();
        plant.measure().unwrap()
    };
    pulls.iter().map(measure).collect()
}

#[test]
fn without_errors_it_is_where_the_robot_settles() {
    let robot = hanging();
    let mut plant = plant(&robot, |truth| truth.loads = Loads::payload(0.01).unwrap());
    let measured = commanded(&mut plant, &robot, &[0.004]).pop().unwrap();
    let mut command = robot.mean_command().as_slice().to_vec();
    command[0] -= 0.004;
    let command = robot.command(&command).unwrap();
    let settled = robot.settle(&command, &Loads::payload(0.01).unwrap());
    let tip = measured.origin_of(9).unwrap();
    assert!((tip - settled.positions[9]).norm() < 1e-8);
    assert_eq!(plant.true_tip(), Some(tip));
    let tensions = measured.tensions.unwrap();
    for (found, expected) in tensions.iter().zip(&settled.tendon_tensions) {
        assert!((found - expected).abs() < 1e-6, "{found} {expected}");
    }
}

#[test]
fn a_delay_holds_commands_back_by_its_periods() {
    let robot = hanging();
    let pulls = [0.001, 0.002, 0.003, 0.003, 0.003];
    let tips = |delay: usize| -> Vec<_> {
        let mut plant = plant(&robot, |truth| truth.delay = delay);
        let all = commanded(&mut plant, &robot, &pulls);
        all.iter().map(|now| now.origin_of(9).unwrap()).collect()
    };
    let (prompt, late) = (tips(0), tips(2));
    for k in 0..3 {
        assert!((late[k + 2] - prompt[k]).norm() < 1e-9, "{k}");
    }
    assert!((late[0] - prompt[0]).norm() > 1e-4);
}

#[test]
fn a_tendon_rests_while_its_servo_crosses_the_backlash() {
    let robot = hanging();
    let mut plant = plant(&robot, |truth| {
        truth
            .servos
            .iter_mut()
            .for_each(|servo| servo.backlash = 5e-4);
    });
    let start = plant.measure().unwrap().origin_of(9).unwrap();
    let all = commanded(&mut plant, &robot, &[4e-4, 2e-3, 1.2e-3]);
    let tips: Vec<_> = all.iter().map(|now| now.origin_of(9).unwrap()).collect();
    assert!((tips[0] - start).norm() < 1e-9);
    assert!((tips[1] - start).norm() > 1e-4);
    assert!((tips[2] - tips[1]).norm() < 1e-9);
}

#[test]
fn a_spool_in_error_pulls_by_its_share() {
    let robot = hanging();
    let mut wrong = plant(&robot, |truth| truth.servos[0].gain = 1.1);
    let mut right = plant(&robot, |_| {});
    let straight = 0.085;
    let wrong = commanded(&mut wrong, &robot, &[0.0]).pop().unwrap();
    // It has pulled a tenth further, from the straight pose on.
    let pulled = 0.1 * (straight - 0.02);
    let right = commanded(&mut right, &robot, &[pulled]).pop().unwrap();
    let apart = (wrong.origin_of(9).unwrap() - right.origin_of(9).unwrap()).norm();
    assert!(apart < 5e-4, "{apart}");
}

#[test]
fn noise_is_that_of_its_seed_and_as_large_as_asked() {
    let robot = hanging();
    let noisy = |truth: &mut Truth| {
        truth.sensors.position = 1e-3;
        truth.sensors.tension = Some(0.5);
    };
    let (mut plant, mut again) = (plant(&robot, noisy), plant(&robot, noisy));
    assert_eq!(plant.measure().unwrap(), plant.measure().unwrap());
    let pulls = [0.0; 400];
    let all = commanded(&mut plant, &robot, &pulls);
    assert_eq!(all, commanded(&mut again, &robot, &pulls));
    let truth = plant.true_tip().unwrap();
    let squares: f64 = (all.iter())
        .map(|now| (now.origin_of(9).unwrap() - truth).norm_squared())
        .sum();
    let deviation = (squares / (3.0 * 400.0)).sqrt();
    assert!((deviation - 1e-3).abs() < 1e-4, "{deviation}");
}

#[test]
fn a_robot_in_motion_comes_to_rest_where_it_settles() {
    let robot = hanging();
    let moving = |truth: &mut Truth| {
        truth.physics = Physics::InMotion {
            timestep: 0.005,
            friction: None,
        }
    };
    let mut moving = plant(&robot, moving);
    let mut resting = plant(&robot, |_| {});
    let pulls = [0.004; 2000];
    let moved = commanded(&mut moving, &robot, &pulls);
    let rested = commanded(&mut resting, &robot, &pulls[..1]);
    let at = |now: &Measurement| now.origin_of(9).unwrap();
    let off = |now: &Measurement| (at(now) - at(&rested[0])).norm();
    assert!(off(&moved[0]) > 1e-3);
    assert!(
        off(&moved[1999]) < 0.3 * off(&moved[0]),
        "{} after {}",
        off(&moved[1999]),
        off(&moved[0])
    );
}

#[test]
fn a_robot_in_motion_with_friction_comes_to_rest_where_a_path_leads_it() {
    let robot = hanging();
    let tip_after = |physics: Physics, periods: usize| {
        let mut plant = plant(&robot, |truth| truth.physics = physics);
        // There and half the way back, slowly.
        let parts = (0..periods).map(|k| k as f64 / periods as f64);
        let pulls = parts.map(|part| 0.012 * f64::min(part, 0.75 - 0.5 * part) / 0.5);
        let rest = std::iter::repeat_n(0.006, 200);
        let pulls: Vec<f64> = pulls.chain(rest).collect();
        let seen = commanded(&mut plant, &robot, &pulls);
        seen.last().unwrap().origin_of(9).unwrap()
    };
    let in_motion = |friction: Option<f64>| Physics::InMotion {
        timestep: 0.005,
        friction,
    };
    let coefficient = 0.3;
    let led = tip_after(Physics::WithFriction { coefficient }, 2000);
    let moved = tip_after(in_motion(Some(coefficient)), 2000);
    let smooth = tip_after(in_motion(None), 2000);
    assert!((smooth - led).norm() > 1e-3, "{}", (smooth - led).norm());
    assert!(
        (moved - led).norm() < 0.1 * (smooth - led).norm(),
        "{} of {}",
        (moved - led).norm(),
        (smooth - led).norm()
    );
}

#[test]
fn truths_that_are_none_are_refused() {
    let robot = hanging();
    let refused = |change: &dyn Fn(&mut Truth)| -> TruthError {
        let mut truth = Truth::ideal(&robot);
        change(&mut truth);
        SimulatedPlant::new(&truth, PERIOD, &robot.mean_command(), 0).unwrap_err()
    };
    let few = refused(&|truth| truth.servos.truncate(2));
    assert_eq!(
        few.to_string(),
        "robot `2m` has 6 tendons, and 2 servos pull them"
    );
    let noise = refused(&|truth| truth.sensors.position = -1.0);
    assert!(noise.to_string().contains("noise of positions (m) is -1"));
    let marker = refused(&|truth| truth.sensors.markers[0].disc = 10);
    assert!(marker.to_string().contains("disc 10"));
    let gain = refused(&|truth| truth.servos[1].gain = f64::NAN);
    assert!(gain.to_string().contains("gain of a servo is NaN"));
}

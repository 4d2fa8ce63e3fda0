//! Random commands in random scenes.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::contact::{ContactError, ContactSettler};
use tdcr_sim::robot::{Loads, Robot, RobotSpec};

use super::scenes::scene;

/// Settles random commands in as many random scenes. Those that start inside an obstacle say so; of the others 99.5 % settle.
fn survey(name: &str, pairs: usize) {
    let robot = Robot::load(name).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(36);
    let (mut settled, mut touching, mut refused, mut steps) = (0, 0, 0, Vec::new());
    for pair in 0..pairs {
        let scene = scene(&mut rng, &robot);
        let command = robot.random_command(&mut rng);
        let mut settler = ContactSettler::new(&robot, &scene);
        let found = match settler.settle(&command, &Loads::default()) {
            Ok(found) => found,
            Err(ContactError::StartsInside { .. }) => {
                refused += 1;
                continue;
            }
            Err(error) => panic!("{name} {pair}: {error}"),
        };
        let at = &found.equilibrium;
        assert!(
            at.positions.iter().flatten().all(|x| x.is_finite()),
            "{name} {pair}"
        );
        steps.push(at.iterations);
        touching += usize::from(!found.contacts.is_empty());
        if at.converged {
            settled += 1;
            assert!(at.residual <= 1e-9, "{name} {pair}: {:e} N m", at.residual);
            assert!(
                found.complementarity <= 1e-12,
                "{name} {pair}: {:e} J",
                found.complementarity
            );
        } else {
            eprintln!(
                "{name} {pair}: {:e} N m left after {} steps",
                at.residual, at.iterations
            );
        }
    }
    steps.sort_unstable();
    let solved = steps.len();
    eprintln!(
        "{name}: {settled} of {solved} settled, {touching} in contact, {refused} started inside; {} Newton steps in the median, {} at the \
         99th percentile",
        steps[solved / 2],
        steps[solved * 99 / 100]
    );
    assert!(settled as f64 >= 0.995 * solved as f64);
    assert!(touching > pairs / 4 && refused < pairs / 20);
}

#[test]
fn two_modules_settle_among_obstacles() {
    survey("2m", 600);
}

#[test]
fn three_modules_settle_among_obstacles() {
    survey("3m", 600);
}

#[test]
fn five_modules_settle_among_obstacles() {
    survey("5m", 600);
}

/// `cargo test --release -p tdcr-sim --test statics contact::random -- --ignored --nocapture`: the figures of docs/contact.md.
#[test]
#[ignore = "more poses of the same"]
fn many_poses_settle_among_obstacles() {
    for name in RobotSpec::STANDARD {
        survey(name, 2000);
    }
}

#[test]
fn a_scene_without_obstacles_changes_nothing() {
    let robot = Robot::load("2m").unwrap();
    let mut settler = ContactSettler::new(&robot, &tdcr_sim::scene::Scene::default());
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for _ in 0..20 {
        let command = robot.random_command(&mut rng);
        let loads = Loads::payload(0.01).unwrap();
        let alone = robot.settle(&command, &loads);
        assert_eq!(settler.settle(&command, &loads).unwrap().equilibrium, alone);
    }
}

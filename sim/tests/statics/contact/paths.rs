//! Paths of commands among obstacles.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_sim::contact::{ContactEquilibrium, ContactSettler};
use tdcr_sim::robot::{Command, Loads, Robot};
use tdcr_sim::scene::{Obstacle, Scene};
use tdcr_sim::statics::Stability;

use super::scenes::scene;

const FRICTION: f64 = 0.3;

/// Steps of commands by up to a twentieth of their range, in which beads begin and cease to touch: all settle, where they settle from
/// the straight pose or on another branch, and most do in few steps of Newton's method.
#[test]
fn coarse_paths_settle_in_few_steps() {
    for name in ["2m", "3m", "5m"] {
        let robot = Robot::load(name).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(36);
        let (mut steps, mut same) = (Vec::new(), 0);
        while steps.len() < 300 {
            let scene = scene(&mut rng, &robot);
            let (mut follower, mut settler) = (
                ContactSettler::new(&robot, &scene),
                ContactSettler::new(&robot, &scene),
            );
            let start = robot.mean_command();
            if follower.settle(&start, &Loads::default()).is_err() {
                continue;
            }
            let mut command = start.as_slice().to_vec();
            for _ in 0..40 {
                let command = wander(&robot, &mut command, 2e-3, &mut rng);
                let found = follower.follow(&command, &Loads::default()).unwrap();
                check(found, name);
                if found.contacts.is_empty() {
                    continue;
                }
                steps.push(found.equilibrium.iterations);
                let other = settler.settle(&command, &Loads::default()).unwrap();
                let [own, beside] = [found, other].map(|found| found.equilibrium.positions.last());
                let apart = (own.unwrap() - beside.unwrap()).norm();
                assert!(!(1e-9..1e-5).contains(&apart), "{name}: {apart} m");
                same += usize::from(apart < 1e-9);
            }
        }
        steps.sort_unstable();
        let median = steps[steps.len() / 2];
        eprintln!(
            "{name}: {median} steps in the median, {same} of {}",
            steps.len()
        );
        assert!(median <= 12, "{name}: {median}");
        assert!(same > steps.len() / 2, "{name}: {same}");
    }
}

/// With friction, in smaller steps: forces are within their cones. Some commands do not settle, as bounds of friction are those of the solve
/// before.
#[test]
fn paths_with_friction_settle_within_their_cones() {
    let robot = Robot::load("3m").unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let (mut steps, mut unsettled) = (Vec::new(), 0);
    while steps.len() < 200 {
        let scene = rough(&scene(&mut rng, &robot));
        let mut follower = ContactSettler::new(&robot, &scene);
        let start = robot.mean_command();
        if follower.settle(&start, &Loads::default()).is_err() {
            continue;
        }
        let mut command = start.as_slice().to_vec();
        for _ in 0..40 {
            let command = wander(&robot, &mut command, 5e-4, &mut rng);
            let found = follower.follow(&command, &Loads::default()).unwrap();
            if !found.equilibrium.converged {
                unsettled += 1;
                break;
            }
            if found.contacts.is_empty() {
                continue;
            }
            steps.push(found.equilibrium.iterations);
            for contact in &found.contacts {
                let along = contact.force.dot(&contact.normal);
                let across = (contact.force - contact.normal * along).norm();
                assert!(across <= FRICTION * along + 1e-6, "{across} {along}");
            }
        }
    }
    steps.sort_unstable();
    let median = steps[steps.len() / 2];
    eprintln!("{median} steps in the median, {unsettled} not settled");
    assert!(unsettled * 25 <= steps.len(), "{unsettled}");
}

/// The next command: each tendon's moved by so much (m) at most.
fn wander(robot: &Robot, values: &mut [f64], most: f64, rng: &mut ChaCha8Rng) -> Command {
    for value in &mut *values {
        *value = (*value + rng.random_range(-most..most)).clamp(1e-3, 0.039);
    }
    robot.command(values).unwrap()
}

/// A scene in which all surfaces resist sliding.
fn rough(scene: &Scene) -> Scene {
    let rough = |obstacle: &Obstacle| obstacle.clone().with_friction(FRICTION).unwrap();
    Scene::new(scene.obstacles().iter().map(rough).collect()).unwrap()
}

fn check(found: &ContactEquilibrium, name: &str) {
    let at = &found.equilibrium;
    assert!(at.converged, "{name}: {:e} N m", at.residual);
    assert_ne!(at.stability, Some(Stability::Unstable));
    assert!(
        at.residual <= 1e-9 && found.complementarity <= 1e-12,
        "{name}"
    );
}

//! Robots that touch obstacles: MuJoCo finds them at rest under the forces that we report.

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::contact::{ContactEquilibrium, ContactSettler};
use tdcr_sim::robot::{Command, Loads, Robot};
use tdcr_sim::scene::Scene;

use crate::probe::{self, Probe};
use crate::scenes::scene;

/// What MuJoCo finds to be left of the forces at an equilibrium, where those of the contacts are applied (N m).
fn force_left(
    model: &tdcr_mujoco::Model,
    robot: &Robot,
    command: &Command,
    found: &ContactEquilibrium,
) -> f64 {
    let positions = &found.equilibrium.positions;
    let mut wrenches = vec![(Vector3::zeros(), Vector3::zeros()); positions.len()];
    let mut press = |disc: usize, point: &Vector3<f64>, force: Vector3<f64>| {
        wrenches[disc].0 += force;
        wrenches[disc].1 += (point - positions[disc]).cross(&force);
    };
    for contact in &found.contacts {
        press(contact.disc, &contact.point, contact.force);
        if let Some(other) = contact.partner.disc() {
            press(other, &contact.point, -contact.force);
        }
    }
    let mut probe = Probe::new(model, robot, command, &Loads::default());
    for (disc, (force, moment)) in wrenches.into_iter().enumerate() {
        probe.push(disc, force, moment);
    }
    probe.force_at(&found.equilibrium.configuration)
}

#[test]
fn mujoco_finds_no_force_where_our_contacts_press() {
    let mut rng = ChaCha8Rng::seed_from_u64(36);
    for robot in crate::standard_robots() {
        let model = probe::model(&robot);
        let (mut pressed, mut largest) = (0, 0.0_f64);
        while pressed < 40 {
            let scene = scene(&mut rng, &robot);
            let command = robot.random_command(&mut rng);
            let mut settler = ContactSettler::new(&robot, &scene);
            let Ok(found) = settler.settle(&command, &Loads::default()) else {
                continue;
            };
            if found.contacts.is_empty() || !found.equilibrium.converged {
                continue;
            }
            pressed += 1;
            largest = largest.max(force_left(&model, &robot, &command, found));
        }
        eprintln!("{}: {largest:e} N m", robot.spec().name);
        assert!(largest <= 2e-9, "{}: {largest:e} N m", robot.spec().name);
    }
}

#[test]
fn mujoco_finds_no_force_where_a_robot_presses_itself() {
    let robot = Robot::load("5m").unwrap();
    let model = probe::model(&robot);
    let mut settler = ContactSettler::new(&robot, &Scene::new(Vec::new()).unwrap());
    let mut largest = 0.0_f64;
    for step in 0..10 {
        // All modules pull to one side, so that the tip curls onto the discs below.
        let most = 0.03 + 0.001 * f64::from(step);
        let pulls = [most, 0.001 * f64::from(step), 0.0].repeat(5);
        let command = robot.command(&pulls).unwrap();
        let found = settler.settle(&command, &Loads::default()).unwrap();
        assert!(
            found.equilibrium.converged && !found.contacts.is_empty(),
            "{step}"
        );
        largest = largest.max(force_left(&model, &robot, &command, found));
    }
    eprintln!("pressing itself: {largest:e} N m");
    assert!(largest <= 2e-9, "{largest:e} N m");
}

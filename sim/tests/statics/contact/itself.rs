//! Robots that touch themselves.

use nalgebra::{DVector, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_sim::contact::{Activity, ContactEquilibrium, ContactSettler, Partner};
use tdcr_sim::geometry::Beads;
use tdcr_sim::robot::{Command, Loads, Robot};
use tdcr_sim::scene::{Obstacle, Scene, SelfContact};

/// How many commands are settled.
const COMMANDS: usize = 200;

/// A command that pulls all modules to one side, so that the robot's tip curls onto its lower discs.
fn curling(rng: &mut ChaCha8Rng, robot: &Robot) -> Command {
    let side = rng.random_range(0..3);
    let values: Vec<f64> = (0..robot.tendons().len())
        .map(|tendon| match tendon % 3 == side {
            true => 0.04 * rng.random_range(0.8..1.0),
            false => 0.008 * rng.random_range(0.0..1.0),
        })
        .collect();
    robot.command(&values).unwrap()
}

/// The least distance of beads of discs that are not neighbours (m).
fn clearance(robot: &Robot, found: &ContactEquilibrium) -> f64 {
    let (beads, at) = (Beads::new(robot), &found.equilibrium);
    let centres: Vec<(usize, Vector3<f64>, f64)> = (beads.as_slice().iter())
        .map(|bead| {
            let turned = at.orientations[bead.disc] * bead.centre;
            (bead.disc, at.positions[bead.disc] + turned, bead.radius)
        })
        .collect();
    let mut least = f64::INFINITY;
    for (disc, centre, radius) in &centres {
        for (other, place, other_radius) in &centres {
            if other > &(disc + 1) {
                least = least.min((centre - place).norm() - radius - other_radius);
            }
        }
    }
    least
}

#[test]
fn a_robot_that_curls_up_touches_itself_and_rests() {
    let robot = Robot::load("5m").unwrap();
    let scene = Scene::new(Vec::new()).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut settler = ContactSettler::new(&robot, &scene);
    let (mut settled, mut touching, mut steps) = (0, 0, 0);
    for _ in 0..COMMANDS {
        let command = curling(&mut rng, &robot);
        let found = settler.settle(&command, &Loads::default()).unwrap();
        if !found.equilibrium.converged {
            continue;
        }
        settled += 1;
        steps += found.equilibrium.iterations;
        touching += usize::from(!found.contacts.is_empty());
        let force = (found.contacts.iter()).map(|contact| contact.force.norm());
        let most = force.fold(0.0, f64::max);
        assert!(found.complementarity <= 1e-12 && found.equilibrium.residual <= 1e-9);
        assert!(clearance(&robot, found) >= -1.01e-6 * most - 1e-9);
        for contact in &found.contacts {
            assert!(
                contact
                    .partner
                    .disc()
                    .is_some_and(|disc| disc > contact.disc + 1)
            );
        }
    }
    eprintln!(
        "{settled} settled, {touching} touch themselves, {} steps each",
        steps / settled
    );
    assert!(settled as f64 >= 0.995 * COMMANDS as f64 && touching > COMMANDS / 2);
}

#[test]
fn ignored_it_passes_through_itself_as_without_a_scene() {
    let robot = Robot::load("5m").unwrap();
    let scene = Scene::default();
    assert_eq!(scene.self_contact(), SelfContact::Ignored);
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let command = curling(&mut rng, &robot);
    let mut settler = ContactSettler::new(&robot, &scene);
    let found = settler.settle(&command, &Loads::default()).unwrap();
    assert!(clearance(&robot, found) < -1e-3);
    let free = robot.settle(&command, &Loads::default());
    assert_eq!(found.equilibrium.positions, free.positions);
}

#[test]
fn far_obstacles_change_nothing_of_how_it_touches_itself() {
    let robot = Robot::load("5m").unwrap();
    let far = Obstacle::sphere("moon", 1.0).unwrap().at([0.0, 0.0, 50.0]);
    let scene = Scene::new(vec![far]).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut alone = ContactSettler::new(&robot, &Scene::new(Vec::new()).unwrap());
    let mut among = ContactSettler::new(&robot, &scene);
    for _ in 0..20 {
        let command = curling(&mut rng, &robot);
        let [one, other] = [&mut alone, &mut among].map(|settler| {
            let found = settler.settle(&command, &Loads::default()).unwrap();
            (found.equilibrium.positions.clone(), found.contacts.len())
        });
        assert_eq!(one.1, other.1);
        for (one, other) in one.0.iter().zip(&other.0) {
            assert!((one - other).norm() < 1e-9, "{:e}", (one - other).norm());
        }
    }
}

/// All positions, where the same contacts bear force.
fn positions(
    settler: &mut ContactSettler,
    start: &ContactEquilibrium,
    command: &[f64],
    loads: &Loads,
) -> Option<DVector<f64>> {
    let command = settler.robot().command(command).ok()?;
    let configuration = &start.equilibrium.configuration;
    let found = settler.settle_from(configuration, &command, loads).ok()?;
    let pairs = |found: &ContactEquilibrium| -> Vec<(usize, Partner)> {
        let each = found.contacts.iter();
        each.map(|contact| (contact.disc, contact.partner))
            .collect()
    };
    (found.equilibrium.converged && pairs(found) == pairs(start)).then(|| {
        let coordinates = found.equilibrium.positions.iter().flatten().copied();
        DVector::from_iterator(3 * found.equilibrium.positions.len(), coordinates)
    })
}

#[test]
fn derivatives_of_a_robot_that_touches_itself_are_those_of_differences() {
    let robot = Robot::load("5m").unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut settler = ContactSettler::new(&robot, &Scene::new(Vec::new()).unwrap());
    let (mut checked, mut largest) = (0, 0.0_f64);
    while checked < 30 {
        let command = curling(&mut rng, &robot);
        let loads = Loads::default();
        let found = settler.settle(&command, &loads).unwrap().clone();
        let strict = (found.contacts.iter()).all(|contact| contact.activity == Activity::Strict);
        if !found.equilibrium.converged || found.contacts.is_empty() || !strict {
            continue;
        }
        let jacobian = settler
            .sensitivity(&command, &loads)
            .unwrap()
            .parameters()
            .command_jacobian();
        let tendon = rng.random_range(0..robot.tendons().len());
        let mut at = |step: f64| {
            let mut values = command.as_slice().to_vec();
            values[tendon] += step;
            positions(&mut settler, &found, &values, &loads)
        };
        let mut difference = |step: f64| Some((at(step)? - at(-step)?) / (2.0 * step));
        let (Some(coarse), Some(fine)) = (difference(2e-5), difference(1e-5)) else {
            continue;
        };
        let limit = (&fine * 4.0 - &coarse) / 3.0;
        let ours = DVector::from_fn(limit.len(), |i, _| jacobian[(6 * (i / 3) + i % 3, tendon)]);
        largest = largest.max((limit - &ours).amax() / (1.0 + ours.amax()));
        checked += 1;
    }
    eprintln!("largest difference {largest:e}");
    assert!(largest < 1e-6);
}

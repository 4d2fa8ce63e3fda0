//! Friction of tendons and of contacts together.

use std::f64::consts::TAU;

use nalgebra::{UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_sim::contact::{Contact, ContactError, ContactSettler, Sliding};
use tdcr_sim::robot::{Command, Frame, Loads, Robot, RobotSpec, Wrench};
use tdcr_sim::scene::{Obstacle, Scene};
use tdcr_sim::tendon_friction::{ContactPath, FrictionPath};

use super::{assert_capstan, potential, pull_first, rough_robot, tip};

const FRICTION: f64 = 0.1;

/// A post beside a 2m robot that bends towards +x.
fn post(away: f64, friction: f64) -> Scene {
    let post = Obstacle::cylinder("post", 0.01, 0.4).unwrap();
    let post = post.at([away, 0.006, 0.27]).with_friction(friction);
    Scene::new(vec![post.unwrap()]).unwrap()
}

/// A wall across the robot's way.
fn wall(friction: f64) -> Scene {
    let turn = UnitQuaternion::rotation_between(&Vector3::z(), &-Vector3::x()).unwrap();
    let wall = Obstacle::half_space("wall").at([0.04, 0.0, 0.0]);
    let wall = wall.with_orientation([turn.w, turn.i, turn.j, turn.k]);
    Scene::new(vec![wall.unwrap().with_friction(friction).unwrap()]).unwrap()
}

/// Bends towards +x and back, in so many steps each.
fn bends(robot: &Robot, steps: u32) -> Vec<Command> {
    let there = (0..=steps).map(|step| f64::from(step) / f64::from(steps));
    let parts: Vec<f64> = there.clone().chain(there.rev()).collect();
    (parts.iter())
        .map(|part| pull_first(robot, 0.03 - 0.025 * part))
        .collect()
}

/// Forces of a contact along its normal and across it (N).
fn parts(contact: &Contact) -> [f64; 2] {
    let along = contact.force.dot(&contact.normal);
    [along, (contact.force - contact.normal * along).norm()]
}

#[test]
fn where_nothing_is_touched_a_path_is_that_without_a_scene() {
    let robot = rough_robot(FRICTION);
    let mut free = FrictionPath::new(&robot);
    let mut among = ContactPath::new(&robot, &post(-0.05, 0.3));
    for command in bends(&robot, 3) {
        let expected = free.advance(&command, &Loads::default());
        let found = among.advance(&command, &Loads::default()).unwrap();
        assert!(found.equilibrium.converged);
        assert!((tip(found) - tip(expected)).norm() < 1e-10);
        assert!((found.dissipated - expected.dissipated).abs() < 1e-10);
        assert!(among.contacts().is_empty());
    }
}

#[test]
fn in_an_empty_scene_it_is_that_path_and_takes_all_loads() {
    let robot = rough_robot(FRICTION);
    let mut free = FrictionPath::new(&robot);
    let mut among = ContactPath::new(&robot, &Scene::default());
    let turning = Wrench {
        force: [0.1, 0.0, 0.0],
        ..Wrench::none(4, Frame::Disc)
    };
    let loads = Loads::default().with_wrench(turning).unwrap();
    for command in bends(&robot, 2) {
        let expected = free.advance(&command, &loads);
        assert!(expected.equilibrium.converged);
        assert_eq!(among.advance(&command, &loads).unwrap(), expected);
    }
}

/// Paths of random commands among a post, a ball and a box. Robots without backbones slide off what they press on.
#[test]
fn random_paths_among_obstacles_converge() {
    for (name, friction, rubbing) in [("2m", 0.1, 0.3), ("2m", 0.03, 0.0), ("3m", 0.1, 0.3)] {
        let mut spec = RobotSpec::standard(name).unwrap();
        spec.tendon_specs_mut()
            .for_each(|tendon| tendon.set_friction(friction));
        let robot = Robot::new(spec).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let (mut commands, mut touched) = (0, 0);
        while commands < 70 {
            let mut path = ContactPath::new(&robot, &random_scene(rubbing, &mut rng));
            let mut command = robot.mean_command().as_slice().to_vec();
            let start = robot.command(&command).unwrap();
            if path.start(&start, &Loads::default()).is_err() {
                continue;
            }
            for _ in 0..10 {
                for value in &mut command {
                    *value = (*value + rng.random_range(-6e-3..6e-3)).clamp(1e-3, 0.039);
                }
                let next = robot.command(&command).unwrap();
                let state = path.advance(&next, &Loads::default()).unwrap();
                assert!(state.equilibrium.converged, "{name} {commands}");
                assert!(state.equilibrium.residual <= 1e-8);
                let profiles = &state.tendons;
                profiles
                    .iter()
                    .for_each(|profile| assert_capstan(profile, friction));
                for contact in path.contacts() {
                    let [along, across] = parts(contact);
                    assert!(along >= 0.0 && across <= rubbing * along + 1e-6);
                    touched += 1;
                }
                commands += 1;
            }
        }
        assert!(touched > 10, "{name} {touched}");
    }
}

/// A post, a ball and a box about the robot.
fn random_scene(friction: f64, rng: &mut ChaCha8Rng) -> Scene {
    let obstacles = [
        Obstacle::cylinder("post", 0.01, 0.4),
        Obstacle::sphere("ball", 0.02),
        Obstacle::cuboid("box", [0.03; 3]),
    ];
    let placed = obstacles.map(|obstacle| {
        let (angle, away): (f64, f64) = (rng.random_range(0.0..TAU), rng.random_range(0.05..0.13));
        let height = rng.random_range(0.12..0.32);
        let at = [away * angle.cos(), away * angle.sin(), height];
        obstacle.unwrap().at(at).with_friction(friction).unwrap()
    });
    Scene::new(placed.to_vec()).unwrap()
}

/// Without friction of the post, either; with it, in steps so small that where beads begin to stick matters little, but for where they
/// come and go: compared at every sixteenth.
#[test]
fn without_friction_of_tendons_a_path_is_that_of_contacts() {
    let robot = rough_robot(0.0);
    for (friction, steps, every, near) in [(0.0, 6, 1, 1e-8), (0.3, 96, 16, 2e-5)] {
        let scene = post(0.05, friction);
        let mut expected = ContactSettler::new(&robot, &scene);
        let mut found = ContactPath::new(&robot, &scene).with_resolution(1.0);
        let mut touched = 0;
        for (step, command) in bends(&robot, steps).iter().enumerate() {
            let expected = expected.follow(command, &Loads::default()).unwrap();
            let state = found.advance(command, &Loads::default()).unwrap();
            assert!(state.equilibrium.converged && expected.equilibrium.converged);
            if step % every != 0 {
                continue;
            }
            let apart = (tip(state) - expected.equilibrium.positions[9]).norm();
            assert!(apart < near, "{friction} {step}: {apart}");
            assert_eq!(found.contacts().len(), expected.contacts.len());
            for (own, other) in found.contacts().iter().zip(&expected.contacts) {
                assert!((own.force - other.force).norm() < 1e3 * near, "{friction}");
                touched += 1;
            }
        }
        assert!(touched > 5);
    }
}

#[test]
fn forces_of_both_are_within_their_cones_and_in_balance() {
    let robot = rough_robot(FRICTION);
    let mut path = ContactPath::new(&robot, &post(0.05, 0.3));
    let (mut slipped, mut stuck) = (0, 0);
    for command in bends(&robot, 4) {
        let state = path.advance(&command, &Loads::default()).unwrap();
        assert!(state.equilibrium.converged);
        assert!(state.equilibrium.residual <= 1e-9);
        state
            .tendons
            .iter()
            .for_each(|profile| assert_capstan(profile, FRICTION));
        for contact in path.contacts() {
            let [along, across] = parts(contact);
            assert!(across <= 0.3 * along + 1e-6, "{across} {along}");
            match contact.sliding {
                Sliding::Slips => {
                    assert!((across - 0.3 * along).abs() < 1e-6);
                    slipped += 1;
                }
                _ => stuck += 1,
            }
        }
    }
    assert!(slipped > 3 && stuck > 0, "{slipped} {stuck}");
}

/// What servos do is in the robot, or has become heat at the holes; a wall without friction takes nothing, one with friction some.
#[test]
fn a_wall_takes_energy_by_friction_alone() {
    let robot = rough_robot(FRICTION);
    let taken = |friction: f64| {
        let mut path = ContactPath::new(&robot, &wall(friction)).with_resolution(5e-3);
        let mut before = 0.0;
        let mut touches = 0;
        for (step, command) in bends(&robot, 3).iter().enumerate() {
            let state = path.advance(command, &Loads::default()).unwrap();
            assert!(state.equilibrium.converged);
            let energy = potential(&robot, state) + state.stored + state.dissipated;
            if step == 0 {
                before = energy - state.servo_work;
            }
            touches += path.contacts().len();
        }
        assert!(touches > 4);
        let state = path.state();
        let energy = potential(&robot, state) + state.stored;
        (before + state.servo_work - energy - state.dissipated) / state.dissipated
    };
    let [without, with] = [0.0, 0.3].map(taken);
    eprintln!("{without} {with}");
    assert!(without.abs() < 2e-3 && with > 0.01, "{without} {with}");
}

#[test]
fn loads_without_a_potential_are_refused() {
    let robot = rough_robot(FRICTION);
    let wrench = Wrench {
        force: [1.0, 0.0, 0.0],
        ..Wrench::none(4, Frame::Disc)
    };
    let loads = Loads::default().with_wrench(wrench).unwrap();
    let mut path = ContactPath::new(&robot, &wall(0.0));
    let refused = path.advance(&pull_first(&robot, 0.02), &loads);
    assert_eq!(refused.unwrap_err(), ContactError::Loads { disc: 4 });
}

//! Paths of commands among obstacles.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_sim::contact::{BranchPath, Contact, ContactEquilibrium, ContactSettler, Sliding};
use tdcr_sim::geometry::{Bead, Beads};
use tdcr_sim::reactions::joint_reactions;
use tdcr_sim::robot::{Command, Frame, Loads, Robot, Wrench};
use tdcr_sim::scene::{Obstacle, Scene};
use tdcr_sim::statics::Stability;
use tdcr_sim::tendon_friction::ContactPath;

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
        while steps.len() < 150 {
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
                // Moments of 1e-9 N m, which both may leave, bend 5m by nanometres.
                assert!(!(1e-8..1e-5).contains(&apart), "{name}: {apart} m");
                same += usize::from(apart < 1e-8);
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

/// With friction, in smaller steps: forces are in balance, within their cones, and on their bounds where contacts slip; most commands settle
/// in few steps. A few do not settle, where the robot slides off what it pressed on.
#[test]
fn paths_with_friction_settle_within_their_cones() {
    for name in ["2m", "3m", "5m"] {
        let robot = Robot::load(name).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let (mut steps, mut stuck, mut slipped, mut unsettled) = (Vec::new(), 0, 0, 0);
        while steps.len() < 100 {
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
                check(found, name);
                if found.contacts.is_empty() {
                    continue;
                }
                steps.push(found.equilibrium.iterations);
                for (contact, [along, across]) in of_beads(follower.beads(), follower.found()) {
                    let most = FRICTION * along;
                    assert!(across <= most + 1e-9, "{across} {along}");
                    match contact.sliding {
                        Sliding::Slips => {
                            assert!((across - most).abs() < 1e-9, "{across} {along}");
                            slipped += 1;
                        }
                        _ => stuck += 1,
                    }
                }
                let found = follower.found();
                assert_balanced(&robot, follower.beads(), found);
            }
        }
        steps.sort_unstable();
        let median = steps[steps.len() / 2];
        eprintln!(
            "{name}: {median} steps in the median, {unsettled} not settled, {stuck} stick, {slipped} slip"
        );
        assert!(
            median <= 40 && unsettled * 20 <= steps.len(),
            "{name}: {median} {unsettled}"
        );
        assert!(stuck > 10 && slipped > 25, "{name}: {stuck} {slipped}");
    }
}

/// Without friction a path down the energy and one of balanced moments with an active set are one path, as long as neither snaps.
#[test]
fn paths_on_a_branch_are_those_of_balanced_moments() {
    for name in ["2m", "3m"] {
        let robot = Robot::load(name).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(13);
        let (mut compared, mut touching, mut apart) = (0, 0, 0.0_f64);
        while compared < 60 {
            let scene = scene(&mut rng, &robot);
            let mut path = BranchPath::new(&robot, &scene);
            let mut balanced = ContactPath::new(&robot, &scene);
            let start = robot.random_command(&mut rng);
            if path.advance(&start, &Loads::default()).is_err() {
                continue;
            }
            balanced.start(&start, &Loads::default()).unwrap();
            let mut command = start.as_slice().to_vec();
            for _ in 0..10 {
                let command = wander(&robot, &mut command, 5e-4, &mut rng);
                let found = path.advance(&command, &Loads::default()).unwrap().clone();
                let state = balanced.advance(&command, &Loads::default()).unwrap();
                check(&found, name);
                if path.snaps() > 0 || state.snaps > 0 {
                    break;
                }
                assert!(state.equilibrium.converged, "{name}");
                let pairs = found.equilibrium.positions.iter();
                for (a, b) in pairs.zip(&state.equilibrium.positions) {
                    apart = apart.max((a - b).norm());
                }
                compared += 1;
                touching += usize::from(!found.contacts.is_empty());
            }
        }
        eprintln!("{name}: {apart:e} m apart in {compared} commands, {touching} in contact");
        assert!(apart < 1e-7 && touching > 15, "{name}: {apart} {touching}");
    }
}

/// What sticks is a spring along the surface from one command to the next, also where a command is reached in parts, or a part fails.
#[test]
fn what_sticks_is_a_spring_along_the_surface() {
    let robot = Robot::load("3m").unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let (mut compared, mut broken) = (0, 0);
    for _ in 0..30 {
        let scene = rough(&scene(&mut rng, &robot));
        let mut follower = ContactSettler::new(&robot, &scene);
        let start = robot.mean_command();
        if follower.settle(&start, &Loads::default()).is_err() {
            continue;
        }
        let mut command = start.as_slice().to_vec();
        let mut before: Vec<(Bead, Contact, Vector3<f64>)> = Vec::new();
        for _ in 0..20 {
            let command = wander(&robot, &mut command, 5e-4, &mut rng);
            follower.follow(&command, &Loads::default()).unwrap();
            let now = on_beads(follower.beads(), follower.found());
            for (bead, contact, at) in &now {
                let same = |(of, other, _): &&(Bead, Contact, _)| {
                    of == bead && other.partner == contact.partner
                };
                let Some((_, from, there)) = before.iter().find(same) else {
                    continue;
                };
                if contact.sliding != Sliding::Sticks
                    || (contact.normal - from.normal).norm() > 1e-3
                {
                    continue;
                }
                let obstacle = contact.partner.obstacle().unwrap();
                let stiffness = 1.0 / scene.obstacles()[obstacle].compliance;
                let along =
                    |force: Vector3<f64>| force - contact.normal * contact.normal.dot(&force);
                let expected = along(from.force) - along(at - there) * stiffness;
                compared += 1;
                broken += usize::from(
                    (along(contact.force) - expected).norm() > 1e-3 * contact.force.norm(),
                );
            }
            before = now;
        }
    }
    eprintln!("{compared} stick, {broken} have let go in between");
    assert!(compared > 5 && broken == 0, "{compared} {broken}");
}

/// The contacts with obstacles, each with its bead and where that is centred (m).
fn on_beads(beads: &Beads, found: &ContactEquilibrium) -> Vec<(Bead, Contact, Vector3<f64>)> {
    let at = &found.equilibrium;
    let of = |contact: &Contact| {
        let own = &beads.as_slice()[beads.of_disc(contact.disc)];
        own.iter().find_map(|bead| {
            let centre = at.positions[contact.disc] + at.orientations[contact.disc] * bead.centre;
            let touching = contact.point + contact.normal * (contact.gap + bead.radius);
            ((centre - touching).norm() < 1e-9).then_some((*bead, *contact, centre))
        })
    };
    let obstacles = found.contacts.iter();
    let obstacles = obstacles.filter(|contact| contact.partner.obstacle().is_some());
    obstacles.filter_map(of).collect()
}

/// No moment is left at the joints, which have no springs, by Newton's and Euler's laws with the forces of the contacts as loads.
fn assert_balanced(robot: &Robot, beads: &Beads, found: &ContactEquilibrium) {
    let left = imbalance(robot, beads, found);
    assert!(left < 3e-9, "{left} N m");
}

/// The largest moment (N m) that is left.
fn imbalance(robot: &Robot, beads: &Beads, found: &ContactEquilibrium) -> f64 {
    let touching = on_beads(beads, found);
    assert_eq!(touching.len(), found.contacts.len());
    let pressed = touching
        .iter()
        .fold(Loads::default(), |loads, (bead, contact, _)| {
            let wrench = Wrench {
                point: bead.centre.into(),
                force: contact.force.into(),
                ..Wrench::none(contact.disc, Frame::World)
            };
            loads.with_wrench(wrench).unwrap()
        });
    let reactions = joint_reactions(robot, &found.equilibrium.pose(), &pressed).unwrap();
    let moments = reactions.iter().map(|reaction| reaction.moment.norm());
    moments.fold(0.0, f64::max)
}

/// Of each bead that touches an obstacle the contact that slips, or else any, and its forces (N) along their normal and across it: a bead
/// between several faces rubs with what they bear together.
fn of_beads(beads: &Beads, found: &ContactEquilibrium) -> Vec<(Contact, [f64; 2])> {
    let touching = on_beads(beads, found);
    let parts = |index: usize| {
        let (bead, contact, _) = &touching[index];
        let same =
            |(of, other, _): &&(Bead, Contact, _)| of == bead && other.partner == contact.partner;
        if touching[..index].iter().any(|other| same(&other)) {
            return None;
        }
        let own: Vec<&Contact> = (touching.iter().filter(same))
            .map(|(_, own, _)| own)
            .collect();
        let pressed: Vector3<f64> = own.iter().map(|own| own.normal * -own.gap.min(0.0)).sum();
        let normal = pressed.try_normalize(0.0).unwrap_or(contact.normal);
        let force: Vector3<f64> = own.iter().map(|own| own.force).sum();
        let along = force.dot(&normal);
        let slips = own.iter().find(|own| own.sliding == Sliding::Slips);
        let across = (force - normal * along).norm();
        Some((**slips.unwrap_or(&own[0]), [along, across]))
    };
    (0..touching.len()).filter_map(parts).collect()
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

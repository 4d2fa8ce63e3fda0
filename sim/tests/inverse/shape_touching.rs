//! Commands that keep the robot clear of obstacles, or press it on them.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_sim::contact::ContactSettler;
use tdcr_sim::geometry::Beads;
use tdcr_sim::inverse::shape::{
    ContactGoals, Outcome, Press, Search, ShapeControlError, ShapeController, ShapeSolution, Target,
};
use tdcr_sim::robot::{Loads, Robot};
use tdcr_sim::scene::{Obstacle, Scene};
use tdcr_sim::statics::Equilibrium;

/// A ball (centre and radius, m) or a half space (a point, and its outward normal).
#[derive(Clone, Copy)]
enum Body {
    Ball(Vector3<f64>, f64),
    Plane(Vector3<f64>, Vector3<f64>),
}

impl Body {
    fn obstacle(&self, name: &str) -> Obstacle {
        match *self {
            Self::Ball(centre, radius) => Obstacle::sphere(name, radius).unwrap().at(centre.into()),
            Self::Plane(point, normal) => {
                let turn = nalgebra::UnitQuaternion::rotation_between(&Vector3::z(), &normal);
                let pose = nalgebra::Isometry3::from_parts(point.into(), turn.unwrap());
                Obstacle::half_space(name).with_pose(pose)
            }
        }
    }

    /// Distance of a point (m), by the formula.
    fn distance(&self, from: &Vector3<f64>) -> f64 {
        match self {
            Self::Ball(centre, radius) => (from - centre).norm() - radius,
            Self::Plane(point, normal) => normal.dot(&(from - point)),
        }
    }

    /// Distance of the nearest bead of a robot (m).
    fn gap(&self, robot: &Robot, at: &Equilibrium) -> f64 {
        let beads = Beads::new(robot);
        let gaps = beads.as_slice().iter().map(|bead| {
            let centre = at.positions[bead.disc] + at.orientations[bead.disc] * bead.centre;
            self.distance(&centre) - bead.radius
        });
        gaps.fold(f64::INFINITY, f64::min)
    }
}

fn scene(bodies: &[Body]) -> Scene {
    let named = bodies.iter().enumerate();
    let obstacles = named.map(|(number, body)| body.obstacle(&format!("body {number}")));
    Scene::new(obstacles.collect()).unwrap()
}

fn clear(clearance: f64) -> ContactGoals {
    ContactGoals {
        clearance: Some(clearance),
        ..ContactGoals::default()
    }
}

fn tip(at: &Equilibrium) -> Vector3<f64> {
    *at.positions.last().unwrap()
}

/// Balls in a robot's reach, and one plane beside it, that leave the straight robot 1 cm.
fn bodies(robot: &Robot, rng: &mut ChaCha8Rng) -> Vec<Body> {
    let mut straight = ContactSettler::new(robot, &Scene::default());
    let straight = (straight
        .settle(&robot.mean_command(), &Loads::default())
        .unwrap())
    .equilibrium
    .clone();
    let length = tip(&straight).z;
    let mut found = Vec::new();
    while found.len() < 7 {
        let body = match found.len() {
            0 => Body::Plane([0.08, 0.0, 0.0].into(), -Vector3::x()),
            _ => {
                let mut range = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
                let centre = [
                    range(-0.12, 0.12),
                    range(-0.12, 0.12),
                    range(0.3, 1.0) * length,
                ];
                Body::Ball(centre.into(), range(0.01, 0.03))
            }
        };
        if body.gap(robot, &straight) > 0.01 {
            found.push(body);
        }
    }
    found
}

#[test]
fn the_robot_keeps_the_clearance_by_the_formulas_of_balls_and_planes() {
    let loads = Loads::default();
    for name in ["2m", "3m"] {
        let robot = Robot::load(name).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        let (mut reached, mut kept_off) = (0, 0);
        for k in 0..20 {
            let bodies = bodies(&robot, &mut rng);
            let scene = scene(&bodies);
            let controller =
                ShapeController::among(&robot, &scene, &loads, Search::default()).unwrap();
            let mut settler = ContactSettler::new(&robot, &scene);
            // Tips that the robot has where it may touch, or would have if it passed through obstacles.
            let wanted = robot.random_command(&mut rng);
            let wanted = match k < 10 {
                true => tip(&settler.settle(&wanted, &loads).unwrap().equilibrium),
                false => tip(&robot.settle(&wanted, &loads)),
            };
            let clearance = [0.0, 0.003][k % 2];
            let goals = clear(clearance);
            let found = controller
                .reach_with(&[Target::tip(&robot, wanted)], &goals)
                .unwrap();
            let again = settler.settle(&found.command, &loads).unwrap();
            assert_eq!(again.equilibrium, found.equilibrium, "{name} {k}");
            let gaps = bodies
                .iter()
                .map(|body| body.gap(&robot, &found.equilibrium));
            let gap = gaps.fold(f64::INFINITY, f64::min);
            assert!((gap - found.nearest.unwrap().gap).abs() < 1e-12);
            match found.outcome {
                Outcome::Reached => {
                    assert!((tip(&found.equilibrium) - wanted).norm() <= 1e-6);
                    reached += 1;
                }
                Outcome::Unreachable { ref obstacles, .. } => {
                    kept_off += usize::from(!obstacles.is_empty());
                }
                ref other => {
                    eprintln!("{name} {k}: {other:?}");
                    continue;
                }
            }
            assert!(
                gap >= clearance && again.contacts.is_empty(),
                "{name} {k}: {gap}"
            );
        }
        eprintln!("{name}: {reached} reached, {kept_off} kept off, of 20");
        assert!(reached + kept_off >= 19, "{name}: {reached} {kept_off}");
    }
}

/// A robot of three tendons.
fn small() -> Robot {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/cli/one-module.toml");
    Robot::load(file).unwrap()
}

/// How near the tip comes to a point while all beads are apart from a body, under the commands of a grid, as shares of the ranges: 41
/// for each tendon, over a width about a middle.
fn nearest_of_grid(
    (robot, body, clearance): (&Robot, Body, f64),
    wanted: Vector3<f64>,
    (middle, width): ([f64; 3], f64),
) -> f64 {
    const POINTS: usize = 41;
    let mut settler = tdcr_sim::statics::Settler::new(robot);
    let mut least = f64::INFINITY;
    for number in 0..POINTS.pow(3) {
        let places = [number, number / POINTS, number / (POINTS * POINTS)].map(|n| n % POINTS);
        let values: Vec<f64> = (0..3)
            .map(|axis| {
                let place = places[axis] as f64 / (POINTS - 1) as f64 - 0.5;
                let share = (middle[axis] + width * place).clamp(0.0, 1.0);
                let [low, high] = robot.tendons()[axis].range;
                low + (high - low) * share
            })
            .collect();
        let settled = settler.settle(&robot.command(&values).unwrap(), &Loads::default());
        let off = (tip(settled) - wanted).norm();
        if settled.converged && off < least && body.gap(robot, settled) >= clearance {
            least = off;
        }
    }
    least
}

#[test]
fn a_point_inside_an_obstacle_gives_the_nearest_clear_pose_and_its_price() {
    let (robot, loads) = (small(), Loads::default());
    let [low, high] = robot.tendons()[0].range;
    let inside = [0.9, 0.3, 0.2].map(|share| low + (high - low) * share);
    let wanted = tip(&robot.settle(&robot.command(&inside).unwrap(), &loads));
    let body = Body::Ball(wanted + Vector3::new(0.003, -0.002, 0.004), 0.02);
    let scene = scene(&[body]);
    let controller = ShapeController::among(&robot, &scene, &loads, Search::default()).unwrap();
    let find = |clearance: f64| -> ShapeSolution {
        controller
            .reach_with(&[Target::tip(&robot, wanted)], &clear(clearance))
            .unwrap()
    };
    let found = find(0.002);
    let Outcome::Unreachable { obstacles, .. } = &found.outcome else {
        panic!("{:?}", found.outcome);
    };
    assert!(!obstacles.is_empty() && obstacles.iter().all(|one| one.obstacle == 0));
    assert!(body.gap(&robot, &found.equilibrium) >= 0.002);
    // No command of the box is better, and none close by, but for the few micrometres that are kept beyond the clearance.
    let shares = found
        .command
        .as_slice()
        .iter()
        .map(|c| (c - low) / (high - low));
    let middle = shares.collect::<Vec<_>>().try_into().unwrap();
    for (middle, width) in [([0.5; 3], 1.0), (middle, 0.1), (middle, 0.01)] {
        let of_grid = nearest_of_grid((&robot, body, 0.002), wanted, (middle, width));
        assert!(found.errors[0] < of_grid + 3e-5, "{width}: {of_grid}");
        assert!(
            of_grid < found.errors[0] + 0.02 * width,
            "{width}: {of_grid}"
        );
    }
    // What a metre of clearance costs, by differences.
    let price: f64 = obstacles.iter().map(|one| one.price).sum();
    let step = 1e-4;
    let difference = (find(0.002 + step).errors[0] - find(0.002 - step).errors[0]) / (2.0 * step);
    assert!(
        (price - difference).abs() < 0.01 * difference,
        "{price} {difference}"
    );
}

#[test]
fn where_no_pose_keeps_the_clearance_the_nearest_obstacle_is_told() {
    let (robot, loads) = (Robot::load("2m").unwrap(), Loads::default());
    // Beside the lowest disc, which hardly moves.
    let first = robot.settle(&robot.mean_command(), &loads).positions[0];
    let body = Body::Ball(first + Vector3::new(0.06, 0.0, 0.0), 0.02);
    let scene = scene(&[body]);
    let controller = ShapeController::among(&robot, &scene, &loads, Search::default()).unwrap();
    let wanted = Target::tip(&robot, [0.06, 0.03, 0.31].into());
    assert_eq!(
        controller.reach(&[wanted]).unwrap().outcome,
        Outcome::Reached
    );
    let found = controller.reach_with(&[wanted], &clear(0.05)).unwrap();
    let Outcome::TooNear { nearest } = found.outcome else {
        panic!("{:?}", found.outcome);
    };
    let gap = body.gap(&robot, &found.equilibrium);
    assert!((nearest.gap - gap).abs() < 1e-12 && gap < 0.05);
    assert_eq!((nearest.obstacle, found.nearest), (0, Some(nearest)));
}

/// The total normal force on a body (N) of a compliance (m/N), by the formula `overlap / compliance`.
fn force_on(body: Body, robot: &Robot, at: &Equilibrium, compliance: f64) -> f64 {
    let beads = Beads::new(robot);
    let forces = beads.as_slice().iter().map(|bead| {
        let centre = at.positions[bead.disc] + at.orientations[bead.disc] * bead.centre;
        (bead.radius - body.distance(&centre)).max(0.0) / compliance
    });
    forces.sum()
}

fn push(press: Press) -> ContactGoals {
    ContactGoals {
        presses: vec![press],
        ..ContactGoals::default()
    }
}

#[test]
fn the_robot_presses_on_a_plane_with_the_force_of_the_formula() {
    let loads = Loads::default();
    let compliance = 1e-4;
    let plane = Body::Plane([0.05, 0.0, 0.0].into(), -Vector3::x());
    let obstacle = plane.obstacle("wall").with_compliance(compliance).unwrap();
    let scene = Scene::new(vec![obstacle]).unwrap();
    for name in ["2m", "3m"] {
        let robot = Robot::load(name).unwrap();
        let controller = ShapeController::among(&robot, &scene, &loads, Search::default()).unwrap();
        let mut settler = ContactSettler::new(&robot, &scene);
        for force in [0.01, 0.05, 0.2, 0.5] {
            let found = controller
                .reach_with(&[], &push(Press::new(0, force)))
                .unwrap();
            eprintln!(
                "{name} {force} {:?} {:?} {}",
                found.outcome, found.forces, found.steps
            );
            assert_eq!(found.outcome, Outcome::Reached, "{name} {force}");
            assert!((found.forces[0] - force).abs() <= 1e-5);
            let settled = settler.settle(&found.command, &loads).unwrap();
            let told: f64 = settled
                .contacts
                .iter()
                .map(|contact| contact.force.norm())
                .sum();
            let formula = force_on(plane, &robot, &settled.equilibrium, compliance);
            assert!((found.forces[0] / told - 1.0).abs() < 1e-6, "{told}");
            assert!((found.forces[0] / formula - 1.0).abs() < 1e-6, "{formula}");
        }
    }
}

#[test]
fn tips_and_forces_that_the_robot_has_together_are_found_together() {
    let (robot, loads) = (Robot::load("2m").unwrap(), Loads::default());
    let bodies = [
        Body::Plane([0.06, 0.0, 0.0].into(), -Vector3::x()),
        Body::Ball([-0.06, 0.02, 0.22].into(), 0.02),
    ];
    let scene = scene(&bodies);
    let controller = ShapeController::among(&robot, &scene, &loads, Search::default()).unwrap();
    let mut settler = ContactSettler::new(&robot, &scene);
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let (mut met, mut of) = (0, 0);
    while of < 20 {
        let settled = settler
            .settle(&robot.random_command(&mut rng), &loads)
            .unwrap();
        let on_wall = settled
            .contacts
            .iter()
            .filter(|one| one.partner.obstacle() == Some(0));
        let disc = on_wall.map(|one| one.disc).next_back();
        let (Some(disc), true) = (disc, bodies[1].gap(&robot, &settled.equilibrium) > 0.004) else {
            continue;
        };
        let own = [None, Some(disc)][of % 2];
        let force = settled.normal_force(0, own);
        if force < 1e-3 {
            continue;
        }
        let press = Press {
            disc: own,
            ..Press::new(0, force)
        };
        let goals = ContactGoals {
            clearance: Some(0.003),
            ..push(press)
        };
        let target = Target::tip(&robot, tip(&settled.equilibrium));
        let found = controller.reach_with(&[target], &goals).unwrap();
        eprintln!(
            "{of} {force} {:?} {:?} {}",
            found.outcome, found.forces, found.steps
        );
        of += 1;
        if found.outcome == Outcome::Reached {
            met += 1;
            let again = settler.settle(&found.command, &loads).unwrap();
            assert_eq!(again.normal_force(0, own), found.forces[0]);
            assert!((found.forces[0] - force).abs() <= 1e-5);
            assert!(bodies[1].gap(&robot, &again.equilibrium) >= 0.003);
        }
    }
    assert!(met >= 16, "{met}");
}

#[test]
fn contact_that_makes_no_sense_is_refused() {
    let (robot, loads) = (Robot::load("2m").unwrap(), Loads::default());
    let ball = |name: &str| Obstacle::sphere(name, 0.02).unwrap().at([0.1, 0.0, 0.2]);
    let movable = ball("toy").with_mass(0.1).unwrap();
    let scene = Scene::new(vec![ball("ball"), movable]).unwrap();
    let search = Search {
        samples: 3,
        ..Search::default()
    };
    let controller = ShapeController::among(&robot, &scene, &loads, search).unwrap();
    let refused = |goals: &ContactGoals| controller.reach_with(&[], goals).unwrap_err();
    let press = Press::new(0, 0.1);
    for (press, expected) in [
        (Press::new(2, 0.1), "the scene has no such obstacle"),
        (Press::new(1, 0.1), "the obstacle can move"),
        (
            Press::new(0, -0.1),
            "forces, levers and weights are finite numbers above 0",
        ),
        (Press::new(0, f64::NAN), "forces, levers and weights"),
        (
            Press {
                lever: 0.0,
                ..press
            },
            "forces, levers and weights",
        ),
        (
            Press {
                weight: f64::INFINITY,
                ..press
            },
            "forces, levers and weights",
        ),
        (
            Press {
                disc: Some(10),
                ..press
            },
            "the robot has no such disc",
        ),
    ] {
        let said = refused(&push(press)).to_string();
        assert!(said.contains(expected), "{said}");
    }
    let tip = [Target::tip(&robot, [0.0, 0.0, 0.3].into())];
    let refused = |clearance| controller.reach_with(&tip, &clear(clearance)).unwrap_err();
    assert_eq!(refused(-1e-3), ShapeControlError::Clearance(-1e-3));
    assert!(matches!(refused(f64::NAN), ShapeControlError::Clearance(_)));
    assert_eq!(
        controller
            .reach_with(&[], &ContactGoals::default())
            .unwrap_err(),
        ShapeControlError::NoTarget
    );
    let alone = ShapeController::new(&robot, &loads, search).unwrap();
    let refused = alone.reach_with(&tip, &clear(0.001)).unwrap_err();
    assert_eq!(refused, ShapeControlError::NoObstacle);
}

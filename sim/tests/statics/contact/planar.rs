//! A planar robot among circles, beside an independent solution of a published model.
//!
//! The model is that of Rao, Salzman and Burgner-Kahrs (RA-L 9(5), 2024): a robot of 30 arcs in the plane takes the least sum of squared
//! curvatures that keeps the length of one tendon, which may push, and its points out of five circles. `data/contact2d` has three paths of
//! it, one of them clear of all circles, solved by SciPy's SLSQP. Here the arcs are joints in their middles, and the circles are long cylinders.

use std::collections::BTreeSet;
use std::path::Path;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use tdcr_sim::contact::ContactSettler;
use tdcr_sim::geometry::{Bead, Beads};
use tdcr_sim::robot::{
    Backbone, Body, Drive, Holes, Loads, MassSpec, ModuleSpec, PerDisc, Pull, RigidMass, Robot,
    RobotSpec, RouteSpec, TendonSpec, Waypoint,
};
use tdcr_sim::scene::{Obstacle, Scene};

const DISCS: usize = 30;
/// Half width of the discs (m).
const HALF_WIDTH: f64 = 0.006;
/// Centres of the circles (m).
const CIRCLES: [[f64; 2]; 5] = [
    [0.02, 0.03],
    [-0.04, 0.03],
    [0.08, 0.03],
    [-0.01, 0.08],
    [0.05, 0.08],
];

/// The robot at a length (m).
fn robot(length: f64) -> Robot {
    let pitch = length / DISCS as f64;
    let holes = Holes::At(vec![[HALF_WIDTH, 0.0]]);
    let mut spec = RobotSpec::standard("2m").unwrap();
    spec.gravity = [0.0; 3];
    spec.base.position = [0.0; 3];
    spec.base.hole_height = 0.0;
    spec.base.holes = holes.clone();
    spec.modules = vec![ModuleSpec {
        discs: DISCS,
        first_offset: pitch,
        pitch,
        joint_below: pitch / 2.0,
        mass: MassSpec::Rigid(PerDisc::Uniform(RigidMass::default())),
        holes,
        backbone: Some(PerDisc::Uniform(Backbone {
            bending: [1e-3 / pitch; 2],
            torsion: 1e-3 / pitch,
            rest: [0.0; 3],
        })),
        tendons: None,
        ..spec.modules[0].clone()
    }];
    let discs = (0..DISCS).map(|disc| Waypoint(Body::Disc(disc), 0));
    spec.routes = vec![RouteSpec {
        through: std::iter::once(Waypoint(Body::Base, 0))
            .chain(discs)
            .collect(),
        tendon: TendonSpec {
            drive: Drive::Length,
            range: [0.0, 1.0],
            pull: Pull::Bilateral,
            axial_stiffness: None,
            stiffening: 0.0,
            friction: None,
            servo: None,
        },
    }];
    Robot::new(spec).unwrap()
}

/// The points of the model: of each arc the disc's centre, its holes, and the middles of the tendons below it.
fn points(robot: &Robot, pitch: f64) -> Beads {
    let of_disc = |disc| {
        let places = [
            [0.0, 0.0],
            [1.0, 0.0],
            [-1.0, 0.0],
            [1.0, -0.5],
            [-1.0, -0.5],
        ];
        places.map(|[side, below]| Bead {
            disc,
            centre: Vector3::new(side * HALF_WIDTH, 0.0, below * pitch),
            radius: 0.0,
            along_rod: 0.0,
        })
    };
    Beads::of(robot, (0..DISCS).flat_map(of_disc))
}

fn circles() -> Scene {
    let along_y = UnitQuaternion::rotation_between(&Vector3::z(), &Vector3::y()).unwrap();
    let obstacles = CIRCLES.iter().enumerate().map(|(index, &[x, z])| {
        let mut circle = Obstacle::cylinder(&format!("circle {index}"), 0.01, 0.2).unwrap();
        circle.pose = Isometry3::from_parts(Vector3::new(x, 0.0, z).into(), along_y);
        circle
    });
    Scene::new(obstacles.collect()).unwrap()
}

/// The rows of a table of the reference, without its header.
fn table(name: &str) -> Vec<Vec<String>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/contact2d");
    let text = std::fs::read_to_string(folder.join(name)).unwrap();
    let row = |line: &str| line.split(',').map(str::to_owned).collect();
    text.lines().skip(1).map(row).collect()
}

/// The circles that are touched in each step of the reference.
fn touched(name: &str, steps: usize) -> Vec<BTreeSet<usize>> {
    let mut sets = vec![BTreeSet::new(); steps];
    for row in table(name) {
        sets[row[0].parse::<usize>().unwrap()].insert(row[1].parse().unwrap());
    }
    sets
}

/// Follows a path of the reference; largest distance of the tips (m), and the number of steps with the same circles touched.
fn follow(path: &str) -> (f64, usize, usize) {
    let steps = table(&format!("{path}.csv"));
    let theirs = touched(&format!("{path}_contacts.csv"), steps.len());
    let scene = circles();
    let mut configuration = None;
    let (mut apart, mut alike) = (0.0_f64, 0);
    for (step, theirs) in steps.iter().zip(&theirs) {
        let [length, tendon, x, z] = [1, 2, 3, 4].map(|k: usize| step[k].parse::<f64>().unwrap());
        let robot = robot(length);
        let beads = points(&robot, length / DISCS as f64);
        let mut settler = ContactSettler::with_beads(&robot, &scene, beads);
        let command = robot.command(&[tendon]).unwrap();
        let found = match &configuration {
            None => settler.settle(&command, &Loads::default()),
            Some(before) => settler.settle_from(before, &command, &Loads::default()),
        }
        .unwrap();
        assert!(
            found.equilibrium.converged,
            "{path} {}: {}",
            step[0], found.equilibrium.residual
        );
        let tip = found.equilibrium.positions[DISCS - 1];
        assert!(tip.y.abs() < 1e-9);
        let error = (tip - Vector3::new(x, 0.0, z)).norm();
        let ours: BTreeSet<usize> = found
            .contacts
            .iter()
            .filter_map(|contact| contact.partner.obstacle())
            .collect();
        apart = apart.max(error);
        alike += usize::from(ours == *theirs);
        configuration = Some(found.equilibrium.configuration.clone());
    }
    (apart, alike, steps.len())
}

#[test]
fn bent_around_a_circle_the_robot_lies_where_the_model_has_it() {
    let (apart, alike, steps) = follow("around");
    eprintln!("tips within {apart:e} m, the same circles in {alike} of {steps} steps");
    assert!(apart < 5e-4 && alike + 2 >= steps);
}

#[test]
fn inserted_between_circles_the_robot_lies_where_the_model_has_it() {
    let (apart, alike, steps) = follow("between");
    eprintln!("tips within {apart:e} m, the same circles in {alike} of {steps} steps");
    assert!(apart < 5e-4 && alike + 2 >= steps);
}

#[test]
fn clear_of_all_circles_the_robot_bends_as_the_model_does() {
    let (apart, alike, steps) = follow("free");
    eprintln!("tips within {apart:e} m, no circle in {alike} of {steps} steps");
    assert!(apart < 5e-4 && alike == steps && steps == 26);
}

//! Contacts that push before they touch: smooth equilibria among obstacles, whose limit is exact contact.

use nalgebra::Vector3;
use tdcr_sim::contact::{Activity, ContactSettler};
use tdcr_sim::pose::PoseTangent;
use tdcr_sim::robot::{Command, Loads, Robot};
use tdcr_sim::scene::{Obstacle, Scene, SceneError};

const COMMAND: [f64; 6] = [0.034, 0.007, 0.001, 0.026, 0.015, 0.019];
/// Where a post is that 2m leans on, and one that it keeps clear of by millimetres.
const TOUCHED: f64 = -0.05;
const CLEAR: f64 = -0.15;

fn post(x: f64) -> Scene {
    let post = Obstacle::cylinder("post", 0.01, 0.4).unwrap();
    let post = post.at([x, 0.0, 0.25]).with_compliance(1e-5).unwrap();
    Scene::new(vec![post]).unwrap()
}

fn robot() -> (Robot, Command) {
    let robot = Robot::load("2m").unwrap();
    let command = robot.command(&COMMAND).unwrap();
    (robot, command)
}

/// Positions of all discs, and the settler that found them.
fn settled(scene: &Scene) -> (Vec<Vector3<f64>>, ContactSettler) {
    let (robot, command) = robot();
    let mut settler = ContactSettler::new(&robot, scene);
    let found = settler.settle(&command, &Loads::default()).unwrap();
    assert!(found.equilibrium.converged);
    (found.equilibrium.positions.clone(), settler)
}

fn apart(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).norm())
        .fold(0.0, f64::max)
}

#[test]
fn exact_contact_is_their_limit() {
    for x in [TOUCHED, CLEAR] {
        let (exact, settler) = settled(&post(x));
        let touches = !settler.found().contacts.is_empty();
        assert_eq!(touches, x == TOUCHED);
        let mut last = f64::INFINITY;
        for smoothing in [1e-4, 1e-5, 1e-6, 1e-7] {
            let (smooth, settler) = settled(&post(x).with_smoothing(smoothing).unwrap());
            let found = settler.found();
            // Force times distance, for every surface within reach: what is cut off there is less.
            assert!(found.complementarity > 0.0 && found.complementarity <= smoothing);
            assert_eq!(found.barrier, smoothing);
            let off = apart(&exact, &smooth);
            assert!(
                off > 1e-12 && off < 0.5 * last,
                "{x} {smoothing}: {off} {last}"
            );
            last = off;
        }
        assert!(last < 1e-4, "{last}");
    }
}

#[test]
fn an_obstacle_that_is_not_touched_has_a_gradient() {
    let scene = |x: f64| post(x).with_smoothing(1e-4).unwrap();
    let (_, settler) = settled(&scene(CLEAR));
    let (_, command) = robot();
    assert!(
        settler
            .found()
            .contacts
            .iter()
            .all(|own| own.activity == Activity::Weak)
    );
    let sensitivity = settler.sensitivity(&command, &Loads::default()).unwrap();
    let along = PoseTangent {
        position: Vector3::x(),
        ..PoseTangent::default()
    };
    let found = sensitivity.by_obstacle(0, &along);
    let step = 1e-5;
    let ends = [-step, step].map(|by| settled(&scene(CLEAR + by)).0);
    for ((pose, before), after) in found.iter().zip(&ends[0]).zip(&ends[1]) {
        let difference = (after - before) / (2.0 * step);
        assert!(
            (pose.position - difference).norm() < 1e-6,
            "{pose:?} {difference}"
        );
    }
    assert!(found[9].position.norm() > 1e-3);
    // In exact contact there is none.
    let (_, exact) = settled(&post(CLEAR));
    let sensitivity = exact.sensitivity(&command, &Loads::default()).unwrap();
    let none = sensitivity.by_obstacle(0, &along);
    assert!(none.iter().all(|pose| pose.position.norm() < 1e-6));
}

#[test]
fn a_path_goes_on_smoothly_without_friction() {
    let scene = post(TOUCHED).with_smoothing(1e-5).unwrap();
    let (robot, command) = robot();
    let mut settler = ContactSettler::new(&robot, &scene);
    for part in 1..=20 {
        let values: Vec<f64> = (robot.mean_command().as_slice().iter().zip(COMMAND))
            .map(|(from, to)| from + f64::from(part) / 20.0 * (to - from))
            .collect();
        let at = robot.command(&values).unwrap();
        assert!(
            settler
                .follow(&at, &Loads::default())
                .unwrap()
                .equilibrium
                .converged
        );
    }
    let followed = settler.found().equilibrium.positions.clone();
    let at_once = settler.settle(&command, &Loads::default()).unwrap();
    assert!(apart(&followed, &at_once.equilibrium.positions) < 1e-8);
}

#[test]
fn what_is_no_smoothing_is_refused() {
    for wrong in [-1e-9, 1.1, f64::NAN, f64::INFINITY] {
        let refused = post(TOUCHED).with_smoothing(wrong);
        assert!(matches!(refused, Err(SceneError::Smoothing(_))), "{wrong}");
    }
}

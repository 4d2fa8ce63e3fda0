//! Plants, estimation and control, from outside.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod bad_days;
mod clouds;
mod estimation;
mod friction;
mod moving;
mod obstacles;
mod paths;
mod plants;
mod posts;
mod quadratic;
mod safety;
mod tracking;

use tdcr_control::controller::Limits;
use tdcr_control::estimator::EstimatorSettings;
use tdcr_control::lag::Delay;
use tdcr_control::tip_path::{Shape, TipPath};
use tdcr_control::tracking::TrackingSettings;
use tdcr_control::watch::WatchSettings;
use tdcr_sim::inverse::shape::{Search, ShapeController, Target};
use tdcr_sim::robot::{Command, Loads, Robot, RobotSpec};
use tdcr_sim::scene::Scene;

/// Time between commands (s).
const PERIOD: f64 = 0.05;

/// The 2m robot, hung from its base: loads straighten it.
fn hanging() -> Robot {
    let mut spec = RobotSpec::standard("2m").unwrap();
    spec.gravity[2] = -spec.gravity[2];
    Robot::new(spec).unwrap()
}

/// A circle of 60 mm about the straight robot's axis in `duration` (s), 10 mm short of its tip.
fn circle(duration: f64) -> TipPath {
    let frame = nalgebra::Isometry3::translation(0.0, 0.0, 0.326);
    TipPath::closed(Shape::Circle, &frame, 0.06, duration).unwrap()
}

/// The command with the model's tip at the path's first point.
fn first_command(robot: &Robot, path: &TipPath) -> Command {
    let search = Search {
        tolerance: 1e-5,
        ..Search::default()
    };
    let controller = ShapeController::new(robot, &Loads::default(), search).unwrap();
    let found = controller
        .reach(&[Target::tip(robot, path.at(0.0))])
        .unwrap();
    assert!(found.errors[0] < 1e-5);
    found.command
}

fn settings(robot: &Robot) -> TrackingSettings {
    TrackingSettings {
        approach: 2.0,
        loads: Loads::default(),
        scene: Scene::default(),
        correction: Vec::new(),
        estimator: EstimatorSettings::for_robot(robot),
        delay: Delay::Estimated { most: 4 },
        limits: Limits::new(robot, PERIOD, None, [0.0, f64::INFINITY]).unwrap(),
        watch: WatchSettings::default(),
    }
}

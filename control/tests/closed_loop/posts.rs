//! Robots that lean on a post, and come free of it.

use nalgebra::Vector3;
use tdcr_control::belief::Belief;
use tdcr_control::controller::{Controller, Limits, Predictive};
use tdcr_control::plant::{SimulatedPlant, Truth};
use tdcr_control::tip_path::TipPath;
use tdcr_control::tracking::{TrackingSettings, track};
use tdcr_sim::inverse::shape::{Search, ShapeController, Target};
use tdcr_sim::robot::{Loads, Robot, RobotSpec};
use tdcr_sim::scene::{Obstacle, Scene};

use super::settings;

/// Time between commands (s).
const PERIOD: f64 = 0.1;

/// The 3m robot, hung from its base.
fn hanging() -> Robot {
    let mut spec = RobotSpec::standard("3m").unwrap();
    spec.gravity[2] = -spec.gravity[2];
    Robot::new(spec).unwrap()
}

/// The post of `benches/published_path.py`: past its end, at y = 50 mm, a robot that leans on it comes free.
fn post() -> Scene {
    let turn = 0.5_f64.sqrt();
    let post = Obstacle::cylinder("post", 0.005, 0.1)
        .unwrap()
        .at([0.03, 0.0, 0.28]);
    let post = post.with_orientation([turn, turn, 0.0, 0.0]).unwrap();
    Scene::new(vec![post]).unwrap()
}

/// The first quarter of the curve of `benches/published_path.py`, at its speed: 12 s of a rounded triangle.
fn quarter() -> TipPath {
    const LOBES: f64 = 0.650_468_444_814_202_5;
    let at = |k: usize| {
        let angle = std::f64::consts::TAU * k as f64 / 4000.0;
        let radius = 1.0 + LOBES * (3.0 * angle).cos();
        [radius * angle.cos(), radius * angle.sin()]
    };
    let points: Vec<[f64; 2]> = (0..=4000).map(at).collect();
    let span = |axis: usize| {
        let of = points.iter().map(|point| point[axis]);
        let (low, high) = (of.clone().reduce(f64::min), of.reduce(f64::max));
        [low.unwrap(), high.unwrap()]
    };
    let spans = [span(0), span(1)];
    let scaled = |point: &[f64; 2]| {
        let place = |axis: usize, width: f64| {
            let [low, high] = spans[axis];
            (point[axis] - (low + high) / 2.0) * width / (high - low)
        };
        Vector3::new(place(0, 0.121), place(1, 0.131), 0.38)
    };
    let points: Vec<Vector3<f64>> = points.iter().map(scaled).collect();
    let speed = 0.472 / 60.0;
    let (mut rows, mut way) = (vec![(0.0, points[0])], 0.0);
    for pair in points.windows(2) {
        way += (pair[1] - pair[0]).norm();
        rows.push((way / speed, pair[1]));
    }
    rows.retain(|row| row.0 <= 12.0);
    TipPath::table(&rows).unwrap()
}

#[test]
fn asking_a_model_of_other_commands_does_not_move_it() {
    let robot = hanging();
    let mut belief = Belief::new(&robot, &Loads::default(), &[]).unwrap();
    belief = belief.among(&post()).unwrap();
    let command = |bent: f64| {
        let middle = robot.mean_command().as_slice().to_vec();
        let change = [bent, -bent / 2.0, -bent / 2.0].repeat(3);
        let changed = middle.iter().zip(change).map(|(at, change)| at + change);
        changed.collect::<Vec<f64>>()
    };
    belief.rest(&command(0.004)).unwrap();
    let asked = belief.tip(&command(0.0)).unwrap();
    for bent in [-0.008, 0.008, -0.004] {
        belief.tip(&command(bent)).unwrap();
    }
    assert_eq!(belief.tip(&command(0.0)).unwrap(), asked);
}

#[test]
fn mpc_comes_free_of_a_post_and_back_to_its_path() {
    let (robot, scene, path) = (hanging(), post(), quarter());
    let mut truth = Truth::ideal(&robot);
    truth.scene = scene.clone();
    truth.sensors.position = 1e-4;
    let settings = TrackingSettings {
        approach: 4.0,
        scene: scene.clone(),
        limits: Limits::new(&robot, PERIOD, None, [0.0, f64::INFINITY]).unwrap(),
        ..settings(&robot)
    };
    // The seeds whose starts lead round the end of the post.
    let errors = [0, 3, 4, 5, 7, 9].map(|seed| {
        let search = Search {
            tolerance: 1e-5,
            seed,
            ..Search::default()
        };
        let start = ShapeController::among(&robot, &scene, &Loads::default(), search).unwrap();
        let start = start.reach(&[Target::tip(&robot, path.at(0.0))]).unwrap();
        let mut plant = SimulatedPlant::new(&truth, PERIOD, &start.command, seed).unwrap();
        let controller: &mut dyn Controller = &mut Predictive::default();
        let run = track(
            &mut plant,
            &robot,
            &start.command,
            &path,
            controller,
            &settings,
            &mut |_| true,
        );
        let run = run.unwrap();
        assert!(run.stopped.is_none(), "{:?}", run.stopped);
        run.rms_error().unwrap()
    });
    eprintln!("RMS errors of 12 s: {errors:?} m");
    let squares: f64 = errors.iter().map(|error| error * error).sum();
    // Nearly all of a minute's squared error is in this quarter, so that over the minute it is less than half of this.
    assert!((squares / 6.0).sqrt() < 3.5e-3, "{errors:?}");
}

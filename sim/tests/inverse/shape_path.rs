//! Commands along paths of targets.

use std::f64::consts::TAU;

use nalgebra::{Unit, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_sim::inverse::shape::{
    Arrival, Outcome, PathPoint, Search, ShapeControlError, ShapeController, Target,
};
use tdcr_sim::robot::{Command, Loads, Robot};
use tdcr_sim::statics::{Equilibrium, Settler};

/// Targets of the example's circle.
const TARGETS: usize = 72;

/// Positions on a circle (m), both ends included.
fn circle(
    centre: Vector3<f64>,
    [u, v]: [Vector3<f64>; 2],
    radius: f64,
    n: usize,
) -> Vec<Vector3<f64>> {
    let at = |k: usize| {
        let (sin, cos) = (TAU * k as f64 / n as f64).sin_cos();
        centre + (u * cos + v * sin) * radius
    };
    (0..=n).map(at).collect()
}

/// How far the disc that moves most is displaced (m).
fn displacement(a: &Equilibrium, b: &Equilibrium) -> f64 {
    let pairs = a.positions.iter().zip(&b.positions);
    pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

/// Largest change of an entry.
fn change(a: &Command, b: &Command) -> f64 {
    let pairs = a.as_slice().iter().zip(b.as_slice());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Moves a robot's command evenly, in small steps, and follows its equilibrium. Returns where it ends,
/// and the largest displacement of a disc in one step.
fn play(
    robot: &Robot,
    loads: &Loads,
    from: &Equilibrium,
    commands: &[&Command],
) -> (Equilibrium, f64) {
    const STEPS: usize = 256;
    let mut settler = Settler::new(robot);
    let (mut last, mut largest) = (from.clone(), 0.0);
    for ends in commands.windows(2) {
        for step in 1..=STEPS {
            let share = step as f64 / STEPS as f64;
            let pairs = ends[0].as_slice().iter().zip(ends[1].as_slice());
            let between: Vec<f64> = pairs.map(|(a, b)| a + share * (b - a)).collect();
            let command = robot.command(&between).unwrap();
            let settled = settler.settle_from(&last.configuration, &command, loads);
            assert!(settled.converged);
            largest = f64::max(largest, displacement(&last, settled));
            last = settled.clone();
        }
    }
    (last, largest)
}

/// The figures that a point states are true; what it calls followed is arrived at without a jump, at
/// the equilibrium stated.
fn assert_honest(
    robot: &Robot,
    loads: &Loads,
    last: &PathPoint,
    point: &PathPoint,
    target: &Vector3<f64>,
) {
    let (from, to) = (&last.solution, &point.solution);
    let tip = robot.discs().len() - 1;
    let changed = change(&from.command, &to.command);
    assert!((point.command_change - changed).abs() <= 1e-15);
    assert_eq!(
        point.disc_change,
        displacement(&from.equilibrium, &to.equilibrium)
    );
    let left = (to.equilibrium.positions[tip] - target).norm();
    assert!((left - to.errors[0]).abs() <= 1e-15);
    assert_eq!(left <= 1e-6, to.outcome == Outcome::Reached);
    match point.arrival {
        Arrival::First => panic!("there is a last point"),
        Arrival::Followed => {
            let commands: Vec<_> = std::iter::once(&from.command)
                .chain(&point.via)
                .chain([&to.command])
                .collect();
            let (end, largest) = play(robot, loads, &from.equilibrium, &commands);
            assert!(displacement(&end, &to.equilibrium) <= 1e-6);
            assert!(largest <= 2e-3, "{largest}");
        }
        Arrival::Switched => assert_eq!(to.outcome, Outcome::Reached),
    }
}

/// The circle of the example `shape_control`, from half out of reach through where the equilibria that
/// it was followed on once vanished. All that is reached from anywhere is reached on one branch.
#[test]
fn a_circle_is_followed_on_one_branch_with_changes_in_proportion_to_its_spacing() {
    let robot = Robot::load("3m").unwrap();
    let loads = Loads::payload(0.01).unwrap();
    let controller = ShapeController::new(&robot, &loads, Search::default()).unwrap();
    let level = [Vector3::x(), Vector3::y()];
    let positions = circle(Vector3::new(0.12, 0.0, 0.33), level, 0.07, TARGETS);
    let spacing = (positions[1] - positions[0]).norm();
    let mut path = controller.path();
    let mut points: Vec<PathPoint> = Vec::new();
    for position in &positions {
        let target = [Target::tip(&robot, *position)];
        let point = path.follow(&target).unwrap();
        let anywhere = controller.reach(&target).unwrap();
        assert_eq!(
            anywhere.outcome == Outcome::Reached,
            point.solution.outcome == Outcome::Reached
        );
        assert!(point.solution.errors[0] <= anywhere.errors[0] + 1e-6);
        if let Some(last) = points.last() {
            assert_honest(&robot, &loads, last, &point, position);
            assert_eq!(point.arrival, Arrival::Followed);
            assert!(point.via.is_empty());
            assert!(
                point.command_change <= 1.5 * spacing,
                "{}",
                point.command_change
            );
            assert!(point.disc_change <= 4.0 * spacing, "{}", point.disc_change);
        }
        points.push(point);
    }
    assert_eq!(points[0].arrival, Arrival::First);
    let reached = points
        .iter()
        .filter(|p| p.solution.outcome == Outcome::Reached);
    assert_eq!(reached.count(), 47);
    // Inside its reach, the robot's discs move about as far as its targets.
    for point in &points[20..50] {
        assert!(
            point.command_change <= 0.5 * spacing,
            "{}",
            point.command_change
        );
        assert!(point.disc_change <= 1.3 * spacing, "{}", point.disc_change);
    }
}

/// Circles anywhere, most of them partly out of reach: whatever happens on them is said.
#[test]
fn on_any_path_the_robot_follows_or_a_switch_is_reported() {
    let (mut followed, mut switched, mut through) = (0, 0, 0);
    for name in ["2m", "3m"] {
        let robot = Robot::load(name).unwrap();
        let loads = Loads::payload(0.01).unwrap();
        let controller = ShapeController::new(&robot, &loads, Search::default()).unwrap();
        let tip = robot.discs().len() - 1;
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        for _ in 0..6 {
            let settled = robot.settle(&robot.random_command(&mut rng), &loads);
            let axis = Vector3::from_fn(|_, _| rng.random::<f64>() - 0.5);
            let u = Unit::new_normalize(axis.cross(&Vector3::x())).into_inner();
            let v = axis.normalize().cross(&u);
            let positions = circle(settled.positions[tip], [u, v], 0.04, 24);
            let mut path = controller.path();
            let mut last: Option<PathPoint> = None;
            for position in &positions {
                let point = path.follow(&[Target::tip(&robot, *position)]).unwrap();
                if let Some(last) = &last {
                    assert_honest(&robot, &loads, last, &point, position);
                    followed += usize::from(point.arrival == Arrival::Followed);
                    switched += usize::from(point.arrival == Arrival::Switched);
                    through += point.via.len();
                }
                last = Some(point);
            }
        }
    }
    assert!(followed > 250 && switched > 0 && switched < 10 && through > 0);
}

#[test]
fn a_path_starts_at_a_command() {
    let robot = Robot::load("3m").unwrap();
    let loads = Loads::default();
    let controller = ShapeController::new(&robot, &loads, Search::default()).unwrap();
    let start = (robot.command(&[0.03, 0.01, 0.01, 0.02, 0.03, 0.02, 0.01, 0.02, 0.03])).unwrap();
    let settled = robot.settle(&start, &loads);
    let mut path = controller.path_from(&start).unwrap();
    let target = |position| [Target::tip(&robot, position)];
    let stay = path.follow(&target(settled.positions[14])).unwrap();
    assert_eq!(stay.arrival, Arrival::Followed);
    assert!(stay.command_change <= 1e-9 && stay.disc_change <= 1e-6);
    let near = path
        .follow(&target(settled.positions[14] + Vector3::x() * 1e-3))
        .unwrap();
    assert_eq!(near.arrival, Arrival::Followed);
    assert_eq!(near.solution.outcome, Outcome::Reached);
    assert!(near.command_change <= 1e-3 && near.disc_change <= 2e-3);

    let other = Robot::load("2m").unwrap().mean_command();
    assert!(matches!(
        controller.path_from(&other),
        Err(ShapeControlError::Command(_))
    ));
    assert_eq!(path.follow(&[]).unwrap_err(), ShapeControlError::NoTarget);
    // A refusal leaves the path where it was.
    let again = path
        .follow(&target(settled.positions[14] + Vector3::x() * 1e-3))
        .unwrap();
    assert!(again.command_change <= 1e-9);
}

//! Deployments along random curves of three classes.

use std::f64::consts::{PI, TAU};

use nalgebra::{Unit, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_control::plan::follow_the_leader::{
    BaseMotion, Deployment, DeploymentError, DeploymentTask, deploy, deploy_while,
};
use tdcr_sim::contact::ContactSettler;
use tdcr_sim::robot::{Loads, Robot, RobotSpec};
use tdcr_sim::scene::{Obstacle, Scene};

/// Stages of a deployment.
const STAGES: usize = 40;
/// Points that a curve is sampled at.
const POINTS: usize = 200;

#[derive(Clone, Copy, Debug)]
enum Class {
    C,
    S,
    /// What the backbone of a robot of three segments of constant curvature is.
    Robot,
}

/// A curve for a robot of length 3, no longer than that: Bezier curves (S) and half circles whose first quarter is cut off (C), ends
/// uniform within 0.3 of (-2.3, 0, 0.8) in each coordinate, the half circle turned about its chord by any angle; backbones whose
/// two curvatures of each segment are uniform within 0.3 / 0.2.
fn curve(class: Class, rng: &mut ChaCha8Rng) -> Vec<Vector3<f64>> {
    loop {
        let drawn = drawn(class, rng);
        let length: f64 = drawn
            .windows(2)
            .map(|pair| (pair[1] - pair[0]).norm())
            .sum();
        if length <= 3.0 {
            return drawn;
        }
    }
}

fn drawn(class: Class, rng: &mut ChaCha8Rng) -> Vec<Vector3<f64>> {
    let mut uniform = |half: f64| half * (2.0 * rng.random::<f64>() - 1.0);
    let share = |k: usize| k as f64 / (POINTS - 1) as f64;
    let end = Vector3::new(-2.3, 0.0, 0.8) + Vector3::new(uniform(0.3), uniform(0.3), uniform(0.3));
    match class {
        Class::S => {
            let middle = end / 2.0;
            let control = [
                Vector3::zeros(),
                Vector3::new(middle.x / 2.0, 0.0, middle.z + 0.5),
                Vector3::new(end.x - middle.x / 2.0, end.y, middle.z - 0.5),
                end,
            ];
            let at = |t: f64| {
                let weights = [
                    (1.0 - t).powi(3),
                    3.0 * t * (1.0 - t).powi(2),
                    3.0 * t * t * (1.0 - t),
                    t.powi(3),
                ];
                control
                    .iter()
                    .zip(weights)
                    .map(|(point, weight)| point * weight)
                    .sum()
            };
            (0..POINTS).map(|k| at(share(k))).collect()
        }
        Class::C => {
            let (centre, angle) = (end / 2.0, uniform(PI));
            let chord = Unit::new_normalize(end);
            let across = end.cross(&Vector3::z()).normalize();
            let across = UnitQuaternion::from_axis_angle(&chord, angle) * across;
            let at = |t: f64| {
                let (sin, cos) = t.sin_cos();
                centre - centre * cos + across * (centre.norm() * sin)
            };
            // Of ten points the first two are cut off.
            let from = PI * 2.0 / 9.0;
            (0..POINTS)
                .map(|k| at(from + (PI - from) * share(k)))
                .collect()
        }
        Class::Robot => {
            let curvatures: Vec<[f64; 2]> = (0..3)
                .map(|_| [uniform(0.3) / 0.2, uniform(0.3) / 0.2])
                .collect();
            let step = 3.0 / (POINTS - 1) as f64;
            let (mut place, mut turn) = (Vector3::new(0.0, 0.0, -3.0), UnitQuaternion::identity());
            let mut points = vec![place];
            for k in 0..POINTS - 1 {
                let [x, y] = curvatures[((k as f64 + 0.5) * step) as usize];
                let half =
                    UnitQuaternion::from_scaled_axis(Vector3::new(-y, x, 0.0) * (step / 2.0));
                turn *= half;
                place += turn * Vector3::z() * step;
                turn *= half;
                points.push(place);
            }
            points
        }
    }
}

const THREE_SEGMENTS: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../examples/three-segments.toml"
);

/// A robot of three segments on an elastic rod, under gravity, with tendons that pull up to 25 N: a segment bends by 2 rad then.
fn robot() -> Robot {
    let mut spec = RobotSpec::load(THREE_SEGMENTS).unwrap();
    for module in &mut spec.modules {
        module.tendons.as_mut().unwrap().range = [0.0, 25.0];
    }
    Robot::new(spec).unwrap()
}

fn deployed(
    robot: &Robot,
    class: Class,
    motion: BaseMotion,
    rng: &mut ChaCha8Rng,
) -> Result<Deployment, DeploymentError> {
    let scale = robot.arc_lengths().last().unwrap() / 3.0;
    let points: Vec<_> = curve(class, rng)
        .into_iter()
        .map(|point| point * scale)
        .collect();
    deploy(robot, &Loads::default(), &points, motion, STAGES)
}

/// Mean and largest deviation of deployments, as shares of the robot's length.
fn deviations(count: usize, motion: BaseMotion) -> [f64; 2] {
    let robot = robot();
    let length = *robot.arc_lengths().last().unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let (mut all, mut worst) = (Vec::new(), 0.0_f64);
    for class in [Class::S, Class::C, Class::Robot] {
        let began = std::time::Instant::now();
        let mut means = Vec::new();
        for _ in 0..count {
            let deployment = deployed(&robot, class, motion, &mut rng).unwrap();
            let tip = deployment
                .stages
                .iter()
                .map(|stage| stage.tip_error)
                .fold(0.0, f64::max);
            if motion == BaseMotion::Free {
                assert!(tip <= 1e-9, "{class:?}: the tip is {tip} m off");
            }
            assert_settles_so(&robot, &deployment);
            means.push(deployment.mean_deviation / length);
            worst = worst.max(deployment.largest_deviation / length);
        }
        let mean = means.iter().sum::<f64>() / count as f64;
        let most = means.iter().fold(0.0, |a: f64, b| a.max(*b));
        eprintln!(
            "{motion:?} {class:?}: {:.2} % in the mean over {count} curves, {:.2} % of the worst; {:.2} s each",
            100.0 * mean,
            100.0 * most,
            began.elapsed().as_secs_f64() / count as f64
        );
        all.extend(means);
    }
    [all.iter().sum::<f64>() / all.len() as f64, worst]
}

/// The robot with its base in the pose of each stage settles, from the straight pose, where the stage has its discs.
fn assert_settles_so(robot: &Robot, deployment: &Deployment) {
    for stage in &deployment.stages {
        let mut spec = robot.spec().clone();
        spec.base.position = stage.base.translation.vector.into();
        let q = stage.base.rotation;
        spec.base.orientation = [q.w, q.i, q.j, q.k];
        let there = Robot::new(spec).unwrap();
        let settled = there.settle(&stage.command, &Loads::default());
        let places = settled.positions.iter().zip(&stage.positions);
        let off = places.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        assert!(settled.converged && off <= 1e-6, "{off} m off");
    }
}

#[test]
fn a_robot_on_a_free_base_stays_on_random_curves_by_a_percent_of_its_length() {
    let [mean, _] = deviations(3, BaseMotion::Free);
    assert!(mean <= 0.01, "{mean}");
}

/// `cargo test --release -p tdcr-control --test plan deployments -- --ignored --nocapture`: minutes.
#[test]
#[ignore = "takes minutes"]
fn over_120_random_curves_the_deviation_is_a_percent_of_the_length() {
    let [mean, _] = deviations(40, BaseMotion::Free);
    eprintln!("free: {:.3} % over 120 curves", 100.0 * mean);
    let [carried, _] = deviations(40, BaseMotion::Carriage);
    eprintln!("carriage: {:.3} % over 120 curves", 100.0 * carried);
    assert!(mean <= 0.01, "{mean}");
}

#[test]
fn a_robot_without_weight_follows_an_arc_that_its_segments_can_take() {
    let mut spec = RobotSpec::load(THREE_SEGMENTS).unwrap();
    spec.gravity = [0.0; 3];
    let robot = Robot::new(spec).unwrap();
    let length = *robot.arc_lengths().last().unwrap();
    let radius = length / (TAU / 8.0);
    let at = |k: usize| {
        let (sin, cos) = (TAU / 8.0 * k as f64 / 100.0).sin_cos();
        Vector3::new(radius * (1.0 - cos), 0.0, radius * sin)
    };
    let arc: Vec<_> = (0..=100).map(at).collect();
    let deployment = deploy(&robot, &Loads::default(), &arc, BaseMotion::Free, 20).unwrap();
    assert!(
        deployment.largest_deviation <= 0.002 * length,
        "{}",
        deployment.largest_deviation / length
    );
    let last = &deployment.stages[19];
    assert!((last.positions[29] - arc[100]).norm() < 1e-9);
    let too_long: Vec<_> = arc.iter().map(|point| point * 1.1).collect();
    let refused = deploy(&robot, &Loads::default(), &too_long, BaseMotion::Free, 20);
    assert!(
        matches!(refused, Err(DeploymentError::TooLong { .. })),
        "{refused:?}"
    );
    let refused = deploy(&robot, &Loads::default(), &arc[..1], BaseMotion::Free, 20);
    assert_eq!(refused, Err(DeploymentError::Curve(1)));
}

#[test]
fn a_deployment_tells_its_steps_and_stops_when_it_is_told_to() {
    let robot = robot();
    let arc: Vec<_> = (0..=20)
        .map(|k| {
            let angle = 0.5 * f64::from(k) / 20.0;
            Vector3::new(0.3 * (1.0 - angle.cos()), 0.0, 0.3 * angle.sin())
        })
        .collect();
    let task = DeploymentTask {
        robot: &robot,
        scene: &Scene::default(),
        loads: &Loads::default(),
        points: &arc,
        motion: BaseMotion::Carriage,
        stages: 5,
    };
    let mut told = Vec::new();
    let whole = deploy_while(&task, |done, steps| {
        told.push((done, steps));
        true
    });
    assert_eq!(whole.unwrap().stages.len(), 5);
    assert_eq!(told, (1..=18).map(|done| (done, 18)).collect::<Vec<_>>());
    let stopped = deploy_while(&task, |done, _| done < 3);
    assert_eq!(stopped, Err(DeploymentError::Interrupted));
}

/// Each stage settles again among the obstacles, by none of the deployment's code, where it has its discs, and bears what it said.
#[test]
fn stages_of_a_deployment_in_a_scene_are_equilibria_among_its_obstacles() {
    let robot = robot();
    let length = robot.arc_lengths()[robot.discs().len() - 1];
    let at = |k: i32| {
        let angle = 0.8 * f64::from(k) / 40.0;
        let radius = 0.85 * length / 0.8;
        Vector3::new(radius * (1.0 - angle.cos()), 0.0, radius * angle.sin())
    };
    let points: Vec<_> = (0..=40).map(at).collect();
    // The tip's disc would reach 1 mm into the ball.
    let (tip, before) = (points[40], points[39]);
    let along = (tip - before).normalize();
    let inward = along.cross(&Vector3::y()) * -1.0;
    let away = 0.02 + robot.discs()[robot.discs().len() - 1].radius - 0.001;
    let ball = Obstacle::sphere("ball", 0.02).unwrap();
    let ball = ball.at((tip + inward * away).into());
    let scene = Scene::new(vec![ball]).unwrap();
    let task = DeploymentTask {
        robot: &robot,
        scene: &scene,
        loads: &Loads::default(),
        points: &points,
        motion: BaseMotion::Free,
        stages: 12,
    };
    let deployment = deploy_while(&task, |_, _| true).unwrap();
    let mut touching = 0;
    for stage in &deployment.stages {
        let mut spec = robot.spec().clone();
        let (base, turn) = (stage.base.translation.vector, stage.base.rotation);
        spec.base.position = base.into();
        spec.base.orientation = [turn.w, turn.i, turn.j, turn.k];
        let (there, loads) = (Robot::new(spec).unwrap(), Loads::default());
        // From where it would be without the ball, which the straight robot may pass on the other side.
        let free = there.settle(&stage.command, &loads);
        let mut settler = ContactSettler::new(&there, &scene);
        let found = settler.settle_from(&free.configuration, &stage.command, &loads);
        let found = found.unwrap();
        for (one, other) in stage.positions.iter().zip(&found.equilibrium.positions) {
            assert!((one - other).norm() < 1e-5, "{}", (one - other).norm());
        }
        let force: f64 = found.contacts.iter().map(|one| one.force.norm()).sum();
        assert!((force - stage.contact_force()).abs() < 1e-2 * force.max(1e-3));
        let touches = force > 1e-4;
        touching += usize::from(touches);
        // The tip is on the curve where the ball lets it, and else as near as it comes.
        let allowed = if touches { 4e-3 } else { 1e-6 };
        assert!(stage.tip_error < allowed, "{}", stage.tip_error);
    }
    assert!((1..12).contains(&touching), "{touching}");
}

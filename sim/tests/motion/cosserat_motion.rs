//! A chain of discs with a rod against the motion of a continuous Cosserat rod: three releases of a steel rod by SoRoSim
//! (`data/sorosim`).
//!
//! `cargo test --release -p tdcr-sim --test motion cosserat -- --ignored --nocapture` prints the table of docs/validation.md.

use std::path::Path;

use nalgebra::{Matrix3, Vector3};
use tdcr_sim::dynamics::{Integrator, State, Stepper};
use tdcr_sim::robot::{Frame, Loads, Robot, RobotSpec};

const LENGTH: f64 = 0.6;
/// Time between the rows of the files (s).
const ROW: f64 = 0.005;

/// One release, in a frame where the straight rod stands along z.
struct Release {
    damping: f64,
    gravity: [f64; 3],
    /// Moment (N m) and force (N) that hold the rod, in the middle and at the tip.
    wrenches: [[Vector3<f64>; 2]; 2],
    /// Place of the tip (m) by row.
    tips: Vec<Vector3<f64>>,
}

fn release(number: usize) -> Release {
    let path = format!(
        "{}/tests/data/sorosim/spring_steel_tip_release_{number}.txt",
        env!("CARGO_MANIFEST_DIR")
    );
    let text = std::fs::read_to_string(path).unwrap();
    let rows: Vec<Vec<f64>> = (text.lines())
        .map(|row| row.split_whitespace().map(|n| n.parse().unwrap()).collect())
        .collect();
    let upright = Matrix3::new(0.0, 0.0, 1.0, 0.0, -1.0, 0.0, 1.0, 0.0, 0.0);
    let at =
        |row: usize, first: usize| upright * Vector3::from_fn(|axis, _| rows[row][first + axis]);
    Release {
        damping: rows[0][0],
        gravity: at(0, 10).into(),
        wrenches: [1, 7].map(|first| [at(1, first), at(1, first + 3)]),
        tips: (2..rows.len()).map(|row| at(row, 10)).collect(),
    }
}

fn rod(discs: usize, release: &Release, time: f64) -> Robot {
    let spec = format!(
        "name = \"rod\"
        gravity = {:?}
        routing = \"base\"
        base = {{ position = [0.0, 0.0, 0.0], holes = [], hole_height = 0.0 }}
        [[modules]]
        discs = {discs}
        length = {LENGTH}
        joint_below = {}
        radius = 0.0008
        half_height = 0.001
        mass = {{ density = 0.0 }}
        holes = []
        damping = 0.0
        armature = 0.0
        [modules.rod]
        youngs = 200e9
        poisson = 0.33
        radius = 0.0008
        density = 7870.0
        damping = {{ bending = {time:?}, torsion = {time:?} }}",
        release.gravity,
        LENGTH / discs as f64 / 2.0
    );
    Robot::new(RobotSpec::from_toml(&spec, Path::new("robot.toml")).unwrap()).unwrap()
}

/// Where the tip is at every row, and the steps not taken as asked.
fn simulate(release: &Release, discs: usize, time: f64, dt: f64) -> (Vec<Vector3<f64>>, usize) {
    let robot = rod(discs, release, time);
    let mut loads = Loads::default();
    for (arc_length, [moment, force]) in [LENGTH / 2.0, LENGTH].into_iter().zip(release.wrenches) {
        let (force, moment) = (force.into(), moment.into());
        loads =
            (loads.with_backbone_wrench(&robot, arc_length, force, moment, Frame::World)).unwrap();
    }
    let command = robot.command(&[]).unwrap();
    let held = robot.settle(&command, &loads);
    assert!(held.converged);
    let mut state = State::at_rest(held.configuration);
    let mut stepper = Stepper::new(&robot, dt, Integrator::ImplicitMidpoint).unwrap();
    let steps = (ROW / dt).round() as usize;
    let mut tips = vec![state.positions(&robot)[discs - 1]];
    for _ in 1..release.tips.len() {
        for _ in 0..steps {
            stepper
                .step(&mut state, &command, &Loads::default())
                .unwrap();
        }
        tips.push(state.positions(&robot)[discs - 1]);
    }
    (tips, stepper.fallbacks())
}

fn rms(found: &[Vector3<f64>], wanted: &[Vector3<f64>]) -> f64 {
    let pairs = found.iter().zip(wanted);
    let sum: f64 = pairs.map(|(a, b)| (a - b).norm_squared()).sum();
    (sum / wanted.len() as f64).sqrt()
}

/// Frequency (Hz) of the slowest mode, once the others have decayed: from the tip's passages through where it will rest,
/// between 0.4 s and the end.
fn frequency(tips: &[Vector3<f64>], rest: &Vector3<f64>) -> f64 {
    let first = (0.4 / ROW) as usize;
    let swing: Vec<Vector3<f64>> = tips[first..].iter().map(|tip| tip - rest).collect();
    let widest = (swing.iter())
        .max_by(|a, b| a.norm().total_cmp(&b.norm()))
        .unwrap()
        .normalize();
    let along: Vec<f64> = swing.iter().map(|s| s.dot(&widest)).collect();
    let passages: Vec<f64> = (along.windows(2).enumerate())
        .filter(|(_, pair)| pair[0] * pair[1] < 0.0)
        .map(|(row, pair)| (row as f64 + pair[0] / (pair[0] - pair[1])) * ROW)
        .collect();
    let (start, end) = (passages[0], passages[passages.len() - 1]);
    (passages.len() - 1) as f64 / (2.0 * (end - start))
}

/// Where the tip rests when nothing holds it (m).
fn rest(release: &Release, discs: usize) -> Vector3<f64> {
    let robot = rod(discs, release, 0.0);
    let settled = robot.settle(&robot.command(&[]).unwrap(), &Loads::default());
    settled.positions[discs - 1]
}

/// RMS error of the tip over the first second and the first two, as a share of the length, and the two frequencies (Hz).
fn compare(release: &Release, discs: usize, dt: f64) -> ([f64; 2], [f64; 2]) {
    let (tips, fallbacks) = simulate(release, discs, release.damping, dt);
    assert_eq!(fallbacks, 0);
    let errors = [200, 400].map(|last| rms(&tips[..=last], &release.tips[..=last]) / LENGTH);
    let rest = rest(release, discs);
    let frequencies = [&tips, &release.tips].map(|tips| frequency(tips, &rest));
    (errors, frequencies)
}

/// The files' damping is the relaxation time, in bending and in torsion.
#[test]
fn a_released_rod_moves_as_a_cosserat_rod_does() {
    for number in 1..=3 {
        let ([first, both], [found, wanted]) = compare(&release(number), 30, 2.5e-3);
        assert!(first < 0.01 && both < 0.01, "{number}: {first} {both}");
        assert!(
            (found / wanted - 1.0).abs() < 0.01,
            "{number}: {found} {wanted} Hz"
        );
    }
}

#[test]
#[ignore = "prints the table of docs/validation.md"]
#[allow(clippy::print_stdout, reason = "that is what it is for")]
fn the_table_of_releases() {
    println!(
        "| release | discs | step (ms) | RMS 1 s (% of length) | RMS 2 s (%) | frequency (Hz) | of the file (Hz) | error (%) | time for 2 s (s) |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for (number, discs, dt) in (1..=3).flat_map(|number| {
        [
            (25, 1e-3),
            (50, 1e-3),
            (50, 5e-3),
            (50, 2.5e-3),
            (100, 1e-3),
        ]
        .map(|(n, h)| (number, n, h))
    }) {
        let start = std::time::Instant::now();
        let ([first, both], [found, wanted]) = compare(&release(number), discs, dt);
        println!(
            "| {number} | {discs} | {} | {:.3} | {:.3} | {found:.3} | {wanted:.3} | {:.2} | {:.2} |",
            dt * 1e3,
            first * 100.0,
            both * 100.0,
            (found / wanted - 1.0) * 100.0,
            start.elapsed().as_secs_f64()
        );
    }
}

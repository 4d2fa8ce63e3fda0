//! Chains of discs with a rod against a continuous Cosserat rod: 500 shapes of a steel rod under
//! gravity and wrenches in the middle and at the tip, by SoRoSim (`data/sorosim`).
//!
//! `cargo test --release -p tdcr-sim --test statics cosserat -- --ignored --nocapture` prints the table of
//! docs/validation.md.

use std::path::Path;

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use tdcr_sim::curve::BackboneCurve;
use tdcr_sim::robot::{Frame, Loads, Robot, RobotSpec};

/// The rod's length (m): the shapes' errors are given as shares of it.
const LENGTH: f64 = 0.6;

/// One shape, in a frame where the straight rod stands along z.
struct Shape {
    gravity: [f64; 3],
    /// Moment (N m) and force (N) in the middle and at the tip.
    wrenches: [[Vector3<f64>; 2]; 2],
    /// Arc length (m) and position (m) of each station.
    stations: Vec<(f64, Vector3<f64>)>,
}

fn shapes() -> Vec<Shape> {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/tests/data/sorosim/spring_steel_statics.csv"
    );
    let text = std::fs::read_to_string(path).unwrap();
    let rows: Vec<Vec<f64>> = (text.lines().skip(1))
        .map(|row| row.split(',').skip(1).map(|n| n.parse().unwrap()).collect())
        .collect();
    let upright = Matrix3::new(0.0, 0.0, 1.0, 0.0, -1.0, 0.0, 1.0, 0.0, 0.0);
    let (shares, shapes) = rows.split_first().unwrap();
    let station = |column: usize| {
        let segment = if column < 10 { 0.0 } else { 1.0 };
        LENGTH / 2.0 * (segment + shares[column])
    };
    let shape = |rows: &[Vec<f64>]| {
        let at = |first: usize, column: usize| {
            upright * Vector3::from_fn(|axis, _| rows[first + axis][column])
        };
        Shape {
            gravity: at(3, 0).into(),
            wrenches: [1, 2].map(|column| [at(0, column), at(3, column)]),
            stations: (3..17).map(|c| (station(c), at(3, c))).collect(),
        }
    };
    shapes.chunks(6).map(shape).collect()
}

/// The rod as a chain of discs without mass, from a robot file's text.
fn rod(discs: usize) -> RobotSpec {
    let text = format!(
        "name = \"rod\"
        gravity = [0.0, 0.0, 0.0]
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
        rod = {{ youngs = 200e9, poisson = 0.33, radius = 0.0008, density = 7870.0 }}",
        LENGTH / discs as f64 / 2.0
    );
    RobotSpec::from_toml(&text, Path::new("robot.toml")).unwrap()
}

/// The rod's curve in the shape.
fn settle(shape: &Shape, discs: usize) -> BackboneCurve {
    let mut spec = rod(discs);
    spec.gravity = shape.gravity;
    let robot = Robot::new(spec).unwrap();
    let mut loads = Loads::default();
    for (arc_length, [moment, force]) in [LENGTH / 2.0, LENGTH].into_iter().zip(shape.wrenches) {
        let (force, moment) = (force.into(), moment.into());
        loads =
            (loads.with_backbone_wrench(&robot, arc_length, force, moment, Frame::World)).unwrap();
    }
    let settled = robot.settle(&robot.command(&[]).unwrap(), &loads);
    assert!(settled.converged, "{}", settled.residual);
    BackboneCurve::new(&robot, &settled.pose())
}

/// Mean, median and largest.
fn summary(mut errors: Vec<f64>) -> [f64; 3] {
    errors.sort_by(f64::total_cmp);
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    let median = errors[errors.len() / 2];
    [mean, median, errors[errors.len() - 1]]
}

/// Errors (m) of one in `every` shapes by a chain of `discs`: each shape's mean over the 14 stations, and at the tip.
fn errors(shapes: &[Shape], every: usize, discs: usize) -> [Vec<f64>; 2] {
    let errors = shapes.par_iter().step_by(every).map(|shape| {
        let curve = settle(shape, discs);
        let point = |s: f64| curve.at(s).unwrap().translation.vector;
        let error = |&(s, p): &(f64, Vector3<f64>)| (point(s) - p).norm();
        let all: Vec<f64> = shape.stations.iter().map(error).collect();
        (all.iter().sum::<f64>() / all.len() as f64, all[13])
    });
    let (stations, tips) = errors.collect::<Vec<_>>().into_iter().unzip();
    [stations, tips]
}

/// The positions are given to 0.1 mm, 0.017 % of the length.
#[test]
fn chains_of_discs_take_the_shapes_of_a_cosserat_rod() {
    let shapes = shapes();
    assert_eq!(shapes.len(), 500);
    for (discs, [mean_bound, worst_bound]) in BOUNDS {
        // Whether a shape is stable is told by its motion, which takes far longer than to find it. The table has all.
        let every = if discs == 50 { 5 } else { 20 };
        let [_, tips] = errors(&shapes, every, discs).map(summary);
        let [mean, _, worst] = tips.map(|error| 100.0 * error / LENGTH);
        assert!(mean < mean_bound, "{discs} discs: mean {mean} %");
        assert!(worst < worst_bound, "{discs} discs: worst {worst} %");
    }
}

/// By number of discs, the largest mean and the largest error at the tip, in percent of the length.
const BOUNDS: [(usize, [f64; 2]); 3] = [(25, [0.1, 0.5]), (50, [0.03, 0.15]), (100, [0.03, 0.15])];

#[test]
#[ignore = "prints the table of docs/validation.md"]
#[allow(clippy::print_stdout, reason = "that is what it is for")]
fn the_table_of_errors() {
    println!(
        "| discs | where | mean (mm) | worst (mm) | mean (%) | median (%) | worst (%) | ms a shape |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    let shapes = shapes();
    for discs in [12, 25, 50, 100, 200] {
        let start = std::time::Instant::now();
        shapes.iter().for_each(|shape| drop(settle(shape, discs)));
        let each = 1e3 * start.elapsed().as_secs_f64() / shapes.len() as f64;
        let errors = errors(&shapes, 1, discs).map(summary);
        for (what, errors) in ["14 stations", "tip"].iter().zip(errors) {
            let [mean, median, worst] = errors.map(|error| error * 1e3);
            let share = 100.0 / (LENGTH * 1e3);
            println!(
                "| {discs} | {what} | {mean:.3} | {worst:.3} | {:.3} | {:.3} | {:.3} | {each:.2} |",
                mean * share,
                median * share,
                worst * share
            );
        }
    }
}

/// With the weight on the discs' origins, half a pitch off, the error would only halve.
#[test]
fn a_rod_under_its_weight_converges_with_the_square_of_the_pitch() {
    let tip = |discs: usize| {
        let mut spec = rod(discs);
        spec.gravity = [0.0, 9.81, 0.0];
        let robot = Robot::new(spec).unwrap();
        let settled = robot.settle(&robot.command(&[]).unwrap(), &Loads::default());
        assert!(settled.converged);
        settled.positions[discs - 1]
    };
    let limit = tip(640);
    assert!(limit.y > 0.03, "it sags: {limit}");
    let errors = [20, 40, 80].map(|discs| (tip(discs) - limit).norm());
    for pair in errors.windows(2) {
        assert!(pair[0] / pair[1] > 3.5, "{errors:?}");
    }
}

//! Follow the leader: a robot of three segments is deployed along a curve in space; its body stays on the curve that its tip has gone.
//!
//! `cargo run --release --example follow_the_leader [picture.svg]`
#![allow(clippy::print_stdout, reason = "an example shows its result on stdout")]

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use nalgebra::Vector3;
use tdcr::control::plan::follow_the_leader::{BaseMotion, Deployment, deploy};
use tdcr::report::{Aspect, Figure, Ink, Mark, Panel, Scale, Shape};
use tdcr::sim::robot::{Loads, Robot, RobotSpec};

const MM: f64 = 1e3;
/// Control points of the Bezier curve (m).
const CURVE: [[f64; 3]; 4] = [
    [0.0, 0.0, 0.0],
    [0.0, 0.0, 0.07],
    [0.08, 0.0, 0.05],
    [0.07, 0.05, 0.13],
];
/// Largest tension of a tendon (N).
const TENSION: f64 = 25.0;
const STAGES: usize = 41;
/// Stages between two that are drawn.
const EVERY: usize = 8;

fn main() -> Result<()> {
    let path = std::env::args()
        .nth(1)
        .map_or_else(|| "follow_the_leader.svg".into(), PathBuf::from);
    run(&path)
}

/// Runs the example and writes its picture to `path`.
pub fn run(path: &Path) -> Result<()> {
    let mut spec = RobotSpec::load(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/examples/three-segments.toml"
    ))?;
    for module in &mut spec.modules {
        let tendons = module.tendons.as_mut().context("a module has tendons")?;
        tendons.range = [0.0, TENSION];
    }
    let robot = Robot::new(spec)?;
    let length = robot.arc_lengths().last().copied().unwrap_or_default();
    let curve: Vec<_> = (0..=200).map(|k| bezier(f64::from(k) / 200.0)).collect();
    let deployed = [BaseMotion::Free, BaseMotion::Carriage].map(|motion| {
        let deployment = deploy(&robot, &Loads::default(), &curve, motion, STAGES)?;
        println!(
            "{motion:?}: {:.2} % of the robot's length off the curve in the mean, {:.2} % at the worst stage",
            100.0 * deployment.mean_deviation / length,
            100.0 * deployment.largest_deviation / length
        );
        Ok(deployment)
    });
    let [free, carriage]: [Result<Deployment>; 2] = deployed;
    std::fs::write(path, figure(&curve, length, &free?, &carriage?).to_svg())?;
    println!("picture: {}", path.display());
    Ok(())
}

fn bezier(t: f64) -> Vector3<f64> {
    let s = 1.0 - t;
    let weights = [s * s * s, 3.0 * t * s * s, 3.0 * t * t * s, t * t * t];
    CURVE
        .iter()
        .zip(weights)
        .map(|(point, weight)| Vector3::from(*point) * weight)
        .sum()
}

fn figure(curve: &[Vector3<f64>], length: f64, free: &Deployment, carriage: &Deployment) -> Figure {
    let view = |title: &str, across: usize, deployment: &Deployment| {
        let flat = |p: &Vector3<f64>| [p[across] * MM, p.z * MM];
        let mut marks = vec![mark(
            "curve",
            Shape::Line,
            Ink::Black,
            curve.iter().map(flat).collect(),
        )];
        for stage in deployment.stages.iter().step_by(EVERY) {
            let base = stage.base.translation.vector;
            let backbone = std::iter::once(&base).chain(&stage.positions).map(flat);
            let last = stage.arc_length == deployment.stages[STAGES - 1].arc_length;
            let (name, ink) = if last {
                ("at last", Ink::Blue)
            } else {
                ("", Ink::Grey)
            };
            marks.push(mark(name, Shape::Line, ink, backbone.collect()));
        }
        let bases = deployment
            .stages
            .iter()
            .map(|stage| flat(&stage.base.translation.vector));
        marks.push(mark(
            "base",
            Shape::Dots,
            Ink::Vermilion,
            bases.step_by(EVERY).collect(),
        ));
        Panel {
            title: title.into(),
            x: Scale::linear(["x (mm)", "y (mm)"][across]),
            y: Scale::linear("z (mm)"),
            aspect: Aspect::Equal,
            marks,
        }
    };
    let deviations = |deployment: &Deployment| {
        let stages = deployment.stages.iter();
        stages
            .map(|stage| [stage.arc_length * MM, 100.0 * stage.deviation / length])
            .collect()
    };
    Figure {
        title: "Follow the leader".into(),
        caption: format!(
            "A robot of three segments, {:.0} mm long, under gravity, deployed along a curve in space (black). Left and middle: its backbone at every \
             {EVERY}th stage, its base carried freely. Right: how far the part on the curve is from it in the mean, over the robot's length.",
            length * MM
        ),
        panels: vec![
            view("From the front", 0, free),
            view("From the side", 1, free),
            Panel {
                title: "Deviation".into(),
                x: Scale::linear("tip along the curve (mm)"),
                y: Scale::linear("deviation (% of the length)"),
                aspect: Aspect::Free,
                marks: vec![
                    mark("base free", Shape::Line, Ink::Blue, deviations(free)),
                    mark(
                        "on a carriage",
                        Shape::Line,
                        Ink::Vermilion,
                        deviations(carriage),
                    ),
                ],
            },
        ],
    }
}

fn mark(name: &str, shape: Shape, ink: Ink, points: Vec<[f64; 2]>) -> Mark {
    Mark {
        name: name.to_owned(),
        shape,
        ink,
        points,
    }
}

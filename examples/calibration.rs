//! Calibration: gain, stiffness, hole radius and density of a 2-module robot on an elastic backbone,
//! from 100 measured configurations.
//!
//! `cargo run --release --example calibration [picture.svg]`
#![allow(clippy::print_stdout, reason = "an example shows its result on stdout")]

use std::path::{Path, PathBuf};

use anyhow::Result;
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use tdcr::report::{Aspect, Figure, Ink, Mark, Panel, Scale, Shape};
use tdcr::sim::inverse::calibration::{
    Calibration, CalibrationSettings, Finding, Observation, Unknown, calibrate,
};
use tdcr::sim::robot::{
    Axis, Backbone, Body, Command, Loads, Parameter, PerDisc, Robot, RobotSpec,
};

const MM: f64 = 1e3;
/// Standard deviation of each measured coordinate (m).
const NOISE: f64 = 5e-4;
/// What the robot really is, in the order of [`unknowns`].
const TRUTH: [f64; 4] = [455.0, 0.033, 0.0129, 31.0];

fn main() -> Result<()> {
    let path = std::env::args()
        .nth(1)
        .map_or_else(|| "calibration.svg".into(), PathBuf::from);
    run(&path)
}

/// Runs the example and writes its picture to `path`.
pub fn run(path: &Path) -> Result<()> {
    let nominal = nominal()?;
    let unknowns = unknowns(&nominal);
    let mut real = nominal.clone();
    for (unknown, truth) in unknowns.iter().zip(TRUTH) {
        real = unknown.set(&real, truth)?;
    }
    println!("100 commands, payloads up to 30 g, discs 4 and 9 measured with errors of 0.5 mm:");
    let settings = CalibrationSettings::default();
    let found = calibrate(&nominal, &unknowns, &measure(&real, 0.03)?, &settings)?;
    print_findings(&unknowns, &found);

    println!("the same without payloads:");
    let unloaded = calibrate(&nominal, &unknowns, &measure(&real, 0.0)?, &settings)?;
    print_findings(&unknowns, &unloaded);

    let errors = [&nominal, &found.spec].map(|spec| tip_errors(spec, &real));
    let [before, after] = errors.map(|errors| errors.map(sorted));
    let (before, after) = (before?, after?);
    let (b, a) = (before[before.len() / 2] * MM, after[after.len() / 2] * MM);
    println!("tip of 200 new commands: median error {b:.2} mm before, {a:.3} mm after");
    std::fs::write(path, figure(&unknowns, &found, &before, &after).to_svg())?;
    println!("picture: {}", path.display());
    Ok(())
}

/// The robot as it was designed.
fn nominal() -> Result<RobotSpec> {
    let mut spec = RobotSpec::load("2m")?;
    spec.name = "2m on a backbone".into();
    for module in &mut spec.modules {
        module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(0.04)));
    }
    Ok(spec)
}

fn unknowns(spec: &RobotSpec) -> [Unknown; 4] {
    let modules = 0..spec.modules.len();
    let bending = |m| {
        Axis::ALL[..2]
            .iter()
            .map(move |&axis| Parameter::Bending(m, axis))
    };
    let bodies = [Body::Base, Body::Disc(0), Body::Disc(5)];
    [
        Unknown::shared("gain", (0..spec.tendon_count()).map(Parameter::Gain)),
        Unknown::shared("bending stiffness", modules.clone().flat_map(bending)),
        Unknown::shared("hole radius", bodies.map(Parameter::HoleRadius)),
        Unknown::shared("density", modules.map(Parameter::Density)),
    ]
}

/// 100 observations of the real robot, under payloads of up to `payload` kg.
fn measure(real: &RobotSpec, payload: f64) -> Result<Vec<Observation>> {
    let robot = Robot::new(real.clone())?;
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let error = Normal::new(0.0, NOISE)?;
    let mut observe = || {
        let command = robot.random_command(&mut rng);
        let loads = Loads::payload(payload * rng.random::<f64>())?;
        let settled = robot.settle(&command, &loads);
        let positions = [4, 9].map(|disc| {
            let miss = Vector3::from_fn(|_, _| error.sample(&mut rng));
            (disc, settled.positions[disc] + miss)
        });
        Ok(Observation {
            command,
            loads,
            positions: positions.to_vec(),
        })
    };
    (0..100).map(|_| observe()).collect()
}

fn print_findings(unknowns: &[Unknown], found: &Calibration) {
    let names = |with: &[usize]| -> String {
        let names: Vec<_> = with.iter().map(|&k| unknowns[k].name()).collect();
        names.join(" and ")
    };
    for (k, (unknown, finding)) in unknowns
        .iter()
        .zip(&found.identification.findings)
        .enumerate()
    {
        let (name, unit, truth) = (unknown.name(), unknown.unit(), TRUTH[k]);
        let said = match finding {
            Finding::Identified(e) => {
                let [low, high] = e.interval;
                let (value, error) = (e.value, e.standard_error);
                format!(
                    "{value:.5} +- {error:.5} {unit}, 95 % in {low:.5} to {high:.5} (truth {truth})"
                )
            }
            Finding::Confounded { with } => format!("cannot be told from {}", names(with)),
            Finding::Undetermined { standard_error } => {
                format!("lost in the noise (standard error {standard_error:.3} {unit})")
            }
            Finding::NoEffect => "has no effect on what was measured".to_owned(),
            Finding::AtBound(value) => format!("at its bound, {value} {unit}"),
        };
        println!("  {name:18} {said}");
    }
    let identification = &found.identification;
    println!(
        "  {:?}: residuals {:.3} mm, noise {:.3} mm, condition number {:.0}",
        found.state,
        found.residual_rms * MM,
        identification.noise * MM,
        identification.condition
    );
}

/// Distances (m) between the tips of a robot and the real one under new commands.
fn tip_errors(spec: &RobotSpec, real: &RobotSpec) -> Result<Vec<f64>> {
    let robots = [spec, real].map(|spec| Robot::new(spec.clone()));
    let [robot, real] = robots;
    let (robot, real) = (robot?, real?);
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let commands: Vec<Command> = (0..200).map(|_| real.random_command(&mut rng)).collect();
    let loads = Loads::payload(0.01)?;
    let [found, true_ones] = [&robot, &real].map(|robot| robot.settle_batch(&commands, &loads));
    let apart = found
        .iter()
        .zip(&true_ones)
        .map(|(a, b)| (a.positions[9] - b.positions[9]).norm());
    Ok(apart.collect())
}

fn sorted(mut values: Vec<f64>) -> Vec<f64> {
    values.sort_by(f64::total_cmp);
    values
}

fn figure(unknowns: &[Unknown], found: &Calibration, before: &[f64], after: &[f64]) -> Figure {
    let percent = |k: usize, value: f64| 100.0 * (value / TRUTH[k] - 1.0);
    let mut intervals = Vec::new();
    let mut values = Vec::new();
    for (k, finding) in found.identification.findings.iter().enumerate() {
        if let Finding::Identified(estimate) = finding {
            let ends = estimate.interval.map(|end| [percent(k, end), k as f64]);
            intervals.push(mark("", Shape::Line, Ink::Blue, ends.to_vec()));
            values.push([percent(k, estimate.value), k as f64]);
        }
    }
    let mut marks = vec![mark(
        "truth",
        Shape::Dashes,
        Ink::Black,
        vec![[0.0, -0.5], [0.0, 3.5]],
    )];
    marks.extend(intervals);
    marks.push(mark(
        "estimate, with its 95 % interval",
        Shape::Dots,
        Ink::Blue,
        values,
    ));
    let share = |errors: &[f64]| -> Vec<[f64; 2]> {
        let count = errors.len() as f64;
        let point = |(k, error): (usize, &f64)| [error * MM, 100.0 * (k + 1) as f64 / count];
        errors.iter().enumerate().map(point).collect()
    };
    Figure {
        title: "A robot calibrated from 100 measured configurations".into(),
        caption: "Left: estimates from positions of two discs with errors of 0.5 mm, relative to the \
                  robot that was measured. Right: how far the tip that is computed is from the true one, \
                  for 200 commands that were not measured; the height of a curve is the share of \
                  commands with at most the error below it."
            .into(),
        panels: vec![
            Panel {
                title: "Estimates".into(),
                x: Scale::linear("difference from the truth (%)"),
                y: Scale::Names(unknowns.iter().map(|u| u.name().to_owned()).collect()),
                aspect: Aspect::Free,
                marks,
            },
            Panel {
                title: "Tip errors on new commands".into(),
                x: Scale::log("distance of the tip from the true one (mm)"),
                y: Scale::linear("commands below (%)"),
                aspect: Aspect::Free,
                marks: vec![
                    mark("as designed", Shape::Line, Ink::Vermilion, share(before)),
                    mark("calibrated", Shape::Line, Ink::Blue, share(after)),
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

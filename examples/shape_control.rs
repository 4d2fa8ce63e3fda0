//! Shape control: the 3m robot's tip follows a circle that is partly out of its reach, and its whole
//! backbone takes a curve.
//!
//! `cargo run --release --example shape_control [picture.svg]`
#![allow(clippy::print_stdout, reason = "an example shows its result on stdout")]

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use anyhow::Result;
use nalgebra::Vector3;
use tdcr::report::{Aspect, Figure, Ink, Mark, Panel, Scale, Shape};
use tdcr::sim::inverse::shape::{Goal, Outcome, Search, ShapeController, ShapeSolution, Target};
use tdcr::sim::robot::{Loads, Robot};

const MM: f64 = 1e3;
/// Targets on the circle.
const TARGETS: usize = 72;

fn main() -> Result<()> {
    let path = std::env::args()
        .nth(1)
        .map_or_else(|| "shape_control.svg".into(), PathBuf::from);
    run(&path)
}

/// Runs the example and writes its picture to `path`.
pub fn run(path: &Path) -> Result<()> {
    let robot = Robot::load("3m")?;
    let loads = Loads::payload(0.01)?;
    let controller = ShapeController::new(&robot, &loads, Search::default())?;

    let circle = circle();
    let followed = follow(&robot, &controller, &circle)?;
    let reached = followed
        .iter()
        .filter(|found| found.outcome == Outcome::Reached);
    println!(
        "circle: {} of {TARGETS} targets reached to 1e-6 m",
        reached.count()
    );
    for (k, found) in followed.iter().enumerate() {
        if let Outcome::Unreachable { active, gap } = &found.outcome {
            let tendons: Vec<_> = active.iter().map(|bound| bound.tendon).collect();
            let left = found.errors[0] * MM;
            println!(
                "  target {k:2}: {left:6.2} mm left, tendons {tendons:?} at their ends (gap {gap:.0e} m)"
            );
        }
    }

    let curve = bend(&robot);
    let bent = controller.reach(&curve)?;
    let worst = bent.errors.iter().copied().fold(0.0, f64::max);
    println!(
        "backbone: largest distance from the curve {:.2} mm",
        worst * MM
    );

    std::fs::write(
        path,
        figure(&robot, &circle, &followed, &curve, &bent).to_svg(),
    )?;
    println!("picture: {}", path.display());
    Ok(())
}

/// Positions (m) on a level circle beside the robot.
fn circle() -> Vec<Vector3<f64>> {
    let at = |k: usize| {
        let (sin, cos) = (TAU * k as f64 / TARGETS as f64).sin_cos();
        Vector3::new(0.12 + 0.07 * cos, 0.07 * sin, 0.33)
    };
    (0..TARGETS).map(at).collect()
}

/// Every target from the last one's command, so that the robot moves without jumps; a target that is
/// not reached so is sought afresh.
fn follow(
    robot: &Robot,
    controller: &ShapeController,
    path: &[Vector3<f64>],
) -> Result<Vec<ShapeSolution>> {
    let mut found: Vec<ShapeSolution> = Vec::new();
    for position in path {
        let target = [Target::tip(robot, *position)];
        let near = found
            .last()
            .map(|last| controller.reach_from(&target, &last.command));
        found.push(match near.transpose()? {
            Some(near) if near.outcome == Outcome::Reached => near,
            _ => controller.reach(&target)?,
        });
    }
    Ok(found)
}

/// All discs on an arc that bends by a right angle over 0.25 m, in the plane at 30 degrees to x.
fn bend(robot: &Robot) -> Vec<Target> {
    let (sin, cos) = (TAU / 12.0).sin_cos();
    let curvature = 0.25 * TAU / 0.25;
    let base = Vector3::from(robot.spec().base.position);
    Target::along(robot, |s| {
        let angle = curvature * s;
        let out = (1.0 - angle.cos()) / curvature;
        base + Vector3::new(out * cos, out * sin, angle.sin() / curvature)
    })
}

fn figure(
    robot: &Robot,
    circle: &[Vector3<f64>],
    followed: &[ShapeSolution],
    curve: &[Target],
    bent: &ShapeSolution,
) -> Figure {
    let tip = robot.discs().len() - 1;
    let top = |p: &Vector3<f64>| [p.x * MM, p.y * MM];
    let tips = |reached: bool| -> Vec<[f64; 2]> {
        let such = followed
            .iter()
            .filter(|f| (f.outcome == Outcome::Reached) == reached);
        such.map(|f| top(&f.equilibrium.positions[tip])).collect()
    };
    let wanted = circle.iter().chain(circle.first()).map(top).collect();
    let from_above = Panel {
        title: "Tip on a circle, from above".into(),
        x: Scale::linear("x (mm)"),
        y: Scale::linear("y (mm)"),
        aspect: Aspect::Equal,
        marks: vec![
            mark("asked for", Shape::Line, Ink::Grey, wanted),
            mark("reached", Shape::Dots, Ink::Blue, tips(true)),
            mark(
                "out of reach: nearest point",
                Shape::Dots,
                Ink::Vermilion,
                tips(false),
            ),
        ],
    };
    let base = Vector3::from(robot.spec().base.position);
    let (sin, cos) = (TAU / 12.0).sin_cos();
    let side = |p: &Vector3<f64>| [(p.x * cos + p.y * sin) * MM, p.z * MM];
    let on_curve = curve.iter().filter_map(|target| match target.goal {
        Goal::Position(position) => Some(side(&position)),
        _ => None,
    });
    let backbone = std::iter::once(&base)
        .chain(&bent.equilibrium.positions)
        .map(side)
        .collect();
    let from_side = Panel {
        title: "Discs on an arc, from its side".into(),
        x: Scale::linear("distance from the axis (mm)"),
        y: Scale::linear("height (mm)"),
        aspect: Aspect::Equal,
        marks: vec![
            mark("settled backbone", Shape::Line, Ink::Blue, backbone),
            mark("asked for", Shape::Dots, Ink::Grey, on_curve.collect()),
        ],
    };
    Figure {
        title: "Commands for target shapes: the 3m robot with 10 g on its tip".into(),
        caption: format!(
            "Left: the tip is led around a level circle, each command starting from the last; where \
             the circle is out of reach, the nearest point that the tendons' ranges allow is taken and \
             reported as such. Middle: the commands, and dashed the ends of their range. Right: every \
             disc is asked to lie on an arc, by least squares; the largest distance left is {:.1} mm.",
            bent.errors.iter().copied().fold(0.0, f64::max) * MM
        ),
        panels: vec![from_above, commands(robot, followed), from_side],
    }
}

fn commands(robot: &Robot, followed: &[ShapeSolution]) -> Panel {
    let modules = [Ink::Blue, Ink::Green, Ink::Purple];
    let mut marks: Vec<Mark> = (0..robot.tendons().len())
        .map(|tendon| {
            let name = match tendon % 3 {
                0 => format!("tendons of module {}", tendon / 3 + 1),
                _ => String::new(),
            };
            let value = |(k, f): (usize, &ShapeSolution)| {
                [
                    360.0 * k as f64 / TARGETS as f64,
                    f.command.as_slice()[tendon] * MM,
                ]
            };
            let points = followed.iter().enumerate().map(value).collect();
            mark(&name, Shape::Line, modules[tendon / 3], points)
        })
        .collect();
    for end in robot.tendons()[0].range {
        marks.push(mark(
            "",
            Shape::Dashes,
            Ink::Black,
            vec![[0.0, end * MM], [355.0, end * MM]],
        ));
    }
    Panel {
        title: "Commands along the circle".into(),
        x: Scale::linear("angle on the circle (degrees)"),
        y: Scale::linear("command: rest length (mm)"),
        aspect: Aspect::Free,
        marks,
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

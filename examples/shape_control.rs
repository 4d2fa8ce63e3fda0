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
use tdcr::sim::inverse::shape::{
    Arrival, Goal, Outcome, PathPoint, Search, ShapeController, ShapeSolution, Target,
};
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
    let points = follow(&robot, &controller, &circle)?;
    let followed: Vec<_> = points.iter().map(|point| &point.solution).collect();
    let reached = followed
        .iter()
        .filter(|found| found.outcome == Outcome::Reached);
    println!(
        "circle: {} of {TARGETS} targets reached to 1e-6 m",
        reached.count()
    );
    print_changes(&circle, &points);
    for (k, found) in followed.iter().enumerate() {
        if let Outcome::Unreachable { active, gap, .. } = &found.outcome {
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

/// Leads the tip along the path, each command as near to the last as can be, so that the robot moves
/// without jumps where there is such a way.
fn follow(
    robot: &Robot,
    controller: &ShapeController,
    path: &[Vector3<f64>],
) -> Result<Vec<PathPoint>> {
    let mut follower = controller.path();
    let follow = |position: &Vector3<f64>| Ok(follower.follow(&[Target::tip(robot, *position)])?);
    path.iter().map(follow).collect()
}

/// Says how far commands and discs moved at most from one target to the next, and where the robot had to
/// jump.
fn print_changes(circle: &[Vector3<f64>], followed: &[PathPoint]) {
    let largest = |change: fn(&PathPoint) -> f64| {
        let all = followed.iter().map(change).enumerate();
        all.fold(
            (0, 0.0),
            |most, next| if next.1 > most.1 { next } else { most },
        )
    };
    let (at_command, command) = largest(|point| point.command_change);
    let (at_disc, disc) = largest(|point| point.disc_change);
    println!(
        "  targets {:.2} mm apart; largest change of a command {:.2} mm (target {at_command}), of a \
         disc's position {:.2} mm (target {at_disc})",
        (circle[1] - circle[0]).norm() * MM,
        command * MM,
        disc * MM
    );
    let switched: Vec<usize> = (0..followed.len())
        .filter(|&k| followed[k].arrival == Arrival::Switched)
        .collect();
    match switched.is_empty() {
        true => println!("  on one branch of solutions all the way"),
        false => {
            println!("  the robot jumps to another branch of solutions at targets {switched:?}")
        }
    }
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
    followed: &[&ShapeSolution],
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
            "Left: the tip is led around a level circle, each command as near to the last as can be; where \
             the circle is out of reach, the nearest point that the tendons' ranges allow is taken and \
             reported as such. Middle: the commands, and dashed the ends of their range. Right: every \
             disc is asked to lie on an arc, by least squares; the largest distance left is {:.1} mm.",
            bent.errors.iter().copied().fold(0.0, f64::max) * MM
        ),
        panels: vec![from_above, commands(robot, followed), from_side],
    }
}

fn commands(robot: &Robot, followed: &[&ShapeSolution]) -> Panel {
    let modules = [Ink::Blue, Ink::Green, Ink::Purple];
    let mut marks: Vec<Mark> = (0..robot.tendons().len())
        .map(|tendon| {
            let name = match tendon % 3 {
                0 => format!("tendons of module {}", tendon / 3 + 1),
                _ => String::new(),
            };
            let value = |(k, f): (usize, &&ShapeSolution)| {
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

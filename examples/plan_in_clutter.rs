//! A motion among obstacles: the 3m robot goes from one side of a row of balls to the other, where a straight change of its command
//! would run into them.
//!
//! `cargo run --release --example plan_in_clutter [picture.svg]`
#![allow(clippy::print_stdout, reason = "an example shows its result on stdout")]

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use anyhow::Result;
use nalgebra::Vector3;
use tdcr::control::plan::{Goal, MotionPlan, MotionPlanner, PlanSettings, Stance};
use tdcr::report::{Aspect, Figure, Ink, Mark, Panel, Scale, Shape};
use tdcr::sim::inverse::shape::{Search, ShapeController, Target};
use tdcr::sim::robot::{Loads, Robot};
use tdcr::sim::scene::{Obstacle, Scene};

const MM: f64 = 1e3;
/// Balls: middle and radius (m).
const BALLS: [([f64; 3], f64); 8] = [
    ([0.09, 0.0, 0.33], 0.022),
    ([0.14, 0.0, 0.30], 0.022),
    ([0.05, 0.01, 0.42], 0.020),
    ([0.12, -0.01, 0.38], 0.018),
    ([0.17, 0.02, 0.36], 0.016),
    ([0.16, 0.03, 0.25], 0.020),
    ([-0.10, 0.09, 0.33], 0.025),
    ([-0.09, -0.07, 0.36], 0.022),
];
/// Where the tip is at first and at last (m).
const TIPS: [[f64; 3]; 2] = [[0.12, -0.10, 0.31], [0.12, 0.10, 0.31]];
/// Least distance of discs and balls (m).
const CLEARANCE: f64 = 0.004;
/// Backbones that are drawn.
const SHOWN: usize = 9;

fn main() -> Result<()> {
    let path = std::env::args()
        .nth(1)
        .map_or_else(|| "plan_in_clutter.svg".into(), PathBuf::from);
    run(&path)
}

/// Runs the example and writes its picture to `path`.
pub fn run(path: &Path) -> Result<()> {
    let robot = Robot::load("3m")?;
    let loads = Loads::default();
    let balls = BALLS.iter().enumerate().map(|(number, (place, radius))| {
        Ok(Obstacle::sphere(&format!("ball {number}"), *radius)?.at(*place))
    });
    let scene = Scene::new(balls.collect::<Result<_>>()?)?;
    let controller = ShapeController::new(&robot, &loads, Search::default())?;
    let start = controller.reach(&[Target::tip(&robot, TIPS[0].into())])?;
    let settings = PlanSettings {
        clearance: CLEARANCE,
        ..PlanSettings::default()
    };
    let mut planner = MotionPlanner::new(&robot, &scene, &loads, settings)?;
    let plan = planner.plan(&Stance::from(start.command), &Goal::Tip(TIPS[1].into()))?;
    let nearest = (plan.steps.iter().filter_map(|step| step.clearance)).fold(f64::MAX, f64::min);
    println!(
        "{} steps, {} places reached, {} equilibria solved for",
        plan.steps.len() - 1,
        plan.effort.nodes,
        plan.effort.settled
    );
    println!(
        "at the steps the balls are {:.1} mm away at least",
        nearest * MM
    );
    let straight = straight(&mut planner, &plan)?;
    let deepest = straight
        .iter()
        .map(|[_, away]| *away)
        .fold(f64::MAX, f64::min);
    println!("on a straight line of commands {deepest:.1} mm");
    std::fs::write(path, figure(&robot, &plan, straight).to_svg())?;
    println!("picture: {}", path.display());
    Ok(())
}

/// Distance of discs and balls (mm) by the share of a straight line of commands (%).
fn straight(planner: &mut MotionPlanner, plan: &MotionPlan) -> Result<Vec<[f64; 2]>> {
    let ends = [&plan.steps[0], &plan.steps[plan.steps.len() - 1]];
    let [from, to] = ends.map(|step| step.stance.command.as_slice().to_vec());
    let steps = 100;
    let mut line = Vec::new();
    for step in 0..=steps {
        let share = f64::from(step) / f64::from(steps);
        let pairs = from.iter().zip(&to);
        let values: Vec<f64> = pairs.map(|(a, b)| a + share * (b - a)).collect();
        let there = planner.examine(&planner.robot().command(&values)?.into())?;
        line.extend(there.clearance.map(|away| [100.0 * share, away * MM]));
    }
    Ok(line)
}

fn figure(robot: &Robot, plan: &MotionPlan, straight: Vec<[f64; 2]>) -> Figure {
    let steps = &plan.steps;
    let shown = (0..SHOWN).map(|k| &steps[k * (steps.len() - 1) / (SHOWN - 1)]);
    let base = Vector3::from(robot.spec().base.position);
    let view = |title: &str, [across, up]: [usize; 2]| {
        let flat = |p: &Vector3<f64>| [p[across] * MM, p[up] * MM];
        let circle = |(place, radius): &([f64; 3], f64)| {
            let rim = |k: usize| {
                let (sin, cos) = (TAU * k as f64 / 48.0).sin_cos();
                [
                    (place[across] + radius * cos) * MM,
                    (place[up] + radius * sin) * MM,
                ]
            };
            (0..=48).map(rim).collect::<Vec<_>>()
        };
        let mut marks: Vec<Mark> = (BALLS.iter().map(circle))
            .map(|rim| mark("", Shape::Line, Ink::Black, rim))
            .collect();
        marks.extend(shown.clone().enumerate().map(|(k, step)| {
            let backbone = std::iter::once(&base).chain(&step.positions).map(flat);
            let (name, ink) = match k {
                0 => ("start", Ink::Green),
                _ if k == SHOWN - 1 => ("goal", Ink::Vermilion),
                _ => ("", Ink::Grey),
            };
            mark(name, Shape::Line, ink, backbone.collect())
        }));
        let tips = steps.iter().map(|step| flat(&step.tip)).collect();
        marks.push(mark("tip", Shape::Line, Ink::Blue, tips));
        Panel {
            title: title.into(),
            x: Scale::linear(["x (mm)", "y (mm)"][across]),
            y: Scale::linear(["x (mm)", "y (mm)", "z (mm)"][up]),
            aspect: Aspect::Equal,
            marks,
        }
    };
    let last = (steps.len() - 1) as f64;
    let planned = steps.iter().enumerate();
    let planned =
        planned.filter_map(|(k, step)| Some([100.0 * k as f64 / last, step.clearance? * MM]));
    let floor = vec![[0.0, CLEARANCE * MM], [100.0, CLEARANCE * MM]];
    Figure {
        title: "From one side of a row of balls to the other".into(),
        caption: format!(
            "Robot 3m; its discs keep {:.0} mm from all balls (black). Left and middle: backbones on the way (grey) and the tip's path. Right: \
             distance from the nearest ball along the plan, and along a straight line of commands, where discs would be in a ball below 0.",
            CLEARANCE * MM
        ),
        panels: vec![
            view("From the side", [1, 2]),
            view("From above", [0, 1]),
            Panel {
                title: "Distance from the nearest ball".into(),
                x: Scale::linear("way (%)"),
                y: Scale::linear("distance (mm)"),
                aspect: Aspect::Free,
                marks: vec![
                    mark("asked for", Shape::Line, Ink::Grey, floor),
                    mark("planned", Shape::Line, Ink::Blue, planned.collect()),
                    mark("straight", Shape::Line, Ink::Vermilion, straight),
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

//! A push: the 2m robot bends over a table, pushes a box, and the box a ball.
//!
//! `cargo run --release --example push [picture.svg]`
#![allow(clippy::print_stdout, reason = "an example shows its result on stdout")]

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use anyhow::Result;
use nalgebra::{Isometry3, Vector3};
use tdcr::report::{Aspect, Figure, Ink, Mark, Panel, Scale, Shape};
use tdcr::sim::contact::ContactStepper;
use tdcr::sim::dynamics::{Integrator, State, Stepper};
use tdcr::sim::robot::{Loads, Robot};
use tdcr::sim::scene::{Obstacle, Scene};

const MM: f64 = 1e3;
/// Time step (s), and how many of them.
const STEP: f64 = 2e-3;
const STEPS: usize = 1_000;
/// Every so many steps are drawn.
const SHOWN: usize = 125;
/// Sides of the box (m) and radius of the ball (m).
const BOX: [f64; 3] = [0.03, 0.06, 0.05];
const BALL: f64 = 0.015;
/// Command at the end of the push (m), a second from the middle of all ranges.
const PUSH: [f64; 6] = [0.034, 0.007, 0.001, 0.026, 0.015, 0.019];

fn main() -> Result<()> {
    let path = (std::env::args().nth(1)).map_or_else(|| "push.svg".into(), PathBuf::from);
    run(&path)
}

/// What is drawn of a moment: the backbone (m) and the objects' poses.
struct Moment {
    backbone: Vec<Vector3<f64>>,
    objects: [Isometry3<f64>; 2],
}

/// Runs the example and writes its picture to `path`.
pub fn run(path: &Path) -> Result<()> {
    let robot = Robot::load("2m")?;
    let table = Obstacle::cuboid("table", [0.3, 0.3, 0.02])?.at([-0.19, 0.0, 0.23]);
    let parcel = Obstacle::cuboid("box", BOX)?.at([-0.062, 0.0, 0.265]);
    let ball = Obstacle::sphere("ball", BALL)?.at([-0.11, 0.01, 0.255]);
    let scene = Scene::new(vec![
        table.with_friction(0.3)?,
        parcel.with_mass(0.02)?,
        ball.with_mass(0.01)?,
    ])?;
    let stepper = Stepper::new(&robot, STEP, Integrator::SemiImplicitEuler)?;
    let mut stepper = ContactStepper::new(stepper, &scene)?;
    let mut state = State::straight(&robot);
    let base = Vector3::from(robot.spec().base.position);
    let mut moments = Vec::new();
    let (mut forces, mut ways) = (Vec::new(), [Vec::new(), Vec::new()]);
    for step in 0..=STEPS {
        let poses = [0, 1].map(|object| stepper.objects()[object].pose);
        if step % SHOWN == 0 {
            let discs = state.positions(&robot);
            moments.push(Moment {
                backbone: std::iter::once(base).chain(discs).collect(),
                objects: poses,
            });
        }
        let time = STEP * step as f64;
        let force: Vector3<f64> = stepper.contacts().iter().map(|contact| contact.force).sum();
        forces.push([time, force.norm()]);
        for (way, pose) in ways.iter_mut().zip(&poses) {
            way.push([time, -pose.translation.vector.x * MM]);
        }
        let share = time.min(1.0);
        let mean = robot.mean_command();
        let pairs = mean.as_slice().iter().zip(&PUSH);
        let values: Vec<f64> = pairs.map(|(a, b)| a + share * (b - a)).collect();
        stepper.step(&mut state, &robot.command(&values)?, &Loads::default())?;
    }
    let pushed = |object: usize| ways[object][STEPS][1] - ways[object][0][1];
    println!(
        "the box is pushed by {:.1} mm, the ball by {:.1} mm",
        pushed(0),
        pushed(1)
    );
    let strongest = forces.iter().map(|[_, force]| *force).fold(0.0, f64::max);
    println!("the contacts with the robot bear up to {strongest:.1} N");
    std::fs::write(path, figure(&moments, forces, ways).to_svg())?;
    println!("picture: {}", path.display());
    Ok(())
}

fn figure(moments: &[Moment], forces: Vec<[f64; 2]>, ways: [Vec<[f64; 2]>; 2]) -> Figure {
    let view = |title: &str, [across, up]: [usize; 2]| {
        let flat = |p: &Vector3<f64>| [p[across] * MM, p[up] * MM];
        let mut marks = Vec::new();
        let last = moments.len() - 1;
        for (k, moment) in moments.iter().enumerate() {
            let ink = |late: Ink| match k {
                0 => Ink::Green,
                _ if k == last => late,
                _ => Ink::Grey,
            };
            let name = |name: &str| match k == last {
                true => name.to_owned(),
                false => String::new(),
            };
            let backbone = moment.backbone.iter().map(flat).collect();
            marks.push(mark(&name("robot"), ink(Ink::Blue), backbone));
            let outline = |points: Vec<Vector3<f64>>| points.iter().map(flat).collect();
            let [parcel, ball] = &moment.objects;
            marks.push(mark(
                &name("box"),
                ink(Ink::Vermilion),
                outline(rectangle(parcel, up)),
            ));
            marks.push(mark(
                &name("ball"),
                ink(Ink::Black),
                outline(circle(ball, up)),
            ));
        }
        Panel {
            title: title.into(),
            x: Scale::linear("x (mm)"),
            y: Scale::linear(["x (mm)", "y (mm)", "z (mm)"][up]),
            aspect: Aspect::Equal,
            marks,
        }
    };
    let [parcel, ball] = ways;
    let plot = |title: &str, what: &str, marks| Panel {
        title: title.into(),
        x: Scale::linear("time (s)"),
        y: Scale::linear(what),
        aspect: Aspect::Free,
        marks,
    };
    Figure {
        title: "A robot pushes a box, and the box a ball".into(),
        caption: format!(
            "Robot 2m, a box of 20 g and a ball of 10 g on a table with friction 0.3, every {:.2} s from the start (green) to the end (colours). \
             Right: how far they are, and the force of the contacts on the robot, highest where the box comes to a stop.",
            STEP * SHOWN as f64
        ),
        panels: vec![
            view("From the side", [0, 2]),
            view("From above", [0, 1]),
            plot(
                "How far",
                "-x (mm)",
                vec![
                    mark("box", Ink::Vermilion, parcel),
                    mark("ball", Ink::Black, ball),
                ],
            ),
            plot(
                "Force on the robot",
                "force (N)",
                vec![mark("robot", Ink::Blue, forces)],
            ),
        ],
    }
}

/// The outline of the box seen along y, where `up` is z, or from above (m).
fn rectangle(pose: &Isometry3<f64>, up: usize) -> Vec<Vector3<f64>> {
    let [x, y, z] = BOX.map(|side| side / 2.0);
    let corners = [
        [-1.0, -1.0],
        [1.0, -1.0],
        [1.0, 1.0],
        [-1.0, 1.0],
        [-1.0, -1.0],
    ];
    let corner = |[a, b]: [f64; 2]| match up {
        2 => Vector3::new(a * x, 0.0, b * z),
        _ => Vector3::new(a * x, b * y, 0.0),
    };
    corners
        .map(|signs| pose.transform_point(&corner(signs).into()).coords)
        .to_vec()
}

/// The outline of the ball in the same view (m).
fn circle(pose: &Isometry3<f64>, up: usize) -> Vec<Vector3<f64>> {
    let middle = pose.translation.vector;
    (0..=36)
        .map(|k| {
            let (sin, cos) = (TAU * f64::from(k) / 36.0).sin_cos();
            let mut rim = Vector3::new(BALL * cos, 0.0, 0.0);
            rim[up] = BALL * sin;
            middle + rim
        })
        .collect()
}

fn mark(name: &str, ink: Ink, points: Vec<[f64; 2]>) -> Mark {
    Mark {
        name: name.to_owned(),
        shape: Shape::Line,
        ink,
        points,
    }
}

//! Contact-aided navigation: a robot of three segments on an elastic rod is pushed from below into a bent pipe. Left alone it leans on
//! the wall; steered by derivatives of its equilibrium, contacts in them, it follows the pipe's axis.
//!
//! `cargo run --release --example contact_navigation [picture.svg]`
#![allow(clippy::print_stdout, reason = "an example shows its result on stdout")]

use std::path::{Path, PathBuf};

use anyhow::Result;
use nalgebra::{DMatrix, DVector, Vector3};
use tdcr::report::{Aspect, Figure, Ink, Mark, Panel, Scale, Shape};
use tdcr::sim::chain::Configuration;
use tdcr::sim::contact::{ContactEquilibrium, ContactSettler};
use tdcr::sim::geometry::Pipe;
use tdcr::sim::robot::{Command, Loads, Robot};
use tdcr::sim::scene::{Obstacle, Scene};

const MM: f64 = 1e3;
/// Radius of the pipe (m); the robot's discs have 0.006.
const RADIUS: f64 = 0.01;
/// The pipe's path (m): the straight robot stands with its tip in the mouth.
const PATH: [[f64; 3]; 3] = [[0.0, 0.0, 0.17], [0.0, 0.0, 0.24], [0.07, 0.0, 0.31]];
/// How far the robot is pushed in (m), and in which steps.
const DEPTH: f64 = 0.1;
const STEPS: usize = 50;
/// Tension of all tendons at the start (N).
const TENSION: f64 = 0.5;
/// Steps of Gauss and Newton at each depth, and what damps them (m²/N²).
const ITERATIONS: usize = 3;
const DAMPING: f64 = 1e-5;

fn main() -> Result<()> {
    let path = std::env::args()
        .nth(1)
        .map_or_else(|| "contact_navigation.svg".into(), PathBuf::from);
    run(&path)
}

/// Runs the example and writes its picture to `path`.
pub fn run(path: &Path) -> Result<()> {
    let robot = Robot::load(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/examples/three-segments.toml"
    ))?;
    let pipe = Pipe::along(RADIUS, &PATH)?;
    let scene = Scene::new(vec![Obstacle::pipe_along("pipe", RADIUS, &PATH)?])?;
    let alone = insert(&robot, &scene, |_, _, _| Ok(None))?;
    let steered = insert(&robot, &scene, |settler, command, found| {
        steer(settler, command, found, &pipe)
    })?;
    for (name, way) in [("left alone", &alone), ("steered", &steered)] {
        let most = way
            .iter()
            .map(|(_, found)| pressure(found))
            .fold(0.0, f64::max);
        let (depth, last) = &way[way.len() - 1];
        println!(
            "{name}: {:.0} mm deep, the walls bear {most:.3} N at most, {:.3} N at last",
            depth * MM,
            pressure(last)
        );
    }
    std::fs::write(path, figure(&robot, &pipe, &alone, &steered).to_svg())?;
    println!("picture: {}", path.display());
    Ok(())
}

/// Depth (m) and equilibrium of each step on the way in.
type Way = Vec<(f64, ContactEquilibrium)>;

/// Pushes the robot's base up step by step; at each depth `steer` may give another command.
fn insert(
    robot: &Robot,
    scene: &Scene,
    steer: impl Fn(&mut ContactSettler, &Command, &ContactEquilibrium) -> Result<Option<Command>>,
) -> Result<Way> {
    let loads = Loads::default();
    let mut command = robot.command(&vec![TENSION; robot.tendons().len()])?;
    let mut configuration = Configuration::straight(robot);
    let mut way = Way::new();
    for step in 0..=STEPS {
        let depth = DEPTH * step as f64 / STEPS as f64;
        let mut spec = robot.spec().clone();
        spec.base.position[2] += depth;
        let mut settler = ContactSettler::new(&Robot::new(spec)?, scene);
        let mut found = settler
            .settle_from(&configuration, &command, &loads)?
            .clone();
        for _ in 0..ITERATIONS {
            let Some(better) = steer(&mut settler, &command, &found)? else {
                break;
            };
            found = settler.follow(&better, &loads)?.clone();
            command = better;
        }
        anyhow::ensure!(found.equilibrium.converged, "not settled at {depth} m");
        configuration = found.equilibrium.configuration.clone();
        way.push((depth, found));
    }
    Ok(way)
}

/// A step of Gauss and Newton towards discs on the pipe's axis: least squares of their offsets, with the command's change damped.
fn steer(
    settler: &mut ContactSettler,
    command: &Command,
    found: &ContactEquilibrium,
    pipe: &Pipe,
) -> Result<Option<Command>> {
    let jacobian = settler.sensitivity(command, &Loads::default())?;
    let jacobian = jacobian.parameters().command_jacobian();
    let inside: Vec<(usize, Vector3<f64>)> = (found.equilibrium.positions.iter().enumerate())
        .filter(|(_, position)| position.z > PATH[0][2])
        .map(|(disc, position)| (disc, position - nearest_on_axis(pipe, position)))
        .collect();
    if inside.is_empty() {
        return Ok(None);
    }
    let tendons = command.as_slice().len();
    let mut slopes = DMatrix::zeros(3 * inside.len(), tendons);
    let mut offsets = DVector::zeros(3 * inside.len());
    for (row, (disc, offset)) in inside.iter().enumerate() {
        let own = jacobian.view((6 * disc, 0), (3, tendons));
        slopes.view_mut((3 * row, 0), (3, tendons)).copy_from(&own);
        offsets.rows_mut(3 * row, 3).copy_from(offset);
    }
    let normal = slopes.transpose() * &slopes + DMatrix::identity(tendons, tendons) * DAMPING;
    let Some(change) = normal
        .cholesky()
        .map(|factor| factor.solve(&slopes.tr_mul(&offsets)))
    else {
        return Ok(None);
    };
    let ranges = settler.robot().tendons().iter().map(|tendon| tendon.range);
    let values: Vec<f64> = (command.as_slice().iter().zip(change.iter()))
        .zip(ranges)
        .map(|((value, change), [low, high])| (value - change).clamp(low, high))
        .collect();
    Ok(Some(settler.robot().command(&values)?))
}

fn nearest_on_axis(pipe: &Pipe, point: &Vector3<f64>) -> Vector3<f64> {
    let count = 400;
    let places = (0..=count).map(|k| {
        pipe.axis_at(pipe.axis_length() * f64::from(k) / f64::from(count))
            .0
    });
    let distance = |place: &Vector3<f64>| (point - place).norm_squared();
    places
        .min_by(|a, b| distance(a).total_cmp(&distance(b)))
        .unwrap_or(*point)
}

/// Sum of the forces of all contacts (N).
fn pressure(found: &ContactEquilibrium) -> f64 {
    found
        .contacts
        .iter()
        .map(|contact| contact.force.norm())
        .sum()
}

fn figure(robot: &Robot, pipe: &Pipe, alone: &Way, steered: &Way) -> Figure {
    let side = |p: &Vector3<f64>| [p.x * MM, p.z * MM];
    let wall = |sign: f64| -> Vec<[f64; 2]> {
        let at = |k: usize| {
            let (place, along) = pipe.axis_at(pipe.axis_length() * k as f64 / 60.0);
            side(&(place + Vector3::y().cross(&along) * (sign * RADIUS)))
        };
        (0..=60).map(at).collect()
    };
    let backbone = |(depth, found): &(f64, ContactEquilibrium)| -> Vec<[f64; 2]> {
        let mut base = Vector3::from(robot.spec().base.position);
        base.z += depth;
        std::iter::once(&base)
            .chain(&found.equilibrium.positions)
            .map(side)
            .collect()
    };
    let last = |way: &Way| backbone(&way[way.len() - 1]);
    let discs: Vec<[f64; 2]> = (robot.discs().iter())
        .zip(&steered[STEPS].1.equilibrium.positions)
        .zip(&steered[STEPS].1.equilibrium.orientations)
        .flat_map(|((disc, place), turn)| {
            let across = turn * Vector3::x() * disc.radius;
            [side(&(place - across)), side(&(place + across))]
        })
        .collect();
    let mark = |name: &str, shape, ink, points| Mark {
        name: name.to_owned(),
        shape,
        ink,
        points,
    };
    let forces = |way: &Way| {
        way.iter()
            .map(|(depth, found)| [depth * MM, pressure(found)])
            .collect()
    };
    Figure {
        title: "A robot pushed into a bent pipe".into(),
        caption: format!(
            "A robot of three segments, its base pushed up by {:.0} mm into a pipe of {:.0} mm radius, without friction. Left: at last, from the side; \
             discs of the steered robot in grey. Right: the sum of all contact forces on the way.",
            DEPTH * MM,
            RADIUS * MM
        ),
        panels: vec![
            Panel {
                title: "At last".into(),
                x: Scale::linear("x (mm)"),
                y: Scale::linear("z (mm)"),
                aspect: Aspect::Equal,
                marks: vec![
                    mark("pipe", Shape::Line, Ink::Black, wall(1.0)),
                    mark("", Shape::Line, Ink::Black, wall(-1.0)),
                    mark("", Shape::Segments, Ink::Grey, discs),
                    mark("left alone", Shape::Line, Ink::Vermilion, last(alone)),
                    mark("steered", Shape::Line, Ink::Blue, last(steered)),
                ],
            },
            Panel {
                title: "Contact forces".into(),
                x: Scale::linear("pushed in (mm)"),
                y: Scale::linear("force of the walls (N)"),
                aspect: Aspect::Free,
                marks: vec![
                    mark("left alone", Shape::Line, Ink::Vermilion, forces(alone)),
                    mark("steered", Shape::Line, Ink::Blue, forces(steered)),
                ],
            },
        ],
    }
}

//! Pulls one tendon of the 2m robot, on an elastic backbone, and lets it go again, with more and more
//! friction in its holes, and draws the tip's hysteresis and how the tension falls from hole to hole.
//!
//! ```text
//! cargo run --release --example friction_loop [friction_loop.svg]
//! ```
#![allow(
    clippy::print_stdout,
    reason = "the table is what the example is run for"
)]

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use tdcr::report::{Aspect, Figure, Ink, Mark, Panel, Scale, Shape};
use tdcr::sim::robot::{Backbone, Friction, Loads, PerDisc, Robot, RobotSpec};
use tdcr::sim::tendon_friction::FrictionPath;

const MM: f64 = 1e3;
/// Coefficients of friction, and the ink that each is drawn in.
const COEFFICIENTS: [(f64, Ink); 4] = [
    (0.0, Ink::Grey),
    (0.05, Ink::Blue),
    (0.1, Ink::Green),
    (0.2, Ink::Vermilion),
];
/// Bending and torsion stiffness of every joint (N m/rad).
const BACKBONE: f64 = 0.2;
/// Commands of the tendons that are not driven (m).
const STILL: f64 = 0.03;
/// Commands of the driven tendon: pulled in and let out again (m).
const PULLED: f64 = 0.0;
const LET_OUT: f64 = 0.03;
/// Commands from one end to the other.
const STEPS: usize = 60;

/// What one coefficient of friction does.
struct Hysteresis {
    coefficient: f64,
    ink: Ink,
    /// Command of the driven tendon and the tip's x (mm), once around a closed loop.
    closed: Vec<[f64; 2]>,
    /// Turned into heat over the closed loop (mJ).
    dissipated: f64,
    /// Largest difference of the tip's x between pulling and letting out (mm).
    width: f64,
    /// Tensions of the driven tendon from the servo to its end, pulled in (N).
    tensions: Vec<f64>,
}

fn main() -> Result<()> {
    let path = std::env::args()
        .nth(1)
        .map_or_else(|| "friction_loop.svg".into(), PathBuf::from);
    run(&path)
}

/// Runs the example and writes its picture to `path`.
pub fn run(path: &Path) -> Result<()> {
    let loops = COEFFICIENTS
        .iter()
        .map(|&(coefficient, ink)| drive(coefficient, ink))
        .collect::<Result<Vec<_>>>()?;
    println!("  mu   dissipated (mJ)   loop width (mm)   end/servo tension");
    for turn in &loops {
        let arriving = turn.tensions[turn.tensions.len() - 1] / turn.tensions[0];
        println!(
            "{:4.2} {:17.3} {:17.2} {arriving:19.3}",
            turn.coefficient, turn.dissipated, turn.width
        );
    }
    std::fs::write(path, figure(&loops).to_svg())
        .with_context(|| format!("cannot write {}", path.display()))?;
    println!("picture: {}", path.display());
    Ok(())
}

/// Pulls the tendon and lets it out, twice: the second time is a closed loop.
fn drive(coefficient: f64, ink: Ink) -> Result<Hysteresis> {
    let robot = rough_robot(coefficient)?;
    let mut path = FrictionPath::new(&robot);
    stroke(&mut path, &robot, LET_OUT, PULLED)?;
    stroke(&mut path, &robot, PULLED, LET_OUT)?;
    let before = path.state().dissipated;
    let pulling = stroke(&mut path, &robot, LET_OUT, PULLED)?;
    let tensions = path.state().tendons[0].tensions.clone();
    let letting_out = stroke(&mut path, &robot, PULLED, LET_OUT)?;
    let gaps = pulling.iter().zip(letting_out.iter().rev());
    Ok(Hysteresis {
        coefficient,
        ink,
        width: gaps.map(|(a, b)| (a[1] - b[1]).abs()).fold(0.0, f64::max),
        closed: [pulling, letting_out].concat(),
        dissipated: 1e3 * (path.state().dissipated - before),
        tensions,
    })
}

fn rough_robot(coefficient: f64) -> Result<Robot> {
    let mut spec = RobotSpec::load("2m")?;
    for module in &mut spec.modules {
        module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(BACKBONE)));
        if let Some(tendons) = &mut module.tendons {
            tendons.friction = Some(Friction {
                coefficient,
                contact_stiffness: 1e5,
            });
        }
    }
    Ok(Robot::new(spec)?)
}

/// Moves the driven tendon's command; returns it and the tip's x at every step (mm).
fn stroke(path: &mut FrictionPath, robot: &Robot, from: f64, to: f64) -> Result<Vec<[f64; 2]>> {
    (0..=STEPS)
        .map(|step| {
            let first = from + (to - from) * step as f64 / STEPS as f64;
            let command = robot.command(&[first, STILL, STILL, STILL, STILL, STILL])?;
            let equilibrium = &path.advance(&command, &Loads::default()).equilibrium;
            ensure!(equilibrium.converged, "no equilibrium at {first} m");
            Ok([MM * first, MM * equilibrium.positions[9].x])
        })
        .collect()
}

fn figure(loops: &[Hysteresis]) -> Figure {
    let line = |turn: &Hysteresis, points| Mark {
        name: format!("friction {}", turn.coefficient),
        shape: Shape::Line,
        ink: turn.ink,
        points,
    };
    let paths = loops.iter().map(|turn| line(turn, turn.closed.clone()));
    let profiles = loops.iter().map(|turn| {
        let steps = turn.tensions.iter().enumerate();
        let points = steps.map(|(segment, tension)| [segment as f64, *tension]);
        line(turn, points.collect())
    });
    Figure {
        title: "2m robot on an elastic backbone, one tendon pulled and let out".into(),
        caption: format!(
            "Left: the tip lags behind, on the lower branch when the tendon is pulled. The other \
             tendons stay at {:.0} mm. Right: the tension along the pulled tendon falls from hole \
             to hole.",
            MM * STILL
        ),
        panels: vec![
            Panel {
                title: "Hysteresis".into(),
                x: Scale::linear("command: rest length of the tendon (mm)"),
                y: Scale::linear("tip x (mm)"),
                aspect: Aspect::Free,
                marks: paths.collect(),
            },
            Panel {
                title: "Tension, pulled in".into(),
                x: Scale::linear("segment, from the servo"),
                y: Scale::linear("tension (N)"),
                aspect: Aspect::Free,
                marks: profiles.collect(),
            },
        ],
    }
}

//! Bends a robot to three sides and sees it from all cameras, on whatever rig a file names: in memory or on the desk.
//!
//! ```text
//! cargo run --release --example rig [examples/rig-sim.toml]
//! ```
//!
//! Nothing here knows what the rig consists of. With your own file in place of `rig-sim.toml` (`rig-2m.toml` is a template), the
//! same program moves real servos.
#![allow(
    clippy::print_stdout,
    reason = "the table is what the example is run for"
)]

use std::f64::consts::TAU;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use tdcr::hw::capture::{Session, SessionSettings};
use tdcr::hw::plan::Bend;
use tdcr::hw::rig::{Homing, Rig};

/// Bend of the last module (rad).
const BEND: f64 = 0.6;

/// What was seen of a bend.
pub struct Seen {
    /// Where the robot was bent to (rad from x).
    pub direction: f64,
    /// Mean of the points that the cameras saw of it (m).
    pub middle: [f64; 3],
    /// Points.
    pub points: usize,
}

/// Bends the robot of the rig in a file and sees it.
pub fn run(path: &Path) -> Result<Vec<Seen>> {
    let mut rig = Rig::open(path)?;
    let known = rig.meet()?;
    if !known.iter().all(|servo| matches!(servo, Homing::Homed(_))) {
        // Servos without power forget their turns.
        rig.home_recalled()?;
    }
    let settings = SessionSettings::default();
    let mut go_on = || ControlFlow::Continue(());
    let mut session = Session::begin(&mut rig, &settings, None, &mut go_on)?;
    let mut seen = Vec::new();
    for side in 0..3 {
        let direction = TAU * f64::from(side) / 3.0;
        let mut shape = session.program().rest().clone();
        let last = shape.0.last_mut().context("a robot with modules")?;
        last.toward = Bend::new(direction, BEND, 0.0).toward;
        session.visit(shape)?;
        let captured = session.observe(side as u64)?;
        let count = captured.cloud.len() as f64;
        let mean = |axis: usize| {
            let along = captured
                .cloud
                .points
                .iter()
                .map(|point| f64::from(point[axis]));
            along.sum::<f64>() / count
        };
        let ticks: Vec<String> = captured
            .goals
            .iter()
            .map(|goal| goal.0.to_string())
            .collect();
        let middle = [mean(0), mean(1), mean(2)];
        println!(
            "bent to {:3.0} degrees: servos at {} ticks, {} points about ({:.1}, {:.1}, {:.1}) mm",
            direction.to_degrees(),
            ticks.join(" "),
            captured.cloud.len(),
            1e3 * middle[0],
            1e3 * middle[1],
            1e3 * middle[2],
        );
        seen.push(Seen {
            direction,
            middle,
            points: captured.cloud.len(),
        });
    }
    // Lets the tendons out and switches the motors off; so does whatever else ends the session.
    session.end()?;
    Ok(seen)
}

fn main() -> Result<()> {
    let default = || PathBuf::from("examples/rig-sim.toml");
    run(&std::env::args_os()
        .nth(1)
        .map_or_else(default, PathBuf::from))
    .map(drop)
    .context("the rig did not do what it should")
}

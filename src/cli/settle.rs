//! `tdcr settle`.

use std::fmt::Write;

use anyhow::bail;
use clap::Args;
use serde::Serialize;
use tdcr::sim::robot::{Loads, Robot};

use super::CommandArg;
use super::console::Console;

/// Settle a robot under one command: where its discs come to rest
#[derive(Debug, Args)]
pub(super) struct SettleArgs {
    /// 2m, 3m, 5m, or the path of a robot file (.toml, .json, .xml or .urdf)
    #[arg(long, default_value = "2m")]
    robot: String,
    #[command(flatten)]
    command: CommandArg,
    /// Mass hung from the tip disc (kg)
    #[arg(
        long,
        default_value_t = 0.0,
        allow_hyphen_values = true,
        value_name = "KG"
    )]
    payload: f64,
}

#[derive(Serialize)]
struct Settled {
    /// Disc origins, world frame (m).
    positions: Vec<[f64; 3]>,
    /// Disc orientations, world frame, unit quaternions (w, x, y, z).
    orientations: Vec<[f64; 4]>,
    tendon_lengths: Vec<f64>,
    tendon_tensions: Vec<f64>,
    residual: f64,
    iterations: usize,
    min_eigenvalue: f64,
    converged: bool,
}

pub(super) fn run(args: &SettleArgs, console: &Console) -> anyhow::Result<()> {
    let robot = Robot::new(super::load_robot(&args.robot)?)?;
    let command = robot.command(&args.command.lengths)?;
    let loads = Loads::payload(args.payload)?;
    let equilibrium = robot.settle(&command, &loads);
    let settled = Settled {
        min_eigenvalue: robot.smallest_stiffness(&command, &loads, &equilibrium.configuration),
        positions: equilibrium
            .positions
            .iter()
            .map(|p| [p.x, p.y, p.z])
            .collect(),
        orientations: equilibrium
            .orientations
            .iter()
            .map(|q| [q.w, q.i, q.j, q.k])
            .collect(),
        tendon_lengths: equilibrium.tendon_lengths,
        tendon_tensions: equilibrium.tendon_tensions,
        residual: equilibrium.residual,
        iterations: equilibrium.iterations,
        converged: equilibrium.converged,
    };
    console.result(&settled, table)?;
    if !settled.converged {
        bail!(
            "the robot did not settle: residual {:e} N m",
            settled.residual
        );
    }
    Ok(())
}

fn table(settled: &Settled) -> String {
    let mut text = String::from(
        "disc       x (m)      y (m)      z (m)         w         x         y         z\n",
    );
    for (disc, ([x, y, z], [w, i, j, k])) in settled
        .positions
        .iter()
        .zip(&settled.orientations)
        .enumerate()
    {
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{disc:4}  {x:10.6} {y:10.6} {z:10.6}  {w:8.5}  {i:8.5}  {j:8.5}  {k:8.5}"
        );
    }
    text.push_str("\ntendon  length (m)  tension (N)\n");
    for (tendon, (length, tension)) in settled
        .tendon_lengths
        .iter()
        .zip(&settled.tendon_tensions)
        .enumerate()
    {
        let _ = writeln!(text, "{tendon:6}  {length:10.6}  {tension:11.4}");
    }
    let _ = writeln!(
        text,
        "\n{} in {} Newton steps; residual {:.1e} N m, smallest stiffness {:.3e} N m/rad",
        if settled.converged {
            "settled"
        } else {
            "NOT settled"
        },
        settled.iterations,
        settled.residual,
        settled.min_eigenvalue
    );
    text
}

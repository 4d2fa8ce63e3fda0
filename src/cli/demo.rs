//! `tdcr demo`.

use std::path::PathBuf;

use clap::Args;
use tdcr::learn::symmetry::SymmetryUse;
use tdcr::pages::{DemoSettings, demo, headline};

use super::console::Console;
use super::eval::table;
use super::{PrecisionArgs, output};

/// Simulate, see, learn, predict and evaluate the paper's 2m robot, and write a report
///
/// Interrupted, the same command goes on where it stopped.
#[derive(Debug, Args)]
pub(super) struct DemoArgs {
    /// Folder of everything that the demo makes
    #[arg(long, default_value = "demo_out", value_name = "DIR")]
    out: PathBuf,
    /// Commands to simulate, split 80/10/10
    #[arg(long, default_value_t = DemoSettings::default().samples, value_name = "N")]
    samples: usize,
    /// Optimiser steps
    #[arg(long, default_value_t = DemoSettings::default().steps, value_name = "N")]
    steps: u64,
    #[command(flatten)]
    precision: PrecisionArgs,
    /// Use the robot's symmetries where its clouds have them (auto), or not (none)
    #[arg(long, default_value = DemoSettings::default().symmetry.name(), value_parser = super::symmetry_use())]
    symmetry: SymmetryUse,
    /// Seed of everything random
    #[arg(long, default_value_t = DemoSettings::default().seed)]
    seed: u64,
}

pub(super) fn run(args: &DemoArgs, console: &Console) -> anyhow::Result<()> {
    output::folder("--out", &args.out, "a folder for all that the demo makes")?;
    let settings = DemoSettings {
        samples: args.samples,
        steps: args.steps,
        precision: args.precision.precision,
        symmetry: args.symmetry,
        seed: args.seed,
    };
    let made = demo(&settings, &args.out, console)?;
    tracing::info!(
        "shapes.png: test commands from the best prediction to the worst; the bar is {:.0} cm",
        100.0 * made.scale_bar
    );
    console.result(&made.metrics, |m| {
        format!(
            "{}\nmeans over {} test commands; {:.0} s in all\n{}\nsee {}",
            table(&made.evaluation),
            m.metrics.tests,
            m.seconds,
            headline(&m.metrics),
            made.report.display()
        )
    })
}

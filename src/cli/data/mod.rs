//! `tdcr data`: inspects, checks, merges, imports and exports data sets.

mod check;
mod exchange;
mod info;
mod lerobot;
mod merge;
mod view;

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::console::Console;

/// Inspect, check, merge, import and export data sets
#[derive(Debug, Args)]
pub(super) struct DataArgs {
    #[command(subcommand)]
    command: DataCommand,
}

#[derive(Debug, Subcommand)]
enum DataCommand {
    Info(info::InfoArgs),
    View(view::ViewArgs),
    Check(check::CheckArgs),
    Merge(merge::MergeArgs),
    Import(exchange::ImportArgs),
    Export(exchange::ExportArgs),
}

pub(super) fn run(args: &DataArgs, console: &Console) -> anyhow::Result<()> {
    match &args.command {
        DataCommand::Info(args) => info::run(args, console),
        DataCommand::View(args) => view::run(args, console),
        DataCommand::Check(args) => check::run(args, console),
        DataCommand::Merge(args) => merge::run(args, console),
        DataCommand::Import(args) => exchange::import(args, console),
        DataCommand::Export(args) => exchange::export(args, console),
    }
}

/// Folders of data sets.
#[derive(Debug, Args)]
struct Dirs {
    /// Folders of data sets
    #[arg(required = true, value_name = "DIR")]
    dirs: Vec<PathBuf>,
}

//! `tdcr data view`.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;
use tdcr::pages::{CLOUDS_SHOWN, DataDrawing};

use super::{Console, Dirs};
use crate::cli::output;

/// Draw data sets: workspace, histograms of commands and payloads, some of the clouds
#[derive(Debug, Args)]
pub(in crate::cli) struct ViewArgs {
    #[command(flatten)]
    dirs: Dirs,
    /// The file to write: .html for all of it, .svg for the workspace, .png for the clouds of one set
    #[arg(long, default_value = "data.html", value_name = "FILE")]
    out: PathBuf,
    /// Clouds to show of each set
    #[arg(long, default_value_t = CLOUDS_SHOWN, value_name = "N", value_parser = super::super::amount)]
    clouds: usize,
}

#[derive(Serialize)]
struct Viewed {
    file: PathBuf,
}

pub(super) fn run(args: &ViewArgs, console: &Console) -> anyhow::Result<()> {
    let dirs = &args.dirs.dirs;
    let drawing = DataDrawing::of(&args.out, dirs.len())?;
    output::write(&args.out, drawing.draw(dirs, args.clouds, console)?)?;
    let viewed = Viewed {
        file: args.out.clone(),
    };
    console.summary(&viewed, |viewed| format!("see {}", viewed.file.display()))
}

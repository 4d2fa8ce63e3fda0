//! `tdcr data view`.

use std::path::{Path, PathBuf};

use anyhow::bail;
use clap::Args;
use serde::Serialize;
use tdcr::pipeline::{Survey, Tips};
use tdcr::report::{DataPage, MotorGroup, SetSummary};

use super::info::Info;
use super::{Console, Dirs, name};
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
    #[arg(long, default_value_t = 8, value_name = "N", value_parser = super::super::amount)]
    clouds: usize,
}

#[derive(Serialize)]
struct Viewed {
    file: PathBuf,
}

pub(super) fn run(args: &ViewArgs, console: &Console) -> anyhow::Result<()> {
    let extension = args
        .out
        .extension()
        .and_then(|extension| extension.to_str());
    if extension == Some("png") && args.dirs.dirs.len() > 1 {
        bail!(
            "a .png shows the clouds of one data set; expected one folder, or --out with .html or .svg"
        );
    }
    if !matches!(extension, Some("html" | "svg" | "png")) {
        bail!(
            "{} has none of the extensions .html, .svg and .png",
            args.out.display()
        );
    }
    let summary = |dir: &PathBuf| summary(dir, args.clouds);
    let sets = args.dirs.dirs.iter().map(summary);
    let page = DataPage {
        sets: sets.collect::<Result<_, _>>()?,
    };
    let bytes = match extension {
        Some("png") => page.sets[0].sheet().0,
        Some("svg") => page.workspace().to_svg().into_bytes(),
        _ => page.to_html().into_bytes(),
    };
    output::write(&args.out, bytes)?;
    let viewed = Viewed {
        file: args.out.clone(),
    };
    console.result(&viewed, |viewed| format!("see {}", viewed.file.display()))
}

fn summary(dir: &Path, clouds: usize) -> anyhow::Result<SetSummary> {
    let survey = Survey::open(dir)?;
    let (tips, note) = match survey.tips()? {
        Tips::Settled(tips) => (tips, "The tips of simulated sets are settled again."),
        Tips::Estimated(tips) => (
            tips,
            "Those of other sets are estimated from the test clouds: the mean of the 2 % of the points \
             that are farthest from the lowest.",
        ),
    };
    Ok(SetSummary {
        name: name(dir),
        facts: Info::new(dir, &survey)?.facts(),
        motors: (0..survey.motors()).map(|k| survey.motor(k)).collect(),
        groups: MotorGroup::of(
            survey.recipe().map(|recipe| &recipe.subject.robot),
            survey.motors(),
        ),
        payloads: survey.payloads(),
        tips,
        tips_note: note.to_owned(),
        clouds: survey.clouds(clouds)?,
    })
}

//! `tdcr study`.

use std::path::PathBuf;

use anyhow::Context;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Subcommand};
use tdcr::base::Part;
use tdcr::report::counted;
use tdcr::study::{Finished, Starter, Study, merge, run as run_study};

use super::console::Console;
use super::output;
use super::scene::SceneArgs;

/// Sweep designs, loads and commands, as one file says: a table, and a report with figures
///
/// tdcr study --new payload > payload.toml prints a commented file to start from. The folder gets table.csv and table.parquet (a
/// row for each configuration), summary.csv (quantiles over what is sampled), study.json (what was run), report.html and
/// figures/*.svg. Interrupted, the same command goes on where it stopped. To run on several machines, give each a --part, and put
/// the parts together with tdcr study merge.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub(super) struct StudyArgs {
    #[command(subcommand)]
    command: Option<StudyCommand>,
    /// The study's file
    #[arg(required_unless_present = "new", value_name = "FILE")]
    file: Option<PathBuf>,
    /// Print a study to start from, and do nothing else
    #[arg(long, value_parser = starter(), conflicts_with_all = ["file", "out", "part", "scene"])]
    new: Option<Starter>,
    #[command(flatten)]
    scene: SceneArgs,
    /// Folder of the results
    #[arg(long, default_value = "study", value_name = "DIR")]
    out: PathBuf,
    /// Run part I of N of the configurations, in a folder of its own; tdcr study merge makes the whole of all parts
    #[arg(long, value_name = "I/N")]
    part: Option<Part>,
}

#[derive(Debug, Subcommand)]
enum StudyCommand {
    Merge(MergeArgs),
}

/// Put the parts of a study together that tdcr study --part I/N ran
///
/// Tables, summary and report are byte for byte those of a run without --part. The parts stay as they are.
#[derive(Debug, Args)]
struct MergeArgs {
    /// Folders of all parts, in any order
    #[arg(required = true, value_name = "PART")]
    parts: Vec<PathBuf>,
    /// Folder of the results
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

pub(super) fn run(args: &StudyArgs, console: &Console) -> anyhow::Result<()> {
    if let Some(StudyCommand::Merge(args)) = &args.command {
        output::folder("--out", &args.out, "a folder for the results")?;
        return report(&merge(&args.parts, &args.out, console)?, None, console);
    }
    if let Some(starter) = args.new {
        return console.result(&starter.text(), |text| (*text).to_owned());
    }
    output::folder("--out", &args.out, "a folder for the results")?;
    let file = args.file.as_deref().context("no study is given")?;
    let scene = args.scene.given()?;
    let (study, notes) = Study::load_with_notes(file, scene.as_ref())?;
    super::warn_of(&notes);
    report(
        &run_study(&study, &args.out, args.part, console)?,
        args.part,
        console,
    )
}

fn report(finished: &Finished, part: Option<Part>, console: &Console) -> anyhow::Result<()> {
    console.summary(finished, |f| {
        let dir = f.dir.display();
        let of = part.map_or(String::new(), |part| format!("{part}, "));
        let rows = counted(f.rows, "configuration");
        let page = match part {
            None => format!("; see {}", f.dir.join("report.html").display()),
            Some(_) => String::new(),
        };
        format!(
            "{dir}: {of}{} of {rows} settled, in {:.1} s{page}",
            f.settled, f.seconds
        )
    })
}

/// Parses the name of a starter.
fn starter() -> impl TypedValueParser<Value = Starter> {
    PossibleValuesParser::new(Starter::ALL.map(Starter::name)).map(|name| {
        let starter = Starter::ALL
            .into_iter()
            .find(|starter| starter.name() == name);
        starter.expect("one of the possible values")
    })
}

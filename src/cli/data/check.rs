//! `tdcr data check`.

use anyhow::bail;
use clap::Args;
use serde::Serialize;
use tdcr::learn::data::check;
use tdcr::report::counted;

use super::{Console, Dirs};

/// Check data sets: array shapes, finite numbers, normalisation, disjoint splits, no condition twice
#[derive(Debug, Args)]
pub(in crate::cli) struct CheckArgs {
    #[command(flatten)]
    dirs: Dirs,
}

#[derive(Serialize)]
struct Checked {
    dir: std::path::PathBuf,
    findings: Vec<String>,
}

pub(super) fn run(args: &CheckArgs, console: &Console) -> anyhow::Result<()> {
    let mut checked = Vec::new();
    for dir in &args.dirs.dirs {
        let findings = check(dir)?.iter().map(ToString::to_string).collect();
        checked.push(Checked {
            dir: dir.clone(),
            findings,
        });
    }
    console.result(&checked, |checked| {
        let lines = checked.iter().map(|set| {
            let dir = set.dir.display();
            match set.findings.as_slice() {
                [] => format!("{dir}: good\n"),
                findings => format!("{dir}:\n  {}\n", findings.join("\n  ")),
            }
        });
        lines.collect()
    })?;
    let wrong: usize = checked.iter().map(|set| set.findings.len()).sum();
    if wrong > 0 {
        bail!("{}, expected none", counted(wrong, "finding"));
    }
    Ok(())
}

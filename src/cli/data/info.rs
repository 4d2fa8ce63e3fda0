//! `tdcr data info`.

use std::path::PathBuf;

use clap::Args;
use tdcr::pages::SetInfo;
use tdcr::pipeline::Survey;

use super::{Console, Dirs};

/// Summarise data sets: robot, splits, ranges
#[derive(Debug, Args)]
pub(in crate::cli) struct InfoArgs {
    #[command(flatten)]
    dirs: Dirs,
}

pub(super) fn run(args: &InfoArgs, console: &Console) -> anyhow::Result<()> {
    let info = |dir: &PathBuf| SetInfo::new(dir, &Survey::open(dir)?);
    let infos: Vec<SetInfo> = args.dirs.dirs.iter().map(info).collect::<Result<_, _>>()?;
    console.result(&infos, |infos| {
        let text = infos.iter().map(|info| {
            let facts = info.facts().into_iter();
            let lines: String = facts
                .map(|(name, value)| format!("  {name:17} {value}\n"))
                .collect();
            format!("{}\n{lines}", info.dir.display())
        });
        text.collect()
    })
}

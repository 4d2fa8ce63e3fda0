//! `tdcr manual`.

use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use clap_mangen::Man;
use serde::Serialize;
use tdcr::report::counted;

use super::console::Console;
use super::output;

/// Write manual pages, one for each command
///
/// To read one: man ./man/tdcr-settle.1. For all users: tdcr manual --out /usr/local/share/man/man1
#[derive(Debug, Args)]
pub(super) struct ManualArgs {
    /// Folder of the pages
    #[arg(long, default_value = "man", value_name = "DIR")]
    out: PathBuf,
}

#[derive(Serialize)]
struct Written {
    dir: PathBuf,
    pages: usize,
}

pub(super) fn run(args: &ManualArgs, console: &Console) -> anyhow::Result<()> {
    output::folder("--out", &args.out, "a folder for the pages")?;
    std::fs::create_dir_all(&args.out)
        .with_context(|| format!("cannot write {}", args.out.display()))?;
    let mut command = super::help::command();
    command.build();
    let mut pages = 0;
    let mut waiting = vec![(String::from("tdcr"), command)];
    while let Some((name, command)) = waiting.pop() {
        for below in command
            .get_subcommands()
            .filter(|below| below.get_name() != "help")
        {
            waiting.push((format!("{name}-{}", below.get_name()), below.clone()));
        }
        let mut page = Vec::new();
        // A page is called as the file: `tdcr-data-merge`.
        Man::new(command.clone().display_name(name.clone())).render(&mut page)?;
        output::write(&args.out.join(format!("{name}.1")), page)?;
        pages += 1;
    }
    let written = Written {
        dir: args.out.clone(),
        pages,
    };
    console.summary(&written, |w| {
        format!("{}: {}", w.dir.display(), counted(w.pages, "page"))
    })
}

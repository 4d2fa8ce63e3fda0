//! `tdcr completions`.

use std::io::Write;

use anyhow::Context;
use clap::Args;
use clap_complete::Shell;

use super::console::Console;

/// Print what completes tdcr's commands and options in a shell
///
/// For bash: tdcr completions bash > ~/.local/share/bash-completion/completions/tdcr
#[derive(Debug, Args)]
pub(super) struct CompletionsArgs {
    /// The shell
    #[arg(value_enum)]
    shell: Shell,
}

pub(super) fn run(args: &CompletionsArgs, _console: &Console) -> anyhow::Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut super::help::command(), "tdcr", &mut script);
    let mut stdout = std::io::stdout().lock();
    stdout
        .write_all(&script)
        .and_then(|()| stdout.flush())
        .context("cannot write to stdout")
}

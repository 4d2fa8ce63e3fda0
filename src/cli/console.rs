//! What the user sees: results, progress bars, interruption.

use std::ffi::OsStr;
use std::io::{IsTerminal, Write};
use std::ops::ControlFlow;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use anyhow::Context;
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use serde::Serialize;
use tdcr::pipeline::Monitor;
use tdcr::report::counted;

use super::Global;
use super::person;
use super::printable::printable;
pub(super) use super::printable::say;
use super::signals::Signals;

/// The terminal: results to stdout, progress to stderr, signals heard.
pub(super) struct Console {
    format: Format,
    bars: Bars,
    quiet: bool,
    signals: Arc<Signals>,
    stage: Mutex<Option<Running>>,
}

/// Interruption of work that keeps nothing to resume from.
#[derive(Debug, thiserror::Error)]
#[error("interrupted")]
pub(super) struct Interrupted;

#[derive(Clone, Copy)]
enum Format {
    Text,
    Json,
}

/// How progress is shown on stderr.
#[derive(Clone, Copy)]
enum Bars {
    /// A live bar, on a terminal.
    Live,
    /// A line when a stage begins and ends, in a log.
    Lines,
    /// Not at all.
    None,
}

struct Running {
    name: String,
    bar: ProgressBar,
    began: Instant,
}

impl Console {
    pub fn new(global: &Global) -> anyhow::Result<Self> {
        Ok(Self {
            format: if global.json {
                Format::Json
            } else {
                Format::Text
            },
            bars: match (global.quiet, Terminal::stderr().moves_cursor) {
                (true, _) => Bars::None,
                (false, true) => Bars::Live,
                (false, false) => Bars::Lines,
            },
            quiet: global.quiet,
            signals: Signals::listen()?,
            stage: Mutex::new(None),
        })
    }

    /// Says what was done where the result itself is in files, or is what a robot did: as [`Self::result`], but nothing where
    /// quiet was asked for and JSON was not.
    pub fn summary<T: Serialize>(
        &self,
        value: &T,
        text: impl FnOnce(&T) -> String,
    ) -> anyhow::Result<()> {
        match (self.format, self.bars) {
            (Format::Text, Bars::None) => Ok(()),
            _ => self.result(value, text),
        }
    }

    /// Prints a result: as JSON where asked for, else as `text` renders it.
    pub fn result<T: Serialize>(
        &self,
        value: &T,
        text: impl FnOnce(&T) -> String,
    ) -> anyhow::Result<()> {
        let mut rendered = match self.format {
            Format::Json => {
                serde_json::to_string_pretty(value).context("cannot write the result as JSON")?
            }
            Format::Text => text(value),
        };
        rendered = printable(&rendered);
        if !rendered.ends_with('\n') {
            rendered.push('\n');
        }
        let mut stdout = std::io::stdout().lock();
        stdout
            .write_all(rendered.as_bytes())
            .and_then(|()| stdout.flush())
            .context("cannot write to stdout")
    }

    /// Writes a part of a result that is too long to be held, in the format that [`is_json`](Self::is_json) says.
    pub fn part(&self, text: &str) -> anyhow::Result<()> {
        let write = || {
            let mut stdout = std::io::stdout().lock();
            stdout
                .write_all(printable(text).as_bytes())
                .and_then(|()| stdout.flush())
                .context("cannot write to stdout")
        };
        match self.stage.lock() {
            // A live bar makes room for it.
            Ok(stage) if stage.is_some() => stage
                .as_ref()
                .map_or(Ok(()), |running| running.bar.suspend(write)),
            _ => write(),
        }
    }

    /// Whether results are JSON.
    pub fn is_json(&self) -> bool {
        matches!(self.format, Format::Json)
    }

    /// Whether nothing but errors and the result are wanted.
    pub fn is_quiet(&self) -> bool {
        self.quiet
    }

    /// Says a line about the work on stderr, unless only errors and the result are wanted.
    pub fn tell(&self, line: &str) {
        if !self.quiet {
            say(line);
        }
    }

    /// Whether to go on with work that may hold a robot: not after a signal that asks the process to end.
    pub fn go_on(&self) -> ControlFlow<()> {
        match self.interrupted() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    }

    fn with_stage(&self, act: impl FnOnce(&Running)) {
        // A poisoned lock means that another thread panicked: progress no longer matters.
        if let Ok(stage) = self.stage.lock()
            && let Some(running) = stage.as_ref()
        {
            act(running);
        }
    }
}

/// What the terminal at stderr can do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Terminal {
    /// Overwrite what it shows, as a progress bar does.
    pub moves_cursor: bool,
    /// Show colours, and is wanted to.
    pub colors: bool,
}

impl Terminal {
    /// The one that the process was started in.
    pub fn stderr() -> Self {
        let variable = |name| std::env::var_os(name);
        Self::new(
            std::io::stderr().is_terminal(),
            variable("TERM").as_deref(),
            variable("NO_COLOR").as_deref(),
        )
    }

    /// By whether there is one at all, and the values of `TERM` and `NO_COLOR` (<https://no-color.org>).
    fn new(terminal: bool, term: Option<&OsStr>, no_color: Option<&OsStr>) -> Self {
        let moves_cursor = terminal && term.map_or(cfg!(windows), |term| term != "dumb");
        Self {
            moves_cursor,
            colors: moves_cursor && no_color.is_none_or(OsStr::is_empty),
        }
    }
}

/// Whether the reader of stdout went away, as `head` does: no error of ours.
pub(super) fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error
        .downcast_ref::<std::io::Error>()
        .is_some_and(|error| error.kind() == std::io::ErrorKind::BrokenPipe)
}

impl Monitor for Console {
    fn begin(&self, name: &str, steps: u64, done: u64) {
        let target = match self.bars {
            Bars::Live => ProgressDrawTarget::stderr_with_hz(10),
            Bars::Lines | Bars::None => ProgressDrawTarget::hidden(),
        };
        let style =
            "{prefix:12} {bar:32} {human_pos}/{human_len}  {rate}  {elapsed}, {eta} left  {msg}";
        let style = ProgressStyle::with_template(style)
            .expect("the template is well formed")
            .with_key(
                "rate",
                |state: &ProgressState, out: &mut dyn std::fmt::Write| {
                    // A progress bar has no way to report that it could not be written.
                    let _ = write!(out, "{:.1}/s", state.per_sec());
                },
            );
        let bar = ProgressBar::with_draw_target(Some(steps), target)
            .with_style(style)
            .with_position(done);
        bar.set_prefix(name.to_owned());
        bar.reset_eta();
        if let Bars::Lines = self.bars {
            match done {
                0 => tracing::info!("{name}: {}", counted(steps as usize, "step")),
                done => tracing::info!("{name}: {done} of {steps} steps done before, going on"),
            }
        }
        if let Ok(mut stage) = self.stage.lock() {
            *stage = Some(Running {
                name: name.to_owned(),
                bar,
                began: Instant::now(),
            });
        }
    }

    fn advance(&self, steps: u64) {
        self.with_stage(|running| running.bar.inc(steps));
    }

    fn note(&self, text: &str) {
        if self.stage.lock().is_ok_and(|stage| stage.is_none()) {
            tracing::info!("{text}");
        }
        self.with_stage(|running| {
            running.bar.set_message(text.to_owned());
            if let Bars::Lines = self.bars {
                let bar = &running.bar;
                tracing::info!(
                    "{} {}: {text}, {:.1}/s, {:#} left",
                    running.name,
                    bar.position(),
                    bar.per_sec(),
                    HumanDuration(bar.eta())
                );
            }
        });
    }

    fn status(&self, text: &str) {
        self.with_stage(|running| running.bar.set_message(text.to_owned()));
    }

    fn end(&self) {
        self.signals.forget_safe_points();
        self.with_stage(|running| {
            running.bar.finish_and_clear();
            if !matches!(self.bars, Bars::None) {
                tracing::info!(
                    "{}: done in {:.1} s",
                    running.name,
                    running.began.elapsed().as_secs_f64()
                );
            }
        });
        if let Ok(mut stage) = self.stage.lock() {
            *stage = None;
        }
    }

    fn interrupted(&self) -> bool {
        self.signals.came()
    }

    fn hang(&self, payload: f64) -> bool {
        let request = match payload {
            0.0 => "The rig is released. Take the payload off the tip".to_owned(),
            payload => format!("The rig is released. Hang {payload} kg at the tip"),
        };
        let ask = || person::does(&request, || self.interrupted());
        match self.stage.lock() {
            // A live bar makes room for it.
            Ok(stage) if stage.is_some() => stage
                .as_ref()
                .is_some_and(|running| running.bar.suspend(ask)),
            _ => ask(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_and_bars_are_for_terminals_that_have_them_and_users_who_want_them() {
        let terminal = |term: Option<&str>, no_color: Option<&str>| {
            let Terminal {
                moves_cursor,
                colors,
            } = Terminal::new(true, term.map(OsStr::new), no_color.map(OsStr::new));
            (moves_cursor, colors)
        };
        assert_eq!(terminal(Some("xterm"), None), (true, true));
        assert_eq!(terminal(Some("xterm"), Some("")), (true, true));
        assert_eq!(terminal(Some("xterm"), Some("1")), (true, false));
        assert_eq!(terminal(Some("xterm"), Some("0")), (true, false));
        assert_eq!(terminal(Some("dumb"), None), (false, false));
        let log = Terminal::new(false, Some(OsStr::new("xterm")), None);
        assert!(!log.moves_cursor && !log.colors);
    }
}

//! What the user sees: results, progress bars, interruption.

use std::io::{IsTerminal, Write};
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use anyhow::Context;
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use serde::Serialize;
use tdcr::pipeline::Monitor;

use super::{Global, INTERRUPTED};

/// The terminal: results to stdout, progress to stderr, Ctrl-C heard.
pub(super) struct Console {
    format: Format,
    bars: Bars,
    interrupted: Arc<AtomicBool>,
    stage: Mutex<Option<Running>>,
}

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
        let interrupted = Arc::new(AtomicBool::new(false));
        let flag = interrupted.clone();
        ctrlc::set_handler(move || {
            if flag.swap(true, Ordering::Relaxed) {
                std::process::exit(INTERRUPTED.into());
            }
            eprintln!("\nstopping at the next safe point; press Ctrl-C again to stop at once");
        })
        .context("cannot listen for Ctrl-C")?;
        Ok(Self {
            format: if global.json {
                Format::Json
            } else {
                Format::Text
            },
            bars: match (global.quiet, std::io::stderr().is_terminal()) {
                (true, _) => Bars::None,
                (false, true) => Bars::Live,
                (false, false) => Bars::Lines,
            },
            interrupted,
            stage: Mutex::new(None),
        })
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
        if !rendered.ends_with('\n') {
            rendered.push('\n');
        }
        let mut stdout = std::io::stdout().lock();
        stdout
            .write_all(rendered.as_bytes())
            .and_then(|()| stdout.flush())
            .context("cannot write to stdout")
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
            tracing::info!("{name}: {done} of {steps} steps done, going on");
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
        self.interrupted.load(Ordering::Relaxed)
    }
}

//! A stage of the libraries, watched from Python.

use std::sync::atomic::{AtomicBool, Ordering};

use tdcr::pipeline::Monitor;

use crate::run::Watch;

/// Tells of the steps of some stages, and of no other; asks every stage to stop where the caller does.
pub struct Stage<'a> {
    names: &'static [&'static str],
    watch: &'a Watch,
    running: AtomicBool,
}

impl<'a> Stage<'a> {
    /// The stages that the libraries call `names`.
    pub fn new(names: &'static [&'static str], watch: &'a Watch) -> Self {
        let running = AtomicBool::new(false);
        Self {
            names,
            watch,
            running,
        }
    }
}

impl Monitor for Stage<'_> {
    fn begin(&self, stage: &str, _steps: u64, done: u64) {
        let counts = self.names.contains(&stage);
        self.running.store(counts, Ordering::Relaxed);
        self.advance(done);
    }

    fn advance(&self, steps: u64) {
        if self.running.load(Ordering::Relaxed) {
            self.watch
                .advance(usize::try_from(steps).unwrap_or(usize::MAX));
        }
    }

    fn note(&self, _text: &str) {}

    fn status(&self, _text: &str) {}

    fn end(&self) {
        self.running.store(false, Ordering::Relaxed);
    }

    fn interrupted(&self) -> bool {
        self.watch.stopped()
    }
}

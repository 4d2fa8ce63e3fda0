//! A stage of the libraries, watched from Python.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use pyo3::prelude::*;
use tdcr::pipeline::Monitor;

use crate::run::Watch;

/// Tells of the steps of some stages, and of no other; asks every stage to stop where the caller does.
pub struct Stage<'a> {
    names: &'static [&'static str],
    watch: &'a Watch,
    running: AtomicBool,
    hang: Option<(&'a Py<PyAny>, &'a AtomicBool)>,
    raised: Mutex<Option<PyErr>>,
}

impl<'a> Stage<'a> {
    /// The stages that the libraries call `names`.
    pub fn new(names: &'static [&'static str], watch: &'a Watch) -> Self {
        let running = AtomicBool::new(false);
        Self {
            names,
            watch,
            running,
            hang: None,
            raised: Mutex::new(None),
        }
    }

    /// The same; `hang` is called with payloads (kg) that a person is to hang at the tip of a rig, and returns when they hang there.
    /// Its flag is set meanwhile.
    pub fn with_hang(self, hang: Option<(&'a Py<PyAny>, &'a AtomicBool)>) -> Self {
        Self { hang, ..self }
    }

    /// What `hang` raised, if it did.
    pub fn raised(self) -> Option<PyErr> {
        self.raised
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner)
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

    fn hang(&self, payload: f64) -> bool {
        let Some((hang, hanging)) = self.hang else {
            return false;
        };
        hanging.store(true, Ordering::Release);
        let hung = Python::attach(|py| hang.call1(py, (payload,)).map(drop));
        hanging.store(false, Ordering::Release);
        match hung {
            Ok(()) => true,
            Err(error) => {
                *self.raised.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
                false
            }
        }
    }
}

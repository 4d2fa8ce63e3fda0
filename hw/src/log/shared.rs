//! A log that several parts of a rig write to.

use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::error::LogError;
use super::write::LogWriter;

/// A handle of a log. A rig goes on where its log fails, on a full disk for one: the first failure is kept, and told by
/// [`finish`](Self::finish).
#[derive(Clone)]
pub struct SharedLog(Arc<Mutex<State>>);

enum State {
    Open(Box<LogWriter>),
    Failed(LogError),
    Finished,
}

impl SharedLog {
    /// A handle of `log`.
    pub fn new(log: LogWriter) -> Self {
        Self(Arc::new(Mutex::new(State::Open(Box::new(log)))))
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // Whoever panicked was between two records, or its record is not whole: the writer knows.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Has `write` write to the log, unless that has failed before or is finished. A record that a log cannot hold is only
    /// warned of.
    pub fn with(&self, write: impl FnOnce(&mut LogWriter) -> Result<(), LogError>) {
        let mut state = self.state();
        let State::Open(log) = &mut *state else {
            return;
        };
        match write(log) {
            Ok(()) => {}
            Err(error @ LogError::Record { .. }) => tracing::warn!("{error}"),
            Err(error) => {
                tracing::warn!("the log ends here: {error}");
                *state = State::Failed(error);
            }
        }
    }

    /// Logs `record` of a `time` of the clock.
    pub fn write(&self, time: Duration, record: &super::LogRecord) {
        self.with(|log| log.write(time, record));
    }

    /// Ends the log. Handles that are left write nothing more.
    ///
    /// # Errors
    /// The first [`LogError`] since the log's beginning.
    pub fn finish(&self) -> Result<(), LogError> {
        match std::mem::replace(&mut *self.state(), State::Finished) {
            State::Open(log) => log.finish(),
            State::Failed(error) => Err(error),
            State::Finished => Ok(()),
        }
    }
}

impl fmt::Debug for SharedLog {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SharedLog").finish_non_exhaustive()
    }
}

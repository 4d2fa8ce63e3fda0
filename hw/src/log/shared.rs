//! A log that several parts of a rig write to.

use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Duration;

use super::error::LogError;
use super::write::LogWriter;
use crate::servo::locked_within;

/// All logs of the process; those that are gone do not upgrade.
static LOGS: Mutex<Vec<Weak<Mutex<State>>>> = Mutex::new(Vec::new());

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
        let state = Arc::new(Mutex::new(State::Open(Box::new(log))));
        let mut logs = LOGS.lock().unwrap_or_else(PoisonError::into_inner);
        logs.retain(|log| log.strong_count() > 0);
        logs.push(Arc::downgrade(&state));
        Self(state)
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
                let ended = std::mem::replace(&mut *state, State::Failed(error));
                // What it has is whole, as far as its end can be written.
                if let State::Open(log) = ended
                    && let Err(error) = log.finish()
                {
                    tracing::debug!("{error}");
                }
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

/// Ends all logs of the process, as far as each is to be had within `patience`. Their handles write nothing more.
pub(crate) fn finish_all(patience: Duration) {
    let logs = LOGS.lock().unwrap_or_else(PoisonError::into_inner).clone();
    for log in logs.iter().filter_map(Weak::upgrade) {
        let taken = locked_within(&log, patience)
            .map(|mut state| std::mem::replace(&mut *state, State::Finished));
        if let Some(State::Open(log)) = taken
            && let Err(error) = log.finish()
        {
            tracing::warn!("the log is not whole: {error}");
        }
    }
}

impl fmt::Debug for SharedLog {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SharedLog").finish_non_exhaustive()
    }
}

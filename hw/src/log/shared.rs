//! A log that several parts of a rig write to, by a thread of its own.

use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, Weak};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use tdcr_sim::render::RgbdFrame;

use super::error::LogError;
use super::record::LogRecord;
use super::write::LogWriter;
use crate::camera::Stamped;

/// Pictures that may wait to be written: with depth, 70 MB of 640 by 480 pixels.
const PICTURES: usize = 32;

/// Time between looks at a thread that is to end.
const LOOK: Duration = Duration::from_millis(5);

/// All logs of the process; those that are gone do not upgrade.
static LOGS: Mutex<Vec<Weak<Shared>>> = Mutex::new(Vec::new());

/// A handle of a log. What is logged is written later, in its order: who looks after servos does not wait for a disk. A rig goes on
/// where its log fails, on a full disk for one: the first failure is kept, and told by [`finish`](Self::finish).
#[derive(Clone)]
pub struct SharedLog(Arc<Shared>);

/// Something to be written.
type Write = Box<dyn FnOnce(&mut LogWriter) -> Result<(), LogError> + Send>;

struct Shared {
    /// What is to be written, until the log ends.
    queue: Mutex<Option<Sender<Write>>>,
    /// The thread that writes it.
    writer: Mutex<Option<JoinHandle<Result<(), LogError>>>>,
    /// Whether that has come to its end.
    is_written: Arc<AtomicBool>,
    pictures: Arc<Places>,
}

/// Places for pictures that wait.
struct Places {
    free: Mutex<usize>,
    changed: Condvar,
}

/// A place that is taken until this goes.
struct Place(Arc<Places>);

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // What these locks hold is whole between any two statements.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Place {
    /// Waits for one.
    fn take(places: &Arc<Places>) -> Self {
        let free = places
            .changed
            .wait_while(locked(&places.free), |free| *free == 0);
        *free.unwrap_or_else(PoisonError::into_inner) -= 1;
        Self(places.clone())
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        *locked(&self.0.free) += 1;
        self.0.changed.notify_one();
    }
}

impl SharedLog {
    /// A handle of `log`.
    pub fn new(log: LogWriter) -> Self {
        let (queue, writes) = channel();
        let is_written = Arc::new(AtomicBool::new(false));
        let written = is_written.clone();
        let writer = thread::spawn(move || {
            let ended = write_all(log, writes);
            written.store(true, Ordering::Release);
            ended
        });
        let shared = Arc::new(Shared {
            queue: Mutex::new(Some(queue)),
            writer: Mutex::new(Some(writer)),
            is_written,
            pictures: Arc::new(Places {
                free: Mutex::new(PICTURES),
                changed: Condvar::new(),
            }),
        });
        let mut logs = locked(&LOGS);
        logs.retain(|log| log.strong_count() > 0);
        logs.push(Arc::downgrade(&shared));
        Self(shared)
    }

    /// Has `write` write to the log in its turn, unless that has failed by then, or is finished now. A record that a log cannot hold is
    /// only warned of.
    pub fn with(
        &self,
        write: impl FnOnce(&mut LogWriter) -> Result<(), LogError> + Send + 'static,
    ) {
        if let Some(queue) = &*locked(&self.0.queue) {
            // Nobody takes it where the log has failed.
            let _ = queue.send(Box::new(write));
        }
    }

    /// Logs `record` of a `time` of the clock.
    pub fn write(&self, time: Duration, record: LogRecord) {
        self.with(move |log| log.write(time, &record));
    }

    /// Logs a picture of the camera `serial`. Waits where so many are to be written that they take too much memory.
    pub fn frame(&self, serial: &str, frame: &Stamped<RgbdFrame>) {
        let place = Place::take(&self.0.pictures);
        let (serial, frame) = (serial.to_owned(), frame.clone());
        self.with(move |log| {
            let _place = place;
            log.frame(&serial, &frame)
        });
    }

    /// Ends the log, once all is written. Handles that are left write nothing more.
    ///
    /// # Errors
    /// The first [`LogError`] since the log's beginning.
    pub fn finish(&self) -> Result<(), LogError> {
        self.0.finish()
    }
}

impl Shared {
    fn finish(&self) -> Result<(), LogError> {
        drop(locked(&self.queue).take());
        match locked(&self.writer).take() {
            Some(writer) => {
                (writer.join()).unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            }
            None => Ok(()),
        }
    }
}

impl Drop for Shared {
    fn drop(&mut self) {
        if let Err(error) = self.finish() {
            tracing::debug!("{error}");
        }
    }
}

/// Writes to `log` what comes, until nobody is left who writes, and ends it.
fn write_all(mut log: LogWriter, writes: Receiver<Write>) -> Result<(), LogError> {
    for write in writes {
        match write(&mut log) {
            Ok(()) => {}
            Err(error @ LogError::Record { .. }) => tracing::warn!("{error}"),
            Err(error) => {
                tracing::warn!("the log ends here: {error}");
                // What it has is whole, as far as its end can be written.
                if let Err(error) = log.finish() {
                    tracing::debug!("{error}");
                }
                return Err(error);
            }
        }
    }
    log.finish()
}

/// Ends all logs of the process, as far as each is written within `patience`. Their handles write nothing more.
pub(crate) fn finish_all(patience: Duration) {
    let logs: Vec<_> = locked(&LOGS).iter().filter_map(Weak::upgrade).collect();
    let deadline = Instant::now() + patience;
    for log in &logs {
        drop(locked(&log.queue).take());
    }
    for log in logs {
        let is_written = || log.is_written.load(Ordering::Acquire);
        while !is_written() && Instant::now() < deadline {
            thread::sleep(LOOK);
        }
        let finished = match is_written() {
            true => log.finish(),
            false => {
                // It is cut off: dropped, it would be waited for.
                std::mem::forget(log);
                continue;
            }
        };
        if let Err(error) = finished {
            tracing::warn!("the log is not whole: {error}");
        }
    }
}

impl fmt::Debug for SharedLog {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SharedLog").finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;
    use crate::clock::{Clock, SystemClock};
    use crate::log::{Entry, Event, Level, LogReader, LogSettings};

    #[test]
    fn who_logs_does_not_wait_for_a_disk_that_stalls_and_nothing_is_lost() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.mcap");
        let clock = SystemClock::new();
        let log = SharedLog::new(LogWriter::create(&path, &clock, LogSettings::default()).unwrap());
        let stall = Duration::from_secs(1);
        log.with(move |_| {
            thread::sleep(stall);
            Ok(())
        });
        let began = Instant::now();
        for number in 0..100 {
            let event = Event {
                level: Level::Info,
                source: "test".to_owned(),
                text: number.to_string(),
            };
            log.write(clock.now(), LogRecord::Event(event));
        }
        assert!(began.elapsed() < stall / 2, "{:?}", began.elapsed());
        log.finish().unwrap();
        assert!(began.elapsed() >= stall / 2);
        let mut reader = LogReader::open(&path).unwrap();
        let mut texts = Vec::new();
        while let Some(entry) = reader.next_entry().unwrap() {
            if let Entry::Message(message) = entry
                && let Some(LogRecord::Event(event)) =
                    LogRecord::decode(&message.channel, &message.data).unwrap()
            {
                texts.push(event.text);
            }
        }
        assert!(
            texts
                .iter()
                .cloned()
                .eq((0..100).map(|number: i32| number.to_string()))
        );
        // What comes after the end is nothing.
        log.write(clock.now(), LogRecord::Command(vec![0.0]));
        assert!(log.finish().is_ok());
    }
}

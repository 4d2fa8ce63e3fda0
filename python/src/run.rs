//! Running work of the libraries: on threads of our own, without the interpreter's lock, stopped by Ctrl-C.
//!
//! Rayon's global pool hangs in a forked child, as a fork copies none of its threads. The pool here belongs to one process: a
//! child makes its own at its first call.

use std::num::NonZero;
use std::panic::resume_unwind;
use std::process;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use std::{mem, thread};

use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::errors::{Failure, Outcome};

/// How often signals are looked at.
const POLL: Duration = Duration::from_millis(20);
/// Largest number of threads.
const MOST_THREADS: usize = 1024;

/// The pool, and of which process its threads are.
struct Pool {
    process: u32,
    threads: Arc<ThreadPool>,
}

/// Only locked by threads that hold the interpreter's lock, as does one that forks: so it is never locked in a child.
static POOL: Mutex<Option<Pool>> = Mutex::new(None);

/// What long work tells, and is told, meanwhile.
#[derive(Debug, Default)]
pub struct Watch {
    stop: AtomicBool,
    done: AtomicUsize,
}

impl Watch {
    /// Whether to stop: the result will not be used.
    pub fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Says that `count` more are done.
    pub fn advance(&self, count: usize) {
        self.done.fetch_add(count, Ordering::Relaxed);
    }

    /// Tells `progress` how many more are done since it was last told.
    fn tell(&self, progress: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        match (progress, self.done.swap(0, Ordering::Relaxed)) {
            (Some(progress), count) if count > 0 => progress.call1((count,)).map(drop),
            _ => Ok(()),
        }
    }
}

/// The pool of this process.
fn pool(_locked: Python<'_>) -> Outcome<Arc<ThreadPool>> {
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    let process = process::id();
    match &*pool {
        Some(of_ours) if of_ours.process == process => Ok(of_ours.threads.clone()),
        _ => {
            let threads = Arc::new(build(0)?);
            replace(
                &mut pool,
                Pool {
                    process,
                    threads: threads.clone(),
                },
            );
            Ok(threads)
        }
    }
}

/// A pool of `count` threads; 0 for one per processor.
fn build(count: usize) -> Outcome<ThreadPool> {
    let built = ThreadPoolBuilder::new().num_threads(count).build();
    built.map_err(|error| Failure::Of("TdcrError", format!("cannot start the threads: {error}")))
}

fn replace(pool: &mut Option<Pool>, new: Pool) {
    let process = new.process;
    if let Some(old) = pool.replace(new)
        && old.process != process
    {
        // Its threads are the parent's: to end them from here would wait for ever.
        mem::forget(old.threads);
    }
}

/// Sets the number of threads that this process computes with, from 1 to 1024.
#[pyfunction]
pub fn set_threads(_py: Python<'_>, count: usize) -> Outcome<()> {
    if !(1..=MOST_THREADS).contains(&count) {
        return Err(Failure::input(format!(
            "{count} threads; expected 1 to {MOST_THREADS}"
        )));
    }
    let new = Pool {
        process: process::id(),
        threads: Arc::new(build(count)?),
    };
    replace(
        &mut POOL.lock().unwrap_or_else(PoisonError::into_inner),
        new,
    );
    Ok(())
}

/// Number of processors that this process may run on, by its affinity and its control group.
#[pyfunction]
pub fn processors() -> usize {
    thread::available_parallelism().map_or(1, NonZero::get)
}

/// Number of threads that this process computes with.
#[pyfunction]
pub fn threads(py: Python<'_>) -> Outcome<usize> {
    Ok(pool(py)?.current_num_threads())
}

/// Runs long work on our threads, without the interpreter's lock. `progress` is called with the number of rows, samples or
/// steps that were done since its last call, as `update` of a tqdm bar is. Where it raises, or the handler of a signal such as
/// Ctrl-C does, the work is told to stop, and the exception is returned once it has ended.
pub fn long<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Watch) -> T + Send,
) -> Outcome<T> {
    if let Some(progress) = progress.filter(|progress| !progress.is_callable()) {
        let found = progress.repr()?;
        let message = format!("progress is {found}; expected a function of a number");
        return Err(Failure::input(message));
    }
    let pool = pool(py)?;
    let progress = progress.map(|progress| progress.clone().unbind());
    let watch = Watch::default();
    let look = || {
        Python::attach(|py| {
            py.check_signals()?;
            watch.tell(progress.as_ref().map(|progress| progress.bind(py)))
        })
    };
    let (result, raised) = py.detach(|| {
        thread::scope(|scope| {
            let (running, ended) = channel::<()>();
            let worker = scope.spawn(|| {
                let _running = running;
                pool.install(|| work(&watch))
            });
            let mut raised = None;
            while let Err(RecvTimeoutError::Timeout) = ended.recv_timeout(POLL) {
                if raised.is_none() {
                    raised = look().err();
                    watch.stop.store(raised.is_some(), Ordering::Relaxed);
                }
            }
            let result = worker.join().unwrap_or_else(|panic| resume_unwind(panic));
            (result, raised)
        })
    });
    match raised.or_else(|| look().err()) {
        None => Ok(result),
        Some(raised) => Err(raised.into()),
    }
}

/// Runs work of milliseconds on our threads, without the interpreter's lock. Signals wait until it ends.
pub fn short<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> Outcome<T> {
    let pool = pool(py)?;
    Ok(py.detach(|| pool.install(work)))
}

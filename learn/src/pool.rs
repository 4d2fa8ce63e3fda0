//! Scratch memory that outlives a call.

use std::sync::{Mutex, PoisonError};

/// Buffers that parallel work borrows and returns, so that only the first calls allocate.
#[derive(Debug)]
pub(crate) struct Pool<T>(Mutex<Vec<T>>);

impl<T> Pool<T> {
    /// Runs `work` with a buffer from the pool, or a fresh one from `create` where all are in use.
    pub fn with<R>(&self, create: impl FnOnce() -> T, work: impl FnOnce(&mut T) -> R) -> R {
        let free = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let taken = free().pop();
        let mut buffer = taken.unwrap_or_else(create);
        let result = work(&mut buffer);
        free().push(buffer);
        result
    }
}

impl<T> Default for Pool<T> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

/// A clone starts with no buffers: they are no part of the owner's value.
impl<T> Clone for Pool<T> {
    fn clone(&self) -> Self {
        Self::default()
    }
}

//! Bytes to and from a bus of servos: over a serial port, a pseudo-terminal, or in memory.

mod arriving;

use std::io;
use std::sync::Arc;
use std::time::Duration;

use crate::clock::Clock;

pub use arriving::Arriving;

/// A half-duplex line of bytes.
pub trait Transport: Send {
    /// Sends all of `bytes`.
    ///
    /// # Errors
    /// The device's: unplugged, for one.
    fn write(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// Fills the start of `buffer` with what has arrived, and returns how many bytes that is. Waits for the first one, but not
    /// beyond `deadline` (time of [`clock`](Self::clock)): 0 says that none came.
    ///
    /// # Errors
    /// The device's: unplugged, for one.
    fn read(&mut self, buffer: &mut [u8], deadline: Duration) -> io::Result<usize>;

    /// Forgets what has arrived and was not read.
    ///
    /// # Errors
    /// The device's: unplugged, for one.
    fn discard_input(&mut self) -> io::Result<()>;

    /// The clock that deadlines are times of.
    fn clock(&self) -> &Arc<dyn Clock>;

    /// Bits per second of the line; a byte takes ten.
    fn baud_rate(&self) -> u32;

    /// How long the way from the line to this program may hold arrived bytes back, besides their own times: the latency timer
    /// of a USB adapter and the scheduling of the computer.
    fn latency(&self) -> Duration;
}

impl<T: Transport + ?Sized> Transport for Box<T> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        (**self).write(bytes)
    }

    fn read(&mut self, buffer: &mut [u8], deadline: Duration) -> io::Result<usize> {
        (**self).read(buffer, deadline)
    }

    fn discard_input(&mut self) -> io::Result<()> {
        (**self).discard_input()
    }

    fn clock(&self) -> &Arc<dyn Clock> {
        (**self).clock()
    }

    fn baud_rate(&self) -> u32 {
        (**self).baud_rate()
    }

    fn latency(&self) -> Duration {
        (**self).latency()
    }
}

//! Bytes on their way to a reader.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use crate::clock::Clock;

/// Bytes on a line in memory, and when they arrive: the reading half of a [`Transport`](super::Transport) that has no device.
#[derive(Debug)]
pub struct Arriving {
    clock: Arc<dyn Clock>,
    /// In the order in which they are read.
    bytes: VecDeque<(Duration, u8)>,
}

impl Arriving {
    /// None yet; times are those of `clock`.
    pub fn new(clock: Arc<dyn Clock>) -> Self {
        Self {
            clock,
            bytes: VecDeque::new(),
        }
    }

    /// The clock of the line.
    pub fn clock(&self) -> &Arc<dyn Clock> {
        &self.clock
    }

    /// When the last byte arrives that has not been read, or now.
    pub fn end(&self) -> Duration {
        let last = self.bytes.back().map(|&(time, _)| time);
        last.unwrap_or_default().max(self.clock.now())
    }

    /// Has `byte` arrive at `time`, behind all others.
    pub fn push(&mut self, time: Duration, byte: u8) {
        self.bytes.push_back((time, byte));
    }

    /// As [`Transport::read`](super::Transport::read).
    pub fn read(&mut self, buffer: &mut [u8], deadline: Duration) -> usize {
        match self.bytes.front() {
            Some(&(time, _)) if time <= deadline => self.clock.wait_until(time),
            _ => self.clock.wait_until(deadline),
        }
        let now = self.clock.now();
        let here = self.bytes.iter().take_while(|(time, _)| *time <= now);
        let count = here.count().min(buffer.len());
        for (place, (_, byte)) in buffer.iter_mut().zip(self.bytes.drain(..count)) {
            *place = byte;
        }
        count
    }

    /// As [`Transport::discard_input`](super::Transport::discard_input).
    pub fn discard(&mut self) {
        let now = self.clock.now();
        self.bytes.retain(|(time, _)| *time > now);
    }
}

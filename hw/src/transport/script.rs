//! A conversation that is known beforehand.

use std::collections::VecDeque;
use std::io;
use std::sync::Arc;
use std::time::Duration;

use super::Transport;
use crate::clock::{Clock, VirtualClock};

/// What is to be written next, and what then arrives.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Exchange {
    /// The bytes that are to be written.
    pub sent: Vec<u8>,
    /// The bytes that arrive, and how long after the write.
    pub answers: Vec<(Duration, Vec<u8>)>,
}

/// A line in memory whose other end keeps to a script: each write must be the next one of it.
#[derive(Debug)]
pub struct Script {
    clock: Arc<dyn Clock>,
    exchanges: VecDeque<Exchange>,
    /// Bytes on their way, and when they arrive.
    arriving: VecDeque<(Duration, u8)>,
}

impl Script {
    /// A line of 1 Mbaud and 1 ms of latency, whose time is virtual.
    pub fn new(exchanges: impl IntoIterator<Item = Exchange>) -> Self {
        Self {
            clock: Arc::new(VirtualClock::new()),
            exchanges: exchanges.into_iter().collect(),
            arriving: VecDeque::new(),
        }
    }

    /// What has not been written yet.
    pub fn left(&self) -> impl ExactSizeIterator<Item = &Exchange> {
        self.exchanges.iter()
    }
}

impl Transport for Script {
    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        let Some(exchange) = self.exchanges.pop_front() else {
            let text = format!("{bytes:02X?} was written after the end of the script");
            return Err(io::Error::new(io::ErrorKind::InvalidData, text));
        };
        if exchange.sent != bytes {
            let text = format!("{bytes:02X?} was written instead of {:02X?}", exchange.sent);
            return Err(io::Error::new(io::ErrorKind::InvalidData, text));
        }
        let now = self.clock.now();
        for (delay, bytes) in exchange.answers {
            let bytes = bytes.into_iter().map(|byte| (now + delay, byte));
            self.arriving.extend(bytes);
        }
        Ok(())
    }

    fn read(&mut self, buffer: &mut [u8], deadline: Duration) -> io::Result<usize> {
        match self.arriving.front() {
            Some(&(time, _)) if time <= deadline => self.clock.wait_until(time),
            _ => self.clock.wait_until(deadline),
        }
        let now = self.clock.now();
        let here = self.arriving.iter().take_while(|(time, _)| *time <= now);
        let count = here.count().min(buffer.len());
        for (place, (_, byte)) in buffer.iter_mut().zip(self.arriving.drain(..count)) {
            *place = byte;
        }
        Ok(count)
    }

    fn discard_input(&mut self) -> io::Result<()> {
        let now = self.clock.now();
        self.arriving.retain(|(time, _)| *time > now);
        Ok(())
    }

    fn clock(&self) -> &Arc<dyn Clock> {
        &self.clock
    }

    fn baud_rate(&self) -> u32 {
        1_000_000
    }

    fn latency(&self) -> Duration {
        Duration::from_millis(1)
    }
}

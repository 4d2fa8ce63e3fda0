//! A line that pays no heed to what is asked.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use super::hw::clock::{Clock, VirtualClock};
use super::hw::transport::Transport;

/// Bytes that arrive at a time.
const PIECE: usize = 16;

/// A line in memory on which the same bytes come, 16 at a time, whatever is sent: what a driver must survive.
#[derive(Debug)]
pub struct NoiseTransport {
    clock: Arc<dyn Clock>,
    bytes: Vec<u8>,
    at: usize,
}

impl NoiseTransport {
    /// A line of 1 Mbaud and 1 ms of latency, whose time is virtual.
    pub fn new(bytes: impl Into<Vec<u8>>) -> Self {
        Self {
            clock: Arc::new(VirtualClock::new()),
            bytes: bytes.into(),
            at: 0,
        }
    }
}

impl Transport for NoiseTransport {
    fn write(&mut self, _: &[u8]) -> io::Result<()> {
        Ok(())
    }

    fn read(&mut self, buffer: &mut [u8], deadline: Duration) -> io::Result<usize> {
        let left = &self.bytes[self.at..];
        let count = left.len().min(buffer.len()).min(PIECE);
        buffer[..count].copy_from_slice(&left[..count]);
        self.at += count;
        if count == 0 {
            self.clock.wait_until(deadline);
        }
        Ok(count)
    }

    fn discard_input(&mut self) -> io::Result<()> {
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

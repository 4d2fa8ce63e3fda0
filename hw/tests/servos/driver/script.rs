//! A conversation that is known beforehand.

use std::collections::VecDeque;
use std::io;
use std::sync::Arc;
use std::time::Duration;

use tdcr_hw::clock::{Clock, VirtualClock};
use tdcr_hw::transport::{Arriving, Transport};

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
    exchanges: VecDeque<Exchange>,
    arriving: Arriving,
}

impl Script {
    /// A line of 1 Mbaud and 1 ms of latency, whose time is virtual.
    pub fn new(exchanges: impl IntoIterator<Item = Exchange>) -> Self {
        Self {
            exchanges: exchanges.into_iter().collect(),
            arriving: Arriving::new(Arc::new(VirtualClock::new())),
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
        let now = self.clock().now();
        for (delay, bytes) in exchange.answers {
            for byte in bytes {
                self.arriving.push(now + delay, byte);
            }
        }
        Ok(())
    }

    fn read(&mut self, buffer: &mut [u8], deadline: Duration) -> io::Result<usize> {
        Ok(self.arriving.read(buffer, deadline))
    }

    fn discard_input(&mut self) -> io::Result<()> {
        self.arriving.discard();
        Ok(())
    }

    fn clock(&self) -> &Arc<dyn Clock> {
        self.arriving.clock()
    }

    fn baud_rate(&self) -> u32 {
        1_000_000
    }

    fn latency(&self) -> Duration {
        Duration::from_millis(1)
    }
}

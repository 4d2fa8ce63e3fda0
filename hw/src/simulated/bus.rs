//! The simulated line as a transport in memory.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use super::Simulator;
use crate::clock::Clock;
use crate::transport::Transport;

/// The computer's end of the line.
#[derive(Clone, Debug)]
pub struct SimulatedBus {
    simulator: Simulator,
}

impl SimulatedBus {
    pub(super) fn new(simulator: Simulator) -> Self {
        Self { simulator }
    }

    /// Sets the bits per second that the computer talks with.
    pub fn set_baud_rate(&mut self, baud_rate: u32) {
        self.simulator.now().wire.set_baud_rate(baud_rate);
    }

    /// What a call on a pulled cable gives.
    fn plugged(&self) -> io::Result<()> {
        match self.simulator.now().unplugged {
            false => Ok(()),
            true => Err(io::Error::new(
                io::ErrorKind::NotConnected,
                "the cable of the simulated bus is unplugged",
            )),
        }
    }
}

impl Transport for SimulatedBus {
    fn write(&mut self, mut bytes: &[u8]) -> io::Result<()> {
        while !bytes.is_empty() {
            self.plugged()?;
            let clock = &self.simulator.clock;
            let mut world = self.simulator.now();
            let (first, rest) = bytes.split_at(bytes.len().min(world.wire.room()));
            world.wire.send(clock.now(), first);
            bytes = rest;
            // A full buffer holds its writer up until some of it is sent.
            if let Some(next) = world.wire.next_arrival().filter(|_| !bytes.is_empty()) {
                drop(world);
                clock.wait_until(next);
            }
        }
        Ok(())
    }

    fn read(&mut self, buffer: &mut [u8], deadline: Duration) -> io::Result<usize> {
        loop {
            self.plugged()?;
            let clock = &self.simulator.clock;
            let now = clock.now();
            let mut world = self.simulator.now();
            let count = world.wire.receive(now, buffer);
            if count > 0 || buffer.is_empty() || now >= deadline {
                return Ok(count);
            }
            let next = world.next_event().unwrap_or(deadline);
            drop(world);
            clock.wait_until(next.min(deadline));
        }
    }

    fn discard_input(&mut self) -> io::Result<()> {
        self.plugged()?;
        let now = self.simulator.clock.now();
        self.simulator.now().wire.discard(now);
        Ok(())
    }

    fn clock(&self) -> &Arc<dyn Clock> {
        &self.simulator.clock
    }

    fn baud_rate(&self) -> u32 {
        self.simulator.world().wire.baud_rate()
    }

    fn latency(&self) -> Duration {
        self.simulator.world().wire.latency()
    }
}

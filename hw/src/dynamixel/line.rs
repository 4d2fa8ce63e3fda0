//! One exchange after the other on a half-duplex line: an instruction out, statuses back, within deadlines.

use std::io;
use std::ops::ControlFlow;
use std::time::Duration;

use super::frame::{Decoder, PREFIX, PacketId};
use super::instruction::Instruction;
use super::joined::{self, Section, sections};
use super::status::Status;
use crate::clock::Clock;
use crate::servo::ServoId;
use crate::transport::Transport;

/// Bits of a byte on the line: start, eight of data, stop.
const BITS_PER_BYTE: f64 = 10.0;
/// Largest "Return Delay Time": 254 times 2 us.
pub(super) const LONGEST_RETURN_DELAY: Duration = Duration::from_micros(508);
/// Bytes of a status without parameters.
pub(super) const EMPTY_STATUS: usize = 11;

/// How a wait for statuses ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Received {
    /// With nothing on the line, or nothing more.
    Silence,
    /// With bytes that were no status that anybody waited for.
    Noise,
}

#[derive(Debug)]
pub(super) struct Line<T> {
    transport: T,
    decoder: Decoder,
    /// What is sent.
    output: Vec<u8>,
    input: Box<[u8; 256]>,
}

impl<T: Transport> Line<T> {
    pub fn new(transport: T) -> Self {
        Self {
            transport,
            decoder: Decoder::new(),
            output: Vec::new(),
            input: Box::new([0; 256]),
        }
    }

    pub fn transport(&self) -> &T {
        &self.transport
    }

    pub fn transport_mut(&mut self) -> &mut T {
        &mut self.transport
    }

    pub fn into_transport(self) -> T {
        self.transport
    }

    pub fn clock(&self) -> &dyn Clock {
        self.transport.clock().as_ref()
    }

    /// How long these many bytes take.
    pub fn time_of(&self, bytes: usize) -> Duration {
        // A line of no speed is as slow as one can be.
        let rate = f64::from(self.transport.baud_rate().max(1));
        Duration::from_secs_f64(bytes as f64 * BITS_PER_BYTE / rate)
    }

    /// Sends an instruction, after which nothing that arrived earlier is taken for its answer. Returns when, by the clock, its
    /// last byte is on the line at the latest.
    pub fn send(&mut self, id: PacketId, instruction: Instruction) -> io::Result<Duration> {
        self.output.clear();
        instruction
            .encode(id, &mut self.output)
            .map_err(|error| io::Error::new(io::ErrorKind::InvalidInput, error))?;
        self.transport.discard_input()?;
        self.decoder.clear();
        let start = self.clock().now();
        self.transport.write(&self.output)?;
        Ok(start + self.time_of(self.output.len()))
    }

    /// When answers of `bytes` in all, each after its servo's delay, to an instruction that ends at `sent` have arrived.
    pub fn deadline(&self, sent: Duration, delays: Duration, bytes: usize) -> Duration {
        sent.max(self.clock().now()) + delays + self.time_of(bytes) + self.transport.latency()
    }

    /// Hands each status to `take` until it breaks off or the deadline passes.
    pub fn listen(
        &mut self,
        deadline: Duration,
        mut take: impl FnMut(Status) -> ControlFlow<()>,
    ) -> io::Result<Received> {
        let mut received = Received::Silence;
        let mut over = false;
        loop {
            while let Some(frame) = self.decoder.next_frame() {
                // An adapter may echo the instruction: that is no status.
                if let Some(status) = Status::decode(&frame)
                    && take(status).is_break()
                {
                    return Ok(received);
                }
            }
            if !over && self.fill(deadline)?.is_some() {
                received = Received::Noise;
                continue;
            }
            over = true;
            if self.decoder.pending().is_empty() {
                return Ok(received);
            }
            // What began will not be completed: it may hide a whole frame.
            self.decoder.give_up();
        }
    }

    /// Hands the sections of a joined status to `take`: all of them, or those before the first that is missing or damaged once
    /// the deadline has passed.
    pub fn listen_joined(
        &mut self,
        asked: &[(ServoId, usize)],
        deadline: Duration,
        mut take: impl FnMut(Section),
    ) -> io::Result<Received> {
        let mut received = Received::Silence;
        let whole = PREFIX + joined::length_field(asked.iter().map(|&(_, size)| size));
        loop {
            let pending = self.decoder.pending();
            let begun = joined::begins(pending);
            let complete = || sections(pending, asked.iter().copied()).count() == asked.len();
            // Checksums are computed once all bytes are there.
            if begun && pending.len() >= whole && complete() {
                sections(pending, asked.iter().copied()).for_each(&mut take);
                self.decoder.clear();
                return Ok(received);
            }
            if !begun && self.decoder.next_frame().is_some() {
                continue;
            }
            match self.fill(deadline)? {
                Some(()) => received = Received::Noise,
                None => break,
            }
        }
        while !self.decoder.pending().is_empty() {
            let pending = self.decoder.pending();
            if joined::begins(pending) {
                sections(pending, asked.iter().copied()).for_each(&mut take);
                break;
            }
            self.decoder.give_up();
        }
        self.decoder.clear();
        Ok(received)
    }

    /// Takes what has arrived; `None` where nothing does until the deadline, or where there is no room for more.
    fn fill(&mut self, deadline: Duration) -> io::Result<Option<()>> {
        let room = self.decoder.room().min(self.input.len());
        if room == 0 {
            return Ok(None);
        }
        let input = &mut self.input[..room];
        let count = self.transport.read(input, deadline)?.min(room);
        self.decoder.fill(&input[..count]);
        Ok((count > 0).then_some(()))
    }
}

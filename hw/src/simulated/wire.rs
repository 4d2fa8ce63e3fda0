//! The line between the computer and the servos, byte by byte in time.
//!
//! A byte takes ten bits of the baud rate. What arrives at the computer's adapter is handed on when its latency timer next
//! expires, as with USB adapters. Where two servos talk at once, a bit is 0 if either says so (open collector).

use std::collections::VecDeque;
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::fault::LATENESS;
use crate::dynamixel::{Decoder, PREFIX, PacketId};
use crate::servo::ServoId;

/// Bytes that wait on either side at most, as in the kernel's buffers; what comes beyond is lost.
pub(super) const CAPACITY: usize = 16_384;
/// Silence after which a servo takes no byte for the rest of a frame.
const FRAME_GAP: Duration = Duration::from_millis(20);

/// How often bytes go wrong.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Noise {
    pub lost: f64,
    pub corrupted: f64,
    pub duplicated: f64,
    pub late: f64,
}

/// What the servos hear.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Received {
    /// A frame.
    Frame {
        id: PacketId,
        instruction: u8,
        parameters: Vec<u8>,
    },
    /// A frame for a servo whose checksum is wrong.
    Damaged(ServoId),
}

/// The line.
#[derive(Debug)]
pub(super) struct Wire {
    baud_rate: u32,
    latency: Duration,
    pub noise: Noise,
    rng: ChaCha8Rng,
    decoder: Decoder,
    last_byte: Duration,
    /// Bytes on their way to the servos, with the times at which they are whole.
    to_servos: VecDeque<(Duration, u8)>,
    /// The same to the computer's adapter, in order.
    to_host: VecDeque<(Duration, u8)>,
}

impl Wire {
    /// A silent line.
    pub fn new(baud_rate: u32, latency: Duration, seed: u64) -> Self {
        Self {
            baud_rate,
            latency,
            noise: Noise::default(),
            rng: ChaCha8Rng::seed_from_u64(seed),
            decoder: Decoder::new(),
            last_byte: Duration::ZERO,
            to_servos: VecDeque::new(),
            to_host: VecDeque::new(),
        }
    }

    /// Bits per second that the computer talks with.
    pub fn baud_rate(&self) -> u32 {
        self.baud_rate
    }

    /// Sets these.
    pub fn set_baud_rate(&mut self, baud_rate: u32) {
        self.baud_rate = baud_rate.max(1);
    }

    /// How long the adapter may hold bytes back.
    pub fn latency(&self) -> Duration {
        self.latency
    }

    /// Time of a byte on the line.
    pub fn byte_time(&self) -> Duration {
        Duration::from_nanos(10_000_000_000 / u64::from(self.baud_rate))
    }

    /// The computer sends bytes from `now` on, after those that it is still sending.
    pub fn send(&mut self, now: Duration, bytes: &[u8]) {
        let byte_time = self.byte_time();
        let mut time = self
            .to_servos
            .back()
            .map_or(now, |&(last, _)| last.max(now));
        for &byte in bytes {
            time += byte_time;
            for byte in distort(&self.noise, &mut self.rng, byte) {
                if self.to_servos.len() < CAPACITY {
                    self.to_servos.push_back((time, byte));
                }
            }
        }
    }

    /// Room for bytes that the computer sends.
    pub fn room(&self) -> usize {
        CAPACITY - self.to_servos.len()
    }

    /// When the next byte is with the servos.
    pub fn next_arrival(&self) -> Option<Duration> {
        self.to_servos.front().map(|&(time, _)| time)
    }

    /// Takes the next byte that is with the servos by `now`; returns its time and what it completes.
    pub fn arrive(&mut self, now: Duration) -> Option<(Duration, Vec<Received>)> {
        let (time, byte) = *self.to_servos.front().filter(|(time, _)| *time <= now)?;
        self.to_servos.pop_front();
        if time.saturating_sub(self.last_byte) > FRAME_GAP {
            self.decoder.clear();
        }
        self.last_byte = time;
        let addressed = completed(self.decoder.pending());
        // One byte always fits where the decoder has said that there is no whole frame.
        self.decoder.fill(&[byte]);
        let mut received = Vec::new();
        while let Some(frame) = self.decoder.next_frame() {
            received.push(Received::Frame {
                id: frame.id,
                instruction: frame.instruction,
                parameters: frame.parameters.to_vec(),
            });
        }
        if let Some(PacketId::Servo(id)) = addressed
            && received.is_empty()
        {
            received.push(Received::Damaged(id));
        }
        Some((time, received))
    }

    /// A servo sends bytes from `start` on; returns when the last one is whole.
    pub fn answer(&mut self, start: Duration, bytes: &[u8]) -> Duration {
        let byte_time = self.byte_time();
        let late = self.rng.random::<f64>() < self.noise.late;
        let mut time = start + if late { LATENESS } else { Duration::ZERO };
        for &byte in bytes {
            time += byte_time;
            // A second copy comes between its neighbours, with which it does not collide.
            let times = [time, time + byte_time / 2];
            for (time, byte) in times
                .into_iter()
                .zip(distort(&self.noise, &mut self.rng, byte))
            {
                self.put(time, byte);
            }
        }
        start + byte_time * bytes.len() as u32
    }

    /// When the computer can next read a byte.
    pub fn next_delivery(&self) -> Option<Duration> {
        self.to_host.front().map(|&(time, _)| self.delivered(time))
    }

    /// Moves what the computer can read by `now` to the start of `buffer`; returns how many bytes that is.
    pub fn receive(&mut self, now: Duration, buffer: &mut [u8]) -> usize {
        let mut count = 0;
        while let Some(place) = buffer.get_mut(count)
            && let Some(&(time, byte)) = self.to_host.front()
            && self.delivered(time) <= now
        {
            *place = byte;
            count += 1;
            self.to_host.pop_front();
        }
        count
    }

    /// Forgets what the computer could read by `now`.
    pub fn discard(&mut self, now: Duration) {
        while self.next_delivery().is_some_and(|time| time <= now) {
            self.to_host.pop_front();
        }
    }

    /// Forgets all bytes on their way.
    pub fn clear(&mut self) {
        self.to_servos.clear();
        self.to_host.clear();
        self.decoder.clear();
    }

    /// Puts a byte on the line to the computer, in order of time.
    fn put(&mut self, time: Duration, byte: u8) {
        let half = self.byte_time() / 2;
        let place = self.to_host.partition_point(|&(other, _)| other <= time);
        let collides = |&(other, _): &(Duration, u8)| other.abs_diff(time) < half;
        let neighbours = [place.checked_sub(1), Some(place)];
        let met = (neighbours.into_iter().flatten())
            .find(|&at| self.to_host.get(at).is_some_and(collides));
        match met {
            Some(at) => self.to_host[at].1 &= byte,
            None if self.to_host.len() < CAPACITY => self.to_host.insert(place, (time, byte)),
            None => {}
        }
    }

    /// When a byte that is at the adapter at `time` is handed on.
    fn delivered(&self, time: Duration) -> Duration {
        if self.latency.is_zero() {
            return time;
        }
        let ticks = time.as_nanos().div_ceil(self.latency.as_nanos());
        Duration::from_nanos((ticks * self.latency.as_nanos()) as u64)
    }
}

/// What arrives of a byte: nothing, itself, or something else.
fn distort(noise: &Noise, rng: &mut ChaCha8Rng, byte: u8) -> impl Iterator<Item = u8> + use<> {
    let [lost, corrupted, duplicated] =
        [noise.lost, noise.corrupted, noise.duplicated].map(|share| rng.random::<f64>() < share);
    let flipped = match corrupted {
        true => 1 << rng.random_range(0..8),
        false => 0,
    };
    let times = match (lost, duplicated) {
        (true, _) => 0,
        (false, true) => 2,
        (false, false) => 1,
    };
    std::iter::repeat_n(byte ^ flipped, times)
}

/// Whom the frame is for of which `pending` has all bytes but the last.
fn completed(pending: &[u8]) -> Option<PacketId> {
    let &[_, _, _, _, id, low, high, ..] = pending else {
        return None;
    };
    let length = usize::from(u16::from_le_bytes([low, high]));
    (pending.len() + 1 == PREFIX + length)
        .then(|| PacketId::from_byte(id))
        .flatten()
}

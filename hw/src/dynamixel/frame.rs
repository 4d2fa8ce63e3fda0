//! Frames on the line: header, id, length, instruction, parameters, checksum; both ways.
//!
//! ```text
//! FF FF FD 00 | id | length, low byte first | instruction | parameters ... | CRC-16, low byte first
//!                    `-- of instruction, parameters and CRC
//! ```
//!
//! Where FF FF FD occurs from the instruction on, another FD follows it ("byte stuffing"), so that no frame contains a header.
//! Answers to fast reads are the exception: they are statuses from the broadcast id, and not stuffed. Source: ROBOTIS
//! e-Manual, "DYNAMIXEL Protocol 2.0".

use super::crc::crc16;
use crate::servo::ServoId;

/// Start of every frame.
pub const HEADER: [u8; 4] = [0xFF, 0xFF, 0xFD, 0x00];
/// Largest value of the length field that is sent or believed: the vendor's SDK receives no more.
pub const MAX_LENGTH: usize = 1024;
/// Bytes before those that the length counts.
pub const PREFIX: usize = 7;
/// Longest frame (bytes).
pub const MAX_FRAME: usize = PREFIX + MAX_LENGTH;
/// What stands at the instruction's place in a status.
pub const STATUS: u8 = 0x55;

const BROADCAST: u8 = 0xFE;
/// Instruction and checksum.
const MIN_LENGTH: usize = 3;

/// Whom an instruction is for, or a status from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PacketId {
    /// One servo.
    Servo(ServoId),
    /// All servos; as the sender of a status, those that a fast read names.
    Broadcast,
}

impl PacketId {
    /// The id on the wire; `None` for 253 and 255, which no packet has.
    pub const fn from_byte(byte: u8) -> Option<Self> {
        match ServoId::new(byte) {
            Some(id) => Some(Self::Servo(id)),
            None if byte == BROADCAST => Some(Self::Broadcast),
            None => None,
        }
    }

    /// The id on the wire.
    pub const fn byte(self) -> u8 {
        match self {
            Self::Servo(id) => id.get(),
            Self::Broadcast => BROADCAST,
        }
    }
}

/// A frame whose checksum was right, without its stuffing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame<'a> {
    /// Whom it is for, or from.
    pub id: PacketId,
    /// The instruction's number; [`STATUS`] in an answer.
    pub instruction: u8,
    /// What follows the instruction.
    pub parameters: &'a [u8],
}

/// A frame could not be written: its length would not fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "a frame of length {length} is longer than the {MAX_LENGTH} that servos receive: address fewer servos at once"
)]
pub struct FrameTooLong {
    /// The value that the length field would have.
    pub length: usize,
}

/// Writes one frame at the end of a buffer, stuffing its parameters.
#[derive(Debug)]
pub struct FrameWriter<'a> {
    bytes: &'a mut Vec<u8>,
    start: usize,
}

impl<'a> FrameWriter<'a> {
    /// Begins a frame behind what `bytes` contains.
    pub fn new(bytes: &'a mut Vec<u8>, id: PacketId, instruction: u8) -> Self {
        let start = bytes.len();
        bytes.extend_from_slice(&HEADER);
        bytes.extend_from_slice(&[id.byte(), 0, 0, instruction]);
        Self { bytes, start }
    }

    /// Adds a parameter of one byte.
    pub fn byte(&mut self, byte: u8) {
        self.bytes.push(byte);
        let body = &self.bytes[self.start + PREFIX..];
        if body.ends_with(&HEADER[..3]) {
            self.bytes.push(HEADER[2]);
        }
    }

    /// Adds a parameter of two bytes, low byte first.
    pub fn word(&mut self, word: u16) {
        self.bytes(&word.to_le_bytes());
    }

    /// Adds parameters.
    pub fn bytes(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.byte(byte);
        }
    }

    /// Ends the frame with its length and checksum.
    ///
    /// # Errors
    /// [`FrameTooLong`]; the buffer is then what it was before.
    pub fn finish(self) -> Result<(), FrameTooLong> {
        let length = self.bytes.len() - self.start - PREFIX + 2;
        let field = u16::try_from(length).ok().filter(|_| length <= MAX_LENGTH);
        let Some(field) = field else {
            self.bytes.truncate(self.start);
            return Err(FrameTooLong { length });
        };
        self.bytes[self.start + 5..self.start + PREFIX].copy_from_slice(&field.to_le_bytes());
        let crc = crc16(0, &self.bytes[self.start..]);
        self.bytes.extend_from_slice(&crc.to_le_bytes());
        Ok(())
    }
}

/// Finds frames in a stream of bytes, whatever else is in it, in the memory of one longest frame.
///
/// ```
/// use tdcr_hw::dynamixel::{Decoder, Instruction, PacketId};
///
/// // The e-Manual's ping of servo 1, behind noise.
/// let bytes = [0x00, 0xFF, 0xFF, 0xFF, 0xFD, 0x00, 0x01, 0x03, 0x00, 0x01, 0x19, 0x4E];
/// let mut decoder = Decoder::new();
/// assert_eq!(decoder.fill(&bytes), bytes.len());
/// let frame = decoder.next_frame().expect("a frame");
/// assert_eq!(Instruction::decode(&frame), Ok(Instruction::Ping));
/// # assert_eq!(frame.id.byte(), 1);
/// ```
#[derive(Clone, Debug)]
pub struct Decoder {
    buffer: Box<[u8; MAX_FRAME]>,
    /// The bytes not yet understood lie in `start..end`.
    start: usize,
    end: usize,
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Decoder {
    /// A decoder that has seen nothing.
    pub fn new() -> Self {
        Self {
            buffer: Box::new([0; MAX_FRAME]),
            start: 0,
            end: 0,
        }
    }

    /// Takes as much of `bytes` as there is room for and says how many bytes these are: at least one, unless there are none,
    /// once [`next_frame`](Self::next_frame) has returned `None`.
    pub fn fill(&mut self, bytes: &[u8]) -> usize {
        self.buffer.copy_within(self.start..self.end, 0);
        self.end -= self.start;
        self.start = 0;
        let taken = bytes.len().min(MAX_FRAME - self.end);
        self.buffer[self.end..self.end + taken].copy_from_slice(&bytes[..taken]);
        self.end += taken;
        taken
    }

    /// How many bytes [`fill`](Self::fill) takes.
    pub fn room(&self) -> usize {
        MAX_FRAME - (self.end - self.start)
    }

    /// The next frame among the bytes taken. `None`: none is complete.
    pub fn next_frame(&mut self) -> Option<Frame<'_>> {
        loop {
            match sight(self.pending()) {
                Sight::Nothing => self.start += 1,
                Sight::Unfinished => return None,
                Sight::Frame { id, length } => {
                    let body = self.start + PREFIX;
                    self.start = body + length;
                    return Some(self.open(id, body, length));
                }
            }
        }
    }

    /// Gives the frame up that has begun and is not complete: what looked like its header is skipped, so that frames after
    /// it are found. For when nothing more will come.
    pub fn give_up(&mut self) {
        if self.start < self.end {
            self.start += 1;
        }
    }

    /// Forgets all bytes.
    pub fn clear(&mut self) {
        self.start = self.end;
    }

    /// The bytes taken and not yet understood, from the first header, or part of one, on.
    pub fn pending(&mut self) -> &[u8] {
        self.seek();
        &self.buffer[self.start..self.end]
    }

    /// Skips what cannot start a frame.
    fn seek(&mut self) {
        while self.start < self.end {
            let pending = &self.buffer[self.start..self.end];
            let known = pending.len().min(HEADER.len());
            if pending[..known] == HEADER[..known] {
                return;
            }
            self.start += 1;
        }
    }

    /// The frame whose instruction is at `body`.
    fn open(&mut self, id: PacketId, body: usize, length: usize) -> Frame<'_> {
        let content = &mut self.buffer[body..body + length - 2];
        let joined = id == PacketId::Broadcast && content[0] == STATUS;
        let length = if joined {
            content.len()
        } else {
            unstuff(content)
        };
        Frame {
            id,
            instruction: content[0],
            parameters: &content[1..length],
        }
    }
}

/// What stands at the start of some bytes.
enum Sight {
    Nothing,
    Unfinished,
    Frame { id: PacketId, length: usize },
}

/// Looks for a frame in bytes that start with a header, or with a part of one and nothing behind it.
fn sight(bytes: &[u8]) -> Sight {
    let Some(&id) = bytes.get(4) else {
        return Sight::Unfinished;
    };
    let Some(id) = PacketId::from_byte(id) else {
        return Sight::Nothing;
    };
    let &[.., low, high] = &bytes[..bytes.len().min(PREFIX)] else {
        return Sight::Unfinished;
    };
    if bytes.len() < PREFIX {
        return Sight::Unfinished;
    }
    let length = usize::from(u16::from_le_bytes([low, high]));
    if !(MIN_LENGTH..=MAX_LENGTH).contains(&length) {
        return Sight::Nothing;
    }
    let Some(frame) = bytes.get(..PREFIX + length) else {
        return Sight::Unfinished;
    };
    let (content, crc) = frame.split_at(PREFIX + length - 2);
    if crc == crc16(0, content).to_le_bytes() {
        Sight::Frame { id, length }
    } else {
        Sight::Nothing
    }
}

/// Removes the FD that follows each FF FF FD, in place; returns how many bytes are left.
fn unstuff(bytes: &mut [u8]) -> usize {
    let mut kept = 0;
    let mut read = 0;
    while read < bytes.len() {
        bytes[kept] = bytes[read];
        kept += 1;
        read += 1;
        let stuffed = bytes[..kept].ends_with(&HEADER[..3]) && bytes.get(read) == Some(&HEADER[2]);
        if stuffed {
            read += 1;
        }
    }
    kept
}

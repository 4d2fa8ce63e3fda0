//! The one status with which several servos answer a fast read, each adding its section.
//!
//! ```text
//! FF FF FD 00 FE length 55 | error id data... CRC | error id data... CRC | ...
//! ```
//!
//! A section's checksum is of everything before it, earlier checksums included, so that the last one is the frame's; nothing is
//! stuffed. The first servo writes the header with the length of all sections. Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol
//! 2.0", Fast Sync Read and Fast Bulk Read; the examples there fix what the text leaves open.

use super::crc::crc16;
use super::frame::{FrameTooLong, HEADER, MAX_LENGTH, PREFIX, PacketId, STATUS};
use super::status::ErrorByte;
use crate::servo::ServoId;

/// Bytes of a section besides its data: error, id, checksum.
const FRAMING: usize = 4;

/// The length field of a joined status whose sections have these many bytes of data.
pub fn length_field(data: impl IntoIterator<Item = usize>) -> usize {
    1 + data.into_iter().map(|size| FRAMING + size).sum::<usize>()
}

/// Writes a joined status, section by section: a bus on which a servo drops out stops before its section.
#[derive(Debug)]
pub struct JoinedWriter<'a> {
    bytes: &'a mut Vec<u8>,
    crc: u16,
}

impl<'a> JoinedWriter<'a> {
    /// Begins a status behind what `bytes` contains, of the length that [`length_field`] gives for all servos asked.
    ///
    /// # Errors
    /// [`FrameTooLong`].
    pub fn new(bytes: &'a mut Vec<u8>, length: usize) -> Result<Self, FrameTooLong> {
        let field = u16::try_from(length).map_err(|_| FrameTooLong { length })?;
        if length > MAX_LENGTH {
            return Err(FrameTooLong { length });
        }
        let start = bytes.len();
        let [low, high] = field.to_le_bytes();
        bytes.extend_from_slice(&HEADER);
        bytes.extend_from_slice(&[PacketId::Broadcast.byte(), low, high, STATUS]);
        let crc = crc16(0, &bytes[start..]);
        Ok(Self { bytes, crc })
    }

    /// Adds the section of one servo.
    pub fn section(&mut self, id: ServoId, error: ErrorByte, data: &[u8]) {
        let start = self.bytes.len();
        self.bytes.extend_from_slice(&[error.0, id.get()]);
        self.bytes.extend_from_slice(data);
        self.crc = crc16(self.crc, &self.bytes[start..]);
        let check = self.crc.to_le_bytes();
        self.bytes.extend_from_slice(&check);
        self.crc = crc16(self.crc, &check);
    }
}

/// What one servo wrote into a joined status.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Section<'a> {
    /// Who.
    pub id: ServoId,
    /// What was wrong.
    pub error: ErrorByte,
    /// What was asked for.
    pub data: &'a [u8],
}

/// Whether bytes begin with the header of a joined status.
pub fn begins(bytes: &[u8]) -> bool {
    bytes.starts_with(&HEADER)
        && bytes.get(4) == Some(&PacketId::Broadcast.byte())
        && bytes.get(PREFIX) == Some(&STATUS)
}

/// The sections of a joined status, up to the first that is not whole: `frame` begins with the header and may end anywhere,
/// `asked` are the servos and how many bytes of data each was asked for.
pub fn sections<'a>(
    frame: &'a [u8],
    asked: impl IntoIterator<Item = (ServoId, usize)>,
) -> impl Iterator<Item = Section<'a>> {
    let (head, mut rest) = if begins(frame) {
        frame.split_at(PREFIX + 1)
    } else {
        frame.split_at(frame.len())
    };
    let mut crc = crc16(0, head);
    asked.into_iter().map_while(move |(id, size)| {
        let (section, behind) = rest.split_at_checked(FRAMING + size)?;
        let (content, check) = section.split_at(size + 2);
        crc = crc16(crc, content);
        let whole = check == crc.to_le_bytes() && content[1] == id.get();
        crc = crc16(crc, check);
        rest = behind;
        whole.then_some(Section {
            id,
            error: ErrorByte(content[0]),
            data: &content[2..],
        })
    })
}

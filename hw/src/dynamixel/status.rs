//! Statuses: what servos answer.

use super::frame::{Frame, FrameTooLong, FrameWriter, PacketId, STATUS};
use crate::servo::Fault;

/// The error byte of a status: what was wrong with the instruction, and whether the servo reports a hardware error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ErrorByte(pub u8);

impl ErrorByte {
    /// Nothing is wrong.
    pub const NONE: Self = Self(0);
    const ALERT: u8 = 0x80;

    /// The byte that says this.
    pub const fn new(fault: Option<Fault>, alert: bool) -> Self {
        let number = match fault {
            None => 0,
            Some(fault) => number(fault),
        };
        Self(number | if alert { Self::ALERT } else { 0 })
    }

    /// Whether the servo's "Hardware Error Status" is not 0.
    pub const fn alert(self) -> bool {
        self.0 & Self::ALERT != 0
    }

    /// What was wrong with the instruction.
    pub const fn fault(self) -> Option<Fault> {
        match self.0 & !Self::ALERT {
            0 => None,
            1 => Some(Fault::Result),
            2 => Some(Fault::Instruction),
            3 => Some(Fault::Crc),
            4 => Some(Fault::DataRange),
            5 => Some(Fault::DataLength),
            6 => Some(Fault::DataLimit),
            7 => Some(Fault::Access),
            other => Some(Fault::Other(other)),
        }
    }
}

/// The number of a fault in the error byte.
const fn number(fault: Fault) -> u8 {
    match fault {
        Fault::Result => 1,
        Fault::Instruction => 2,
        Fault::Crc => 3,
        Fault::DataRange => 4,
        Fault::DataLength => 5,
        Fault::DataLimit => 6,
        Fault::Access => 7,
        Fault::Other(number) => number & !ErrorByte::ALERT,
    }
}

/// An answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Status<'a> {
    /// Who answers; [`PacketId::Broadcast`] where several do in one status (see [`joined`](super::joined)).
    pub id: PacketId,
    /// What was wrong.
    pub error: ErrorByte,
    /// What was asked for.
    pub parameters: &'a [u8],
}

impl<'a> Status<'a> {
    /// The status in a frame; `None` where it is an instruction, or has no error byte.
    pub fn decode(frame: &Frame<'a>) -> Option<Self> {
        let (&error, parameters) = frame.parameters.split_first()?;
        (frame.instruction == STATUS).then_some(Self {
            id: frame.id,
            error: ErrorByte(error),
            parameters,
        })
    }

    /// Writes it at the end of `bytes`.
    ///
    /// # Errors
    /// [`FrameTooLong`].
    pub fn encode(&self, bytes: &mut Vec<u8>) -> Result<(), FrameTooLong> {
        let mut frame = FrameWriter::new(bytes, self.id, STATUS);
        frame.byte(self.error.0);
        frame.bytes(self.parameters);
        frame.finish()
    }
}

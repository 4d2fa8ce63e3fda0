//! DYNAMIXEL servos: Protocol 2.0 as frames, instructions and statuses, and the control tables of the X330 series.
//!
//! Everything here goes both ways: a driver encodes instructions and decodes statuses, a simulated device the reverse.

mod bus;
mod control_table;
mod crc;
mod frame;
mod instruction;
pub mod joined;
mod line;
mod status;

pub use bus::{Bus, BusSettings, LastingChanges, Reply, Span};

pub use control_table::{
    Access, Area, BAUD_RATES, Bound, ControlTable, Entry, Item, Kind, Model, Unit,
};
pub use crc::crc16;
pub use frame::{
    Decoder, Frame, FrameTooLong, FrameWriter, HEADER, MAX_FRAME, MAX_LENGTH, PREFIX, PacketId,
    STATUS,
};
pub use instruction::{
    Answers, Backup, Instruction, InstructionError, Reset, bulk_read_rows, bulk_write_rows,
    sync_rows,
};
pub use status::{ErrorByte, Status};

pub use crate::servo::Fault;

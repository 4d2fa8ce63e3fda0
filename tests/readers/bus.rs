//! What goes over a bus of servos.

use tdcr::hw::dynamixel::joined::{JoinedWriter, length_field};
use tdcr::hw::dynamixel::{Answers, Backup, ErrorByte, Instruction, PacketId, Reset, Status};
use tdcr::hw::servo::ServoId;

/// An instruction of each kind.
pub fn instructions() -> Vec<u8> {
    let answers = Answers::Fast;
    let (address, length, ids) = (116, 4, &[1, 2, 3]);
    let row = &[1, 116, 0, 4, 0, 0xFF, 0xFF, 0xFD, 0x00];
    let mut bytes = Vec::new();
    for instruction in [
        Instruction::Ping,
        Instruction::Read { address, length },
        Instruction::Write { address, data: row },
        Instruction::FactoryReset(Reset::All),
        Instruction::Backup(Backup::Store),
        Instruction::ClearTurns,
        Instruction::SyncRead {
            answers,
            address,
            length,
            ids,
        },
        Instruction::SyncWrite {
            address,
            length,
            rows: &row[..5],
        },
        Instruction::BulkRead {
            answers,
            rows: &row[..5],
        },
        Instruction::BulkWrite { rows: row },
    ] {
        let encoded = instruction.encode(PacketId::Broadcast, &mut bytes);
        encoded.expect("a short frame");
    }
    bytes
}

/// What three servos answer to a driver that meets and reads them.
pub fn statuses() -> Vec<u8> {
    let mut bytes = Vec::new();
    for id in (1..4).filter_map(ServoId::new) {
        for parameters in [&[0xB0, 4, 46][..], &[2], &[250], &[], &[50; 15], &[4]] {
            let status = Status {
                id: PacketId::Servo(id),
                error: ErrorByte(0x80),
                parameters,
            };
            status.encode(&mut bytes).expect("a short frame");
        }
    }
    let mut joined = JoinedWriter::new(&mut bytes, length_field([4; 3])).expect("a short frame");
    for id in (1..4).filter_map(ServoId::new) {
        joined.section(id, ErrorByte::NONE, &[1, 2, 3, 4]);
    }
    bytes
}

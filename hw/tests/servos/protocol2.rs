//! The examples of the manufacturer's manual, encoded and decoded: `data/protocol2_examples.txt`.

use tdcr_hw::dynamixel::joined::{JoinedWriter, Section, length_field, sections};
use tdcr_hw::dynamixel::{
    Answers, Backup, Decoder, ErrorByte, Instruction, PacketId, Reset, Status, bulk_read_rows,
    bulk_write_rows, sync_rows,
};
use tdcr_hw::servo::ServoId;

/// The packets of one example: its instruction and its statuses.
fn example(name: &str) -> (Vec<u8>, Vec<Vec<u8>>) {
    let text = include_str!("../data/protocol2_examples.txt");
    let from = text.split_once(&format!("= {name}\n")).unwrap().1;
    let lines: Vec<&str> = from
        .lines()
        .take_while(|line| !line.starts_with('='))
        .collect();
    let packets = |mark| {
        let packets = lines.iter().filter_map(move |line| line.strip_prefix(mark));
        packets.map(hex).collect::<Vec<_>>()
    };
    let [instruction] = <[_; 1]>::try_from(packets("> ")).unwrap();
    (instruction, packets("< "))
}

fn hex(text: &str) -> Vec<u8> {
    text.split(' ')
        .map(|byte| u8::from_str_radix(byte, 16).unwrap())
        .collect()
}

fn servo(id: u8) -> ServoId {
    ServoId::new(id).unwrap()
}

fn one() -> PacketId {
    PacketId::Servo(servo(1))
}

fn all() -> PacketId {
    PacketId::Broadcast
}

/// The instruction is what the example says, both ways.
#[track_caller]
fn check(name: &str, id: PacketId, instruction: Instruction) {
    let (bytes, _) = example(name);
    let mut encoded = Vec::new();
    instruction.encode(id, &mut encoded).unwrap();
    assert_eq!(encoded, bytes);
    let mut decoder = Decoder::new();
    assert_eq!(decoder.fill(&bytes), bytes.len());
    let frame = decoder.next_frame().unwrap();
    assert_eq!(frame.id, id);
    assert_eq!(Instruction::decode(&frame), Ok(instruction));
}

/// The statuses are what the example says, both ways.
#[track_caller]
fn check_statuses(name: &str, statuses: &[(u8, &[u8])]) {
    let (_, examples) = example(name);
    assert_eq!(examples.len(), statuses.len());
    for (bytes, &(id, parameters)) in examples.iter().zip(statuses) {
        let status = Status {
            id: PacketId::Servo(servo(id)),
            error: ErrorByte::NONE,
            parameters,
        };
        let mut encoded = Vec::new();
        status.encode(&mut encoded).unwrap();
        assert_eq!(encoded, *bytes);
        let mut decoder = Decoder::new();
        decoder.fill(bytes);
        assert_eq!(
            Status::decode(&decoder.next_frame().unwrap()).unwrap(),
            status
        );
    }
}

#[test]
fn ping() {
    check("ping", one(), Instruction::Ping);
    check_statuses("ping", &[(1, &[6, 4, 38])]);
    check("ping of all", all(), Instruction::Ping);
    check_statuses("ping of all", &[(1, &[6, 4, 38]), (2, &[6, 4, 38])]);
}

#[test]
fn read_and_write() {
    let (address, length) = (132, 4);
    check("read", one(), Instruction::Read { address, length });
    check_statuses("read", &[(1, &[166, 0, 0, 0])]);
    let data = &512_u32.to_le_bytes();
    check("write", one(), Instruction::Write { address: 116, data });
    check_statuses("write", &[(1, &[])]);
    let data = &200_u32.to_le_bytes();
    let address = 104;
    check("reg write", one(), Instruction::RegWrite { address, data });
    check("action", one(), Instruction::Action);
}

#[test]
fn whole_servos() {
    let reset = Instruction::FactoryReset(Reset::KeepId);
    check("factory reset but for the id", one(), reset);
    check("reboot", one(), Instruction::Reboot);
    check("clear turns", one(), Instruction::ClearTurns);
    let (store, restore) = (Backup::Store, Backup::Restore);
    check("store a backup", one(), Instruction::Backup(store));
    check("restore a backup", one(), Instruction::Backup(restore));
}

#[test]
fn the_same_of_several() {
    let read = Instruction::SyncRead {
        answers: Answers::Each,
        address: 132,
        length: 4,
        ids: &[1, 2],
    };
    check("sync read", all(), read);
    check_statuses("sync read", &[(1, &[166, 0, 0, 0]), (2, &[0x1F, 8, 0, 0])]);
    let rows = &[1, 150, 0, 0, 0, 2, 170, 0, 0, 0];
    let write = Instruction::SyncWrite {
        address: 116,
        length: 4,
        rows,
    };
    check("sync write", all(), write);
    let by_servo: Vec<_> = sync_rows(4, rows).collect();
    assert_eq!(
        by_servo,
        [(servo(1), &rows[1..5]), (servo(2), &rows[6..10])]
    );
}

#[test]
fn something_of_each() {
    let rows = &[1, 144, 0, 2, 0, 2, 146, 0, 1, 0];
    let answers = Answers::Each;
    check("bulk read", all(), Instruction::BulkRead { answers, rows });
    check_statuses("bulk read", &[(1, &[119, 0]), (2, &[36])]);
    let by_servo: Vec<_> = bulk_read_rows(rows).collect();
    assert_eq!(by_servo, [(servo(1), 144, 2), (servo(2), 146, 1)]);

    let rows = &[1, 32, 0, 2, 0, 160, 0, 2, 31, 0, 1, 0, 80];
    check("bulk write", all(), Instruction::BulkWrite { rows });
    let by_servo: Vec<_> = bulk_write_rows(rows).collect();
    assert_eq!(
        by_servo,
        [(servo(1), 32, &rows[5..7]), (servo(2), 31, &rows[12..13])]
    );
}

#[test]
fn fast_reads() {
    let answers = Answers::Fast;
    let read = Instruction::SyncRead {
        answers,
        address: 132,
        length: 4,
        ids: &[3, 7, 4],
    };
    check("fast sync read", all(), read);
    let data: [(u8, &[u8]); 3] = [
        (3, &[166, 0, 0, 0]),
        (7, &[0x1F, 8, 0, 0]),
        (4, &[255, 3, 0, 0]),
    ];
    check_joined("fast sync read", &data);

    let rows = &[3, 132, 0, 4, 0, 7, 124, 0, 2, 0, 4, 146, 0, 1, 0];
    check(
        "fast bulk read",
        all(),
        Instruction::BulkRead { answers, rows },
    );
    check_joined(
        "fast bulk read",
        &[(3, &[166, 0, 0, 0]), (7, &[0xA5, 1]), (4, &[31])],
    );
}

#[track_caller]
fn check_joined(name: &str, data: &[(u8, &[u8])]) {
    let bytes = <[_; 1]>::try_from(example(name).1).unwrap().concat();
    let length = length_field(data.iter().map(|(_, data)| data.len()));
    let mut encoded = Vec::new();
    let mut writer = JoinedWriter::new(&mut encoded, length).unwrap();
    for &(id, data) in data {
        writer.section(servo(id), ErrorByte::NONE, data);
    }
    assert_eq!(encoded, bytes);
    // As a frame it is whole, too.
    let mut decoder = Decoder::new();
    decoder.fill(&bytes);
    assert_eq!(decoder.next_frame().unwrap().id, all());

    let asked = || data.iter().map(|&(id, data)| (servo(id), data.len()));
    let expected: Vec<_> = data
        .iter()
        .map(|&(id, data)| Section {
            id: servo(id),
            error: ErrorByte::NONE,
            data,
        })
        .collect();
    assert!(sections(&bytes, asked()).eq(expected.iter().copied()));
    // Where a servo drops out, those before it are kept.
    for end in 0..bytes.len() {
        let kept: Vec<_> = sections(&bytes[..end], asked()).collect();
        assert_eq!(kept, expected[..kept.len()]);
        let written: usize = expected
            .iter()
            .map(|section| section.data.len() + 4)
            .scan(8, |sum, size| {
                *sum += size;
                Some(*sum)
            })
            .filter(|&behind| behind <= end)
            .count();
        assert_eq!(kept.len(), written);
    }
}

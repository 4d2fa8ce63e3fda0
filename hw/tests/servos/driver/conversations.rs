//! The examples of the manufacturer's manual, word for word, and what goes wrong around them.

use std::time::Duration;

use tdcr_hw::dynamixel::{Backup, Bus, BusSettings, LastingChanges, Reset, Span};
use tdcr_hw::servo::{Fault, Identity, ServoBus, ServoError, ServoId};

use super::script::{Exchange, Script};

fn hex(text: &str) -> Vec<u8> {
    text.split_whitespace()
        .map(|byte| u8::from_str_radix(byte, 16).unwrap())
        .collect()
}

/// An example of the manual: its instruction, and its statuses 1 ms apart.
fn example(name: &str) -> Exchange {
    let text = include_str!("../../data/protocol2_examples.txt");
    let from = text.split_once(&format!("= {name}\n")).unwrap().1;
    let lines: Vec<&str> = from
        .lines()
        .take_while(|line| !line.starts_with('='))
        .collect();
    let sent = lines
        .iter()
        .find_map(|line| line.strip_prefix("> "))
        .unwrap();
    let answers = lines.iter().filter_map(|line| line.strip_prefix("< "));
    Exchange {
        sent: hex(sent),
        answers: (0..)
            .zip(answers)
            .map(|(at, answer)| (Duration::from_micros(100 * at), hex(answer)))
            .collect(),
    }
}

fn bus(exchanges: impl IntoIterator<Item = Exchange>) -> Bus<Script> {
    Bus::new(Script::new(exchanges), BusSettings::default())
}

fn servo(id: u8) -> ServoId {
    ServoId::new(id).unwrap()
}

const XM430: Identity = Identity {
    model: 1030,
    firmware: 38,
};

#[test]
fn each_instruction_is_the_manuals() {
    let names = [
        "ping",
        "read",
        "write",
        "reg write",
        "clear turns",
        "reboot",
        "ping of all",
        "sync write",
        "bulk write",
    ];
    let mut bus = bus(names.map(example));
    let one = servo(1);
    assert_eq!(bus.ping(one).unwrap(), XM430);
    assert_eq!(bus.read(one, 132, 4).unwrap().data, [166, 0, 0, 0]);
    bus.write(one, 116, &512_i32.to_le_bytes()).unwrap();
    bus.reg_write(one, 104, &200_i32.to_le_bytes()).unwrap();
    bus.clear_turns(one).unwrap();
    bus.reboot(one).unwrap();
    assert_eq!(bus.scan().unwrap(), [(one, XM430), (servo(2), XM430)]);
    let rows: [(ServoId, &[u8]); 2] = [(one, &[150, 0, 0, 0]), (servo(2), &[170, 0, 0, 0])];
    bus.sync_write(116, 4, &rows).unwrap();
    bus.bulk_write(&[(one, 32, &[160, 0]), (servo(2), 31, &[80])])
        .unwrap();
    assert_eq!(bus.transport().left().len(), 0);
}

#[test]
fn reads_of_many_are_the_manuals() {
    let mut bus = bus([example("sync read"), example("bulk read")]);
    let span = |id, address, length| Span {
        id: servo(id),
        address,
        length,
    };
    let read = bus.read_many(&[span(1, 132, 4), span(2, 132, 4)]);
    let read: Vec<_> = read.into_iter().map(|reply| reply.unwrap().data).collect();
    assert_eq!(read, [[166, 0, 0, 0], [0x1F, 8, 0, 0]]);
    let read = bus.read_many(&[span(1, 144, 2), span(2, 146, 1)]);
    let read: Vec<_> = read.into_iter().map(|reply| reply.unwrap().data).collect();
    assert_eq!(read, [vec![119, 0], vec![36]]);
}

#[test]
fn what_changes_a_servo_for_good_is_sent_only_where_it_is_allowed() {
    let mut careful = bus([]);
    for result in [
        careful.factory_reset(servo(1), Reset::KeepId),
        careful.backup(servo(1), Backup::Store),
    ] {
        let error = result.unwrap_err();
        assert!(matches!(error, ServoError::Forbidden { .. }), "{error}");
    }
    let names = [
        "factory reset but for the id",
        "store a backup",
        "restore a backup",
    ];
    let settings = BusSettings {
        lasting_changes: LastingChanges::Allowed,
        ..BusSettings::default()
    };
    let mut bus = Bus::new(Script::new(names.map(example)), settings);
    bus.factory_reset(servo(1), Reset::KeepId).unwrap();
    bus.backup(servo(1), Backup::Store).unwrap();
    bus.backup(servo(1), Backup::Restore).unwrap();
    assert_eq!(bus.transport().left().len(), 0);
}

/// The manual's read, with something else arriving.
fn read_of(answers: Vec<(Duration, Vec<u8>)>) -> Exchange {
    Exchange {
        answers,
        ..example("read")
    }
}

fn now(bytes: Vec<u8>) -> Vec<(Duration, Vec<u8>)> {
    vec![(Duration::ZERO, bytes)]
}

#[test]
fn a_status_is_found_in_noise_behind_an_echo_and_behind_one_that_broke_off() {
    let Exchange { sent, answers } = example("read");
    let status = &answers[0].1;
    for before in [
        hex("00 FF 13 FF FF FD"),
        sent,
        status[..9].to_vec(),
        // A header that promises a thousand bytes.
        hex("FF FF FD 00 01 E8 03 55"),
        // Somebody else's status.
        hex("FF FF FD 00 02 08 00 55 00 1F 08 00 00 BA BE"),
    ] {
        let mut bus = bus([read_of(now([&before[..], status].concat()))]);
        assert_eq!(bus.read(servo(1), 132, 4).unwrap().data, [166, 0, 0, 0]);
    }
}

#[test]
fn a_damaged_answer_is_asked_for_again_after_a_pause() {
    let mut status = example("read").answers[0].1.clone();
    status[9] ^= 1;
    let mut bus = bus([
        read_of(now(status.clone())),
        read_of(vec![]),
        example("read"),
    ]);
    assert_eq!(bus.read(servo(1), 132, 4).unwrap().data, [166, 0, 0, 0]);

    let mut bus = self::bus([0; 6].map(|_| read_of(now(status.clone()))));
    let error = bus.read(servo(1), 132, 4).unwrap_err();
    assert!(
        matches!(error, ServoError::Damaged { id } if id == servo(1)),
        "{error}"
    );
    assert_eq!(bus.transport().left().len(), 0);
}

#[test]
fn silence_ends_at_the_deadline_and_says_how_long_it_was() {
    let mut bus = bus([0; 6].map(|_| read_of(vec![])));
    let error = bus.read(servo(1), 132, 4).unwrap_err();
    // 14 bytes out and 15 back at 10 us each, the longest return delay, and the line's latency.
    let expected = Duration::from_micros(140 + 508 + 150 + 1000);
    assert!(
        matches!(error, ServoError::NoAnswer { waited, .. } if waited == expected),
        "{error:?}"
    );
    assert!(
        error
            .to_string()
            .contains("servo 1 did not answer within 1 ms"),
        "{error}"
    );
}

#[test]
fn instructions_that_must_not_be_repeated_are_sent_once() {
    let silent = |name| Exchange {
        answers: Vec::new(),
        ..example(name)
    };
    let names = ["reg write", "reboot", "restore a backup"];
    let settings = BusSettings {
        lasting_changes: LastingChanges::Allowed,
        ..BusSettings::default()
    };
    // The script would refuse a second one.
    let mut bus = Bus::new(Script::new(names.map(silent)), settings);
    let results = [
        bus.reg_write(servo(1), 104, &200_i32.to_le_bytes())
            .map(drop),
        bus.reboot(servo(1)),
        bus.backup(servo(1), Backup::Restore).map(drop),
    ];
    for result in results {
        assert!(
            matches!(result, Err(ServoError::NoAnswer { .. })),
            "{result:?}"
        );
    }
}

#[test]
fn a_refusal_says_what_was_refused_and_why() {
    // Error 7, and the alert.
    let refusal = |error: u8| {
        let mut bytes = Vec::new();
        let status = tdcr_hw::dynamixel::Status {
            id: tdcr_hw::dynamixel::PacketId::Servo(servo(1)),
            error: tdcr_hw::dynamixel::ErrorByte(error),
            parameters: &[],
        };
        status.encode(&mut bytes).unwrap();
        Exchange {
            answers: now(bytes),
            ..example("write")
        }
    };
    let mut bus = bus([refusal(0x87), refusal(0x80)]);
    let error = bus
        .write(servo(1), 116, &512_i32.to_le_bytes())
        .unwrap_err();
    assert!(
        matches!(
            error,
            ServoError::Refused {
                fault: Fault::Access,
                ..
            }
        ),
        "{error:?}"
    );
    let text = error.to_string();
    assert!(
        text.contains("write 4 bytes at 116 (Goal Position)"),
        "{text}"
    );
    assert!(text.contains("switch torque off first"), "{text}");
    // An alert alone is kept, and is no error.
    assert!(
        bus.write(servo(1), 116, &512_i32.to_le_bytes())
            .unwrap()
            .alert()
    );
}

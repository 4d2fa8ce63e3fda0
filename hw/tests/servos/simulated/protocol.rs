//! Instructions to one servo.

use std::time::Duration;

use tdcr_hw::clock::Clock;
use tdcr_hw::dynamixel::{
    Backup, Fault as Refusal, Instruction, Item, Model, PacketId, Reset, crc16,
};
use tdcr_hw::transport::Transport;

use super::{Desk, EXTENDED, POSITION, answers, id, setup, table};

#[test]
fn a_ping_says_model_and_firmware() {
    let mut desk = Desk::of("2m");
    let answer = desk.ask(3, &Instruction::Ping).expect("an answer");
    assert_eq!(answer.id, PacketId::Servo(id(3)));
    assert_eq!(answer.data, [0xD8, 0x04, 52]); // 1240
    assert_eq!(desk.ask(7, &Instruction::Ping), None);
}

#[test]
fn the_answer_comes_after_byte_times_and_return_delay() {
    let mut setup = setup("2m");
    setup.latency = Duration::ZERO;
    let mut desk = Desk::new(&setup);
    let ping = |desk: &mut Desk| {
        let start = desk.clock.now();
        let mut bytes = Vec::new();
        Instruction::Ping
            .encode(PacketId::Servo(id(1)), &mut bytes)
            .expect("a short frame");
        desk.bus.write(&bytes).expect("it is plugged in");
        let deadline = start + Duration::from_secs(1);
        let mut byte = [0];
        let times: Vec<_> = (0..14)
            .map(|_| {
                assert_eq!(desk.bus.read(&mut byte, deadline).expect("plugged in"), 1);
                (desk.clock.now() - start).as_micros()
            })
            .collect();
        (times[0], times[13])
    };
    // 10 bytes of 10 us, 250 times 2 us, and then 14 bytes.
    assert_eq!(ping(&mut desk), (100 + 500 + 10, 100 + 500 + 140));
    desk.write(1, Item::ReturnDelayTime, 10);
    assert_eq!(ping(&mut desk), (100 + 20 + 10, 100 + 20 + 140));
}

#[test]
fn a_latency_timer_hands_bytes_on_in_lots() {
    let mut setup = setup("2m");
    setup.latency = Duration::from_millis(16);
    let mut desk = Desk::new(&setup);
    desk.wait(0.020);
    let mut bytes = Vec::new();
    Instruction::Ping
        .encode(PacketId::Servo(id(1)), &mut bytes)
        .expect("a short frame");
    desk.bus.write(&bytes).expect("it is plugged in");
    let mut buffer = [0; 64];
    let count = desk.bus.read(&mut buffer, Duration::from_secs(1));
    assert_eq!(
        (count.ok(), desk.clock.now()),
        (Some(14), Duration::from_millis(32))
    );
    // A deadline before that gives nothing.
    desk.bus.write(&bytes).expect("it is plugged in");
    let count = desk.bus.read(&mut buffer, Duration::from_millis(40));
    assert_eq!(
        (count.ok(), desk.clock.now()),
        (Some(0), Duration::from_millis(40))
    );
}

#[test]
fn writes_are_refused_for_the_reasons_of_the_manual() {
    let mut desk = Desk::of("2m");
    // Read only, and not defined.
    assert_eq!(
        desk.try_write(1, Item::PresentPosition, 0),
        Some(Refusal::Access)
    );
    let gap = Instruction::Write {
        address: 66,
        data: &[0],
    };
    assert_eq!(
        desk.ask(1, &gap).and_then(|a| a.error.fault()),
        Some(Refusal::Access)
    );
    let beyond = Instruction::Read {
        address: 1000,
        length: 4,
    };
    assert_eq!(
        desk.ask(1, &beyond).and_then(|a| a.error.fault()),
        Some(Refusal::Access)
    );
    // Out of a range, fixed or in another item.
    assert_eq!(desk.try_write(1, Item::Led, 2), Some(Refusal::DataRange));
    assert_eq!(
        desk.try_write(1, Item::OperatingMode, 2),
        Some(Refusal::DataRange)
    );
    assert_eq!(
        desk.try_write(1, Item::GoalPosition, 4096),
        Some(Refusal::DataLimit)
    );
    desk.write(1, Item::CurrentLimit, 500);
    assert_eq!(
        desk.try_write(1, Item::GoalCurrent, 501),
        Some(Refusal::DataLimit)
    );
    assert_eq!(
        desk.try_write(1, Item::GoalCurrent, -501),
        Some(Refusal::DataLimit)
    );
    desk.write(1, Item::GoalCurrent, -500);
    // Parts of an item.
    for (address, data) in [(116, &[0, 0][..]), (117, &[0, 0, 0]), (112, &[0; 5])] {
        let write = Instruction::Write { address, data };
        let refusal = desk.ask(1, &write).and_then(|a| a.error.fault());
        assert_eq!(refusal, Some(Refusal::DataLength), "{data:?} at {address}");
    }
    // EEPROM while torque is on.
    desk.write(1, Item::TorqueEnable, 1);
    assert_eq!(
        desk.try_write(1, Item::OperatingMode, EXTENDED),
        Some(Refusal::Access)
    );
    desk.write(1, Item::Led, 1);
    desk.write(1, Item::TorqueEnable, 0);
    desk.write(1, Item::OperatingMode, EXTENDED);
    desk.write(1, Item::GoalPosition, 100_000);
    assert_eq!(
        desk.try_write(1, Item::GoalPosition, 2_000_000),
        Some(Refusal::DataRange)
    );
}

#[test]
fn a_refused_write_changes_nothing() {
    let mut desk = Desk::of("2m");
    let before = desk.read(1, Item::ProfileVelocity);
    // Profile velocity and goal position at once, the latter out of its limits.
    let mut data = 77u32.to_le_bytes().to_vec();
    data.extend(5000i32.to_le_bytes());
    let write = Instruction::Write {
        address: table().entry(Item::ProfileVelocity).address,
        data: &data,
    };
    let refusal = desk.ask(1, &write).and_then(|a| a.error.fault());
    assert_eq!(refusal, Some(Refusal::DataLimit));
    assert_eq!(desk.read(1, Item::ProfileVelocity), before);
}

#[test]
fn damaged_and_unknown_instructions_are_answered_as_such() {
    let mut desk = Desk::of("2m");
    let mut bytes = Vec::new();
    Instruction::Ping
        .encode(PacketId::Servo(id(2)), &mut bytes)
        .expect("a short frame");
    bytes[8] ^= 0x10;
    desk.bus.write(&bytes).expect("it is plugged in");
    let heard = answers(&desk.listen(Duration::from_millis(10)));
    assert_eq!(heard.len(), 1);
    assert_eq!(heard[0].error.fault(), Some(Refusal::Crc));
    // Instruction 0x77.
    let mut bytes = vec![0xFF, 0xFF, 0xFD, 0x00, 0x02, 0x03, 0x00, 0x77];
    bytes.extend(crc16(0, &bytes).to_le_bytes());
    desk.bus.write(&bytes).expect("it is plugged in");
    let heard = answers(&desk.listen(Duration::from_millis(10)));
    assert_eq!(heard[0].error.fault(), Some(Refusal::Instruction));
    // An action without anything registered.
    let action = desk.ask(2, &Instruction::Action).expect("an answer");
    assert_eq!(action.error.fault(), Some(Refusal::Instruction));
}

#[test]
fn registered_writes_wait_for_the_action() {
    let mut desk = Desk::of("2m");
    let lamp = Instruction::RegWrite {
        address: 65,
        data: &[1],
    };
    assert_eq!(desk.ask(1, &lamp).and_then(|a| a.error.fault()), None);
    assert_eq!(
        (
            desk.read(1, Item::Led),
            desk.read(1, Item::RegisteredInstruction)
        ),
        (0, 1)
    );
    assert_eq!(
        desk.ask(1, &Instruction::Action)
            .and_then(|a| a.error.fault()),
        None
    );
    assert_eq!(
        (
            desk.read(1, Item::Led),
            desk.read(1, Item::RegisteredInstruction)
        ),
        (1, 0)
    );
    // What would be refused is not kept.
    let wrong = Instruction::RegWrite {
        address: 65,
        data: &[9],
    };
    let refusal = desk.ask(1, &wrong).and_then(|a| a.error.fault());
    assert_eq!(refusal, Some(Refusal::DataRange));
    assert_eq!(desk.read(1, Item::RegisteredInstruction), 0);
}

#[test]
fn the_status_return_level_decides_what_is_answered() {
    let mut desk = Desk::of("2m");
    let read = Instruction::Read {
        address: 65,
        length: 1,
    };
    let lamp = Instruction::Write {
        address: 65,
        data: &[1],
    };
    desk.write(1, Item::StatusReturnLevel, 1);
    assert!(desk.ask(1, &lamp).is_none());
    assert_eq!(desk.ask(1, &read).map(|a| a.data), Some(vec![1]));
    let silence = Instruction::Write {
        address: 68,
        data: &[0],
    };
    assert!(desk.ask(1, &silence).is_none());
    assert!(desk.ask(1, &read).is_none());
    assert!(desk.ask(1, &Instruction::Ping).is_some());
}

#[test]
fn ids_and_baud_rates_change_after_the_answer() {
    let mut desk = Desk::of("2m");
    desk.write(1, Item::Id, 100);
    assert!(desk.ask(1, &Instruction::Ping).is_none());
    desk.write(100, Item::SecondaryId, 50);
    // The second id obeys and does not answer.
    let lamp = Instruction::Write {
        address: 65,
        data: &[1],
    };
    assert!(desk.ask(50, &lamp).is_none());
    assert_eq!(desk.read(100, Item::Led), 1);
    desk.write(100, Item::BaudRate, 1);
    assert!(desk.ask(100, &Instruction::Ping).is_none());
    desk.bus.set_baud_rate(57_600);
    assert!(desk.ask(100, &Instruction::Ping).is_some());
    assert!(desk.ask(2, &Instruction::Ping).is_none());
}

#[test]
fn indirect_bytes_stand_for_those_that_they_point_at_in_both_layouts() {
    for (firmware, first) in [(52, 208), (53, 224)] {
        let mut setup = setup("2m");
        setup.servos[0].firmware = firmware;
        let mut desk = Desk::new(&setup);
        // The lamp, then the goal position.
        let pointers: Vec<u8> = [65u16, 116, 117, 118, 119]
            .iter()
            .flat_map(|address| address.to_le_bytes())
            .collect();
        let point = Instruction::Write {
            address: 168,
            data: &pointers,
        };
        assert_eq!(desk.ask(1, &point).and_then(|a| a.error.fault()), None);
        let write = Instruction::Write {
            address: first,
            data: &[1, 0xE8, 0x03, 0, 0],
        };
        assert_eq!(desk.ask(1, &write).and_then(|a| a.error.fault()), None);
        assert_eq!(
            (desk.read(1, Item::Led), desk.read(1, Item::GoalPosition)),
            (1, 1000)
        );
        let read = Instruction::Read {
            address: first,
            length: 5,
        };
        assert_eq!(
            desk.ask(1, &read).map(|a| a.data),
            Some(vec![1, 0xE8, 0x03, 0, 0])
        );
        // Half of an item, and its range, count there too.
        for (data, refusal) in [
            (&[1, 0, 0][..], Refusal::DataLength),
            (&[2], Refusal::DataRange),
        ] {
            let write = Instruction::Write {
                address: first,
                data,
            };
            assert_eq!(
                desk.ask(1, &write).and_then(|a| a.error.fault()),
                Some(refusal)
            );
        }
        // EEPROM cannot be pointed at.
        let eeprom = Instruction::Write {
            address: 168,
            data: &[7, 0],
        };
        let refusal = desk.ask(1, &eeprom).and_then(|a| a.error.fault());
        assert_eq!(refusal, Some(Refusal::DataRange));
    }
}

#[test]
fn a_reboot_forgets_turns_goals_and_faults() {
    let mut setup = setup("2m");
    setup.servos[0].home.0 = 3 * 4096 + 100;
    let mut desk = Desk::new(&setup);
    desk.write(1, Item::OperatingMode, EXTENDED);
    // It has run for long, and yet knows no more than the angle.
    assert_eq!(desk.read(1, Item::PresentPosition), 100);
    desk.write(1, Item::ProfileVelocity, 100);
    desk.drive(1, EXTENDED);
    desk.write(1, Item::GoalPosition, -500);
    desk.wait(3.0);
    let position = desk.read(1, Item::PresentPosition);
    assert!((-520..-480).contains(&position), "{position}");
    assert_eq!(
        desk.ask(1, &Instruction::Reboot)
            .and_then(|a| a.error.fault()),
        None
    );
    assert!(desk.ask(1, &Instruction::Ping).is_none());
    desk.wait(0.3);
    assert_eq!(
        (
            desk.read(1, Item::TorqueEnable),
            desk.read(1, Item::ProfileVelocity)
        ),
        (0, 0)
    );
    assert!((desk.read(1, Item::PresentPosition) - (position + 4096)).abs() < 60);
    assert_eq!(desk.read(1, Item::OperatingMode), EXTENDED);
}

#[test]
fn clearing_turns_needs_a_servo_at_rest() {
    let mut desk = Desk::of("2m");
    desk.write(1, Item::VelocityLimit, 300);
    desk.drive(1, EXTENDED);
    desk.write(1, Item::ProfileVelocity, 100);
    desk.write(1, Item::GoalPosition, 2048 + 2000);
    desk.wait(0.5);
    let refusal = desk
        .ask(1, &Instruction::ClearTurns)
        .and_then(|a| a.error.fault());
    assert_eq!(refusal, Some(Refusal::Result));
    desk.wait(3.0);
    assert_eq!(
        desk.ask(1, &Instruction::ClearTurns)
            .and_then(|a| a.error.fault()),
        None
    );
    let position = desk.read(1, Item::PresentPosition);
    assert!((0..4096).contains(&position));
    // It does not turn back to where its goal was.
    desk.wait(0.5);
    assert!((desk.read(1, Item::PresentPosition) - position).abs() < 60);
}

#[test]
fn resets_and_backups_do_what_they_say() {
    let mut desk = Desk::of("2m");
    desk.write(4, Item::TemperatureLimit, 55);
    desk.write(4, Item::TorqueEnable, 1);
    let store = Instruction::Backup(Backup::Store);
    let refusal = desk.ask(4, &store).and_then(|a| a.error.fault());
    assert_eq!(refusal, Some(Refusal::Result));
    desk.write(4, Item::TorqueEnable, 0);
    assert_eq!(desk.ask(4, &store).and_then(|a| a.error.fault()), None);
    assert_eq!(desk.read(4, Item::BackupReady), 1);
    let reset = Instruction::FactoryReset(Reset::KeepIdAndBaudRate);
    assert_eq!(desk.ask(4, &reset).and_then(|a| a.error.fault()), None);
    desk.wait(0.3);
    assert_eq!(desk.read(4, Item::TemperatureLimit), 70);
    let restore = Instruction::Backup(Backup::Restore);
    assert_eq!(desk.ask(4, &restore).and_then(|a| a.error.fault()), None);
    desk.wait(0.3);
    assert_eq!(desk.read(4, Item::TemperatureLimit), 55);
    // A whole reset of all is not carried out; of one, id and baud rate are the factory's.
    desk.ask_all(PacketId::Broadcast, &Instruction::FactoryReset(Reset::All));
    desk.wait(0.3);
    assert_eq!(desk.read(4, Item::TemperatureLimit), 55);
    let reset = Instruction::FactoryReset(Reset::All);
    assert_eq!(desk.ask(4, &reset).and_then(|a| a.error.fault()), None);
    desk.wait(0.3);
    desk.bus.set_baud_rate(57_600);
    assert_eq!(
        desk.read(1, Item::ModelNumber),
        i64::from(Model::Xc330M288.number())
    );
    assert_eq!(desk.read(1, Item::OperatingMode), POSITION);
}

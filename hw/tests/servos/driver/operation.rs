//! Servos as their traits have it.

use std::time::Duration;

use tdcr_hw::dynamixel::{Answers, Bus, BusSettings, Item, Model};
use tdcr_hw::servo::{
    Fault, OperatingMode, PerServo, ServoBus, ServoError, ServoId, Setting, Ticks, Torque,
    WatchdogState,
};
use tdcr_hw::transport::Transport;

use super::devices::{Device, Devices};

const FAST_READ: u8 = 0x8A;
const SYNC_READ: u8 = 0x82;
const BULK_READ: u8 = 0x92;
const READ: u8 = 0x02;

fn servos<const N: usize>(ids: [u8; N]) -> [ServoId; N] {
    ids.map(|id| ServoId::new(id).unwrap())
}

fn three() -> Devices {
    Devices::new([1, 2, 3].map(|id| Device::new(id, Model::Xl330M288, 46)))
}

fn bus(devices: &mut Devices) -> Bus<&mut Devices> {
    Bus::new(devices, BusSettings::default())
}

#[track_caller]
fn all<T>(results: PerServo<T>) -> Vec<T> {
    results.into_iter().map(Result::unwrap).collect()
}

#[test]
fn one_exchange_reads_all_that_servos_say_of_themselves() {
    for (answers, number) in [(Answers::Fast, FAST_READ), (Answers::Each, SYNC_READ)] {
        let mut devices = three();
        devices.device(2).set(Item::PresentPosition, -1200);
        devices.device(2).set(Item::PresentVelocity, -100);
        devices.device(2).set(Item::PresentCurrent, -250);
        let settings = BusSettings {
            answers,
            ..BusSettings::default()
        };
        let mut bus = Bus::new(&mut devices, settings);
        let ids = servos([1, 2, 3]);
        let present = all(bus.present(&ids));
        assert_eq!(present[1].position, Ticks(-1200));
        assert!((present[1].velocity + 100.0 * 0.023_969_122_7).abs() < 1e-12);
        assert!((present[1].current + 0.25).abs() < 1e-12);
        assert!(present[1].errors.is_empty());
        assert_eq!(all(bus.voltages(&ids)), [5.0; 3]);
        assert_eq!(all(bus.temperatures(&ids)), [31.0; 3]);
        all(bus.present(&ids));
        drop(bus);
        // Once they are set up, each reading is one exchange.
        assert!(devices.heard.ends_with(&[number; 4]));
    }
}

#[test]
fn servos_of_both_layouts_are_read_together() {
    let mut devices = Devices::new([
        Device::new(1, Model::Xc330M288, 52),
        Device::new(2, Model::Xc330T288, 53),
    ]);
    devices.device(2).set(Item::PresentPosition, 6800);
    let settings = BusSettings {
        answers: Answers::Each,
        ..BusSettings::default()
    };
    let mut bus = Bus::new(&mut devices, settings);
    let ids = servos([1, 2]);
    let present = all(bus.present(&ids));
    assert_eq!(present[1].position, Ticks(6800));
    assert_eq!(bus.model(ids[1]), Some((Model::Xc330T288, 53)));
    drop(bus);
    assert_eq!(devices.heard.last(), Some(&BULK_READ));
}

#[test]
fn a_servo_that_does_not_answer_costs_no_others_data() {
    for answers in [Answers::Fast, Answers::Each] {
        for dead in [1, 2, 3] {
            let mut devices = three();
            let settings = BusSettings {
                answers,
                ..BusSettings::default()
            };
            let ids = servos([1, 2, 3]);
            let mut bus = Bus::new(&mut devices, settings);
            all(bus.present(&ids));
            let known = bus.into_transport();
            known.device(dead).dead = true;
            // What is known of the servos is kept in the bus: read anew with one gone.
            let mut bus = Bus::new(known, settings);
            for (id, present) in ids.iter().zip(bus.present(&ids)) {
                match present {
                    Ok(present) => assert_eq!(present.position, Ticks(0)),
                    Err(error) => {
                        assert!(matches!(error, ServoError::NoAnswer { .. }), "{error}");
                        assert_eq!(id.get(), dead);
                    }
                }
            }
        }
    }
}

#[test]
fn a_servo_that_falls_silent_is_asked_last_until_it_is_back() {
    let mut devices = three();
    let ids = servos([1, 2, 3]);
    let mut bus = bus(&mut devices);
    all(bus.read_items(&ids, Item::PresentPosition));
    bus.transport_mut().device(1).dead = true;
    let exchanges = |bus: &mut Bus<&mut Devices>| {
        let before = bus.transport().heard.len();
        let results = bus.read_items(&ids, Item::PresentPosition);
        let ok: Vec<_> = results.iter().map(Result::is_ok).collect();
        (ok, bus.transport().heard[before..].to_vec())
    };
    // The others wait for it: both exchanges fail, and each is asked alone.
    let (ok, heard) = exchanges(&mut bus);
    assert_eq!(ok, [false, true, true]);
    assert_eq!(heard[..2], [FAST_READ, SYNC_READ]);
    assert_eq!(heard[2..], [READ; 8]);
    // Then it is the last in line, and asked once more alone.
    let (ok, heard) = exchanges(&mut bus);
    assert_eq!(ok, [false, true, true]);
    assert_eq!(heard, [FAST_READ, READ]);
    bus.transport_mut().device(1).dead = false;
    let (ok, heard) = exchanges(&mut bus);
    assert_eq!(ok, [true; 3]);
    assert_eq!(heard, [FAST_READ]);
    let (ok, heard) = exchanges(&mut bus);
    assert_eq!((ok, heard), (vec![true; 3], vec![FAST_READ]));
}

#[test]
fn readings_are_right_or_errors_on_a_line_that_damages_bytes() {
    for every in [7, 23, 61, 97, 211] {
        let mut devices = three();
        for id in [1, 2, 3] {
            devices
                .device(id)
                .set(Item::PresentPosition, 1000 * i64::from(id));
        }
        let ids = servos([1, 2, 3]);
        let mut bus = bus(&mut devices);
        all(bus.present(&ids));
        bus.transport_mut().flip_every = Some(every);
        let mut good = 0;
        for _ in 0..200 {
            for (id, present) in ids.iter().zip(bus.present(&ids)) {
                if let Ok(present) = present {
                    assert_eq!(present.position, Ticks(1000 * i32::from(id.get())));
                    good += 1;
                }
            }
        }
        // One damaged byte in 23 leaves few statuses whole, one in 61 most of what is asked for again.
        assert!(every < 61 || good == 600, "{every}: {good}");
    }
}

#[test]
fn a_servo_that_does_not_acknowledge_is_told_to() {
    for level in [0, 1] {
        let mut devices = three();
        devices.device(2).set(Item::StatusReturnLevel, level);
        let ids = servos([1, 2, 3]);
        let mut bus = bus(&mut devices);
        all(bus.present(&ids));
        assert_eq!(
            bus.transport_mut().device(2).get(Item::StatusReturnLevel),
            2
        );
    }
}

#[test]
fn torque_goes_on_where_the_servo_is() {
    let mut devices = three();
    let ids = servos([1, 2, 3]);
    devices.device(2).set(Item::PresentPosition, 6800);
    devices.device(3).set(Item::OperatingMode, 0);
    devices.device(3).set(Item::GoalPosition, 77);
    let mut bus = bus(&mut devices);
    all(bus.set(Setting::Mode(
        &ids[..2],
        OperatingMode::CurrentBasedPosition,
    )));
    all(bus.set(Setting::Torque(&ids, Torque::On)));
    assert_eq!(all(bus.torque(&ids)), [Torque::On; 3]);
    // A servo that follows currents has no use for a position.
    assert_eq!(
        all(bus.goal_positions(&ids)),
        [Ticks(0), Ticks(6800), Ticks(77)]
    );
    let error = bus
        .set(Setting::Mode(&ids[..1], OperatingMode::Velocity))
        .remove(0)
        .unwrap_err();
    assert!(
        matches!(
            error,
            ServoError::Refused {
                fault: Fault::Access,
                ..
            }
        ),
        "{error}"
    );
    all(bus.set(Setting::Torque(&ids, Torque::Off)));
    assert_eq!(all(bus.torque(&ids)), [Torque::Off; 3]);
}

#[test]
fn torque_stays_off_where_a_servo_has_an_error_and_goes_off_all_the_same() {
    let mut devices = three();
    devices.device(2).set(Item::HardwareErrorStatus, 0b10_0100);
    let ids = servos([1, 2, 3]);
    let mut bus = bus(&mut devices);
    let present = all(bus.present(&ids));
    assert!(present[1].errors.overload && present[1].errors.overheating);
    let mut results = bus.set(Setting::Torque(&ids, Torque::On)).into_iter();
    results.next().unwrap().unwrap();
    let error = results.next().unwrap().unwrap_err();
    assert!(matches!(error, ServoError::Hardware { errors, .. } if errors.overload));
    assert_eq!(
        error.to_string(),
        "servo 2 reports overheating, overload: find the cause, then reboot it"
    );
    results.next().unwrap().unwrap();
    assert_eq!(all(bus.torque(&ids)), [Torque::On, Torque::Off, Torque::On]);
    all(bus.set(Setting::Torque(&ids, Torque::Off)));
    bus.reboot(ids[1]).unwrap();
    assert!(
        all(bus.hardware_errors(&ids))
            .iter()
            .all(|errors| errors.is_empty())
    );
}

#[test]
fn goals_are_refused_after_a_watchdog_has_tripped_until_it_is_set() {
    let mut devices = three();
    let ids = servos([1, 2, 3]);
    let mut bus = bus(&mut devices);
    let timeout = Duration::from_millis(110);
    all(bus.set(Setting::Watchdog(&ids, Some(timeout))));
    // To the next 20 ms.
    let armed = WatchdogState::Armed(Duration::from_millis(120));
    assert_eq!(all(bus.watchdog(&ids)), [armed; 3]);
    bus.transport_mut().device(2).set(Item::BusWatchdog, -1);
    all(bus.present(&ids));
    assert_eq!(
        bus.watchdog(&ids).remove(1).unwrap(),
        WatchdogState::Tripped
    );
    let goals = ids.map(|id| (id, Ticks(100)));
    let results = bus.set(Setting::GoalPositions(&goals));
    assert!(results[0].is_ok() && results[2].is_ok());
    assert!(matches!(results[1], Err(ServoError::WatchdogTripped { id }) if id == ids[1]));
    all(bus.set(Setting::Watchdog(&ids, None)));
    all(bus.set(Setting::GoalPositions(&goals)));
    assert_eq!(all(bus.goal_positions(&ids)), [Ticks(100); 3]);
    for too_long in [Duration::from_millis(2541), Duration::MAX] {
        let results = bus.set(Setting::Watchdog(&ids, Some(too_long)));
        assert!(matches!(results[0], Err(ServoError::OutOfRange { .. })));
    }
}

#[test]
fn a_servo_that_was_without_power_is_said_to_have_restarted() {
    let mut devices = three();
    let ids = servos([1, 2, 3]);
    let mut bus = bus(&mut devices);
    all(bus.present(&ids));
    bus.transport_mut().device(3).power_on(64);
    let present = bus.present(&ids);
    assert!(present[0].is_ok() && present[1].is_ok());
    assert!(matches!(present[2], Err(ServoError::Restarted { id }) if id == ids[2]));
    // It is set up again, and read.
    all(bus.present(&ids));
}

#[test]
fn currents_are_sent_in_their_unit_and_bounded_for_good() {
    let mut devices = three();
    let ids = servos([1, 2]);
    let mut bus = bus(&mut devices);
    all(bus.set(Setting::CurrentLimits(&ids.map(|id| (id, 0.9)))));
    assert_eq!(all(bus.current_limits(&ids)), [0.9, 0.9]);
    all(bus.set(Setting::GoalCurrents(&[(ids[0], -0.25), (ids[1], 0.3)])));
    for nonsense in [f64::NAN, f64::INFINITY, 40.0] {
        let results = bus.set(Setting::GoalCurrents(&[(ids[0], nonsense), (ids[1], 0.3)]));
        assert!(
            matches!(results[0], Err(ServoError::OutOfRange { .. })),
            "{nonsense}"
        );
        assert!(results[1].is_ok());
    }
    assert_eq!(bus.transport_mut().device(1).get(Item::GoalCurrent), -250);
    assert_eq!(bus.transport_mut().device(2).get(Item::GoalCurrent), 300);
}

#[test]
fn other_servos_are_refused_by_name() {
    let mut devices = three();
    devices.device(1).set(Item::ModelNumber, 1060);
    let mut bus = bus(&mut devices);
    let error = bus.present(&servos([1])).remove(0).unwrap_err();
    assert_eq!(
        error.to_string(),
        "servo 1 is of model 1060, which is not supported"
    );
}

#[test]
fn a_whole_bus_of_servos_is_read_in_as_many_frames_as_it_takes() {
    let mut devices = Devices::new((0..=252).map(|id| Device::new(id, Model::Xl330M288, 46)));
    let ids: Vec<_> = (0..=252).map(|id| ServoId::new(id).unwrap()).collect();
    let mut bus = bus(&mut devices);
    all(bus.present(&ids));
    let goals: Vec<_> = ids.iter().map(|&id| (id, Ticks(-1))).collect();
    all(bus.set(Setting::GoalPositions(&goals)));
    assert_eq!(all(bus.goal_positions(&ids)), [Ticks(-1); 253]);
    // Nothing was asked twice: 15 servos' readings at 1 Mbaud take less than 15 ms.
    let start = bus.transport().clock().now();
    all(bus.present(&ids[..15]));
    assert!(bus.transport().clock().now() - start < Duration::from_millis(15));
}

//! What goes wrong, switched on while it runs.

use std::io;
use std::time::Duration;

use tdcr_hw::clock::Clock;
use tdcr_hw::dynamixel::{Fault as Refusal, Instruction, Item, PacketId};
use tdcr_hw::simulated::{Fault, LATENESS, ScheduledFault, TendonFault};
use tdcr_hw::transport::Transport;

use super::{Desk, EXTENDED, answers, id, setup};

const PING: Instruction<'_> = Instruction::Ping;

/// How many of 200 pings are answered, and by how many bytes.
fn pings(desk: &mut Desk) -> (usize, usize) {
    let mut sum = (0, 0);
    for _ in 0..200 {
        let bytes = desk.exchange(PacketId::Servo(id(1)), &PING);
        sum.0 += usize::from(answers(&bytes).iter().any(|a| a.error.fault().is_none()));
        sum.1 += bytes.len();
    }
    sum
}

#[test]
fn bytes_are_lost_corrupted_and_doubled_by_the_seed() {
    let mut desk = Desk::of("2m");
    assert_eq!(pings(&mut desk), (200, 2800));
    for fault in [
        Fault::Lost(0.01),
        Fault::Corrupted(0.01),
        Fault::Duplicated(0.01),
    ] {
        desk.simulator.inject(fault);
        let (whole, bytes) = pings(&mut desk);
        // 24 bytes go over the line: 79 % of the conversations stay whole.
        assert!((130..185).contains(&whole), "{fault}: {whole}");
        match fault {
            Fault::Lost(_) => assert!(bytes < 2700),
            _ => assert!(bytes > 2000),
        }
        let again = |seed| {
            let mut setup = setup("2m");
            setup.seed = seed;
            let mut desk = Desk::new(&setup);
            desk.simulator.inject(fault);
            pings(&mut desk)
        };
        assert_eq!(again(1), again(1));
        assert_ne!(again(1), again(2));
        desk.simulator.repair();
    }
    assert_eq!(pings(&mut desk), (200, 2800));
}

#[test]
fn late_answers_come_late() {
    let mut desk = Desk::of("2m");
    desk.simulator.inject(Fault::Late(1.0));
    let start = desk.clock.now();
    assert!(desk.exchange(PacketId::Servo(id(1)), &PING).is_empty());
    let bytes = desk.listen(Duration::from_millis(40));
    assert_eq!(answers(&bytes).len(), 1);
    assert!(desk.clock.now() - start >= LATENESS);
}

#[test]
fn a_silent_servo_comes_back_when_it_is_repaired() {
    let mut desk = Desk::of("2m");
    let fault = Fault::Silent(id(3));
    let at = Duration::from_secs(2);
    desk.simulator.schedule(ScheduledFault { fault, at });
    assert!(desk.ask(3, &PING).is_some());
    desk.wait(2.0);
    assert!(desk.ask(3, &PING).is_none());
    assert!(desk.ask(2, &PING).is_some());
    desk.simulator.repair();
    assert!(desk.ask(3, &PING).is_some());
}

#[test]
fn hot_and_overloaded_servos_shut_down_and_say_so() {
    for (fault, bit) in [
        (Fault::Overheated(id(2)), 1 << 2),
        (Fault::Overloaded(id(2)), 1 << 5),
    ] {
        let mut desk = Desk::of("2m");
        desk.drive(2, EXTENDED);
        desk.simulator.inject(fault);
        desk.wait(0.01);
        let (status, error) = desk.read_with_error(2, Item::HardwareErrorStatus);
        assert!(error.alert() && status == bit, "{fault}");
        assert_eq!(desk.read(2, Item::TorqueEnable), 0);
        // Torque stays off until it is rebooted; the heat has to leave first.
        assert_eq!(
            desk.try_write(2, Item::TorqueEnable, 1),
            Some(Refusal::Result)
        );
        assert!(!desk.ask(1, &PING).expect("an answer").error.alert());
        desk.wait(120.0);
        assert!(
            desk.ask(2, &Instruction::Reboot)
                .expect("an answer")
                .error
                .alert()
        );
        desk.wait(0.3);
        assert!(!desk.ask(2, &PING).expect("an answer").error.alert());
        desk.drive(2, EXTENDED);
    }
}

#[test]
fn a_fault_that_shutdown_does_not_name_only_alerts() {
    let mut desk = Desk::of("2m");
    desk.write(2, Item::Shutdown, 0);
    desk.drive(2, EXTENDED);
    desk.simulator.inject(Fault::Overloaded(id(2)));
    desk.wait(0.01);
    let (torque, error) = desk.read_with_error(2, Item::TorqueEnable);
    assert!(error.alert() && torque == 1);
}

#[test]
fn a_supply_out_of_limits_is_an_error() {
    let mut desk = Desk::of("2m");
    assert_eq!(desk.read(1, Item::PresentInputVoltage), 50);
    desk.simulator.set_supply(3.0);
    desk.wait(0.01);
    assert_eq!(desk.read(1, Item::PresentInputVoltage), 30);
    assert_eq!(desk.read(1, Item::HardwareErrorStatus), 1);
}

#[test]
fn a_power_cycle_forgets_turns_and_lets_go() {
    let mut setup = setup("2m");
    setup.servos[1].home.0 = -300;
    let mut desk = Desk::new(&setup);
    desk.drive(2, EXTENDED);
    desk.simulator.inject(Fault::PowerCycled(id(2)));
    assert!(desk.ask(2, &PING).is_none());
    desk.wait(0.3);
    assert_eq!(desk.read(2, Item::TorqueEnable), 0);
    let position = desk.read(2, Item::PresentPosition);
    assert!((position - (4096 - 300)).abs() < 20, "{position}");
}

#[test]
fn a_snapped_tendon_pulls_nothing_and_its_servo_feels_nothing() {
    let mut desk = Desk::of("3m");
    for servo in 1..=9 {
        desk.drive(servo, EXTENDED);
        desk.write(servo, Item::GoalPosition, 2048 + 1500);
    }
    desk.wait(3.0);
    let before = desk.simulator.truth();
    assert!(before.tendons[3].tension > 3.0);
    desk.simulator.inject(Fault::Snapped(id(4)));
    desk.wait(1.0);
    let after = desk.simulator.truth();
    assert_eq!(
        (after.tendons[3].tension, after.tendons[3].tension_at_spool),
        (0.0, 0.0)
    );
    assert_eq!(after.tendons[3].fault, TendonFault::Snapped);
    assert!(desk.read(4, Item::PresentCurrent).abs() < 150);
    let moved = after.discs[14].translation.vector - before.discs[14].translation.vector;
    assert!(moved.norm() > 0.005);
}

#[test]
fn a_jammed_tendon_stalls_its_servo_into_an_overload() {
    let mut desk = Desk::of("3m");
    for servo in 1..=9 {
        desk.drive(servo, EXTENDED);
        desk.write(servo, Item::GoalPosition, 2048 + 1000);
    }
    desk.wait(3.0);
    desk.simulator.inject(Fault::Jammed(id(1)));
    let before = desk.simulator.truth();
    desk.write(1, Item::GoalPosition, 2048 + 4000);
    desk.wait(0.8);
    let during = desk.simulator.truth();
    assert!(
        during.tendons[0].tension_at_spool > 50.0,
        "{:?}",
        during.tendons[0]
    );
    // The robot feels nothing of it.
    let moved = during.discs[14].translation.vector - before.discs[14].translation.vector;
    assert!(
        moved.norm() < 1e-3 && (during.tendons[0].tension - before.tendons[0].tension).abs() < 0.1
    );
    desk.wait(1.0);
    let (status, error) = desk.read_with_error(1, Item::HardwareErrorStatus);
    assert!(error.alert() && status == 1 << 5, "{status}");
}

#[test]
fn a_pulled_cable_fails_every_call_until_it_is_plugged_in() {
    let mut desk = Desk::of("2m");
    desk.simulator.inject(Fault::Unplugged);
    let kind = |result: io::Result<usize>| result.map_err(|error| error.kind());
    let gone = Err(io::ErrorKind::NotConnected);
    assert_eq!(
        kind(desk.bus.read(&mut [0; 8], Duration::from_secs(1))),
        gone
    );
    assert_eq!(kind(desk.bus.write(&[0]).map(|()| 0)), gone);
    assert_eq!(kind(desk.bus.discard_input().map(|()| 0)), gone);
    desk.simulator.repair();
    assert!(desk.ask(1, &PING).is_some());
}

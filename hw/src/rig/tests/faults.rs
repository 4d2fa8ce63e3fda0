//! What goes wrong with servos and their line.

use super::*;

/// Every fault that a rig may meet on the way, and what it says of it.
#[test]
fn whatever_goes_wrong_the_tension_is_released() {
    for (fault, expected) in [
        (Fault::Lost(1.0), "was lost"),
        (Fault::Corrupted(1.0), "was lost"),
        (Fault::Silent(servo(4)), "servo 4 was lost"),
        (Fault::Overheated(servo(5)), "servo 5"),
        (Fault::Overloaded(servo(5)), "servo 5 reports overload"),
        (Fault::PowerCycled(servo(6)), "servo 6"),
        (Fault::Jammed(servo(4)), "servo 4"),
        (Fault::Unplugged, "was lost"),
    ] {
        let mut rig = rig();
        rig.engage().unwrap();
        let simulator = rig.simulator().unwrap().clone();
        rig.poll().unwrap();
        simulator.inject(fault);
        let error = wander(&mut rig).expect_err(&fault.to_string());
        let said = error.to_string();
        assert!(said.contains(expected), "{fault}: {said}");
        assert!(matches!(error, RigError::Stopped(_)), "{fault}: {error:?}");
        assert!(!rig.is_engaged());
        drop(rig);
        // Those that could not be told stop by themselves: their watchdog is due by now, and then nothing moves any more.
        simulator.clock().wait(Duration::from_secs(1));
        let rest = simulator.truth();
        simulator.clock().wait(Duration::from_secs(1));
        let later = simulator.truth();
        for (a, b) in rest.horns.iter().zip(&later.horns) {
            assert!((a - b).abs() < 20.0, "{fault}: {a} {b}");
        }
        for tendon in &later.tendons {
            assert!(tendon.tension_at_spool < 150.0, "{fault}: {tendon:?}");
        }
        simulator.repair();
        let mut bus = Bus::new(simulator.bus(), BusSettings::default());
        let ids: Vec<ServoId> = (1..=6).map(servo).collect();
        let torque = ServoBus::torque(&mut bus, &ids);
        let watchdogs = ServoBus::watchdog(&mut bus, &ids);
        for ((id, torque), watchdog) in ids.iter().zip(torque).zip(watchdogs) {
            let stopped = matches!(watchdog, Ok(crate::servo::WatchdogState::Tripped));
            assert!(
                stopped || torque.unwrap() == Torque::Off,
                "{fault}: servo {id}"
            );
        }
    }
}

/// A program that is killed tells nobody: what holds is in the servos.
#[test]
fn where_the_program_is_killed_the_servos_stop_by_themselves() {
    let mut rig = rig();
    rig.engage().unwrap();
    let simulator = rig.simulator().unwrap().clone();
    let mut program = Program::new(rig.file(), 1).unwrap();
    let (rest, shape) = (program.rest().clone(), program.draw(0).unwrap().shape);
    let path = program.path(&rest, &shape).unwrap();
    rig.move_along(&path[..path.len() / 2], &mut || ControlFlow::Continue(()))
        .unwrap();
    // Nothing is dropped.
    std::mem::forget(rig);
    simulator.clock().wait(Duration::from_secs(1));
    let mut bus = Bus::new(simulator.bus(), BusSettings::default());
    let ids: Vec<ServoId> = (1..=6).map(servo).collect();
    for watchdog in ServoBus::watchdog(&mut bus, &ids) {
        assert_eq!(watchdog.unwrap(), crate::servo::WatchdogState::Tripped);
    }
    let before = simulator.truth();
    simulator.clock().wait(Duration::from_secs(5));
    let after = simulator.truth();
    for (a, b) in before.horns.iter().zip(&after.horns) {
        assert!((a - b).abs() < 20.0, "{a} to {b}");
    }
    // Another program takes over from there.
    let parts = Parts {
        bus: Box::new(bus),
        cameras: Vec::new(),
        clock: simulator.clock().clone(),
        turns: TurnsFile::in_memory(),
    };
    let mut rig = Rig::of_parts(file(SIMULATED).unwrap(), parts).unwrap();
    rig.home_here().unwrap();
    rig.engage().unwrap();
    rig.release().unwrap();
}

/// Some bytes are lost on every line: that stops nothing.
#[test]
fn a_bad_line_stops_nothing() {
    for fault in [
        Fault::Lost(0.002),
        Fault::Corrupted(0.002),
        Fault::Duplicated(0.005),
        Fault::Late(0.05),
    ] {
        let mut rig = rig();
        rig.engage().unwrap();
        rig.simulator().unwrap().inject(fault);
        wander(&mut rig).unwrap_or_else(|error| panic!("{fault}: {error}"));
        rig.release().unwrap();
    }
}

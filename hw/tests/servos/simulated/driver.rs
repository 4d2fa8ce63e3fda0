//! Our own driver on the simulated bus, in memory and over a pseudo-terminal.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use tdcr_hw::clock::{Clock, SystemClock};
use tdcr_hw::dynamixel::{Answers, Bus, BusSettings};
use tdcr_hw::serial::{Serial, SerialSettings};
use tdcr_hw::servo::{OperatingMode, ServoBus, ServoId, Setting, Ticks, Torque, WatchdogState};
use tdcr_hw::simulated::{Fault, SimulatedBus, Simulator, Terminal};

use super::{Desk, id, setup};

fn nine() -> Vec<ServoId> {
    (1..=9).map(id).collect()
}

fn driver(desk: &Desk, settings: BusSettings) -> Bus<SimulatedBus> {
    Bus::new(desk.simulator.bus(), settings)
}

/// Switches all on in a mode, their goals where they stand.
fn engage(bus: &mut impl ServoBus, ids: &[ServoId], mode: OperatingMode) {
    for done in bus.set(Setting::Mode(ids, mode)) {
        done.expect("the mode is set");
    }
    let goals: Vec<_> = (ids.iter().zip(bus.present(ids)))
        .map(|(&id, present)| (id, present.expect("present").position))
        .collect();
    for done in bus.set(Setting::GoalPositions(&goals)) {
        done.expect("sent");
    }
    for done in bus.set(Setting::Torque(ids, Torque::On)) {
        done.expect("torque is on");
    }
}

/// Moves all by some ticks in current-based position mode, and sees them there.
fn moves(bus: &mut impl ServoBus, ids: &[ServoId], wait: impl Fn(Duration)) {
    engage(bus, ids, OperatingMode::CurrentBasedPosition);
    let currents: Vec<_> = ids.iter().map(|&id| (id, 0.6)).collect();
    assert!(
        bus.set(Setting::GoalCurrents(&currents))
            .iter()
            .all(Result::is_ok)
    );
    let goals: Vec<_> = ids.iter().map(|&id| (id, Ticks(2048 + 500))).collect();
    assert!(
        bus.set(Setting::GoalPositions(&goals))
            .iter()
            .all(Result::is_ok)
    );
    wait(Duration::from_millis(1000));
    for present in bus.present(ids) {
        let present = present.expect("an answer");
        assert!((present.position.0 - 2548).abs() < 80, "{present:?}");
        assert!(present.current.abs() <= 0.61 && present.velocity.abs() < 0.3);
    }
}

#[test]
fn it_moves_nine_servos_in_memory_with_either_answer() {
    for answers in [Answers::Fast, Answers::Each] {
        let desk = Desk::of("3m");
        let settings = BusSettings {
            answers,
            ..BusSettings::default()
        };
        let mut bus = driver(&desk, settings);
        let ids = nine();
        let found: Vec<_> = bus
            .scan()
            .expect("a line")
            .into_iter()
            .map(|(id, _)| id)
            .collect();
        assert_eq!(found, ids);
        moves(&mut bus, &ids, |time| desk.clock.wait(time));
        assert!(
            desk.simulator
                .truth()
                .tendons
                .iter()
                .all(|tendon| tendon.tension > 2.0)
        );
    }
}

#[test]
fn one_that_is_silent_costs_no_other_ones_data() {
    for answers in [Answers::Fast, Answers::Each] {
        let desk = Desk::of("3m");
        let settings = BusSettings {
            answers,
            ..BusSettings::default()
        };
        let mut bus = driver(&desk, settings);
        let ids = nine();
        assert!(bus.present(&ids).iter().all(Result::is_ok));
        desk.simulator.inject(Fault::Silent(id(4)));
        for _ in 0..3 {
            let present = bus.present(&ids);
            for (id, present) in ids.iter().zip(&present) {
                assert_eq!(present.is_ok(), id.get() != 4, "{id}: {present:?}");
            }
        }
        desk.simulator.repair();
        assert!(bus.present(&ids).iter().all(Result::is_ok));
    }
}

#[test]
fn noise_on_the_line_is_survived() {
    for fault in [
        Fault::Lost(0.001),
        Fault::Corrupted(0.001),
        Fault::Duplicated(0.001),
    ] {
        let desk = Desk::of("3m");
        let mut bus = driver(&desk, BusSettings::default());
        let ids = nine();
        engage(&mut bus, &ids, OperatingMode::ExtendedPosition);
        desk.simulator.inject(fault);
        let (mut read, mut missed) = (0, 0);
        for _ in 0..100 {
            for present in bus.present(&ids) {
                match present {
                    // What is read is right: nothing has moved.
                    Ok(present) => {
                        assert!(
                            (present.position.0 - 2048).abs() < 20,
                            "{fault}: {present:?}"
                        );
                        read += 1;
                    }
                    Err(_) => missed += 1,
                }
            }
        }
        assert!(missed * 20 < read, "{fault}: {missed} of {}", read + missed);
    }
}

#[test]
fn shutdowns_watchdogs_and_pulled_cables_are_reported() {
    let desk = Desk::of("3m");
    let mut bus = driver(&desk, BusSettings::default());
    let ids = nine();
    engage(&mut bus, &ids, OperatingMode::ExtendedPosition);
    let timeout = Some(Duration::from_millis(200));
    assert!(
        bus.set(Setting::Watchdog(&ids, timeout))
            .iter()
            .all(Result::is_ok)
    );
    desk.wait(1.0);
    let tripped = bus.watchdog(&ids);
    assert!(
        tripped
            .into_iter()
            .all(|state| matches!(state, Ok(WatchdogState::Tripped)))
    );
    assert!(
        bus.set(Setting::Watchdog(&ids, None))
            .iter()
            .all(Result::is_ok)
    );
    desk.simulator.inject(Fault::Overheated(id(2)));
    desk.wait(0.01);
    let errors = bus.hardware_errors(&ids);
    for (id, errors) in ids.iter().zip(errors) {
        assert_eq!(errors.expect("an answer").overheating, id.get() == 2);
    }
    let torque = bus.torque(&ids);
    assert!(matches!(torque[1], Ok(Torque::Off)) && matches!(torque[2], Ok(Torque::On)));
    desk.simulator.inject(Fault::Unplugged);
    assert!(bus.present(&ids).iter().all(Result::is_err));
    assert!(bus.ping(id(1)).is_err());
}

#[test]
fn it_moves_nine_servos_over_a_pseudo_terminal() {
    let clock: Arc<dyn Clock> = Arc::new(SystemClock::new());
    let simulator = Simulator::new(&setup("3m"), clock.clone()).expect("a valid setup");
    let mut terminal = Terminal::open(1_000_000).expect("a pseudo-terminal");
    let path = terminal.path().to_owned();
    let over = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| {
            terminal
                .serve(&simulator, || over.load(Ordering::Relaxed))
                .expect("it serves");
        });
        // A machine that does much else runs the server late.
        let settings = SerialSettings {
            scheduling: Duration::from_millis(100),
            ..SerialSettings::default()
        };
        let outcome = Serial::open(&path, settings, clock.clone()).map(|port| {
            let mut bus = Bus::new(port, BusSettings::default());
            std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
                moves(&mut bus, &nine(), |time| clock.wait(time));
            }))
        });
        over.store(true, Ordering::Relaxed);
        assert!(outcome.expect("the port opens").is_ok(), "see above");
    });
}

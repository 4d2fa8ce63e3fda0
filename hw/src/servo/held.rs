//! Motors that are on, for a thread that has to switch them off in place of their user.
//!
//! A process that is told to end at once cannot wait for whoever drives its servos. A [`Held`] bus notes which motors are on;
//! [`switch_off_all`] takes the lines of all of them, for good, and switches these motors off; [`while_all_off`] keeps all of
//! them off for a while.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError, Weak};
use std::thread;
use std::time::{Duration, Instant};

use super::forward::forward;
use super::{
    HardwareErrors, Identity, OperatingMode, PerServo, Present, Registers, ServoBus, ServoError,
    ServoId, Setting, Ticks, Torque, WatchdogState,
};

/// How often a motor is told to go off before one gives up.
const ATTEMPTS: usize = 3;

/// Time between looks at a lock that another thread has.
const LOOK: Duration = Duration::from_millis(5);

/// All lines of the process; those that are gone do not upgrade.
static LINES: Mutex<Vec<Weak<dyn Switch>>> = Mutex::new(Vec::new());

/// A bus whose motors are known to be on or off, as far as they were switched through it.
pub struct Held<B>(Arc<Line<B>>);

struct Line<B> {
    bus: Mutex<B>,
    /// Motors that were told to go on and did not confirm to be off since.
    on: Mutex<Vec<ServoId>>,
}

/// Switches off what is on.
trait Switch: Send + Sync {
    /// Takes the line, for good, and says what became of each motor that was on.
    fn switch_off(&self, patience: Duration) -> Vec<(ServoId, Result<(), ServoError>)>;

    /// Does `work` while nobody else has the line, where all its motors are off: says what `work` did, else `false`.
    fn while_off(&self, patience: Duration, work: &mut dyn FnMut() -> bool) -> bool;
}

fn locked<T: ?Sized>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The lock of `mutex`, if it is to be had within a time.
fn locked_within<T: ?Sized>(mutex: &Mutex<T>, patience: Duration) -> Option<MutexGuard<'_, T>> {
    let deadline = Instant::now() + patience;
    loop {
        match mutex.try_lock() {
            Ok(guard) => return Some(guard),
            Err(TryLockError::Poisoned(poisoned)) => return Some(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) if Instant::now() >= deadline => return None,
            Err(TryLockError::WouldBlock) => thread::sleep(LOOK),
        }
    }
}

impl<B: ServoBus + 'static> Held<B> {
    /// A bus whose motors [`switch_off_all`] switches off.
    pub fn new(bus: B) -> Self {
        let line = Arc::new(Line {
            bus: Mutex::new(bus),
            on: Mutex::default(),
        });
        let mut lines = locked(&LINES);
        lines.retain(|line| line.strong_count() > 0);
        let switch: Arc<dyn Switch> = line.clone();
        lines.push(Arc::downgrade(&switch));
        Self(line)
    }
}

impl<B> Held<B> {
    fn bus(&self) -> MutexGuard<'_, B> {
        locked(&self.0.bus)
    }
}

impl<B: ServoBus> ServoBus for Held<B> {
    fn set(&mut self, setting: Setting<'_>) -> PerServo<()> {
        let mut bus = self.bus();
        if let Setting::Torque(ids, Torque::On) = setting {
            // Before they are told: one that does not answer may have heard.
            locked(&self.0.on).extend(ids);
        }
        let results = bus.set(setting);
        if let Setting::Torque(ids, Torque::Off) = setting {
            let confirmed = ids
                .iter()
                .zip(&results)
                .filter(|(_, result)| result.is_ok());
            let confirmed: Vec<ServoId> = confirmed.map(|(&id, _)| id).collect();
            locked(&self.0.on).retain(|id| !confirmed.contains(id));
        }
        results
    }

    forward! { reads, |this| this.bus() }
    forward! {
        |this| this.bus(),
        fn present(ids: &[ServoId]) -> PerServo<Present>;
        fn reboot(id: ServoId) -> Result<(), ServoError>;
    }
}

impl<B: ServoBus> Switch for Line<B> {
    fn switch_off(&self, patience: Duration) -> Vec<(ServoId, Result<(), ServoError>)> {
        let bus = locked_within(&self.bus, patience);
        let mut left = locked(&self.on).clone();
        left.sort_unstable();
        left.dedup();
        let Some(mut bus) = bus else {
            let silent = |id| {
                (
                    id,
                    Err(ServoError::NoAnswer {
                        id,
                        waited: patience,
                    }),
                )
            };
            return left.into_iter().map(silent).collect();
        };
        let mut done = Vec::new();
        for attempt in 1..=ATTEMPTS {
            if left.is_empty() {
                break;
            }
            let results = bus.set(Setting::Torque(&left, Torque::Off));
            let again = |result: &Result<(), _>| result.is_err() && attempt < ATTEMPTS;
            let (failed, ended): (Vec<_>, Vec<_>) =
                (left.into_iter().zip(results)).partition(|(_, result)| again(result));
            done.extend(ended);
            left = failed.into_iter().map(|(id, _)| id).collect();
        }
        // Whoever drove these servos sends nothing any more.
        std::mem::forget(bus);
        done
    }

    fn while_off(&self, patience: Duration, work: &mut dyn FnMut() -> bool) -> bool {
        match locked_within(&self.bus, patience) {
            Some(_line) if locked(&self.on).is_empty() => work(),
            _ => false,
        }
    }
}

/// Switches off all motors of the process that are on, and says what became of each. Their lines are taken from whoever has
/// them, who waits for ever at the next call: the process is to end. A line that is not to be had within `patience` is left.
pub fn switch_off_all(patience: Duration) -> Vec<(ServoId, Result<(), ServoError>)> {
    let lines: Vec<_> = locked(&LINES).iter().filter_map(Weak::upgrade).collect();
    let off = lines.iter().map(|line| line.switch_off(patience));
    off.flatten().collect()
}

/// Does `work` where no motor of the process is on, and keeps all of them off meanwhile: who would switch one on waits. Says
/// whether it was done: not where a motor is on, nor where a line is not to be had within `patience`.
pub fn while_all_off(patience: Duration, work: impl FnOnce()) -> bool {
    // Held, so that no line is opened meanwhile.
    let lines = locked(&LINES);
    let open: Vec<_> = lines.iter().filter_map(Weak::upgrade).collect();
    let mut work = Some(work);
    nested(&open, patience, &mut || {
        if let Some(work) = work.take() {
            work();
        }
        true
    })
}

/// Does `work` while nobody else has any of `lines`.
fn nested(lines: &[Arc<dyn Switch>], patience: Duration, work: &mut dyn FnMut() -> bool) -> bool {
    match lines.split_first() {
        None => work(),
        Some((line, rest)) => line.while_off(patience, &mut || nested(rest, patience, work)),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use std::sync::mpsc::channel;

    use tdcr_sim::robot::RobotSpec;

    use super::*;
    use crate::clock::VirtualClock;
    use crate::dynamixel::{Bus, BusSettings};
    use crate::simulated::{Simulator, SimulatorSetup};

    fn ids() -> Vec<ServoId> {
        (1..=6).filter_map(ServoId::new).collect()
    }

    /// A thread that has just sent something and would send more finds the motors off, and sends nothing.
    #[test]
    fn another_thread_switches_off_what_is_on_and_keeps_the_line() {
        let setup = SimulatorSetup::of_robot(RobotSpec::standard("2m").unwrap());
        let simulator = Simulator::new(&setup, Arc::new(VirtualClock::new())).unwrap();
        let held = || Held::new(Bus::new(simulator.bus(), BusSettings::default()));
        assert!(held().0.switch_off(Duration::ZERO).is_empty());
        let mut driver = held();
        assert!(
            driver
                .set(Setting::Torque(&ids(), Torque::On))
                .iter()
                .all(Result::is_ok)
        );
        assert!(
            driver
                .set(Setting::Torque(&ids()[..1], Torque::Off))
                .iter()
                .all(Result::is_ok)
        );
        let line = driver.0.clone();
        let off = line.switch_off(Duration::from_secs(5));
        let confirmed = off.iter().map(|(id, result)| (*id, result.is_ok()));
        let expected = ids().into_iter().skip(1).map(|id| (id, true));
        assert!(confirmed.eq(expected), "{off:?}");
        // The driver's next order does not come through.
        let (sent, order) = channel();
        thread::spawn(move || {
            drop(driver.set(Setting::Torque(&ids(), Torque::On)));
            let _ = sent.send(());
        });
        assert!(order.recv_timeout(Duration::from_millis(200)).is_err());
        let mut judge = Bus::new(simulator.bus(), BusSettings::default());
        let torques = judge.torque(&ids());
        assert!(
            torques
                .iter()
                .all(|torque| matches!(torque, Ok(Torque::Off))),
            "{torques:?}"
        );
    }

    /// Of lines of its own: other tests of this process have motors on.
    #[test]
    fn while_all_are_off_nobody_switches_one_on() {
        let setup = SimulatorSetup::of_robot(RobotSpec::standard("2m").unwrap());
        let simulator = Simulator::new(&setup, Arc::new(VirtualClock::new())).unwrap();
        let held = || Held::new(Bus::new(simulator.bus(), BusSettings::default()));
        let (mut driver, other) = (held(), held());
        let lines: [Arc<dyn Switch>; 2] = [other.0.clone(), driver.0.clone()];
        let patience = Duration::from_millis(20);
        let (ready, start) = channel();
        let driving = &mut driver;
        let mut ended = Instant::now();
        let switched = thread::scope(|scope| {
            let switching = scope.spawn(move || {
                start.recv().unwrap();
                let on = driving.set(Setting::Torque(&ids(), Torque::On));
                assert!(on.iter().all(Result::is_ok));
                Instant::now()
            });
            assert!(nested(&lines, patience, &mut || {
                ready.send(()).unwrap();
                thread::sleep(Duration::from_millis(50));
                // Before the lines are free.
                ended = Instant::now();
                true
            }));
            switching.join().unwrap()
        });
        assert!(switched >= ended, "it waited");
        assert!(!nested(&lines, patience, &mut || panic!("motors are on")));
        assert!(
            driver
                .set(Setting::Torque(&ids(), Torque::Off))
                .iter()
                .all(Result::is_ok)
        );
        assert!(nested(&lines, patience, &mut || true));
        // Who has the line may be about to switch one on.
        let busy = locked(&driver.0.bus);
        assert!(!nested(&lines, patience, &mut || panic!("a line is busy")));
        drop(busy);
    }

    #[test]
    fn a_line_that_is_busy_for_long_is_left_and_its_motors_are_named() {
        let setup = SimulatorSetup::of_robot(RobotSpec::standard("2m").unwrap());
        let simulator = Simulator::new(&setup, Arc::new(VirtualClock::new())).unwrap();
        let mut driver = Held::new(Bus::new(simulator.bus(), BusSettings::default()));
        drop(driver.set(Setting::Torque(&ids(), Torque::On)));
        let busy = locked(&driver.0.bus);
        let off = driver.0.switch_off(Duration::from_millis(20));
        assert_eq!(off.len(), 6);
        assert!(off.iter().all(|(_, result)| result.is_err()));
        drop(busy);
    }
}

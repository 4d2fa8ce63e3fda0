//! What is watched in motion: pure bookkeeping, from readings to a [`Cause`].

use std::time::Duration;

use super::settings::SafetySettings;
use super::stop::Cause;
use super::winch::{Winch, WinchState};
use crate::servo::{HardwareErrors, ServoError, ServoId, Ticks, Torque};

/// A change of position between two reads that no motor makes (ticks): half a turn, in as much time as a few reads take.
const JUMP: i32 = Ticks::PER_TURN / 2;

/// How far beyond its limits a position may be (ticks): what a servo overshoots.
const OVERSHOOT: i32 = 100;

/// What was seen of a servo so far.
#[derive(Clone, Debug, Default)]
struct Seen {
    position: Option<Ticks>,
    failed: usize,
    overloaded: Option<Duration>,
    lagging: Option<Duration>,
}

/// Watches servos in motion.
#[derive(Clone, Debug)]
pub(super) struct Watch {
    seen: Vec<Seen>,
}

/// How a servo fares.
#[derive(Debug)]
pub(super) struct Vitals {
    pub temperature: Result<f64, ServoError>,
    pub errors: Result<HardwareErrors, ServoError>,
    pub torque: Result<Torque, ServoError>,
}

impl Watch {
    pub fn new(servos: usize) -> Self {
        Self {
            seen: vec![Seen::default(); servos],
        }
    }

    /// Takes a read of all servos at `now`, with the goals that they have; returns the states of those that answered. `silence` is
    /// how long the bus was silent before it, and how long it may be.
    ///
    /// # Errors
    /// The first [`Cause`] to end the motion.
    pub fn take(
        &mut self,
        now: Duration,
        winches: &[Winch],
        goals: &[Ticks],
        states: Vec<Result<WinchState, ServoError>>,
        safety: &SafetySettings,
        silence: [Duration; 2],
    ) -> Result<Vec<Option<WinchState>>, Cause> {
        let lasts = |since: &mut Option<Duration>, is: bool| {
            let began = match is {
                true => Some(since.unwrap_or(now)),
                false => None,
            };
            *since = began;
            let lasting = now.saturating_sub(began?);
            (lasting.as_secs_f64() >= safety.overload_time).then_some(lasting)
        };
        let servos = self.seen.iter_mut().zip(winches).zip(goals);
        let mut readings = Vec::with_capacity(winches.len());
        for (((seen, winch), goal), state) in servos.zip(states) {
            let id = winch.id;
            let state = match state {
                Ok(state) => state,
                Err(source) => {
                    if let Some(cause) = Cause::of(&source, silence) {
                        return Err(cause);
                    }
                    seen.failed += 1;
                    if seen.failed >= safety.lost_after {
                        let reads = seen.failed;
                        return Err(Cause::Lost { id, reads, source });
                    }
                    readings.push(None);
                    continue;
                }
            };
            seen.failed = 0;
            let position = state.position;
            if let Some(before) = seen.position.replace(position)
                && off(before, position) > JUMP
            {
                return Err(Cause::Jump {
                    id,
                    before,
                    now: position,
                });
            }
            let [low, high] = winch.limits;
            if position.0 < low.saturating_sub(OVERSHOOT)
                || position.0 > high.saturating_add(OVERSHOOT)
            {
                return Err(Cause::Beyond {
                    id,
                    position,
                    low,
                    high,
                });
            }
            let current = state.pull.abs();
            if let Some(lasting) = lasts(&mut seen.overloaded, current > winch.overload) {
                return Err(Cause::Current {
                    id,
                    current,
                    limit: winch.overload,
                    lasting,
                });
            }
            let far = off(position, *goal);
            if let Some(lasting) = lasts(&mut seen.lagging, far > safety.lag) {
                return Err(Cause::Lag {
                    id,
                    off: far,
                    lasting,
                });
            }
            readings.push(Some(state));
        }
        Ok(readings)
    }

    /// Takes a check of how the servos fare. One that does not answer it is left to [`take`](Self::take).
    ///
    /// # Errors
    /// The first [`Cause`] to end the motion.
    pub fn check(
        ids: &[ServoId],
        vitals: Vec<Vitals>,
        safety: &SafetySettings,
        silence: [Duration; 2],
    ) -> Result<(), Cause> {
        for (&id, vitals) in ids.iter().zip(vitals) {
            let error = vitals.errors.as_ref().err();
            if let Some(cause) = error.and_then(|error| Cause::of(error, silence)) {
                return Err(cause);
            }
            if let Ok(errors) = vitals.errors
                && !errors.is_empty()
            {
                return Err(Cause::Hardware { id, errors });
            }
            if let Ok(temperature) = vitals.temperature
                && temperature > safety.temperature
            {
                return Err(Cause::Heat {
                    id,
                    temperature,
                    limit: safety.temperature,
                });
            }
            if let Ok(Torque::Off) = vitals.torque {
                return Err(Cause::Off { id });
            }
        }
        Ok(())
    }
}

/// Distance of two positions (ticks).
fn off(a: Ticks, b: Ticks) -> i32 {
    a.0.saturating_sub(b.0).saturating_abs()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;
    use crate::rig::{Direction, Spool};

    const GOAL: Ticks = Ticks(500);
    /// Of the bus, and what is allowed.
    const SILENCE: [Duration; 2] = [Duration::from_millis(812), Duration::from_millis(500)];

    fn winch() -> Winch {
        Winch {
            id: ServoId::new(7).unwrap(),
            spool: Spool {
                radius: 0.005,
                direction: Direction::Up,
                home_command: 0.1,
            },
            limits: [-100, 2000],
            current_limit: 1.5,
            overload: 1.2,
            home_tension: 5.0,
        }
    }

    fn at(position: i32, pull: f64) -> Result<WinchState, ServoError> {
        Ok(WinchState {
            position: Ticks(position),
            command: 0.1,
            velocity: 0.0,
            pull,
        })
    }

    fn silent() -> Result<WinchState, ServoError> {
        Err(ServoError::NoAnswer {
            id: winch().id,
            waited: Duration::from_millis(5),
        })
    }

    /// Reads every 200 ms, and what they lead to: overload and lag may last for 0.5 s, and a servo may miss two reads.
    #[test]
    fn motions_end_when_they_should_and_not_before() {
        type Read = fn() -> Result<WinchState, ServoError>;
        let fine: Read = || at(500, 0.2);
        let tight: Read = || at(500, -1.5);
        let lagging: Read = || at(100, 0.2);
        for (name, reads, ends) in [
            ("nothing", vec![fine; 6], None),
            (
                "a peak",
                vec![tight, tight, tight, fine, tight, tight],
                None,
            ),
            (
                "an overload",
                vec![fine, tight, tight, tight, tight],
                Some("drew 1.50 A for 600 ms"),
            ),
            (
                "a short lag",
                vec![lagging, lagging, fine, lagging, lagging],
                None,
            ),
            (
                "a jam",
                vec![lagging, lagging, lagging, lagging],
                Some("stood 400 ticks from its goal for 600 ms"),
            ),
            (
                "missed reads",
                vec![silent, silent, fine, silent, silent],
                None,
            ),
            (
                "silence",
                vec![fine, silent, silent, silent],
                Some("was lost: 3 reads in a row"),
            ),
            (
                "beyond its limits",
                vec![fine, || at(2101, 0.2)],
                Some("2101 ticks from home; its limits are -100 to 2000"),
            ),
            (
                "a jump",
                vec![fine, || at(-2000, 0.2)],
                Some("went from 500 to -2000 ticks in an instant"),
            ),
            (
                "a watchdog",
                vec![fine, || Err(ServoError::WatchdogTripped { id: winch().id })],
                Some(
                    "servo 7 stopped it: the bus was silent for 812 ms, and safety.watchdog is 500 ms",
                ),
            ),
            (
                "a restart",
                vec![|| Err(ServoError::Restarted { id: winch().id })],
                Some("restarted"),
            ),
        ] {
            let mut watch = Watch::new(1);
            let safety = SafetySettings::default();
            let count = reads.len();
            let mut ended = None;
            for (k, read) in reads.into_iter().enumerate() {
                let now = Duration::from_millis(200) * k as u32;
                let states = vec![read()];
                let taken = watch.take(now, &[winch()], &[GOAL], states, &safety, SILENCE);
                if let Err(cause) = taken {
                    ended = Some((k, cause.to_string()));
                    break;
                }
            }
            match (ends, ended) {
                (None, None) => {}
                (Some(expected), Some((at, said))) => {
                    assert!(said.contains(expected), "{name}: {said}");
                    assert_eq!(at, count - 1, "{name}");
                }
                (_, ended) => panic!("{name}: {ended:?}"),
            }
        }
    }

    #[test]
    fn a_check_up_ends_motions_of_servos_that_fare_ill() {
        let well = || Vitals {
            temperature: Ok(40.0),
            errors: Ok(HardwareErrors::default()),
            torque: Ok(Torque::On),
        };
        let hot = Vitals {
            temperature: Ok(70.5),
            ..well()
        };
        let off = Vitals {
            torque: Ok(Torque::Off),
            ..well()
        };
        let overload = HardwareErrors {
            overload: true,
            ..HardwareErrors::default()
        };
        let overloaded = Vitals {
            errors: Ok(overload),
            ..well()
        };
        for (vitals, ends) in [
            (well(), None),
            (hot, Some("70.5 degrees")),
            (off, Some("went off by itself")),
            (overloaded, Some("overload")),
        ] {
            let safety = SafetySettings::default();
            let checked = Watch::check(&[winch().id], vec![vitals], &safety, SILENCE);
            let said = checked.err().map(|cause| cause.to_string());
            assert_eq!(said.is_some(), ends.is_some(), "{said:?}");
            assert!(said.unwrap_or_default().contains(ends.unwrap_or_default()));
        }
    }
}

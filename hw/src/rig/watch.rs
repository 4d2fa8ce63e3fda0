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
    slack: Option<Duration>,
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

    /// Takes a read of all servos at `now`, with the goals that they have; returns the states, those of servos that did not
    /// answer this time as they last were.
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
                    if let Some(cause) = Cause::of(&source) {
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
            if let Some(lasting) = lasts(&mut seen.overloaded, current > safety.current) {
                return Err(Cause::Current {
                    id,
                    current,
                    limit: safety.current,
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
            let is_slack = |limit: &f64| state.pull < *limit;
            if let Some(limit) = safety.slack_current
                && let Some(lasting) = lasts(&mut seen.slack, is_slack(&limit))
            {
                return Err(Cause::Slack {
                    id,
                    pull: state.pull,
                    limit,
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
    ) -> Result<(), Cause> {
        for (&id, vitals) in ids.iter().zip(vitals) {
            if let Some(cause) = vitals.errors.as_ref().err().and_then(Cause::of) {
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

//! Goals: whether servos were told them, hold them, and are there.

use std::io::ErrorKind;
use std::time::Duration;

use super::motion::{Drive, Engaged, GoalState};
use super::stop::Cause;
use super::winch::WinchState;
use super::{Rig, RigError};
use crate::servo::{PerServo, ServoError, ServoId, Setting, Ticks};

/// How often a servo is told a goal that it does not hold.
const MOST_TOLD: usize = 8;

/// A servo that is not where it was told to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OffGoal {
    /// Which one.
    pub id: ServoId,
    /// Its goal, from home.
    pub goal: Ticks,
    /// Where it is, from home.
    pub position: Ticks,
}

impl OffGoal {
    /// How far it is from its goal (ticks).
    pub fn distance(&self) -> i32 {
        self.goal.0.saturating_sub(self.position.0).saturating_abs()
    }
}

impl Engaged {
    /// The goals in the servos' own counts.
    fn counts(&self, ids: &[ServoId]) -> Vec<(ServoId, Ticks)> {
        let servos = ids.iter().zip(&self.goals).zip(&self.homes);
        servos
            .map(|((&id, goal), home)| (id, Ticks(goal.0.saturating_add(home.0))))
            .collect()
    }

    /// Something was said on the bus from `began` to `ended`.
    pub(super) fn talked(&mut self, began: Duration, ended: Duration) {
        self.silence = self.silence.max(began.saturating_sub(self.heard));
        self.heard = ended;
    }
}

impl Rig {
    /// The servo farthest from its goal at the last look, where that is farther than `motion.arrived`. A servo under a tension
    /// stands some ticks off: that takes a current, and its controller a distance for it.
    pub fn off_goal(&self) -> Option<OffGoal> {
        let Drive::Engaged(engaged) = &self.drive else {
            return None;
        };
        let servos = self.ids.iter().zip(&engaged.goals).zip(&engaged.states);
        let off = servos.map(|((&id, &goal), state)| OffGoal {
            id,
            goal,
            position: state.position,
        });
        let farthest = off.max_by_key(OffGoal::distance)?;
        (farthest.distance() > self.file.spec.motion.arrived).then_some(farthest)
    }

    /// Looks at the servos until all of them have answered one look.
    ///
    /// # Errors
    /// As [`poll`](Self::poll): servos that do not answer are lost at some time.
    pub fn read_all(&mut self) -> Result<&[WinchState], RigError> {
        loop {
            self.poll()?;
            match &self.drive {
                Drive::Engaged(engaged) if engaged.missed => {}
                Drive::Engaged(_) => break,
                Drive::Released => return Err(RigError::Released),
            }
        }
        self.last_states().ok_or(RigError::Released)
    }

    /// Sends the goals that are to be held.
    pub(super) fn send_goals(&mut self) -> Result<(), RigError> {
        let Drive::Engaged(engaged) = &mut self.drive else {
            return Err(RigError::Released);
        };
        engaged.goal_state = match engaged.goal_state {
            GoalState::Sent(times) => GoalState::Sent(times + 1),
            GoalState::Confirmed => GoalState::Sent(1),
        };
        let counts = engaged.counts(&self.ids);
        let began = self.clock.now();
        let sent = self.bus.set(Setting::GoalPositions(&counts));
        engaged.talked(began, self.clock.now());
        self.judge(sent)
    }

    /// Asks servos that were told goals whether they hold them, and tells those that do not once more: goals may be lost on the
    /// line.
    pub(super) fn make_sure_of_goals(&mut self) -> Result<(), RigError> {
        let Drive::Engaged(engaged) = &mut self.drive else {
            return Err(RigError::Released);
        };
        let GoalState::Sent(times) = engaged.goal_state else {
            return Ok(());
        };
        let began = self.clock.now();
        let found = self.bus.goal_positions(&self.ids);
        engaged.talked(began, self.clock.now());
        let counts = engaged.counts(&self.ids);
        let servos = counts.iter().zip(&found).zip(&engaged.homes);
        let missed: Vec<_> = servos
            .filter(|(((_, goal), held), _)| !matches!(held, Ok(held) if held == goal))
            .collect();
        if missed.is_empty() {
            engaged.goal_state = GoalState::Confirmed;
            return Ok(());
        }
        // What a servo does that does not answer, reading tells.
        let refuses = missed.iter().find_map(|(((id, goal), held), home)| {
            let from_home = |count: &Ticks| Ticks(count.0.saturating_sub(home.0));
            Some(Cause::Goal {
                id: *id,
                goal: from_home(goal),
                held: from_home(held.as_ref().ok()?),
                times,
            })
        });
        match refuses {
            Some(cause) if times >= MOST_TOLD => Err(self.stop(cause)),
            _ => self.send_goals(),
        }
    }

    /// Judges whether goals were sent. That one was lost on the line, reading back tells.
    fn judge(&mut self, sent: PerServo<()>) -> Result<(), RigError> {
        let Drive::Engaged(engaged) = &self.drive else {
            return Err(RigError::Released);
        };
        let silence = [engaged.silence, self.file.spec.safety.watchdog()];
        let cause = self.ids.iter().zip(sent).find_map(|(&id, sent)| {
            let source = sent.err()?;
            // A line that fails fails for readings too, which say for how long; a recording refuses what was not recorded.
            let passes = match &source {
                ServoError::Line { source } => source.kind() != ErrorKind::Unsupported,
                error => error.may_pass(),
            };
            match Cause::of(&source, silence) {
                None if passes => {
                    tracing::debug!("{source}");
                    None
                }
                None => Some(Cause::Refused { id, source }),
                cause => cause,
            }
        });
        cause.map_or(Ok(()), |cause| Err(self.stop(cause)))
    }
}

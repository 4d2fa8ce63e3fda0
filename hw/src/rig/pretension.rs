//! Tensioning the tendons: winding until each servo pulls with the same current.

use std::ops::ControlFlow;

use super::{Rig, RigError, WinchState};
use crate::servo::{ServoId, Ticks};

/// How often a servo may turn back before its current counts as one that it cannot be brought to: below what its gear's friction takes,
/// or finer than steps are.
const MOST_REVERSALS: usize = 20;

/// How tendons are tensioned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PretensionSettings {
    /// Current that each servo is to pull with (A).
    pub current: f64,
    /// Share of it that a servo may be off by.
    pub tolerance: f64,
    /// Ticks that a servo winds at once.
    pub step: i32,
    /// Looks at the servos after each step, whose currents are averaged.
    pub looks: usize,
    /// Ticks that a servo may wind in all.
    pub most: i32,
}

/// What tensioning did to a servo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pretensioned {
    /// Which one.
    pub id: ServoId,
    /// How far it wound, as it counts (ticks).
    pub wound: i32,
    /// What it pulls with in the end (A).
    pub pull: f64,
}

impl Default for PretensionSettings {
    /// 50 mA within a tenth, in steps of 10 ticks, over two turns at most.
    fn default() -> Self {
        Self {
            current: 0.05,
            tolerance: 0.1,
            step: 10,
            looks: 4,
            most: 2 * Ticks::PER_TURN,
        }
    }
}

impl Rig {
    /// Winds the tendons until each servo pulls with the current of `settings`, the weakest first, and takes where they then stand
    /// for home. The robot has to stand straight. `show` sees the states after each step and says whether to go on.
    ///
    /// # Errors
    /// [`RigError::Pretension`] where a servo winds all it may before it pulls so; [`RigError::Unsteady`] where it winds back and forth
    /// and never does; [`RigError::Interrupted`]; as [`engage`](Self::engage) and [`step`](Self::step). The motors are off then, and homes as they were found.
    pub fn pretension(
        &mut self,
        settings: &PretensionSettings,
        show: &mut dyn FnMut(&[WinchState]) -> ControlFlow<()>,
    ) -> Result<Vec<Pretensioned>, RigError> {
        self.check_pulls(&[settings.current])?;
        // Positions count from here meanwhile.
        self.home_here()?;
        self.engage()?;
        let found = self.wind(settings, show);
        match found {
            Ok(found) => {
                let released = self.home_here();
                self.release_at_once();
                released.map(|_| found)
            }
            Err(error) => {
                self.release_at_once();
                Err(error)
            }
        }
    }

    /// Refuses currents to pull with, one for each servo or a single one, that a servo cannot come to or may not have for long.
    pub(super) fn check_pulls(&self, currents: &[f64]) -> Result<(), RigError> {
        let servos = self.winches.len();
        let fits = currents
            .iter()
            .all(|current| current.is_finite() && *current > 0.0);
        if !fits || (currents.len() != 1 && currents.len() != servos) {
            let expected = format!("currents above 0 (A), a single one or {servos}");
            return Err(RigError::field(
                "current",
                format!("{currents:?}"),
                expected,
            ));
        }
        for (winch, current) in self.winches.iter().zip(currents.iter().cycle()) {
            let most = winch.overload.min(winch.current_limit);
            if *current >= most {
                let expected = format!(
                    "below {most} A, which servo {} may not exceed (servos.current_limit, safety.current)",
                    winch.id
                );
                return Err(RigError::field("current", current, expected));
            }
        }
        Ok(())
    }

    fn wind(
        &mut self,
        settings: &PretensionSettings,
        show: &mut dyn FnMut(&[WinchState]) -> ControlFlow<()>,
    ) -> Result<Vec<Pretensioned>, RigError> {
        let servos = self.winches().len();
        let mut goals = vec![Ticks(0); servos];
        let (mut ways, mut reversals) = (vec![0; servos], vec![0; servos]);
        loop {
            let states = self.mean_states(&goals, settings.looks)?;
            if show(&states).is_break() {
                return Err(RigError::Interrupted);
            }
            let least = settings.current * (1.0 - settings.tolerance);
            let pulls = states.iter().map(|state| state.pull).enumerate();
            let weakest = pulls
                .filter(|(_, pull)| *pull < least)
                .min_by(|a, b| a.1.total_cmp(&b.1));
            let strongest = (states.iter().enumerate())
                .find(|(_, state)| state.pull > settings.current * (1.0 + settings.tolerance));
            let (index, ticks) = match (weakest, strongest) {
                (Some((index, _)), _) => (index, settings.step),
                // Winding one changes the others: what pulls too much lets out a little.
                (None, Some((index, _))) => (index, -(settings.step / 2).max(1)),
                (None, None) => {
                    let servos = self.winches().iter().zip(&goals).zip(&states);
                    return Ok(servos
                        .map(|((winch, goal), state)| Pretensioned {
                            id: winch.id,
                            wound: goal.0,
                            pull: state.pull,
                        })
                        .collect());
                }
            };
            let winch = &self.winches()[index];
            let way = std::mem::replace(&mut ways[index], ticks.signum());
            reversals[index] += usize::from(way == -ticks.signum());
            if reversals[index] > MOST_REVERSALS {
                return Err(RigError::Unsteady {
                    id: winch.id,
                    reversals: MOST_REVERSALS,
                    current: settings.current,
                    tolerance: settings.tolerance,
                });
            }
            let direction = i32::from(winch.spool.direction);
            goals[index].0 += direction * ticks;
            let [low, high] = winch.limits;
            let room = match goals[index].0 < 0 {
                true => low.saturating_abs(),
                false => high,
            };
            if goals[index].0.abs() > settings.most.min(room) {
                return Err(RigError::Pretension {
                    id: winch.id,
                    wound: goals[index].0.abs(),
                    pull: states[index].pull,
                    current: settings.current,
                });
            }
        }
    }

    /// Goes to goals from home, in no more steps than the rig's slew needs.
    fn walk_to(&mut self, goals: &[Ticks]) -> Result<(), RigError> {
        let from = self.held_goals().ok_or(RigError::Released)?.to_vec();
        let servos = self.winches.iter().zip(&from).zip(goals);
        let steps = servos
            .map(|((winch, from), to)| to.0.abs_diff(from.0).div_ceil(self.most_step(winch)))
            .max()
            .unwrap_or(0);
        for step in 1..=steps.max(1) {
            let part = f64::from(step) / f64::from(steps.max(1));
            let servos = from.iter().zip(goals);
            let between = servos.map(|(from, to)| {
                let way = f64::from(to.0.saturating_sub(from.0));
                Ticks(from.0.saturating_add((part * way).round() as i32))
            });
            self.step_to(&between.collect::<Vec<_>>())?;
        }
        Ok(())
    }

    /// States under goals, with the means of several looks for currents.
    fn mean_states(&mut self, goals: &[Ticks], looks: usize) -> Result<Vec<WinchState>, RigError> {
        // The first look is while they move.
        self.walk_to(goals)?;
        let mut mean = self.poll()?.to_vec();
        for _ in 1..looks {
            for (mean, state) in mean.iter_mut().zip(self.poll()?) {
                mean.pull += state.pull;
            }
        }
        for mean in &mut mean {
            mean.pull /= looks.max(1) as f64;
        }
        Ok(mean)
    }
}

//! Tensioning tendons by hand: servos hold, a person turns gears, currents say how far.

use std::ops::ControlFlow;
use std::time::Duration;

use super::{Pretensioned, Rig, RigError};
use crate::servo::ServoId;

/// What a person is to reach at the gears.
#[derive(Clone, Debug, PartialEq)]
pub struct ByHand {
    /// Current that each servo is to pull with (A): one for each, or a single one for all.
    pub currents: Vec<f64>,
    /// Share of it that a servo may be off by.
    pub tolerance: f64,
    /// How often in a row all have to be within it.
    pub steady: usize,
    /// How long one waits for that.
    pub patience: Duration,
}

impl Default for ByHand {
    /// 50 mA within a tenth, twice in a row, within ten minutes.
    fn default() -> Self {
        Self {
            currents: vec![0.05],
            tolerance: 0.1,
            steady: 2,
            patience: Duration::from_secs(600),
        }
    }
}

/// What a person is to do with the gear of a tendon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// Nothing.
    Leave,
    /// Turn it further, so that the tendon pulls more.
    Tighten,
    /// Turn it back.
    Loosen,
}

/// How a tendon pulls, and what follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gauged {
    /// Its servo.
    pub id: ServoId,
    /// Current that it takes (A).
    pub pull: f64,
    /// What it should take (A).
    pub target: f64,
    /// What is to be done.
    pub turn: Turn,
}

impl ByHand {
    fn gauged(&self, id: ServoId, index: usize, pull: f64) -> Gauged {
        let target = self.currents[if self.currents.len() == 1 { 0 } else { index }];
        let turn = match pull - target {
            off if off.abs() <= self.tolerance * target => Turn::Leave,
            off if off < 0.0 => Turn::Tighten,
            _ => Turn::Loosen,
        };
        Gauged {
            id,
            pull,
            target,
            turn,
        }
    }
}

impl Rig {
    /// Holds the servos while a person sets the tension of each tendon at its gear, and takes where they stand for home when all
    /// pull as they should. The robot has to stand straight. `show` sees each reading ([`gauge`](Self::gauge)) and says whether
    /// to go on.
    ///
    /// # Errors
    /// [`RigError::Field`] for currents that make no sense; [`RigError::Untensioned`] at the end of patience;
    /// [`RigError::Interrupted`]; as [`engage`](Self::engage) and [`step`](Self::step). The motors are off then.
    pub fn pretension_by_hand(
        &mut self,
        settings: &ByHand,
        show: &mut dyn FnMut(&[Gauged]) -> ControlFlow<()>,
    ) -> Result<Vec<Pretensioned>, RigError> {
        self.check_pulls(&settings.currents)?;
        // Positions count from here meanwhile.
        self.home_here()?;
        self.engage()?;
        let reached = self.wait_for_hands(settings, show);
        let homed = reached.and_then(|reached| {
            self.home_here()?;
            Ok(reached)
        });
        self.release_at_once();
        homed
    }

    fn wait_for_hands(
        &mut self,
        settings: &ByHand,
        show: &mut dyn FnMut(&[Gauged]) -> ControlFlow<()>,
    ) -> Result<Vec<Pretensioned>, RigError> {
        let deadline = self.clock().now().saturating_add(settings.patience);
        let mut steady = 0;
        loop {
            let pulls = self.gauge()?;
            let servos = self.winches().iter().zip(&pulls).enumerate();
            let gauged: Vec<Gauged> = servos
                .map(|(index, (winch, &pull))| settings.gauged(winch.id, index, pull))
                .collect();
            if show(&gauged).is_break() {
                return Err(RigError::Interrupted);
            }
            let is_left = |gauged: &&Gauged| gauged.turn != Turn::Leave;
            steady = match gauged.iter().any(|gauged| is_left(&gauged)) {
                true => 0,
                false => steady + 1,
            };
            if steady >= settings.steady {
                let done = gauged.iter().map(|gauged| Pretensioned {
                    id: gauged.id,
                    wound: 0,
                    pull: gauged.pull,
                });
                return Ok(done.collect());
            }
            if self.clock().now() >= deadline {
                let left = gauged.iter().filter(is_left);
                return Err(RigError::Untensioned(
                    left.map(|gauged| {
                        let Gauged {
                            id, pull, target, ..
                        } = gauged;
                        format!("servo {id} pulls with {pull:.3} A, expected {target} A")
                    })
                    .collect(),
                ));
            }
        }
    }
}

//! Learning rate and weight averaging over a run, also one that was extended.

use std::f64::consts::PI;

use super::difference::require_same;
use super::error::{SettingsError, TrainError};
use super::optimizer::Optimizer;
use super::settings::{Procedure, Schedule, TrainSettings};

impl TrainSettings {
    /// These settings for a run that took `taken` steps with the settings `before`: the same, or with more steps. An extended
    /// run may also have another warm-up and validate at other steps. Its next step follows the schedule of the new
    /// length, so the learning rate jumps, and the result differs from that of a run of this length from the start.
    ///
    /// # Errors
    /// [`TrainError::Shorter`] for fewer steps; [`TrainError::OtherRun`] with the first field that differs.
    pub(super) fn continuing(self, before: &Self, taken: u64) -> Result<Self, TrainError> {
        if self.steps < before.steps {
            return Err(TrainError::Shorter {
                found: self.steps,
                expected: before.steps,
            });
        }
        let mut earlier = before.earlier.clone();
        // What is refined afterwards makes no difference to the steps.
        let mut same = Self {
            earlier: earlier.clone(),
            refinement: before.refinement,
            ..self.clone()
        };
        if self.steps > before.steps {
            let followed = earlier.last().map_or(0, |earlier| earlier.until);
            if taken > followed {
                earlier.push(Schedule {
                    until: taken,
                    steps: before.steps,
                    warmup_steps: before.warmup_steps,
                });
            }
            (same.steps, same.warmup_steps) = (before.steps, before.warmup_steps);
            same.validate_every = before.validate_every;
        }
        require_same("settings", before, &same).map_err(TrainError::other_run)?;
        Ok(Self { earlier, ..self })
    }

    /// Returns an error for schedules that no run can follow.
    pub(super) fn check_schedule(&self) -> Result<(), SettingsError> {
        let mut before = 0;
        for earlier in &self.earlier {
            if !(before < earlier.until && earlier.until <= earlier.steps.min(self.steps)) {
                let expected =
                    format!("above {before}, at most the steps of its schedule and of the run");
                return Err(SettingsError::new("earlier.until", earlier.until, expected));
            }
            check_warmup("earlier.warmup_steps", earlier.warmup_steps, earlier.steps)?;
            before = earlier.until;
        }
        check_warmup("warmup_steps", self.warmup_steps, self.steps)
    }

    /// Learning rate of step `step` (the first is 1): linear from 0 to [`Self::learning_rate`] at the end of warm-up,
    /// then half a cosine to [`Self::final_learning_rate`] at the last step (Loshchilov and Hutter, ICLR 2017). Steps taken
    /// before the run was extended have the rate of the [`Schedule`] of that time. By [`Procedure::Authors`], who set the rate
    /// behind the optimiser's step, each step has the rate that the one before it would have, and the first
    /// [`Self::learning_rate`].
    pub fn learning_rate_at(&self, step: u64) -> f64 {
        let earlier = self.earlier.iter().find(|earlier| step <= earlier.until);
        let (steps, warmup_steps) = match earlier {
            Some(earlier) => (earlier.steps, earlier.warmup_steps),
            None => (self.steps, self.warmup_steps),
        };
        let step = match self.procedure {
            Procedure::Project => step,
            Procedure::Authors if step == 1 => return self.learning_rate,
            Procedure::Authors => step - 1,
        };
        if step <= warmup_steps {
            return self.learning_rate * step as f64 / warmup_steps as f64;
        }
        let progress = (step - warmup_steps) as f64 / (steps - warmup_steps) as f64;
        let descent = self.learning_rate - self.final_learning_rate;
        self.final_learning_rate + 0.5 * descent * (1.0 + (PI * progress).cos())
    }

    /// Learning rate of the optimiser's matrices at step `step`: [`Self::learning_rate_at`], in proportion.
    pub(super) fn matrix_learning_rate_at(&self, step: u64) -> f64 {
        self.matrix_learning_rate() * (self.learning_rate_at(step) / self.learning_rate)
    }

    /// The same after warm-up.
    pub(super) fn matrix_learning_rate(&self) -> f64 {
        match self.optimizer {
            Optimizer::AdamW => self.learning_rate,
            Optimizer::Muon { learning_rate } => learning_rate,
        }
    }

    /// Decay of the weight average at step `step` (the first is 1): `min(decay, (1 + step) / (10 + step))`, so that the
    /// early average is not held at the initial weights; by [`Procedure::Authors`] the same at all steps.
    pub(super) fn average_decay_at(&self, step: u64) -> f64 {
        let step = step as f64;
        match self.procedure {
            Procedure::Project => self.average_decay.min((1.0 + step) / (10.0 + step)),
            Procedure::Authors => self.average_decay,
        }
    }
}

fn check_warmup(field: &'static str, warmup_steps: u64, steps: u64) -> Result<(), SettingsError> {
    match warmup_steps < steps {
        true => Ok(()),
        false => {
            let expected = format!("fewer than the {steps} steps");
            Err(SettingsError::new(field, warmup_steps, expected))
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;
    use crate::train::Refinement;

    #[test]
    fn learning_rate_warms_up_linearly_and_falls_by_half_a_cosine() {
        let settings = TrainSettings {
            steps: 110,
            warmup_steps: 10,
            learning_rate: 1.0,
            final_learning_rate: 0.2,
            ..TrainSettings::default()
        };
        for (step, expected) in [(1, 0.1), (5, 0.5), (10, 1.0), (60, 0.6), (110, 0.2)] {
            assert!(
                (settings.learning_rate_at(step) - expected).abs() < 1e-12,
                "step {step}"
            );
        }
    }

    #[test]
    fn the_authors_rate_is_that_of_the_step_before_and_their_average_has_one_decay() {
        let ours = TrainSettings {
            steps: 110,
            warmup_steps: 10,
            ..TrainSettings::default()
        };
        let theirs = TrainSettings {
            procedure: Procedure::Authors,
            ..ours.clone()
        };
        assert_eq!(theirs.learning_rate_at(1), ours.learning_rate);
        for step in 2..=110 {
            let before = ours.learning_rate_at(step - 1);
            assert_eq!(theirs.learning_rate_at(step), before, "step {step}");
        }
        assert_eq!(
            [1, 90, 1000].map(|step| theirs.average_decay_at(step)),
            [0.999; 3]
        );
    }

    #[test]
    fn average_decay_rises_to_its_limit() {
        let settings = TrainSettings::default();
        assert_eq!(settings.average_decay_at(1), 2.0 / 11.0);
        assert_eq!(settings.average_decay_at(90), 0.91);
        assert_eq!(settings.average_decay_at(1_000_000), 0.999);
    }

    #[test]
    fn a_longer_run_keeps_the_rates_that_it_had_and_follows_its_new_schedule() {
        let before = TrainSettings {
            steps: 110,
            warmup_steps: 10,
            ..TrainSettings::default()
        };
        let longer = TrainSettings {
            steps: 210,
            warmup_steps: 20,
            ..before.clone()
        };
        let run = longer.clone().continuing(&before, 100).unwrap();
        assert_eq!(run.check(), Ok(()));
        for (step, expected) in [(5, &before), (100, &before), (101, &longer), (210, &longer)] {
            let rate = run.learning_rate_at(step);
            assert_eq!(rate, expected.learning_rate_at(step), "step {step}");
        }
        // Asked for again, and given more once more, it knows its past.
        assert_eq!(longer.clone().continuing(&run, 150).unwrap(), run);
        let longest = TrainSettings {
            steps: 300,
            ..longer.clone()
        };
        let twice = longest.clone().continuing(&run, 150).unwrap();
        assert_eq!(twice.earlier.len(), 2);
        assert_eq!(twice.learning_rate_at(150), longer.learning_rate_at(150));
        assert_eq!(twice.learning_rate_at(151), longest.learning_rate_at(151));
        // How it is refined in the end is of no account before.
        let refined = TrainSettings {
            refinement: Some(Refinement::DEFAULT),
            ..before.clone()
        };
        assert_eq!(refined.clone().continuing(&before, 100).unwrap(), refined);
        // Before its first step, a run has no past.
        assert_eq!(longest.clone().continuing(&before, 0).unwrap(), longest);
    }

    #[test]
    fn a_run_does_not_shrink_and_changes_no_other_setting() {
        let before = TrainSettings::default();
        let error = |settings: TrainSettings| {
            let error = settings.continuing(&before, 10).unwrap_err();
            error.to_string()
        };
        let shorter = error(TrainSettings {
            steps: 100,
            ..before.clone()
        });
        assert!(
            shorter.contains("`steps` is 100") && shorter.contains("5500"),
            "{shorter}"
        );
        let other = error(TrainSettings {
            steps: 8000,
            clouds: 8,
            ..before.clone()
        });
        assert!(
            other.contains("settings.clouds was 128, expected 8"),
            "{other}"
        );
    }

    #[test]
    fn schedules_that_no_run_can_follow_are_refused() {
        let settings = |until, steps, warmup_steps| TrainSettings {
            earlier: vec![Schedule {
                until,
                steps,
                warmup_steps,
            }],
            ..TrainSettings::default()
        };
        assert_eq!(settings(50, 100, 10).check(), Ok(()));
        for wrong in [
            settings(0, 100, 10),
            settings(101, 100, 10),
            settings(50, 100, 100),
        ] {
            assert!(wrong.check().is_err(), "{:?}", wrong.earlier);
        }
    }
}

//! Bounds of a training run's settings.

use super::error::SettingsError;
use super::settings::TrainSettings;

/// Largest batch; far above any useful one.
const MAX_CLOUDS: usize = 65_536;

/// Points in a step: what a few gigabytes hold.
const MAX_BATCH: usize = 100_000_000;

impl TrainSettings {
    /// Returns an error for settings with which no run can be made.
    pub fn check(&self) -> Result<(), SettingsError> {
        for (field, value) in [
            ("steps", self.steps),
            ("clouds", self.clouds as u64),
            ("points", self.points as u64),
            ("validate_every", self.validate_every),
            ("validation_clouds", self.validation_clouds as u64),
            ("validation_points", self.validation_points as u64),
        ] {
            if value == 0 {
                return Err(SettingsError::new(field, value, "at least 1"));
            }
        }
        if self.clouds > MAX_CLOUDS {
            let expected = format!("at most {MAX_CLOUDS}");
            return Err(SettingsError::new("clouds", self.clouds, expected));
        }
        let batch = self.clouds.saturating_mul(self.points);
        if batch > MAX_BATCH {
            let expected = format!("at most {MAX_BATCH} points in a step");
            return Err(SettingsError::new("clouds times points", batch, expected));
        }
        self.check_schedule()?;
        for (field, value, least) in [
            ("learning_rate", self.learning_rate, f64::MIN_POSITIVE),
            (
                "muon's learning_rate",
                self.matrix_learning_rate(),
                f64::MIN_POSITIVE,
            ),
            ("final_learning_rate", self.final_learning_rate, 0.0),
            ("weight_decay", self.weight_decay, 0.0),
            ("clip_norm", self.clip_norm, f64::MIN_POSITIVE),
            ("color_weight", self.color_weight.into(), f64::MIN_POSITIVE),
        ] {
            if !(value.is_finite() && value >= least) {
                let sign = if least > 0.0 {
                    "positive"
                } else {
                    "non-negative"
                };
                return Err(SettingsError::new(field, value, format!("a {sign} number")));
            }
        }
        if self.patience == Some(0) {
            return Err(SettingsError::new("patience", 0, "at least 1"));
        }
        if !(self.spike_factor.is_finite() && self.spike_factor > 1.0) {
            let expected = "a number above 1";
            return Err(SettingsError::new(
                "spike_factor",
                self.spike_factor,
                expected,
            ));
        }
        if !(0.0..1.0).contains(&self.average_decay) {
            return Err(SettingsError::new(
                "average_decay",
                self.average_decay,
                "0 or more, below 1",
            ));
        }
        self.path.check()?;
        self.sampler.check()?;
        self.check_refinement()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_settings_are_refused_by_name() {
        let good = TrainSettings::default();
        assert_eq!(good.check(), Ok(()));
        let error =
            |settings: TrainSettings| settings.check().expect_err("bad settings").to_string();
        assert_eq!(
            error(TrainSettings {
                clouds: 0,
                ..good.clone()
            }),
            "clouds is 0, expected at least 1"
        );
        assert_eq!(
            error(TrainSettings {
                warmup_steps: 30_000,
                ..good.clone()
            }),
            "warmup_steps is 30000, expected fewer than the 5500 steps"
        );
        assert!(
            error(TrainSettings {
                learning_rate: f64::NAN,
                ..good.clone()
            })
            .starts_with("learning_rate is NaN")
        );
        assert!(
            error(TrainSettings {
                average_decay: 1.0,
                ..good.clone()
            })
            .starts_with("average_decay is 1")
        );
        assert_eq!(
            error(TrainSettings {
                color_weight: 0.0,
                ..good.clone()
            }),
            "color_weight is 0, expected a positive number"
        );
        assert_eq!(
            error(TrainSettings {
                patience: Some(0),
                ..good.clone()
            }),
            "patience is 0, expected at least 1"
        );
        assert_eq!(
            error(TrainSettings {
                spike_factor: 1.0,
                ..good
            }),
            "spike_factor is 1, expected a number above 1"
        );
    }
}

//! Divergence of a loss that stays finite: it is far above its running level for several steps on end.

use tdcr_base::stats::median;

use super::settings::TrainSettings;

/// Steps in a row for which a diverged loss is above its running level times [`TrainSettings::spike_factor`]; single batches
/// may be that far off.
pub(super) const SPIKE_STEPS: usize = 10;

/// Losses, before those of the last [`SPIKE_STEPS`] steps, whose median is the running level.
const LEVEL_STEPS: usize = 100;

impl TrainSettings {
    /// The running level of `losses`, one per step: the median of up to 100 losses before the last [`SPIKE_STEPS`]. None
    /// while there are fewer than [`SPIKE_STEPS`] before them.
    pub(super) fn loss_level(losses: &[f32]) -> Option<f64> {
        let before = losses.len().checked_sub(SPIKE_STEPS)?;
        if before < SPIKE_STEPS {
            return None;
        }
        let recent = &losses[before.saturating_sub(LEVEL_STEPS)..before];
        let mut level = [0.0; LEVEL_STEPS];
        let level = &mut level[..recent.len()];
        for (level, &loss) in level.iter_mut().zip(recent) {
            *level = f64::from(loss);
        }
        Some(median(level))
    }

    /// Number of losses in a row, up to and including the last one, above the running level times [`Self::spike_factor`]: 0 in
    /// a sound run, [`SPIKE_STEPS`] in one that has diverged.
    pub(super) fn spike_length(&self, losses: &[f32]) -> usize {
        let Some(level) = Self::loss_level(losses) else {
            return 0;
        };
        let limit = self.spike_factor * level;
        let last = losses.iter().rev().take(SPIKE_STEPS);
        last.take_while(|loss| f64::from(**loss) > limit).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Losses that fall and scatter by a factor of three either way, as those of few clouds do.
    fn noisy_losses(steps: usize) -> Vec<f32> {
        let scatter = |k: usize| (1.1 * ((k * 7919 % 101) as f32 / 50.0 - 1.0)).exp();
        (0..steps)
            .map(|k| (0.02 + (-(k as f32) / 80.0).exp()) * scatter(k))
            .collect()
    }

    #[test]
    fn a_rise_that_stays_is_a_spike_and_scatter_is_none() {
        let settings = TrainSettings::default();
        let mut losses = noisy_losses(600);
        for steps in 1..=losses.len() {
            assert_eq!(settings.spike_length(&losses[..steps]) / SPIKE_STEPS, 0);
        }
        losses.push(50.0);
        assert_eq!(settings.spike_length(&losses), 1);
        losses.push(0.02);
        assert_eq!(settings.spike_length(&losses), 0);
        for rise in 1..=SPIKE_STEPS {
            losses.push(0.4 + rise as f32);
            assert_eq!(settings.spike_length(&losses), rise);
        }
    }

    #[test]
    fn the_first_losses_of_a_run_have_no_level() {
        let settings = TrainSettings::default();
        let mut losses = vec![1.0; 2 * SPIKE_STEPS - 1];
        losses[SPIKE_STEPS..].fill(100.0);
        assert_eq!(TrainSettings::loss_level(&losses), None);
        assert_eq!(settings.spike_length(&losses), 0);
        losses.push(100.0);
        assert_eq!(TrainSettings::loss_level(&losses), Some(1.0));
        assert_eq!(settings.spike_length(&losses), SPIKE_STEPS);
    }
}

//! What a network is trained on, and its loss.

use crate::channels::{Channels, DIM};

/// Clouds with flow times, in normalised units, and the velocities that the network should have there.
#[derive(Clone, Copy, Debug)]
pub struct Batch<'a> {
    /// Flow time of every cloud, `(B)`.
    pub times: &'a [f32],
    /// Conditions, row-major `(B, D)`.
    pub conditions: &'a [f32],
    /// Points on the path `X_t`, row-major `(B, N, C)`.
    pub points: &'a [f32],
    /// Target velocities, row-major `(B, N, C)`.
    pub targets: &'a [f32],
    /// Weight of the colours' error beside the positions'; without effect on clouds without colours.
    pub color_weight: f32,
}

impl Batch<'_> {
    /// Number of clouds `B`.
    pub(in crate::net) fn clouds(&self) -> usize {
        self.times.len()
    }

    /// Panics if the slices do not fit each other or a network of `condition_dim`, `channels` and `parameters`.
    pub(in crate::net) fn check(
        &self,
        condition_dim: usize,
        channels: Channels,
        [parameters, derivatives]: [usize; 2],
    ) {
        let clouds = self.clouds();
        let conditions = clouds * condition_dim;
        assert_eq!(self.conditions.len(), conditions, "condition dimension");
        assert_eq!(
            self.points.len(),
            self.targets.len(),
            "one target per point"
        );
        assert_eq!(derivatives, parameters, "one derivative per parameter");
        let whole = self.points.len().is_multiple_of(clouds * channels.count());
        assert!(!self.points.is_empty() && whole, "points (B, N, C)");
    }

    /// Loss that belongs to this batch.
    pub(in crate::net) fn loss(&self, channels: Channels) -> Loss {
        let points = self.points.len() / channels.count();
        Loss {
            channels: channels.count(),
            components: points * DIM,
            color_weight: self.color_weight,
        }
    }
}

/// Mean squared velocity error over all `B N 3` components of the positions (paper, Eq. fm_loss_tdcr, divided by their
/// number), plus the weighted one of the colours (Eq. rgb_loss_tdcr), divided by the same number.
#[derive(Clone, Copy, Debug)]
pub struct Loss {
    /// Numbers per velocity.
    pub channels: usize,
    /// Components `B N 3` of the positions.
    pub components: usize,
    color_weight: f32,
}

impl Loss {
    /// Replaces velocities by the loss's gradient by them; returns the sum of weighted squared errors.
    pub fn differentiate(&self, velocities: &mut [f32], targets: &[f32]) -> f64 {
        let factor = 2.0 / self.components as f32;
        let mut squared_error = 0.0;
        let rows = velocities.chunks_exact_mut(self.channels);
        for (velocities, targets) in rows.zip(targets.chunks_exact(self.channels)) {
            for (k, (velocity, target)) in velocities.iter_mut().zip(targets).enumerate() {
                let weight = if k < DIM { 1.0 } else { self.color_weight };
                let error = *velocity - target;
                squared_error += f64::from(weight) * f64::from(error) * f64::from(error);
                *velocity = weight * factor * error;
            }
        }
        squared_error
    }
}

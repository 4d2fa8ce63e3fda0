//! What a network is trained on, and its loss.

use crate::channels::{Channels, DIM};

/// A cloud at a flow time, under a condition, in normalised units.
#[derive(Clone, Copy, Debug)]
pub struct Cloud<'a> {
    pub time: f32,
    pub condition: &'a [f32],
    /// `(N, C)`.
    pub points: &'a [f32],
}

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
    /// Length of a position's error beyond which it counts linearly and no longer squared (Huber, Annals of Mathematical
    /// Statistics 35, 1964); `None`: squared at any length.
    pub huber: Option<f32>,
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
            huber: self.huber,
        }
    }
}

/// Mean squared velocity error over all `B N 3` components of the positions (paper, Eq. fm_loss_tdcr, divided by their
/// number), plus the weighted one of the colours (Eq. rgb_loss_tdcr), divided by the same number. Where errors are long,
/// [`Batch::huber`] may have the positions' count linearly: `2 h r - h^2` in place of `r^2` beyond the length `h`.
#[derive(Clone, Copy, Debug)]
pub struct Loss {
    /// Numbers per velocity.
    pub channels: usize,
    /// Components `B N 3` of the positions.
    pub components: usize,
    color_weight: f32,
    huber: Option<f32>,
}

impl Loss {
    /// Replaces velocities by the loss's gradient by them; returns the sum of weighted errors.
    pub fn differentiate(&self, velocities: &mut [f32], targets: &[f32]) -> f64 {
        let factor = 2.0 / self.components as f32;
        let mut sum = 0.0;
        let rows = velocities.chunks_exact_mut(self.channels);
        for (velocities, targets) in rows.zip(targets.chunks_exact(self.channels)) {
            let (weight, excess) = self.bounded(velocities, targets);
            sum -= excess;
            for (k, (velocity, target)) in velocities.iter_mut().zip(targets).enumerate() {
                let weight = if k < DIM { weight } else { self.color_weight };
                let error = *velocity - target;
                sum += f64::from(weight) * f64::from(error) * f64::from(error);
                *velocity = weight * factor * error;
            }
        }
        sum
    }

    /// The weight `w` of a point's squared error `r^2`, and what its loss is below `w r^2`. Beyond the length `h`, `w = h / r`
    /// makes the gradient that of `2 h r - h^2`, which is `h^2 - h r` below `w r^2` (a negative number).
    fn bounded(&self, velocity: &[f32], target: &[f32]) -> (f32, f64) {
        let Some(huber) = self.huber else {
            return (1.0, 0.0);
        };
        let errors = velocity.iter().zip(target).take(DIM);
        let length = errors.map(|(v, u)| (v - u) * (v - u)).sum::<f32>().sqrt();
        match length > huber {
            true => (huber / length, f64::from(huber) * f64::from(huber - length)),
            false => (1.0, 0.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn loss(huber: Option<f32>) -> Loss {
        Loss {
            channels: 3,
            components: 6,
            color_weight: 0.0,
            huber,
        }
    }

    /// Short errors count squared, long ones linearly; the gradient is that of central differences.
    #[test]
    fn long_errors_count_linearly() {
        let (velocities, targets) = ([0.3, 0.0, 0.4, 3.0, 0.0, 4.0], [0.0; 6]);
        let sum = |velocities: &[f32], huber| {
            let mut gradient = velocities.to_vec();
            let sum = loss(huber).differentiate(&mut gradient, &targets);
            (sum, gradient)
        };
        let (squared, _) = sum(&velocities, None);
        assert!((squared - 25.25).abs() < 1e-6, "{squared}");
        // 0.5^2, and 2 * 2 * 5 - 2^2.
        let (bounded, gradient) = sum(&velocities, Some(2.0));
        assert!((bounded - 16.25).abs() < 1e-5, "{bounded}");
        for k in 0..6 {
            let moved = |step: f32| {
                let mut moved = velocities;
                moved[k] += step;
                sum(&moved, Some(2.0)).0 / 6.0
            };
            let slope = (moved(1e-2) - moved(-1e-2)) / 2e-2;
            assert!(
                (slope - f64::from(gradient[k])).abs() < 1e-4,
                "{k}: {slope}"
            );
        }
    }
}

//! A network beside which another one makes the last evaluation of a prediction, and a second one that corrects it.
//!
//! # Correction
//!
//! The last evaluation takes the ends of the flow to the surface, but a few percent of them by too little: those that came to
//! lie far inside the robot. Evaluated again at the same flow time, the network of the last evaluation says how far a point is
//! still off. With its displacement `d` there, a point `x` moves to `x + d |d|^2 / (|d|^2 + h^2)`: nearly all of the way where it is
//! off by much more than `h`, and hardly where the displacement is as small as the network's own error, which would only carry
//! points along the surface and make them less even. The weight is smooth, so that points stay smooth functions of the command.
//!
//! Points that came to the surface need not be left out for being alone, which costs places where the network's points are few.

use crate::channels::DIM;
use crate::flow::{Reach, Sampler, VelocityField};
use crate::net::{Channels, Network};
use crate::predict::{ISOLATED, ISOLATED_CORRECTED, select};

/// Displacement `h` (normalised units) half of which is made in the correction: about half a millimetre.
const HALFWAY: f32 = 1.25e-3;

/// The points that were drawn for a cloud.
pub(super) struct Drawn {
    /// Their positions (normalised units): of those that make the cloud, in it.
    pub positions: Vec<[f32; DIM]>,
    /// Indices, in order, of those that make the cloud.
    pub kept: Vec<usize>,
    /// Evaluations of a network that they took.
    pub evaluations: usize,
}

/// A network whose velocities point at where data are, and beside which another one may be used in the last denoising.
#[derive(Clone, Copy, Debug)]
pub(super) struct Refined<'a> {
    pub flow: &'a Network,
    /// The network of a denoising at this flow time.
    pub last: Option<(f32, &'a Network)>,
    /// Where data are, as far as that is known.
    pub reach: Option<Reach>,
}

impl Refined<'_> {
    /// Moves samples `rows` `(N, C)` of the prior to data, in place, and selects the `count` of them that make a cloud.
    pub fn draw(
        &self,
        sampler: &Sampler,
        condition: &[f32],
        rows: &mut [f32],
        count: usize,
    ) -> Drawn {
        let mut evaluations = sampler.integrate(self, condition, rows);
        let corrected = sampler.denoise.filter(|&t| self.last_network(t).is_some());
        if let Some(t) = corrected {
            correct(self, t, condition, rows);
            evaluations += 1;
        }
        let mut positions = positions(rows, self.channels());
        let isolated = match corrected {
            Some(_) => ISOLATED_CORRECTED,
            None => ISOLATED,
        };
        Drawn {
            kept: select(&mut positions, count, isolated),
            positions,
            evaluations,
        }
    }

    /// The network that was learned for a last evaluation at the flow time `t`.
    fn last_network(&self, t: f32) -> Option<&Network> {
        (self.last.filter(|(time, _)| *time == t)).map(|(_, network)| network)
    }

    fn velocity_by(
        &self,
        network: &Network,
        t: f32,
        condition: &[f32],
        points: &[f32],
        velocities: &mut [f32],
    ) {
        network.velocity(t, condition, points, velocities);
        if let Some(reach) = self.reach {
            reach.bound(network.channels(), t, points, velocities);
        }
    }
}

impl VelocityField for Refined<'_> {
    fn channels(&self) -> Channels {
        self.flow.channels()
    }

    fn velocity(&self, t: f32, condition: &[f32], points: &[f32], velocities: &mut [f32]) {
        self.velocity_by(self.flow, t, condition, points, velocities);
    }

    fn last_velocity(&self, t: f32, condition: &[f32], points: &[f32], velocities: &mut [f32]) {
        let network = self.last_network(t).unwrap_or(self.flow);
        self.velocity_by(network, t, condition, points, velocities);
    }
}

/// The positions in `rows` `(N, C)`.
pub(super) fn positions(rows: &[f32], channels: Channels) -> Vec<[f32; DIM]> {
    let rows = rows.chunks_exact(channels.count());
    rows.map(|row| [row[0], row[1], row[2]]).collect()
}

/// Moves what the last evaluation by `field`, at the flow time `t`, left beside the surface, in place. Colours stay as they are.
fn correct(field: &impl VelocityField, t: f32, condition: &[f32], rows: &mut [f32]) {
    let channels = field.channels().count();
    let mut velocities = vec![0.0; rows.len()];
    field.last_velocity(t, condition, rows, &mut velocities);
    let velocities = velocities.chunks_exact(channels);
    for (row, velocity) in rows.chunks_exact_mut(channels).zip(velocities) {
        let displacement: [f32; DIM] = std::array::from_fn(|k| (1.0 - t) * velocity[k]);
        let squared: f32 = displacement.iter().map(|d| d * d).sum();
        let share = squared / (squared + HALFWAY * HALFWAY);
        row.iter_mut()
            .zip(displacement)
            .for_each(|(x, d)| *x += share * d);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TIME: f32 = 0.995;

    /// Points at a plane: it takes what is off it to it in the time that is left, but for an error along it.
    struct Plane {
        error: f32,
    }

    impl VelocityField for Plane {
        fn channels(&self) -> Channels {
            Channels::XyzRgb
        }

        fn velocity(&self, _: f32, _: &[f32], _: &[f32], _: &mut [f32]) {
            unreachable!("the last velocity alone is asked for");
        }

        fn last_velocity(&self, t: f32, _: &[f32], points: &[f32], velocities: &mut [f32]) {
            let velocities = velocities.chunks_exact_mut(6);
            for (velocity, point) in velocities.zip(points.chunks_exact(6)) {
                let to_plane = [self.error, 0.0, -point[2], 0.1, 0.1, 0.1];
                velocity.copy_from_slice(&to_plane.map(|d| d / (1.0 - t)));
            }
        }
    }

    fn corrected(error: f32, height: f32) -> [f32; 6] {
        let mut row = [0.3, 0.2, height, 0.5, 0.6, 0.7];
        correct(&Plane { error }, TIME, &[], &mut row);
        row
    }

    #[test]
    fn points_far_off_a_surface_come_to_it_and_those_on_it_stay() {
        // In closed form h^2 / (z^2 + h^2) of the height is left: of 20 h a four hundredth, of h half.
        for (times, left) in [(20.0, 1.0 / 401.0), (1.0, 0.5), (0.1, 1.0 / 1.01)] {
            let height = times * HALFWAY;
            let row = corrected(0.0, height);
            assert!((row[2] / height - left).abs() < 1e-4, "{}", row[2]);
            assert_eq!(row[..2], [0.3, 0.2]);
        }
        // A tenth of h along the surface is an error of the network, and no more than a thousandth of it comes about.
        let moved = corrected(0.1 * HALFWAY, 0.0)[0] - 0.3;
        assert!((0.0..=1.1e-3 * HALFWAY).contains(&moved), "{moved}");
    }

    #[test]
    fn colours_stay() {
        assert_eq!(corrected(0.0, 20.0 * HALFWAY)[3..], [0.5, 0.6, 0.7]);
    }

    #[test]
    fn corrected_points_are_smooth_functions_of_where_they_were() {
        // The slope of z h^2 / (z^2 + h^2), h^2 (h^2 - z^2) / (z^2 + h^2)^2, is 1 at most.
        let heights = (0..200).map(|k| 0.02 * HALFWAY * k as f32);
        let ends: Vec<f32> = heights.map(|height| corrected(0.0, height)[2]).collect();
        let steps = ends.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        assert!(steps.fold(0.0, f32::max) < 0.021 * HALFWAY);
    }
}

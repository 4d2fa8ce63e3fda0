//! Where data are: what bounds a learned velocity.

use serde::{Deserialize, Serialize};

use crate::channels::{Channels, DIM};

/// What a box of training data is widened by on each side (normalised units): other clouds may reach a little farther.
const MARGIN: f32 = 0.02;

/// A box of positions, in normalised units, beyond which no data are.
///
/// The velocity of the flow points at the mean of the data that a point may come to, `D = X + (1 - t) u`, and that lies in any
/// convex set that holds all data. A learned one may point elsewhere, where the training has hardly any points: such a point
/// leaves the places that the network knows, and flies off. So it is bounded to point into the box.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reach {
    /// Its least corner.
    pub min: [f32; DIM],
    /// Its greatest corner.
    pub max: [f32; DIM],
}

impl Reach {
    /// Of data that are known by their normalisation alone: none is farther than 1 from the origin.
    pub const NORMALISED: Self = Self {
        min: [-1.0; DIM],
        max: [1.0; DIM],
    };

    /// That of `points` `(N, 3)`, with some margin; without points, nothing is known.
    pub fn of(points: &[f32]) -> Option<Self> {
        let (points, _) = points.as_chunks::<DIM>();
        let first = points.first()?;
        let bound = |pick: fn(f32, f32) -> f32, margin: f32| {
            let farthest = points.iter().fold(*first, |bound, point| {
                std::array::from_fn(|k| pick(bound[k], point[k]))
            });
            farthest.map(|x| x + margin)
        };
        Some(Self {
            min: bound(f32::min, -MARGIN),
            max: bound(f32::max, MARGIN),
        })
    }

    /// Bounds the velocities `(N, C)` of `points` `(N, C)` at flow time `t`, such that the data that they point at lie in the box.
    /// Those that do so stay as they are, and so do all at `t = 1`.
    pub fn bound(&self, channels: Channels, t: f32, points: &[f32], velocities: &mut [f32]) {
        let left = 1.0 - t;
        if left <= 0.0 {
            return;
        }
        let rows = points.chunks_exact(channels.count());
        for (x, u) in rows.zip(velocities.chunks_exact_mut(channels.count())) {
            for k in 0..DIM {
                let data = x[k] + left * u[k];
                let within = data.max(self.min[k]).min(self.max[k]);
                // What is not finite is an error, and to be seen as one.
                if within != data && data.is_finite() {
                    u[k] = (within - x[k]) / left;
                }
            }
        }
    }

    /// Says what is wrong with it, if anything: it may be from a file.
    pub(crate) fn check(&self) -> Result<(), String> {
        let ordered = |k: usize| {
            self.min[k].is_finite() && self.max[k].is_finite() && self.min[k] <= self.max[k]
        };
        match (0..DIM).all(ordered) {
            true => Ok(()),
            false => Err(format!(
                "the data reach from {:?} to {:?}, expected min <= max, finite",
                self.min, self.max
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::{Method, Sampler, VelocityField};

    /// Carries points to twice where they are, and farther the later it is.
    struct Flying(Option<Reach>);

    impl VelocityField for Flying {
        fn channels(&self) -> Channels {
            Channels::Xyz
        }

        fn velocity(&self, t: f32, _: &[f32], points: &[f32], velocities: &mut [f32]) {
            for (u, x) in velocities.iter_mut().zip(points) {
                *u = x / (1.05 - t);
            }
            if let Some(reach) = self.0 {
                reach.bound(Channels::Xyz, t, points, velocities);
            }
        }
    }

    #[test]
    fn points_that_fly_off_come_to_where_data_are() {
        let data = [-0.2, 0.0, 0.1, 0.3, 0.5, 0.9];
        let reach = Reach::of(&data).expect("two points");
        let starts: Vec<f32> = (0..300)
            .map(|k| ((k * 37) % 100) as f32 / 50.0 - 1.0)
            .collect();
        for method in Method::ALL {
            let sampler = Sampler {
                method,
                ..Sampler::DEFAULT
            };
            let ends = |reach| {
                let mut rows = starts.clone();
                sampler.integrate(&Flying(reach), &[], &mut rows);
                rows
            };
            let farthest = |rows: &[f32]| rows.iter().fold(0.0f32, |far, x| far.max(x.abs()));
            assert!(farthest(&ends(None)) > 5.0, "{method:?}");
            for end in ends(Some(reach)).as_chunks::<DIM>().0 {
                for k in 0..DIM {
                    let within = reach.min[k] - 1e-5..=reach.max[k] + 1e-5;
                    assert!(within.contains(&end[k]), "{method:?}: {end:?}");
                }
            }
        }
    }

    #[test]
    fn velocities_that_point_at_data_stay_as_they_are() {
        let points = [0.5, -0.4, 0.3, 2.0, 2.0, 2.0];
        let velocities = [0.1, 0.2, -0.3, -2.5, -3.0, -4.5];
        let mut bounded = velocities;
        Reach::NORMALISED.bound(Channels::Xyz, 0.5, &points, &mut bounded);
        assert_eq!(bounded, velocities);
        Reach::NORMALISED.bound(Channels::Xyz, 0.75, &points, &mut bounded);
        assert_eq!(bounded[..3], velocities[..3]);
        assert_eq!(bounded[3..], [-4.0, -4.0, -4.5]);
        assert_eq!(Reach::of(&[]), None);
        let mut wrong = [f32::INFINITY, f32::NAN, -2.0];
        Reach::NORMALISED.bound(Channels::Xyz, 0.5, &[0.0; 3], &mut wrong);
        assert!(wrong[0].is_infinite() && wrong[1].is_nan() && wrong[2] == -2.0);
    }
}

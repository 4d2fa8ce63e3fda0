//! The batch of a training step.

use rand::RngExt;
use rand::seq::SliceRandom;
use rayon::prelude::*;

use super::settings::{Procedure, TrainSettings};
use crate::channels::Channels;
use crate::data::CloudSet;
use crate::flow::{Stream, rng};
use crate::metrics::Matcher;
use crate::net::Batch;
use crate::prior::start_from;

/// A step's batch: `B` clouds of `N` points.
#[derive(Debug, Default)]
pub(super) struct Samples {
    pub times: Vec<f32>,
    pub conditions: Vec<f32>,
    pub points: Vec<f32>,
    pub targets: Vec<f32>,
    /// [`Batch::huber`].
    pub huber: Option<f32>,
    /// Indices of a cloud's points, the drawn ones first.
    order: Vec<usize>,
    /// One per cloud.
    matchers: Vec<Matcher>,
    epoch: Epoch,
}

/// How the clouds of a batch are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Draw {
    /// Each at random.
    Replacing,
    /// In the order of an [`Epoch`].
    Shuffled,
}

impl Draw {
    /// Of a set, as a run's procedure has it.
    pub fn of(procedure: Procedure) -> Self {
        match procedure {
            Procedure::Project => Self::Replacing,
            Procedure::Authors => Self::Shuffled,
        }
    }
}

/// A random order of all clouds of a set.
#[derive(Debug, Default)]
struct Epoch {
    /// Seed, index and number of clouds that it was made for; none before the first.
    of: Option<(u64, u64, usize)>,
    order: Vec<usize>,
}

impl Epoch {
    /// Makes it the epoch `index` of `clouds` clouds, if it is not.
    fn enter(&mut self, index: u64, seed: u64, clouds: usize) {
        let of = Some((seed, index, clouds));
        if self.of == of {
            return;
        }
        self.of = of;
        self.order.clear();
        self.order.extend(0..clouds);
        self.order.shuffle(&mut rng(seed, Stream::Epoch(index)));
    }
}

impl Samples {
    /// Draws the batch of step `step` (the first is 1): clouds as `draw` says, points of each without replacement.
    ///
    /// # Panics
    /// Where a batch in the order of an epoch has more clouds than the set.
    pub fn draw(
        &mut self,
        settings: &TrainSettings,
        (set, draw): (&CloudSet, Draw),
        channels: Channels,
        step: u64,
    ) {
        // Steps that the clouds of an epoch fill, and the first cloud of this one in its order.
        let steps = (set.len() / settings.clouds) as u64;
        let first = match draw {
            Draw::Replacing => 0,
            Draw::Shuffled => {
                let (epoch, step) = ((step - 1) / steps, (step - 1) % steps);
                self.epoch.enter(epoch, settings.seed, set.len());
                step as usize * settings.clouds
            }
        };
        let mut rng = rng(settings.seed, Stream::Step(step));
        let stride = settings.points * channels.count();
        self.times.clear();
        self.conditions.clear();
        self.points.resize(settings.clouds * stride, 0.0);
        self.targets.clear();
        for (k, points) in self.points.chunks_exact_mut(stride).enumerate() {
            let cloud = match draw {
                Draw::Replacing => rng.random_range(0..set.len()),
                Draw::Shuffled => self.epoch.order[first + k],
            };
            let time = settings.path.sample_time(&mut rng);
            // As `index::sample` shuffles, but without allocating.
            self.order.clear();
            self.order.extend(0..set.points_per_cloud);
            for k in 0..settings.points {
                let drawn = rng.random_range(k..set.points_per_cloud);
                self.order.swap(k, drawn);
            }
            let subset = self.order[..settings.points].iter().copied();
            set.gather(cloud, subset, channels, &mut self.targets);
            settings.path.sample_prior(&mut rng, channels, points);
            if let Some(surface) = set.start(cloud) {
                start_from(surface, &self.order, channels, points);
            }
            self.times.push(time);
            self.conditions.extend_from_slice(set.condition(cloud));
        }
        self.follow(settings, channels);
    }

    /// Turns noise into points on the path to the data, and data into velocities.
    fn follow(&mut self, settings: &TrainSettings, channels: Channels) {
        let stride = settings.points * channels.count();
        self.matchers.resize_with(settings.clouds, Matcher::default);
        let clouds = self.points.par_chunks_exact_mut(stride);
        let clouds = clouds.zip(self.targets.par_chunks_exact_mut(stride));
        let clouds = clouds.zip(&self.times).zip(&mut self.matchers);
        clouds.for_each(|(((points, targets), &time), matcher)| {
            let path = &settings.path;
            path.coupling.couple(channels, points, targets, matcher);
            path.follow(time, points, targets);
        });
    }

    pub fn batch(&self, color_weight: f32) -> Batch<'_> {
        Batch {
            times: &self.times,
            conditions: &self.conditions,
            points: &self.points,
            targets: &self.targets,
            color_weight,
            huber: self.huber,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CLOUDS: usize = 11;

    /// Clouds of one point, each with its index as the condition.
    fn set() -> CloudSet {
        CloudSet {
            condition_dim: 1,
            points_per_cloud: 1,
            conditions: (0..CLOUDS).map(|k| k as f32).collect(),
            points: vec![0.0; 3 * CLOUDS],
            colors: None,
            starts: None,
        }
    }

    #[test]
    fn an_epoch_has_each_cloud_at_most_once_and_depends_on_nothing_but_seed_and_step() {
        let settings = TrainSettings {
            clouds: 3,
            points: 1,
            ..TrainSettings::default()
        };
        let set = set();
        let mut samples = Samples::default();
        let mut at = |seed: u64, step: u64| {
            let settings = TrainSettings {
                seed,
                ..settings.clone()
            };
            samples.draw(&settings, (&set, Draw::Shuffled), Channels::Xyz, step);
            samples.conditions.clone()
        };
        let mut epoch =
            |first: u64| -> Vec<f32> { (first..first + 3).flat_map(|k| at(7, k)).collect() };
        let (one, two) = (epoch(1), epoch(4));
        for drawn in [&one, &two] {
            let mut sorted = drawn.clone();
            sorted.sort_by(f32::total_cmp);
            sorted.dedup();
            assert_eq!(sorted.len(), 9, "{drawn:?}");
        }
        assert_ne!(one, two);
        // As a run that is resumed draws it.
        assert_eq!(epoch(1), one);
        let other: Vec<f32> = (1..4).flat_map(|step| at(8, step)).collect();
        assert_ne!(other, one);
    }
}

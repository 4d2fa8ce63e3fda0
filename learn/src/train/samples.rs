//! The batch of a training step.

use rand::RngExt;
use rayon::prelude::*;

use super::settings::TrainSettings;
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
    /// Indices of a cloud's points, the drawn ones first.
    order: Vec<usize>,
    /// One per cloud.
    matchers: Vec<Matcher>,
}

impl Samples {
    /// Draws the batch of step `step`: clouds with replacement, points of each without.
    pub fn draw(
        &mut self,
        settings: &TrainSettings,
        set: &CloudSet,
        channels: Channels,
        step: u64,
    ) {
        let mut rng = rng(settings.seed, Stream::Step(step));
        let stride = settings.points * channels.count();
        self.times.clear();
        self.conditions.clear();
        self.points.resize(settings.clouds * stride, 0.0);
        self.targets.clear();
        for points in self.points.chunks_exact_mut(stride) {
            let cloud = rng.random_range(0..set.len());
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
        }
    }
}

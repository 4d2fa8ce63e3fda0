//! Refinement: the last evaluation of a prediction, learned where predictions end.
//!
//! Most of what is wrong with a predicted cloud arises in the last hundredths of the flow: points come to lie inside the robot,
//! where the paths of the training data hardly ever pass, and the network learns little about them. So when its training is
//! done, a copy of it learns on the ends of its own flow, under the conditions of the training clouds: where a point should
//! have come to is the surface nearest to it, the mean of the three nearest points of the training cloud. (States that a model
//! itself reaches are what it has to learn on: Ross, Gordon and Bagnell, AISTATS 2011.) In a prediction the copy takes the
//! place of the network in the last denoising ([`Sampler::denoise`]).

use rand::RngExt;
use rayon::prelude::*;
use tdcr_base::hash::hash_all;

use super::error::{SettingsError, TrainError};
use super::model::Model;
use super::optimizer::Optimizer;
use super::refined::{Refined, positions};
use super::samples::Samples;
use super::settings::{Refinement, Target, TrainSettings};
use super::{start, state};
use crate::channels::DIM;
use crate::data::CloudSet;
use crate::flow::{FlowPath, Reach, Sampler, Stream, VelocityField, rng};
use crate::metrics::nearest_points;
use crate::net::{Channels, Network, NetworkShape};
use crate::prior::start_from;

/// Points of the training cloud whose mean a point should come to.
const TARGETS: usize = 3;

/// Length of an error (normalised units) beyond which it counts linearly, about a millimetre: a point in the middle of the robot
/// should come to one side of it, not to their mean.
const HUBER: f32 = 2.5e-3;

/// Learning rate, of Muon and of AdamW: half of what networks are trained at from the start.
const RATE: f64 = 1e-2;

/// The ends of a network's flow under the conditions of training clouds, and where they should have come to.
#[derive(Debug)]
pub struct Refiner {
    network: Network,
    reach: Option<Reach>,
    path: FlowPath,
    /// Flow time of the denoising.
    time: f32,
    fingerprint: u64,
    condition_dim: usize,
    points_per_cloud: usize,
    /// `(B, D)`.
    conditions: Vec<f32>,
    /// `(B, N, C)`.
    ends: Vec<f32>,
    /// Velocities that take the ends to the surface, `(B, N, C)`.
    targets: Vec<f32>,
}

impl Refiner {
    /// What `model` has to learn of its own predictions for the clouds of `set`: a function of these and of the seed of its run. On
    /// all cores; `made` is told of every cloud, and says whether to go on. `None` where it says no.
    ///
    /// # Errors
    /// [`TrainError`] where the model's settings have no refinement, or the set does not suit it.
    pub fn new(
        model: &Model,
        set: &CloudSet,
        made: &(dyn Fn() -> bool + Sync),
    ) -> Result<Option<Self>, TrainError> {
        let settings = &model.settings;
        let (Some(refinement), Some(time)) = (settings.refinement, settings.sampler.denoise) else {
            let expected = "steps, with a sampler that denoises";
            return Err(SettingsError::new("refinement", "none", expected).into());
        };
        let network = model.network.clone().with_precision(settings.precision)?;
        let points = refinement.points_per_cloud(settings, set.len());
        let cloud = points * network.channels().count();
        let mut ends = vec![0.0; set.len() * cloud];
        let mut targets = vec![0.0; ends.len()];
        let clouds = ends.par_chunks_exact_mut(cloud.max(1));
        let clouds = clouds.zip(targets.par_chunks_exact_mut(cloud.max(1)));
        let field = Refined {
            flow: &network,
            last: None,
            reach: model.reach,
        };
        let lessons = clouds.enumerate().map(|(index, (ends, targets))| {
            if !made() {
                return Ok(false);
            }
            let lesson = Lesson {
                settings,
                set,
                index,
            };
            lesson.predict(&field, ends);
            lesson.aim(&field, ends, targets, time)?;
            Ok(true)
        });
        let whole = lessons.try_reduce(|| true, |a, b| Ok::<_, TrainError>(a && b))?;
        Ok(whole.then(|| Self {
            fingerprint: hash_all(&[start::fingerprint(&network), state::fingerprint(set)]),
            path: settings.path,
            reach: model.reach,
            network,
            time,
            condition_dim: set.condition_dim,
            points_per_cloud: points,
            conditions: set.conditions.clone(),
            ends,
            targets,
        }))
    }

    /// The network whose flow it refines.
    pub fn network(&self) -> &Network {
        &self.network
    }

    /// The network beside `last`, which is learned.
    pub(super) fn refined<'a>(&'a self, last: &'a Network) -> Refined<'a> {
        Refined {
            flow: &self.network,
            last: Some((self.time, last)),
            reach: self.reach,
        }
    }

    /// Returns an error for a network of another shape, or settings that do not refine this flow.
    pub(super) fn check(
        &self,
        shape: &NetworkShape,
        settings: &TrainSettings,
    ) -> Result<(), SettingsError> {
        let own = self.network.shape();
        SettingsError::unless_equal("shape", shape, &own, format!("the flow's {own:?}"))?;
        let path = format!("the flow's {:?}", self.path);
        SettingsError::unless_equal("path", &settings.path, &self.path, path)?;
        let time = format!("{}, of which the ends are", self.time);
        let denoise = &settings.sampler.denoise;
        SettingsError::unless_equal("sampler denoising time", denoise, &Some(self.time), time)?;
        if settings.points > self.points_per_cloud {
            let expected = format!("at most the {} of a cloud", self.points_per_cloud);
            return Err(SettingsError::new("points", settings.points, expected));
        }
        Ok(())
    }

    pub(super) fn reach(&self) -> Option<Reach> {
        self.reach
    }

    pub(super) fn points_per_cloud(&self) -> usize {
        self.points_per_cloud
    }

    pub(super) fn fingerprint(&self) -> u64 {
        self.fingerprint
    }

    /// Draws the batch of step `step`: clouds with replacement, points of each without.
    pub(super) fn draw_batch(&self, settings: &TrainSettings, step: u64, samples: &mut Samples) {
        let mut rng = rng(settings.seed, Stream::Step(step));
        let row = self.network.channels().count();
        let stride = self.points_per_cloud * row;
        samples.huber = Some(HUBER / (1.0 - self.time));
        samples.times.clear();
        samples.times.resize(settings.clouds, self.time);
        samples.conditions.clear();
        samples.points.clear();
        samples.targets.clear();
        for _ in 0..settings.clouds {
            let cloud = rng.random_range(0..self.conditions.len() / self.condition_dim);
            let condition = &self.conditions[cloud * self.condition_dim..][..self.condition_dim];
            samples.conditions.extend_from_slice(condition);
            let chosen = rand::seq::index::sample(&mut rng, self.points_per_cloud, settings.points);
            for k in chosen {
                let place = cloud * stride + k * row;
                samples
                    .points
                    .extend_from_slice(&self.ends[place..place + row]);
                samples
                    .targets
                    .extend_from_slice(&self.targets[place..place + row]);
            }
        }
    }
}

/// A training cloud whose prediction is learned from.
struct Lesson<'a> {
    settings: &'a TrainSettings,
    set: &'a CloudSet,
    index: usize,
}

impl Lesson<'_> {
    /// The ends of the flow.
    fn predict(&self, field: &Refined, ends: &mut [f32]) {
        let Self {
            settings,
            set,
            index,
        } = *self;
        let (path, sampler) = (settings.path, settings.sampler);
        let mut rng = rng(settings.seed, Stream::Own(index as u64));
        let channels = field.channels();
        path.sample_prior(&mut rng, channels, ends);
        if let Some(surface) = set.start(index) {
            let points = ends.len() / channels.count();
            let from: Vec<_> = (0..points)
                .map(|_| rng.random_range(0..set.points_per_cloud))
                .collect();
            start_from(surface, &from, channels, ends);
        }
        let flow = Sampler {
            denoise: None,
            ..sampler
        };
        flow.integrate(field, set.condition(index), ends);
    }

    /// The velocities that take the ends to the surface in the time that is left at `time`. Colours keep those that the flow gives
    /// them: they are as good as they get, and a colour that is off would need a velocity beside which no displacement counts.
    fn aim(
        &self,
        field: &Refined,
        ends: &[f32],
        targets: &mut [f32],
        time: f32,
    ) -> Result<(), TrainError> {
        let Self { set, index, .. } = *self;
        let channels = field.channels();
        let (cloud, _) = set.cloud(index).as_chunks::<DIM>();
        let points = positions(ends, channels);
        let nearest = match cloud.len() >= TARGETS {
            true => nearest_points::<TARGETS>(&points, cloud),
            // Of a cloud of one or two points, the nearer one.
            false => nearest_points(&points, cloud)
                .map(|nearest| nearest.into_iter().map(|[k]| [k; TARGETS]).collect()),
        };
        let nearest = nearest.map_err(|error| TrainError::Data {
            set: "training",
            reason: format!("cloud {index}, or its prediction: {error}"),
        })?;
        if channels == Channels::XyzRgb {
            field.velocity(time, set.condition(index), ends, targets);
        }
        let rows = targets.chunks_exact_mut(channels.count());
        for ((nearest, point), target) in nearest.into_iter().zip(points).zip(rows) {
            for (k, (target, x)) in target.iter_mut().zip(point).enumerate() {
                let sum: f32 = nearest.iter().map(|&other| cloud[other][k]).sum();
                *target = (sum / TARGETS as f32 - x) / (1.0 - time);
            }
        }
        Ok(())
    }
}

impl TrainSettings {
    /// Returns an error for a refinement that cannot be learned.
    pub(super) fn check_refinement(&self) -> Result<(), SettingsError> {
        let Some(Refinement { steps, points }) = self.refinement else {
            return Ok(());
        };
        for (field, value) in [
            ("refinement.steps", steps),
            ("refinement.points", points as u64),
        ] {
            if value == 0 {
                return Err(SettingsError::new(field, value, "at least 1"));
            }
        }
        if self.sampler.denoise.is_none() {
            let expected = "a sampler that denoises, whose last evaluation it learns";
            return Err(SettingsError::new(
                "refinement",
                format!("{steps} steps"),
                expected,
            ));
        }
        Ok(())
    }

    /// Settings of the refinement of a network that was trained with these; `None` where there is none.
    pub fn refining(&self) -> Option<Self> {
        let refinement = self.refinement?;
        Some(Self {
            steps: refinement.steps,
            earlier: Vec::new(),
            points: self.points.min(refinement.points),
            optimizer: Optimizer::Muon {
                learning_rate: RATE,
            },
            learning_rate: RATE,
            warmup_steps: (refinement.steps / 10).min(100),
            target: Target::Refinement,
            validate_every: refinement.steps.div_ceil(4).max(1),
            patience: None,
            ..self.clone()
        })
    }
}

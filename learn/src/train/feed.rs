//! Sources of training clouds.

use tdcr_base::hash::hash;
use tdcr_sim::robot::SpecError;

use super::error::{SettingsError, TrainError};
use super::refinement::Refiner;
use super::samples::{Draw, Samples};
use super::settings::{Target, TrainSettings};
use super::state::fingerprint;
use super::teacher::Teacher;
use crate::channels::{Channels, DIM};
use crate::data::{CloudSet, Normalisation, Sample, SimStream, SimulateError, StreamSpec};
use crate::flow::{Reach, Sampler};
use crate::net::{Network, NetworkShape};
use crate::symmetry::Reduction;

/// Samples that a stream's threads may be ahead of the run.
const AHEAD: usize = 32;

/// Training clouds: a set in memory, or a stream that never ends.
#[derive(Debug)]
#[non_exhaustive]
pub enum Feed<'a> {
    /// The clouds of a data set.
    Set(&'a CloudSet),
    /// The last clouds of a stream.
    Stream(Box<StreamWindow>),
    /// The trajectories of another network, from prior to data: distillation.
    Teacher(Box<Teacher>),
    /// The ends of another network's flow: refinement.
    Refiner(Box<Refiner>),
}

/// A window of `clouds` clouds that moves along a stream by `fresh` clouds per step: step `k` (the first is 1) sees the
/// samples from `(k - 1) fresh` on. So a step does not depend on interruptions, and each cloud serves `clouds / fresh`
/// steps.
#[derive(Debug)]
pub struct StreamWindow {
    spec: StreamSpec,
    fresh: usize,
    threads: usize,
    normalisation: Normalisation,
    reduction: Reduction,
    /// Sample `i` is in place `i mod clouds`.
    set: CloudSet,
    clouds: usize,
    /// The stream, and the index of its next sample; none before the first step.
    stream: Option<(SimStream, u64)>,
}

impl<'a> From<&'a CloudSet> for Feed<'a> {
    fn from(set: &'a CloudSet) -> Self {
        Self::Set(set)
    }
}

impl Feed<'_> {
    /// Condition dimension `D`.
    pub fn condition_dim(&self) -> usize {
        match self {
            Self::Set(set) => set.condition_dim,
            Self::Stream(window) => window.set.condition_dim,
            Self::Teacher(teacher) => teacher.network().shape().condition_dim(),
            Self::Refiner(refiner) => refiner.network().shape().condition_dim(),
        }
    }

    /// Points per cloud `N`; a teacher gives any number.
    pub fn points_per_cloud(&self) -> usize {
        match self {
            Self::Set(set) => set.points_per_cloud,
            Self::Stream(window) => window.set.points_per_cloud,
            Self::Teacher(_) => usize::MAX,
            Self::Refiner(refiner) => refiner.points_per_cloud(),
        }
    }

    /// Where its clouds are; `None` for a student, whose velocities do not point at data.
    pub(super) fn reach(&self) -> Option<Reach> {
        match self {
            Self::Set(set) => Reach::of(&set.points),
            Self::Stream(_) => Some(Reach::NORMALISED),
            Self::Teacher(_) => None,
            Self::Refiner(refiner) => refiner.reach(),
        }
    }

    /// The teacher's network for the last denoising of a student with `sampler`, where that takes it over ([`Teacher::lent`]).
    pub(super) fn lent(&self, sampler: &Sampler) -> Option<&Network> {
        match self {
            Self::Teacher(teacher) => teacher.lent(sampler),
            Self::Set(_) | Self::Stream(_) | Self::Refiner(_) => None,
        }
    }

    /// Number of clouds; 0 where a network is the source.
    pub(super) fn clouds(&self) -> usize {
        match self {
            Self::Set(set) => set.len(),
            Self::Stream(window) => window.clouds,
            Self::Teacher(_) | Self::Refiner(_) => 0,
        }
    }

    /// The clouds that step `step` draws from; `None` where a network is the source.
    pub(super) fn at_step(&mut self, step: u64) -> Result<Option<&CloudSet>, TrainError> {
        match self {
            Self::Set(set) => Ok(Some(set)),
            Self::Stream(window) => window.at_step(step.max(1)).map(Some),
            Self::Teacher(_) | Self::Refiner(_) => Ok(None),
        }
    }

    /// Draws the batch of step `step` for `network`, whose steps a teacher looks at.
    pub(super) fn draw(
        &mut self,
        settings: &TrainSettings,
        network: &Network,
        step: u64,
        samples: &mut Samples,
    ) -> Result<(), TrainError> {
        let channels = network.shape().channels();
        match self {
            Self::Set(set) => {
                let draw = Draw::of(settings.procedure);
                samples.draw(settings, (set, draw), channels, step);
            }
            Self::Stream(window) => {
                let set = window.at_step(step)?;
                samples.draw(settings, (set, Draw::Replacing), channels, step);
            }
            Self::Teacher(teacher) => teacher.draw_batch(settings, network, step, samples),
            Self::Refiner(refiner) => refiner.draw_batch(settings, step, samples),
        }
        Ok(())
    }

    /// A hash of the clouds, or of what determines them.
    pub(super) fn fingerprint(&self) -> u64 {
        match self {
            Self::Set(set) => fingerprint(set),
            Self::Stream(window) => {
                let key = (&window.spec, window.clouds, window.fresh);
                let mut json = serde_json::to_string(&key).expect("plain values serialise");
                if !window.reduction.is_trivial() {
                    json +=
                        &serde_json::to_string(&window.reduction).expect("plain values serialise");
                }
                hash(json.bytes().map(u32::from))
            }
            Self::Teacher(teacher) => teacher.fingerprint(),
            Self::Refiner(refiner) => refiner.fingerprint(),
        }
    }
}

impl StreamWindow {
    /// A window of `clouds` clouds of `channels` on the stream `spec`, made by `threads` threads; at least one of each.
    ///
    /// # Errors
    /// [`SpecError`] where the robot is refused.
    pub fn new(
        spec: StreamSpec,
        clouds: usize,
        fresh: usize,
        threads: usize,
        channels: Channels,
    ) -> Result<Self, SpecError> {
        let normalisation = spec.normalisation()?;
        let clouds = clouds.max(1);
        let condition_dim = normalisation.motor_min.len();
        Ok(Self {
            set: blank(clouds, condition_dim, spec.points, channels),
            spec,
            fresh: fresh.max(1),
            threads,
            normalisation,
            reduction: Reduction::default(),
            clouds,
            stream: None,
        })
    }

    /// The same of samples that are reduced by `reduction`, which is of the stream's recipe.
    #[must_use]
    pub fn with_reduction(self, reduction: Reduction) -> Self {
        let condition_dim = self.normalisation.motor_min.len() + reduction.view_numbers();
        let set = blank(
            self.clouds,
            condition_dim,
            self.spec.points,
            self.channels(),
        );
        Self {
            set,
            reduction,
            ..self
        }
    }

    fn channels(&self) -> Channels {
        match self.set.colors {
            None => Channels::Xyz,
            Some(_) => Channels::XyzRgb,
        }
    }

    /// The normalisation of the clouds: [`StreamSpec::normalisation`].
    pub fn normalisation(&self) -> &Normalisation {
        &self.normalisation
    }

    /// Clouds for validation, which no step sees: the samples of the stream from `2^62` on.
    ///
    /// # Errors
    /// [`TrainError::Data`] where a sample cannot be made.
    pub fn validation(&self, clouds: usize) -> Result<CloudSet, TrainError> {
        let mut set = blank(
            clouds,
            self.set.condition_dim,
            self.spec.points,
            self.channels(),
        );
        let mut stream = self.open(1 << 62)?;
        for place in 0..clouds {
            let sample = next(&mut stream)?;
            put(
                &mut set,
                place,
                sample,
                &self.normalisation,
                &self.reduction,
            )?;
        }
        Ok(set)
    }

    fn at_step(&mut self, step: u64) -> Result<&CloudSet, TrainError> {
        let first = (step - 1) * self.fresh as u64;
        // A step before the window, or far behind it, starts a new stream.
        let reached = self
            .stream
            .take()
            .filter(|(_, next)| (first..=first + self.clouds as u64).contains(next));
        let (mut stream, mut index) = match reached {
            Some(reached) => reached,
            None => (self.open(first)?, first),
        };
        while index < first + self.clouds as u64 {
            let place = (index % self.clouds as u64) as usize;
            let sample = next(&mut stream)?;
            put(
                &mut self.set,
                place,
                sample,
                &self.normalisation,
                &self.reduction,
            )?;
            index += 1;
        }
        self.stream = Some((stream, index));
        Ok(&self.set)
    }

    fn open(&self, first: u64) -> Result<SimStream, TrainError> {
        SimStream::open(&self.spec, first, self.threads, AHEAD).map_err(refuse)
    }
}

/// A set of clouds, all zero.
fn blank(clouds: usize, condition_dim: usize, points: usize, channels: Channels) -> CloudSet {
    let components = clouds * points * DIM;
    CloudSet {
        condition_dim,
        points_per_cloud: points,
        conditions: vec![0.0; clouds * condition_dim],
        points: vec![0.0; components],
        colors: (channels == Channels::XyzRgb).then(|| vec![0; components]),
        starts: None,
    }
}

fn next(stream: &mut SimStream) -> Result<Sample, TrainError> {
    let sample = stream.next().unwrap_or(Err(SimulateError::Panicked));
    sample.map_err(refuse)
}

fn refuse(error: impl ToString) -> TrainError {
    TrainError::Data {
        set: "training",
        reason: error.to_string(),
    }
}

/// Puts a sample, reduced and normalised, in a place of a set.
fn put(
    set: &mut CloudSet,
    place: usize,
    sample: Sample,
    normalisation: &Normalisation,
    reduction: &Reduction,
) -> Result<(), TrainError> {
    let (sample, condition) = reduction.sample(sample, normalisation).map_err(refuse)?;
    set.conditions[place * set.condition_dim..][..set.condition_dim].copy_from_slice(&condition);
    let stride = set.points_per_cloud * DIM;
    let points = &mut set.points[place * stride..][..stride];
    points.copy_from_slice(sample.cloud.points.as_flattened());
    normalisation.normalise_points(points);
    if let Some(colors) = &mut set.colors {
        let colors = &mut colors[place * stride..][..stride];
        colors.copy_from_slice(sample.cloud.colors.as_flattened());
    }
    Ok(())
}

/// Returns an error for training clouds that do not suit the network or the settings.
pub(super) fn check_feed(
    feed: &Feed,
    shape: &NetworkShape,
    settings: &TrainSettings,
) -> Result<(), TrainError> {
    let points = settings.points;
    let target = match feed {
        Feed::Set(_) | Feed::Stream(_) => Target::Velocity,
        Feed::Teacher(_) => Target::Steps,
        Feed::Refiner(_) => Target::Refinement,
    };
    if !settings.prior.is_gaussian() && !matches!(feed, Feed::Set(_) | Feed::Refiner(_)) {
        let expected = "gaussian: only the flow to a data set starts from a simulated surface";
        return Err(SettingsError::new("prior", "surface", expected).into());
    }
    if settings.target != target {
        let expected = match target {
            Target::Velocity => "velocity: clouds teach nothing else",
            Target::Steps => "steps: a teacher teaches them",
            Target::Refinement => "refinement: the ends of a flow teach nothing else",
        };
        return Err(SettingsError::new("target", settings.target.name(), expected).into());
    }
    let set = match feed {
        Feed::Set(set) => {
            check_set("training", set, shape, settings, points)?;
            return check_batch(set, settings);
        }
        Feed::Stream(window) => &window.set,
        Feed::Teacher(teacher) => return Ok(teacher.check(shape, settings)?),
        Feed::Refiner(refiner) => return Ok(refiner.check(shape, settings)?),
    };
    if shape.channels() == Channels::XyzRgb && set.colors.is_none() {
        return Err(no_colors("training"));
    }
    let (found, expected) = (feed.condition_dim(), shape.condition_dim());
    if found != expected {
        let reason = format!("conditions of dimension {found}, expected the network's {expected}");
        return Err(TrainError::Data {
            set: "training",
            reason,
        });
    }
    let found = feed.points_per_cloud();
    if points > found {
        let reason = format!("{found} points per cloud, expected at least {points}");
        return Err(TrainError::Data {
            set: "training",
            reason,
        });
    }
    Ok(())
}

/// Returns an error where clouds without replacement do not fill a batch.
fn check_batch(set: &CloudSet, settings: &TrainSettings) -> Result<(), TrainError> {
    if Draw::of(settings.procedure) == Draw::Replacing || settings.clouds <= set.len() {
        return Ok(());
    }
    let expected = format!(
        "at most the {} clouds of the training set, which the authors' procedure draws without replacement",
        set.len()
    );
    Err(SettingsError::new("clouds", settings.clouds, expected).into())
}

/// Returns an error for sets that are inconsistent, hold a value that is not finite, or have fewer than `points` points per
/// cloud.
pub(super) fn check_set(
    name: &'static str,
    set: &CloudSet,
    shape: &NetworkShape,
    settings: &TrainSettings,
    points: usize,
) -> Result<(), TrainError> {
    let refuse = |reason: String| Err(TrainError::Data { set: name, reason });
    check_starts(set, settings).or_else(refuse)?;
    if set.condition_dim != shape.condition_dim() {
        let expected = shape.condition_dim();
        return refuse(format!(
            "conditions of dimension {}, expected the network's {expected}",
            set.condition_dim
        ));
    }
    if set.conditions.is_empty() {
        return refuse("no cloud, expected at least 1".to_owned());
    }
    let clouds = set.conditions.len() / set.condition_dim;
    if set.conditions.len() != clouds * set.condition_dim
        || set.points.len() != clouds * set.points_per_cloud * DIM
    {
        let (conditions, components) = (set.conditions.len(), set.points.len());
        return refuse(format!(
            "{conditions} condition values and {components} point coordinates, expected {clouds} clouds of {} and {}",
            set.condition_dim,
            set.points_per_cloud * DIM
        ));
    }
    if points > set.points_per_cloud {
        return refuse(format!(
            "{} points per cloud, expected at least {points}",
            set.points_per_cloud
        ));
    }
    for (what, values) in [
        ("condition value", &set.conditions),
        ("point coordinate", &set.points),
    ] {
        if let Some(index) = values.iter().position(|x| !x.is_finite()) {
            return refuse(format!(
                "{what} {index} is {}, expected finite values",
                values[index]
            ));
        }
    }
    match shape.channels() {
        Channels::Xyz => Ok(()),
        Channels::XyzRgb => check_colors(name, set),
    }
}

/// Returns what is wrong with the surfaces that the flow starts from.
fn check_starts(set: &CloudSet, settings: &TrainSettings) -> Result<(), String> {
    let Some(starts) = &set.starts else {
        return match settings.prior.is_gaussian() {
            true => Ok(()),
            false => Err("no surfaces to start from, which the prior needs".to_owned()),
        };
    };
    if settings.prior.is_gaussian() {
        return Err("surfaces to start from, expected none with the Gaussian prior".to_owned());
    }
    let (found, expected) = (starts.len(), set.points.len());
    if found != expected {
        return Err(format!(
            "{found} coordinates of surfaces to start from, expected {expected}, as many as the clouds have"
        ));
    }
    match starts.iter().position(|x| !x.is_finite()) {
        None => Ok(()),
        Some(index) => Err(format!(
            "surface coordinate {index} is {}, expected finite values",
            starts[index]
        )),
    }
}

/// Returns an error for sets without colours, and for those in which all points have the same one: there is nothing to learn.
fn check_colors(name: &'static str, set: &CloudSet) -> Result<(), TrainError> {
    let colors = set.colors.as_ref().ok_or_else(|| no_colors(name))?;
    let refuse = |reason: String| Err(TrainError::Data { set: name, reason });
    if colors.len() != set.points.len() {
        let (found, expected) = (colors.len(), set.points.len());
        return refuse(format!("{found} colour values, expected {expected}"));
    }
    let (colors, _) = colors.as_chunks::<3>();
    if colors.iter().all(|color| *color == colors[0]) {
        return refuse(format!(
            "all points have the colour {:?}, expected several: clouds that are imported without colours are grey",
            colors[0]
        ));
    }
    Ok(())
}

fn no_colors(set: &'static str) -> TrainError {
    TrainError::Data {
        set,
        reason: "positions alone, expected colours too".to_owned(),
    }
}

//! The training loop (paper, Alg. tdcr-training), one step at a time.

use rand::seq::index;

use super::difference::require_same;
use super::error::{SettingsError, TrainError};
use super::feed::{Feed, check_feed, check_set};
use super::model::{Model, Provenance};
use super::optimizer::{Moments, Update, Updater, norm};
use super::refined::Refined;
use super::refinement::Refiner;
use super::samples::Samples;
use super::settings::TrainSettings;
use super::spike::SPIKE_STEPS;
use super::start::{self, Start};
use super::state::{Best, TrainingState, fingerprint};
use super::validation::predict_cloud;
use crate::channels::DIM;
use crate::data::CloudSet;
use crate::flow::{Reach, Stream, rng};
use crate::net::{Network, Workspace};

/// A distance between two clouds, the Chamfer distance in the paper.
pub type Distance<'a> = &'a dyn Fn(&[[f32; 3]], &[[f32; 3]]) -> f64;

/// Steps whose losses and norms are allocated for from the start (4 MB each).
const HISTORY: u64 = 1 << 20;

/// A training run.
///
/// Everything random in step `k` follows from the settings' seed and `k`, so a run that is stopped and resumed equals
/// one that was not, bit for bit, on any number of threads.
#[derive(Debug)]
pub struct Trainer<'a> {
    training: Feed<'a>,
    reach: Option<Reach>,
    validation: &'a CloudSet,
    /// Fingerprints of the two sets.
    data: [u64; 2],
    /// [`Start::fingerprint`].
    initial: Option<u64>,
    settings: TrainSettings,
    network: Network,
    /// Running average of the network's weights.
    average: Network,
    updater: Updater,
    step: u64,
    best: Option<Best>,
    losses: Vec<f32>,
    gradient_norms: Vec<f32>,
    validations: Vec<(u64, f64)>,
    samples: Samples,
    gradient: Vec<f32>,
    workspace: Workspace,
}

impl<'a> Trainer<'a> {
    /// A new run: random weights of a network of the given shape, or those of a given network.
    ///
    /// # Errors
    /// [`TrainError`] where settings or shape are out of bounds, or the sets do not suit them.
    pub fn new<'s>(
        start: impl Into<Start<'s>>,
        settings: TrainSettings,
        training: impl Into<Feed<'a>>,
        validation: &'a CloudSet,
    ) -> Result<Self, TrainError> {
        let start = start.into();
        let shape = start.shape();
        if !shape.has_gradient() {
            return Err(TrainError::BatchNorm);
        }
        settings.check()?;
        let training = training.into();
        check_feed(&training, &shape, &settings)?;
        check_set(
            "validation",
            validation,
            &shape,
            &settings,
            settings.validation_points,
        )?;
        if settings.validation_clouds > validation.len() {
            let expected = format!(
                "at most the {} clouds of the validation set",
                validation.len()
            );
            return Err(SettingsError::new(
                "validation_clouds",
                settings.validation_clouds,
                expected,
            )
            .into());
        }
        let network = start
            .network(&settings)?
            .with_precision(settings.precision)?;
        let parameters = network.params().len();
        let history = settings.steps.min(HISTORY) as usize;
        let updater = Updater::new(settings.optimizer, &shape.tensors());
        Ok(Self {
            data: [training.fingerprint(), fingerprint(validation)],
            initial: start.fingerprint(),
            reach: training.reach(),
            training,
            validation,
            settings,
            average: network.clone(),
            network,
            updater,
            step: 0,
            best: None,
            losses: Vec::with_capacity(history),
            gradient_norms: Vec::with_capacity(history),
            validations: Vec::new(),
            samples: Samples::default(),
            gradient: vec![0.0; parameters],
            workspace: Workspace::default(),
        })
    }

    /// Resumes the run that `state` was saved from, or extends it by more steps: then the next step follows the schedule of
    /// the new length, and [`TrainSettings::earlier`] records the older one.
    ///
    /// # Errors
    /// [`TrainError::Shorter`] where the run had more steps; [`TrainError::OtherRun`] where `state` is of another shape, other
    /// settings, other data or another start; else as [`Trainer::new`].
    pub fn resume<'s>(
        state: TrainingState,
        start: impl Into<Start<'s>>,
        settings: TrainSettings,
        training: impl Into<Feed<'a>>,
        validation: &'a CloudSet,
    ) -> Result<Self, TrainError> {
        let start = start.into();
        let shape = start.shape();
        let other = TrainError::other_run;
        // First: where it differs, shapes do as well.
        let [of_state, own] = [&state.settings, &settings].map(|settings| settings.symmetry);
        require_same("settings.symmetry", &of_state, &own).map_err(other)?;
        require_same("shape", &state.shape, &shape).map_err(other)?;
        let settings = settings.continuing(&state.settings, state.step)?;
        let mut trainer = Self::new(start, settings, training, validation)?;
        for (set, found, expected) in [
            ("training set's fingerprint", state.data[0], trainer.data[0]),
            (
                "validation set's fingerprint",
                state.data[1],
                trainer.data[1],
            ),
        ] {
            require_same(set, &found, &expected).map_err(other)?;
        }
        let [found, expected] = [state.initial, trainer.initial].map(start::describe);
        require_same("the start of the weights", &found, &expected).map_err(other)?;
        let network = |params| {
            let network = Network::from_params(shape, params)?;
            network.with_precision(trainer.settings.precision)
        };
        trainer.average = network(state.average)?;
        trainer.network = network(state.params)?;
        trainer.updater.moments = Moments {
            first: state.first_moment,
            second: state.second_moment,
        };
        trainer.step = state.step;
        trainer.best = state.best;
        trainer.losses.extend(state.losses);
        trainer.gradient_norms.extend(state.gradient_norms);
        trainer.validations = state.validations;
        Ok(trainer)
    }

    /// The whole run, to be saved. `provenance` is that of the data sets.
    pub fn state(&self, provenance: Provenance) -> TrainingState {
        TrainingState {
            provenance,
            shape: self.network.shape(),
            settings: self.settings.clone(),
            data: self.data,
            initial: self.initial,
            step: self.step,
            params: self.network.params().to_vec(),
            average: self.average.params().to_vec(),
            first_moment: self.updater.moments.first.clone(),
            second_moment: self.updater.moments.second.clone(),
            best: self.best.clone(),
            losses: self.losses.clone(),
            gradient_norms: self.gradient_norms.clone(),
            validations: self.validations.clone(),
        }
    }

    /// The predictor: the best averaged weights so far. None before the first validation.
    pub fn model(&self, provenance: Provenance) -> Option<Model> {
        let best = self.best.as_ref()?;
        // Of single precision, as a model that is read.
        let network = |params| {
            let network = Network::from_params(self.network.shape(), params);
            network.expect("weights of this network's shape")
        };
        let lent = self.training.lent(&self.settings.sampler);
        Some(Model {
            provenance,
            settings: self.settings.clone(),
            step: best.step,
            validation_distance: best.distance,
            network: network(best.params.clone()),
            refinement: lent.map(|last| network(last.params().to_vec())),
            reach: self.reach,
            uncertainty_factor: None,
        })
    }

    /// Clouds of the training set, or of the window on the stream; 0 where a network is the source.
    pub fn clouds(&self) -> usize {
        self.training.clouds()
    }

    /// What `model`, the network of this run, has to learn on the ends of its own flow for the training clouds; of a stream for
    /// those of the last step. As [`Refiner::new`].
    ///
    /// # Errors
    /// [`TrainError`] as [`Refiner::new`], and where a stream's samples cannot be made.
    pub fn refiner(
        &mut self,
        model: &Model,
        made: &(dyn Fn() -> bool + Sync),
    ) -> Result<Option<Refiner>, TrainError> {
        match self.training.at_step(self.step)? {
            Some(set) => Refiner::new(model, set, made),
            None => {
                let expected = "of a network that clouds teach";
                Err(SettingsError::new("refinement", "of a distilled one", expected).into())
            }
        }
    }

    /// Settings of the run.
    pub fn settings(&self) -> &TrainSettings {
        &self.settings
    }

    /// Steps taken.
    pub fn steps_taken(&self) -> u64 {
        self.step
    }

    /// Whether all steps are taken, or [`TrainSettings::patience`] is exhausted.
    pub fn is_finished(&self) -> bool {
        self.step >= self.settings.steps || self.is_out_of_patience()
    }

    fn is_out_of_patience(&self) -> bool {
        let Some((patience, best)) = self.settings.patience.zip(self.best.as_ref()) else {
            return false;
        };
        let worse = self.validations.iter().rev();
        worse.take_while(|(step, _)| *step > best.step).count() as u64 >= patience
    }

    /// Whether the last loss is near its running level, so that the run is worth saving: false from the first step of a
    /// spike that may become [`TrainError::Spike`].
    pub fn is_level(&self) -> bool {
        self.settings.spike_length(&self.losses) == 0
    }

    /// Whether the averaged weights of this step should be validated: every [`TrainSettings::validate_every`] steps and
    /// at the end.
    pub fn validation_is_due(&self) -> bool {
        let due = self.step.is_multiple_of(self.settings.validate_every) || self.is_finished();
        due && self.step > 0
            && self
                .validations
                .last()
                .is_none_or(|(step, _)| *step < self.step)
    }

    /// Loss of every step taken.
    pub fn losses(&self) -> &[f32] {
        &self.losses
    }

    /// Norm of the gradient of every step taken, before clipping.
    pub fn gradient_norms(&self) -> &[f32] {
        &self.gradient_norms
    }

    /// Step and mean distance of every validation.
    pub fn validations(&self) -> &[(u64, f64)] {
        &self.validations
    }

    /// Takes one step; returns its loss, the mean squared velocity error before the step. Steps on a set in memory
    /// allocate nothing after the first, up to the millionth.
    ///
    /// # Errors
    /// [`TrainError::Diverged`] where the loss or its gradient is not finite, [`TrainError::Data`] where a stream's sample
    /// cannot be made; the run stays as it was before the step. [`TrainError::Spike`] where this loss is the last of a
    /// spike; the step is taken.
    pub fn step(&mut self) -> Result<f32, TrainError> {
        let step = self.step + 1;
        self.training
            .draw(&self.settings, &self.average, step, &mut self.samples)?;
        let batch = self.samples.batch(self.settings.color_weight);
        let loss = self
            .network
            .loss_and_gradient(&batch, &mut self.workspace, &mut self.gradient)
            as f32;
        let gradient_norm = norm(&self.gradient);
        require_finite(step, "the loss", loss.into())?;
        require_finite(step, "the gradient's norm", gradient_norm)?;
        let update = Update {
            step,
            learning_rate: self.settings.learning_rate_at(step),
            matrix_learning_rate: self.settings.matrix_learning_rate_at(step),
            weight_decay: self.settings.weight_decay,
            average_decay: self.settings.average_decay_at(step),
            gradient_scale: (self.settings.clip_norm / gradient_norm).min(1.0),
        };
        let average = self.average.params_mut();
        self.updater
            .update(&update, &self.gradient, self.network.params_mut(), average);
        self.step = step;
        self.losses.push(loss);
        self.gradient_norms
            .push((gradient_norm as f32).min(f32::MAX));
        if self.settings.spike_length(&self.losses) == SPIKE_STEPS {
            return Err(TrainError::Spike {
                step,
                loss,
                level: TrainSettings::loss_level(&self.losses).unwrap_or(f64::NAN) as f32,
                factor: self.settings.spike_factor,
            });
        }
        Ok(loss)
    }

    /// Mean `distance` between the positions of validation clouds and of their predictions by the averaged weights, in
    /// the distance's power of normalised units. Keeps the weights where they are the best so far.
    ///
    /// Noise and subsets of points depend on the seed alone, so validations of different steps compare.
    ///
    /// # Errors
    /// [`TrainError::Diverged`] where the distance is not finite.
    pub fn validate(&mut self, distance: Distance) -> Result<f64, TrainError> {
        let clouds = self.settings.validation_clouds;
        let spread = |k: usize| k * self.validation.len() / clouds;
        let sum: f64 = (0..clouds)
            .map(|k| self.validate_cloud(spread(k), distance))
            .sum();
        let mean = sum / clouds as f64;
        require_finite(self.step, "the validation distance", mean)?;
        self.validations.push((self.step, mean));
        if self.best.as_ref().is_none_or(|best| mean < best.distance) {
            self.best = Some(Best {
                step: self.step,
                distance: mean,
                params: self.average.params().to_vec(),
            });
        }
        Ok(mean)
    }

    /// `distance` between validation cloud `cloud` and its prediction.
    fn validate_cloud(&self, cloud: usize, distance: Distance) -> f64 {
        let Self {
            settings,
            validation,
            ..
        } = self;
        let field = match &self.training {
            Feed::Refiner(refiner) => refiner.refined(&self.average),
            other => Refined {
                flow: &self.average,
                last: (settings.sampler.denoise).zip(other.lent(&settings.sampler)),
                reach: self.reach,
            },
        };
        let count = settings.validation_points;
        let mut rng = rng(settings.seed, Stream::Sample(cloud as u64));
        let predicted = predict_cloud(field, settings, (validation, cloud), count, &mut rng);
        let (points, _) = validation.cloud(cloud).as_chunks::<DIM>();
        let subset = index::sample(&mut rng, points.len(), count);
        let truth: Vec<[f32; DIM]> = subset.iter().map(|k| points[k]).collect();
        distance(&predicted, &truth)
    }
}

fn require_finite(step: u64, quantity: &'static str, value: f64) -> Result<(), TrainError> {
    if value.is_finite() {
        Ok(())
    } else {
        Err(TrainError::Diverged {
            step,
            quantity,
            found: value,
        })
    }
}

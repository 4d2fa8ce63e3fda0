//! What a run is asked for, as names and numbers of its user, and what becomes of it.

use tdcr_learn::data::{DataSet, Meta, Origin, Recipe, Split, Subject};
use tdcr_learn::flow::{Coupling, FlowPath, Method, Sampler, TimeGrid};
use tdcr_learn::net::{Channels, ContextShape, Precision, TimeFeatures};
use tdcr_learn::prior::Prior;
use tdcr_learn::symmetry::SymmetryUse;
use tdcr_learn::train::{Optimizer, Refinement, Target, TrainSettings};
use tdcr_sim::robot::RobotSpec;

use super::preset::{Length, Preset, Rates};
use super::{NetworkSize, PipelineError, TrainRunError, TrainingData};

/// What [`train`](super::train) is asked for: a preset, and what is to be other than it says.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainPlan {
    /// The preset.
    pub preset: Preset,
    /// Features per layer; the preset's by default, as all that may be `None`.
    pub width: Option<usize>,
    /// Layers.
    pub depth: Option<usize>,
    /// Features of the embedding of time and condition.
    pub embedding: Option<usize>,
    /// The context network of a hybrid; `None` for an MLP.
    pub context: Option<ContextShape>,
    /// What points consist of.
    pub channels: Option<Channels>,
    /// Weight of the colours' error beside the positions'.
    pub color_weight: f32,
    /// Optimiser steps.
    pub steps: Option<u64>,
    /// Clouds per step.
    pub clouds: Option<usize>,
    /// Points per cloud and step, or all that a cloud has.
    pub points: Option<usize>,
    /// Operand type of the network's matrix products; the fastest by default.
    pub precision: Option<Precision>,
    /// How gradients move the weights; a rate in it is that of the preset's learning rate, and follows it in proportion.
    pub optimizer: Option<Optimizer>,
    /// Learning rate after warm-up.
    pub learning_rate: Option<f64>,
    /// Steps of warm-up, at most a tenth of all.
    pub warmup_steps: Option<u64>,
    /// Steps between validations.
    pub validate_every: Option<u64>,
    /// Validations without a better one after which the run ends; `None` takes all steps.
    pub patience: Option<u64>,
    /// How noise is coupled to the points of a cloud.
    pub coupling: Coupling,
    /// Flow times are Beta(`time_exponent`, 1).
    pub time_exponent: f32,
    /// Share of flow times near the data ([`FlowPath::late_times`]).
    pub late_times: Option<f32>,
    /// Where the prior is cut, in its deviations ([`FlowPath::prior_cut`]); 0 for nowhere.
    pub prior_cut: Option<f32>,
    /// Steps of the refinement, at most a third of all; 0 for none. By default the preset's, and none where the flow starts from a
    /// surface.
    pub refinement_steps: Option<u64>,
    /// Residual blocks of the condition ([`MlpShape::condition_blocks`](tdcr_learn::net::MlpShape::condition_blocks)).
    pub condition_blocks: Option<usize>,
    /// Octaves of the positions' Fourier features ([`MlpShape::octaves`](tdcr_learn::net::MlpShape::octaves)).
    pub octaves: Option<usize>,
    /// What the network sees of the flow time.
    pub time_features: Option<TimeFeatures>,
    /// The robot whose simulated surface the flow starts from; noise alone without it.
    pub surface_prior: Option<RobotSpec>,
    /// Whether it learns representatives of symmetric conditions.
    pub symmetry: Option<SymmetryUse>,
    /// Standard deviation of the noise that the flow starts from, or of that about the surface, in normalised units.
    pub prior_deviation: Option<f32>,
    /// Seed of weights, noise and subsets.
    pub seed: u64,
}

/// An MLP by the default preset.
impl Default for TrainPlan {
    fn default() -> Self {
        let path = FlowPath::default();
        Self {
            preset: Preset::default(),
            width: None,
            depth: None,
            embedding: None,
            context: None,
            channels: None,
            color_weight: TrainSettings::default().color_weight,
            steps: None,
            clouds: None,
            points: None,
            precision: None,
            optimizer: None,
            learning_rate: None,
            warmup_steps: None,
            validate_every: None,
            patience: None,
            coupling: path.coupling,
            time_exponent: path.time_exponent,
            late_times: None,
            prior_cut: None,
            refinement_steps: None,
            condition_blocks: None,
            octaves: None,
            time_features: None,
            surface_prior: None,
            symmetry: None,
            prior_deviation: None,
            seed: 0,
        }
    }
}

impl TrainPlan {
    /// Network and settings of a run on `data`.
    ///
    /// # Errors
    /// [`TrainRunError::Endless`] where a preset's epochs are to be of a stream; [`PipelineError::Data`] where the training
    /// set, of which epochs are, cannot be read.
    pub fn settle(
        &self,
        data: &TrainingData,
    ) -> Result<(NetworkSize, TrainSettings), PipelineError> {
        let default = self.preset.size;
        let size = NetworkSize {
            width: self.width.unwrap_or(default.width),
            depth: self.depth.unwrap_or(default.depth),
            embedding: self.embedding.unwrap_or(default.embedding),
            condition_blocks: self.condition_blocks.unwrap_or(default.condition_blocks),
            octaves: self.octaves.unwrap_or(default.octaves),
            time_features: self.time_features.unwrap_or(default.time_features),
            context: self.context,
            channels: self.channels.unwrap_or(default.channels),
        };
        let usual = self.preset.refinement;
        let preset = Preset {
            refinement: match (self.refinement_steps, &self.surface_prior) {
                (None, None) => usual,
                (None, Some(_)) | (Some(0), _) => None,
                (Some(steps), _) => Some(Refinement {
                    steps,
                    ..usual.unwrap_or_default()
                }),
            },
            length: self.steps.map_or(self.preset.length, Length::Steps),
            points: self.points.unwrap_or(self.preset.points),
            validate_every: self.validate_every.unwrap_or(self.preset.validate_every),
            symmetry: self.symmetry.unwrap_or(self.preset.symmetry),
            ..self.preset
        };
        let usual = self.preset.rates[usize::from(self.context.is_some())];
        let rates = Rates {
            clouds: self.clouds.unwrap_or(usual.clouds),
            learning_rate: self.learning_rate.unwrap_or(usual.learning_rate),
            warmup_steps: self.warmup_steps.unwrap_or(usual.warmup_steps),
        };
        let set = match (preset.length, data) {
            (Length::Steps(_), _) => 0,
            (Length::Epochs(_), TrainingData::Set(dir) | TrainingData::SetIn(dir, _)) => {
                DataSet::open(dir)?.samples(Split::Train)?.len()
            }
            (Length::Epochs(epochs), TrainingData::Stream(_)) => {
                return Err(TrainRunError::Endless {
                    preset: preset.name,
                    epochs,
                }
                .into());
            }
        };
        let optimizer = self.optimizer.unwrap_or(preset.optimizer);
        let settings = TrainSettings {
            seed: self.seed,
            precision: (self.precision).unwrap_or_else(|| Precision::fastest(size.width)),
            patience: self.patience,
            optimizer: optimizer.scaled(rates.learning_rate / usual.learning_rate),
            path: FlowPath {
                prior_deviation: self.prior_deviation.unwrap_or(match self.surface_prior {
                    None => FlowPath::default().prior_deviation,
                    Some(_) => Prior::SURFACE_DEVIATION,
                }),
                time_exponent: self.time_exponent,
                late_times: self.late_times.unwrap_or(match self.surface_prior {
                    None => preset.path.late_times,
                    Some(_) => FlowPath::PAPER.late_times,
                }),
                prior_cut: match self.prior_cut {
                    None => preset.path.prior_cut,
                    Some(0.0) => None,
                    cut => cut,
                },
                coupling: self.coupling,
            },
            prior: self.prior(data)?,
            color_weight: self.color_weight,
            ..preset.settings(rates, preset.length.steps(rates.clouds, set))
        };
        Ok((size, settings))
    }

    /// The prior, seen as the data set is: with or without the base, in voxels of the same size.
    fn prior(&self, data: &TrainingData) -> Result<Prior, PipelineError> {
        let Some(robot) = self.surface_prior.clone() else {
            return Ok(Prior::Gaussian);
        };
        let meta = match data {
            TrainingData::Set(dir) | TrainingData::SetIn(dir, _) => {
                DataSet::open(dir)?.meta().cloned()
            }
            TrainingData::Stream(_) => None,
        };
        let usual = Recipe::default();
        let (base, voxel_size) = match meta.map(|meta: Meta| meta.origin) {
            Some(Origin::Simulated { recipe, .. }) => (recipe.subject.base, recipe.voxel_size),
            Some(Origin::Recorded { recording }) => (recording.base, recording.voxel_size),
            _ => (usual.subject.base, usual.voxel_size),
        };
        let subject = Subject {
            robot,
            base,
            payload: None,
        };
        Ok(Prior::Surface(Box::new(Recipe {
            subject,
            voxel_size,
            sensor: None,
        })))
    }
}

/// How a prediction is asked to follow the flow; what is `None` is the model's own.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SamplerPlan {
    /// Integration method.
    pub method: Option<Method>,
    /// Number of steps; with a tolerance, the most.
    pub steps: Option<usize>,
    /// Exponent of the time grid.
    pub power: Option<f32>,
    /// Adaptive steps of this tolerance, in place of a grid.
    pub tolerance: Option<f32>,
    /// Flow time of the last denoising; 1 for none.
    pub denoise: Option<f32>,
    /// Share of points that are drawn beyond those asked for.
    pub spare: Option<f32>,
}

impl SamplerPlan {
    /// Most adaptive steps, where they are not said.
    pub const MOST_STEPS: usize = 200;

    /// The sampler for a model trained with `settings`.
    ///
    /// # Errors
    /// [`TrainRunError::Sampler`] for values that describe none, [`TrainRunError::OwnSampler`] where the model was distilled
    /// for another.
    pub fn settle(&self, settings: &TrainSettings) -> Result<Sampler, PipelineError> {
        let own = settings.sampler;
        let sampler = Sampler {
            method: self.method.unwrap_or(own.method),
            steps: match self.tolerance {
                None => self.steps.unwrap_or(own.steps),
                Some(_) => self.steps.unwrap_or(Self::MOST_STEPS),
            },
            grid: match (self.tolerance, self.power) {
                (Some(tolerance), _) => TimeGrid::Adaptive(tolerance),
                (None, Some(power)) => TimeGrid::Power(power),
                (None, None) => own.grid,
            },
            denoise: match self.denoise {
                None => own.denoise,
                Some(1.0) => None,
                denoise => denoise,
            },
            spare: self.spare.unwrap_or(own.spare),
            colors: own.colors,
        };
        sampler.check()?;
        match settings.target == Target::Velocity
            || (Sampler {
                spare: own.spare,
                ..sampler
            }) == own
        {
            true => Ok(sampler),
            false => Err(TrainRunError::OwnSampler {
                evaluations: own.evaluations(),
            }
            .into()),
        }
    }
}

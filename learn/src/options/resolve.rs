//! From options to a network and the settings of its training.

use tdcr_sim::formats::RobotFileError;
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::scene::Scene;
use thiserror::Error;

use super::{Net, Preset, TrainOptions};
use crate::data::{DataError, DataSet, Meta, ObstacleVariation, Origin, Recipe, Split, Subject};
use crate::flow::FlowPath;
use crate::net::{Channels, ContextShape, HybridShape, MlpShape, NetworkShape, Precision};
use crate::prior::Prior;
use crate::train::{Refinement, TrainSettings};

/// What a run's settings depend on beside its options.
#[derive(Clone, Debug, PartialEq)]
pub struct DataFacts {
    /// Clouds of the training set; `None` for a stream, which has no end.
    pub clouds: Option<usize>,
    /// Whether the clouds show the robot's base.
    pub base: BaseVisibility,
    /// Edge of the voxels that thinned the clouds (m).
    pub voxel_size: f64,
    /// Obstacles around the robot.
    pub scene: Scene,
    /// How far they are moved for each sample.
    pub obstacles: Option<ObstacleVariation>,
}

/// Of a stream that is seen as data sets are by default.
impl Default for DataFacts {
    fn default() -> Self {
        let usual = Recipe::default();
        Self {
            clouds: None,
            base: usual.subject.base,
            voxel_size: usual.voxel_size,
            scene: usual.subject.scene,
            obstacles: None,
        }
    }
}

impl DataFacts {
    /// Those of a data set.
    ///
    /// # Errors
    /// [`DataError`] where its training set cannot be read.
    pub fn of(set: &DataSet) -> Result<Self, DataError> {
        let clouds = Some(set.samples(Split::Train)?.len());
        let origin = set.meta().cloned().map(|meta: Meta| meta.origin);
        let (subject, voxel_size) = match origin {
            Some(Origin::Simulated { recipe, .. }) => (recipe.subject, recipe.voxel_size),
            Some(Origin::Recorded { recording }) => {
                let base = recording.base;
                (
                    Subject {
                        base,
                        ..Subject::default()
                    },
                    recording.voxel_size,
                )
            }
            _ => {
                return Ok(Self {
                    clouds,
                    ..Self::default()
                });
            }
        };
        Ok(Self {
            clouds,
            base: subject.base,
            voxel_size,
            scene: subject.scene,
            obstacles: subject.obstacles,
        })
    }
}

/// What a run's options come to.
#[derive(Clone, Debug, PartialEq)]
pub struct Resolved {
    /// Shape of the network, but for the dimension of its conditions, which is the data's.
    pub shape: NetworkShape,
    /// Settings of its training.
    pub settings: TrainSettings,
}

/// Why options describe no run.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum OptionsError {
    /// An option of the context network, where there is none.
    #[error("{option} is of a hybrid, the network is an mlp")]
    NoContext {
        /// Its name.
        option: &'static str,
    },
    /// Not a value for each of the context network's stages.
    #[error("{option} has {found} values, expected 3, one per stage")]
    Stages {
        /// Name of the option.
        option: &'static str,
        /// Number of its values.
        found: usize,
    },
    /// Epochs of a stream.
    #[error(
        "preset {} takes {} epochs of a data set, and a stream has no end",
        preset.name(),
        Preset::EPOCHS
    )]
    Endless {
        /// The preset.
        preset: Preset,
    },
    /// There is no such robot.
    #[error(transparent)]
    Robot(#[from] RobotFileError),
}

impl TrainOptions {
    /// Returns an error where options contradict each other, whatever the data are.
    ///
    /// # Errors
    /// [`OptionsError::NoContext`], [`OptionsError::Stages`].
    pub fn check(&self) -> Result<(), OptionsError> {
        self.context_shape().map(drop)
    }

    /// Whether colours are learned.
    pub fn learns_colors(&self) -> bool {
        let usual = self.preset.options(self.net).colors;
        !self.no_colors && self.colors.or(usual).unwrap_or_default()
    }

    /// Network and settings of a run on these data.
    ///
    /// Of what is not asked for: warm-up takes at most a tenth of the steps, the refinement a third of them, and Muon's own
    /// learning rate follows that of the run in proportion to the preset's. A flow that starts from a surface has less noise,
    /// no more times near the data than others, and no refinement.
    ///
    /// # Errors
    /// [`OptionsError`].
    pub fn resolve(&self, data: &DataFacts) -> Result<Resolved, OptionsError> {
        let usual = self.preset.options(self.net);
        let default = self.preset.settings();
        let shape = self.shape(&usual)?;
        let clouds = self.clouds.or(usual.clouds).unwrap_or(default.clouds);
        let steps = self.steps(&usual, clouds, data)?;
        let usual_rate = usual.learning_rate.unwrap_or(default.learning_rate);
        let learning_rate = self.learning_rate.unwrap_or(usual_rate);
        let optimizer = self.optimizer.or(usual.optimizer);
        let optimizer = optimizer.map_or(default.optimizer, |name| name.optimizer());
        let warmup = self.warmup.or(usual.warmup).unwrap_or(default.warmup_steps);
        let validate_every = self.validate_every.or(usual.validate_every);
        let settings = TrainSettings {
            steps,
            clouds,
            points: self.points.or(usual.points).unwrap_or(default.points),
            optimizer: optimizer.scaled(learning_rate / usual_rate),
            precision: (self.precision).unwrap_or_else(|| Precision::fastest(shape.width())),
            learning_rate,
            warmup_steps: warmup.min(steps / 10),
            path: self.path(&usual),
            prior: self.prior(data)?,
            symmetry: self.symmetry.or(usual.symmetry).unwrap_or(default.symmetry),
            color_weight: self.color_weight,
            seed: self.seed,
            validate_every: validate_every.unwrap_or(default.validate_every),
            refinement: self.refinement(&usual, steps),
            patience: self.patience,
            ..default
        };
        Ok(Resolved { shape, settings })
    }

    /// Shape of the network, with the preset's values for what is not asked for.
    fn shape(&self, usual: &Self) -> Result<NetworkShape, OptionsError> {
        let default = MlpShape::default();
        let head = MlpShape {
            width: self.width.or(usual.width).unwrap_or(default.width),
            depth: self.depth.or(usual.depth).unwrap_or(default.depth),
            embedding: (self.embedding.or(usual.embedding)).unwrap_or(default.embedding),
            condition_dim: default.condition_dim,
            condition_blocks: (self.condition_blocks.or(usual.condition_blocks))
                .unwrap_or(default.condition_blocks),
            octaves: self.octaves.or(usual.octaves).unwrap_or(default.octaves),
            time_features: (self.time_features.or(usual.time_features))
                .unwrap_or(default.time_features),
            channels: match self.learns_colors() {
                true => Channels::XyzRgb,
                false => Channels::Xyz,
            },
        };
        Ok(match self.context_shape()? {
            None => head.into(),
            Some(context) => HybridShape { head, context }.into(),
        })
    }

    /// Shape of the context network; none for an MLP, which has none.
    fn context_shape(&self) -> Result<Option<ContextShape>, OptionsError> {
        if self.net == Net::Mlp {
            let given = [
                ("layers", self.layers.is_some()),
                ("channels", self.channels.is_some()),
                ("resolutions", self.resolutions.is_some()),
                ("blocks", self.blocks.is_some()),
                ("context", self.context.is_some()),
            ];
            return match given.into_iter().find(|(_, given)| *given) {
                Some((option, _)) => Err(OptionsError::NoContext { option }),
                None => Ok(None),
            };
        }
        let usual = self.preset.options(self.net).layers;
        let mut shape = ContextShape::of(self.layers.or(usual).unwrap_or_default());
        for (stage, channels) in per_stage("channels", self.channels.as_deref())? {
            shape.stages[stage].channels = channels;
        }
        for (stage, resolution) in per_stage("resolutions", self.resolutions.as_deref())? {
            shape.stages[stage].resolution = resolution;
        }
        shape.blocks = self.blocks.unwrap_or(shape.blocks);
        shape.features = self.context.unwrap_or(shape.features);
        Ok(Some(shape))
    }

    /// Optimiser steps of a run with batches of `clouds` clouds.
    fn steps(&self, usual: &Self, clouds: usize, data: &DataFacts) -> Result<u64, OptionsError> {
        match (self.steps.or(usual.steps), data.clouds) {
            (Some(steps), _) => Ok(steps),
            (None, Some(set)) => Ok(Preset::EPOCHS * (set / clouds.max(1)).max(1) as u64),
            (None, None) => Err(OptionsError::Endless {
                preset: self.preset,
            }),
        }
    }

    /// Noise and flow times.
    fn path(&self, usual: &Self) -> FlowPath {
        let default = FlowPath::DEFAULT;
        let on_surface = self.surface_prior.is_some();
        let (deviation, late_times) = match on_surface {
            false => (default.prior_deviation, usual.late_times),
            true => (Prior::SURFACE_DEVIATION, Some(FlowPath::PAPER.late_times)),
        };
        FlowPath {
            prior_deviation: self.prior_deviation.unwrap_or(deviation),
            time_exponent: self.time_exponent,
            late_times: (self.late_times.or(late_times)).unwrap_or(default.late_times),
            prior_cut: (self.prior_cut.or(usual.prior_cut)).filter(|cut| *cut != 0.0),
            coupling: self.coupling,
        }
    }

    /// The prior, seen as the data are: with or without the base, in voxels of the same size.
    fn prior(&self, data: &DataFacts) -> Result<Prior, OptionsError> {
        let Some(robot) = &self.surface_prior else {
            return Ok(Prior::Gaussian);
        };
        let subject = Subject {
            robot: robot.load()?,
            base: data.base,
            payload: None,
            scene: data.scene.clone(),
            obstacles: data.obstacles,
        };
        Ok(Prior::Surface(Box::new(Recipe {
            subject,
            voxel_size: data.voxel_size,
            sensor: None,
        })))
    }

    /// The refinement of a run of so many steps.
    fn refinement(&self, usual: &Self, steps: u64) -> Option<Refinement> {
        let usual = usual
            .refinement_steps
            .filter(|_| self.surface_prior.is_none());
        let refinement = Refinement {
            steps: self.refinement_steps.or(usual)?,
            ..Refinement::DEFAULT
        };
        refinement.at_most(steps / 3)
    }
}

/// The values of an option, one per stage; none where it is not given.
fn per_stage(
    option: &'static str,
    values: Option<&[usize]>,
) -> Result<impl Iterator<Item = (usize, usize)>, OptionsError> {
    let values = values.unwrap_or_default();
    match values.len() {
        0 | 3 => Ok(values.iter().copied().enumerate()),
        found => Err(OptionsError::Stages { option, found }),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::net::ContextLayers;
    use crate::options::OptimizerName;
    use crate::train::Optimizer;

    fn resolved(options: TrainOptions) -> Resolved {
        let data = DataFacts {
            clouds: Some(8000),
            ..DataFacts::default()
        };
        options.resolve(&data).unwrap()
    }

    #[test]
    fn the_default_options_are_the_default_settings() {
        let Resolved { shape, settings } = resolved(TrainOptions::default());
        let refinement = Some(Refinement::DEFAULT);
        let precision = Precision::fastest(96);
        let expected = TrainSettings {
            refinement,
            precision,
            ..TrainSettings::default()
        };
        assert_eq!((shape, settings), (MlpShape::default().into(), expected));
    }

    #[test]
    fn what_a_preset_says_is_what_is_resolved_without_it() {
        for preset in Preset::ALL {
            for net in [Net::Mlp, Net::Hybrid] {
                let said = TrainOptions {
                    layers: preset.options(net).layers.filter(|_| net == Net::Hybrid),
                    ..preset.options(net)
                };
                let asked = TrainOptions {
                    preset,
                    net,
                    ..TrainOptions::default()
                };
                assert_eq!(resolved(said), resolved(asked), "{preset:?} {net:?}");
            }
        }
    }

    #[test]
    fn a_refinement_takes_a_third_of_the_steps_at_most() {
        let of = |steps, refinement_steps| {
            let options = TrainOptions {
                steps: Some(steps),
                refinement_steps,
                ..TrainOptions::default()
            };
            resolved(options).settings.refinement.map(|one| one.steps)
        };
        assert_eq!(of(60, None), Some(20));
        assert_eq!(of(2, None), None);
        assert_eq!(of(600, Some(0)), None);
        assert_eq!(of(600, Some(7)), Some(7));
    }

    #[test]
    fn an_epoch_is_as_many_batches_as_the_clouds_fill() {
        let steps = |clouds, set| {
            let options = TrainOptions {
                preset: Preset::Paper,
                clouds: Some(clouds),
                ..TrainOptions::default()
            };
            let facts = DataFacts {
                clouds: Some(set),
                ..DataFacts::default()
            };
            options.resolve(&facts).unwrap().settings.steps
        };
        assert_eq!(steps(8, 8000), 500_000);
        assert_eq!(steps(8, 17), 1000);
        assert_eq!(steps(8, 7), 500);
    }

    #[test]
    fn epochs_of_a_stream_are_refused() {
        let paper = TrainOptions {
            preset: Preset::Paper,
            ..TrainOptions::default()
        };
        let error = paper.resolve(&DataFacts::default()).unwrap_err();
        assert!(error.to_string().contains("takes 500 epochs"), "{error}");
    }

    #[test]
    fn rates_follow_each_other() {
        let halved = TrainOptions {
            learning_rate: Some(1e-2),
            steps: Some(50),
            ..TrainOptions::default()
        };
        let settings = resolved(halved).settings;
        let muon = Optimizer::Muon {
            learning_rate: 1e-2,
        };
        assert_eq!((settings.optimizer, settings.warmup_steps), (muon, 5));
        let paper = TrainOptions {
            preset: Preset::Paper,
            optimizer: Some(OptimizerName::Muon),
            ..TrainOptions::default()
        };
        assert_eq!(resolved(paper).settings.optimizer, Optimizer::MUON);
    }

    #[test]
    fn a_surface_changes_the_noise_about_it() {
        let options = TrainOptions {
            surface_prior: Some("2m".to_owned().into()),
            ..TrainOptions::default()
        };
        let settings = resolved(options.clone()).settings;
        assert_eq!(settings.path.prior_deviation, Prior::SURFACE_DEVIATION);
        assert_eq!((settings.path.late_times, settings.refinement), (0.0, None));
        assert!(!settings.prior.is_gaussian());
        let asked = TrainOptions {
            late_times: Some(0.25),
            prior_cut: Some(0.0),
            refinement_steps: Some(9),
            ..options
        };
        let settings = resolved(asked).settings;
        assert_eq!(
            (settings.path.late_times, settings.path.prior_cut),
            (0.25, None)
        );
        assert_eq!(settings.refinement.map(|one| one.steps), Some(9));
    }

    #[test]
    fn options_of_the_context_are_a_hybrids() {
        let small = TrainOptions {
            channels: Some(vec![8, 16, 32]),
            blocks: Some(1),
            ..TrainOptions::default()
        };
        let error = small.check().unwrap_err();
        assert!(matches!(
            error,
            OptionsError::NoContext { option: "channels" }
        ));
        let hybrid = TrainOptions {
            net: Net::Hybrid,
            ..small
        };
        let NetworkShape::Hybrid(shape) = resolved(hybrid.clone()).shape else {
            panic!("not a hybrid")
        };
        let usual = ContextShape::of(ContextLayers::Residual);
        assert_eq!(
            shape.context.stages.map(|stage| stage.channels),
            [8, 16, 32]
        );
        assert_eq!(
            shape.context.stages.map(|stage| stage.resolution),
            usual.stages.map(|stage| stage.resolution)
        );
        assert_eq!(
            (shape.context.blocks, shape.context.features),
            (1, usual.features)
        );
        let short = TrainOptions {
            channels: Some(vec![8, 16]),
            ..hybrid
        };
        let error = short.check().unwrap_err();
        assert!(matches!(
            error,
            OptionsError::Stages {
                option: "channels",
                found: 2
            }
        ));
    }
}

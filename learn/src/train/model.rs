//! The predictor: a network with averaged weights, and the units of its inputs and outputs.

use std::path::Path;

use rand::Rng;
use serde::{Deserialize, Serialize};

use super::error::{FileError, FileProblem};
use super::format::{Kind, Reader, Writer, read};
use super::refined::{Drawn, Refined};
use super::settings::TrainSettings;
use crate::channels::{Channels, DIM};
use crate::data::{Normalisation, Subject};
use crate::flow::{Reach, Sampler, Stream, rng};
use crate::net::{Network, NetworkShape, NetworkShapeError, Precision};
use crate::predict::{PredictError, Prediction};
use crate::prior::{Prior, SurfaceError, SurfacePrior, start_from};
use crate::symmetry::{Reduced, Reduction};

/// What a network was trained on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Robot, base and payloads; `None` where the data set does not say.
    pub subject: Option<Subject>,
    /// The data set's normalisation.
    pub normalisation: Normalisation,
    /// How its conditions and clouds are reduced, before normalisation, to one representative of each class; not in older
    /// files, which do not say.
    #[serde(default, skip_serializing_if = "Reduction::is_trivial")]
    pub reduction: Reduction,
}

/// A trained shape predictor.
#[derive(Clone, Debug)]
pub struct Model {
    /// What it was trained on.
    pub provenance: Provenance,
    /// How it was trained.
    pub settings: TrainSettings,
    /// Step at which its weights were taken.
    pub step: u64,
    /// Their mean Chamfer distance in validation, in normalised units squared; times `s^2` for m^2.
    pub validation_distance: f64,
    /// The network, with averaged weights.
    pub network: Network,
    /// The network that takes its place in the last denoising, where one was learned ([`TrainSettings::refinement`]), or lent by a
    /// teacher that has one.
    pub refinement: Option<Network>,
    /// Where the clouds are that it was trained on: its velocities point there. `None` in older files, which do not say, and of
    /// distilled networks.
    pub reach: Option<Reach>,
    /// What the spread of its clouds is multiplied by, so that twice their uncertainty covers 95 % of the points of commands that
    /// it was not trained on ([`Model::calibrated`]); `None` in older files, and in models of an unfinished run.
    pub uncertainty_factor: Option<f32>,
}

/// A model's header on disk.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    provenance: Provenance,
    shape: NetworkShape,
    settings: TrainSettings,
    step: u64,
    validation_distance: f64,
    /// Whether there is a network of the last denoising.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    refined: bool,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    reach: Option<Reach>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    uncertainty_factor: Option<f32>,
}

/// What precedes the names of the tensors of the last denoising's network.
const REFINEMENT: &str = "refinement.";

impl Model {
    /// A cloud of `points` points (m, world frame) for `command` `(D)` in physical units; where the data had payloads,
    /// its last value is the payload (kg).
    ///
    /// Predicted colours are clamped to [0, 1] before they are rounded to 8 bits. The noise that the cloud starts
    /// from is a function of `seed`. Where the sampler draws spare points, [`select`](crate::predict::select) says which are left out, and evens the others out. A
    /// refined model, whose sampler denoises at the time of the refinement, corrects the points by one more evaluation. Commands
    /// outside the training range are extrapolated, without any guarantee.
    ///
    /// # Errors
    /// [`PredictError`] where the command has another length than the model's or holds a NaN or an infinity, and where
    /// the network's cloud does, as that of weights or a scale near the largest numbers may.
    pub fn predict(
        &self,
        command: &[f64],
        points: usize,
        seed: u64,
        sampler: &Sampler,
    ) -> Result<Prediction, PredictError> {
        let Provenance {
            normalisation,
            reduction,
            ..
        } = &self.provenance;
        let reduced = reduction.reduce(command, normalisation)?;
        self.predict_reduced(command, &reduced, points, seed, sampler)
    }

    /// Clouds for several commands near one another, as by [`predict`](Self::predict), which are alike point by point: all start from the
    /// same noise, and are reduced by the symmetry of the first command. Their differences are those of the robot's surface.
    ///
    /// # Errors
    /// As [`predict`](Self::predict).
    pub fn predict_alike(
        &self,
        commands: &[Vec<f64>],
        points: usize,
        seed: u64,
        sampler: &Sampler,
    ) -> Result<Vec<Prediction>, PredictError> {
        let Some(first) = commands.first() else {
            return Ok(Vec::new());
        };
        let Provenance {
            normalisation,
            reduction,
            ..
        } = &self.provenance;
        let symmetry = reduction.reduce(first, normalisation)?.symmetry;
        let predict = |command: &Vec<f64>| {
            let reduced = reduction.reduce_by(symmetry, command, normalisation)?;
            self.predict_reduced(command, &reduced, points, seed, sampler)
        };
        commands.iter().map(predict).collect()
    }

    fn predict_reduced(
        &self,
        command: &[f64],
        reduced: &Reduced<'_>,
        points: usize,
        seed: u64,
        sampler: &Sampler,
    ) -> Result<Prediction, PredictError> {
        let Provenance {
            normalisation,
            reduction,
            ..
        } = &self.provenance;
        // The network knows one representative of each class of commands: its cloud is moved back.
        if let Some(index) = command.iter().position(|value| !value.is_finite()) {
            return Err(PredictError::NotFinite {
                index,
                found: command[index],
            });
        }
        let channels = self.network.shape().channels();
        let drawn = sampler.drawn(points);
        let mut rows = vec![0.0; drawn * channels.count()];
        let rng = &mut rng(seed, Stream::Sample(0));
        let surface = self.surface(&reduced.values, drawn, rng)?;
        self.settings.path.sample_prior(rng, channels, &mut rows);
        if let Some(surface) = surface {
            let all: Vec<_> = (0..drawn).collect();
            start_from(&surface, &all, channels, &mut rows);
        }
        // Selected of the representative, so that clouds of commands that are alike are so point by point.
        let Drawn {
            mut positions,
            kept,
            evaluations,
        } = (self.field()).draw(sampler, &reduced.condition, &mut rows, points);
        let components = positions.as_flattened_mut();
        normalisation.denormalise_points(components);
        if !reduction.is_trivial() {
            reduced.symmetry.inverse().move_points(&mut positions, 1.0);
        }
        self.require_cloud(command, &positions, &rows)?;
        let prediction = Prediction {
            points: positions,
            colors: colors(&rows, channels),
            evaluations,
            uncertainty_factor: self.uncertainty_factor,
        };
        Ok(prediction.keep(&kept))
    }

    /// How many evaluations of a network its own sampler takes, of adaptive steps at most: with the correction of a refined model.
    pub fn evaluations(&self) -> usize {
        let sampler = &self.settings.sampler;
        let corrected = sampler.denoise.is_some() && self.refinement.is_some();
        sampler.evaluations() + usize::from(corrected)
    }

    /// The velocities that a prediction follows. The network of the last denoising is used at the time that it was learned for; at
    /// others, the network itself.
    pub(super) fn field(&self) -> Refined<'_> {
        Refined {
            flow: &self.network,
            last: (self.settings.sampler.denoise).zip(self.refinement.as_ref()),
            reach: self.reach,
        }
    }

    /// Points of the simulated surface under `command`, in normalised units, where the flow starts from one.
    fn surface(
        &self,
        command: &[f64],
        points: usize,
        rng: &mut impl Rng,
    ) -> Result<Option<Vec<f32>>, PredictError> {
        let Prior::Surface(recipe) = &self.settings.prior else {
            return Ok(None);
        };
        let prior = SurfacePrior::new(recipe).map_err(SurfaceError::from)?;
        let mut surface = prior.points(command, points, rng)?;
        self.provenance.normalisation.normalise_points(&mut surface);
        Ok(Some(surface))
    }

    /// Returns an error if the `points` (m) of a cloud, or its `rows` as the network gives them, are not finite.
    fn require_cloud(
        &self,
        command: &[f64],
        points: &[[f32; DIM]],
        rows: &[f32],
    ) -> Result<(), PredictError> {
        const NAMES: [&str; 6] = ["x", "y", "z", "red", "green", "blue"];
        let count = self.network.shape().channels().count();
        // Colours are bounded when they become bytes: only the rows tell.
        let in_metres = points.iter().enumerate().flat_map(|(k, point)| {
            point
                .iter()
                .enumerate()
                .map(move |(c, value)| (k, c, *value))
        });
        let in_rows = rows
            .iter()
            .enumerate()
            .map(|(k, value)| (k / count, k % count, *value));
        let wrong = in_metres
            .chain(in_rows)
            .find(|(.., value)| !value.is_finite());
        let Some((point, channel, value)) = wrong else {
            return Ok(());
        };
        let params = self.network.params();
        let largest = |range: &std::ops::Range<usize>| {
            let weights = params[range.clone()].iter().map(|weight| weight.abs());
            weights.fold(0.0, f32::max)
        };
        let tensors = self.network.shape().tensors().into_iter();
        let tensors = tensors.map(|tensor| (largest(&tensor.range), tensor.name));
        let (weight, tensor) = tensors
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .expect("a network has tensors");
        Err(PredictError::NoCloud {
            command: command.to_vec(),
            point,
            channel: NAMES[channel],
            found: value,
            tensor,
            weight,
            scale: self.provenance.normalisation.scale,
        })
    }

    /// The same model with another operand type; a model that is read has [`Precision::Float32`].
    ///
    /// # Errors
    /// [`NetworkShapeError::Precision`] where the network's width does not suit it.
    pub fn with_precision(self, precision: Precision) -> Result<Self, NetworkShapeError> {
        let refinement = self.refinement;
        let refinement = refinement.map(|network| network.with_precision(precision));
        Ok(Self {
            network: self.network.with_precision(precision)?,
            refinement: refinement.transpose()?,
            ..self
        })
    }

    /// Writes the model to `path`, in one step.
    pub fn save(&self, path: &Path) -> Result<(), FileError> {
        let mut writer = Writer::new(Kind::Model);
        put_params(&mut writer, "", self.network.shape(), self.network.params());
        if let Some(last) = &self.refinement {
            put_params(&mut writer, REFINEMENT, last.shape(), last.params());
        }
        let header = Header {
            provenance: self.provenance.clone(),
            shape: self.network.shape(),
            settings: self.settings.clone(),
            step: self.step,
            validation_distance: self.validation_distance,
            refined: self.refinement.is_some(),
            reach: self.reach,
            uncertainty_factor: self.uncertainty_factor,
        };
        writer.write(path, &header)
    }

    /// Reads a model.
    ///
    /// # Errors
    /// [`FileError`] where the file cannot be read, or is anything but a whole, finite and consistent model.
    pub fn load(path: &Path) -> Result<Self, FileError> {
        read(path, Kind::Model, |header: Header, reader| {
            check_header(&header.provenance, &header.shape, &header.settings)?;
            let reach = header.reach.map_or(Ok(()), |reach| reach.check());
            reach.map_err(FileProblem::header)?;
            if let Some(factor) = header.uncertainty_factor
                && !(factor.is_finite() && factor >= 0.0)
            {
                let problem = format!("uncertainty_factor is {factor}, expected 0 or more");
                return Err(FileProblem::header(problem));
            }
            let mut network = |prefix| {
                let params = take_params(reader, prefix, header.shape)?;
                Network::from_params(header.shape, params).map_err(FileProblem::header)
            };
            let refinement = header.refined.then(|| network(REFINEMENT)).transpose()?;
            let network = network("")?;
            Ok(Self {
                provenance: header.provenance,
                settings: header.settings,
                step: header.step,
                validation_distance: header.validation_distance,
                network,
                refinement,
                reach: header.reach,
                uncertainty_factor: header.uncertainty_factor,
            })
        })
    }
}

/// The colours in `rows` `(N, C)`, 8-bit, if there are any.
fn colors(rows: &[f32], channels: Channels) -> Option<Vec<[u8; 3]>> {
    // Casts saturate: what is out of [0, 1] becomes the nearest colour.
    let byte = |channel: f32| (255.0 * channel).round() as u8;
    let colors = rows.chunks_exact(channels.count());
    let colors = colors.map(|row| [row[DIM], row[DIM + 1], row[DIM + 2]].map(byte));
    (channels == Channels::XyzRgb).then(|| colors.collect())
}

/// Returns an error for headers that do not describe a network.
pub(super) fn check_header(
    provenance: &Provenance,
    shape: &NetworkShape,
    settings: &TrainSettings,
) -> Result<(), FileProblem> {
    shape.check().map_err(FileProblem::header)?;
    settings.check().map_err(FileProblem::header)?;
    let normalisation = &provenance.normalisation;
    let motors = [&normalisation.motor_min, &normalisation.motor_max].map(Vec::len);
    (provenance.reduction.check(motors[0])).map_err(FileProblem::header)?;
    let views = provenance.reduction.view_numbers();
    if motors[0] != motors[1] || motors[0] + views != shape.condition_dim() {
        return Err(FileProblem::header(format!(
            "{} minima and {} maxima of the motors, expected {} each",
            motors[0],
            motors[1],
            shape.condition_dim().saturating_sub(views)
        )));
    }
    normalisation.check_motors().map_err(FileProblem::header)?;
    normalisation.check_scale().map_err(FileProblem::header)
}

/// Adds a flat parameter vector as its tensors, their names after `prefix`.
pub(super) fn put_params(writer: &mut Writer, prefix: &str, shape: NetworkShape, params: &[f32]) {
    for tensor in shape.tensors() {
        writer.put(
            format!("{prefix}{}", tensor.name),
            &tensor.shape,
            &params[tensor.range],
        );
    }
}

/// The flat parameter vector that [`put_params`] added.
pub(super) fn take_params(
    reader: &mut Reader,
    prefix: &str,
    shape: NetworkShape,
) -> Result<Vec<f32>, FileProblem> {
    let mut params = Vec::new();
    for tensor in shape.tensors() {
        reader.take(
            &format!("{prefix}{}", tensor.name),
            &tensor.shape,
            &mut params,
        )?;
    }
    Ok(params)
}

//! What predicts: averaged weights, and what their numbers mean.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::error::{FileError, FileProblem};
use super::format::{Kind, Reader, Writer, read};
use super::settings::TrainSettings;
use crate::data::{DataError, Normalisation, Subject};
use crate::flow::{Sampler, Stream, rng};
use crate::net::{Channels, DIM, Network, NetworkShape};

/// What a network was trained on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Robot, base and payloads; `None` where the data set does not say.
    pub subject: Option<Subject>,
    /// The data set's normalisation.
    pub normalisation: Normalisation,
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
}

/// A command that no cloud can be predicted for.
#[derive(Debug, thiserror::Error)]
pub enum PredictError {
    /// Another number of values than the model was trained with.
    #[error(transparent)]
    Length(#[from] DataError),
    /// A value is NaN or infinite.
    #[error("value {index} of the command is {value}, expected a finite number")]
    NotFinite {
        /// Where in the command.
        index: usize,
        /// What stands there.
        value: f64,
    },
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
}

impl Model {
    /// A cloud of `points` points (m, world frame) for `command` `(D)` in physical units; where the data had payloads,
    /// its last value is the payload (kg).
    ///
    /// The noise that the cloud starts from is a function of `seed`. Commands outside the training range are
    /// extrapolated, without warrant.
    ///
    /// # Errors
    /// [`PredictError`] where the command has another length than the model's or holds a NaN or an infinity.
    pub fn predict(
        &self,
        command: &[f64],
        points: usize,
        seed: u64,
        sampler: &Sampler,
    ) -> Result<Vec<[f32; 3]>, PredictError> {
        let condition = self.provenance.normalisation.condition(command)?;
        if let Some(index) = command.iter().position(|value| !value.is_finite()) {
            return Err(PredictError::NotFinite {
                index,
                value: command[index],
            });
        }
        let mut cloud = vec![[0.0; DIM]; points];
        let components = cloud.as_flattened_mut();
        self.settings
            .path
            .sample_prior(&mut rng(seed, Stream::Sample(0)), components);
        sampler.integrate(&self.network, &condition, components);
        self.provenance.normalisation.denormalise_points(components);
        Ok(cloud)
    }

    /// Writes the model to `path`, in one step.
    pub fn save(&self, path: &Path) -> Result<(), FileError> {
        let mut writer = Writer::new(Kind::Model);
        put_params(&mut writer, "", self.network.shape(), self.network.params());
        let header = Header {
            provenance: self.provenance.clone(),
            shape: self.network.shape(),
            settings: self.settings.clone(),
            step: self.step,
            validation_distance: self.validation_distance,
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
            let params = take_params(reader, "", header.shape)?;
            let network =
                Network::from_params(header.shape, params).map_err(FileProblem::header)?;
            Ok(Self {
                provenance: header.provenance,
                settings: header.settings,
                step: header.step,
                validation_distance: header.validation_distance,
                network,
            })
        })
    }
}

/// Refuses headers of which no network can be made.
pub(super) fn check_header(
    provenance: &Provenance,
    shape: &NetworkShape,
    settings: &TrainSettings,
) -> Result<(), FileProblem> {
    shape.check().map_err(FileProblem::header)?;
    settings.check().map_err(FileProblem::header)?;
    if shape.channels() != Channels::Xyz {
        return Err(FileProblem::header(
            "a network of points with colours, expected positions alone",
        ));
    }
    let normalisation = &provenance.normalisation;
    let motors = [&normalisation.motor_min, &normalisation.motor_max].map(Vec::len);
    if motors != [shape.condition_dim(); 2] {
        return Err(FileProblem::header(format!(
            "{} minima and {} maxima of the motors, expected {} each",
            motors[0],
            motors[1],
            shape.condition_dim()
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

//! A whole training run on disk.

use std::path::Path;

use serde::{Deserialize, Serialize};
use tdcr_base::hash::hash;

use super::error::{FileError, FileProblem};
use super::format::{Element, Kind, Reader, Writer, read};
use super::model::{Provenance, check_header, put_params, take_params};
use super::settings::{Target, TrainSettings};
use super::start;
use crate::data::CloudSet;
use crate::net::{Network, NetworkShape};

/// The averaged weights with the smallest validation distance so far.
#[derive(Clone, Debug, PartialEq)]
pub struct Best {
    /// Step at which they were validated.
    pub step: u64,
    /// Mean distance of the validation, in normalised units squared.
    pub distance: f64,
    /// The weights, in the order of [`NetworkShape::tensors`].
    pub params: Vec<f32>,
}

/// Everything that a run needs to be resumed as if it had never stopped.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingState {
    /// What the network is trained on.
    pub provenance: Provenance,
    /// Shape of the network.
    pub shape: NetworkShape,
    /// Settings of the run.
    pub settings: TrainSettings,
    /// Fingerprints of the training and the validation set ([`fingerprint`]).
    pub(super) data: [u64; 2],
    /// Fingerprint of the network that the run started from; `None` if it started from random weights.
    pub(super) initial: Option<u64>,
    /// Steps taken.
    pub step: u64,
    /// Weights, in the order of [`NetworkShape::tensors`], as all vectors below.
    pub params: Vec<f32>,
    /// Running average of the weights.
    pub average: Vec<f32>,
    /// Adam's first moment.
    pub first_moment: Vec<f32>,
    /// Adam's second moment.
    pub second_moment: Vec<f32>,
    /// The best average so far; none before the first validation.
    pub best: Option<Best>,
    /// Loss of every step taken.
    pub losses: Vec<f32>,
    /// Norm of the gradient of every step taken, before clipping.
    pub gradient_norms: Vec<f32>,
    /// Step and distance of every validation.
    pub validations: Vec<(u64, f64)>,
}

/// A state's header on disk.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    provenance: Provenance,
    shape: NetworkShape,
    settings: TrainSettings,
    data: [u64; 2],
    #[serde(default)]
    initial: Option<u64>,
    step: u64,
    validations: usize,
    best: Option<(u64, f64)>,
}

impl TrainingState {
    /// Writes the state to `path`, in one step.
    pub fn save(&self, path: &Path) -> Result<(), FileError> {
        let mut writer = Writer::new(Kind::TrainingState);
        for (prefix, params) in [
            ("params.", &self.params),
            ("average.", &self.average),
            ("first_moment.", &self.first_moment),
            ("second_moment.", &self.second_moment),
        ] {
            put_params(&mut writer, prefix, self.shape, params);
        }
        if let Some(best) = &self.best {
            put_params(&mut writer, "best.", self.shape, &best.params);
        }
        let (steps, distances): (Vec<_>, Vec<_>) = self.validations.iter().copied().unzip();
        let norms = &self.gradient_norms;
        writer.put("losses", &[self.losses.len()], &self.losses);
        writer.put("gradient_norms", &[norms.len()], norms);
        writer.put("validations.step", &[steps.len()], &steps);
        writer.put("validations.distance", &[distances.len()], &distances);
        let header = Header {
            provenance: self.provenance.clone(),
            shape: self.shape,
            settings: self.settings.clone(),
            data: self.data,
            initial: self.initial,
            step: self.step,
            validations: self.validations.len(),
            best: self.best.as_ref().map(|best| (best.step, best.distance)),
        };
        writer.write(path, &header)
    }

    /// Whether the run started from the weights of `network`.
    pub fn starts_from(&self, network: &Network) -> bool {
        self.initial == Some(start::fingerprint(network))
    }

    /// Reads a state.
    ///
    /// # Errors
    /// [`FileError`] where the file cannot be read, or is anything but a whole, finite and consistent state.
    pub fn load(path: &Path) -> Result<Self, FileError> {
        read(path, Kind::TrainingState, |header: Header, reader| {
            check_header(&header.provenance, &header.shape, &header.settings)?;
            let taught = header.settings.target == Target::Steps;
            let mut params = |prefix| take_params(reader, prefix, header.shape);
            Ok(Self {
                params: params("params.")?,
                average: params("average.")?,
                first_moment: params("first_moment.")?,
                second_moment: params("second_moment.")?,
                best: match header.best {
                    None => None,
                    Some((step, distance)) => Some(Best {
                        step,
                        distance,
                        params: params("best.")?,
                    }),
                },
                losses: take_history(reader, "losses", header.step as usize)?,
                gradient_norms: take_history(reader, "gradient_norms", header.step as usize)?,
                validations: take_validations(reader, header.validations)?,
                provenance: header.provenance,
                shape: header.shape,
                settings: header.settings,
                data: header.data,
                // In older states, which do not say, only students started from a network: their teacher's.
                initial: header.initial.or(taught.then_some(header.data[0])),
                step: header.step,
            })
        })
    }
}

fn take_history<T: Element>(
    reader: &mut Reader,
    name: &str,
    len: usize,
) -> Result<Vec<T>, FileProblem> {
    let mut values = Vec::new();
    reader.take(name, &[len], &mut values)?;
    Ok(values)
}

fn take_validations(reader: &mut Reader, len: usize) -> Result<Vec<(u64, f64)>, FileProblem> {
    let steps = take_history(reader, "validations.step", len)?;
    let distances = take_history(reader, "validations.distance", len)?;
    Ok(steps.into_iter().zip(distances).collect())
}

/// A hash of all numbers of a set, to tell whether two sets are the same.
pub(super) fn fingerprint(set: &CloudSet) -> u64 {
    let sizes = [set.condition_dim as u32, set.points_per_cloud as u32];
    let numbers = set
        .conditions
        .iter()
        .chain(&set.points)
        .map(|x| x.to_bits());
    let colors = set.colors.iter().flatten().copied().map(u32::from);
    hash(sizes.into_iter().chain(numbers).chain(colors))
}

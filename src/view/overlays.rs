//! What is shown over a robot: clouds of a data set, a network's predictions, a recording, the rows of a study.

use std::path::Path;
use std::sync::Arc;

use serde::Serialize;
use tdcr_learn::data::{DataError, DataSet, Recipe, Sample, Split, SplitSamples};
use tdcr_learn::net::Precision;
use tdcr_learn::train::{FileError, Model};
use tdcr_sim::cloud::{Observer, VoxelGrid};
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::robot::{Robot, RobotSpec};
use tdcr_sim::scene::Scene;
use thiserror::Error;

use super::desk::RigLimits;
use super::recording::{Contents, Recording, RecordingError};
use crate::study::{Rows, StudyError};

/// What is shown over a robot.
#[derive(Clone, Debug, Default)]
pub struct Overlays {
    /// Clouds of a data set.
    pub clouds: Option<Arc<Clouds>>,
    /// A network.
    pub model: Option<Arc<Model>>,
    /// A log.
    pub log: Option<Arc<Recording>>,
    /// A study.
    pub study: Option<Arc<Rows>>,
}

/// Where overlays are read from.
#[derive(Clone, Copy, Debug, Default)]
pub struct OverlayFiles<'p> {
    /// Folder of a data set.
    pub data: Option<&'p Path>,
    /// File of a trained model.
    pub model: Option<&'p Path>,
    /// An MCAP file.
    pub log: Option<&'p Path>,
    /// Folder of a finished study.
    pub study: Option<&'p Path>,
}

/// Why an overlay is not there.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum OverlayError {
    /// No data set.
    #[error(transparent)]
    Data(#[from] DataError),
    /// No model.
    #[error(transparent)]
    Model(#[from] FileError),
    /// No recording.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// No study.
    #[error(transparent)]
    Study(#[from] StudyError),
}

/// The clouds of a data set, read one by one.
#[derive(Clone, Debug)]
pub struct Clouds {
    robot: Option<RobotSpec>,
    base: BaseVisibility,
    splits: Vec<(Split, SplitSamples)>,
}

/// What a page is told of all of it.
#[derive(Debug, Serialize)]
pub(super) struct OverlayList {
    data: Option<Vec<SplitSize>>,
    model: Option<ModelName>,
    log: Option<Contents>,
    study: Option<Scatter>,
    rig: Option<RigLimits>,
}

#[derive(Debug, Serialize)]
struct SplitSize {
    split: &'static str,
    samples: usize,
}

#[derive(Debug, Serialize)]
struct ModelName {
    /// The robot that it was trained on, where it says so.
    robot: Option<String>,
}

/// The rows of a study as points of a figure.
#[derive(Debug, Serialize)]
struct Scatter {
    title: String,
    columns: Vec<String>,
    /// Numbers of the rows.
    rows: Vec<usize>,
    /// A list for each row; `null` in an empty cell.
    values: Vec<Vec<Option<f64>>>,
}

impl Overlays {
    /// Reads what is named.
    ///
    /// # Errors
    /// [`OverlayError`] for the first that cannot be read.
    pub fn open(files: OverlayFiles<'_>) -> Result<Self, OverlayError> {
        Ok(Self {
            clouds: files.data.map(Clouds::open).transpose()?.map(Arc::new),
            model: files.model.map(model).transpose()?.map(Arc::new),
            log: files.log.map(Recording::open).transpose()?.map(Arc::new),
            study: files.study.map(Rows::open).transpose()?.map(Arc::new),
        })
    }

    /// The robot of the model, of the data set or of the study, in this order, where one says.
    pub fn robot(&self) -> Option<&RobotSpec> {
        let subject = (self.model.as_ref()).and_then(|model| model.provenance.subject.as_ref());
        let of_model = subject.map(|subject| &subject.robot);
        let of_data = || (self.clouds.as_ref()).and_then(|clouds| clouds.robot.as_ref());
        let of_study = || self.study.as_ref().map(|rows| &rows.study().robot);
        of_model.or_else(of_data).or_else(of_study)
    }

    pub(super) fn list(&self, rig: Option<RigLimits>) -> OverlayList {
        OverlayList {
            rig,
            data: self.clouds.as_ref().map(|clouds| clouds.sizes()),
            model: self.model.as_ref().map(|model| ModelName {
                robot: (model.provenance.subject.as_ref())
                    .map(|subject| subject.robot.name.clone()),
            }),
            log: self.log.as_ref().map(|log| log.contents()),
            study: self.study.as_ref().map(|rows| Scatter {
                title: rows.study().title.clone(),
                columns: rows.columns().iter().map(|column| column.title()).collect(),
                rows: rows.numbers().to_vec(),
                values: rows.values().to_vec(),
            }),
        }
    }
}

/// A model in the operand type that is fastest here.
fn model(path: &Path) -> Result<Model, FileError> {
    let model = Model::load(path)?;
    let precision = Precision::fastest(model.network.shape().width());
    // Whatever the fastest is, the network has it.
    Ok(model.clone().with_precision(precision).unwrap_or(model))
}

impl Clouds {
    /// The clouds of the data set in a folder.
    ///
    /// # Errors
    /// As [`DataSet::open`] and [`DataSet::samples`].
    pub fn open(dir: &Path) -> Result<Self, DataError> {
        let set = DataSet::open(dir)?;
        let splits = Split::ALL.into_iter();
        let splits = splits.map(|split| Ok((split, set.samples(split)?)));
        Ok(Self {
            robot: set.meta().and_then(|meta| meta.robot()).cloned(),
            base: (set.meta().and_then(|meta| meta.base())).unwrap_or(BaseVisibility::Hidden),
            splits: splits.collect::<Result<_, DataError>>()?,
        })
    }

    /// A sample of a split by its name; `None` for a name that no split has.
    pub(super) fn sample(&self, split: &str, index: usize) -> Option<Result<Sample, DataError>> {
        let (_, samples) = (self.splits.iter()).find(|(of, _)| of.folder() == split)?;
        match samples.read(index..index.saturating_add(1)) {
            Ok(read) => read.into_iter().next().map(Ok),
            Err(error) => Some(Err(error)),
        }
    }

    /// Cameras that see a robot as the set's clouds show it.
    pub(super) fn observer(&self, robot: &Robot, scene: &Scene) -> Observer {
        let grid = VoxelGrid::new(Recipe::default().voxel_size);
        Observer::new(robot, self.base, grid).among(scene)
    }

    fn sizes(&self) -> Vec<SplitSize> {
        let sizes = self.splits.iter().map(|(split, samples)| SplitSize {
            split: split.folder(),
            samples: samples.len(),
        });
        sizes.collect()
    }
}

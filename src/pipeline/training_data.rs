//! What a network is trained on.

use std::path::PathBuf;

use tdcr_learn::data::{DataError, DataSet, Normalisation, StreamSpec};
use tdcr_learn::options::DataFacts;

/// What a network is trained on.
#[derive(Clone, Debug, PartialEq)]
pub enum TrainingData {
    /// The data set in this folder.
    Set(PathBuf),
    /// The same in the units of another normalisation than its own, as those of the model that a run starts at.
    SetIn(PathBuf, Box<Normalisation>),
    /// Fresh samples of a simulated robot: no file in between.
    Stream(Box<StreamSettings>),
}

impl TrainingData {
    /// What settings depend on.
    ///
    /// # Errors
    /// [`DataError`] where the data set cannot be read.
    pub fn facts(&self) -> Result<DataFacts, DataError> {
        match self {
            Self::Set(dir) | Self::SetIn(dir, _) => DataFacts::of(&DataSet::open(dir)?),
            Self::Stream(stream) => {
                let subject = &stream.spec.recipe.subject;
                Ok(DataFacts {
                    scene: subject.scene.clone(),
                    obstacles: subject.obstacles,
                    ..DataFacts::default()
                })
            }
        }
    }
}

/// A stream of samples, and how a run uses them.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamSettings {
    /// What the samples are.
    pub spec: StreamSpec,
    /// Clouds that a step draws from: the newest.
    pub window: usize,
    /// Clouds that are replaced by new ones after each step.
    pub fresh: usize,
    /// Folder of a data set whose val split validates; else clouds of the stream that no step sees.
    pub validation: Option<PathBuf>,
}

/// Steps draw from the newest 512 clouds of the default stream, of which each replaces one: those of the command line.
impl Default for StreamSettings {
    fn default() -> Self {
        Self {
            spec: StreamSpec::default(),
            window: 512,
            fresh: 1,
            validation: None,
        }
    }
}

//! What is scored: a predictor, or clouds that were given.

use std::path::Path;
use std::sync::Arc;

use tdcr_learn::data::{Normalisation, PredictedClouds, Sample};
use tdcr_learn::flow::Sampler;
use tdcr_learn::predict::{About, Predictor, TrainingCost};
use tdcr_learn::prior::{Prior, SurfacePrior};
use tdcr_learn::train::{FlowPredictor, Model};

use super::measure::Extent;
use super::scores::RowKind;
use super::{EvalError, PipelineError};

/// How far a command beside a predicted cloud may be from the test command, as a part of the motor's range: what is lost
/// where commands are printed with a few digits, and far less than what tells commands apart.
const COMMAND_TOLERANCE: f32 = 1e-3;

/// What is scored: a model, any other predictor, or clouds that any program predicted.
///
/// One that is scored alone needs no name. Of several, each has one of its own: [`named`](Self::named).
pub struct ScoredMethod {
    pub(super) about: About,
    pub(super) clouds: Clouds,
    pub(super) extent: Extent,
    pub(super) kind: RowKind,
    /// Where it was read, which errors name.
    file: Option<String>,
    /// What it is compared with beside what every evaluation has.
    pub(super) beside: Option<Arc<dyn Predictor>>,
}

/// Where the clouds come from.
pub(super) enum Clouds {
    /// From the conditions.
    Predicted(Arc<dyn Predictor>),
    /// Given, one for each test command in the order of the test split. A predictor could not find them: two test commands may
    /// be the same.
    Given(PredictedClouds),
}

impl ScoredMethod {
    /// A predictor, under its own name.
    pub fn of_predictor(predictor: Arc<dyn Predictor>) -> Self {
        Self {
            kind: RowKind::Method,
            ..Self::baseline(predictor, Extent::All)
        }
    }

    /// The flow of `model` with `sampler`, under the name `network`; beside the simulator alone where it starts from a simulated
    /// surface.
    ///
    /// # Errors
    /// [`PipelineError`] where that surface cannot be simulated.
    pub fn of_model(model: Arc<Model>, sampler: Sampler) -> Result<Self, PipelineError> {
        let beside: Option<Arc<dyn Predictor>> = match &model.settings.prior {
            Prior::Surface(recipe) => Some(Arc::new(SurfacePrior::new(recipe)?)),
            _ => None,
        };
        Ok(Self {
            beside,
            ..Self::of_predictor(Arc::new(FlowPredictor::new(model, sampler)))
        })
    }

    /// Clouds that any program predicted for the test commands, in their order, under the name `predictions`.
    pub fn of_clouds(clouds: PredictedClouds) -> Self {
        Self {
            about: About {
                key: "predictions".to_owned(),
                name: "predictions".to_owned(),
                method: "clouds of another program".to_owned(),
                colors: clouds.colors.is_some(),
                training: TrainingCost {
                    processor_seconds: clouds.training_seconds,
                    ..TrainingCost::default()
                },
                prediction_seconds: clouds.prediction_seconds,
                ..About::default()
            },
            clouds: Clouds::Given(clouds),
            extent: Extent::All,
            kind: RowKind::Method,
            file: None,
            beside: None,
        }
    }

    /// What methods are compared with.
    pub(super) fn baseline(predictor: Arc<dyn Predictor>, extent: Extent) -> Self {
        Self {
            about: predictor.about(),
            clouds: Clouds::Predicted(predictor),
            extent,
            kind: RowKind::Baseline,
            file: None,
            beside: None,
        }
    }

    /// The same under another name, in tables and as the key of its row.
    #[must_use]
    pub fn named(mut self, name: &str) -> Self {
        name.clone_into(&mut self.about.key);
        name.clone_into(&mut self.about.name);
        self
    }

    /// The same, read in `file`, which errors name; clouds under the name that the file has for their method, or under the
    /// file's own.
    #[must_use]
    pub fn read_in(mut self, file: &Path) -> Self {
        self.file = Some(file.display().to_string());
        let said = match &self.clouds {
            Clouds::Given(clouds) => clouds.method.clone(),
            Clouds::Predicted(_) => return self,
        };
        let stem = || file.file_stem().map(|stem| stem.display().to_string());
        match said.or_else(stem) {
            Some(name) => self.named(&name),
            None => self,
        }
    }

    /// Its name in tables.
    pub fn name(&self) -> &str {
        &self.about.name
    }

    /// An error as one of this method.
    pub(super) fn refused(&self, source: PipelineError) -> PipelineError {
        let name = self.file.as_ref().unwrap_or(&self.about.name).clone();
        let source = Box::new(source);
        EvalError::OfMethod { name, source }.into()
    }
}

/// Refuses clouds that are not of the test commands: of those that are scored, `test`, or of more of the `whole` split.
pub(super) fn require_commands(
    clouds: &PredictedClouds,
    test: &[Sample],
    whole: usize,
    normalisation: &Normalisation,
) -> Result<(), PipelineError> {
    let (found, scored) = (clouds.points.len(), test.len());
    if !(scored..=whole).contains(&found) {
        return Err(EvalError::OtherClouds {
            found,
            scored,
            whole,
        }
        .into());
    }
    let commands = clouds.commands.iter().flatten();
    for (index, (command, sample)) in commands.zip(test).enumerate() {
        let truth = sample.condition.to_vec();
        let expected = normalisation.condition(&truth)?;
        let given: Vec<f64> = command.iter().map(|&value| value.into()).collect();
        let found = normalisation.condition(&given)?;
        let near = |(a, b): (&f32, &f32)| (a - b).abs() <= COMMAND_TOLERANCE;
        if !found.iter().zip(&expected).all(near) {
            return Err(EvalError::OtherCommand {
                index,
                found: given,
                expected: truth,
            }
            .into());
        }
    }
    Ok(())
}

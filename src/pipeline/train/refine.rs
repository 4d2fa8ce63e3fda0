//! What follows the steps of a run: the refinement of its last evaluation, and the factor of its uncertainty.

use std::path::{Path, PathBuf};

use tdcr_learn::data::CloudSet;
use tdcr_learn::train::{Feed, Model, Refiner, Start, TrainError, Trainer, TrainingState};

use super::{Run, state_path};
use crate::pipeline::log::RunLog;
use crate::pipeline::{PipelineError, TrainRunError};

/// The folder of a run's refinement, a run of its own.
fn refinement_path(run: &Path) -> PathBuf {
    run.join("refinement")
}

impl Run<'_> {
    /// `flow` with the network of its last evaluation, where there is to be one and its clouds are better in validation.
    pub(super) fn refine(
        &self,
        trainer: &mut Trainer,
        flow: Model,
        validation: &CloudSet,
    ) -> Result<Model, PipelineError> {
        let Some(settings) = flow.settings.refining() else {
            return Ok(flow);
        };
        let monitor = self.monitor;
        monitor.begin("predict to refine", trainer.clouds() as u64, 0);
        let made = || {
            monitor.advance(1);
            !monitor.interrupted()
        };
        let refiner = trainer.refiner(&flow, &made)?;
        let refiner = refiner.ok_or(PipelineError::Interrupted)?;
        monitor.end();
        let run = Run {
            folder: &refinement_path(self.folder),
            settings: &settings,
            monitor,
        };
        let last = run.last_evaluation(refiner, &flow, validation)?;
        let area = flow.provenance.normalisation.scale.powi(2);
        let told = |model: &Model| area * model.validation_distance;
        match last {
            Some(last) if last.validation_distance < flow.validation_distance => {
                monitor.note(&format!(
                    "refined: validation CD {:.3e} m², before {:.3e} m²",
                    told(&last),
                    told(&flow)
                ));
                Ok(Model {
                    validation_distance: last.validation_distance,
                    refinement: Some(last.network),
                    ..flow
                })
            }
            _ => {
                monitor.note(
                    "the refinement does not make the clouds of validation better, and is left out",
                );
                Ok(flow)
            }
        }
    }

    /// The network of the last evaluation of `flow`, learned in this run; `None` where that diverges.
    fn last_evaluation(
        &self,
        refiner: Refiner,
        flow: &Model,
        validation: &CloudSet,
    ) -> Result<Option<Model>, PipelineError> {
        let start = || Start::from(&flow.network);
        let feed = Feed::Refiner(Box::new(refiner));
        std::fs::create_dir_all(self.folder).map_err(|source| PipelineError::Write {
            path: self.folder.to_owned(),
            source,
        })?;
        let path = state_path(self.folder);
        // What was given more steps, or is to be refined otherwise, is refined anew.
        let of_flow = |state: &TrainingState| {
            state.starts_from(&flow.network) && state.settings == *self.settings
        };
        let state = match path.exists() {
            true => Some(TrainingState::load(&path)?).filter(of_flow),
            false => None,
        };
        let mut trainer = match state {
            Some(state) => {
                let resumed =
                    Trainer::resume(state, start(), self.settings.clone(), feed, validation);
                resumed.map_err(|source| TrainRunError::OtherRun { path, source })?
            }
            None => Trainer::new(start(), self.settings.clone(), feed, validation)?,
        };
        let provenance = &flow.provenance;
        let mut log = RunLog::open(self.folder, &trainer, provenance.normalisation.scale)?;
        self.monitor
            .begin("refine", self.settings.steps, trainer.steps_taken());
        // Alone, it is no model: it is saved with the state.
        let finished = self.finish(&mut trainer, &mut log, provenance, &|_| Ok(()));
        self.monitor.end();
        match finished {
            Err(PipelineError::Train(TrainRunError::Diverged(_))) => Ok(None),
            finished => finished.map(|()| trainer.model(provenance.clone())),
        }
    }

    /// The model with the factor of its uncertainty.
    pub(super) fn calibrate(
        &self,
        model: Model,
        validation: &CloudSet,
    ) -> Result<Model, PipelineError> {
        let monitor = self.monitor;
        monitor.begin(
            "validate the uncertainty",
            Model::calibration_clouds(validation) as u64,
            0,
        );
        let made = || {
            monitor.advance(1);
            !monitor.interrupted()
        };
        let precision = self.settings.precision;
        let precise = model.clone().with_precision(precision);
        let calibrated = (precise.map_err(TrainError::from)?).calibrated(validation, &made)?;
        let factor = calibrated
            .ok_or(PipelineError::Interrupted)?
            .uncertainty_factor;
        monitor.end();
        Ok(Model {
            uncertainty_factor: factor,
            ..model
        })
    }
}

/// The model at `path`, if it is `flow` with all that follows its training.
pub(super) fn completed(path: &Path, flow: &Model) -> Option<Model> {
    // One that cannot be read is made anew.
    let model = Model::load(path).ok()?;
    let same = model.step == flow.step
        && model.settings == flow.settings
        && model.provenance == flow.provenance
        && model.network.params() == flow.network.params();
    (same && model.uncertainty_factor.is_some()).then_some(model)
}

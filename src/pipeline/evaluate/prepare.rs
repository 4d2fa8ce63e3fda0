//! From methods and a data set to an evaluator: what fits, and on how many points all can be compared.

use std::path::Path;
use std::sync::Arc;

use tdcr_learn::data::{DataSet, Meta, PredictedClouds, Split};
use tdcr_learn::flow::Sampler;
use tdcr_learn::predict::{MeanCommand, NearestCommand, Predictor};
use tdcr_learn::train::Model;

use super::{Evaluator, REFERENCES};
use crate::pipeline::eval_settings::{EvalSettings, Scoring};
use crate::pipeline::measure::Extent;
use crate::pipeline::method::{Clouds, ScoredMethod, require_commands};
use crate::pipeline::simulation::Simulation;
use crate::pipeline::subject::require_same;
use crate::pipeline::{EvalError, PipelineError};

impl Evaluator {
    /// Prepares to test `predictor` on the data set in the folder `data`.
    ///
    /// # Errors
    /// [`PipelineError`] where the data set cannot be read, shows another subject than the predictor's (robot,
    /// base, payloads), or has fewer points per cloud than are to be compared.
    pub fn new(
        predictor: Arc<dyn Predictor>,
        data: &Path,
        settings: EvalSettings,
    ) -> Result<Self, PipelineError> {
        Self::of_methods(vec![ScoredMethod::of_predictor(predictor)], data, settings)
    }

    /// Prepares to score `model` with `sampler`, beside the simulator alone where its flow starts from a simulated surface.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn of_model(
        model: Arc<Model>,
        sampler: Sampler,
        data: &Path,
        settings: EvalSettings,
    ) -> Result<Self, PipelineError> {
        Self::of_methods(
            vec![ScoredMethod::of_model(model, sampler)?],
            data,
            settings,
        )
    }

    /// Prepares to score `clouds`, predicted by any program for the test commands of the data set in the folder `data`, in
    /// their order, or at least for those that are scored.
    ///
    /// # Errors
    /// [`PipelineError`] where the data set cannot be read, the clouds are of other commands, fewer than are scored or more than
    /// there are, or where there are fewer points than are to be compared.
    pub fn of_clouds(
        clouds: PredictedClouds,
        data: &Path,
        settings: EvalSettings,
    ) -> Result<Self, PipelineError> {
        Self::of_methods(vec![ScoredMethod::of_clouds(clouds)], data, settings)
    }

    /// Prepares to score methods beside each other on the data set in the folder `data`. All are compared on as many points; the
    /// scores of each are those that it has alone on as many.
    ///
    /// # Errors
    /// As [`new`](Self::new) and [`of_clouds`](Self::of_clouds), with the name of the method where there are several; for two of
    /// one name, and where there is none.
    pub fn of_methods(
        mut methods: Vec<ScoredMethod>,
        data: &Path,
        settings: EvalSettings,
    ) -> Result<Self, PipelineError> {
        if methods.is_empty() {
            return Err(EvalError::NoMethod.into());
        }
        let set = DataSet::open(data)?;
        let recipe = set.meta().and_then(|meta| meta.origin.recipe().cloned());
        let (training, mut test) = (set.cloud_set(Split::Train)?, set.read_split(Split::Test)?);
        let whole = test.len();
        set.require_some(Split::Test, whole)?;
        if let Some(found) = settings.tests {
            if !(1..=whole).contains(&found) {
                return Err(EvalError::ScoredTests { found, most: whole }.into());
            }
            test.truncate(found);
        }
        let points = training.points_per_cloud;
        let seen = test.iter().map(|sample| sample.cloud.len()).min();
        let mut available = seen.unwrap_or(0);
        let several = methods.len() > 1;
        for method in &methods {
            // The cloud of the nearest training command is compared by earth mover's distances alone.
            let check = || -> Result<usize, PipelineError> {
                if let (Some(subject), Some(recipe)) = (&method.about.subject, &recipe) {
                    require_same(subject, &recipe.subject)?;
                }
                let Clouds::Given(clouds) = &method.clouds else {
                    return Ok(available);
                };
                require_commands(clouds, &test, whole, set.normalisation())?;
                let scored = clouds.points.iter().take(test.len());
                let fewest = scored.map(Vec::len).min();
                let fewest = available.min(fewest.unwrap_or(0));
                Scoring::new(&settings, fewest, points)?;
                Ok(fewest)
            };
            available = check().map_err(|error| match several {
                true => method.refused(error),
                false => error,
            })?;
        }
        let scoring = Scoring::new(&settings, available, points)?;
        let mut colors = test.iter().flat_map(|sample| &sample.cloud.colors);
        let first = colors.next();
        let colored = colors.any(|color| Some(color) != first);
        let simulation = recipe
            .map(|recipe| Simulation::new(recipe, points))
            .transpose()?;
        let mean = simulation.as_ref().map(|Simulation { robot, recipe, .. }| {
            MeanCommand::new(robot, recipe, set.normalisation(), &training, settings.seed)
        });
        let mean = mean.transpose()?;
        let normalisation = set.normalisation().clone();
        let nearest = Arc::new(NearestCommand::new(training, normalisation)?);
        let added = methods.split_off(1);
        methods.push(ScoredMethod::baseline(nearest.clone(), Extent::Tip));
        methods.extend(mean.map(|mean| ScoredMethod::baseline(Arc::new(mean), Extent::Distances)));
        let mut evaluator = Self {
            standard: methods.len(),
            methods,
            nearest,
            scoring,
            asked: settings,
            test,
            colored,
            simulation,
            shown: set.meta().and_then(Meta::robot).cloned(),
        };
        let first = &evaluator.methods[0];
        let free = evaluator.require_free(&first.about.key, 1);
        free.map_err(|error| first.refused(error.into()))?;
        for method in added {
            let free = evaluator.require_free(&method.about.key, 0);
            free.map_err(|error| method.refused(error.into()))?;
            evaluator.methods.push(method);
        }
        let beside = evaluator.methods.iter().filter_map(|m| m.beside.clone());
        for predictor in beside.collect::<Vec<_>>() {
            // Two models from one surface are compared with it once.
            if evaluator.require_free(&predictor.about().key, 0).is_ok() {
                evaluator.compare(predictor)?;
            }
        }
        Ok(evaluator)
    }

    /// Adds a predictor that is scored beside what is evaluated. The scores of all other rows stay as they are without it.
    ///
    /// # Errors
    /// [`EvalError::SameKey`] where a row has its key already; as [`new`](Self::new) where it is of another subject.
    pub fn compare(&mut self, predictor: Arc<dyn Predictor>) -> Result<(), PipelineError> {
        let method = ScoredMethod::baseline(predictor, Extent::All);
        self.require_free(&method.about.key, 0)?;
        if let (Some(subject), Some(simulation)) = (&method.about.subject, &self.simulation) {
            require_same(subject, &simulation.recipe.subject)?;
        }
        self.methods.push(method);
        Ok(())
    }

    /// Refuses the key of another row, but for the first `own` rows.
    fn require_free(&self, key: &str, own: usize) -> Result<(), EvalError> {
        let references = REFERENCES.iter().map(|(key, _)| *key);
        let methods = self.methods.iter().skip(own);
        let mut keys = methods
            .map(|other| other.about.key.as_str())
            .chain(references);
        match keys.any(|other| other == key) {
            true => Err(EvalError::SameKey {
                key: key.to_owned(),
            }),
            false => Ok(()),
        }
    }
}

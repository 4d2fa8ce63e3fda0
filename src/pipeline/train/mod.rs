//! From a data set or a stream to a network.

mod refine;

use std::path::{Path, PathBuf};

use tdcr_learn::data::{CloudSet, Condition, DataSet, Meta, Normalisation, Recipe, Split};
use tdcr_learn::metrics::chamfer;
use tdcr_learn::net::{Channels, NetworkShape};
use tdcr_learn::prior::{Prior, SurfaceError, SurfacePrior};
use tdcr_learn::symmetry::Reduction;
use tdcr_learn::train::{
    Feed, FileError, Model, Provenance, Start, StreamWindow, Teacher, TrainError, TrainSettings,
    Trainer, TrainingState,
};

use refine::completed;

use super::log::RunLog;
use super::subject::require_same;
use super::symmetry::{reduced, reduction};
use super::training_data::{StreamSettings, TrainingData};
use super::{Divergence, Monitor, PipelineError, TrainRunError, lock_folder};

/// Steps between two words on the loss.
const STEPS_PER_STATUS: u64 = 10;

/// A finished training run.
#[derive(Clone, Debug)]
pub struct Trained {
    /// The network with the best validation distance.
    pub model: Model,
    /// Loss of every step.
    pub losses: Vec<f32>,
    /// Step and validation Chamfer distance (m²).
    pub validations: Vec<(u64, f64)>,
}

/// The model's file in a run's folder.
pub fn model_path(run: &Path) -> PathBuf {
    run.join("model.safetensors")
}

fn state_path(run: &Path) -> PathBuf {
    run.join("state.safetensors")
}

/// Trains a network of `shape`, with as many numbers of a condition as the data have, on `data`, keeping model, state and log in the
/// folder `run`. Its weights start at those of `initial`, at random ones without it.
///
/// When all steps are taken, the network's last evaluation is refined where `settings` say so (a run of its own, in the folder
/// `refinement` of `run`), and the factor of its uncertainty is found in validation.
///
/// The state is saved at every validation and at an interruption; a run that is resumed ends with
/// the network and the `log.csv` of an uninterrupted one, bit for bit. A state whose loss is above its running level is
/// not saved: when training diverges, the last good one is still there.
///
/// A run in the folder is given more steps where `settings` have more: it goes on from its state, with the learning rate's
/// schedule of the new length, so it does not end as one that was as long from the start
/// ([`TrainSettings::earlier`] in its model says so).
///
/// # Errors
/// [`PipelineError`]: a data set, an initial model or files that do not fit, a folder that another process works in or that
/// holds a model of another origin, training that diverges, or an interruption.
pub fn train(
    data: &TrainingData,
    run: &Path,
    shape: impl Into<NetworkShape>,
    settings: &TrainSettings,
    initial: Option<&Model>,
    monitor: &dyn Monitor,
) -> Result<Trained, PipelineError> {
    let run = Run {
        folder: run,
        settings,
        monitor,
    };
    let shape = shape.into();
    match data {
        TrainingData::Set(dir) => run.on_set(dir, None, shape, initial),
        TrainingData::SetIn(dir, units) => run.on_set(dir, Some(units), shape, initial),
        TrainingData::Stream(stream) => run.on_stream(stream, shape, initial),
    }
}

/// Trains `teacher`'s network to come from prior to data in the few steps of `settings.sampler`, keeping model, state and log
/// in the folder `run` as [`train`] does. `data` is a data set whose val split validates.
///
/// # Errors
/// As [`train`], and where the data set shows another subject, or the settings do not suit a [`Teacher`].
pub fn distill(
    teacher: &Model,
    data: &Path,
    run: &Path,
    settings: &TrainSettings,
    monitor: &dyn Monitor,
) -> Result<Trained, PipelineError> {
    let set = DataSet::open(data)?;
    let provenance = teacher.provenance.clone();
    let found = simulated(&set).map(|recipe| &recipe.subject);
    if let (Some(subject), Some(found)) = (&provenance.subject, found) {
        require_same(subject, found)?;
    }
    let channels = teacher.network.shape().channels();
    let (validation, _) = reduced(
        &set,
        Split::Val,
        &provenance.normalisation,
        channels,
        &provenance.reduction,
    )?;
    let precise = teacher.clone().with_precision(settings.precision);
    let precise = precise.map_err(TrainError::from)?;
    let training = Teacher::new(&precise).map_err(TrainError::from)?;
    let training = Feed::Teacher(Box::new(training));
    let start = Start::from(&teacher.network);
    let run = Run {
        folder: run,
        settings,
        monitor,
    };
    run.on(training, &validation, start, provenance)
}

/// A run: where it is kept, how it learns, who watches.
struct Run<'a> {
    folder: &'a Path,
    settings: &'a TrainSettings,
    monitor: &'a dyn Monitor,
}

impl Run<'_> {
    /// On the data set in the folder `dir`, in its own units or others.
    fn on_set(
        &self,
        dir: &Path,
        units: Option<&Normalisation>,
        shape: NetworkShape,
        initial: Option<&Model>,
    ) -> Result<Trained, PipelineError> {
        let set = DataSet::open(dir)?;
        let units = units.unwrap_or(set.normalisation());
        let recipe = simulated(&set);
        let reduction = self.reduction(recipe, shape.channels(), initial)?;
        let read = |split| -> Result<CloudSet, PipelineError> {
            let (clouds, conditions) = reduced(&set, split, units, shape.channels(), &reduction)?;
            let starts = self.starts(&clouds, &conditions, units)?;
            Ok(CloudSet { starts, ..clouds })
        };
        let (training, validation) = (read(Split::Train)?, read(Split::Val)?);
        let provenance = Provenance {
            subject: set.meta().and_then(Meta::subject),
            normalisation: units.clone(),
            reduction,
        };
        let start = start(
            initial,
            shape.with_condition_dim(training.condition_dim),
            &provenance,
            recipe,
        )?;
        self.on(Feed::from(&training), &validation, start, provenance)
    }

    /// How clouds of `recipe`, where they are simulated, are reduced.
    fn reduction(
        &self,
        recipe: Option<&Recipe>,
        channels: Channels,
        initial: Option<&Model>,
    ) -> Result<Reduction, PipelineError> {
        reduction(self.settings, recipe, channels, initial, self.monitor)
    }

    /// What the flow to each point of `clouds` under `conditions` starts from, where the prior is a surface.
    fn starts(
        &self,
        clouds: &CloudSet,
        conditions: &[Condition],
        units: &Normalisation,
    ) -> Result<Option<Vec<f32>>, PipelineError> {
        let Prior::Surface(recipe) = &self.settings.prior else {
            return Ok(None);
        };
        let prior = SurfacePrior::new(recipe)?;
        let monitor = self.monitor;
        monitor.begin("simulate the prior", conditions.len() as u64, 0);
        let made = || {
            monitor.advance(1);
            !monitor.interrupted()
        };
        let starts = prior.starts(clouds, conditions, units, self.settings.seed, &made);
        let starts = starts.map_err(|error| match error {
            SurfaceError::Interrupted => PipelineError::Interrupted,
            error => error.into(),
        })?;
        monitor.end();
        Ok(Some(starts))
    }

    /// On a stream.
    fn on_stream(
        &self,
        stream: &StreamSettings,
        shape: NetworkShape,
        initial: Option<&Model>,
    ) -> Result<Trained, PipelineError> {
        stream.spec.recipe.check()?;
        let window = StreamWindow::new(
            stream.spec.clone(),
            stream.window,
            stream.fresh,
            rayon::current_num_threads(),
            shape.channels(),
        )?;
        let recipe = &stream.spec.recipe;
        let reduction = self.reduction(Some(recipe), shape.channels(), initial)?;
        let window = window.with_reduction(reduction.clone());
        let subject = &recipe.subject;
        let validation = match &stream.validation {
            None => window.validation(self.settings.validation_clouds)?,
            Some(dir) => {
                let set = DataSet::open(dir)?;
                let found = simulated(&set).map(|recipe| &recipe.subject);
                found.map_or(Ok(()), |found| require_same(subject, found))?;
                let units = window.normalisation();
                reduced(&set, Split::Val, units, shape.channels(), &reduction)?.0
            }
        };
        let provenance = Provenance {
            subject: Some(subject.clone()),
            normalisation: window.normalisation().clone(),
            reduction,
        };
        let training = Feed::Stream(Box::new(window));
        let start = start(
            initial,
            shape.with_condition_dim(training.condition_dim()),
            &provenance,
            Some(recipe),
        )?;
        self.on(training, &validation, start, provenance)
    }

    /// On `training`, a network from its `start`; then its refinement, and the factor of its uncertainty.
    fn on(
        &self,
        training: Feed,
        validation: &CloudSet,
        start: Start,
        provenance: Provenance,
    ) -> Result<Trained, PipelineError> {
        let _lock = lock_folder(self.folder)?;
        // A validation looks at no cloud twice, and neither it nor a step at more points than a cloud has.
        let settings = TrainSettings {
            points: self.settings.points.min(training.points_per_cloud()),
            validation_clouds: self.settings.validation_clouds.min(validation.len()),
            validation_points: (self.settings.validation_points).min(validation.points_per_cloud),
            ..self.settings.clone()
        };
        let mut trainer = open(self.folder, start, &settings, training, validation)?;
        let scale = provenance.normalisation.scale;
        let mut log = RunLog::open(self.folder, &trainer, scale)?;
        if trainer.steps_taken() == 0 {
            // From here on the folder is this run's: a model without a state is another's.
            let state = trainer.state(provenance.clone());
            state.save(&state_path(self.folder))?;
        }
        let path = model_path(self.folder);
        if !trainer.is_finished() {
            let (steps, taken) = (settings.steps, trainer.steps_taken());
            self.monitor.begin("train", steps, taken);
            let grown = trainer.settings().earlier.last();
            if grown.is_some_and(|earlier| earlier.until == taken) {
                self.monitor.note(&format!(
                    "more steps than before: from here on the learning rate is that of a run of {steps}"
                ));
            }
            let save = |model: Model| model.save(&path);
            self.finish(&mut trainer, &mut log, &provenance, &save)?;
            self.monitor.end();
        }
        let flow = (trainer.model(provenance)).expect("the last step is validated");
        Ok(Trained {
            losses: trainer.losses().to_vec(),
            validations: (trainer.validations().iter())
                .map(|(step, distance)| (*step, distance * scale * scale))
                .collect(),
            model: match completed(&path, &flow) {
                Some(model) => model,
                None => {
                    let refined = self.refine(&mut trainer, flow, validation)?;
                    let model = self.calibrate(refined, validation)?;
                    model.save(&path)?;
                    model
                }
            },
        })
    }

    /// Takes the steps that are left.
    fn finish(
        &self,
        trainer: &mut Trainer,
        log: &mut RunLog,
        provenance: &Provenance,
        save: &dyn Fn(Model) -> Result<(), FileError>,
    ) -> Result<(), PipelineError> {
        let (model_path, state_path) = (model_path(self.folder), state_path(self.folder));
        let mut saved = (trainer.steps_taken() > 0).then_some(trainer.steps_taken());
        let mut due = false;
        while !trainer.is_finished() {
            let stepped = match step(trainer, provenance, self.monitor) {
                Err(source) if source.is_divergence() => {
                    let best = trainer.model(provenance.clone()).map(|model| model.step);
                    return Err(TrainRunError::Diverged(Box::new(Divergence {
                        source,
                        state: saved.map(|step| (state_path, step)),
                        model: best.map(|step| (model_path, step)),
                        target: trainer.settings().target,
                        learning_rate: trainer.settings().learning_rate,
                    }))
                    .into());
                }
                stepped => stepped?,
            };
            log.catch_up(trainer)?;
            let interrupted = self.monitor.interrupted();
            due |= stepped == Stepped::Validated || interrupted;
            if due && (trainer.is_level() || trainer.is_finished()) {
                if let Some(model) = trainer.model(provenance.clone()) {
                    save(model)?;
                }
                log.sync()?;
                trainer.state(provenance.clone()).save(&state_path)?;
                (saved, due) = (Some(trainer.steps_taken()), false);
            }
            if interrupted && !trainer.is_finished() {
                return Err(PipelineError::Interrupted);
            }
        }
        Ok(())
    }
}

/// How the clouds of a data set were simulated, where they were.
fn simulated(set: &DataSet) -> Option<&Recipe> {
    set.meta().and_then(|meta| meta.origin.recipe())
}

/// Where the weights of a network of `shape` start, that is trained on data of `provenance`, simulated by `recipe` or not.
fn start<'m>(
    initial: Option<&'m Model>,
    shape: NetworkShape,
    provenance: &Provenance,
    recipe: Option<&Recipe>,
) -> Result<Start<'m>, PipelineError> {
    let Some(model) = initial else {
        return Ok(shape.into());
    };
    // A model of the simulator may go on with a real robot's clouds.
    if let (Some(of_model), Some(recipe)) = (&model.provenance.subject, recipe) {
        require_same(of_model, &recipe.subject)?;
    }
    Ok(Start::at(model, shape, provenance)?)
}

/// The run in the folder `run`, or a new one where there is neither a state nor a model.
fn open<'a>(
    run: &Path,
    start: Start,
    settings: &TrainSettings,
    training: Feed<'a>,
    validation: &'a CloudSet,
) -> Result<Trainer<'a>, PipelineError> {
    let path = state_path(run);
    if !path.exists() {
        let path = model_path(run);
        if path.exists() {
            return Err(TrainRunError::ModelInTheWay { path }.into());
        }
        return Ok(Trainer::new(start, settings.clone(), training, validation)?);
    }
    let state = TrainingState::load(&path)?;
    let resumed = Trainer::resume(state, start, settings.clone(), training, validation);
    resumed.map_err(|source| TrainRunError::OtherRun { path, source }.into())
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Stepped {
    Plain,
    Validated,
}

/// Takes a step, and the validation that is due after it.
fn step(
    trainer: &mut Trainer,
    provenance: &Provenance,
    monitor: &dyn Monitor,
) -> Result<Stepped, TrainError> {
    let loss = trainer.step()?;
    monitor.advance(1);
    let area = provenance.normalisation.scale.powi(2);
    if trainer.validation_is_due() {
        let distance = |a: &[[f32; 3]], b: &[[f32; 3]]| chamfer(a, b).unwrap_or(f64::NAN);
        let distance = trainer.validate(&distance)?;
        monitor.note(&format!(
            "loss {loss:.3e}, validation CD {:.3e} m²",
            distance * area
        ));
        return Ok(Stepped::Validated);
    }
    if trainer.steps_taken().is_multiple_of(STEPS_PER_STATUS) {
        let validated = trainer.validations().last();
        let cd = validated.map_or(String::new(), |(_, distance)| {
            format!(", validation CD {:.3e} m²", distance * area)
        });
        monitor.status(&format!("loss {loss:.3e}{cd}"));
    }
    Ok(Stepped::Plain)
}

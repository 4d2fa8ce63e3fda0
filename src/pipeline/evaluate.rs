//! From a network to its scores, beside those of trivial predictors and the sampling floor.

use std::path::Path;

use rand::seq::index;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::json;
use tdcr_learn::data::{CloudSet, DataSet, Normalisation, PredictedClouds, Sample, Split, Subject};
use tdcr_learn::flow::Sampler;
use tdcr_learn::metrics::{
    MetricError, chamfer, color_error, emd, emd_squared, nearest_distances, rank_correlation,
};
use tdcr_learn::net::{Channels, Precision};
use tdcr_learn::train::{Model, Prediction, TrainError};
use tdcr_sim::robot::Robot;

use super::journal::Journal;
use super::scores::{Distances, Evaluation, Scores, TipError, UncertaintyScore};
use super::simulation::Simulation;
use super::tip::tip_error;
use super::{Monitor, PipelineError};

/// How a network is scored.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EvalSettings {
    /// Points of each cloud that the Chamfer distance is computed on.
    pub points: usize,
    /// Points of each cloud that the earth mover's distances are computed on, no more than `points`.
    pub emd_points: usize,
    /// Sampler of the predictions.
    pub sampler: Sampler,
    /// What numbers the network's products are of.
    pub precision: Precision,
    /// Seed of noise and subsets.
    pub seed: u64,
}

/// What an [`Entry`] in a journal means. Entries of another format are computed anew, though they may
/// parse: it changes with the fields of [`Scores`] and with how they are computed.
const JOURNAL_FORMAT: u32 = 10;

/// How far a command beside a predicted cloud may be from the test command, as a part of the motor's range: what is lost
/// where commands are printed with a few digits, and far less than what tells commands apart.
const COMMAND_TOLERANCE: f32 = 1e-3;

/// A finished piece of the evaluation.
#[derive(Serialize, Deserialize)]
struct Entry {
    index: usize,
    scores: Scores,
}

/// Clouds that are scored, and the data set that they are tested on.
pub struct Evaluator {
    predictor: Predictor,
    settings: EvalSettings,
    /// Training commands and clouds, in the units of the data set's `normalisation`, which is not the
    /// model's where that was trained on another set.
    training: CloudSet,
    normalisation: Normalisation,
    test: Vec<Sample>,
    /// Whether the test clouds have several colours between them.
    colored: bool,
    simulation: Option<Simulation>,
}

/// Where the clouds come from.
enum Predictor {
    /// A network, which predicts them when they are scored.
    Model(Box<Model>),
    /// Any program: one cloud for each test command.
    Clouds(PredictedClouds),
}

impl Evaluator {
    /// Prepares to test `model` on the data set in the folder `data`.
    ///
    /// # Errors
    /// [`PipelineError`] where the data set cannot be read, shows another subject than the model's (robot,
    /// base, payloads), or has fewer points per cloud than are to be compared, and where the network's width
    /// does not suit the precision.
    pub fn new(model: &Model, data: &Path, settings: EvalSettings) -> Result<Self, PipelineError> {
        let precise = (model.clone()).with_precision(settings.precision);
        let predictor = Predictor::Model(Box::new(precise.map_err(TrainError::from)?));
        let subject = model.provenance.subject.as_ref();
        Self::of(predictor, subject, data, settings)
    }

    /// Prepares to score `clouds`, predicted by any program for the test commands of the data set in the folder `data`, in
    /// their order. Of the settings, the sampler and the precision say nothing here.
    ///
    /// # Errors
    /// [`PipelineError`] where the data set cannot be read, has another number of test commands or other ones than the
    /// clouds, or where there are fewer points than are to be compared.
    pub fn of_clouds(
        clouds: PredictedClouds,
        data: &Path,
        settings: EvalSettings,
    ) -> Result<Self, PipelineError> {
        let available = clouds.points.first().map_or(0, Vec::len);
        require_points(settings.points, available)?;
        let evaluator = Self::of(Predictor::Clouds(clouds), None, data, settings)?;
        evaluator.require_commands()?;
        Ok(evaluator)
    }

    fn of(
        predictor: Predictor,
        subject: Option<&Subject>,
        data: &Path,
        settings: EvalSettings,
    ) -> Result<Self, PipelineError> {
        let set = DataSet::open(data)?;
        let recipe = set.meta().and_then(|meta| meta.origin.recipe().cloned());
        if let (Some(subject), Some(recipe)) = (subject, &recipe) {
            require_same(subject, &recipe.subject)?;
        }
        let (training, test) = (set.cloud_set(Split::Train)?, set.read_split(Split::Test)?);
        let available = test.iter().map(|sample| sample.cloud.len()).min();
        require_points(settings.points, available.unwrap_or(0))?;
        require_points(settings.emd_points, settings.points)?;
        let mut colors = test.iter().flat_map(|sample| &sample.cloud.colors);
        let first = colors.next();
        let colored = colors.any(|color| Some(color) != first);
        let simulation = recipe
            .map(|recipe| Simulation::new(recipe, &set, &training, settings.seed))
            .transpose()?;
        Ok(Self {
            predictor,
            settings,
            training,
            normalisation: set.normalisation().clone(),
            test,
            colored,
            simulation,
        })
    }

    /// Refuses clouds that are not of the test commands.
    fn require_commands(&self) -> Result<(), PipelineError> {
        let Predictor::Clouds(clouds) = &self.predictor else {
            return Ok(());
        };
        if clouds.points.len() != self.test.len() {
            return Err(PipelineError::OtherClouds {
                clouds: clouds.points.len(),
                tests: self.test.len(),
            });
        }
        let commands = clouds.commands.iter().flatten();
        for (index, (command, sample)) in commands.zip(&self.test).enumerate() {
            let truth = sample.condition.to_vec();
            let expected = self.normalisation.condition(&truth)?;
            let given: Vec<f64> = command.iter().map(|&value| value.into()).collect();
            let found = self.normalisation.condition(&given)?;
            let near = |(a, b): (&f32, &f32)| (a - b).abs() <= COMMAND_TOLERANCE;
            if !found.iter().zip(&expected).all(near) {
                return Err(PipelineError::OtherCommand {
                    index,
                    found: given,
                    expected: truth,
                });
            }
        }
        Ok(())
    }

    /// The network that is scored; `None` where the clouds are another program's.
    pub fn model(&self) -> Option<&Model> {
        match &self.predictor {
            Predictor::Model(model) => Some(model),
            Predictor::Clouds(_) => None,
        }
    }

    /// How it is scored.
    pub fn settings(&self) -> &EvalSettings {
        &self.settings
    }

    /// The robot of the data set; `None` where it names none.
    pub fn robot(&self) -> Option<&Robot> {
        self.simulation.as_ref().map(|simulation| &simulation.robot)
    }

    /// The samples of the test split.
    pub fn test(&self) -> &[Sample] {
        &self.test
    }

    /// Whether colours are predicted that the data set cannot judge: all points of its test clouds have one
    /// colour, as those of clouds that were imported without colours do.
    pub fn lacks_colors(&self) -> bool {
        let predicted = match &self.predictor {
            Predictor::Model(model) => model.network.shape().channels() == Channels::XyzRgb,
            Predictor::Clouds(clouds) => clouds.colors.is_some(),
        };
        predicted && !self.colored
    }

    /// The predicted cloud for test command `index`: of a network as many points as are compared.
    ///
    /// # Errors
    /// [`PipelineError::Predict`] where the command does not fit the model.
    pub fn predict(&self, index: usize) -> Result<Prediction, PipelineError> {
        match &self.predictor {
            Predictor::Model(model) => {
                let command = self.test[index].condition.to_vec();
                let seed = self.settings.seed.wrapping_add(index as u64);
                let sampler = &self.settings.sampler;
                Ok(model.predict(&command, self.settings.points, seed, sampler)?)
            }
            Predictor::Clouds(clouds) => Ok(Prediction {
                points: clouds.points[index].clone(),
                colors: clouds.colors.as_ref().map(|colors| colors[index].clone()),
                evaluations: 0,
            }),
        }
    }

    /// The cloud (m) of the training command nearest to test command `index`.
    ///
    /// # Errors
    /// [`PipelineError::Data`] where the command does not fit the data set.
    pub fn nearest(&self, index: usize) -> Result<Vec<[f32; 3]>, PipelineError> {
        let command = self.test[index].condition.to_vec();
        let condition = self.normalisation.condition(&command)?;
        let nearest = self
            .training
            .nearest_condition(&condition)
            .expect("a data set has training samples");
        let mut points = self.training.cloud(nearest).to_vec();
        self.normalisation.denormalise_points(&mut points);
        Ok(points.as_chunks().0.to_vec())
    }

    /// Distance of the condition of test command `index` from the nearest training condition: Euclidean, each number in
    /// units of its range in the training data.
    ///
    /// # Errors
    /// [`PipelineError::Data`] where the command does not fit the data set.
    pub fn distance_to_training(&self, index: usize) -> Result<f64, PipelineError> {
        let command = self.test[index].condition.to_vec();
        let condition = self.normalisation.condition(&command)?;
        let nearest = self
            .training
            .nearest_condition(&condition)
            .expect("a data set has training samples");
        let pairs = condition.iter().zip(self.training.condition(nearest));
        let squared: f64 = pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum();
        Ok(squared.sqrt())
    }

    /// Scores every test command. Finished ones are kept in the file `journal`, from which an
    /// interrupted evaluation of a network is taken up.
    ///
    /// # Errors
    /// [`PipelineError`] for an interruption, or a journal that cannot be written.
    pub fn run(
        &self,
        journal: Option<&Path>,
        monitor: &dyn Monitor,
    ) -> Result<Evaluation, PipelineError> {
        let count = self.test.len();
        let key = json!({
            "format": JOURNAL_FORMAT,
            "settings": self.settings,
            "model": self.model().map(|model| json!({
                "step": model.step, "validation": model.validation_distance,
            })),
            "tests": count,
        });
        // What a journal holds of other programs' clouds could be of other clouds.
        let (journal, entries) = match journal.filter(|_| self.model().is_some()) {
            Some(path) => {
                let (journal, entries) = Journal::open::<Entry>(path, &key)?;
                (Some(journal), entries)
            }
            None => (None, Vec::new()),
        };
        let mut done: Vec<Option<Scores>> = vec![None; count];
        for entry in entries.into_iter().filter(|entry| entry.index < count) {
            done[entry.index] = Some(entry.scores);
        }
        let missing: Vec<usize> = (0..count).filter(|&index| done[index].is_none()).collect();
        if !missing.is_empty() {
            monitor.begin("evaluate", count as u64, (count - missing.len()) as u64);
        }
        let scored: Vec<(usize, Scores)> = missing
            .into_par_iter()
            .map(|index| {
                if monitor.interrupted() {
                    return Err(PipelineError::Interrupted);
                }
                let scores = self.score(index)?;
                if let Some(journal) = &journal {
                    journal.add(&Entry { index, scores })?;
                }
                monitor.advance(1);
                Ok((index, scores))
            })
            .collect::<Result<_, _>>()?;
        monitor.end();
        for (index, scores) in scored {
            done[index] = Some(scores);
        }
        let per_test = done
            .into_iter()
            .map(|scores| scores.expect("scored, or kept"))
            .collect();
        Ok(Evaluation { per_test })
    }

    fn score(&self, index: usize) -> Result<Scores, PipelineError> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.settings.seed);
        rng.set_stream(index as u64);
        let truth = self.subset(&self.test[index].cloud.points, &mut rng);
        let nearest = self.nearest(index)?;
        let mut against =
            |points: &[[f32; 3]]| self.distances(&self.subset(points, &mut rng), &truth);
        let again = match &self.simulation {
            Some(simulation) => {
                let condition = &self.test[index].condition;
                Some(simulation.see_again(condition, self.settings.seed, index)?)
            }
            None => None,
        };
        let prediction = self.predict(index)?;
        let cloud = &self.test[index].cloud;
        let color = |colors: &Vec<[u8; 3]>| {
            color_error((&prediction.points, colors), (&cloud.points, &cloud.colors))
        };
        let colors = prediction.colors.as_ref().filter(|_| self.colored);
        let tip = match &self.simulation {
            Some(simulation) => {
                let settled = simulation.settle(&self.test[index].condition)?;
                let of = |points: &[_]| tip_error(&simulation.robot, &settled, &truth, points);
                let of_network = of(&prediction.points)?;
                let of_nearest = of(&nearest)?;
                of_network
                    .zip(of_nearest)
                    .map(|(network, nearest)| TipError { network, nearest })
            }
            None => None,
        };
        let network = against(&prediction.points)?;
        let nearest = against(&nearest)?;
        let mean = self.simulation.as_ref();
        let mean = mean.map(|s| against(&s.mean.points)).transpose()?;
        let (mut perfect, mut floor) = (None, None);
        if let Some(again) = again {
            let view = self.subset(&again.view.points, &mut rng);
            let of_floor = self.floor(&view, &truth)?;
            floor = Some(of_floor);
            // The floor's points of the earth mover's distances are independent of each other already.
            perfect = Some(Distances {
                cd: chamfer(&self.subset(&again.independent.points, &mut rng), &truth)?,
                ..of_floor
            });
        }
        Ok(Scores {
            network,
            nearest,
            mean,
            perfect,
            floor,
            color: colors.map(color).transpose()?,
            uncertainty: uncertainty(&prediction, &cloud.points)?,
            tip,
            evaluations: prediction.evaluations as f64,
        })
    }

    /// As many points as are compared, drawn without replacement, in random order.
    fn subset(&self, points: &[[f32; 3]], rng: &mut impl Rng) -> Vec<[f32; 3]> {
        let count = self.settings.points.min(points.len());
        index::sample(rng, points.len(), count)
            .iter()
            .map(|k| points[k])
            .collect()
    }

    fn distances(
        &self,
        cloud: &[[f32; 3]],
        truth: &[[f32; 3]],
    ) -> Result<Distances, PipelineError> {
        let few = self.settings.emd_points;
        distances([cloud, truth], [&cloud[..few], &truth[..few]])
    }

    /// What two samples of the same surfaces score. For CD the second is a view in a random phase of pixels and voxels; but
    /// that has some parts, like a base, in another density, which counts in the earth mover's distances: for them it is
    /// other points of `truth`, where there are enough.
    fn floor(&self, again: &[[f32; 3]], truth: &[[f32; 3]]) -> Result<Distances, PipelineError> {
        let few = self.settings.emd_points;
        let second = truth.get(few..2 * few).unwrap_or(&again[..few]);
        distances([again, truth], [second, &truth[..few]])
    }
}

/// Refuses to compare more points than there are.
fn require_points(wanted: usize, available: usize) -> Result<(), PipelineError> {
    match (1..=available).contains(&wanted) {
        true => Ok(()),
        false => Err(PipelineError::EvalPoints { wanted, available }),
    }
}

/// CD of one pair of clouds, earth mover's distances of another.
fn distances(
    [cloud, truth]: [&[[f32; 3]]; 2],
    [few_of_cloud, few_of_truth]: [&[[f32; 3]]; 2],
) -> Result<Distances, PipelineError> {
    let emd = emd(few_of_cloud, few_of_truth)?;
    let emd_squared = emd_squared(few_of_cloud, few_of_truth)?;
    Ok(Distances {
        cd: chamfer(cloud, truth)?,
        emd: emd.value,
        emd_gap: emd.gap,
        emd_squared: emd_squared.value,
        emd_squared_gap: emd_squared.gap,
    })
}

/// How uncertain a prediction is, and how well that tells its distance from the true cloud.
fn uncertainty(
    prediction: &Prediction,
    truth: &[[f32; 3]],
) -> Result<Option<UncertaintyScore>, MetricError> {
    let Some(values) = prediction.uncertainty(&[]) else {
        return Ok(None);
    };
    let values: Vec<f64> = values.into_iter().map(f64::from).collect();
    let distances = nearest_distances(&prediction.points, truth)?;
    Ok(Some(UncertaintyScore {
        mean: values.iter().sum::<f64>() / values.len() as f64,
        rank_correlation: rank_correlation(&values, &distances),
    }))
}

/// Refuses to score a model of one subject on clouds of another.
pub(super) fn require_same(model: &Subject, data: &Subject) -> Result<(), PipelineError> {
    if model.robot != data.robot {
        return Err(PipelineError::OtherRobot {
            model: model.robot.name.clone(),
            data: data.robot.name.clone(),
        });
    }
    if model.base != data.base {
        return Err(PipelineError::OtherBase {
            model: model.base,
            data: data.base,
        });
    }
    let covered = match (model.payload, data.payload) {
        (Some(model), Some(data)) => model.covers(data),
        (model, data) => model == data,
    };
    if !covered {
        return Err(PipelineError::OtherPayload {
            model: model.payload,
            data: data.payload,
        });
    }
    Ok(())
}

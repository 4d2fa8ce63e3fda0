//! From predictors to their scores, beside those of trivial predictors and the sampling floor.

mod prepare;

use std::collections::HashSet;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use tdcr_learn::data::Sample;
use tdcr_learn::predict::{About, NearestCommand, Prediction, Predictor};
use tdcr_sim::robot::{Robot, RobotSpec};

use super::eval_settings::{EvalSettings, Scoring};
use super::journal::Journal;
use super::measure::{Extent, Measure, subset};
use super::method::{Clouds, ScoredMethod};
use super::scores::{Evaluation, Quantiles, Row, RowKind, Scores};
use super::simulation::Simulation;
use super::{EvalError, Monitor, PipelineError};

/// What an [`Entry`] in a journal means. Entries of another format are computed anew, though they may
/// parse: it changes with the fields of [`Scores`] and with how they are computed.
const JOURNAL_FORMAT: u32 = 14;

/// Predictions of a method that are timed.
const TIMED: usize = 3;

/// Points of a test cloud and distinct ones of them, means.
fn true_points(test: &[Sample]) -> [f64; 2] {
    let distinct = |sample: &Sample| {
        let points = sample.cloud.points.iter();
        let keys: HashSet<_> = points.map(|point| point.map(f32::to_bits)).collect();
        keys.len()
    };
    let mean = |count: usize| count as f64 / test.len() as f64;
    [
        mean(test.iter().map(|sample| sample.cloud.len()).sum()),
        mean(test.par_iter().map(distinct).sum()),
    ]
}

/// Key and name of each reference, in the order of the rows.
const REFERENCES: [(&str, &str); 3] = [
    ("perfect", "perfect predictor"),
    ("perfect-selected", "perfect, evenly spread"),
    ("floor", "sampling floor"),
];

/// A finished piece of the evaluation.
#[derive(Serialize, Deserialize)]
struct Entry {
    index: usize,
    scores: Scores,
}

/// Predictors that are scored, and the data set that they are tested on.
///
/// Its rows are what is evaluated, the cloud of the nearest training command, that of the mean command, what
/// [`compare`](Self::compare) added, and the references: second samples of the true surface, which no predictor can be
/// expected to beat. The mean command and the references take a data set that names its robot.
pub struct Evaluator {
    /// In the order of their rows: what is evaluated, `standard - 1` trivial predictors, and those that were added.
    methods: Vec<ScoredMethod>,
    standard: usize,
    nearest: Arc<NearestCommand>,
    scoring: Scoring,
    /// What was asked for.
    asked: EvalSettings,
    test: Vec<Sample>,
    /// Whether the test clouds have several colours between them.
    colored: bool,
    simulation: Option<Simulation>,
    /// The robot that the data set shows, simulated or not.
    shown: Option<RobotSpec>,
}

impl Evaluator {
    /// How clouds are compared.
    pub fn scoring(&self) -> &Scoring {
        &self.scoring
    }

    /// That fewer points are compared than usual, where nobody asked for that: the clouds have no more.
    pub fn note(&self) -> Option<String> {
        let Scoring {
            points, emd_points, ..
        } = self.scoring;
        let few = [
            (
                self.asked.points,
                points,
                Scoring::POINTS,
                "Chamfer distances",
            ),
            (
                self.asked.emd_points,
                emd_points,
                Scoring::EMD_POINTS,
                "earth mover's distances",
            ),
        ];
        let few: Vec<String> = (few.iter())
            .filter(|(asked, count, usual, _)| asked.is_none() && count < usual)
            .map(|(_, count, usual, what)| format!("{what} are on {count} points, not on {usual}"))
            .collect();
        (!few.is_empty()).then(|| {
            format!(
                "{}: there are no more, and scores on fewer points are higher",
                few.join(", ")
            )
        })
    }

    /// What the data set's clouds show; `None` where it does not say.
    pub fn shown(&self) -> Option<&RobotSpec> {
        self.shown.as_ref()
    }

    /// The simulated robot of the data set; `None` where it is of none.
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
        let mut evaluated = self.methods.iter().filter(|m| m.kind == RowKind::Method);
        !self.colored && evaluated.any(|method| method.about.colors)
    }

    /// The cloud of the row at `place`, which is no reference's, for test command `index`: of a predictor that draws points, as
    /// many as are compared.
    ///
    /// # Errors
    /// [`PipelineError::Predict`] where the command does not fit the predictor.
    ///
    /// # Panics
    /// Where `place` is that of a reference, or of no row.
    pub fn predict(&self, place: usize, index: usize) -> Result<Prediction, PipelineError> {
        self.cloud(&self.methods[place], index)
    }

    /// Wall-clock time of a prediction by `method` (s), alone on all threads: the median of some; of clouds that were given, what
    /// their file says.
    fn prediction_seconds(&self, method: &ScoredMethod) -> Result<Option<f64>, PipelineError> {
        if let Clouds::Given(_) = method.clouds {
            return Ok(method.about.prediction_seconds);
        }
        let time = |index: usize| {
            let begun = Instant::now();
            self.cloud(method, index)?;
            Ok::<_, PipelineError>(begun.elapsed().as_secs_f64())
        };
        let times = (0..TIMED.min(self.test.len())).map(time);
        Ok(Some(Quantiles::of(times.collect::<Result<_, _>>()?).median))
    }

    /// The cloud of a method for test command `index`.
    fn cloud(&self, method: &ScoredMethod, index: usize) -> Result<Prediction, PipelineError> {
        let Scoring {
            points,
            emd_points,
            seed,
            ..
        } = self.scoring;
        let prediction = match &method.clouds {
            Clouds::Predicted(predictor) => {
                let condition = &self.test[index].condition;
                predictor.predict(condition, points, seed.wrapping_add(index as u64))?
            }
            Clouds::Given(clouds) => Prediction {
                points: clouds.points[index].clone(),
                colors: clouds.colors.as_ref().map(|colors| colors[index].clone()),
                ..Prediction::default()
            },
        };
        let expected = match method.extent {
            Extent::All => points,
            // Training clouds may have fewer points than test clouds.
            Extent::Tip | Extent::Distances => emd_points,
        };
        match prediction.points.len() {
            found if found >= expected => Ok(prediction),
            found => Err(EvalError::FewPredicted {
                predictor: method.about.name.clone(),
                found,
                expected,
            }
            .into()),
        }
    }

    /// The cloud (m) of the training command nearest to test command `index`.
    ///
    /// # Errors
    /// [`PipelineError::Predict`] where the command does not fit the data set.
    pub fn nearest(&self, index: usize) -> Result<Vec<[f32; 3]>, PipelineError> {
        let condition = &self.test[index].condition;
        let Scoring { points, seed, .. } = self.scoring;
        Ok(self.nearest.predict(condition, points, seed)?.points)
    }

    /// Distance of the condition of test command `index` from the nearest training condition: Euclidean, each number in
    /// units of its range in the training data.
    ///
    /// # Errors
    /// [`PipelineError::Predict`] where the command does not fit the data set.
    pub fn distance_to_training(&self, index: usize) -> Result<f64, PipelineError> {
        Ok(self.nearest.distance(&self.test[index].condition)?)
    }

    /// What is scored, in the order of the rows. Of several methods the time of a prediction is measured.
    fn rows(&self) -> Result<Vec<Row>, PipelineError> {
        let evaluated = |method: &&ScoredMethod| method.kind == RowKind::Method;
        let several = self.methods.iter().filter(evaluated).count() > 1;
        let predicted = self.methods.iter().map(|method| {
            let mut about = method.about.clone();
            if several && evaluated(&method) {
                about.prediction_seconds = self.prediction_seconds(method)?;
            }
            let kind = method.kind;
            Ok::<_, PipelineError>(Row { about, kind })
        });
        let reference = |(key, name): (&str, &str)| Row {
            about: About {
                key: key.to_owned(),
                name: name.to_owned(),
                method: "another sample of the true surface".to_owned(),
                ..About::default()
            },
            kind: RowKind::Reference,
        };
        let references = self.simulation.iter().flat_map(|_| REFERENCES);
        let references = references.map(|names| Ok(reference(names)));
        predicted.chain(references).collect()
    }

    /// What the entries of a journal are of; `None` where clouds are given, as those of another file might be others.
    fn journal_key(&self) -> Option<Value> {
        let of = |method: &ScoredMethod| match method.clouds {
            Clouds::Predicted(_) => Some(json!({
                "key": method.about.key,
                "made_from": method.about.made_from,
            })),
            Clouds::Given(_) => None,
        };
        let methods: Vec<Value> = self.methods.iter().map(of).collect::<Option<_>>()?;
        Some(json!({
            "format": JOURNAL_FORMAT,
            "settings": self.scoring,
            "predictors": methods,
            "tests": self.test.len(),
        }))
    }

    /// Scores every test command. Finished ones are kept in the file `journal`, from which an
    /// interrupted evaluation is resumed; not where clouds are given.
    ///
    /// # Errors
    /// [`PipelineError`] for an interruption, a journal that cannot be written, and a predictor that fails.
    pub fn run(
        &self,
        journal: Option<&Path>,
        monitor: &dyn Monitor,
    ) -> Result<Evaluation, PipelineError> {
        let count = self.test.len();
        let (journal, entries) = match journal.zip(self.journal_key()) {
            Some((path, key)) => {
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
        let scored: Vec<Entry> = missing
            .into_par_iter()
            .map(|index| {
                if monitor.interrupted() {
                    return Err(match journal {
                        Some(_) => PipelineError::Interrupted,
                        None => PipelineError::Abandoned,
                    });
                }
                let scores = self.score(index)?;
                let entry = Entry { index, scores };
                if let Some(journal) = &journal {
                    journal.add(&entry)?;
                }
                monitor.advance(1);
                Ok(entry)
            })
            .collect::<Result<_, _>>()?;
        monitor.end();
        for Entry { index, scores } in scored {
            done[index] = Some(scores);
        }
        let per_test = done
            .into_iter()
            .map(|scores| scores.expect("scored, or kept"))
            .collect();
        Ok(Evaluation {
            rows: self.rows()?,
            per_test,
            true_points: true_points(&self.test),
        })
    }

    fn score(&self, index: usize) -> Result<Scores, PipelineError> {
        // One random stream, in this order: the true points, the standard rows, the references. What was added starts where the
        // first row does: so it moves no other row, and has the scores that it would have alone.
        let mut rng = ChaCha8Rng::seed_from_u64(self.scoring.seed);
        rng.set_stream(index as u64);
        let sample = &self.test[index];
        let simulation = self.simulation.as_ref();
        let settled = simulation.map(|simulation| {
            let settled = simulation.settle(&sample.condition)?;
            Ok::<_, PipelineError>((&simulation.robot, settled))
        });
        let measure = Measure {
            scoring: self.scoring,
            sample,
            truth: subset(self.scoring.points, &sample.cloud.points, &mut rng),
            settled: settled.transpose()?,
            colored: self.colored,
        };
        let score = |method: &ScoredMethod, rng: &mut ChaCha8Rng| {
            let prediction = self.cloud(method, index)?;
            let key = &method.about.key;
            Ok::<_, PipelineError>(measure.row(key, &prediction, method.extent, rng)?)
        };
        let first = rng.clone();
        let (standard, added) = self.methods.split_at(self.standard);
        let mut rows = Vec::new();
        for method in standard {
            rows.push(score(method, &mut rng)?);
        }
        let references = match simulation {
            Some(simulation) => {
                let again = simulation.see_again(&sample.condition, self.scoring.seed, index)?;
                let keys = REFERENCES.map(|(key, _)| key);
                Some(measure.references(keys, &again, &mut rng)?)
            }
            None => None,
        };
        for method in added {
            rows.push(score(method, &mut first.clone())?);
        }
        rows.extend(references.into_iter().flatten());
        Ok(Scores { rows })
    }
}

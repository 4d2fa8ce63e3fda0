//! Trained models whose errors a study tells.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use tdcr_base::files::read_text;
use tdcr_base::rows::Splitter;
use tdcr_learn::data::Subject;
use tdcr_learn::predict::Predictor;
use tdcr_learn::train::{FlowPredictor, Model};
use tdcr_sim::cloud::VoxelGrid;
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::robot::Robot;

use super::Levels;
use super::variable::{Setting, Variable};
use crate::pipeline::{Probe, Scoring};
use crate::report::counted;
use crate::study::error::Refusal;

/// Most models of a study.
const MOST: usize = 1000;
/// Largest log of a training run that is read (bytes).
const LARGEST_LOG: u64 = 64 << 20;
/// Usual points of the earth mover's distance.
const EMD_POINTS: usize = 500;
/// Columns of such a log.
const STEP: &str = "step";
const VALIDATION: &str = "validation_cd";

/// The table `[model]` of a study's file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::study) struct ModelsInFile {
    file: String,
    #[serde(default = "points")]
    points: usize,
    /// [`EMD_POINTS`], or as many as there are, by default.
    emd_points: Option<usize>,
    #[serde(default = "voxels_of_the_paper")]
    voxel: f64,
}

fn points() -> usize {
    2000
}

fn voxels_of_the_paper() -> f64 {
    tdcr_learn::data::Recipe::default().voxel_size
}

/// The models of a study, and how their clouds are compared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::study) struct Models {
    /// Path of the files, with the names of variables in braces.
    file: String,
    /// Points of the Chamfer distance, and of the earth mover's distance.
    points: usize,
    emd_points: usize,
    /// Edge of the voxel grid that thins the true clouds (m).
    voxel: f64,
    /// The models by their paths as the file gives them.
    found: BTreeMap<String, TrainedModel>,
}

/// A trained model, without its weights where it was read from a finished study.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(in crate::study) struct TrainedModel {
    /// What it was trained on.
    pub subject: Subject,
    /// What tells it from others.
    made_from: Vec<(String, String)>,
    /// Steps of its training, and Chamfer distances in validation (m²).
    pub validations: Vec<(u64, f64)>,
    #[serde(skip)]
    model: Option<Arc<Model>>,
}

impl PartialEq for TrainedModel {
    fn eq(&self, other: &Self) -> bool {
        (&self.subject, &self.made_from, &self.validations)
            == (&other.subject, &other.made_from, &other.validations)
    }
}

impl ModelsInFile {
    /// Reads the models of all values of the variables that the path names. Paths begin in `folder`.
    pub fn read(
        self,
        set: &[(Variable, Value)],
        levels: &[Levels],
        folder: &Path,
    ) -> Result<Models, Refusal> {
        let mut models = Models {
            points: self.points,
            emd_points: self.emd_points.unwrap_or(EMD_POINTS.min(self.points)),
            file: self.file,
            voxel: self.voxel,
            found: BTreeMap::new(),
        };
        models.check()?;
        models.check_names(
            set.iter()
                .map(|(what, _)| what)
                .chain(levels.iter().map(|l| &l.what)),
        )?;
        let mut combinations: Vec<Vec<Setting>> = vec![
            set.iter()
                .map(|(what, value)| (what, value.clone()))
                .collect(),
        ];
        for levels in levels.iter().filter(|l| l.what.names_model()) {
            if combinations.len() * levels.values.len() > MOST {
                let expected = format!("variables that name {MOST} models at most");
                return Err(Refusal::value("model.file", &models.file, expected));
            }
            combinations = (combinations.iter())
                .flat_map(|settings| {
                    levels.values.iter().map(move |value| {
                        let mut settings = settings.clone();
                        settings.push((&levels.what, value.clone()));
                        settings
                    })
                })
                .collect();
        }
        for settings in combinations {
            let name = models.path(&settings);
            if let Entry::Vacant(place) = models.found.entry(name) {
                let model = TrainedModel::read(&folder.join(place.key()), place.key())?;
                place.insert(model);
            }
        }
        Ok(models)
    }
}

impl Models {
    fn check(&self) -> Result<(), Refusal> {
        if !VoxelGrid::is_size(self.voxel) {
            return Err(Refusal::value(
                "model.voxel",
                self.voxel,
                VoxelGrid::EXPECTED_SIZE,
            ));
        }
        if self.points == 0 {
            return Err(Refusal::value("model.points", self.points, "1 or more"));
        }
        if !(1..=self.points).contains(&self.emd_points) {
            let expected = format!("1 to {}, the points of the Chamfer distance", self.points);
            return Err(Refusal::value(
                "model.emd_points",
                self.emd_points,
                expected,
            ));
        }
        Ok(())
    }

    /// Refuses names in braces that no variable has, and variables that no braces name.
    fn check_names<'a>(&self, all: impl Iterator<Item = &'a Variable>) -> Result<(), Refusal> {
        let mut rest = self.file.clone();
        for what in all.filter(|what| what.names_model()) {
            let braces = what.in_braces();
            if !self.file.contains(&braces) {
                let expected = format!("a path with {braces}, as `{what}` is a variable");
                return Err(Refusal::value("model.file", &self.file, expected));
            }
            rest = rest.replace(&braces, "");
        }
        match rest.contains(['{', '}']) {
            true => {
                let expected = "a path in which {NAME} is the value of a variable `model.NAME`";
                Err(Refusal::value("model.file", &self.file, expected))
            }
            false => Ok(()),
        }
    }

    /// Path of the model of some settings.
    fn path(&self, settings: &[Setting]) -> String {
        let mut path = self.file.clone();
        // Of a variable that is both fixed and varied, the value that comes last counts.
        for (what, value) in settings.iter().rev().filter(|s| s.0.names_model()) {
            let text = value
                .as_str()
                .map_or_else(|| value.to_string(), ToOwned::to_owned);
            path = path.replace(&what.in_braces(), &text);
        }
        path
    }

    /// The model of some settings.
    ///
    /// # Errors
    /// That there is none, as text.
    pub fn of(&self, settings: &[Setting]) -> Result<&TrainedModel, String> {
        let path = self.path(settings);
        (self.found.get(&path)).ok_or_else(|| format!("there is no model {path}"))
    }

    /// The first one, by its path.
    pub fn first(&self) -> Option<&TrainedModel> {
        self.found.values().next()
    }

    /// All of them with their paths.
    pub fn all(&self) -> impl Iterator<Item = (&str, &TrainedModel)> {
        self.found
            .iter()
            .map(|(path, model)| (path.as_str(), model))
    }

    /// What scores the model of some settings on `robot`; `seed` is that of noise and points.
    ///
    /// # Errors
    /// That there is none, as text.
    pub fn probe(&self, settings: &[Setting], robot: &Robot, seed: u64) -> Result<Probe, String> {
        let found = self.of(settings)?;
        let model = found
            .model
            .as_ref()
            .ok_or("the model's weights were not read")?;
        let compared = Scoring {
            points: self.points,
            emd_points: self.emd_points,
            tests: None,
            seed,
        };
        Ok(Probe::new(
            model,
            robot,
            &found.subject,
            self.voxel,
            compared,
        ))
    }

    /// How clouds are compared, a sentence.
    pub fn phrase(&self) -> String {
        format!(
            "CD of {} points, EMD of {}, from what perfect cameras see in voxels of {} mm.",
            self.points,
            self.emd_points,
            1e3 * self.voxel
        )
    }
}

impl TrainedModel {
    /// What it was trained on, a phrase.
    pub fn phrase(&self) -> String {
        let Subject {
            robot,
            base,
            payload,
            scene,
            obstacles,
        } = &self.subject;
        let base = match base {
            BaseVisibility::Shown => "with its base",
            BaseVisibility::Hidden => "without its base",
        };
        let payload = payload.map_or("no payloads".to_owned(), |range| {
            format!("payloads of {} to {} g", 1e3 * range.min, 1e3 * range.max)
        });
        let scene = match scene.obstacles().len() {
            0 => String::new(),
            count => format!(", among {}", counted(count, "obstacle")),
        };
        let moved = obstacles.map_or_else(String::new, |by| format!(" moved by up to {by}"));
        format!("robot {} {base}, {payload}{scene}{moved}", robot.name)
    }

    /// The model in a file, and the validations in the log beside it.
    fn read(path: &Path, name: &str) -> Result<Self, Refusal> {
        if !path.exists() {
            let found = name.to_owned();
            return Err(Refusal::NoModel { found });
        }
        let model = Model::load(path)
            .map_err(|error| Refusal::value("model.file", error, "a trained model"))?;
        let Some(subject) = model.provenance.subject.clone() else {
            let expected = "a model trained on a data set that names its robot";
            return Err(Refusal::value("model.file", name, expected));
        };
        let model = Arc::new(model);
        let predictor = FlowPredictor::new(model.clone(), model.settings.sampler);
        let log = path.with_file_name("log.csv");
        Ok(Self {
            subject,
            made_from: predictor.about().made_from,
            validations: read_text(&log, LARGEST_LOG).map_or(Vec::new(), |text| validations(&text)),
            model: Some(model),
        })
    }
}

/// Steps and Chamfer distances (m²) of the validations in a run's log; lines that are none are left out.
fn validations(log: &str) -> Vec<(u64, f64)> {
    let mut splitter = Splitter::new(b',');
    let mut lines = log.lines();
    let names = splitter.cells(lines.next().unwrap_or_default());
    let place = |name| names.iter().position(|found| *found == name);
    let (Some(step), Some(cd)) = (place(STEP), place(VALIDATION)) else {
        return Vec::new();
    };
    lines
        .filter_map(|line| {
            let cells = splitter.cells(line);
            Some((cells.get(step)?.parse().ok()?, cells.get(cd)?.parse().ok()?))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;

    #[test]
    fn the_validations_of_a_log_are_read_and_other_lines_left_out() {
        let log = "step,loss,validation_cd\n10,1.0,\n20,0.5,2.5e-4\nbroken\n30,0.4,1e-4\n";
        assert_eq!(validations(log), [(20, 2.5e-4), (30, 1e-4)]);
        assert!(validations("").is_empty());
        assert!(validations("step,loss\n1,2\n").is_empty());
    }

    #[test]
    fn a_path_takes_the_values_of_the_variables_that_it_names() {
        let variable = |name: &str| name.parse::<Variable>().unwrap();
        let models = Models {
            file: "runs/{robot}-{count}.safetensors".to_owned(),
            points: 10,
            emd_points: 5,
            voxel: 0.002,
            found: BTreeMap::new(),
        };
        let (robot, count, other) = (
            variable("model.robot"),
            variable("model.count"),
            variable("payload"),
        );
        let settings = [
            (&robot, Value::from("3m")),
            (&other, Value::from(0.1)),
            (&count, Value::from(50)),
        ];
        assert_eq!(models.path(&settings), "runs/3m-50.safetensors");
        assert!(
            models
                .check_names([&robot, &count, &other].into_iter())
                .is_ok()
        );
        let missing = models.check_names([&robot].into_iter()).unwrap_err();
        assert!(missing.to_string().contains("model.NAME"), "{missing}");
        let third = variable("model.third");
        let unused = models
            .check_names([&robot, &count, &third].into_iter())
            .unwrap_err();
        assert!(unused.to_string().contains("{third}"), "{unused}");
    }
}

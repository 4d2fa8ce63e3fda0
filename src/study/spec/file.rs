//! Studies as files.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;
use serde_json::Value;
use tdcr_base::files::{Table, read_text, with_place};
use tdcr_learn::data::{Design, Subject};
use tdcr_sim::formats::Note;
use tdcr_sim::robot::RobotSpec;
use tdcr_sim::scene::Scene;

use super::cases::Cases;
use super::models::{Models, ModelsInFile};
use super::scenes;
use super::variable::{NAMES, Target, Variable};
use super::vary::Vary;
use super::{HysteresisLoop, Levels, Output, Sample, Sampled, Study};
use crate::study::error::{Refusal, StudyError};

/// Largest file of a study (bytes).
const LARGEST: u64 = 1 << 20;

/// A study as its file has it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct InFile {
    title: Option<String>,
    robot: Option<String>,
    scene: Option<String>,
    model: Option<ModelsInFile>,
    #[serde(default)]
    seed: u64,
    want: Vec<String>,
    #[serde(default)]
    set: BTreeMap<String, Value>,
    #[serde(default)]
    vary: Vec<Vary>,
    sample: Option<SampleInFile>,
    tension_limit: Option<f64>,
    alpha: Option<f64>,
    #[serde(default = "centimetres")]
    dexterity_radius: f64,
    #[serde(default)]
    hysteresis: HysteresisLoop,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SampleInFile {
    #[serde(default = "sobol")]
    design: String,
    count: usize,
}

fn centimetres() -> f64 {
    0.02
}

fn sobol() -> String {
    Design::Sobol.name().to_owned()
}

impl Study {
    /// Reads a study's file. Robots that it names by path are read too, from the folder that the file lies in.
    ///
    /// # Errors
    /// [`StudyError::Read`], [`StudyError::Parse`] or [`StudyError::File`], which say the file, the key and what would be
    /// right.
    pub fn load(path: &Path) -> Result<Self, StudyError> {
        Self::load_with_notes(path, None).map(|(study, _)| study)
    }

    /// As [`Study::load`], with notes on what was passed over in robots' files of other tools, and `scene` around the robot, if one is
    /// given, in place of the file's.
    ///
    /// # Errors
    /// As [`Study::load`].
    pub fn load_with_notes(
        path: &Path,
        scene: Option<&Scene>,
    ) -> Result<(Self, Vec<Note>), StudyError> {
        let text = read_text(path, LARGEST).map_err(|source| StudyError::Read {
            path: path.to_owned(),
            source,
        })?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut notes = Vec::new();
        let file = InFile::parse(&text, path)?;
        let study = file.in_folder(folder, path, scene, &mut notes)?;
        Ok((study, notes))
    }

    /// A study from JSON with the keys of a file, and notes as of [`Study::load_with_notes`]. `folder` and `path` as of
    /// [`Study::parse`].
    ///
    /// # Errors
    /// As [`Study::load`].
    pub fn from_json_with_notes(
        text: &str,
        folder: &Path,
        path: &Path,
        scene: Option<&Scene>,
    ) -> Result<(Self, Vec<Note>), StudyError> {
        let file: InFile = serde_json::from_str(text).map_err(|error| StudyError::Parse {
            path: path.to_owned(),
            reason: with_place(&error.to_string(), &InFile::tables()),
        })?;
        let mut notes = Vec::new();
        let study = file.in_folder(folder, path, scene, &mut notes)?;
        Ok((study, notes))
    }

    /// A study from the text of its file. `folder` is where paths of robots begin, `path` what errors call the file.
    ///
    /// # Errors
    /// As [`Study::load`].
    pub fn parse(text: &str, folder: &Path, path: &Path) -> Result<Self, StudyError> {
        let file = InFile::parse(text, path)?;
        file.in_folder(folder, path, None, &mut Vec::new())
    }
}

impl InFile {
    /// The tables of a study's file.
    fn tables() -> [Table; 5] {
        [
            Table::of::<Self>("the file itself, above all tables"),
            Table::of::<Vary>("[[vary]]"),
            Table::of::<SampleInFile>("[sample]"),
            Table::of::<ModelsInFile>("[model]"),
            Table::of::<HysteresisLoop>("[hysteresis]"),
        ]
    }

    fn parse(text: &str, path: &Path) -> Result<Self, StudyError> {
        toml::from_str(text).map_err(|error| StudyError::Parse {
            path: path.to_owned(),
            reason: with_place(&error.to_string(), &Self::tables()),
        })
    }

    fn in_folder(
        self,
        folder: &Path,
        path: &Path,
        scene: Option<&Scene>,
        notes: &mut Vec<Note>,
    ) -> Result<Study, StudyError> {
        self.study(folder, scene, notes)
            .map_err(|refusal| StudyError::File {
                path: path.to_owned(),
                refusal: Box::new(refusal),
            })
    }

    fn study(
        self,
        folder: &Path,
        scene: Option<&Scene>,
        notes: &mut Vec<Note>,
    ) -> Result<Study, Refusal> {
        let (mut robots, mut scenes) = (BTreeMap::new(), BTreeMap::new());
        let set = (self.set.into_iter())
            .map(|(name, value)| {
                let key = format!("set.\"{name}\"");
                let variable = variable(&key, &name)?;
                if variable.target == Target::Scene {
                    let expected = "the key `scene` above all tables";
                    return Err(Refusal::value(key, value, expected));
                }
                Ok((variable, value))
            })
            .collect::<Result<Vec<_>, Refusal>>()?;
        let (mut levels, mut sampled): (Vec<Levels>, Vec<Sampled>) = Default::default();
        for (place, vary) in self.vary.into_iter().enumerate() {
            let key = format!("vary[{place}]");
            let what = variable(&format!("{key}.what"), &vary.what)?;
            let twice =
                levels.iter().any(|l| l.what == what) || sampled.iter().any(|s| s.what == what);
            if twice {
                let expected = "each variable once";
                return Err(Refusal::value(format!("{key}.what"), &vary.what, expected));
            }
            match vary.values(&key, &what)? {
                Some(values) => {
                    for (place, value) in values.iter().enumerate() {
                        let key = format!("{key}.values[{place}]");
                        match what.target {
                            Target::Robot => {
                                let name = text(&key, value, "the name or path of a robot")?;
                                let robot = load_robot(&key, name, folder, notes)?;
                                robots.insert(name.to_owned(), robot);
                            }
                            Target::Scene => {
                                let name = text(&key, value, "the path of a scene file")?;
                                let scene = scenes::load(&key, name, folder)?;
                                scenes.insert(name.to_owned(), scene);
                            }
                            _ => break,
                        }
                    }
                    levels.push(Levels { what, values });
                }
                None => sampled.push(vary.sampled(&key, what)?),
            }
        }
        let sample = match (self.sample, sampled.is_empty()) {
            (Some(sample), false) => Some(sample.checked()?),
            (None, true) => None,
            (Some(_), true) => {
                let expected = "no such table, or a variable with a range and no steps (or `command` alone) to sample";
                return Err(Refusal::value("sample", "there", expected));
            }
            (None, false) => {
                let expected = "a table with `count`, as many points as the variables without values are sampled at";
                return Err(Refusal::value("sample", "missing", expected));
            }
        };
        let want = wanted(&self.want, sample.is_some())?;
        let of_model = self.model.map(|model| model.read(&set, &levels, folder));
        let models = of_model.transpose()?;
        let has_scene = self.scene.is_some() || scene.is_some() || !scenes.is_empty();
        check_models(&models, &want, &self.robot, has_scene, &set, &levels)?;
        let scene = scenes::of_all(scene, self.scene.as_deref(), folder)?;
        let robot_name = self.robot.unwrap_or_else(|| Subject::ROBOT.to_owned());
        let robot = match models.as_ref().and_then(Models::first) {
            Some(model) => model.subject.robot.clone(),
            None => load_robot("robot", &robot_name, folder, notes)?,
        };
        for (key, value) in [
            ("tension_limit", self.tension_limit),
            ("alpha", self.alpha),
            ("dexterity_radius", Some(self.dexterity_radius)),
        ] {
            if let Some(value) = value.filter(|value| !(value.is_finite() && *value > 0.0)) {
                return Err(Refusal::value(key, value, "a finite number above 0"));
            }
        }
        let study = Study {
            title: self
                .title
                .unwrap_or_else(|| format!("Study of {}", robot.name)),
            robot_name: match models {
                Some(_) => robot.name.clone(),
                None => robot_name,
            },
            robot,
            robots,
            scene,
            scenes,
            models,
            seed: self.seed,
            set,
            levels,
            sampled,
            sample,
            want,
            tension_limit: self.tension_limit,
            alpha: self.alpha,
            dexterity_radius: self.dexterity_radius,
            hysteresis: self.hysteresis.checked()?,
        };
        study.check_scenes()?;
        Cases::new(&study)?.check(&study)?;
        Ok(study)
    }
}

impl HysteresisLoop {
    fn checked(self) -> Result<Self, Refusal> {
        if !(self.by.is_finite() && self.by != 0.0) {
            let expected = "a finite number other than 0 (m, or N for a tension drive)";
            return Err(Refusal::value("hysteresis.by", self.by, expected));
        }
        if !(2..=1000).contains(&self.points) {
            return Err(Refusal::value(
                "hysteresis.points",
                self.points,
                "2 to 1000",
            ));
        }
        Ok(self)
    }
}

/// Refuses an output of models without any, models without their output, and robots and scenes beside those of models.
fn check_models(
    models: &Option<Models>,
    want: &[Output],
    robot: &Option<String>,
    has_scene: bool,
    set: &[(Variable, Value)],
    levels: &[Levels],
) -> Result<(), Refusal> {
    let variables = || {
        set.iter()
            .map(|(what, _)| what)
            .chain(levels.iter().map(|l| &l.what))
    };
    match (models, want.contains(&Output::Model)) {
        (None, true) => {
            let expected =
                "a table with `file`, the path of a trained model, for the output `model`";
            return Err(Refusal::value("model", "missing", expected));
        }
        (Some(_), false) => {
            let expected = "an entry \"model\" in `want`, or no table `model`";
            return Err(Refusal::value("model", "there", expected));
        }
        _ => {}
    }
    let named = variables().find(|what| what.names_model());
    if let (None, Some(what)) = (models, named) {
        let expected = "a table `model` whose `file` names it";
        return Err(Refusal::value(what.name(), "a variable", expected));
    }
    let robots = robot.is_some() || variables().any(|what| what.target == Target::Robot);
    let (key, expected) = match (models.is_some(), robots, has_scene) {
        (true, true, _) => (
            "robot",
            "no other robot than the model's own, beside a table `model`",
        ),
        (true, false, true) => (
            "scene",
            "no other scene than that of the model's data set, beside a table `model`",
        ),
        _ => return Ok(()),
    };
    Err(Refusal::value(key, "there", expected))
}

fn load_robot(
    key: &str,
    name: &str,
    folder: &Path,
    notes: &mut Vec<Note>,
) -> Result<RobotSpec, Refusal> {
    let path = match RobotSpec::standard(name) {
        Some(_) => name.to_owned(),
        // A name that is no path is named as it is in the error.
        None if Path::new(name).extension().is_none() => name.to_owned(),
        None => folder.join(name).to_string_lossy().into_owned(),
    };
    let loaded = RobotSpec::load_with_notes(&path);
    let (robot, found) = loaded.map_err(|source| Refusal::Robot {
        key: key.to_owned(),
        source,
    })?;
    notes.extend(found);
    Ok(robot)
}

/// The text that a value is.
fn text<'a>(key: &str, value: &'a Value, expected: &str) -> Result<&'a str, Refusal> {
    (value.as_str()).ok_or_else(|| Refusal::value(key, value, expected))
}

fn variable(key: &str, name: &str) -> Result<Variable, Refusal> {
    (name.parse())
        .map_err(|_| Refusal::value(key, format!("\"{name}\""), format!("one of {NAMES}")))
}

fn wanted(names: &[String], sampled: bool) -> Result<Vec<Output>, Refusal> {
    let all = || Output::ALL.map(Output::name).join(", ");
    let mut want = Vec::new();
    for (place, name) in names.iter().enumerate() {
        let key = format!("want[{place}]");
        let found = Output::ALL.into_iter().find(|want| want.name() == name);
        let found = found.ok_or_else(|| {
            Refusal::value(&key, format!("\"{name}\""), format!("one of {}", all()))
        })?;
        if want.contains(&found) {
            return Err(Refusal::value(
                key,
                format!("\"{name}\""),
                "each output once",
            ));
        }
        if found.is_of_tips() && !sampled {
            let expected = "an output of single configurations, or a sampled `command`: this one is of many commands";
            return Err(Refusal::value(key, format!("\"{name}\""), expected));
        }
        want.push(found);
    }
    match want.is_empty() {
        true => Err(Refusal::value(
            "want",
            "empty",
            format!("some of {}", all()),
        )),
        false => Ok(want),
    }
}

impl SampleInFile {
    fn checked(self) -> Result<Sample, Refusal> {
        let designs = [Design::Sobol, Design::LatinHypercube, Design::Uniform];
        let design = designs
            .into_iter()
            .find(|design| design.name() == self.design);
        let Some(design) = design else {
            let expected = "sobol, latin-hypercube or uniform (a grid: `steps` of each variable)";
            return Err(Refusal::value(
                "sample.design",
                format!("\"{}\"", self.design),
                expected,
            ));
        };
        if !(1..=100_000_000).contains(&self.count) {
            return Err(Refusal::value("sample.count", self.count, "1 to 100000000"));
        }
        Ok(Sample {
            design,
            count: self.count,
        })
    }
}

//! Studies as files.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;
use serde_json::Value;
use tdcr_learn::data::Design;
use tdcr_sim::files::read_text;
use tdcr_sim::robot::RobotSpec;

use super::cases::Cases;
use super::variable::{NAMES, Target, Variable};
use super::{HysteresisLoop, Levels, Refusal, Sample, Sampled, Study, StudyError, Want};
use crate::report::Spacing;

/// Largest file of a study (bytes).
const LARGEST: u64 = 1 << 20;
/// Most values of one variable.
const MOST_VALUES: usize = 1_000_000;

/// A study as its file has it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct InFile {
    title: Option<String>,
    #[serde(default = "two_modules")]
    robot: String,
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
    #[serde(default)]
    hysteresis: HysteresisLoop,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Vary {
    what: String,
    values: Option<Vec<Value>>,
    range: Option<[f64; 2]>,
    steps: Option<usize>,
    spacing: Option<SpacingInFile>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "snake_case")]
enum SpacingInFile {
    Linear,
    Log,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SampleInFile {
    #[serde(default = "sobol")]
    design: String,
    count: usize,
}

fn two_modules() -> String {
    "2m".to_owned()
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
        let text = read_text(path, LARGEST).map_err(|source| StudyError::Read {
            path: path.to_owned(),
            source,
        })?;
        let folder = path.parent().unwrap_or(Path::new(""));
        Self::parse(&text, folder, path)
    }

    /// A study from JSON with the keys of a file. `folder` and `path` as of [`Study::parse`].
    ///
    /// # Errors
    /// As [`Study::load`].
    pub fn from_json(text: &str, folder: &Path, path: &Path) -> Result<Self, StudyError> {
        let file: InFile = serde_json::from_str(text).map_err(|error| StudyError::Parse {
            path: path.to_owned(),
            reason: error.to_string(),
        })?;
        file.in_folder(folder, path)
    }

    /// A study from the text of its file. `folder` is where paths of robots begin, `path` what errors call the file.
    ///
    /// # Errors
    /// As [`Study::load`].
    pub fn parse(text: &str, folder: &Path, path: &Path) -> Result<Self, StudyError> {
        let file: InFile = toml::from_str(text).map_err(|error| StudyError::Parse {
            path: path.to_owned(),
            reason: error.to_string(),
        })?;
        file.in_folder(folder, path)
    }
}

impl InFile {
    fn in_folder(self, folder: &Path, path: &Path) -> Result<Study, StudyError> {
        self.study(folder).map_err(|refusal| StudyError::File {
            path: path.to_owned(),
            refusal: Box::new(refusal),
        })
    }

    fn study(self, folder: &Path) -> Result<Study, Refusal> {
        let mut robots = BTreeMap::new();
        let robot = load_robot("robot", &self.robot, folder)?;
        let set = (self.set.into_iter())
            .map(|(name, value)| {
                let key = format!("set.\"{name}\"");
                let variable = variable(&key, &name)?;
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
                    if what.target == Target::Robot {
                        for (place, value) in values.iter().enumerate() {
                            let key = format!("{key}.values[{place}]");
                            let Some(name) = value.as_str() else {
                                return Err(Refusal::value(
                                    key,
                                    value,
                                    "the name or path of a robot",
                                ));
                            };
                            let robot = load_robot(&key, name, folder)?;
                            robots.insert(name.to_owned(), robot);
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
        for (key, value) in [("tension_limit", self.tension_limit), ("alpha", self.alpha)] {
            if let Some(value) = value.filter(|value| !(value.is_finite() && *value > 0.0)) {
                return Err(Refusal::value(key, value, "a finite number above 0"));
            }
        }
        let study = Study {
            title: self
                .title
                .unwrap_or_else(|| format!("Study of {}", self.robot)),
            robot_name: self.robot,
            robot,
            robots,
            seed: self.seed,
            set,
            levels,
            sampled,
            sample,
            want,
            tension_limit: self.tension_limit,
            alpha: self.alpha,
            hysteresis: self.hysteresis.checked()?,
        };
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

fn load_robot(key: &str, name: &str, folder: &Path) -> Result<RobotSpec, Refusal> {
    let path = match RobotSpec::standard(name) {
        Some(_) => name.to_owned(),
        // A name that is no path is named as it is in the error.
        None if Path::new(name).extension().is_none() => name.to_owned(),
        None => folder.join(name).to_string_lossy().into_owned(),
    };
    RobotSpec::load(&path).map_err(|source| Refusal::Robot {
        key: key.to_owned(),
        source,
    })
}

fn variable(key: &str, name: &str) -> Result<Variable, Refusal> {
    (name.parse())
        .map_err(|_| Refusal::value(key, format!("\"{name}\""), format!("one of {NAMES}")))
}

fn wanted(names: &[String], sampled: bool) -> Result<Vec<Want>, Refusal> {
    let all = || Want::ALL.map(Want::name).join(", ");
    let mut want = Vec::new();
    for (place, name) in names.iter().enumerate() {
        let key = format!("want[{place}]");
        let found = Want::ALL.into_iter().find(|want| want.name() == name);
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
        if found == Want::Workspace && !sampled {
            let expected = "an output of single configurations, or a sampled `command`: a workspace is of many commands";
            return Err(Refusal::value(key, "\"workspace\"", expected));
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

impl Vary {
    /// The levels of the variable; `None` for one that is sampled.
    fn values(&self, key: &str, what: &Variable) -> Result<Option<Vec<Value>>, Refusal> {
        match (&self.values, self.range, self.steps) {
            (Some(values), None, None) => {
                if !(1..=MOST_VALUES).contains(&values.len()) {
                    let expected = format!("1 to {MOST_VALUES} values");
                    return Err(Refusal::value(
                        format!("{key}.values"),
                        values.len(),
                        expected,
                    ));
                }
                for (place, value) in values.iter().enumerate() {
                    let whole = value.as_u64().is_some();
                    if what.is_whole() && !whole {
                        let key = format!("{key}.values[{place}]");
                        return Err(Refusal::value(key, value, "a whole number"));
                    }
                }
                Ok(Some(values.clone()))
            }
            (None, Some(range), Some(steps)) => {
                if !(2..=MOST_VALUES).contains(&steps) {
                    let expected = format!("2 to {MOST_VALUES}, the two ends included");
                    return Err(Refusal::value(format!("{key}.steps"), steps, expected));
                }
                let spacing = self.checked_range(key, range)?;
                let level = |step: usize| {
                    let value = rounded(place_in(range, spacing, step as f64 / (steps - 1) as f64));
                    match what.is_whole() && value.fract() == 0.0 && value >= 0.0 {
                        true => Value::from(value as u64),
                        false => Value::from(value),
                    }
                };
                let values: Vec<Value> = (0..steps).map(level).collect();
                if let Some(value) = values.iter().find(|v| what.is_whole() && !v.is_u64()) {
                    let expected = format!(
                        "as many as make all values of `{what}` whole, which {value} is not"
                    );
                    return Err(Refusal::value(format!("{key}.steps"), steps, expected));
                }
                Ok(Some(values))
            }
            (None, Some(_), None) => Ok(None),
            (None, None, None) if what.target == Target::Command => Ok(None),
            _ => {
                let expected = "either `values = [...]`, or `range = [LOW, HIGH]` with `steps = N`, or `range` alone for \
                     a variable that is sampled (`command` needs none)";
                Err(Refusal::value(key, "neither", expected))
            }
        }
    }

    fn checked_range(&self, key: &str, range: [f64; 2]) -> Result<Spacing, Refusal> {
        let [low, high] = range;
        let spacing = match self.spacing {
            None | Some(SpacingInFile::Linear) => Spacing::Linear,
            Some(SpacingInFile::Log) => Spacing::Log,
        };
        let ordered = low.is_finite() && high.is_finite() && low < high;
        if !ordered || spacing == Spacing::Log && low <= 0.0 {
            let expected = match spacing {
                Spacing::Linear => "[LOW, HIGH], finite, LOW below HIGH",
                Spacing::Log => "[LOW, HIGH], finite, LOW below HIGH and above 0",
            };
            return Err(Refusal::value(
                format!("{key}.range"),
                format!("[{low}, {high}]"),
                expected,
            ));
        }
        Ok(spacing)
    }

    fn sampled(self, key: &str, what: Variable) -> Result<Sampled, Refusal> {
        if what.is_whole() || what.target == Target::Robot {
            let expected = "`values`, or `range` with `steps`: it is not sampled";
            return Err(Refusal::value(
                key,
                format!("`{what}` without them"),
                expected,
            ));
        }
        let Some(range) = self.range else {
            return Ok(Sampled::new(what, None));
        };
        let spacing = self.checked_range(key, range)?;
        Ok(Sampled::new(what, Some((range, spacing))))
    }
}

/// A value without the last digits of floating-point noise, so that tables are short.
fn rounded(value: f64) -> f64 {
    format!("{value:.12e}").parse().unwrap_or(value)
}

/// The value at a share of the way from one end of a range to the other.
pub(super) fn place_in([low, high]: [f64; 2], spacing: Spacing, share: f64) -> f64 {
    match spacing {
        _ if share == 1.0 => high,
        Spacing::Linear => low + (high - low) * share,
        Spacing::Log => low * (high / low).powf(share),
    }
}

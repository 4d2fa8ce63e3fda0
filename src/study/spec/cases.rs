//! The configurations of a study, each by its number.
//!
//! They are every combination of the values of the variables that have some, the first variable's changing slowest, and under
//! each combination the same sampled points: so what differs between combinations is not the luck of the draw.

use serde_json::Value;
use tdcr_learn::data::UnitPoints;
use tdcr_sim::robot::Robot;

use super::Study;
use super::case;
use super::overlap;
use super::variable::{Setting, Target};
use super::vary::place_in;
use crate::study::error::Refusal;

/// Most configurations of a study.
const MOST: usize = 1_000_000_000;

/// Values of a variable that are tried before a study begins.
const CHECKED: usize = 200;

/// A study's configurations.
pub(in crate::study) struct Cases<'a> {
    study: &'a Study,
    /// Combinations of levels.
    combinations: usize,
    /// The sampled points, for each value of the seed.
    points: Vec<(u64, UnitPoints)>,
}

/// One of them.
pub(in crate::study) struct Case<'a> {
    /// All values: those that are set, the levels, what is sampled but for a command.
    pub settings: Vec<Setting<'a>>,
    /// Where a sampled command lies in the box of the tendons' ranges.
    pub command: Option<Vec<f64>>,
}

impl<'a> Cases<'a> {
    pub fn new(study: &'a Study) -> Result<Self, Refusal> {
        let mut combinations = 1_usize;
        for levels in &study.levels {
            combinations = combinations.saturating_mul(levels.values.len());
        }
        let count = combinations.saturating_mul(study.samples());
        if count > MOST {
            let expected = format!("values and samples that make {MOST} configurations at most");
            return Err(Refusal::value(
                "vary",
                format!("{count} configurations"),
                expected,
            ));
        }
        let mut cases = Self {
            study,
            combinations,
            points: Vec::new(),
        };
        cases.points = cases.sampled_points()?;
        Ok(cases)
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.combinations * self.study.samples()
    }

    /// Configuration `index`.
    pub fn case(&self, index: usize) -> Case<'a> {
        let (combination, sample) = (index / self.study.samples(), index % self.study.samples());
        let mut settings: Vec<Setting> = (self.study.set.iter())
            .map(|(variable, value)| (variable, value.clone()))
            .collect();
        settings.extend(self.levels(combination));
        let mut command = None;
        if let Some(points) = self.points_of(&settings) {
            let point = points.point(sample);
            let mut rest = &point[..];
            for sampled in self.study.scalars() {
                if let (Some((range, spacing)), Some((share, behind))) =
                    (sampled.range(), rest.split_first())
                {
                    let value = place_in(range, spacing, *share);
                    settings.push((&sampled.what, Value::from(value)));
                    rest = behind;
                }
            }
            command = self.study.samples_command().then(|| rest.to_vec());
        }
        Case { settings, command }
    }

    /// The values of the levels of a combination.
    pub fn levels(&self, combination: usize) -> Vec<Setting<'a>> {
        let digits = self.digits(combination * self.study.samples());
        let levels = self.study.levels.iter().zip(digits);
        levels
            .map(|(levels, digit)| (&levels.what, levels.values[digit].clone()))
            .collect()
    }

    /// The place of row `index` among the values of each variable that has some.
    pub fn digits(&self, index: usize) -> Vec<usize> {
        let mut rest = index / self.study.samples();
        let mut digits: Vec<usize> = (self.study.levels.iter().rev())
            .map(|levels| {
                let digit = rest % levels.values.len();
                rest /= levels.values.len();
                digit
            })
            .collect();
        digits.reverse();
        digits
    }

    fn points_of(&self, settings: &[Setting]) -> Option<&UnitPoints> {
        let seed = settings
            .iter()
            .rev()
            .find(|setting| setting.0.target == Target::Seed);
        let seed = seed
            .and_then(|setting| setting.1.as_u64())
            .unwrap_or(self.study.seed);
        (self.points.iter())
            .find(|(of, _)| *of == seed)
            .map(|(_, points)| points)
    }

    fn sampled_points(&self) -> Result<Vec<(u64, UnitPoints)>, Refusal> {
        let Some(sample) = self.study.sample else {
            return Ok(Vec::new());
        };
        let seeds = (self.study.levels.iter()).find(|levels| levels.what.target == Target::Seed);
        let mut seeds: Vec<u64> = seeds.map_or_else(
            || vec![self.study.seed],
            |levels| levels.values.iter().filter_map(Value::as_u64).collect(),
        );
        let set = self
            .study
            .set
            .iter()
            .find(|(what, _)| what.target == Target::Seed);
        seeds.extend(set.and_then(|(_, seed)| seed.as_u64()));
        let dimensions = self.study.scalars().count() + self.most_tendons();
        let points = |seed| {
            Ok((
                seed,
                sample.design.unit_points(dimensions, sample.count, seed)?,
            ))
        };
        seeds.into_iter().map(points).collect()
    }

    /// Most tendons of any robot whose command is sampled; none where none is.
    fn most_tendons(&self) -> usize {
        if !self.study.samples_command() {
            return 0;
        }
        // Only the number of modules, or another robot, as a model may have one, gives other tendons.
        let structural = |target: &Target| {
            matches!(
                target,
                Target::Model | Target::Robot | Target::Modules | Target::Field(_)
            )
        };
        let mut most = 0;
        let mut variants: Vec<Vec<Setting>> = vec![
            (self.study.set.iter())
                .map(|(variable, value)| (variable, value.clone()))
                .collect(),
        ];
        for levels in self
            .study
            .levels
            .iter()
            .filter(|l| structural(&l.what.target))
        {
            let with = |settings: &Vec<Setting<'a>>, value: &Value| {
                let mut settings = settings.clone();
                settings.push((&levels.what, value.clone()));
                settings
            };
            variants = (variants.iter())
                .flat_map(|settings| levels.values.iter().map(move |value| with(settings, value)))
                .collect();
        }
        for settings in &variants {
            let tendons =
                case::robot(self.study, settings).map_or(0, |robot| robot.tendons().len());
            most = most.max(tendons);
        }
        most
    }

    /// Checks the first configuration, and those that differ from it by one level.
    pub fn check(&self, study: &Study) -> Result<(), Refusal> {
        let compiled = |case: &Case| -> Result<Robot, String> {
            let robot = case::robot(study, &case.settings)?;
            overlap::check(study, robot.spec(), &case.settings)?;
            case::command(&robot, &case.settings, case.command.as_deref())?;
            case::loads(&robot, &case.settings)?;
            case::scene(study, &case.settings)?;
            Ok(robot)
        };
        for (variable, value) in &study.set {
            let only = [(variable, value.clone())];
            case::robot(study, &only).map_err(|reason| Refusal::Configuration {
                key: format!("set.\"{variable}\""),
                found: value.to_string(),
                reason,
            })?;
        }
        let first = self.case(0);
        let first_settings = first.settings.len();
        for (place, levels) in study.levels.iter().enumerate() {
            // All of a few values, some of many.
            for value in levels
                .values
                .iter()
                .step_by(levels.values.len().div_ceil(CHECKED))
            {
                let mut case = self.case(0);
                for setting in case.settings.iter_mut().filter(|s| *s.0 == levels.what) {
                    setting.1 = value.clone();
                }
                compiled(&case).map_err(|reason| Refusal::Configuration {
                    key: format!("vary[{place}] ({})", levels.what),
                    found: value.to_string(),
                    reason,
                })?;
            }
        }
        compiled(&first)
            .map(drop)
            .map_err(|reason| Refusal::Configuration {
                key: "vary".to_owned(),
                found: format!("{first_settings} values in the first configuration"),
                reason,
            })
    }
}

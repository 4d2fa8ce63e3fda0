//! Two data sets beside each other, or one beside the simulator, configuration by configuration.

use std::path::Path;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::Serialize;
use tdcr_learn::data::{DataSet, Origin, Recipe, Split, SplitSamples, Subject};
use tdcr_sim::cloud::PointCloud;
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::robot::{Robot, RobotSpec};
use tdcr_sim::scene::Scene;

use super::compare_settings::CompareSettings;
use super::eval_settings::{EvalSettings, Scoring};
use super::measure::{distances, subset};
use super::pairing::{Entry, Pair, Place};
use super::scores::{Distances, Quantiles};
use super::simulation::Simulation;
use super::tip::tip_error;
use super::{CompareError, Monitor, PipelineError};

/// What a data set is compared with.
#[derive(Clone, Copy, Debug)]
pub enum Reference<'a> {
    /// The data set in a folder.
    Set(&'a Path),
    /// The simulator under the same conditions, without faults of cameras.
    Simulator {
        /// The robot; `None` for the data set's own.
        robot: Option<&'a RobotSpec>,
        /// Whether the base is in view, where the data set does not say.
        base: BaseVisibility,
    },
}

/// Two data sets that are compared, `A` and `B`, of which `B` may be the simulator.
pub struct Comparer {
    sides: [Side; 2],
    pairs: Vec<Pair>,
    points: usize,
    emd_points: usize,
    seed: u64,
}

/// One of them.
struct Side {
    entries: Vec<Entry>,
    clouds: Clouds,
    /// Where the discs are under a condition, where the clouds are simulated.
    shapes: Option<Simulation>,
    /// How the clouds would be simulated, where the data set says what they show.
    recipe: Option<Recipe>,
}

/// Where clouds come from.
enum Clouds {
    /// From a data set: its splits in the order of [`Split::ALL`].
    Stored([SplitSamples; 3]),
    /// From the side's simulation.
    Seen,
}

/// One configuration in both.
#[derive(Clone, Debug, Serialize)]
pub struct Configuration {
    /// Place of the sample in `A`.
    pub a: Place,
    /// Place of the sample in `B`; `None` of the simulator.
    pub b: Option<Place>,
    /// The command in `A`: a value for each motor.
    pub command: Vec<f32>,
    /// Mass hung from the tip in `A` (kg); `None` in a data set without payloads.
    pub payload: Option<f32>,
    /// Largest difference of a number of both conditions, as a part of its range.
    pub condition_difference: f64,
    /// Distances of the clouds.
    #[serde(flatten)]
    pub distances: Distances,
    /// Distance of the tips (m); `None` where it is not known.
    pub tip: Option<f64>,
}

/// How the distance of two tips is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum TipSource {
    /// Both robots are settled again.
    Settled,
    /// One is settled; its last disc is laid onto the cloud of the other.
    Laid,
}

/// A distance over all configurations, in its unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Mean.
    pub mean: f64,
    /// Quantiles.
    #[serde(flatten)]
    pub quantiles: Quantiles,
}

/// All that `tdcr compare --json` says.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// Configurations in common.
    pub pairs: usize,
    /// Samples of `A` and of `B` that are in no pair.
    pub unpaired: [usize; 2],
    /// Points of each cloud that the Chamfer distance is computed on.
    pub points: usize,
    /// Points of each cloud that the earth mover's distances are computed on.
    pub emd_points: usize,
    /// Squared Chamfer distance (m²).
    pub cd: Spread,
    /// Earth mover's distance (m).
    pub emd: Spread,
    /// Least mean squared distance (m²).
    pub emd_squared: Spread,
    /// Distance of the tips (m), over the configurations where it is known; `None` where it is known of none.
    pub tip: Option<Spread>,
    /// How the distances of tips are known.
    pub tip_source: Option<TipSource>,
    /// Places in `configurations` of those with the greatest Chamfer distances, the worst first.
    pub worst: Vec<usize>,
    /// Each configuration, in the order of `A`.
    pub configurations: Vec<Configuration>,
}

impl Spread {
    /// Of some values; `None` of none.
    fn of(values: Vec<f64>) -> Option<Self> {
        (!values.is_empty()).then(|| Self {
            mean: values.iter().sum::<f64>() / values.len() as f64,
            quantiles: Quantiles::of(values),
        })
    }
}

/// How the clouds of a data set would be simulated; `None` where it does not say which robot they show.
fn recipe(origin: &Origin) -> Option<Recipe> {
    match origin {
        Origin::Simulated { recipe, .. } => Some(recipe.clone()),
        Origin::Recorded { recording } => Some(Recipe {
            subject: Subject {
                robot: recording.robot.clone(),
                base: recording.base,
                payload: None,
                scene: Scene::default(),
                obstacles: None,
            },
            voxel_size: recording.voxel_size,
            sensor: None,
        }),
        _ => None,
    }
}

impl Side {
    /// The data set in a folder.
    fn open(dir: &Path, split: Option<Split>) -> Result<Self, PipelineError> {
        let set = DataSet::open(dir)?;
        let mut entries = Vec::new();
        for found in Split::ALL {
            if split.is_none_or(|split| split == found) {
                let conditions = set.conditions(found)?.into_iter().enumerate();
                entries.extend(conditions.map(|(index, condition)| Entry {
                    place: Place {
                        split: found,
                        index,
                    },
                    condition,
                }));
            }
        }
        let [train, val, test] = Split::ALL.map(|split| set.samples(split));
        let splits = [train?, val?, test?];
        let origin = set.meta().map(|meta| &meta.origin);
        let recipe = origin.and_then(recipe);
        let simulated = origin.and_then(Origin::recipe).cloned();
        let shapes = simulated.map(|recipe| Simulation::new(recipe, splits[0].points_per_cloud()));
        Ok(Self {
            entries,
            shapes: shapes.transpose()?,
            recipe,
            clouds: Clouds::Stored(splits),
        })
    }

    /// The simulator under the conditions of `of`, which is in the folder `dir`.
    fn simulator(
        of: &Self,
        dir: &Path,
        robot: Option<&RobotSpec>,
        base: BaseVisibility,
    ) -> Result<Self, PipelineError> {
        let own = of.recipe.as_ref();
        let robot = robot.or_else(|| own.map(|recipe| &recipe.subject.robot));
        let robot = robot.ok_or_else(|| CompareError::NoRobot {
            path: dir.to_owned(),
        })?;
        let recipe = Recipe {
            subject: Subject {
                robot: robot.clone(),
                base: own.map_or(base, |recipe| recipe.subject.base),
                payload: own.and_then(|recipe| recipe.subject.payload),
                scene: own.map_or_else(Scene::default, |recipe| recipe.subject.scene.clone()),
                obstacles: own.and_then(|recipe| recipe.subject.obstacles),
            },
            sensor: None,
            ..own.cloned().unwrap_or_default()
        };
        let points = of.fewest_points();
        Ok(Self {
            entries: of.entries.clone(),
            clouds: Clouds::Seen,
            recipe: Some(recipe.clone()),
            shapes: Some(Simulation::new(recipe, points)?),
        })
    }

    /// Points that every cloud has.
    fn fewest_points(&self) -> usize {
        match &self.clouds {
            Clouds::Stored(splits) => {
                let points = splits.iter().map(SplitSamples::points_per_cloud);
                points.min().unwrap_or(0)
            }
            Clouds::Seen => self.shapes.as_ref().map_or(0, Simulation::points),
        }
    }

    /// The cloud of an entry, and where its discs are, if that is known.
    fn cloud(&self, entry: usize, seed: u64) -> Result<PointCloud, PipelineError> {
        let Entry { place, condition } = &self.entries[entry];
        match (&self.clouds, &self.shapes) {
            (Clouds::Stored(splits), _) => {
                let split = Split::ALL.iter().position(|&split| split == place.split);
                let samples = &splits[split.unwrap_or(0)];
                let mut read = samples.read(place.index..place.index + 1)?;
                Ok(std::mem::take(&mut read[0].cloud))
            }
            (Clouds::Seen, Some(shapes)) => Ok(shapes.view(condition, seed, entry)?),
            (Clouds::Seen, None) => Ok(PointCloud::default()),
        }
    }
}

impl Comparer {
    /// Prepares to compare the data set in the folder `a` with `b`.
    ///
    /// # Errors
    /// [`PipelineError`] where a data set cannot be read, they have other numbers of motors or nothing in common, no robot is
    /// known that could be simulated, or there are fewer points than are to be compared.
    pub fn new(
        a: &Path,
        b: Reference<'_>,
        settings: &CompareSettings,
    ) -> Result<Self, PipelineError> {
        let first = Side::open(a, settings.split())?;
        let (second, pairs) = match b {
            Reference::Set(b) => {
                let second = Side::open(b, settings.split())?;
                let pairs = settings.pairing().pairs(&first.entries, &second.entries)?;
                (second, pairs)
            }
            Reference::Simulator { robot, base } => {
                let pairs = (0..first.entries.len()).map(|k| Pair {
                    entries: [k, k],
                    apart: 0.0,
                });
                let second = Side::simulator(&first, a, robot, base)?;
                (second, pairs.collect())
            }
        };
        let most = first.fewest_points().min(second.fewest_points());
        let counts = EvalSettings {
            points: settings.points,
            emd_points: settings.emd_points,
            ..EvalSettings::default()
        };
        let Scoring {
            points, emd_points, ..
        } = Scoring::new(&counts, most, most)?;
        Ok(Self {
            sides: [first, second],
            pairs,
            points,
            emd_points,
            seed: settings.seed,
        })
    }

    /// The robot of `A`, or else of `B`; `None` where neither names one.
    pub fn robot(&self) -> Option<&RobotSpec> {
        let recipes = self.sides.iter().filter_map(|side| side.recipe.as_ref());
        recipes.map(|recipe| &recipe.subject.robot).next()
    }

    /// Compares all configurations; the `worst` worst are listed.
    ///
    /// # Errors
    /// [`PipelineError`] for an interruption, a cloud that cannot be read, and a robot that does not settle.
    pub fn run(&self, worst: usize, monitor: &dyn Monitor) -> Result<Comparison, PipelineError> {
        monitor.begin("compare", self.pairs.len() as u64, 0);
        let configurations = (0..self.pairs.len()).into_par_iter().map(|pair| {
            if monitor.interrupted() {
                return Err(PipelineError::Abandoned);
            }
            let configuration = self.configuration(pair)?;
            monitor.advance(1);
            Ok(configuration)
        });
        let configurations: Vec<Configuration> = configurations.collect::<Result<_, _>>()?;
        monitor.end();
        let over = |pick: fn(&Distances) -> f64| {
            let values = configurations.iter().map(|c| pick(&c.distances)).collect();
            Spread::of(values).expect("a comparison has a configuration")
        };
        let mut order: Vec<usize> = (0..configurations.len()).collect();
        let cd = |&k: &usize| configurations[k].distances.cd;
        order.sort_by(|a, b| cd(b).total_cmp(&cd(a)));
        order.truncate(worst);
        let tip = Spread::of(configurations.iter().filter_map(|c| c.tip).collect());
        let unpaired = |side: usize| self.sides[side].entries.len() - self.pairs.len();
        Ok(Comparison {
            pairs: self.pairs.len(),
            unpaired: [unpaired(0), unpaired(1)],
            points: self.points,
            emd_points: self.emd_points,
            cd: over(|d| d.cd),
            emd: over(|d| d.emd),
            emd_squared: over(|d| d.emd_squared),
            tip,
            tip_source: tip.and(self.tip_source()),
            worst: order,
            configurations,
        })
    }

    /// The clouds of a configuration in `A` and in `B`, whole.
    ///
    /// # Errors
    /// [`PipelineError`] where one cannot be read or simulated.
    pub fn clouds(&self, configuration: usize) -> Result<[PointCloud; 2], PipelineError> {
        let [a, b] = self.pairs[configuration].entries;
        let [first, second] = &self.sides;
        Ok([first.cloud(a, self.seed)?, second.cloud(b, self.seed)?])
    }

    fn configuration(&self, pair: usize) -> Result<Configuration, PipelineError> {
        let Pair { entries, apart } = self.pairs[pair];
        let clouds = self.clouds(pair)?;
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(pair as u64);
        let [p, q] = clouds.map(|cloud| subset(self.points, &cloud.points, &mut rng));
        let few = self.emd_points;
        let distances = distances([&q, &p], [&q[..few], &p[..few]])?;
        let [a, b] = [0, 1].map(|side| &self.sides[side].entries[entries[side]]);
        let stored = matches!(self.sides[1].clouds, Clouds::Stored(_));
        Ok(Configuration {
            a: a.place,
            b: stored.then_some(b.place),
            command: a.condition.motors.clone(),
            payload: a.condition.payload,
            condition_difference: apart,
            distances,
            tip: self.tip(entries, [&p, &q])?,
        })
    }

    fn tip_source(&self) -> Option<TipSource> {
        match self
            .sides
            .iter()
            .filter(|side| side.shapes.is_some())
            .count()
        {
            0 => None,
            1 => Some(TipSource::Laid),
            _ => Some(TipSource::Settled),
        }
    }

    /// Distance of the tips (m).
    fn tip(
        &self,
        entries: [usize; 2],
        clouds: [&[[f32; 3]]; 2],
    ) -> Result<Option<f64>, PipelineError> {
        let settle = |side: usize| {
            let Side {
                entries: list,
                shapes,
                ..
            } = &self.sides[side];
            let shapes = shapes.as_ref()?;
            let settled = shapes.settle(&list[entries[side]].condition);
            Some(settled.map(|settled| (&shapes.robot, settled)))
        };
        let laid = |robot: &Robot, settled, known: usize| {
            tip_error(robot, settled, clouds[known], clouds[1 - known])
        };
        Ok(match [settle(0).transpose()?, settle(1).transpose()?] {
            [None, None] => None,
            [Some((robot, settled)), None] => laid(robot, &settled, 0)?,
            [None, Some((robot, settled))] => laid(robot, &settled, 1)?,
            [Some((_, a)), Some((_, b))] => {
                let tips = a.positions.last().zip(b.positions.last());
                tips.map(|(a, b)| (a - b).norm())
            }
        })
    }
}

//! From conditions to a data set of clouds.

use std::ops::{ControlFlow, Range};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use rayon::prelude::*;
use serde::Serialize;
use tdcr_learn::data::{
    self, Collector, Condition, DataSet, ExportFormat, ImportSettings, Imported, Meta,
    ObstacleDraws, Recipe, SimulationTimes, Simulator, conditions_among,
};
use tdcr_sim::geometry::Stand;
use tdcr_sim::robot::{Robot, RobotSpec};
use tdcr_sim::scene::Scene;

use super::{CollectSettings, Monitor, PipelineError};

/// Time that collecting took, added up over the threads but for the shards (s).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct CollectTimes {
    /// Settling the robot.
    pub settle: f64,
    /// Rendering, back-projection and voxels.
    pub see: f64,
    /// Drawing the points that are kept.
    pub sample: f64,
    /// Writing samples as they come.
    pub write: f64,
    /// Writing the shards in the end, wall clock.
    pub shards: f64,
}

/// How many of the samples have poses that a real robot may not reach, or that obstacles shape. None is refused.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct PoseCounts {
    /// The robot touches obstacles.
    pub in_contact: usize,
    /// It goes through the floor that its base stands on.
    pub below_ground: usize,
    /// It goes through the base that cameras may see, in view or not.
    pub through_base: usize,
}

impl PoseCounts {
    /// Counts the pose in which `simulator` last settled.
    fn count(&mut self, simulator: &Simulator, stand: &Stand) {
        let pose = simulator.equilibrium().pose();
        let through = stand.overlaps(pose.positions, pose.orientations);
        self.in_contact += usize::from(!simulator.contacts().is_empty());
        self.below_ground += usize::from(through.floor);
        self.through_base += usize::from(through.base);
    }

    fn add(&mut self, other: Self) {
        self.in_contact += other.in_contact;
        self.below_ground += other.below_ground;
        self.through_base += other.through_base;
    }

    /// What there is to say of `samples` samples; `None` where all counts are 0.
    pub fn phrase(&self, samples: usize) -> Option<String> {
        let counts = [
            (self.in_contact, "touch obstacles"),
            (self.below_ground, "go below the ground"),
            (self.through_base, "go through the base"),
        ];
        let counts = counts.iter().filter(|(count, _)| *count > 0);
        let counts: Vec<String> = counts
            .map(|(count, what)| format!("{count} {what}"))
            .collect();
        (!counts.is_empty()).then(|| format!("of {samples} poses {}", counts.join(", ")))
    }
}

/// What came of collecting.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Collected {
    /// Time of this run.
    pub times: CollectTimes,
    /// Poses of all samples of the data set or the part, those made before included.
    pub poses: PoseCounts,
}

impl CollectTimes {
    fn add(&mut self, simulation: SimulationTimes, write: Duration) {
        self.settle += simulation.settle.as_secs_f64();
        self.see += simulation.see.as_secs_f64();
        self.sample += simulation.sample.as_secs_f64();
        self.write += write.as_secs_f64();
    }
}

/// Settles the robot in `scene` under the conditions of a design, sees it, and writes the clouds to the folder `dir`.
///
/// Obstacles hide from the cameras what is behind them; the clouds are of the robot alone.
///
/// Sample `i` is a function of the settings and `i` alone, so an interrupted collection that is taken
/// up, on any number of threads, gives the files of an uninterrupted one. So does a set of fewer samples that grows, where the
/// design allows it ([`Design::can_grow`](data::Design::can_grow)); but the splits are drawn anew, and networks that were trained on the smaller set
/// have seen samples that now test.
///
/// Parts of a data set are made by as many calls, anywhere, each in a folder of its own.
///
/// # Errors
/// [`PipelineError`]: a robot that is refused or does not settle, a folder that cannot be written or
/// holds something else, or an interruption.
pub fn collect(
    robot: &RobotSpec,
    scene: &Scene,
    settings: &CollectSettings,
    dir: &Path,
    monitor: &dyn Monitor,
) -> Result<Collected, PipelineError> {
    let recipe = settings.recipe(robot, scene);
    recipe.check()?;
    let meta = settings.meta(&recipe);
    let robot = Robot::new(robot.clone())?;
    let CollectSettings {
        payload,
        design,
        samples,
        seed,
        ..
    } = *settings;
    let obstacles = settings.vary_obstacles;
    let obstacles = obstacles.map(|variation| ObstacleDraws::new(variation, scene, &robot));
    let obstacles = obstacles.transpose()?;
    let conditions = conditions_among(&robot, payload, obstacles.as_ref(), design, samples, seed)?;
    let collector = match settings.part {
        None => Collector::open(dir, &meta)?,
        Some(part) => Collector::open_part(dir, &meta, part)?,
    };
    let maker = Maker {
        settings,
        stand: Stand::new(&robot),
        robot,
        recipe,
        conditions,
        monitor,
    };
    let mut collected = match maker.make_missing(&collector) {
        Ok(collected) => collected,
        Err(error) => {
            if let Err(left) = collector.abandon() {
                tracing::warn!("{left}");
            }
            return Err(error);
        }
    };
    let began = Instant::now();
    collector.finish(stage("write shards", monitor))?;
    collected.times.shards = began.elapsed().as_secs_f64();
    Ok(collected)
}

/// What samples are made by.
struct Maker<'a> {
    settings: &'a CollectSettings,
    robot: Robot,
    stand: Stand,
    recipe: Recipe,
    conditions: Vec<Condition>,
    monitor: &'a dyn Monitor,
}

impl Maker<'_> {
    /// The samples of the data set or the part.
    fn samples(&self) -> Range<usize> {
        let all = self.settings.samples;
        self.settings.part.map_or(0..all, |part| part.range(all))
    }

    /// Makes and stores the samples that are missing.
    fn make_missing(&self, collector: &Collector) -> Result<Collected, PipelineError> {
        collector.keep_samples(stage("keep samples", self.monitor))?;
        let missing = collector.missing_blocks();
        let mut poses = self.count_kept(&missing)?;
        let mut collected = self.simulate(missing, collector)?;
        poses.add(collected.poses);
        collected.poses = poses;
        Ok(collected)
    }

    /// Makes and stores the blocks that are missing.
    fn simulate(
        &self,
        blocks: Vec<Range<usize>>,
        collector: &Collector,
    ) -> Result<Collected, PipelineError> {
        let missing: usize = blocks.iter().map(ExactSizeIterator::len).sum();
        if missing > 0 {
            let count = self.samples().len();
            let made = (count - missing) as u64;
            self.monitor.begin("collect", count as u64, made);
        }
        let collected = Mutex::new(Collected::default());
        blocks.into_par_iter().try_for_each_init(
            || Simulator::new(&self.robot, &self.recipe),
            |simulator, block| self.make_block(simulator, block, collector, &collected),
        )?;
        self.monitor.end();
        Ok(collected.into_inner().unwrap_or_default())
    }

    fn make_block(
        &self,
        simulator: &mut Simulator,
        block: Range<usize>,
        collector: &Collector,
        collected: &Mutex<Collected>,
    ) -> Result<(), PipelineError> {
        if self.monitor.interrupted() {
            return Err(PipelineError::Interrupted);
        }
        let first = block.start;
        let before = simulator.times();
        let mut poses = PoseCounts::default();
        let CollectSettings { points, seed, .. } = *self.settings;
        let mut samples = Vec::with_capacity(block.len());
        for index in block {
            let condition = self.conditions[index].clone();
            samples.push(simulator.sample(condition, points, seed, index as u64)?);
            poses.count(simulator, &self.stand);
        }
        let began = Instant::now();
        collector.write_block(first, &samples)?;
        let spent = simulator.times() - before;
        if let Ok(mut collected) = collected.lock() {
            collected.times.add(spent, began.elapsed());
            collected.poses.add(poses);
        }
        self.monitor.advance(samples.len() as u64);
        Ok(())
    }

    /// Counts the poses of the samples that are not in the blocks `missing`, in ascending order: they are settled again,
    /// which takes a small part of the time that making them took.
    fn count_kept(&self, missing: &[Range<usize>]) -> Result<PoseCounts, PipelineError> {
        let mut kept: Vec<usize> = self.samples().collect();
        kept.retain(|&index| {
            let block = missing.partition_point(|block| block.end <= index);
            missing.get(block).is_none_or(|block| index < block.start)
        });
        let poses = Mutex::new(PoseCounts::default());
        kept.into_par_iter().try_for_each_init(
            || Simulator::new(&self.robot, &self.recipe),
            |simulator, index| {
                if self.monitor.interrupted() {
                    return Err(PipelineError::Interrupted);
                }
                simulator.settle(&self.conditions[index])?;
                if let Ok(mut poses) = poses.lock() {
                    poses.count(simulator, &self.stand);
                }
                Ok(())
            },
        )?;
        Ok(poses.into_inner().unwrap_or_default())
    }
}

/// Puts the parts of a data set in the folders `parts`, in any order, together in the folder `out`: byte for byte the files of
/// [`collect`] without parts. The parts are only read. Interrupted, the same call begins anew.
///
/// # Errors
/// [`PipelineError::Data`] where the folders are not the parts of one data set, each finished and there once, or `out` holds
/// something else or cannot be written; an interruption.
pub fn merge(parts: &[PathBuf], out: &Path, monitor: &dyn Monitor) -> Result<Meta, PipelineError> {
    Ok(data::merge(parts, out, stage("merge", monitor))?)
}

/// Makes a data set of clouds of other programs, as [`data::import`].
///
/// # Errors
/// [`PipelineError::Interrupted`]: the same call goes on; [`PipelineError::Data`].
pub fn import(
    dir: &Path,
    out: &Path,
    settings: &ImportSettings,
    monitor: &dyn Monitor,
) -> Result<Imported, PipelineError> {
    let [read, write] = ["import", "write shards"].map(|name| stage(name, monitor));
    Ok(data::import(dir, out, settings, read, write)?)
}

/// Writes the clouds of a data set as files of their own, as [`data::export`].
///
/// # Errors
/// [`PipelineError::Interrupted`], with nothing left behind; [`PipelineError::Data`].
pub fn export(
    set: &DataSet,
    format: ExportFormat,
    out: &Path,
    monitor: &dyn Monitor,
) -> Result<usize, PipelineError> {
    Ok(data::export(set, format, out, stage("export", monitor))?)
}

/// Tells `monitor` of a stage whose steps are called out, those done and those in all, after each and perhaps before the first; breaks
/// off when it says so.
pub(super) fn stage(
    name: &'static str,
    monitor: &dyn Monitor,
) -> impl FnMut(usize, usize) -> ControlFlow<()> {
    let mut begun = false;
    move |done, steps| {
        if !begun {
            monitor.begin(name, steps as u64, 0);
            begun = true;
        }
        if done > 0 {
            monitor.advance(1);
        }
        if done == steps {
            monitor.end();
        } else if monitor.interrupted() {
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    }
}

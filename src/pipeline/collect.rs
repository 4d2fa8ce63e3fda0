//! From conditions to a data set of clouds.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use rayon::prelude::*;
use serde::Serialize;
use tdcr_learn::data::{
    self, Collector, Condition, DataSet, ExportFormat, ImportSettings, Imported, Meta, Sample,
    SimulationTimes, Simulator, conditions,
};
use tdcr_sim::robot::{Robot, RobotSpec};

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

impl CollectTimes {
    fn add(&mut self, simulation: SimulationTimes, write: Duration) {
        self.settle += simulation.settle.as_secs_f64();
        self.see += simulation.see.as_secs_f64();
        self.sample += simulation.sample.as_secs_f64();
        self.write += write.as_secs_f64();
    }
}

/// Settles the robot under the conditions of a design, sees it, and writes the clouds to the folder `dir`.
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
    settings: &CollectSettings,
    dir: &Path,
    monitor: &dyn Monitor,
) -> Result<CollectTimes, PipelineError> {
    let meta = settings.meta(robot);
    let robot = Robot::new(robot.clone())?;
    let CollectSettings {
        payload,
        design,
        samples,
        seed,
        ..
    } = *settings;
    let conditions = conditions(&robot, payload, design, samples, seed)?;
    let collector = match settings.part {
        None => Collector::open(dir, &meta)?,
        Some(part) => Collector::open_part(dir, &meta, part)?,
    };
    collector.keep_samples(stage("keep samples", monitor))?;
    let mut times = simulate(settings, &robot, &conditions, &collector, monitor)?;
    let began = Instant::now();
    collector.finish(stage("write shards", monitor))?;
    times.shards = began.elapsed().as_secs_f64();
    Ok(times)
}

/// Makes and stores the blocks that are missing.
fn simulate(
    settings: &CollectSettings,
    robot: &Robot,
    conditions: &[Condition],
    collector: &Collector,
    monitor: &dyn Monitor,
) -> Result<CollectTimes, PipelineError> {
    let blocks = collector.missing_blocks();
    let missing: usize = blocks.iter().map(ExactSizeIterator::len).sum();
    if missing > 0 {
        let count = match settings.part {
            None => settings.samples,
            Some(part) => part.range(settings.samples).len(),
        };
        monitor.begin("collect", count as u64, (count - missing) as u64);
    }
    let recipe = settings.recipe(robot.spec());
    let times = Mutex::new(CollectTimes::default());
    blocks.into_par_iter().try_for_each_init(
        || Simulator::new(robot, &recipe),
        |simulator, block| {
            if monitor.interrupted() {
                return Err(PipelineError::Interrupted);
            }
            let first = block.start;
            let before = simulator.times();
            let sample = |index: usize| {
                let condition = conditions[index].clone();
                simulator.sample(condition, settings.points, settings.seed, index as u64)
            };
            let samples: Vec<Sample> = block.map(sample).collect::<Result<_, _>>()?;
            let began = Instant::now();
            collector.write_block(first, &samples)?;
            let spent = simulator.times() - before;
            if let Ok(mut times) = times.lock() {
                times.add(spent, began.elapsed());
            }
            monitor.advance(samples.len() as u64);
            Ok(())
        },
    )?;
    monitor.end();
    Ok(times.into_inner().unwrap_or_default())
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

//! From conditions to a data set of clouds.

use std::path::Path;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use rayon::prelude::*;
use serde::Serialize;
use tdcr_learn::data::{
    Collector, Condition, DataError, Design, Meta, Origin, PayloadRange, Recipe, Sample,
    SimulationTimes, Simulator, Subject, conditions,
};
use tdcr_sim::render::{BaseVisibility, Sensor};
use tdcr_sim::robot::{Robot, RobotSpec};

use super::{Monitor, PipelineError};

/// Samples per file on disk.
const SAMPLES_PER_SHARD: usize = 250;

/// What a data set is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct CollectSettings {
    /// The robot, and the cameras that see it.
    pub robot: RobotSpec,
    /// Whether the cameras see the base.
    pub base: BaseVisibility,
    /// Payloads at the tip; `None` for a data set without.
    pub payload: Option<PayloadRange>,
    /// How the conditions are chosen.
    pub design: Design,
    /// Number of conditions, all splits together.
    pub count: usize,
    /// Points per cloud.
    pub points: usize,
    /// Edge of the voxel grid that thins the fused clouds (m).
    pub voxel_size: f64,
    /// Faults of the cameras; `None` where they see the truth.
    pub sensor: Option<Sensor>,
    /// Seed of conditions, samples, faults and splits.
    pub seed: u64,
}

/// 1,000 clouds of 10,000 points of the default recipe, under uniform commands: those of the command line.
impl Default for CollectSettings {
    fn default() -> Self {
        let Recipe {
            subject,
            voxel_size,
            sensor,
        } = Recipe::default();
        Self {
            robot: subject.robot,
            base: subject.base,
            payload: subject.payload,
            design: Design::Uniform,
            count: 1000,
            points: 10_000,
            voxel_size,
            sensor,
            seed: 0,
        }
    }
}

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

impl CollectSettings {
    fn recipe(&self) -> Recipe {
        Recipe {
            subject: Subject {
                robot: self.robot.clone(),
                base: self.base,
                payload: self.payload,
            },
            voxel_size: self.voxel_size,
            sensor: self.sensor,
        }
    }

    fn meta(&self) -> Meta {
        Meta {
            format: Meta::FORMAT,
            tdcr_version: env!("CARGO_PKG_VERSION").to_owned(),
            seed: self.seed,
            count: self.count,
            motors: self.robot.tendon_count(),
            points_per_cloud: self.points,
            samples_per_shard: SAMPLES_PER_SHARD,
            origin: Origin::Simulated {
                recipe: self.recipe(),
                design: self.design,
            },
        }
    }
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
/// design allows it ([`Design::can_grow`]); but the splits are drawn anew, and networks that were trained on the smaller set
/// have seen samples that now test.
///
/// # Errors
/// [`PipelineError`]: a robot that is refused or does not settle, a folder that cannot be written or
/// holds something else, or an interruption.
pub fn collect(
    settings: &CollectSettings,
    dir: &Path,
    monitor: &dyn Monitor,
) -> Result<CollectTimes, PipelineError> {
    let robot = Robot::new(settings.robot.clone())?;
    let CollectSettings {
        payload,
        design,
        count,
        seed,
        ..
    } = *settings;
    let conditions = conditions(&robot, payload, design, count, seed)?;
    let collector = Collector::open(dir, &settings.meta())?;
    keep_samples(&collector, monitor)?;
    let mut times = simulate(settings, &robot, &conditions, &collector, monitor)?;
    let began = Instant::now();
    finish(collector, monitor)?;
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
        let count = settings.count;
        monitor.begin("collect", count as u64, (count - missing) as u64);
    }
    let recipe = settings.recipe();
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

/// Keeps the samples of a smaller set.
fn keep_samples(collector: &Collector, monitor: &dyn Monitor) -> Result<(), DataError> {
    collector.keep_samples(stage("keep samples", monitor))
}

fn finish(collector: Collector, monitor: &dyn Monitor) -> Result<(), DataError> {
    collector.finish(stage("write shards", monitor))
}

/// Tells `monitor` of a stage whose steps are called out, those done and those in all.
fn stage(name: &'static str, monitor: &dyn Monitor) -> impl FnMut(usize, usize) {
    let mut begun = false;
    move |done, steps| {
        if !begun {
            monitor.begin(name, steps as u64, 0);
            begun = true;
        }
        monitor.advance(1);
        if done == steps {
            monitor.end();
        }
    }
}

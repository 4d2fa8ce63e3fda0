//! From random commands to a data set of clouds.

use std::path::Path;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use tdcr_learn::data::{Collector, DataError, Meta, Sample};
use tdcr_sim::cloud::{Observer, VoxelGrid};
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::robot::{Command, Loads, Robot, RobotSpec};
use tdcr_sim::statics::Settler;

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
    /// Number of commands, all splits together.
    pub count: usize,
    /// Points per cloud.
    pub points: usize,
    /// Edge of the voxel grid that thins the fused clouds (m).
    pub voxel_size: f64,
    /// Seed of commands, samples and splits.
    pub seed: u64,
}

impl CollectSettings {
    fn meta(&self) -> Meta {
        Meta {
            format: Meta::FORMAT,
            tdcr_version: env!("CARGO_PKG_VERSION").to_owned(),
            seed: self.seed,
            count: self.count,
            motors: self.robot.tendon_count(),
            points_per_cloud: self.points,
            samples_per_shard: SAMPLES_PER_SHARD,
            voxel_size: self.voxel_size,
            robot: self.robot.clone(),
            base: self.base,
        }
    }
}

/// Settles the robot under random commands, sees it, and writes the clouds to the folder `dir`.
///
/// Sample `i` is a function of the settings and `i` alone, so an interrupted collection that is taken
/// up, on any number of threads, gives the files of an uninterrupted one.
///
/// # Errors
/// [`PipelineError`]: a robot that is refused or does not settle, a folder that cannot be written or
/// holds something else, or an interruption.
pub fn collect(
    settings: &CollectSettings,
    dir: &Path,
    monitor: &dyn Monitor,
) -> Result<(), PipelineError> {
    let robot = Robot::new(settings.robot.clone())?;
    let collector = Collector::open(dir, &settings.meta())?;
    let blocks = collector.missing_blocks();
    let missing: usize = blocks.iter().map(ExactSizeIterator::len).sum();
    if missing > 0 {
        monitor.begin(
            "collect",
            settings.count as u64,
            (settings.count - missing) as u64,
        );
    }
    let grid = VoxelGrid::new(settings.voxel_size);
    let tools = || {
        (
            Settler::new(&robot),
            Observer::new(&robot, settings.base, grid),
        )
    };
    blocks
        .into_par_iter()
        .try_for_each_init(tools, |(settler, observer), block| {
            if monitor.interrupted() {
                return Err(PipelineError::Interrupted);
            }
            let first = block.start;
            let samples: Vec<Sample> = block
                .map(|index| sample(settings, index, &robot, settler, observer))
                .collect::<Result<_, _>>()?;
            collector.write_block(first, &samples)?;
            monitor.advance(samples.len() as u64);
            Ok(())
        })?;
    monitor.end();
    finish(collector, monitor)?;
    Ok(())
}

fn finish(collector: Collector, monitor: &dyn Monitor) -> Result<(), DataError> {
    let mut begun = false;
    collector.finish(|done, steps| {
        if !begun {
            monitor.begin("write shards", steps as u64, 0);
            begun = true;
        }
        monitor.advance(1);
        if done == steps {
            monitor.end();
        }
    })
}

fn sample(
    settings: &CollectSettings,
    index: usize,
    robot: &Robot,
    settler: &mut Settler,
    observer: &mut Observer,
) -> Result<Sample, PipelineError> {
    let mut rng = ChaCha8Rng::seed_from_u64(settings.seed);
    rng.set_stream(index as u64);
    let command = stored(robot, &robot.random_command(&mut rng));
    let equilibrium = settler.settle(&command, &Loads::default());
    if !equilibrium.converged {
        return Err(PipelineError::NotSettled {
            residual: equilibrium.residual,
            command: command.as_slice().to_vec(),
        });
    }
    let cloud = observer
        .observe(equilibrium)
        .sample_or_pad(settings.points, &mut rng);
    Ok(Sample {
        motors: command
            .as_slice()
            .iter()
            .map(|length| *length as f32)
            .collect(),
        cloud,
    })
}

/// The command as a data set stores it, in `f32`: settled as it will be read.
fn stored(robot: &Robot, command: &Command) -> Command {
    let rounded: Vec<f64> = (command.as_slice().iter().zip(robot.tendons()))
        .map(|(length, tendon)| {
            let [low, high] = tendon.range;
            f64::from(*length as f32).clamp(low, high)
        })
        .collect();
    robot
        .command(&rounded)
        .expect("clamped to the tendons' ranges")
}

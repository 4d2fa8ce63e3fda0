//! From a rig to a data set of clouds.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Instant;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use serde_json::json;
use tdcr_hw::capture::{Captured, Sentinel, Session, SessionSettings, StillDepth};
use tdcr_hw::rig::{Rig, RigSpec};
use tdcr_learn::data::{Collector, Condition, DataError, Meta, Origin, Recording, Sample};

use super::collect::stage;
use super::journal::Journal;
use super::{Monitor, PipelineError};

/// Samples per file on disk.
const SAMPLES_PER_SHARD: usize = 250;

/// What was recorded besides the clouds: a file of JSON lines in the data set's folder.
const JOURNAL: &str = "capture.jsonl";

/// Layout of that file.
const FORMAT: u32 = 1;

/// What is captured.
#[derive(Clone, Debug, PartialEq)]
pub struct CaptureSettings {
    /// Number of commands, all splits together.
    pub count: usize,
    /// Points per cloud.
    pub points: usize,
    /// Edge of the voxel grid that thins the fused clouds (m).
    pub voxel_size: f64,
    /// Seed of the commands, of the points that are kept and of the splits.
    pub seed: u64,
    /// Samples between two looks at the robot in its home pose.
    pub sentinel_every: usize,
}

/// 200 clouds of 10,000 points, with a look at the robot at home after every 25.
impl Default for CaptureSettings {
    fn default() -> Self {
        Self {
            count: 200,
            points: 10_000,
            voxel_size: 0.002,
            seed: 0,
            sentinel_every: 25,
        }
    }
}

/// How a capture went. Of a capture that was resumed, what is in its journal counts too.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CaptureReport {
    /// Samples of the data set.
    pub samples: usize,
    /// Samples that this run captured.
    pub captured: usize,
    /// Samples that were taken when patience came to its end and something still moved.
    pub moving: usize,
    /// Largest difference between the times of the pictures of a sample (s).
    pub skew: f64,
    /// Largest distance of a servo from its goal when pictures were taken (ticks).
    pub lag: i32,
    /// Looks at the robot in its home pose.
    pub sentinels: usize,
    /// How far the mean of what is seen at home moved since the first look, at the most (m).
    pub drift: f64,
    /// How much a servo's current at home changed since the first look, at the most (A).
    pub current_drift: f64,
    /// Time that servos rested because they were hot (s).
    pub rested: f64,
    /// Time that the rig took, by its own clock (s).
    pub rig_seconds: f64,
    /// Wall clock of this run (s).
    pub seconds: f64,
}

/// A line of the journal.
#[derive(Debug, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
enum Entry {
    /// A sample was taken.
    Sample(Record),
    /// The robot was looked at at home, before sample `before`.
    Sentinel {
        before: usize,
        #[serde(flatten)]
        sentinel: Sentinel,
    },
    /// Servos rested before sample `before`.
    Rest { before: usize, seconds: f64 },
}

/// What is known of a sample besides its cloud. One that was captured again is there again, the last one being that of the
/// data set.
#[derive(Debug, Serialize, Deserialize)]
struct Record {
    index: u64,
    /// Time of the rig's clock (s).
    time: f64,
    /// The command (m): the sample's condition.
    command: Vec<f64>,
    /// The same as positions of the servos, from home (ticks).
    ticks: Vec<i32>,
    /// Where the servos were (ticks).
    positions: Vec<i32>,
    /// Currents, positive where they pull (A).
    pulls: Vec<f64>,
    /// Points before the sample was drawn.
    points: usize,
    /// Difference between the times of the pictures (s).
    skew: f64,
    /// How long one waited until all was still (s).
    waited: f64,
    /// Whether it was.
    still: bool,
}

impl Record {
    fn of(captured: &Captured) -> Self {
        Self {
            index: captured.index,
            time: captured.time.as_secs_f64(),
            command: captured.command.clone(),
            ticks: captured.goals.iter().map(|goal| goal.0).collect(),
            positions: captured
                .states
                .iter()
                .map(|state| state.position.0)
                .collect(),
            pulls: captured.states.iter().map(|state| state.pull).collect(),
            points: captured.cloud.len(),
            skew: captured.skew.as_secs_f64(),
            waited: captured.stillness.waited.as_secs_f64(),
            still: captured.stillness.end == StillDepth::Still,
        }
    }
}

impl CaptureReport {
    fn count(&mut self, entry: &Entry) {
        match entry {
            Entry::Sample(record) => {
                self.moving += usize::from(!record.still);
                self.skew = self.skew.max(record.skew);
                let lags = record.ticks.iter().zip(&record.positions);
                let lag = lags.map(|(goal, position)| (goal - position).abs()).max();
                self.lag = self.lag.max(lag.unwrap_or(0));
            }
            Entry::Sentinel { sentinel, .. } => {
                self.sentinels += 1;
                self.drift = self.drift.max(sentinel.drift);
                self.current_drift = self.current_drift.max(sentinel.current_drift);
            }
            Entry::Rest { seconds, .. } => self.rested += seconds,
        }
    }
}

impl CaptureSettings {
    fn meta(&self, rig: &Rig) -> Meta {
        let RigSpec {
            name,
            base,
            servos,
            cameras,
            masks,
            commands,
            ..
        } = rig.spec();
        let sensors: Vec<_> = cameras
            .iter()
            .map(|camera| (&camera.serial, camera.sensor))
            .collect();
        // What a data set depends on: ports and speeds are none of it.
        let settings = json!({
            "ids": servos.ids,
            "directions": servos.directions,
            "spool_radius": servos.spool_radius,
            "home_tension": servos.home_tension,
            "limits": servos.limits,
            "cameras": sensors,
            "masks": masks,
            "commands": commands,
        });
        Meta {
            format: Meta::FORMAT,
            tdcr_version: env!("CARGO_PKG_VERSION").to_owned(),
            seed: self.seed,
            count: self.count,
            motors: rig.winches().len(),
            points_per_cloud: self.points,
            samples_per_shard: SAMPLES_PER_SHARD,
            origin: Origin::Recorded {
                recording: Recording {
                    rig: name.clone(),
                    robot: rig.robot().spec().clone(),
                    base: *base,
                    voxel_size: self.voxel_size,
                    settings,
                },
            },
        }
    }
}

/// Captures a data set with a rig in the folder `dir`: the layout of [`collect`](super::collect()), and beside it a journal of
/// what the servos did (`capture.jsonl`).
///
/// Command `i` follows from the rig's file, the seed and `i` alone. A capture that ended early, however it did, is resumed by
/// the same call, which loses at most seven samples; with a larger `count` the set grows. The tension is released whenever
/// the call returns.
///
/// # Errors
/// [`PipelineError::Capture`] where the rig stopped, [`PipelineError::Data`] for a folder that cannot be written or
/// holds something else, [`PipelineError::Interrupted`].
pub fn capture(
    rig: &mut Rig,
    settings: &CaptureSettings,
    dir: &Path,
    monitor: &dyn Monitor,
) -> Result<CaptureReport, PipelineError> {
    let began = Instant::now();
    let rig_began = rig.clock().now();
    let meta = settings.meta(rig);
    let collector = Collector::open(dir, &meta)?;
    collector.keep_samples(stage("keep samples", monitor))?;
    let blocks = collector.missing_blocks();
    let missing: usize = blocks.iter().map(ExactSizeIterator::len).sum();
    let mut report = CaptureReport {
        samples: settings.count,
        captured: missing,
        ..CaptureReport::default()
    };
    // A set that grows is one work.
    let key = json!({ "format": FORMAT, "seed": settings.seed, "origin": meta.origin });
    let (journal, entries) = Journal::open(&dir.join(JOURNAL), &key)?;
    entries.iter().for_each(|entry| report.count(entry));
    if missing > 0 {
        monitor.begin(
            "capture",
            settings.count as u64,
            (settings.count - missing) as u64,
        );
        let reference = entries.into_iter().find_map(|entry| match entry {
            Entry::Sentinel { sentinel, .. } => Some(sentinel),
            _ => None,
        });
        let mut go_on = || match monitor.interrupted() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        };
        let session = Session::begin(
            rig,
            &SessionSettings {
                seed: settings.seed,
                voxel_size: settings.voxel_size,
            },
            reference,
            &mut go_on,
        )?;
        let mut recorder = Recorder {
            settings,
            journal,
            report: &mut report,
            monitor,
        };
        // The servos are looked after while blocks go to the disk.
        let (blocks_out, blocks_in) = sync_channel(1);
        std::thread::scope(|scope| {
            let writer = scope.spawn(|| write(&collector, blocks_in));
            let captured = recorder.run(session, blocks, blocks_out);
            let written = writer
                .join()
                .unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            written?;
            captured
        })?;
        monitor.end();
    }
    collector.finish(stage("write shards", monitor))?;
    report.rig_seconds = rig.clock().now().saturating_sub(rig_began).as_secs_f64();
    report.seconds = began.elapsed().as_secs_f64();
    Ok(report)
}

/// Consecutive samples and the index of the first.
type Block = (usize, Vec<Sample>);

fn write(collector: &Collector, blocks: Receiver<Block>) -> Result<(), DataError> {
    blocks
        .into_iter()
        .try_for_each(|(first, samples)| collector.write_block(first, &samples))
}

/// Captures samples and keeps the journal.
struct Recorder<'a> {
    settings: &'a CaptureSettings,
    journal: Journal,
    report: &'a mut CaptureReport,
    monitor: &'a dyn Monitor,
}

impl Recorder<'_> {
    fn run(
        &mut self,
        mut session: Session<'_>,
        blocks: Vec<std::ops::Range<usize>>,
        out: SyncSender<Block>,
    ) -> Result<(), PipelineError> {
        let mut since = self.settings.sentinel_every;
        let mut last = 0;
        for block in blocks {
            let first = block.start;
            let mut samples = Vec::with_capacity(block.len());
            for index in block {
                if let Some(rested) = session.cool()? {
                    let seconds = rested.as_secs_f64();
                    self.add(&Entry::Rest {
                        before: index,
                        seconds,
                    })?;
                }
                if since >= self.settings.sentinel_every {
                    self.look(&mut session, index)?;
                    since = 0;
                }
                samples.push(self.sample(&mut session, index)?);
                (since, last) = (since + 1, index + 1);
                self.monitor.advance(1);
            }
            // The writer is gone only where it failed, and then says why.
            if out.send((first, samples)).is_err() {
                return Ok(());
            }
        }
        self.look(&mut session, last)?;
        session
            .end()
            .map_err(|error| PipelineError::Capture(error.into()))
    }

    fn look(&mut self, session: &mut Session<'_>, before: usize) -> Result<(), PipelineError> {
        let sentinel = session.sentinel()?;
        let note = format!("drift at home {:.2} mm", 1e3 * sentinel.drift);
        self.monitor.note(&note);
        self.add(&Entry::Sentinel { before, sentinel })
    }

    fn sample(&mut self, session: &mut Session<'_>, index: usize) -> Result<Sample, PipelineError> {
        let captured = session.sample(index as u64)?;
        self.add(&Entry::Sample(Record::of(&captured)))?;
        let mut rng = ChaCha8Rng::seed_from_u64(self.settings.seed);
        rng.set_stream(index as u64 | 1 << 63);
        Ok(Sample {
            condition: Condition {
                motors: captured
                    .command
                    .iter()
                    .map(|&command| command as f32)
                    .collect(),
                payload: None,
            },
            cloud: captured.cloud.sample_or_pad(self.settings.points, &mut rng),
        })
    }

    fn add(&mut self, entry: &Entry) -> Result<(), PipelineError> {
        self.report.count(entry);
        self.journal.add(entry)
    }
}

#[cfg(test)]
mod tests;

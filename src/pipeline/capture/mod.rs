//! From a rig to a data set of clouds.

use std::collections::BTreeSet;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Instant;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde_json::json;
use tdcr_hw::capture::{CaptureError, Session, SessionSettings};
use tdcr_hw::log::free_space;
use tdcr_hw::mask::MaskFolder;
use tdcr_hw::rig::Rig;
use tdcr_learn::data::{Collector, Condition, DataError, Sample};

use super::collect::stage;
use super::journal::Journal;
use super::{CaptureStop, Monitor, PipelineError};

mod record;
mod repeats;
mod settings;

pub use record::CaptureReport;
use record::{Entry, Record};
use repeats::Repeats;
pub use settings::CaptureSettings;

/// What was recorded besides the clouds: a file of JSON lines in the data set's folder.
const JOURNAL: &str = "capture.jsonl";

/// Stem of the names of logs in the data set's folder.
const LOG: &str = "log";

/// Layout of that file.
const FORMAT: u32 = 1;

/// Captures a data set with a rig in the folder `dir`: the layout of [`collect`](super::collect()), and beside it a journal of
/// what the servos did (`capture.jsonl`).
///
/// Command `i` follows from the rig's file, the seed and `i` alone, or is one of those given; with `repeat`, the commands come again
/// after the last of them. With payloads all of that comes once for each, in a session of its own: before it the payload is hung at
/// the tip, by [`Monitor::hang`], or by a simulated rig itself. A capture that ended early, however it did, is resumed by
/// the same call, and no sample that was finished is lost; with a larger `count` the set grows. The tension is released
/// whenever the call returns.
///
/// # Errors
/// [`CaptureStop::Ended`] once samples are captured: with [`CaptureStop::Rig`] where the rig stopped,
/// [`PipelineError::Data`] and [`PipelineError::Write`] for a disk that is full, or [`PipelineError::Interrupted`];
/// [`PipelineError::Data`] for a folder that cannot be written or holds something else.
pub fn capture(
    rig: &mut Rig,
    settings: &CaptureSettings,
    dir: &Path,
    monitor: &dyn Monitor,
) -> Result<CaptureReport, PipelineError> {
    let began = Instant::now();
    let rig_began = rig.clock().now();
    settings.check(rig.file())?;
    let meta = settings.meta(rig);
    let collector = Collector::open(dir, &meta)?;
    collector.keep_samples(stage("keep samples", monitor))?;
    let missing: BTreeSet<usize> = collector.missing_blocks().into_iter().flatten().collect();
    let mut report = CaptureReport {
        samples: settings.samples(),
        captured: missing.len(),
        ..CaptureReport::default()
    };
    // A set that grows is one work.
    let key = json!({ "format": FORMAT, "seed": settings.seed, "origin": meta.origin });
    let is_kept = |entry: &Entry| match entry {
        // It was taken, and its cloud did not come to the disk: it is taken again.
        Entry::Sample(record) => !missing.contains(&(record.index as usize)),
        _ => true,
    };
    let (journal, entries) = Journal::open_kept(&dir.join(JOURNAL), &key, is_kept)?;
    let mut repeats = Repeats::new(settings);
    for entry in &entries {
        report.count(entry);
        repeats.count(entry);
    }
    if !missing.is_empty() {
        monitor.begin(
            "capture",
            settings.samples() as u64,
            (settings.samples() - missing.len()) as u64,
        );
        let needed = settings.bytes(missing.len(), rig.winches().len());
        if let Some(free) = free_space(dir)
            && free < needed
        {
            let [free, needed] = [free, needed].map(|bytes| bytes as f64 / 1e6);
            monitor.note(&format!(
                "{free:.1} MB are free in {}, and the data set takes up to {needed:.1} MB more",
                dir.display()
            ));
        }
        // Before anything moves.
        let masks = settings.mask_folder(rig.cameras().len(), missing.iter().copied())?;
        if !settings.no_log {
            let log = rig.log_in(dir, LOG, needed);
            report.log = Some(log.map_err(CaptureError::from)?);
        }
        let mut work = Work {
            settings,
            collector: &collector,
            journal: &journal,
            report: &mut report,
            repeats: &mut repeats,
            monitor,
        };
        let captured = work.capture(rig, &missing, masks.as_ref(), &entries);
        // The clouds are worth more than the log.
        if let Err(error) = rig.finish_log() {
            monitor.note(&format!("the log is not whole: {error}"));
        }
        captured.map_err(|ended| {
            let missing = collector.missing_blocks();
            let missing: usize = missing.iter().map(ExactSizeIterator::len).sum();
            settings.ended(ended, settings.samples() - missing, dir)
        })?;
        monitor.end();
    }
    let finished = collector.finish(stage("write shards", monitor));
    finished.map_err(|ended| settings.ended(ended.into(), settings.samples(), dir))?;
    report.repeatability = repeats.spread();
    report.rig_seconds = rig.clock().now().saturating_sub(rig_began).as_secs_f64();
    report.seconds = began.elapsed().as_secs_f64();
    Ok(report)
}

/// A sample and its index.
type Indexed = (usize, Sample);

/// Stores samples as they come: each is a block of its own.
fn write(collector: &Collector, samples: Receiver<Indexed>) -> Result<(), DataError> {
    samples
        .into_iter()
        .try_for_each(|(index, sample)| collector.write_block(index, &[sample]))
}

/// Captures samples and keeps the journal.
struct Work<'a> {
    settings: &'a CaptureSettings,
    collector: &'a Collector,
    journal: &'a Journal,
    report: &'a mut CaptureReport,
    repeats: &'a mut Repeats,
    monitor: &'a dyn Monitor,
}

impl Work<'_> {
    /// Captures what is missing, payload by payload, each in a session of its own: between two the rig is released, and home with
    /// another payload is another pose to be looked at. `entries` are those of earlier runs.
    fn capture(
        &mut self,
        rig: &mut Rig,
        missing: &BTreeSet<usize>,
        masks: Option<&MaskFolder>,
        entries: &[Entry],
    ) -> Result<(), PipelineError> {
        let (settings, monitor) = (self.settings, self.monitor);
        let mut go_on = || match monitor.interrupted() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        };
        for part in 0..settings.parts() {
            let of_part = |index: &usize| settings.part_of(*index) == part;
            let missing: Vec<usize> = missing.iter().copied().filter(of_part).collect();
            if missing.is_empty() {
                continue;
            }
            self.hang(rig, part)?;
            let (loads, other_loads) = settings.loads_in(part).map_err(CaptureStop::from)?;
            let session = SessionSettings {
                seed: settings.seed,
                voxel_size: settings.voxel,
                masks: masks.cloned(),
                loads,
                other_loads,
            };
            let payload_here = settings.payload_in(part);
            let reference = entries.iter().find_map(|entry| match entry {
                Entry::Sentinel {
                    payload, sentinel, ..
                } => (*payload == payload_here).then(|| sentinel.clone()),
                _ => None,
            });
            let session = Session::begin(rig, &session, reference, &mut go_on)?;
            let collector = self.collector;
            self.record(session, part, &missing, |samples| write(collector, samples))?;
        }
        Ok(())
    }

    /// Releases the rig, and sees to it that the payload of a part hangs at its tip.
    fn hang(&self, rig: &mut Rig, part: usize) -> Result<(), PipelineError> {
        let Some(payload) = self.settings.payload_in(part) else {
            return Ok(());
        };
        if rig.is_engaged() {
            rig.release().map_err(CaptureError::from)?;
        }
        if let Some(simulator) = rig.simulator() {
            let (loads, _) = self.settings.loads_in(part).map_err(CaptureStop::from)?;
            return Ok(simulator.set_loads(loads).map_err(CaptureStop::from)?);
        }
        match self.monitor.hang(payload) {
            true => Ok(()),
            false if self.monitor.interrupted() => Err(PipelineError::Interrupted),
            false => Err(CaptureStop::NotHung { payload }.into()),
        }
    }

    /// Captures samples of a part, and has `write` write each while the next is captured.
    fn record(
        &mut self,
        session: Session<'_>,
        part: usize,
        missing: &[usize],
        write: impl FnOnce(Receiver<Indexed>) -> Result<(), DataError> + Send,
    ) -> Result<(), PipelineError> {
        // The servos are looked after while samples go to the disk.
        let (out, samples) = sync_channel(1);
        std::thread::scope(|scope| {
            let writer = scope.spawn(|| write(samples));
            let captured = self.run(session, part, missing, out);
            let written = writer
                .join()
                .unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            written?;
            captured
        })
    }

    fn run(
        &mut self,
        mut session: Session<'_>,
        part: usize,
        missing: &[usize],
        out: SyncSender<Indexed>,
    ) -> Result<(), PipelineError> {
        let mut since = self.settings.sentinel_every;
        let mut last = 0;
        for &index in missing {
            if let Some(rested) = session.cool()? {
                let seconds = rested.as_secs_f64();
                let rest = Entry::Rest {
                    before: index,
                    seconds,
                };
                self.add(&mut session, &rest)?;
            }
            if since >= self.settings.sentinel_every {
                self.look(&mut session, part, index)?;
                since = 0;
            }
            let sample = self.sample(&mut session, index)?;
            for servo in session.restarted() {
                let recalled = Entry::Recalled {
                    before: index,
                    servo,
                };
                self.add(&mut session, &recalled)?;
            }
            (since, last) = (since + 1, index + 1);
            // Waits where the disk is slow. The writer is gone only where it failed, and then says why.
            let sent = session.rig().hold_while(|| out.send((index, sample)));
            if sent.map_err(CaptureError::from)?.is_err() {
                return Ok(());
            }
            let monitor = self.monitor;
            show(&mut session, || monitor.advance(1))?;
        }
        self.look(&mut session, part, last)?;
        session
            .end()
            .map_err(|error| CaptureStop::Rig(error.into()).into())
    }

    fn look(
        &mut self,
        session: &mut Session<'_>,
        part: usize,
        before: usize,
    ) -> Result<(), PipelineError> {
        let sentinel = session.sentinel()?;
        let note = format!("drift at home {:.2} mm", 1e3 * sentinel.drift);
        show(session, || self.monitor.note(&note))?;
        let payload = self.settings.payload_in(part);
        let entry = Entry::Sentinel {
            before,
            payload,
            sentinel,
        };
        self.add(session, &entry)
    }

    fn sample(&mut self, session: &mut Session<'_>, index: usize) -> Result<Sample, PipelineError> {
        let settings = self.settings;
        let place = session.plan(|program| settings.place(index, program));
        let place = place
            .map_err(CaptureError::from)?
            .map_err(CaptureError::from)?;
        let captured = session.sample_at(index as u64, &place)?;
        let payload = settings.payload_in(settings.part_of(index));
        let repeat = index % settings.samples_of_part() / settings.distinct();
        let record = Record::of(&captured, repeat, payload);
        self.add(session, &Entry::Sample(record))?;
        let mut rng = ChaCha8Rng::seed_from_u64(self.settings.seed);
        rng.set_stream(index as u64 | 1 << 63);
        Ok(Sample {
            condition: Condition {
                motors: captured
                    .command
                    .iter()
                    .map(|&command| command as f32)
                    .collect(),
                payload: payload.map(|mass| mass as f32),
            },
            cloud: captured.cloud.sample_or_pad(self.settings.points, &mut rng),
        })
    }

    /// Adds an entry to the journal. The servos are looked after while that goes to the disk.
    fn add(&mut self, session: &mut Session<'_>, entry: &Entry) -> Result<(), PipelineError> {
        self.report.count(entry);
        self.repeats.count(entry);
        let journal = self.journal;
        let added = session.rig().hold_while(|| journal.add(entry));
        added.map_err(CaptureError::from)?
    }
}

/// Shows something of the work. The servos are looked after meanwhile: who reads a terminal may hold it.
fn show(session: &mut Session<'_>, work: impl FnOnce() + Send) -> Result<(), PipelineError> {
    let shown = session.rig().hold_while(work);
    Ok(shown.map_err(CaptureError::from)?)
}

#[cfg(test)]
mod tests;

//! Captures in memory, undisturbed and disturbed.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::sleep;
use std::time::Duration;

use tdcr_hw::clock::Clock;
use tdcr_hw::dynamixel::{Bus, BusSettings};
use tdcr_hw::log::{Entry as LogEntry, LogReader};
use tdcr_hw::mask::{Mask, Shot};
use tdcr_hw::rig::{Pace, RigFile};
use tdcr_hw::servo::{ServoBus, ServoId, Torque, WatchdogState};
use tdcr_hw::simulated::camera::{CameraFault, CameraFaults};
use tdcr_hw::simulated::{Fault, Simulator};
use tdcr_learn::data::{DataSet, Split, check};

use super::*;
use crate::pipeline::Silent;

/// The example's rig with two small cameras, which are quick.
fn rig() -> Rig {
    rig_with(|text| text)
}

/// The same with changes to its file.
fn rig_with(change: impl FnOnce(String) -> String) -> Rig {
    rig_at(Pace::Computed, change)
}

/// The same, whose time passes as `pace` says.
fn rig_at(pace: Pace, change: impl FnOnce(String) -> String) -> Rig {
    let text = include_str!("../../../examples/rig-sim.toml");
    let end = text.match_indices("[[cameras]]").nth(2).unwrap().0;
    let text = text[..end].replace("[640, 480]", "[160, 120]");
    // Robots are named from the folder of the file.
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/rig.toml");
    let file = RigFile::parse(&change(text), &path).unwrap();
    Rig::open_file(file, pace).unwrap()
}

fn settings(commands: usize) -> CaptureSettings {
    CaptureSettings {
        commands,
        points: 200,
        voxel: 0.004,
        seed: 5,
        sentinel_every: 6,
        masks: None,
        no_log: true,
    }
}

/// Every command of a data set, in the order of its samples.
fn commands(dir: &Path) -> Vec<Vec<f32>> {
    assert!(check(dir).unwrap().is_empty());
    let set = DataSet::open(dir).unwrap();
    let mut commands = Vec::new();
    for split in Split::ALL {
        let samples = set.samples(split).unwrap();
        for sample in samples.read(0..samples.len()).unwrap() {
            assert_eq!(sample.cloud.len(), 200);
            commands.push(sample.condition.motors);
        }
    }
    commands
}

/// Labels are where servos stood, some ticks off their goals, which depends on where they came from: 20 ticks are 0.15 mm.
fn assert_alike(found: &[Vec<f32>], expected: &[Vec<f32>]) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
        assert!((found - expected).abs() < 1.5e-4, "{found} {expected}");
    }
}

/// Samples that a capture which ended says to have kept.
fn kept(ended: &PipelineError) -> usize {
    match ended {
        PipelineError::Capture(CaptureStop::Ended { kept, .. }) => *kept,
        other => panic!("{other}"),
    }
}

/// Indices of the samples in a journal, ascending.
fn journalled(dir: &Path) -> Vec<u64> {
    let journal = std::fs::read_to_string(dir.join(JOURNAL)).unwrap();
    let lines = journal
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    let mut indices: Vec<u64> = lines
        .filter_map(|line| line["entry"]["index"].as_u64())
        .collect();
    indices.sort_unstable();
    indices
}

/// Lets something go wrong after the ninth sample.
struct Inject(AtomicU64, Simulator, Fault);

impl Monitor for Inject {
    fn begin(&self, _: &str, _: u64, _: u64) {}
    fn advance(&self, steps: u64) {
        if self.0.fetch_add(steps, Ordering::Relaxed) + steps == 9 {
            self.1.inject(self.2);
        }
    }
    fn note(&self, _: &str) {}
    fn status(&self, _: &str) {}
    fn end(&self) {}
    fn interrupted(&self) -> bool {
        false
    }
}

/// Stops after so many samples.
struct StopAfter(AtomicU64, u64);

impl Monitor for StopAfter {
    fn begin(&self, _: &str, _: u64, _: u64) {}
    fn advance(&self, steps: u64) {
        self.0.fetch_add(steps, Ordering::Relaxed);
    }
    fn note(&self, _: &str) {}
    fn status(&self, _: &str) {}
    fn end(&self) {}
    fn interrupted(&self) -> bool {
        self.0.load(Ordering::Relaxed) >= self.1
    }
}

#[test]
fn a_capture_is_a_data_set_that_resumes_and_grows() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, stopped] = ["whole", "stopped"].map(|name| folder.path().join(name));
    let report = capture(&mut rig(), &settings(20), &whole, &Silent).unwrap();
    assert_eq!(
        (report.samples, report.captured, report.moving),
        (20, 20, 0),
        "{report:?}"
    );
    assert_eq!(report.sentinels, 5);
    assert!(report.drift < 3e-3 && report.lag < 60, "{report:?}");
    assert!(
        report.skew <= 0.034 && report.rig_seconds > 20.0,
        "{report:?}"
    );
    let expected = commands(&whole);
    // The positions of the servos lie beside.
    let journal = std::fs::read_to_string(whole.join(JOURNAL)).unwrap();
    assert_eq!(journal.matches("\"kind\":\"sample\"").count(), 20);
    // Interrupted twice: what was finished is kept, and told.
    for (after, all) in [(3, 3), (10, 13)] {
        let mut rig = rig();
        let stop = StopAfter(AtomicU64::new(0), after);
        let ended = capture(&mut rig, &settings(20), &stopped, &stop).unwrap_err();
        assert!(ended.is_interruption());
        assert_eq!(kept(&ended), all);
        let said = format!(
            "interrupted; {all} of 20 samples are kept in {}",
            stopped.display()
        );
        assert!(ended.to_string().starts_with(&said), "{ended}");
        assert!(!rig.is_engaged());
        assert_eq!(journalled(&stopped), (0..all as u64).collect::<Vec<_>>());
    }
    // A sample whose cloud did not come to the disk is taken again, and stands in the journal once.
    let last = stopped.join(".partial/block-00000012.h5");
    std::fs::remove_file(last).unwrap();
    let report = capture(&mut rig(), &settings(20), &stopped, &Silent).unwrap();
    assert_eq!(report.captured, 8, "{report:?}");
    assert_alike(&commands(&stopped), &expected);
    assert_eq!(journalled(&stopped), (0..20).collect::<Vec<_>>());
    // Done is done: nothing is asked of the rig.
    let mut idle = rig();
    let report = capture(&mut idle, &settings(20), &stopped, &Silent).unwrap();
    assert_eq!((report.captured, report.rig_seconds), (0, 0.0));
    let report = capture(&mut idle, &settings(24), &stopped, &Silent).unwrap();
    assert_eq!(report.captured, 4);
    assert_eq!(commands(&stopped).len(), 24);
    // Another rig is another data set.
    let other = CaptureSettings {
        voxel: 0.003,
        ..settings(24)
    };
    let refused = capture(&mut idle, &other, &stopped, &Silent)
        .unwrap_err()
        .to_string();
    assert!(refused.contains("voxel_size"), "{refused}");
}

/// A first try on a rig is two samples.
#[test]
fn a_capture_of_two_samples_is_a_data_set_that_grows() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("two");
    let report = capture(&mut rig(), &settings(2), &dir, &Silent).unwrap();
    assert_eq!(report.captured, 2);
    let set = DataSet::open(&dir).unwrap();
    let sizes = Split::ALL.map(|split| set.samples(split).unwrap().len());
    assert_eq!(sizes, [1, 0, 1]);
    assert!(check(&dir).unwrap().is_empty());
    let few = set.cloud_set(Split::Val).unwrap_err().to_string();
    assert!(
        few.contains("no sample in val") && few.contains("fewer than 10"),
        "{few}"
    );
    let report = capture(&mut rig(), &settings(10), &dir, &Silent).unwrap();
    assert_eq!(report.captured, 8);
    assert_eq!(commands(&dir).len(), 10);
}

/// In real time, in which servos stop that hear nothing for 0.8 s.
#[test]
fn a_disk_and_a_terminal_that_stall_for_longer_than_the_watchdog_end_nothing() {
    const STALL: Duration = Duration::from_secs(2);
    /// A terminal whose output a person has halted.
    struct Halted;
    impl Monitor for Halted {
        fn begin(&self, _: &str, _: u64, _: u64) {}
        fn advance(&self, _: u64) {
            sleep(STALL);
        }
        fn note(&self, _: &str) {
            sleep(STALL);
        }
        fn status(&self, _: &str) {}
        fn end(&self) {}
        fn interrupted(&self) -> bool {
            false
        }
    }
    let mut rig = rig_at(Pace::RealTime, |text| {
        text.replace("watchdog = 0.5", "watchdog = 0.8")
            .replace("bend = [0.6, 0.8]", "bend = [0.1, 0.1]")
    });
    let folder = tempfile::tempdir().unwrap();
    let settings = settings(3);
    let collector = Collector::open(folder.path(), &settings.meta(&rig)).unwrap();
    let samples: Vec<usize> = collector.missing_blocks().into_iter().flatten().collect();
    let path = folder.path().join(JOURNAL);
    let (journal, _) = Journal::open::<Entry>(&path, &json!({})).unwrap();
    let mut report = CaptureReport::default();
    let recorder = Recorder {
        settings: &settings,
        journal: &journal,
        report: &mut report,
        monitor: &Halted,
    };
    let session = SessionSettings {
        seed: settings.seed,
        voxel_size: settings.voxel,
        masks: None,
    };
    let mut go_on = || ControlFlow::Continue(());
    let session = Session::begin(&mut rig, &session, None, &mut go_on).unwrap();
    let written = AtomicU64::new(0);
    let done = std::thread::scope(|scope| {
        scope.spawn(|| {
            while written.load(Ordering::Relaxed) < 3 {
                journal.while_stalled(|| sleep(STALL));
                sleep(Duration::from_millis(1));
            }
        });
        let slow = |taken: Receiver<Indexed>| {
            for _ in taken {
                sleep(3 * STALL);
                written.fetch_add(1, Ordering::Relaxed);
            }
            Ok(())
        };
        let done = recorder.record(session, samples.into_iter(), slow);
        written.store(3, Ordering::Relaxed);
        done
    });
    done.unwrap();
    assert_eq!(
        (report.sentinels, journalled(folder.path())),
        (2, vec![0, 1, 2])
    );
}

/// Every condition and cloud of a data set.
fn contents(dir: &Path) -> Vec<(Vec<f32>, Vec<[f32; 3]>)> {
    let set = DataSet::open(dir).unwrap();
    let of_split = |split| {
        let samples = set.samples(split).unwrap();
        samples.read(0..samples.len()).unwrap()
    };
    let samples = Split::ALL.into_iter().flat_map(of_split);
    samples
        .map(|sample| (sample.condition.motors, sample.cloud.points))
        .collect()
}

#[test]
fn a_capture_runs_again_on_its_log_and_gives_the_same_clouds() {
    let folder = tempfile::tempdir().unwrap();
    let [first, again] = ["first", "again"].map(|name| folder.path().join(name));
    let logged = CaptureSettings {
        no_log: false,
        ..settings(12)
    };
    let report = capture(&mut rig(), &logged, &first, &Silent).unwrap();
    let log = report.log.unwrap();
    assert_eq!(log, first.join("log.mcap"));
    let mut reader = LogReader::open(&log).unwrap();
    let mut counts = BTreeMap::new();
    while let Some(entry) = reader.next_entry().unwrap() {
        if let LogEntry::Message(message) = entry {
            *counts.entry(message.channel.topic.clone()).or_insert(0) += 1;
        }
    }
    assert!(reader.recovery().is_whole());
    let looks = report.sentinels;
    assert_eq!(counts["/cloud"], 12 + looks);
    for (topic, least) in [
        ("/servos/homes", 1),
        ("/servos/registers", 6),
        ("/servos/present", 100),
        ("/servos/goals", 100),
        ("/command", 100),
        ("/robot_description", 1),
        ("/events", 12),
        ("/tf", 2),
        ("/cameras/south/calibration", 1),
        ("/cameras/east/color", 2 * 12),
        ("/cameras/east/depth", 2 * 12),
    ] {
        let found = counts.get(topic).copied().unwrap_or(0);
        assert!(found >= least, "{topic}: {found}");
    }
    let recorded = || {
        let link = format!("link = {{ recorded = {:?} }}", log.display().to_string());
        rig_with(|text| text.replace("link = \"simulated\"", &link))
    };
    let mut playback = recorded();
    assert!(playback.simulator().is_none());
    let report = capture(&mut playback, &settings(12), &again, &Silent).unwrap();
    assert_eq!((report.captured, report.moving), (12, 0));
    assert_eq!(contents(&first), contents(&again));
    // What was recorded cannot do otherwise.
    let other = CaptureSettings {
        seed: 6,
        ..settings(12)
    };
    let refused = capture(
        &mut recorded(),
        &other,
        &folder.path().join("other"),
        &Silent,
    );
    let said = refused.unwrap_err().to_string();
    assert!(said.contains("recording"), "{said}");
    // A log is not written over another one.
    let more = CaptureSettings {
        commands: 14,
        ..logged
    };
    let report = capture(&mut rig(), &more, &first, &Silent).unwrap();
    assert_eq!(report.log.unwrap(), first.join("log-2.mcap"));
}

#[test]
fn masks_of_another_program_make_the_clouds() {
    let folder = tempfile::tempdir().unwrap();
    let masks = MaskFolder::new(folder.path().join("masks"));
    let settings = CaptureSettings {
        masks: Some(folder.path().join("masks")),
        ..settings(10)
    };
    let dir = folder.path().join("data");
    // The left half of each picture, but for the last of the second camera.
    let half = Mask::of_size([160, 120], |index| index % 160 < 80);
    for sample in 0..10 {
        for view in 0..2 {
            masks.write(&half, Shot { view, sample }).unwrap();
        }
    }
    let last = masks.path(Shot { view: 1, sample: 9 });
    std::fs::remove_file(&last).unwrap();
    let mut idle = rig();
    let refused = capture(&mut idle, &settings, &dir, &Silent).unwrap_err();
    assert!(
        refused.to_string().contains("camera1/000009.png"),
        "{refused}"
    );
    assert!(idle.clock().now() < Duration::from_secs(1), "nothing moved");
    masks.write(&half, Shot { view: 1, sample: 9 }).unwrap();
    capture(&mut rig(), &settings, &dir, &Silent).unwrap();
    // The table and the walls are in them, which the rig's own masks take away.
    let set = DataSet::open(&dir).unwrap();
    let samples = set.samples(Split::Train).unwrap();
    for sample in samples.read(0..samples.len()).unwrap() {
        let beyond = sample.cloud.points.iter().filter(|p| p[2] < 0.1).count();
        assert!(beyond > 50, "{beyond} of {}", sample.cloud.len());
    }
    let other = CaptureSettings {
        masks: None,
        ..settings
    };
    let refused = capture(&mut idle, &other, &dir, &Silent).unwrap_err();
    assert!(refused.to_string().contains("masks_by"), "{refused}");
}

/// Mean distance of two clouds' means (m): a robot that is elsewhere is seen there.
fn apart(a: &[[f32; 3]], b: &[[f32; 3]]) -> f32 {
    let mean = |points: &[[f32; 3]], axis: usize| {
        points.iter().map(|p| p[axis]).sum::<f32>() / points.len() as f32
    };
    let squares = (0..3).map(|axis| (mean(a, axis) - mean(b, axis)).powi(2));
    squares.sum::<f32>().sqrt()
}

/// Takes the power from a servo for a moment, once, after a sample that leaves it beyond its first turn.
struct Unpower(AtomicU64, Simulator);

impl Monitor for Unpower {
    fn begin(&self, _: &str, _: u64, _: u64) {}
    fn advance(&self, _: u64) {
        let horns = self.1.truth().horns;
        // Let out so far that what its tendon then turns leads it no nearer.
        let beyond = horns.iter().position(|horn| *horn < -40.0);
        if let (Some(index), 0) = (beyond, self.0.load(Ordering::Relaxed)) {
            let id = ServoId::new(index as u8 + 1).unwrap();
            self.0.store(u64::from(id.get()), Ordering::Relaxed);
            self.1.inject(Fault::PowerCycled(id));
        }
    }
    fn note(&self, _: &str) {}
    fn status(&self, _: &str) {}
    fn end(&self) {}
    fn interrupted(&self) -> bool {
        false
    }
}

#[test]
fn a_capture_finds_home_again_where_a_servo_lost_its_turns() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, disturbed] = ["whole", "disturbed"].map(|name| folder.path().join(name));
    // On small spools servos turn far.
    let rig = || {
        rig_with(|text| {
            let recalls = "[safety]\nlost_turns = \"recall\"";
            text.replace("[safety]", recalls)
                .replace("spool_radius = [0.005]", "spool_radius = [0.0033]")
                .replace("[-1300,", "[-4000,")
        })
    };
    capture(&mut rig(), &settings(14), &whole, &Silent).unwrap();
    let mut rig = rig();
    let homes = rig.homing().to_vec();
    let unpower = Unpower(AtomicU64::new(0), rig.simulator().unwrap().clone());
    let report = capture(&mut rig, &settings(14), &disturbed, &unpower).unwrap();
    let id = unpower.0.into_inner();
    assert!(id > 0, "no servo was beyond its first turn");
    assert_eq!((report.captured, report.recalled), (14, 1), "{report:?}");
    assert!(report.drift < 3e-3, "{report:?}");
    // Its home is whole turns off in its new count, that of the others where it was.
    for (k, (now, before)) in rig.homing().iter().zip(&homes).enumerate() {
        assert_eq!(now != before, k as u64 + 1 == id, "{now:?}, {before:?}");
    }
    // As if nothing had been: means of 200 points drawn from a robot of 20 cm differ by millimetres, a turn is 22 mm of tendon.
    let (found, expected) = (contents(&disturbed), contents(&whole));
    assert_eq!(found.len(), expected.len());
    for ((a, cloud), (b, other)) in found.iter().zip(&expected) {
        assert_alike(std::slice::from_ref(a), std::slice::from_ref(b));
        assert!(apart(cloud, other) < 1e-2, "{}", apart(cloud, other));
    }
}

#[test]
fn a_capture_rests_where_a_servo_is_hot_and_goes_on() {
    struct Heat(AtomicU64, Simulator);
    impl Monitor for Heat {
        fn begin(&self, _: &str, _: u64, _: u64) {}
        fn advance(&self, steps: u64) {
            if self.0.fetch_add(steps, Ordering::Relaxed) + steps == 9 {
                self.1.set_temperature(ServoId::new(3).unwrap(), 65.0);
            }
        }
        fn note(&self, _: &str) {}
        fn status(&self, _: &str) {}
        fn end(&self) {}
        fn interrupted(&self) -> bool {
            false
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let [cool, hot] = ["cool", "hot"].map(|name| folder.path().join(name));
    capture(&mut rig(), &settings(14), &cool, &Silent).unwrap();
    let mut rig = rig();
    let heat = Heat(AtomicU64::new(0), rig.simulator().unwrap().clone());
    let report = capture(&mut rig, &settings(14), &hot, &heat).unwrap();
    // From 65 to below 50 degrees in a room of 25, with a time constant of 300 s: 300 ln(40 / 25) = 141 s; whole degrees are read.
    assert!((130.0..160.0).contains(&report.rested), "{report:?}");
    assert_eq!((report.captured, report.moving), (14, 0));
    let journal = std::fs::read_to_string(hot.join(JOURNAL)).unwrap();
    let rests: Vec<_> = journal
        .lines()
        .filter(|line| line.contains("\"rest\""))
        .collect();
    assert!(
        rests.len() == 1 && rests[0].contains("\"before\":9"),
        "{rests:?}"
    );
    assert_alike(&commands(&cool), &commands(&hot));
}

/// Lets a camera freeze after the ninth sample.
struct Freeze(AtomicU64, CameraFaults, Arc<dyn Clock>);

impl Monitor for Freeze {
    fn begin(&self, _: &str, _: u64, _: u64) {}
    fn advance(&self, steps: u64) {
        if self.0.fetch_add(steps, Ordering::Relaxed) + steps == 9 {
            let from = self.2.now() + Duration::from_nanos(1);
            self.1.set_from(from, Some(CameraFault::Frozen));
        }
    }
    fn note(&self, _: &str) {}
    fn status(&self, _: &str) {}
    fn end(&self) {}
    fn interrupted(&self) -> bool {
        false
    }
}

/// With the noise of a D435, and without any.
#[test]
fn a_capture_keeps_no_sample_of_a_camera_that_froze() {
    let folder = tempfile::tempdir().unwrap();
    for (name, sensor) in [("noise", "sensor = \"d435\"\n"), ("ideal", "")] {
        let dir = folder.path().join(name);
        let rig = || rig_with(|text| text.replace("sensor = \"d435\"\n", sensor));
        let mut freezing = rig();
        let faults = freezing.camera_faults()[1].clone().unwrap();
        let freeze = Freeze(AtomicU64::new(0), faults, freezing.clock().clone());
        let ended = capture(&mut freezing, &settings(14), &dir, &freeze).unwrap_err();
        assert!(
            ended.to_string().contains("camera east is frozen"),
            "{ended}"
        );
        assert_eq!(kept(&ended), 9);
        assert!(!freezing.is_engaged());
        let report = capture(&mut rig(), &settings(14), &dir, &Silent).unwrap();
        assert_eq!(report.captured, 5);
        assert_eq!(commands(&dir).len(), 14);
    }
}

#[test]
fn whatever_goes_wrong_in_a_capture_the_robot_is_safe_and_the_data_is_whole() {
    let servo = |id| ServoId::new(id).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for (number, (fault, stops)) in [
        (Fault::Lost(0.002), false),
        (Fault::Corrupted(0.002), false),
        (Fault::Duplicated(0.005), false),
        (Fault::Late(0.05), false),
        (Fault::Lost(1.0), true),
        (Fault::Corrupted(1.0), true),
        (Fault::Silent(servo(2)), true),
        (Fault::Overheated(servo(3)), true),
        (Fault::Overloaded(servo(4)), true),
        (Fault::PowerCycled(servo(5)), true),
        // Seen by what its servo takes in the next samples, or at the next look at home.
        (Fault::Snapped(servo(6)), true),
        (Fault::Jammed(servo(4)), true),
        (Fault::Unplugged, true),
    ]
    .into_iter()
    .enumerate()
    {
        let dir = folder.path().join(number.to_string());
        let mut faulty = rig();
        let simulator = faulty.simulator().unwrap().clone();
        let after_nine = Inject(AtomicU64::new(0), simulator.clone(), fault);
        let ended = capture(&mut faulty, &settings(14), &dir, &after_nine);
        match (&ended, stops) {
            (Ok(report), false) => assert_eq!(report.captured, 14),
            (Err(PipelineError::Capture(CaptureStop::Ended { ended, .. })), true)
                if matches!(**ended, PipelineError::Capture(CaptureStop::Rig(_))) => {}
            _ => panic!("{fault}: {ended:?}"),
        }
        assert!(!faulty.is_engaged());
        drop(faulty);
        // The robot is safe: each motor off, or stopped by its watchdog within the current limit, and nothing moves.
        simulator.clock().wait(Duration::from_secs(1));
        let rest = simulator.truth();
        simulator.clock().wait(Duration::from_secs(1));
        let later = simulator.truth();
        for (a, b) in rest.horns.iter().zip(&later.horns) {
            assert!((a - b).abs() < 20.0, "{fault}: {a} to {b}");
        }
        simulator.repair();
        let mut bus = Bus::new(simulator.bus(), BusSettings::default());
        let ids: Vec<ServoId> = (1..=6).map(servo).collect();
        let states = bus.torque(&ids).into_iter().zip(bus.watchdog(&ids));
        for (id, (torque, watchdog)) in ids.iter().zip(states) {
            let stopped = matches!(watchdog, Ok(WatchdogState::Tripped));
            assert!(
                stopped || torque.unwrap() == Torque::Off,
                "{fault}: servo {id}"
            );
        }
        // The data is whole: the same call with a rig in order completes it.
        let report = capture(&mut rig(), &settings(14), &dir, &Silent).unwrap();
        let missing = ended.as_ref().map_or_else(|ended| 14 - kept(ended), |_| 0);
        assert_eq!(report.captured, missing, "{fault}");
        assert!(missing <= 5, "{fault}: the nine before it are kept");
        assert_eq!(journalled(&dir), (0..14).collect::<Vec<_>>(), "{fault}");
        assert_eq!(commands(&dir).len(), 14, "{fault}");
    }
}

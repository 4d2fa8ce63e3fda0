//! Captures that are made in parts, once more from their logs, and with masks of others.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use tdcr_hw::log::{Entry as LogEntry, LogReader};
use tdcr_hw::mask::{Mask, MaskFolder, Shot};

use super::*;
use crate::pipeline::Silent;

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

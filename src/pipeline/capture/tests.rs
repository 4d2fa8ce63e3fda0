//! Captures in memory, undisturbed and disturbed.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use tdcr_hw::dynamixel::{Bus, BusSettings};
use tdcr_hw::rig::{Pace, RigFile};
use tdcr_hw::servo::{ServoId, Torque, TorqueSwitch, Watchdog, WatchdogState};
use tdcr_hw::simulated::{Fault, Simulator};
use tdcr_learn::data::{DataSet, Split, check};

use super::*;
use crate::pipeline::Silent;

/// The example's rig with two small cameras, which are quick.
fn rig() -> Rig {
    let text = include_str!("../../../examples/rig-sim.toml");
    let end = text.match_indices("[[cameras]]").nth(2).unwrap().0;
    let text = text[..end].replace("[640, 480]", "[160, 120]");
    // Robots are named from the folder of the file.
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/rig.toml");
    let file = RigFile::parse(&text, &path).unwrap();
    Rig::open_file(file, Pace::Computed).unwrap()
}

fn settings(count: usize) -> CaptureSettings {
    CaptureSettings {
        count,
        points: 200,
        voxel_size: 0.004,
        seed: 5,
        sentinel_every: 6,
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

/// Lets something go wrong after the ninth sample, one of the second block.
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
    // Interrupted twice, once before the first block is whole.
    for after in [3, 14] {
        let mut rig = rig();
        let stop = StopAfter(AtomicU64::new(0), after);
        let ended = capture(&mut rig, &settings(20), &stopped, &stop);
        assert!(
            matches!(ended, Err(PipelineError::Interrupted)),
            "{ended:?}"
        );
        assert!(!rig.is_engaged());
    }
    let report = capture(&mut rig(), &settings(20), &stopped, &Silent).unwrap();
    assert!(report.captured < 20, "{report:?}");
    assert_eq!(commands(&stopped), expected);
    // Done is done: nothing is asked of the rig.
    let mut idle = rig();
    let report = capture(&mut idle, &settings(20), &stopped, &Silent).unwrap();
    assert_eq!((report.captured, report.rig_seconds), (0, 0.0));
    let report = capture(&mut idle, &settings(24), &stopped, &Silent).unwrap();
    assert_eq!(report.captured, 8, "those after the last whole block");
    assert_eq!(commands(&stopped).len(), 24);
    // Another rig is another data set.
    let other = CaptureSettings {
        voxel_size: 0.003,
        ..settings(24)
    };
    let refused = capture(&mut idle, &other, &stopped, &Silent)
        .unwrap_err()
        .to_string();
    assert!(refused.contains("voxel_size"), "{refused}");
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
        // The others of its module go slack with it, as stiff as tendons are: at home the robot leans by a millimetre, and a
        // gear's friction hides the currents.
        (Fault::Snapped(servo(6)), false),
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
            (Err(PipelineError::Capture(_)), true) => {}
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
        assert_eq!(report.captured, if stops { 6 } else { 0 }, "{fault}");
        assert_eq!(commands(&dir).len(), 14, "{fault}");
    }
}

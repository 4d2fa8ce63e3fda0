//! Captures in which something goes wrong: disks, terminals, servos, cameras.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::sleep;
use std::time::Duration;

use tdcr_hw::clock::Clock;
use tdcr_hw::dynamixel::{Bus, BusSettings};
use tdcr_hw::servo::{ServoBus, ServoId, Torque, WatchdogState};
use tdcr_hw::simulated::camera::{CameraFault, CameraFaults};
use tdcr_hw::simulated::{Fault, Simulator};

use super::*;
use crate::pipeline::Silent;

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

/// In real time, in which servos stop that hear nothing for 0.8 s.
#[test]
fn a_disk_and_a_terminal_that_stall_for_longer_than_the_watchdog_end_nothing() {
    const STALL: Duration = Duration::from_secs(1);
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
    let mut work = Work {
        settings: &settings,
        collector: &collector,
        journal: &journal,
        report: &mut report,
        repeats: &mut Repeats::new(&settings),
        monitor: &Halted,
    };
    let session = SessionSettings {
        seed: settings.seed,
        voxel_size: settings.voxel,
        ..SessionSettings::default()
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
        let done = work.record(session, 0, &samples, slow);
        written.store(3, Ordering::Relaxed);
        done
    });
    done.unwrap();
    assert_eq!(
        (report.sentinels, journalled(folder.path())),
        (2, vec![0, 1, 2])
    );
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

#[test]
fn a_rig_is_released_before_a_payload_is_hung() {
    let mut rig = rig();
    let folder = tempfile::tempdir().unwrap();
    let settings = CaptureSettings {
        payloads: vec![0.1],
        ..settings(1)
    };
    let collector = Collector::open(folder.path(), &settings.meta(&rig)).unwrap();
    let (journal, _) = Journal::open::<Entry>(&folder.path().join(JOURNAL), &json!({})).unwrap();
    let work = Work {
        settings: &settings,
        collector: &collector,
        journal: &journal,
        report: &mut CaptureReport::default(),
        repeats: &mut Repeats::new(&settings),
        monitor: &Silent,
    };
    rig.engage().unwrap();
    work.hang(&mut rig, 0).unwrap();
    assert!(!rig.is_engaged());
}

//! A program on a simulated rig whose run is logged, and on the log of it.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use tdcr_hw::camera::{CameraError, RgbdCamera, Stamped};
use tdcr_hw::clock::{Clock, VirtualClock};
use tdcr_hw::dynamixel::{Bus, BusSettings};
use tdcr_hw::log::{
    Goal, LogError, LogRecord, LogSettings, LogWriter, Reading, ServoStatus, SharedLog, servo_sink,
};
use tdcr_hw::recorded::{Commands, RecordedBus, RecordedCamera, RecordedError};
use tdcr_hw::servo::{
    Logged, OperatingMode, PerServo, ServoBus, ServoError, ServoId, Setting, Ticks, Torque,
};
use tdcr_hw::simulated::camera::{CameraSetup, SimulatedCamera};
use tdcr_hw::simulated::{Fault, Simulator, SimulatorSetup};
use tdcr_sim::camera::{Camera, Intrinsics};
use tdcr_sim::render::RgbdFrame;
use tdcr_sim::robot::RobotSpec;

use super::sample::id;

const SERIAL: &str = "d435-0";

fn ids() -> Vec<ServoId> {
    (1..=6).map(id).collect()
}

/// What a program did and saw, with the times at which calls to servos returned.
type Seen = Vec<String>;

/// Moves the robot, and looks at it, the servo 2 `dropped` for a while.
fn program(
    clock: &dyn Clock,
    bus: &mut dyn ServoBus,
    camera: &mut dyn RgbdCamera,
    mut drop_servo: impl FnMut(bool),
    mut saw: impl FnMut(&Stamped<RgbdFrame>),
) -> Seen {
    let mut seen = Seen::new();
    let start = clock.now();
    let mut note = |what: String| seen.push(format!("{:?}: {what}", clock.now() - start));
    let ids = ids();
    note(format!("{:?}", bus.scan()));
    note(format!("{:?}", bus.ping(id(4))));
    note(format!("{:?}", bus.torque(&ids)));
    note(format!(
        "{:?}",
        bus.set(Setting::CurrentLimits(&[(id(5), 0.3)]))
    ));
    note(format!("{:?}", bus.current_limits(&ids)));
    let timeout = Some(Duration::from_secs(2));
    note(format!("{:?}", bus.set(Setting::Watchdog(&ids, timeout))));
    note(format!("{:?}", bus.watchdog(&ids)));
    note(format!(
        "{:?}",
        bus.set(Setting::Mode(&ids, OperatingMode::ExtendedPosition))
    ));
    note(format!("{:?}", bus.set(Setting::Torque(&ids, Torque::On))));
    for step in 0..6 {
        drop_servo(step == 3);
        let goals: Vec<_> = (ids.iter())
            .map(|&id| (id, Ticks(2048 + 20 * step * i32::from(id.get() % 3))))
            .collect();
        note(format!("{:?}", bus.set(Setting::GoalPositions(&goals))));
        note(format!(
            "{:?}",
            bus.set(Setting::GoalCurrents(&[(id(1), 0.2)]))
        ));
        if step != 3 {
            note(format!("{:?}", bus.temperatures(&ids)));
            note(format!(
                "{:?} {:?}",
                bus.voltages(&ids),
                bus.hardware_errors(&ids)
            ));
            note(format!(
                "{:?} {:?}",
                bus.mode(&ids),
                bus.goal_positions(&ids)
            ));
        }
        for _ in 0..3 {
            let states = bus.present(&ids);
            // How long a program waits for an answer that does not come is not in the log.
            let states = states.into_iter().map(|state| {
                state.map_err(|error| match error {
                    ServoError::NoAnswer { id, .. } => format!("{id} does not answer"),
                    other => other.to_string(),
                })
            });
            note(format!("{:?}", states.collect::<Vec<_>>()));
        }
        let frame = camera.grab(Duration::from_millis(200)).unwrap();
        saw(&frame);
        let depth: u64 = frame
            .value
            .depth
            .iter()
            .map(|d| u64::from(d.to_bits()))
            .sum();
        note(format!(
            "{:?} {:?} {depth}",
            frame.time - start,
            frame.value.color
        ));
    }
    seen
}

/// Runs the program on a simulated rig, and logs it.
fn log(path: &Path) -> Seen {
    let clock = Arc::new(VirtualClock::new());
    // A rig is on before its log begins.
    clock.wait(Duration::from_secs(3));
    let setup = SimulatorSetup::of_robot(RobotSpec::standard("2m").unwrap());
    let simulator = Simulator::new(&setup, clock.clone()).unwrap();
    let spec = RobotSpec::standard("2m").unwrap();
    let placed = Camera::placed(&spec.cameras)[0].clone();
    let camera = Camera {
        intrinsics: Intrinsics::from_fovy(64, 48, 0.8),
        pose: placed.pose,
    };
    let mut camera = SimulatedCamera::new(
        CameraSetup::d435(SERIAL, camera),
        Box::new(simulator.clone()),
        clock.clone(),
    );
    let log = SharedLog::new(LogWriter::create(path, &*clock, LogSettings::default()).unwrap());
    let (now, seen, pose) = (
        clock.now(),
        camera.camera().clone(),
        camera.depth_to_color(),
    );
    log.with(move |log| log.camera(now, SERIAL, &seen, pose));
    let bus = Bus::new(simulator.bus(), BusSettings::default());
    let mut bus = Logged::new(bus, clock.clone(), servo_sink(log.clone()));
    let drop_servo = |dropped| match dropped {
        true => simulator.inject(Fault::Silent(id(2))),
        false => simulator.repair(),
    };
    let seen = program(&*clock, &mut bus, &mut camera, drop_servo, |frame| {
        log.frame(SERIAL, frame);
    });
    log.finish().unwrap();
    seen
}

#[test]
fn a_program_sees_the_same_on_the_log_of_its_run() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let logged = log(&path);
    assert!(logged.iter().any(|line| line.contains("2 does not answer")));
    let clock = Arc::new(VirtualClock::new());
    let mut bus = RecordedBus::open(&path, clock.clone(), Commands::Compare).unwrap();
    let mut camera = RecordedCamera::open(&path, SERIAL, clock.clone()).unwrap();
    let played = program(&*clock, &mut bus, &mut camera, |_| {}, |_| {});
    assert_eq!(logged.len(), played.len());
    for (logged, played) in logged.iter().zip(&played) {
        assert_eq!(logged, played);
    }
}

/// What the servos said to a call, in words.
fn words<T>(results: PerServo<T>) -> Vec<String> {
    let said = results.into_iter().map(|result| match result {
        Ok(_) => "ok".to_owned(),
        Err(error) => error.to_string(),
    });
    said.collect()
}

/// A log of two servos and no camera: told to go to tick 7 after 1 s, seen there after 2 s.
fn short_log(path: &Path) {
    let mut log = LogWriter::create(path, &VirtualClock::new(), LogSettings::default()).unwrap();
    let second = Duration::from_secs;
    let goal = |tick| Goal {
        position: Some(Ticks(tick)),
        current: None,
    };
    let reading = |tick| Reading {
        position: Ticks(tick),
        velocity: 0.0,
        current: 0.01,
    };
    let warm = ServoStatus {
        temperature: Some(40.0),
        ..ServoStatus::of(id(1))
    };
    let records = [
        (
            0,
            LogRecord::Present(vec![(id(1), reading(0)), (id(2), reading(1))]),
        ),
        (
            1,
            LogRecord::Goals(vec![(id(1), goal(7)), (id(2), goal(7))]),
        ),
        (
            2,
            LogRecord::Present(vec![(id(1), reading(7)), (id(2), reading(6))]),
        ),
        (2, LogRecord::Status(vec![warm])),
        (9, LogRecord::Command(vec![1.0])),
    ];
    for (time, record) in records {
        log.write(second(time), &record).unwrap();
    }
    log.finish().unwrap();
}

#[test]
fn a_recording_waits_for_its_time_and_ends() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    short_log(&path);
    let clock = Arc::new(VirtualClock::new());
    let mut bus = RecordedBus::open(&path, clock.clone(), Commands::Compare).unwrap();
    let both = [id(1), id(2)];
    assert_eq!(bus.present(&both)[1].as_ref().unwrap().position, Ticks(1));
    assert_eq!(clock.now(), Duration::ZERO);
    assert!(words(bus.temperatures(&both))[0].contains("no temperature of servo 1 up to 0.000 s"));
    clock.wait(Duration::from_millis(500));
    assert_eq!(
        bus.present(&[id(2)])[0].as_ref().unwrap().position,
        Ticks(6)
    );
    assert_eq!(clock.now(), Duration::from_secs(2));
    let temperatures = bus.temperatures(&both);
    assert!(matches!(temperatures[0], Ok(40.0)));
    assert!(words(temperatures)[1].contains("no temperature of servo 2"));
    assert!(matches!(bus.goal_positions(&both)[0], Ok(Ticks(7))));
    for said in words(bus.present(&both)) {
        assert_eq!(said, "the bus failed: the recording ends at 9.000 s");
    }
    assert!(matches!(bus.ping(id(3)), Err(ServoError::NoAnswer { .. })));
}

#[test]
fn orders_other_than_those_of_the_recording_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    short_log(&path);
    let clock = Arc::new(VirtualClock::new());
    let mut bus = RecordedBus::open(&path, clock.clone(), Commands::Compare).unwrap();
    let said = words(bus.set(Setting::GoalPositions(&[
        (id(1), Ticks(7)),
        (id(2), Ticks(8)),
    ])));
    assert_eq!(said[0], "ok");
    assert_eq!(
        said[1],
        "the bus failed: servo 2 was told to go to tick 8; in the recording, at 1.000 s, it was told to go to tick 7, and it \
         cannot do otherwise"
    );
    assert_eq!(clock.now(), Duration::from_secs(1));
    assert!(
        words(bus.set(Setting::Torque(&[id(1)], Torque::On)))[0].contains("the recording ends")
    );

    let mut shown = RecordedBus::open(&path, clock, Commands::Refuse).unwrap();
    let said = words(shown.set(Setting::GoalPositions(&[(id(1), Ticks(7))])));
    assert!(said[0].contains("only looked at"), "{said:?}");
}

/// How often a rig reads servos that hold their goals, and tells them the same again, depends on the computer: the rest goes as it
/// went.
#[test]
fn repetitions_need_not_be_those_of_the_recording() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    let mut log = LogWriter::create(&path, &VirtualClock::new(), LogSettings::default()).unwrap();
    let told = |tick| {
        let position = Some(Ticks(tick));
        let goal = Goal {
            position,
            current: None,
        };
        LogRecord::Goals(vec![(id(1), goal)])
    };
    let seen = |tick| {
        let reading = Reading {
            position: Ticks(tick),
            velocity: 0.0,
            current: 0.0,
        };
        LogRecord::Present(vec![(id(1), reading)])
    };
    let on = ServoStatus {
        torque: Some(Torque::On),
        ..ServoStatus::of(id(1))
    };
    let off = ServoStatus {
        torque: Some(Torque::Off),
        ..ServoStatus::of(id(1))
    };
    // The last goals are told twice, and the motor is looked at in between.
    let records = [
        LogRecord::Status(vec![on]),
        told(10),
        seen(9),
        told(20),
        seen(18),
        told(20),
        seen(19),
        LogRecord::Status(vec![on]),
        seen(20),
        LogRecord::Status(vec![off]),
    ];
    for (second, record) in (0..).zip(&records) {
        log.write(Duration::from_secs(second), record).unwrap();
    }
    log.finish().unwrap();
    let clock = Arc::new(VirtualClock::new());
    let mut bus = RecordedBus::open(&path, clock, Commands::Compare).unwrap();
    let one = [id(1)];
    let tell = |bus: &mut RecordedBus, tick| {
        words(bus.set(Setting::GoalPositions(&[(id(1), Ticks(tick))])))
    };
    let see = |bus: &mut RecordedBus| bus.present(&one)[0].as_ref().unwrap().position.0;
    assert_eq!(words(bus.set(Setting::Torque(&one, Torque::On))), ["ok"]);
    assert_eq!(tell(&mut bus, 10), ["ok"]);
    // More often than it was: where it stands does not change before it is told to.
    assert_eq!([see(&mut bus), see(&mut bus), see(&mut bus)], [9; 3]);
    assert_eq!(tell(&mut bus, 10), ["ok"]);
    assert_eq!(tell(&mut bus, 20), ["ok"]);
    // Less often: what was not asked for is passed over.
    assert_eq!(see(&mut bus), 18);
    assert_eq!(words(bus.set(Setting::Torque(&one, Torque::Off))), ["ok"]);
}

#[test]
fn what_a_log_cannot_play_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    let clock = Arc::new(VirtualClock::new());
    std::fs::write(&path, "no log").unwrap();
    let refused = RecordedBus::open(&path, clock.clone(), Commands::Compare).err();
    assert!(matches!(
        refused,
        Some(RecordedError::Log(LogError::NotALog { .. }))
    ));
    std::fs::remove_file(&path).unwrap();
    let mut log = LogWriter::create(&path, &*clock, LogSettings::default()).unwrap();
    let calibration = LogRecord::Calibration {
        serial: "left".to_owned(),
        intrinsics: Intrinsics::from_fovy(2, 2, 1.0),
    };
    log.write(Duration::ZERO, &calibration).unwrap();
    log.finish().unwrap();
    let refuse = |serial| {
        let refused = RecordedCamera::open(&path, serial, clock.clone()).err();
        refused.unwrap().to_string()
    };
    assert!(refuse("left").contains("no pose of camera left; its cameras: left"));
    assert!(refuse("right").contains("no calibration of camera right; its cameras: left"));
}

#[test]
fn pictures_come_in_order_within_the_patience_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    let camera = Camera {
        intrinsics: Intrinsics::from_fovy(3, 2, 1.0),
        pose: nalgebra::Isometry3::translation(1.0, 2.0, 3.0),
    };
    let mut log = LogWriter::create(&path, &VirtualClock::new(), LogSettings::default()).unwrap();
    let to_color = nalgebra::Isometry3::translation(0.015, 0.0, 0.0);
    log.camera(Duration::ZERO, SERIAL, &camera, to_color)
        .unwrap();
    let at = |tenths: u64| Duration::from_millis(100 * tenths);
    for tenths in [1, 2, 3, 9] {
        let depth = vec![tenths as f32 / 7.0; 6];
        let color = vec![[tenths as u8, 0, 255]; 6];
        let value = RgbdFrame::measured(&camera, color, depth).unwrap();
        let time = at(tenths);
        log.frame(SERIAL, &Stamped { time, value }).unwrap();
    }
    log.finish().unwrap();
    let clock = Arc::new(VirtualClock::new());
    let mut recorded = RecordedCamera::open(&path, SERIAL, clock.clone()).unwrap();
    assert_eq!(recorded.camera(), &camera);
    assert_eq!(recorded.depth_to_color(), to_color);
    let mut grab = |patience| {
        recorded.grab(at(patience)).map(|frame| {
            assert!(
                frame
                    .value
                    .depth
                    .iter()
                    .all(|d| *d == frame.value.color[0][0] as f32 / 7.0)
            );
            frame.time
        })
    };
    assert_eq!(grab(5).unwrap(), at(1));
    clock.wait_until(at(2) + Duration::from_millis(50));
    assert_eq!(grab(5).unwrap(), at(3));
    assert!(matches!(grab(2), Err(CameraError::NoFrame { .. })));
    assert_eq!(clock.now(), at(5));
    assert_eq!(grab(5).unwrap(), at(9));
    let ended = grab(5).unwrap_err().to_string();
    assert_eq!(ended, "camera d435-0 failed: the recording ends at 0.900 s");
}

#[test]
fn a_recording_that_is_looked_at_shows_what_was_at_its_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    short_log(&path);
    let clock = Arc::new(VirtualClock::new());
    let mut bus = RecordedBus::open(&path, clock.clone(), Commands::Refuse).unwrap();
    clock.wait(Duration::from_millis(500));
    assert_eq!(
        bus.present(&[id(1)])[0].as_ref().unwrap().position,
        Ticks(7)
    );
    assert_eq!(clock.now(), Duration::from_secs(2));
    let mut bus = RecordedBus::open(&path, clock.clone(), Commands::Refuse).unwrap();
    assert!(matches!(bus.temperatures(&[id(1)])[0], Ok(40.0)));
    assert!(matches!(bus.goal_positions(&[id(2)])[0], Ok(Ticks(7))));
}

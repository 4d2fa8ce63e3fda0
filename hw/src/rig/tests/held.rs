//! Servos that hold their goals while something else takes its time, and goals that are lost.

use std::sync::Arc;

use tdcr_sim::camera::Camera;

use super::*;
use crate::camera::{CameraError, described_by};
use crate::capture::{CaptureError, Session, SessionSettings};
use crate::clock::Clock;
use crate::servo::{ServoBus, ServoError, Setting, Ticks, WatchdogState};
use crate::simulated::camera::{CameraSetup, SimulatedCamera};
use crate::simulated::{PlantSetup, Simulator, SimulatorSetup};

fn settings() -> SessionSettings {
    SessionSettings {
        seed: 1,
        voxel_size: 0.004,
        ..SessionSettings::default()
    }
}

/// A camera that slows down: after twenty pictures, in which its exposure is found, they come no faster than `period`.
struct Slow {
    camera: SimulatedCamera,
    period: Duration,
    given: u32,
    last: Duration,
}

impl RgbdCamera for Slow {
    described_by!(|this| this.camera);

    fn grab_after(
        &mut self,
        after: Duration,
        deadline: Duration,
    ) -> Result<Stamped<RgbdFrame>, CameraError> {
        let next = match self.given < 20 {
            true => after,
            false => after.max(self.last + self.period),
        };
        if next > deadline {
            let (serial, waited) = (self.serial().to_owned(), self.period);
            self.clock().wait_until(deadline);
            return Err(CameraError::NoFrame { serial, waited });
        }
        let frame = self.camera.grab_after(next, deadline)?;
        self.given += 1;
        self.last = frame.time;
        Ok(frame)
    }
}

/// The example's rig in memory, homed, with cameras that give a picture each so many milliseconds.
fn slow(simulator: &Simulator, period: u64) -> Rig {
    let file = file(&SIMULATED.replace("[640, 480]", "[96, 72]")).unwrap();
    let specs = file.spec.cameras[..2].to_vec();
    let mut file = file;
    file.spec.cameras.clone_from(&specs);
    file.robot.cameras =
        tdcr_sim::robot::Cameras::Free(specs.iter().map(|spec| spec.camera.clone()).collect());
    let clock = simulator.clock().clone();
    let cameras = specs.iter().map(|spec| {
        let setup = CameraSetup::ideal(spec.serial.clone(), Camera::free(&spec.camera));
        Box::new(Slow {
            camera: SimulatedCamera::new(setup, Box::new(simulator.clone()), clock.clone()),
            period: Duration::from_millis(period),
            given: 0,
            last: Duration::ZERO,
        }) as Box<dyn RgbdCamera>
    });
    let parts = Parts {
        bus: Box::new(Bus::new(simulator.bus(), BusSettings::default())),
        cameras: cameras.collect(),
        clock,
        turns: TurnsFile::in_memory(),
    };
    let mut rig = Rig::of_parts(file, parts).unwrap();
    rig.home_here().unwrap();
    rig
}

/// Pictures come up to 1.2 s apart, and the servos stop after half a second of silence: no sample is of servos that stopped.
#[test]
fn late_pictures_leave_no_servo_without_a_word() {
    for period in [600, 1200] {
        let simulator = rig().simulator().unwrap().clone();
        let mut rig = slow(&simulator, period);
        let mut go_on = || ControlFlow::Continue(());
        let mut session = Session::begin(&mut rig, &settings(), None, &mut go_on).unwrap();
        for index in 0..3 {
            let sample = session.sample(index).unwrap();
            let ids: Vec<ServoId> = (1..=6).map(servo).collect();
            for watchdog in session.rig().bus().watchdog(&ids) {
                assert!(matches!(watchdog, Ok(WatchdogState::Armed(_))));
            }
            let away = sample.goals.iter().zip(&sample.states);
            for (goal, state) in away {
                assert!((goal.0 - state.position.0).abs() <= 100, "{sample:?}");
            }
            // The label is what was measured.
            for (command, state) in sample.command.iter().zip(&sample.states) {
                assert_eq!(*command, state.command);
            }
            let truth = simulator.truth().tendons;
            let winches = session.rig().winches().to_vec();
            for ((command, tendon), winch) in sample.command.iter().zip(truth).zip(winches) {
                // A third of a degree of play, and a tick.
                let off = (command - tendon.rest_length).abs();
                assert!(off < 4.0 * winch.spool.metres_per_tick(), "{off}");
            }
        }
        session.end().unwrap();
    }
}

/// Who computes for too long without a word finds the watchdog named, with the time that it took; so does who is refused.
#[test]
fn a_watchdog_that_tripped_is_named_with_the_silence() {
    for looks_first in [false, true] {
        let mut rig = rig();
        rig.engage().unwrap();
        let home = rig.commanded().unwrap();
        let command = rig.robot().command(&home).unwrap();
        rig.clock().wait(Duration::from_millis(830));
        if looks_first {
            // From then on the bus knows, and refuses goals.
            let ids: Vec<ServoId> = (1..=6).map(servo).collect();
            rig.bus().watchdog(&ids);
            rig.bus().present(&ids);
        }
        let error = rig.step(&command).unwrap_err();
        let said = error.to_string();
        assert!(
            said.contains("the watchdog of servo 1 stopped it: the bus was silent for 83")
                && said.contains("safety.watchdog is 500 ms"),
            "{said}"
        );
        let RigError::Stopped(stop) = error else {
            panic!("{said}");
        };
        assert!(matches!(stop.cause, Cause::Watchdog { .. }));
        assert!(!stop.cause.may_be_restart());
        assert_eq!(torques(&mut rig), [Some(Torque::Off); 6]);
    }
}

/// The computer's clock goes on while somebody computes.
#[test]
fn work_that_takes_longer_than_the_watchdog_is_done_while_servos_are_held() {
    let text = SIMULATED.replace("watchdog = 0.5", "watchdog = 0.8");
    let mut rig = Rig::open_file(file(&text).unwrap(), Pace::RealTime).unwrap();
    assert_eq!(rig.hold_while(|| 3).unwrap(), 3, "before it is engaged");
    rig.engage().unwrap();
    let clock = rig.clock().clone();
    let done = rig.hold_while(|| {
        clock.wait(Duration::from_millis(1300));
        7
    });
    assert_eq!(done.unwrap(), 7);
    rig.poll().unwrap();
    rig.release().unwrap();
}

/// A disk that stalls for longer than the watchdog stalls the log alone.
#[test]
fn servos_do_not_wait_for_the_disk_that_their_log_is_on() {
    let folder = tempfile::tempdir().unwrap();
    let text = SIMULATED.replace("watchdog = 0.5", "watchdog = 0.8");
    let mut rig = Rig::open_file(file(&text).unwrap(), Pace::RealTime).unwrap();
    rig.log_in(folder.path(), "log", 0).unwrap();
    rig.engage().unwrap();
    let log = rig.slot.log().unwrap();
    log.with(|_| {
        std::thread::sleep(Duration::from_secs(2));
        Ok(())
    });
    for _ in 0..30 {
        rig.poll().unwrap();
    }
    rig.grab().unwrap();
    rig.release().unwrap();
    rig.finish_log().unwrap();
    let mut reader = crate::log::LogReader::open(&folder.path().join("log.mcap")).unwrap();
    while reader.next_entry().unwrap().is_some() {}
    assert!(reader.recovery().is_whole());
    assert!(reader.recovery().messages > 60);
}

/// A goal that nobody heard, the last of a path, is told again.
#[test]
fn a_goal_that_was_lost_is_sent_again() {
    let mut rig = rig();
    rig.engage().unwrap();
    let simulator = rig.simulator().unwrap().clone();
    let home = rig.commanded().unwrap();
    let shifted: Vec<f64> = home.iter().map(|command| command - 9e-4).collect();
    let command = rig.robot().command(&shifted).unwrap();
    simulator.inject(Fault::Lost(1.0));
    rig.step(&command).unwrap();
    simulator.repair();
    for _ in 0..10 {
        rig.poll().unwrap();
    }
    assert_eq!(rig.off_goal(), None);
    for state in rig.last_states().unwrap() {
        // 117 ticks.
        assert!((state.position.0 - 117).abs() < 30, "{state:?}");
    }
}

/// A servo whose goal is another one again and again, as where another program uses the bus, is named with both.
#[test]
fn a_servo_that_never_holds_its_goal_is_named() {
    let mut rig = rig();
    rig.engage().unwrap();
    let mut other = Bus::new(rig.simulator().unwrap().bus(), BusSettings::default());
    let home = rig.commanded().unwrap();
    let command = rig.robot().command(&home).unwrap();
    rig.step(&command).unwrap();
    let error = (0..20).try_for_each(|_| {
        assert!(other.set(Setting::GoalPositions(&[(servo(4), Ticks(2060))]))[0].is_ok());
        rig.poll().map(drop)
    });
    let said = error.unwrap_err().to_string();
    assert!(
        said.contains("servo 4 holds the goal of 12 ticks from home where it was told 0, 8 times"),
        "{said}"
    );
}

/// Two thousandths of all bytes lost, damaged or doubled end neither homing nor engaging.
#[test]
fn a_bad_line_ends_neither_homing_nor_engaging() {
    for fault in [
        Fault::Lost(0.002),
        Fault::Corrupted(0.002),
        Fault::Duplicated(0.002),
    ] {
        for seed in 0..12 {
            let text = SIMULATED.replace("seed = 1", &format!("seed = {seed}"));
            let mut rig = Rig::open_file(file(&text).unwrap(), Pace::Computed).unwrap();
            rig.simulator().unwrap().inject(fault);
            let engaged = rig.home_here().and_then(|_| rig.engage());
            engaged.unwrap_or_else(|error| panic!("{fault}, seed {seed}: {error}"));
            rig.release()
                .unwrap_or_else(|error| panic!("{fault}, seed {seed}: {error}"));
        }
    }
}

/// A servo that cannot come to its goal: its sample is not kept, and the servo is named.
#[test]
fn a_servo_that_stays_off_its_goal_ends_a_capture() {
    let simulator = rig().simulator().unwrap().clone();
    let mut rig = slow(&simulator, 33);
    let mut go_on = || ControlFlow::Continue(());
    let mut session = Session::begin(&mut rig, &settings(), None, &mut go_on).unwrap();
    // Too little current to pull with.
    let bounded = session
        .rig()
        .bus()
        .set(Setting::GoalCurrents(&[(servo(2), 0.02)]));
    assert!(bounded[0].is_ok());
    let ended = (0..6).try_for_each(|index| session.sample(index).map(drop));
    let said = ended.unwrap_err().to_string();
    assert!(
        said.contains("servo 2")
            && (said.contains("motion.arrived is 100") || said.contains("from its goal")),
        "{said}"
    );
}

/// The example's robot behind other plants, whose tendons all pull: friction in the holes, and payloads.
fn plant(friction: Option<f64>, payload: f64) -> Simulator {
    let clock: Arc<dyn Clock> = rig().clock().clone();
    let robot = file(SIMULATED).unwrap().robot;
    let setup = SimulatorSetup::of_robot(robot);
    let setup = SimulatorSetup {
        plant: PlantSetup {
            tension_at_home: 6.0,
            physics: match friction {
                Some(coefficient) => crate::simulated::Physics::WithFriction { coefficient },
                None => crate::simulated::Physics::AtRest,
            },
            ..setup.plant.clone()
        },
        ..setup
    };
    let simulator = Simulator::new(&setup, clock).unwrap();
    if payload > 0.0 {
        let loads = tdcr_sim::robot::Loads::payload(payload).unwrap();
        simulator.set_loads(loads).unwrap();
    }
    simulator
}

#[test]
fn tendons_that_pull_are_not_accused() {
    for (friction, payload) in [
        (None, 0.0),
        (None, 0.03),
        (Some(0.1), 0.0),
        (Some(0.3), 0.03),
    ] {
        let simulator = plant(friction, payload);
        let mut rig = slow(&simulator, 33);
        let mut go_on = || ControlFlow::Continue(());
        let mut session = Session::begin(&mut rig, &settings(), None, &mut go_on).unwrap();
        session.check_tendons().unwrap();
        for index in 0..12 {
            if let Err(error) = session.sample(index) {
                panic!("friction {friction:?}, {payload} kg, sample {index}: {error}");
            }
        }
        session.end().unwrap();
    }
}

/// A tendon that snaps or jams between looks at home is found by what its servo takes in the samples.
#[test]
fn tendons_that_snap_or_jam_are_found_in_a_few_samples() {
    for fault in [Fault::Snapped as fn(ServoId) -> Fault, Fault::Jammed] {
        for id in 1..=6 {
            let simulator = plant(None, 0.0);
            let mut rig = slow(&simulator, 33);
            let mut go_on = || ControlFlow::Continue(());
            let mut session = Session::begin(&mut rig, &settings(), None, &mut go_on).unwrap();
            session.check_tendons().unwrap();
            session.sample(0).unwrap();
            simulator.inject(fault(servo(id)));
            let ended = (1..=3).try_for_each(|index| session.sample(index).map(drop));
            let fault = fault(servo(id));
            match ended {
                Err(CaptureError::Pull { id: named, .. }) => {
                    // What a jammed tendon no longer lets go, others pull against.
                    let jammed = matches!(fault, Fault::Jammed(_));
                    assert!(named == id || jammed, "{fault}: {ended:?}");
                }
                Err(CaptureError::OffGoal { id: named, .. }) => assert_eq!(named, id, "{fault}"),
                Err(CaptureError::Rig(RigError::Stopped(stop))) => {
                    assert_eq!(stop.cause.id(), servo(id), "{fault}: {stop}");
                }
                other => panic!("{fault}: {other:?}"),
            }
        }
    }
}

/// A current below what the gear's friction takes, which no step leads to.
#[test]
fn tendons_that_are_wound_and_let_out_in_turn_end_by_a_word() {
    let mut rig = rig();
    let settings = PretensionSettings {
        current: 0.01,
        ..PretensionSettings::default()
    };
    let mut looks = 0;
    let mut show = |_: &[WinchState]| {
        looks += 1;
        match looks < 10_000 {
            true => ControlFlow::Continue(()),
            false => ControlFlow::Break(()),
        }
    };
    let ended = rig.pretension(&settings, &mut show);
    let said = ended.as_ref().map_err(ToString::to_string);
    assert!(
        matches!(ended, Err(RigError::Unsteady { .. })),
        "{said:?} after {looks} looks"
    );
    assert!(!rig.is_engaged());
}

/// Servos that wind by counting down have their room below home.
#[test]
fn tendons_are_wound_as_far_as_the_limits_of_their_side() {
    for (limits, expected) in [("[-60, 400]", 61..=70), ("[-400, 60]", 71..=410)] {
        let text = SIMULATED.replace("directions = [1]", "directions = [-1]");
        let list = text
            .lines()
            .find(|line| line.starts_with("limits"))
            .unwrap();
        let text = text.replace(list, &format!("limits = [{limits}]"));
        let mut rig = Rig::open_file(file(&text).unwrap(), Pace::Computed).unwrap();
        let settings = PretensionSettings {
            current: 0.7,
            ..PretensionSettings::default()
        };
        let mut show = |_: &[WinchState]| ControlFlow::Continue(());
        let ended = rig.pretension(&settings, &mut show);
        let far = match &ended {
            Err(RigError::Pretension { wound, .. }) => *wound,
            Ok(found) => found.iter().map(|servo| servo.wound.abs()).max().unwrap(),
            Err(error) => panic!("{limits}: {error}"),
        };
        assert!(expected.contains(&far), "{limits}: {ended:?}");
    }
}

/// Currents that a servo cannot come to are refused before anything winds.
#[test]
fn tendons_are_not_wound_to_currents_that_servos_cannot_have() {
    let mut rig = rig();
    let settings = PretensionSettings {
        current: 0.9,
        ..PretensionSettings::default()
    };
    let mut show = |_: &[WinchState]| ControlFlow::Continue(());
    let said = rig
        .pretension(&settings, &mut show)
        .unwrap_err()
        .to_string();
    assert!(said.contains("below 0.75 A"), "{said}");
    assert!(!rig.is_engaged());
    assert!(
        ServoError::NoAnswer {
            id: servo(1),
            waited: Duration::ZERO
        }
        .may_pass()
    );
}

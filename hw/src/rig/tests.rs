//! Rigs in memory: files, homing, motion, and what stops it.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use std::ops::ControlFlow;
use std::path::Path;
use std::time::Duration;

use super::*;
use crate::capture::Program;
use crate::dynamixel::{Bus, BusSettings};
use crate::plan::{Bend, Shape};
use crate::servo::Torque;
use crate::simulated::Fault;

mod held;
mod masks;
mod tendons;

const SIMULATED: &str = include_str!("../../../examples/rig-sim.toml");
const PAPER: &str = include_str!("../../../examples/rig-2m.toml");

fn file(text: &str) -> Result<RigFile, RigError> {
    // Robots are named from the folder of the file.
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/rig.toml");
    RigFile::parse(text, &path)
}

fn rig() -> Rig {
    Rig::open_file(file(SIMULATED).unwrap(), Pace::Computed).unwrap()
}

fn servo(id: u8) -> ServoId {
    ServoId::new(id).unwrap()
}

/// Moves a rig that is engaged at home from command to command and back: some seconds, in which faults are met.
fn wander(rig: &mut Rig) -> Result<(), RigError> {
    let mut program = Program::new(rig.file(), 1).unwrap();
    let rest = program.rest().clone();
    let mut shapes: Vec<Shape> = (0..4).map(|k| program.draw(k).unwrap().shape).collect();
    shapes.push(rest.clone());
    let mut at = rest;
    for shape in shapes {
        let path = program.path(&at, &shape).unwrap();
        rig.move_along(&path, &mut || ControlFlow::Continue(()))?;
        at = shape;
    }
    (0..20).try_for_each(|_| rig.poll().map(drop))
}

/// Whether a rig's servos, as far as they are true, neither pull on nor hold their tendons.
fn torques(rig: &mut Rig) -> Vec<Option<Torque>> {
    let ids: Vec<ServoId> = rig.winches().iter().map(|winch| winch.id).collect();
    rig.bus().torque(&ids).into_iter().map(Result::ok).collect()
}

#[test]
fn the_example_files_are_read() {
    let sim = file(SIMULATED).unwrap();
    assert_eq!(sim.spec.cameras.len(), 4);
    assert_eq!(sim.robot.cameras.count(), 4);
    let paper = file(PAPER).unwrap();
    assert!(matches!(paper.spec.servos.link, ServoLink::Serial(_)));
    // What a file says comes back.
    for spec in [sim.spec, paper.spec] {
        let text = toml::to_string(&spec).unwrap();
        assert_eq!(toml::from_str::<RigSpec>(&text).unwrap(), spec);
    }
}

#[test]
fn a_wrong_file_is_refused_with_line_field_and_reason() {
    for (from, to, expected) in [
        (
            "ids = [1, 2, 3, 4, 5, 6]",
            "ids = [1, 2, 3]",
            "rig.toml:10: servos.ids is 3 ids; expected 6",
        ),
        (
            "ids = [1, 2, 3, 4, 5, 6]",
            "ids = [1, 2, 3, 4, 5, 5]",
            "servos.ids[5] is 5; expected no address twice",
        ),
        (
            "ids = [1, 2, 3, 4, 5, 6]",
            "ids = [1, 2, 3, 4, 5, 253]",
            "0 to 252",
        ),
        (
            "directions = [1]",
            "directions = [2]",
            "direction 2; expected 1 where",
        ),
        (
            "directions = [1]",
            "directions = [1, 1]",
            "servos.directions is 2 entries; expected one for each",
        ),
        (
            "spool_radius = [0.005]",
            "spool_radius = [0.0]",
            "rig.toml:14: servos.spool_radius[0] is 0;",
        ),
        (
            "spool_radius = [0.005]",
            "spool_radius = [1e300]",
            "rig.toml:14: servos.spool_radius[0] is 1000",
        ),
        (
            "baud = 1000000",
            "baud = 1000001",
            "servos.baud is 1000001; expected one of the servos' rates",
        ),
        (
            "current_limit = [0.8]",
            "current_limit = [75.0]",
            "servos.current_limit[0] is 75; expected 0.01 to 2.352 A",
        ),
        (
            "[-1300, 2400]",
            "[-1300, 2147483647]",
            "servos.limits[0] is [-1300, 2147483647]",
        ),
        (
            "current = 0.75",
            "current = 75.0",
            "safety.current is 75; expected 0.001 to 2.352",
        ),
        (
            "current = 0.75",
            "current = 0.8",
            "rig.toml:33: safety.current is 0.8; expected below servos.current_limit, 0.8 A",
        ),
        (
            "current_limit = [0.8]",
            "current_limit = [0.8, 0.8, 0.8, 0.8, 0.8, 0.6]",
            "safety.current is 0.75; expected below servos.current_limit, 0.6 A",
        ),
        (
            "slew = 0.02",
            "slew = 1e-12",
            "rig.toml:29: motion.slew is 0.000000000001; expected 0.0001 to 1",
        ),
        (
            "slew = 0.02",
            "slew = 0.2",
            "motion.slew is 0.2; expected no more than 0.060 m/s",
        ),
        (
            "tension = [1.0, 60.0]",
            "tension = [1.0, 6000.0]",
            "commands.tension is [1, 6000]; expected no more than 240 N",
        ),
        (
            "watchdog = 0.5",
            "watchdog = 0.02",
            "rig.toml:32: safety.watchdog is 0.02; expected at least 2 times motion.period, 0.05",
        ),
        (
            "slew = 0.02",
            "slew = 0.02\npicture = 6.0",
            "motion.picture is 6; expected no more than motion.patience, 5",
        ),
        (
            "slew = 0.02",
            "slew = 0.02\narrived = 400",
            "motion.arrived is 400; expected no more than safety.lag, 300",
        ),
        (
            "slew = 0.02",
            "slew = 0.02\nstill_speed = 1e300",
            "motion.still_speed is 1000",
        ),
        (
            "slew = 0.02",
            "slew = 0.02\nstill_depth = 1.0",
            "motion.still_depth is 1; expected 0.000001 to 0.05",
        ),
        (
            "release = \"home\"",
            "lag = 2147483647",
            "safety.lag is 2147483647; expected 1 to 2048",
        ),
        (
            "release = \"home\"",
            "drift = 1e300",
            "safety.drift is 1000",
        ),
        (
            "resume_below = 50.0",
            "resume_below = -300.0",
            "safety.resume_below is -300; expected 10 to 100",
        ),
        (
            "largest = { gap = 6 }",
            "largest = { gap = 4294967295 }",
            "rig.toml:41: masks.largest.gap is 4294967295; expected 0 to 479",
        ),
        (
            "largest = { gap = 6 }",
            "not = { components = { pixels = 20, gap = 480 } }",
            "masks.not.components.gap is 480; expected 0 to 479",
        ),
        (
            "largest = { gap = 6 }",
            "components = { pixels = 400000, gap = 2 }",
            "masks.components.pixels is 400000; expected no more than 307200",
        ),
        ("low = [-0.20,", "low = [-1e300,", "masks.box is -1000"),
        (
            "spool_radius",
            "spool_diameter",
            "unknown field `spool_diameter`",
        ),
        (
            "[-1300, 2400]",
            "[100, 2400]",
            "servos.limits[0] is [100, 2400]",
        ),
        (
            "home_tension = [6.0]",
            "home_tension = [9000.0]",
            "servos.home_tension is 9000 N, for which tendon 1",
        ),
        (
            "bend = [0.6, 0.8]",
            "bend = [0.9, 1.0, 1.1]",
            "commands.bend is 3 entries; expected one for each of the 2",
        ),
        (
            "watchdog = 0.5",
            "watchdog = 5.0",
            "safety.watchdog is 5; expected 0.02 to 2.54",
        ),
        (
            "pause_above = 60.0",
            "pause_above = 80.0",
            "safety.pause_above is 80",
        ),
        (
            "serial = \"east\"",
            "serial = \"south\"",
            "cameras[1].serial is \"south\"; expected a serial",
        ),
        (
            "fovy = 42.5",
            "fovy = 242.5",
            "cameras[0].lens.fovy` is 242.5; expected degrees",
        ),
        (
            "link = \"simulated\"\nbaud",
            "link = { serial = \"/dev/ttyUSB0\" }\nbaud",
            "cameras[0].link is \"simulated\"",
        ),
        (
            "link = \"simulated\"\nbaud",
            "link = \"wireless\"\nbaud",
            "unknown variant `wireless`",
        ),
        ("paper-robot.toml", "nobody.toml", "nobody.toml"),
        (
            "low = [-0.20,",
            "low = [0.30,",
            "masks.box is 0.3 to 0.2 along axis 0",
        ),
        (
            "largest = { gap = 6 }",
            "color = { hue = [0.0, 400.0], saturation = [0.5, 1.0], value = [0.0, 1.0] }",
            "rig.toml:41: masks.color.hue is [0, 400]; expected two numbers of 0 to 360",
        ),
        (
            "largest = { gap = 6 }",
            "any = [{ largest = { gap = 2 } }, { color = { hue = [0, 9], saturation = [0.5, 0.2], value = [0, 1] } }]",
            "masks.any[1].color.saturation is [0.5, 0.2]",
        ),
        (
            "largest = { gap = 6 }",
            "not = {}",
            "masks.not is empty; expected a table with one",
        ),
        (
            "largest = { gap = 6 }",
            "largest = { gap = 6 }\ncomponents = { pixels = 50, gap = 2 }",
            "rig.toml:42: masks.components is there beside largest",
        ),
        (
            "largest = { gap = 6 }",
            "background = { log = \"empty.mcap\", margin = -0.1 }",
            "masks.background.margin is -0.1; expected 0 to 1",
        ),
        (
            "largest = { gap = 6 }",
            "background = { log = \"empty.mcap\", deviations = 1e9 }",
            "masks.background.deviations is 1000000000; expected 0 to 100",
        ),
    ] {
        assert!(SIMULATED.contains(from), "{from}");
        let wrong = SIMULATED.replacen(from, to, 1);
        let said = file(&wrong).and_then(|file| file.winches(&file.compile()?).map(drop));
        let said = said.expect_err(to).to_string();
        assert!(
            said.contains(expected),
            "{to} said\n{said}\nnot\n{expected}"
        );
    }
}

#[test]
fn a_rig_in_memory_is_homed_moves_and_lets_go() {
    let mut rig = rig();
    assert!(matches!(rig.homing()[0], Homing::Homed(_)));
    let home = rig.robot().mean_command();
    assert!(matches!(rig.step(&home), Err(RigError::Released)));
    rig.engage().unwrap();
    assert_eq!(torques(&mut rig), [Some(Torque::On); 6]);
    wander(&mut rig).unwrap();
    let least: Vec<f64> = rig
        .robot()
        .tendons()
        .iter()
        .map(|tendon| tendon.range[0])
        .collect();
    let beyond = rig.robot().command(&least).unwrap();
    assert!(
        matches!(rig.step(&beyond), Err(RigError::Limit { .. })),
        "the limits are those of the servos"
    );
    assert!(rig.is_engaged());
    let states = rig.last_states().unwrap().to_vec();
    assert!(
        states.iter().all(|state| state.position.0.abs() < 300),
        "{states:?}"
    );
    rig.release().unwrap();
    assert_eq!(torques(&mut rig), [Some(Torque::Off); 6]);
    assert!(rig.clock().now() < Duration::from_secs(60));
}

#[test]
fn a_motion_ends_when_asked_to_and_a_panic_lets_go() {
    let mut rig = rig();
    rig.engage().unwrap();
    let home = rig.commanded().unwrap();
    let command = rig.robot().command(&home).unwrap();
    let mut left = 3;
    let mut go_on = || {
        left -= 1;
        if left > 0 {
            ControlFlow::Continue(())
        } else {
            ControlFlow::Break(())
        }
    };
    let ended = rig.move_along(&vec![command; 10], &mut go_on);
    assert!(matches!(ended, Err(RigError::Interrupted)));
    assert!(!rig.is_engaged());
    rig.engage().unwrap();
    let simulator = rig.simulator().unwrap().clone();
    let panicked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(move || {
        let _rig = rig;
        panic!("on purpose");
    }));
    assert!(panicked.is_err());
    let mut again = Bus::new(simulator.bus(), BusSettings::default());
    let ids: Vec<ServoId> = (1..=6).map(servo).collect();
    for torque in crate::servo::TorqueSwitch::torque(&mut again, &ids) {
        assert_eq!(torque.unwrap(), Torque::Off);
    }
}

/// What is known of a rig in memory goes with it, so this one keeps its turns in a file and its servos in a simulator.
#[test]
fn servos_that_lost_their_turns_are_refused_until_they_are_homed_again() {
    let folder = tempfile::tempdir().unwrap();
    let simulator = rig().simulator().unwrap().clone();
    let text = SIMULATED.replace("[-1300, 6800]", "[-3000, 6800]");
    let open = || {
        let file = file(&text).unwrap();
        let parts = Parts {
            bus: Box::new(Bus::new(simulator.bus(), BusSettings::default())),
            cameras: Vec::new(),
            clock: simulator.clock().clone(),
            turns: TurnsFile::open(TurnsFile::beside(&folder.path().join("rig.toml"))).unwrap(),
        };
        Rig::of_parts(file, parts).unwrap()
    };
    let mut rig = open();
    let refused = rig.engage().unwrap_err().to_string();
    assert!(refused.contains("servo 1 was never homed"), "{refused}");
    rig.home_here().unwrap();
    rig.engage().unwrap();
    // On the outside of a bend its tendon is let out, beyond the turn that its home is in, and not so tight that it would
    // turn the servo without power.
    let mut program = Program::new(rig.file(), 1).unwrap();
    let rest = program.rest().clone();
    let toward = std::f64::consts::TAU * 5.0 / 6.0;
    let bent = Shape(vec![
        Bend::new(toward, 0.6, 14.0),
        Bend::new(toward, 0.8, 14.0),
    ]);
    let path = program.path(&rest, &bent).unwrap();
    rig.move_along(&path, &mut || ControlFlow::Continue(()))
        .unwrap();
    for _ in 0..20 {
        rig.poll().unwrap();
    }
    assert!(rig.last_states().unwrap()[4].position.0 < -2100);
    simulator.inject(Fault::PowerCycled(servo(5)));
    let stopped = (0..20).try_for_each(|_| rig.poll().map(drop));
    assert!(matches!(stopped, Err(RigError::Stopped(_))), "{stopped:?}");
    drop(rig);
    simulator.clock().wait(Duration::from_secs(1));
    let mut rig = open();
    let refused = rig.engage();
    let met = rig.homing().to_vec();
    assert!(matches!(refused, Err(RigError::NotHomed(_))), "{refused:?}");
    assert!(matches!(met[4], Homing::Lost { .. }), "{met:?}");
    assert!(matches!(met[0], Homing::Homed(_)), "{met:?}");
    let report = rig.home_recalled().unwrap();
    let truth = simulator.truth().horns[4] - 2048.0;
    assert!(
        (f64::from(report[4].position.0) - truth).abs() < 3.0,
        "{report:?}, {truth}"
    );
    rig.engage().unwrap();
    rig.release().unwrap();
}

/// Every fault that a rig may meet on the way, and what it says of it.
#[test]
fn whatever_goes_wrong_the_tension_is_released() {
    for (fault, expected) in [
        (Fault::Lost(1.0), "was lost"),
        (Fault::Corrupted(1.0), "was lost"),
        (Fault::Silent(servo(4)), "servo 4 was lost"),
        (Fault::Overheated(servo(5)), "servo 5"),
        (Fault::Overloaded(servo(5)), "servo 5 reports overload"),
        (Fault::PowerCycled(servo(6)), "servo 6"),
        (Fault::Jammed(servo(4)), "servo 4"),
        (Fault::Unplugged, "was lost"),
    ] {
        let mut rig = rig();
        rig.engage().unwrap();
        let simulator = rig.simulator().unwrap().clone();
        rig.poll().unwrap();
        simulator.inject(fault);
        let error = wander(&mut rig).expect_err(&fault.to_string());
        let said = error.to_string();
        assert!(said.contains(expected), "{fault}: {said}");
        assert!(matches!(error, RigError::Stopped(_)), "{fault}: {error:?}");
        assert!(!rig.is_engaged());
        drop(rig);
        // Those that could not be told stop by themselves: their watchdog is due by now, and then nothing moves any more.
        simulator.clock().wait(Duration::from_secs(1));
        let rest = simulator.truth();
        simulator.clock().wait(Duration::from_secs(1));
        let later = simulator.truth();
        for (a, b) in rest.horns.iter().zip(&later.horns) {
            assert!((a - b).abs() < 20.0, "{fault}: {a} {b}");
        }
        for tendon in &later.tendons {
            assert!(tendon.tension_at_spool < 150.0, "{fault}: {tendon:?}");
        }
        simulator.repair();
        let mut bus = Bus::new(simulator.bus(), BusSettings::default());
        let ids: Vec<ServoId> = (1..=6).map(servo).collect();
        let torque = crate::servo::TorqueSwitch::torque(&mut bus, &ids);
        let watchdogs = crate::servo::Watchdog::watchdog(&mut bus, &ids);
        for ((id, torque), watchdog) in ids.iter().zip(torque).zip(watchdogs) {
            let stopped = matches!(watchdog, Ok(crate::servo::WatchdogState::Tripped));
            assert!(
                stopped || torque.unwrap() == Torque::Off,
                "{fault}: servo {id}"
            );
        }
    }
}

/// A program that is killed tells nobody: what holds is in the servos.
#[test]
fn where_the_program_is_killed_the_servos_stop_by_themselves() {
    let mut rig = rig();
    rig.engage().unwrap();
    let simulator = rig.simulator().unwrap().clone();
    let mut program = Program::new(rig.file(), 1).unwrap();
    let (rest, shape) = (program.rest().clone(), program.draw(0).unwrap().shape);
    let path = program.path(&rest, &shape).unwrap();
    rig.move_along(&path[..path.len() / 2], &mut || ControlFlow::Continue(()))
        .unwrap();
    // Nothing is dropped.
    std::mem::forget(rig);
    simulator.clock().wait(Duration::from_secs(1));
    let mut bus = Bus::new(simulator.bus(), BusSettings::default());
    let ids: Vec<ServoId> = (1..=6).map(servo).collect();
    for watchdog in crate::servo::Watchdog::watchdog(&mut bus, &ids) {
        assert_eq!(watchdog.unwrap(), crate::servo::WatchdogState::Tripped);
    }
    let before = simulator.truth();
    simulator.clock().wait(Duration::from_secs(5));
    let after = simulator.truth();
    for (a, b) in before.horns.iter().zip(&after.horns) {
        assert!((a - b).abs() < 20.0, "{a} to {b}");
    }
    // Another program takes over from there.
    let parts = Parts {
        bus: Box::new(bus),
        cameras: Vec::new(),
        clock: simulator.clock().clone(),
        turns: TurnsFile::in_memory(),
    };
    let mut rig = Rig::of_parts(file(SIMULATED).unwrap(), parts).unwrap();
    rig.home_here().unwrap();
    rig.engage().unwrap();
    rig.release().unwrap();
}

/// Some bytes are lost on every line: that stops nothing.
#[test]
fn a_bad_line_stops_nothing() {
    for fault in [
        Fault::Lost(0.002),
        Fault::Corrupted(0.002),
        Fault::Duplicated(0.005),
        Fault::Late(0.05),
    ] {
        let mut rig = rig();
        rig.engage().unwrap();
        rig.simulator().unwrap().inject(fault);
        wander(&mut rig).unwrap_or_else(|error| panic!("{fault}: {error}"));
        rig.release().unwrap();
    }
}

#[test]
fn cameras_see_the_robot_behind_the_servos() {
    let mut rig = rig();
    rig.warm_up().unwrap();
    rig.engage().unwrap();
    let pictures = rig.grab().unwrap();
    assert_eq!(pictures.frames.len(), 4);
    assert!(pictures.skew < Duration::from_millis(34));
    assert!(
        pictures
            .frames
            .iter()
            .all(|f| f.value.depth.iter().any(|&d| d > 0.0))
    );
    rig.release().unwrap();
}

//! Homing, moving, and letting go.

use super::*;

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
    for torque in ServoBus::torque(&mut again, &ids) {
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

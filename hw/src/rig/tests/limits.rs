//! The last door before the servos.

use super::*;
use crate::servo::{ServoError, Setting, Ticks};

/// What is sent past [`Rig::step`].
fn send(rig: &mut Rig, goal: i32) -> Result<(), ServoError> {
    let homes = rig.homing()[0];
    let Homing::Homed(home) = homes else {
        panic!("{homes:?}");
    };
    let goals = [(servo(1), Ticks(home.0 + goal))];
    rig.bus().set(Setting::GoalPositions(&goals)).remove(0)
}

#[test]
fn no_goal_beyond_the_limits_comes_to_a_servo_whoever_sends_it() {
    let mut rig = rig();
    let unknown = send(&mut rig, 0);
    assert!(
        matches!(unknown, Err(ServoError::Unknown { .. })),
        "{unknown:?}, before it is engaged"
    );
    rig.engage().unwrap();
    // 2 * 0.02 m/s * 0.05 s on a spool of 5 mm: 260.8 ticks.
    send(&mut rig, 261).unwrap();
    let far = send(&mut rig, 523).unwrap_err().to_string();
    assert!(
        far.contains("step in ticks from one goal to the next 262"),
        "{far}"
    );
    for goal in (261..=2400).step_by(261).skip(1) {
        send(&mut rig, goal).unwrap();
    }
    // Servos swing by 30 ticks about goals within their limits.
    send(&mut rig, 2430).unwrap();
    let beyond = send(&mut rig, 2431).unwrap_err().to_string();
    assert!(
        beyond.contains("goal in ticks 4479 is not within 718 to 4478"),
        "{beyond}"
    );
    let currents = [(servo(1), 0.81)];
    let current = rig.bus().set(Setting::GoalCurrents(&currents)).remove(0);
    let current = current.unwrap_err().to_string();
    assert!(
        current.contains("current in A 0.81 is not within"),
        "{current}"
    );
}

#[test]
fn a_step_beyond_the_slew_is_refused_before_anything_is_sent() {
    let mut rig = rig();
    rig.engage().unwrap();
    let held = rig.held_goals().unwrap().to_vec();
    let home = rig.commanded().unwrap();
    let shifted = |by: f64| {
        let shifted: Vec<f64> = home.iter().map(|command| command - by).collect();
        rig.robot().command(&shifted).unwrap()
    };
    let [near, far] = [1.9e-3, 2.1e-3].map(shifted);
    let refused = rig.step(&far).unwrap_err();
    assert!(
        matches!(refused, RigError::TooFar { most: 261, .. }),
        "{refused}"
    );
    let said = refused.to_string();
    assert!(said.contains("motion.slew, 0.02 m/s, allows 261"), "{said}");
    assert!(rig.is_engaged());
    assert_eq!(rig.held_goals().unwrap(), held);
    rig.step(&near).unwrap();
    rig.release().unwrap();
}

/// A servo may be wound by more at once than the slew allows; it goes there in steps.
#[test]
fn tendons_are_wound_no_faster_than_the_slew() {
    let slow = SIMULATED.replace("slew = 0.02", "slew = 0.0002");
    let mut rig = Rig::open_file(file(&slow).unwrap(), Pace::Computed).unwrap();
    let settings = PretensionSettings {
        current: 0.2,
        step: 100,
        ..PretensionSettings::default()
    };
    let mut looks = 0;
    let stopped = rig.pretension(&settings, &mut |_| {
        looks += 1;
        match looks {
            3 => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        }
    });
    assert!(matches!(stopped, Err(RigError::Interrupted)), "{stopped:?}");
}

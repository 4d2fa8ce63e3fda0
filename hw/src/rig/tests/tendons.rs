//! How tendons pull: set by hand, and after one has snapped.

use super::*;
use crate::capture::{CaptureError, Session, SessionSettings};

/// A person who does as told.
#[test]
fn gears_that_are_turned_as_told_tension_all_tendons_alike() {
    let mut rig = rig();
    let simulator = rig.simulator().unwrap().clone();
    // One is much too tight, one is slack.
    simulator.shorten(servo(2), 8e-4);
    simulator.shorten(servo(5), -2e-3);
    let settings = ByHand {
        currents: vec![0.12],
        ..ByHand::default()
    };
    let mut first: Vec<Turn> = Vec::new();
    let mut tensions: Vec<f64> = Vec::new();
    let mut turn = |gauged: &[Gauged]| {
        if first.is_empty() {
            first = gauged.iter().map(|gauged| gauged.turn).collect();
        }
        let tendons = simulator.truth().tendons;
        tensions = tendons.iter().map(|tendon| tendon.tension).collect();
        for gauged in gauged {
            // A tenth of a millimetre for 50 mA that are missing.
            let length = (gauged.target - gauged.pull) * 2e-3;
            if gauged.turn != Turn::Leave {
                simulator.shorten(gauged.id, length);
            }
        }
        ControlFlow::Continue(())
    };
    let reached = rig.pretension_by_hand(&settings, &mut turn).unwrap();
    assert_eq!((first[1], first[4]), (Turn::Loosen, Turn::Tighten));
    assert_eq!(reached.len(), 6);
    for servo in &reached {
        assert!((servo.pull - 0.12).abs() < 0.0121, "{servo:?}");
    }
    // 0.517 N m/A on a spool of 5 mm; friction alone would hide 9 N either way.
    for tension in tensions {
        assert!((tension - 12.4).abs() < 5.0, "{tension}");
    }
    assert!(!rig.is_engaged() && rig.homing().iter().all(|h| matches!(h, Homing::Homed(_))));
    // Nobody turns anything.
    let settings = ByHand {
        currents: vec![0.12, 0.12, 0.3, 0.12, 0.12, 0.12],
        patience: Duration::from_secs(5),
        ..settings
    };
    let mut idle = |_: &[Gauged]| ControlFlow::Continue(());
    let said = rig.pretension_by_hand(&settings, &mut idle).unwrap_err();
    let said = said.to_string();
    assert!(
        said.contains("servo 3 pulls with 0.1") && said.contains("expected 0.3 A"),
        "{said}"
    );
    assert!(!said.contains("servo 4"), "{said}");
    let two = ByHand {
        currents: vec![0.1, 0.1],
        ..settings
    };
    let said = rig.pretension_by_hand(&two, &mut idle).unwrap_err();
    assert!(said.to_string().contains("a single one or 6"), "{said}");
}

/// A tendon that has snapped takes no current, though at home friction hides that.
#[test]
fn a_tendon_that_has_snapped_is_found_at_home() {
    let settings = SessionSettings {
        seed: 1,
        voxel_size: 0.004,
        ..SessionSettings::default()
    };
    let mut go_on = || ControlFlow::Continue(());
    let folder = tempfile::tempdir().unwrap();
    let file = masks::masked(folder.path(), "");
    let mut rig = Rig::open_file(file, Pace::Computed).unwrap();
    let simulator = rig.simulator().unwrap().clone();
    let mut session = Session::begin(&mut rig, &settings, None, &mut go_on).unwrap();
    session.check_tendons().unwrap();
    drop(session);
    for id in 1..=6 {
        let mut session = Session::begin(&mut rig, &settings, None, &mut go_on).unwrap();
        simulator.inject(Fault::Snapped(servo(id)));
        let found = session.check_tendons();
        let Err(CaptureError::Slack {
            id: named,
            pull,
            expected,
        }) = found
        else {
            panic!("servo {id}: {found:?}");
        };
        assert_eq!(named, id, "{pull} of {expected}");
        assert!(pull < 0.1 * expected, "{pull} of {expected}");
        session.end().unwrap();
        simulator.repair();
    }
}

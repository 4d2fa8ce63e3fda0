//! The examples run, and their pictures stand alone.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

#[allow(dead_code, reason = "its `main` is not called here")]
#[path = "../examples/calibration.rs"]
mod calibration;
#[allow(dead_code, reason = "its `main` is not called here")]
#[path = "../examples/contact_navigation.rs"]
mod contact_navigation;
#[allow(dead_code, reason = "its `main` is not called here")]
#[path = "../examples/follow_the_leader.rs"]
mod follow_the_leader;
#[allow(dead_code, reason = "its `main` is not called here")]
#[path = "../examples/friction_loop.rs"]
mod friction_loop;
#[allow(dead_code, reason = "its `main` is not called here")]
#[path = "../examples/plan_in_clutter.rs"]
mod plan_in_clutter;
#[cfg(feature = "rapier")]
#[allow(dead_code, reason = "its `main` is not called here")]
#[path = "../examples/push.rs"]
mod push;
#[allow(dead_code, reason = "its `main` is not called here")]
#[path = "../examples/rig.rs"]
mod rig;
#[allow(dead_code, reason = "its `main` is not called here")]
#[path = "../examples/shape_control.rs"]
mod shape_control;

use std::path::Path;

/// Runs an example; returns its picture.
fn picture(run: fn(&Path) -> anyhow::Result<()>) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture.svg");
    run(&path).unwrap();
    std::fs::read_to_string(path).unwrap()
}

fn assert_stands_alone(svg: &str) {
    assert!(svg.starts_with("<svg ") && svg.trim_end().ends_with("</svg>"));
    assert!(!svg.contains("NaN") && !svg.contains("href") && !svg.contains("url("));
}

#[test]
fn shape_control_draws_what_it_reached_and_what_it_did_not() {
    let svg = picture(shape_control::run);
    assert_stands_alone(&svg);
    for says in ["(mm)", "reached", "out of reach"] {
        assert!(svg.contains(says), "{says}");
    }
    // One dot for each target and each disc of the arc, and one for each of three legends.
    assert_eq!(svg.matches("<circle").count(), 72 + 15 + 3);
}

#[test]
fn contact_navigation_draws_the_pipe_and_both_ways_in() {
    let svg = picture(contact_navigation::run);
    assert_stands_alone(&svg);
    for says in ["left alone", "steered", "force of the walls (N)"] {
        assert!(svg.contains(says), "{says}");
    }
}

#[test]
fn plan_in_clutter_draws_the_balls_and_what_a_straight_line_would_hit() {
    let svg = picture(plan_in_clutter::run);
    assert_stands_alone(&svg);
    for says in ["start", "goal", "straight", "distance (mm)"] {
        assert!(svg.contains(says), "{says}");
    }
}

#[cfg(feature = "rapier")]
#[test]
fn push_draws_the_robot_and_what_it_pushes() {
    let svg = picture(push::run);
    assert_stands_alone(&svg);
    for says in ["robot", "box", "ball", "force (N)"] {
        assert!(svg.contains(says), "{says}");
    }
}

#[test]
fn follow_the_leader_draws_the_curve_and_both_bases() {
    let svg = picture(follow_the_leader::run);
    assert_stands_alone(&svg);
    for says in ["base free", "on a carriage", "deviation (% of the length)"] {
        assert!(svg.contains(says), "{says}");
    }
}

#[test]
fn calibration_draws_estimates_and_errors() {
    let svg = picture(calibration::run);
    assert_stands_alone(&svg);
    for says in ["bending stiffness", "(%)", "(mm)", "calibrated"] {
        assert!(svg.contains(says), "{says}");
    }
    // All four unknowns are identified.
    assert_eq!(svg.matches("<circle").count(), 4 + 1);
}

#[test]
fn friction_loop_draws_a_loop_and_a_profile_for_each_coefficient() {
    let svg = picture(friction_loop::run);
    assert_stands_alone(&svg);
    for says in ["tip x (mm)", "tension (N)", "friction 0.2"] {
        assert!(svg.contains(says), "{says}");
    }
    // A line in the plot and one in the legend, of four coefficients, in two panels.
    assert_eq!(svg.matches("stroke-width=\"1.8\"").count(), 16);
}

#[test]
fn a_rig_sees_the_robot_where_it_was_bent_to() {
    let seen = rig::run(Path::new("examples/rig-sim.toml")).unwrap();
    assert_eq!(seen.len(), 3);
    for seen in seen {
        let [x, y, z] = seen.middle;
        let (sin, cos) = seen.direction.sin_cos();
        // Towards the side it was bent to, by millimetres.
        assert!(x * cos + y * sin > 2e-3, "{:?}", seen.middle);
        assert!((0.2..0.35).contains(&z) && seen.points > 1000);
    }
}

//! Closed forms of beam theory.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use tdcr_sim::robot::{Frame, Loads};

use super::convergence::{assert_order, errors};
use super::rod::{JointPlace, Rod, TipLoad};

/// Deflections this small leave the linear theory in error by their square.
const SMALL: f64 = 1e-4;

#[test]
fn a_small_tip_force_bends_a_cantilever_by_the_third_power_of_its_length() {
    let rod = Rod {
        length: 0.7,
        ..Rod::unit()
    };
    // F L^3 / (3 E I).
    let load = TipLoad::force(3.0 * SMALL / rod.length.powi(3), 0.0, 0.0);
    let error = |n| rod.tip(n, &load).x / SMALL - 1.0;
    assert_order(2.0, errors(10, error), 2e-4);
}

#[test]
fn joints_at_the_discs_make_a_rod_of_first_order_only() {
    let rod = Rod::unit();
    let load = TipLoad::force(3.0 * SMALL, 0.0, 0.0);
    let error = |n| {
        let robot = rod.chain_with(n, 1, JointPlace::Top);
        rod.settle(&robot, &load.on(&robot)).positions[n - 1].x / SMALL - 1.0
    };
    let errors = errors(20, error);
    assert_order(1.0, errors, 2e-2);
    assert!(errors[2].abs() > 1e-2, "{errors:?}");
}

/// Here the errors of the midpoint rule and of the load's share at each disc cancel: the tip of a
/// chain of any number of discs deflects as the rod's.
#[test]
fn a_small_line_load_bends_a_cantilever_by_the_fourth_power_of_its_length() {
    let rod = Rod {
        length: 1.3,
        ..Rod::unit()
    };
    // w L^4 / (8 E I), whether it is a load or the rod's own weight.
    let load = 8.0 * SMALL / rod.length.powi(4);
    let loads = Loads::default().with_line_load([0.0, load, 0.0]).unwrap();
    let heavy = Rod {
        line_density: load / 9.81,
        gravity: [0.0, 9.81, 0.0],
        ..rod.clone()
    };
    for discs in [1, 2, 5, 40] {
        let loaded = rod.settle(&rod.chain(discs), &loads).positions[discs - 1];
        assert!((loaded.y / SMALL - 1.0).abs() < 1e-7, "{discs}: {loaded}");
        let weighed = heavy.tip(discs, &TipLoad::none());
        assert!((weighed.y / SMALL - 1.0).abs() < 1e-7, "{discs}: {weighed}");
    }
}

#[test]
fn bending_is_stiff_about_each_axis_as_specified() {
    let mut rod = Rod::unit();
    rod.stiffness = nalgebra::Vector3::new(1.0, 25.0, 0.5);
    let tip = rod.tip(40, &TipLoad::force(3.0 * SMALL, 3.0 * SMALL, 0.0));
    // A force along y bends about x.
    assert!((tip.y / SMALL - 1.0).abs() < 2e-4, "{tip}");
    assert!((25.0 * tip.x / SMALL - 1.0).abs() < 2e-4, "{tip}");
}

/// A moment turns every joint alike, so the discs lie on a circle that the links touch in their
/// middles: the radius is `h / (2 tan(theta/2))`, `theta = M h / (E I)` the turn of a joint.
#[test]
fn an_end_moment_bends_a_cantilever_into_an_arc_of_a_circle() {
    let rod = Rod::unit();
    for angle in [0.3, -FRAC_PI_2, PI, 1.5 * PI, TAU] {
        for frame in [Frame::World, Frame::Disc] {
            let load = TipLoad {
                frame,
                ..TipLoad::moment(0.0, angle, 0.0)
            };
            let on_polygon = |n: usize| {
                let robot = rod.chain(n);
                let settled = rod.settle(&robot, &load.on(&robot));
                let radius = 0.5 / (n as f64 * (0.5 * angle / n as f64).tan());
                for (disc, p) in settled.positions.iter().enumerate() {
                    let (sin, cos) = (angle * (disc + 1) as f64 / n as f64).sin_cos();
                    let expected = nalgebra::Vector3::new(1.0 - cos, 0.0, sin) * radius;
                    assert!(
                        (p - expected).norm() < 1e-9,
                        "{angle}, {disc}: {p} {expected}"
                    );
                }
                settled.positions[n / 2 - 1]
            };
            // The point half way up the rod.
            let (sin, cos) = (0.5 * angle).sin_cos();
            let arc = nalgebra::Vector3::new(1.0 - cos, 0.0, sin) / angle;
            assert_order(2.0, errors(10, |n| (on_polygon(n) - arc).norm()), 1e-3);
        }
    }
}

#[test]
fn a_torque_twists_a_rod_in_proportion_to_its_length() {
    let rod = Rod {
        length: 0.8,
        ..Rod::unit()
    };
    let torque = 1.7;
    let robot = rod.chain(20);
    let settled = rod.settle(&robot, &TipLoad::moment(0.0, 0.0, torque).on(&robot));
    for (disc, orientation) in settled.orientations.iter().enumerate() {
        let height = rod.length * (disc + 1) as f64 / 20.0;
        let expected = nalgebra::Vector3::new(0.0, 0.0, torque * height / rod.stiffness.z);
        assert!((orientation.scaled_axis() - expected).norm() < 1e-9);
    }
}

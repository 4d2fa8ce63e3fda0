//! Loads at which a straight column ceases to be stable.

use std::f64::consts::{FRAC_PI_2, PI};

use tdcr_sim::chain::Configuration;
use tdcr_sim::robot::{Loads, Robot};

use super::convergence::{assert_order, errors};
use super::rod::{Rod, TipLoad};

/// The load at which the straight pose loses its stability, by bisection.
fn critical(robot: &Robot, highest: f64, loads: impl Fn(f64) -> Loads) -> f64 {
    let command = robot.command(&[]).unwrap();
    let straight = robot.settle(&command, &Loads::default());
    assert_eq!(straight.configuration, Configuration::straight(robot));
    let stable = |load| robot.smallest_stiffness(&command, &loads(load), &straight) > 0.0;
    assert!(stable(0.0) && !stable(highest));
    let (mut low, mut high) = (0.0, highest);
    while high - low > 1e-9 * highest {
        let middle = 0.5 * (low + high);
        if stable(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[test]
fn a_column_buckles_under_eulers_load() {
    let rod = Rod::unit();
    let found = |n: usize| {
        let robot = rod.chain(n);
        let load = critical(&robot, 5.0, |load| {
            TipLoad::force(0.0, 0.0, -load).on(&robot)
        });
        // The chain's own load: its links' angles grow as sin(pi i / (2 n)).
        let joints = n as f64;
        let of_chain = 2.0 * joints * joints * (1.0 - (FRAC_PI_2 / joints).cos());
        assert!((load - of_chain).abs() < 1e-7, "{load} {of_chain}");
        load
    };
    let euler = PI * PI / 4.0;
    assert_order(2.0, errors(5, |n| found(n) / euler - 1.0), 1e-3);
}

/// Greenhill (1881): a column buckles under its weight at `q L^3 = 9/4 j^2 E I`, `j` the first zero
/// of the Bessel function of order -1/3.
#[test]
fn a_tall_column_buckles_under_its_own_weight() {
    let rod = Rod::unit();
    let found = |n: usize| {
        let loads = |load: f64| Loads::default().with_line_load([0.0, 0.0, -load]).unwrap();
        critical(&rod.chain(n), 20.0, loads)
    };
    let greenhill = 2.25 * 1.866_350_858_890_f64.powi(2);
    assert_order(2.0, errors(10, |n| found(n) / greenhill - 1.0), 1e-3);
}

#[test]
fn a_column_stands_below_its_critical_load_and_leans_above() {
    let rod = Rod::unit();
    let euler = PI * PI / 4.0;
    let tip = |share: f64| rod.tip(20, &TipLoad::force(0.0, 0.0, -share * euler));
    assert!(tip(0.99).xy().norm() < 1e-12);
    // The elastica just above the load: P / P_c = 1 + a^2 / 8 for the tip's angle a, and the tip's
    // deflection is 2 a L / pi (Timoshenko and Gere, Theory of Elastic Stability, 2.7).
    let angle = 0.2_f64;
    let settled = tip(1.0 + angle * angle / 8.0);
    let expected = 2.0 * angle / PI;
    assert!(
        (settled.xy().norm() / expected - 1.0).abs() < 0.05,
        "{settled}"
    );
}

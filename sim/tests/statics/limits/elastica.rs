//! The elastica of a cantilever under a transverse tip force of any size, in elliptic integrals.

use std::f64::consts::FRAC_PI_2;

use super::convergence::{assert_order, errors};
use super::rod::{Rod, TipLoad};

/// Simpson's rule on a smooth function.
fn integral(from: f64, to: f64, f: impl Fn(f64) -> f64) -> f64 {
    let n = 2_000;
    let h = (to - from) / f64::from(n);
    let weight = |i: i32| [2.0, 4.0][i as usize % 2];
    let inside: f64 = (1..n).map(|i| weight(i) * f(from + h * f64::from(i))).sum();
    (f(from) + inside + f(to)) * h / 3.0
}

/// Tip of a cantilever of unit length and stiffness under the transverse force `F`: along the force,
/// and along the rod (Bisshopp and Drucker, Large deflection of cantilever beams, 1945). With `a` the
/// tip's angle, `k^2 = (1 + sin a) / 2` and `sin t = 1 / (k sqrt 2)`, `sqrt F = K(k) - F(t, k)`.
fn elastica_tip(force: f64) -> (f64, f64) {
    let range = |sin_angle: f64| {
        let k2 = 0.5 * (1.0 + sin_angle);
        (k2, (0.5 / k2).sqrt().asin())
    };
    let root_of_force = |sin_angle: f64| {
        let (k2, start) = range(sin_angle);
        integral(start, FRAC_PI_2, |t| {
            1.0 / (1.0 - k2 * t.sin().powi(2)).sqrt()
        })
    };
    let (mut low, mut high): (f64, f64) = (0.0, 0.999);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if root_of_force(middle) < force.sqrt() {
            low = middle;
        } else {
            high = middle;
        }
    }
    let (k2, start) = range(low);
    let second = integral(start, FRAC_PI_2, |t| (1.0 - k2 * t.sin().powi(2)).sqrt());
    (
        1.0 - 2.0 / force.sqrt() * second,
        (2.0 * low / force).sqrt(),
    )
}

#[test]
fn the_elliptic_integrals_give_the_published_elastica() {
    // Mattiasson (1981), tip displacements by elliptic integrals.
    for (force, along, shortening) in [
        (1.0, 0.30172, 0.05643),
        (5.0, 0.71379, 0.38763),
        (10.0, 0.81061, 0.55500),
    ] {
        let (x, z) = elastica_tip(force);
        assert!((x - along).abs() < 1e-5, "{force}: {x}");
        assert!((1.0 - z - shortening).abs() < 1e-5, "{force}: {z}");
    }
}

#[test]
fn a_large_tip_force_bends_a_cantilever_as_the_elastica() {
    let rod = Rod::unit();
    for force in [0.5, 2.0, 10.0] {
        let (x, z) = elastica_tip(force);
        let error = |n| {
            let tip = rod.tip(n, &TipLoad::force(force, 0.0, 0.0));
            (tip - nalgebra::Vector3::new(x, 0.0, z)).norm()
        };
        assert_order(2.0, errors(10, error), 5e-4);
    }
}

//! Chains out of plane against the Cosserat rod of [`continuous`](super::continuous).

use nalgebra::Vector3;
use tdcr_sim::robot::Frame;

use super::convergence::{assert_order, errors};
use super::rod::{Parallel, Rod, TipLoad};

/// Stiff about one axis, soft in torsion, heavy, and leaning.
pub fn strip() -> Rod {
    Rod {
        length: 0.9,
        stiffness: Vector3::new(1.0, 2.5, 0.6),
        line_density: 0.12,
        gravity: [3.0, -5.0, -7.0],
        tendons: Vec::new(),
    }
}

#[track_caller]
fn assert_chains_tend_to_the_rod(rod: &Rod, load: &TipLoad, coarsest: usize, finest: f64) {
    let tip = rod.continuous_tip(load);
    // Out of plane, and bent far.
    assert!(
        tip.x.abs() > 0.05 * rod.length && tip.y.abs() > 0.05 * rod.length,
        "{tip}"
    );
    assert!(tip.z < 0.95 * rod.length, "{tip}");
    let error = |n| (rod.tip(n, load) - tip).norm();
    assert_order(2.0, errors(coarsest, error), finest);
}

#[test]
fn the_continuous_rod_bends_as_the_elastica() {
    // Tip by elliptic integrals: Mattiasson (1981).
    let tip = Rod::unit().continuous_tip(&TipLoad::force(10.0, 0.0, 0.0));
    assert!(
        (tip - Vector3::new(0.81061, 0.0, 0.445)).norm() < 1e-5,
        "{tip}"
    );
}

#[test]
fn a_wrench_in_the_world_frame_and_gravity_bend_a_strip_as_a_cosserat_rod() {
    let load = TipLoad {
        force: Vector3::new(1.2, 0.8, -0.5),
        moment: Vector3::new(-0.9, 1.4, 0.4),
        frame: Frame::World,
    };
    assert_chains_tend_to_the_rod(&strip(), &load, 10, 5e-4);
}

#[test]
fn a_wrench_that_follows_the_tip_bends_a_strip_as_a_cosserat_rod() {
    let load = TipLoad {
        force: Vector3::new(1.2, 0.8, -0.5),
        moment: Vector3::new(-0.9, 1.4, 0.4),
        frame: Frame::Disc,
    };
    assert_chains_tend_to_the_rod(&strip(), &load, 10, 5e-4);
}

#[test]
fn tendons_and_a_tip_force_bend_a_rod_as_the_cosserat_rod_with_tendons() {
    let rod = Rod {
        stiffness: Vector3::new(0.01, 0.01, 0.0077),
        length: 0.4,
        line_density: 0.02,
        gravity: [0.0, 0.0, -9.81],
        tendons: vec![
            Parallel {
                hole: [0.0, 0.01],
                end: 0.2,
                tension: 3.0,
            },
            Parallel {
                hole: [0.009, -0.005],
                end: 0.4,
                tension: 2.0,
            },
        ],
    };
    assert_chains_tend_to_the_rod(&rod, &TipLoad::force(0.03, 0.05, 0.02), 40, 5e-4);
}

//! The figures of the C++ code published with Rao, Peyron, Lilge and Burgner-Kahrs, How to model
//! tendon-driven continuum robots and benchmark modelling performance (Frontiers in Robotics and AI,
//! 2021).
//!
//! Two segments of 0.2 m; tendons t1 to t3 end at the end of the lower one, t4 to t6 at the tip, all
//! starting at the base, with tensions as commands; no gravity. That t4 to t6 pass through the lower
//! segment, and which way each pulls, is read off the figures: t4 alone bends the whole rod to +y by
//! `T r / (E I)`, t5 to +x and half as far to -y.
//!
//! Its models: VCref is a Cosserat rod between discs, PRBM pseudo-rigid bodies, CCsub an arc of constant
//! curvature between discs.

use std::f64::consts::FRAC_PI_4;

use nalgebra::Vector3;
use tdcr_sim::robot::{Body, Frame, Loads, Robot, Waypoint, Wrench};
use tdcr_sim::statics::Equilibrium;

use super::convergence::{assert_order, errors, extrapolated};
use super::rod::{JointPlace, Parallel, Rod, TipLoad};

/// Discs that guide tendons, on both segments.
const GUIDES: usize = 20;
/// Bending stiffness (N m2): 54 GPa, radius 0.7 mm.
const BENDING: f64 = 54e9 * FRAC_PI_4 * 0.7e-3 * 0.7e-3 * 0.7e-3 * 0.7e-3;

struct Case {
    name: &'static str,
    /// Tendons from 1 to 6 with their tensions (N).
    tensions: &'static [(usize, f64)],
    /// Force on the tip, world frame (N).
    force: [f64; 3],
    /// Where the published models have the tip (mm).
    vcref: [f64; 3],
    prbm: [f64; 3],
    ccsub: [f64; 3],
}

const CASES: [Case; 5] = [
    Case {
        name: "A",
        tensions: &[(1, 4.0), (5, 2.0)],
        force: [0.0, 0.0, 0.0],
        vcref: [129.371, 145.941, 334.201],
        prbm: [129.393, 145.942, 334.214],
        ccsub: [127.542, 143.276, 336.556],
    },
    Case {
        name: "C",
        tensions: &[(4, 2.0)],
        force: [0.0, 0.0, 0.0],
        vcref: [0.0, 150.059, 359.599],
        prbm: [0.02, 149.962, 359.667],
        ccsub: [0.0, 149.182, 360.119],
    },
    Case {
        name: "D",
        tensions: &[(4, 2.0)],
        force: [0.1, 0.0, 0.0],
        vcref: [168.596, 126.157, 319.821],
        prbm: [169.517, 124.829, 319.907],
        ccsub: [171.963, 123.747, 318.673],
    },
    Case {
        name: "E",
        tensions: &[(4, 2.0)],
        force: [0.0, 0.1, 0.0],
        vcref: [0.0, 247.467, 281.725],
        prbm: [0.02, 247.398, 281.830],
        ccsub: [0.0, 249.195, 279.488],
    },
    Case {
        name: "G",
        tensions: &[(1, 0.001)],
        force: [0.0, 0.1, 0.0],
        vcref: [0.0, 169.727, 353.765],
        prbm: [0.02, 169.604, 353.837],
        ccsub: [0.0, 174.108, 350.984],
    },
];

impl Case {
    fn rod(&self) -> Rod {
        // The published code takes Poisson's ratio to be 0.3.
        self.rod_of(0.3)
    }

    fn rod_of(&self, poissons_ratio: f64) -> Rod {
        let tendons = self.tensions.iter().map(|&(number, tension)| {
            let angle = [90.0, -30.0, 210.0][(number - 1) % 3];
            let (sin, cos) = f64::to_radians(angle).sin_cos();
            Parallel {
                hole: [0.01 * cos, 0.01 * sin],
                end: if number <= 3 { 0.2 } else { 0.4 },
                tension,
            }
        });
        Rod {
            length: 0.4,
            stiffness: Vector3::new(BENDING, BENDING, BENDING / (1.0 + poissons_ratio)),
            tendons: tendons.collect(),
            ..Rod::unit()
        }
    }

    fn load(&self) -> TipLoad {
        let [x, y, z] = self.force;
        TipLoad::force(x, y, z)
    }

    /// Tip with `joints` joints between guides (mm).
    fn tip(&self, joints: usize) -> Vector3<f64> {
        let rod = self.rod();
        let robot = rod.chain_with(GUIDES * joints, joints, JointPlace::Middle);
        last(&rod.settle(&robot, &self.load().on(&robot)))
    }
}

/// Tip (mm).
fn last(settled: &Equilibrium) -> Vector3<f64> {
    settled.positions.last().unwrap() * 1e3
}

fn apart(tip: Vector3<f64>, published: [f64; 3]) -> f64 {
    (tip - Vector3::from(published)).norm()
}

/// With one ball joint between guides, as in a disc-and-ball-joint robot. The distance to the published
/// Cosserat rod (2.2 to 2.4 mm of 400 mm; 8.6 mm in case A, with 6 N in the lower segment; 0.1 mm where
/// hardly a tendon pulls) is the price of one joint: it falls as the square of the number of joints,
/// as the next test shows.
#[test]
fn one_joint_between_discs_comes_within_millimetres_of_the_published_models() {
    for (case, (to_vcref, to_prbm, to_ccsub)) in CASES.iter().zip([
        (8.6, 8.6, 12.6),
        (2.1, 2.2, 3.1),
        (2.3, 3.0, 4.3),
        (2.4, 2.6, 0.5),
        (0.13, 0.08, 5.4),
    ]) {
        let tip = case.tip(1);
        for (published, most) in [
            (case.vcref, to_vcref),
            (case.prbm, to_prbm),
            (case.ccsub, to_ccsub),
        ] {
            let apart = apart(tip, published);
            assert!(apart < most, "case {}: {apart} mm", case.name);
        }
    }
}

#[test]
fn the_shear_modulus_matters_where_the_rod_leaves_the_plane_of_its_tendon() {
    for case in &CASES {
        let tip = |poissons_ratio: f64| {
            let rod = case.rod_of(poissons_ratio);
            rod.tip(GUIDES, &case.load()) * 1e3
        };
        let moved = (tip(0.2) - tip(0.3)).norm();
        let expected = if case.name == "D" { 1.03 } else { 0.0 };
        assert!(
            (moved - expected).abs() < 0.01,
            "case {}: {moved} mm",
            case.name
        );
    }
}

/// With ever more joints between guides, the chain tends to a Cosserat rod between discs. What then
/// remains to VCref, 0.14 mm at most, is explained by the test after this one.
#[test]
fn many_joints_between_discs_tend_to_the_published_cosserat_rod() {
    for (case, most) in CASES.iter().zip([0.14, 0.011, 0.15, 0.07, 0.002]) {
        let tips = [2, 4, 8].map(|joints| case.tip(joints));
        let limit = extrapolated(tips[1], tips[2]);
        let order = ((tips[0] - tips[1]).norm() / (tips[1] - tips[2]).norm()).log2();
        assert!((order - 2.0).abs() < 0.12, "case {}: {order}", case.name);
        let apart = apart(limit, case.vcref);
        assert!(apart < most, "case {}: {apart} mm", case.name);
    }
}

/// VCref leaves out the part of a tendon's force on a guide that is normal to the guide, which is there
/// wherever the bend changes from disc to disc. With wrenches that cancel it, the chain tends to VCref's
/// figures in every case, but for the rod's compression, which VCref has and the chain has not: tension
/// over `E A` = 83 kN, 0.019 mm in case A and 0.010 mm where t4 pulls.
#[test]
fn without_the_forces_normal_to_guides_the_limit_is_the_published_cosserat_rod() {
    for (case, most) in CASES.iter().zip([0.022, 0.011, 0.011, 0.011, 0.002]) {
        let tips = [2, 4].map(|joints| without_normal_pulls(case, joints));
        let apart = apart(extrapolated(tips[0], tips[1]), case.vcref);
        assert!(apart < most, "case {}: {apart} mm", case.name);
    }
}

#[test]
fn more_discs_tend_to_the_continuous_rod_with_continuous_tendons() {
    // kappa = T r / (E I).
    let curvature = 2.0 * 0.01 / BENDING;
    let (sin, cos) = (0.4 * curvature).sin_cos();
    let arc = Vector3::new(0.0, 1.0 - cos, sin) * (1e3 / curvature);
    // The published code's continuous rod, which is compressed by 0.010 mm.
    assert!(apart(arc, [0.0, 149.204, 360.096]) < 0.011, "{arc}");
    for case in &CASES {
        let (rod, load) = (case.rod(), case.load());
        let continuous = rod.continuous_tip(&load) * 1e3;
        if case.name == "C" {
            assert!((continuous - arc).norm() < 1e-6, "{continuous}");
        }
        let tip = |discs| rod.tip(discs, &load) * 1e3;
        let error = |discs| (tip(discs) - continuous).norm();
        // 10, 20 and 40 discs a segment.
        assert_order(2.0, errors(20, error), 0.75);
        let limit = extrapolated(tip(40), tip(80));
        let apart = (limit - continuous).norm();
        assert!(apart < 0.06, "case {}: {apart} mm", case.name);
    }
}

/// Tip (mm) when guides take up no tendon force along the backbone.
fn without_normal_pulls(case: &Case, joints: usize) -> Vector3<f64> {
    let rod = case.rod();
    let robot = rod.chain_with(GUIDES * joints, joints, JointPlace::Middle);
    let mut settled = rod.settle(&robot, &case.load().on(&robot));
    for _ in 0..50 {
        let loads = cancel_normal_pulls(&robot, &settled, case.load().on(&robot));
        let next = rod.settle(&robot, &loads);
        let moved = (last(&next) - last(&settled)).norm();
        settled = next;
        if moved < 1e-6 {
            return last(&settled);
        }
    }
    panic!(
        "case {}: the pulls along the backbone do not settle",
        case.name
    );
}

/// `loads` with wrenches against the tendons' forces on their guides along the guides' axes.
fn cancel_normal_pulls(robot: &Robot, settled: &Equilibrium, mut loads: Loads) -> Loads {
    for (tendon, &tension) in robot.tendons().iter().zip(&settled.tendon_tensions) {
        let holes: Vec<_> = (tendon.route.iter())
            .map(|waypoint| hole(robot, settled, waypoint))
            .collect();
        for (guide, waypoint) in tendon
            .route
            .iter()
            .enumerate()
            .take(holes.len() - 1)
            .skip(1)
        {
            let Body::Disc(disc) = waypoint.0 else {
                panic!("guides are discs")
            };
            let towards = |other: usize| (holes[other] - holes[guide]).normalize();
            let axis = settled.orientations[disc] * Vector3::z();
            let pull = (towards(guide - 1) + towards(guide + 1)).dot(&axis) * tension;
            let force = axis * -pull;
            let arm = holes[guide] - settled.positions[disc];
            let wrench = Wrench {
                disc,
                point: [0.0; 3],
                force: force.into(),
                moment: arm.cross(&force).into(),
                frame: Frame::World,
            };
            loads = loads.with_wrench(wrench).unwrap();
        }
    }
    loads
}

/// A hole in the world (m).
fn hole(robot: &Robot, settled: &Equilibrium, waypoint: &Waypoint) -> Vector3<f64> {
    let [x, y] = robot.spec().holes(waypoint.0).unwrap().positions()[waypoint.1];
    let local = Vector3::new(x, y, 0.0);
    match waypoint.0 {
        Body::Base => local,
        Body::Disc(disc) => settled.positions[disc] + settled.orientations[disc] * local,
    }
}

//! Random robots.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::robot::{Frame, Limit, PerDisc, Wrench};

use super::case::{NOISE, assert_derivatives_agree, case_of, derivatives_agree, random_case};
use crate::random_robot::{Kind, random_hinged_robot};

#[test]
fn derivatives_are_differences_of_settled_poses_on_random_robots() {
    let mut rng = ChaCha8Rng::seed_from_u64(32);
    let mut checked = 0;
    for k in 0..16 {
        let mut case = random_case(&mut rng);
        // Limits are kinks: differences across one would be of neither side.
        case.spec
            .modules
            .iter_mut()
            .for_each(|module| module.limit = None);
        checked += usize::from(derivatives_agree(&case, &format!("robot {k}"), NOISE));
    }
    assert!(checked >= 12, "{checked} robots settled");
}

/// Against the same changes written once more, in this file.
#[test]
fn they_are_so_with_moments_and_following_forces() {
    let mut rng = ChaCha8Rng::seed_from_u64(33);
    let mut checked = 0;
    for k in 0..8 {
        let mut case = random_case(&mut rng);
        case.spec
            .modules
            .iter_mut()
            .for_each(|module| module.limit = None);
        let tip = case.spec.disc_count() - 1;
        for (disc, frame) in [(tip, Frame::Disc), (tip / 2, Frame::World)] {
            let wrench = Wrench {
                disc,
                point: [0.01, 0.02, -0.015],
                force: [0.03, -0.02, 0.05],
                moment: [1e-3, 2e-3, -1e-3],
                frame,
            };
            case.loads = case.loads.with_wrench(wrench).unwrap();
        }
        checked += usize::from(derivatives_agree(&case, &format!("robot {k}"), NOISE));
    }
    assert!(checked >= 6, "{checked} robots settled");
}

/// Universal joints and others, some modules on ball joints, with and without following loads.
#[test]
fn they_are_so_on_hinges() {
    let mut rng = ChaCha8Rng::seed_from_u64(35);
    let mut checked = 0;
    for k in 0..12 {
        let mut case = case_of(&random_hinged_robot(Kind::Elastic, &mut rng), &mut rng);
        case.spec
            .modules
            .iter_mut()
            .for_each(|module| module.limit = None);
        if k % 2 == 1 {
            let wrench = Wrench {
                disc: case.spec.disc_count() - 1,
                point: [0.01, 0.02, -0.015],
                force: [0.03, -0.02, 0.05],
                moment: [1e-3, 2e-3, -1e-3],
                frame: Frame::Disc,
            };
            case.loads = case.loads.with_wrench(wrench).unwrap();
        }
        checked += usize::from(derivatives_agree(&case, &format!("hinges {k}"), NOISE));
    }
    assert!(checked >= 9, "{checked} robots settled");
}

#[test]
fn they_are_so_within_a_limit() {
    let mut rng = ChaCha8Rng::seed_from_u64(34);
    let mut case = random_case(&mut rng);
    for module in &mut case.spec.modules {
        module.limit = Some(PerDisc::Uniform(Limit {
            angle: 1e-3,
            stiffness: 0.5,
        }));
    }
    assert_derivatives_agree(&case, "at the limits");
}

//! The metrics against SciPy, against all permutations, and on geometry that is hard to match.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use std::num::NonZeroUsize;

use proptest::prelude::*;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_learn::metrics::{
    Emd, GroundCost, MetricError, Side, chamfer, emd, emd_approximate, emd_squared, emd_with,
};

type Cloud = Vec<[f32; 3]>;

const COSTS: [GroundCost; 2] = [GroundCost::Distance, GroundCost::SquaredDistance];

/// One case of tests/data/metrics_scipy.py, which says what the fields are.
#[derive(serde::Deserialize)]
struct Reference {
    name: String,
    p: Vec<[i32; 3]>,
    q: Vec<[i32; 3]>,
    chamfer: f64,
    chamfer_part: f64,
    emd: f64,
    emd_squared: f64,
}

fn references() -> Vec<Reference> {
    serde_json::from_str(include_str!("data/metrics_scipy.json")).unwrap()
}

fn metres(cloud: &[[i32; 3]]) -> Cloud {
    cloud
        .iter()
        .map(|point| point.map(|x| x as f32 * 1e-4))
        .collect()
}

fn assert_close(name: &str, actual: f64, expected: f64) {
    assert!(
        (actual - expected).abs() <= 1e-12 * expected,
        "{name}: {actual:e} instead of {expected:e}"
    );
}

/// Ground cost of a pair, written out.
fn pair_cost(cost: GroundCost, a: [f32; 3], b: [f32; 3]) -> f64 {
    let squared: f64 = (0..3)
        .map(|k| (f64::from(a[k]) - f64::from(b[k])).powi(2))
        .sum();
    match cost {
        GroundCost::Distance => squared.sqrt(),
        GroundCost::SquaredDistance => squared,
    }
}

/// The matching is a permutation whose mean cost is the value.
fn assert_matching(p: &[[f32; 3]], q: &[[f32; 3]], cost: GroundCost, result: &Emd) {
    let mut partners = result.matching.clone();
    partners.sort_unstable();
    assert!(partners.into_iter().eq(0..p.len()), "not a permutation");
    let pairs = p.iter().zip(&result.matching);
    let mean = pairs.map(|(a, &j)| pair_cost(cost, *a, q[j])).sum::<f64>() / p.len() as f64;
    assert_close("mean cost of the matching", mean, result.value);
}

/// The same, and the gap closes.
fn assert_sound(p: &[[f32; 3]], q: &[[f32; 3]], cost: GroundCost, result: &Emd) {
    assert_matching(p, q, cost, result);
    assert!(
        (0.0..=1e-9 * result.value).contains(&result.gap),
        "gap {:e} of value {:e}",
        result.gap,
        result.value
    );
}

/// Least mean cost over all permutations of the columns from `row` on.
fn least_over_permutations(cost: &[Vec<f64>], columns: &mut [usize], row: usize) -> f64 {
    if row == columns.len() {
        return 0.0;
    }
    let mut least = f64::INFINITY;
    for choice in row..columns.len() {
        columns.swap(row, choice);
        let here = cost[row][columns[row]];
        least = least.min(here + least_over_permutations(cost, columns, row + 1));
        columns.swap(row, choice);
    }
    least
}

fn by_all_permutations(p: &[[f32; 3]], q: &[[f32; 3]], cost: GroundCost) -> f64 {
    let costs: Vec<Vec<f64>> = p
        .iter()
        .map(|a| q.iter().map(|b| pair_cost(cost, *a, *b)).collect())
        .collect();
    let mut columns: Vec<usize> = (0..q.len()).collect();
    least_over_permutations(&costs, &mut columns, 0) / p.len() as f64
}

/// Two clouds of `sizes` points; on a grid as coarse as 1/`cells`, so that points and costs repeat.
fn pair(sizes: std::ops::Range<usize>, cells: i32) -> impl Strategy<Value = (Cloud, Cloud)> {
    let point =
        move || prop::array::uniform3((-cells..=cells).prop_map(move |x| x as f32 / cells as f32));
    sizes.prop_flat_map(move |n| {
        (
            prop::collection::vec(point(), n),
            prop::collection::vec(point(), n),
        )
    })
}

/// Surface samples (m) of a tube 0.3 m long and 40 mm wide, bent by `bend` rad to a circular arc.
fn tube(n: usize, bend: f64, rng: &mut ChaCha8Rng) -> Cloud {
    let radius = 0.3 / bend;
    (0..n)
        .map(|_| {
            let (angle, around) = (
                bend * rng.random::<f64>(),
                std::f64::consts::TAU * rng.random::<f64>(),
            );
            let (x, y) = (0.02 * around.cos(), 0.02 * around.sin());
            let bent = [
                radius * (1.0 - angle.cos()) + x * angle.cos(),
                y,
                (radius - x) * angle.sin(),
            ];
            bent.map(|x| x as f32)
        })
        .collect()
}

#[test]
fn chamfer_is_that_of_scipy() {
    for case in references() {
        let (p, q) = (metres(&case.p), metres(&case.q));
        assert_close(&case.name, chamfer(&p, &q).unwrap(), case.chamfer);
        let part = chamfer(&p, &q[..q.len() / 3]).unwrap();
        assert_close(&case.name, part, case.chamfer_part);
    }
}

#[test]
fn emd_is_that_of_scipy() {
    for case in references() {
        let (p, q) = (metres(&case.p), metres(&case.q));
        for (cost, expected) in COSTS.into_iter().zip([case.emd, case.emd_squared]) {
            let result = emd_with(&p, &q, cost).unwrap();
            assert_close(&case.name, result.value, expected);
            assert_sound(&p, &q, cost, &result);
        }
    }
}

#[test]
fn emd_of_equal_clouds_is_zero() {
    let p = tube(500, 0.4, &mut ChaCha8Rng::seed_from_u64(1));
    let mut q = p.clone();
    q.shuffle(&mut ChaCha8Rng::seed_from_u64(2));
    for cost in COSTS {
        let result = emd_with(&p, &q, cost).unwrap();
        assert_eq!(result.value, 0.0);
        assert!(result.gap < 1e-18);
        assert!(p.iter().zip(&result.matching).all(|(a, &j)| *a == q[j]));
    }
}

#[test]
fn emd_of_coincident_points_is_their_distance() {
    let (p, q) = (vec![[0.0; 3]; 300], vec![[0.1, 0.2, 0.2]; 300]);
    let result = emd(&p, &q).unwrap();
    assert_close(
        "distance",
        result.value,
        pair_cost(GroundCost::Distance, p[0], q[0]),
    );
    assert_sound(&p, &q, GroundCost::Distance, &result);
}

#[test]
fn emd_on_a_line_matches_the_points_in_order() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut line = || -> Cloud {
        (0..400)
            .map(|_| [0.3 * rng.random::<f32>(), 0.0, 0.0])
            .collect()
    };
    let (p, q) = (line(), line());
    let sorted = |cloud: &Cloud| {
        let mut cloud = cloud.clone();
        cloud.sort_by(|a, b| a[0].total_cmp(&b[0]));
        cloud
    };
    let (in_order_p, in_order_q) = (sorted(&p), sorted(&q));
    for cost in COSTS {
        let result = emd_with(&p, &q, cost).unwrap();
        let pairs = in_order_p.iter().zip(&in_order_q);
        let expected = pairs.map(|(a, b)| pair_cost(cost, *a, *b)).sum::<f64>() / 400.0;
        assert_close("in order", result.value, expected);
        assert_sound(&p, &q, cost, &result);
    }
}

#[test]
fn emd_squared_of_a_shifted_cloud_is_the_squared_shift() {
    // Steps of 2^-12 keep the shift exact in single precision.
    let p: Cloud = tube(1000, 0.4, &mut ChaCha8Rng::seed_from_u64(4))
        .iter()
        .map(|point| point.map(|x| (x * 4096.0).round() / 4096.0))
        .collect();
    let q: Cloud = p.iter().map(|[x, y, z]| [x + 0.25, y - 0.5, *z]).collect();
    let result = emd_squared(&p, &q).unwrap();
    assert_close("shift", result.value, 0.25 * 0.25 + 0.5 * 0.5);
    assert_sound(&p, &q, GroundCost::SquaredDistance, &result);
}

#[test]
fn emd_between_distant_clusters_moves_each_by_its_own_way() {
    // Two clusters of 1 mm, 10 m apart; their images lie 1 m further up.
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut cluster = |x: f32, z: f32| -> Cloud {
        (0..150)
            .map(|_| {
                [
                    x,
                    1e-3 * rng.random::<f32>(),
                    z + 1e-3 * rng.random::<f32>(),
                ]
            })
            .collect()
    };
    let p = [cluster(0.0, 0.0), cluster(10.0, 0.0)].concat();
    let q = [cluster(10.0, 1.0), cluster(0.0, 1.0)].concat();
    for cost in COSTS {
        let result = emd_with(&p, &q, cost).unwrap();
        assert!((result.value - 1.0).abs() < 3e-3);
        assert!(
            result
                .matching
                .iter()
                .enumerate()
                .all(|(i, &j)| (i < 150) == (j >= 150))
        );
        assert_sound(&p, &q, cost, &result);
    }
}

#[test]
fn emd_is_symmetric_and_blind_to_the_order_of_points() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let (p, q) = (tube(700, 0.001, &mut rng), tube(700, 1.2, &mut rng));
    let (mut shuffled_p, mut shuffled_q) = (p.clone(), q.clone());
    shuffled_p.shuffle(&mut rng);
    shuffled_q.shuffle(&mut rng);
    for cost in COSTS {
        let result = emd_with(&p, &q, cost).unwrap();
        assert_sound(&p, &q, cost, &result);
        assert_close(
            "swapped",
            emd_with(&q, &p, cost).unwrap().value,
            result.value,
        );
        let shuffled = emd_with(&shuffled_p, &shuffled_q, cost).unwrap();
        assert_close("shuffled", shuffled.value, result.value);
    }
}

#[test]
fn emd_does_not_see_a_common_translation() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let round = |cloud: Cloud| -> Cloud {
        cloud
            .iter()
            .map(|point| point.map(|x| (x * 4096.0).round() / 4096.0))
            .collect()
    };
    let (p, q) = (
        round(tube(300, 0.1, &mut rng)),
        round(tube(300, 0.6, &mut rng)),
    );
    let moved = |cloud: &Cloud| -> Cloud {
        cloud
            .iter()
            .map(|[x, y, z]| [x + 64.0, y - 32.0, z + 16.0])
            .collect()
    };
    for cost in COSTS {
        let result = emd_with(&moved(&p), &moved(&q), cost).unwrap();
        assert_close("moved", result.value, emd_with(&p, &q, cost).unwrap().value);
        assert_sound(&moved(&p), &moved(&q), cost, &result);
    }
}

#[test]
fn emd_names_what_is_wrong_with_its_clouds() {
    let good = [[0.0; 3]; 2];
    assert_eq!(
        emd(&[], &good),
        Err(MetricError::EmptyCloud { side: Side::First })
    );
    let unequal = emd(&good, &good[..1]).unwrap_err();
    assert_eq!(
        unequal,
        MetricError::UnequalSizes {
            first: 2,
            second: 1
        }
    );
    assert_eq!(
        unequal.to_string(),
        "the clouds hold 2 and 1 points; the earth mover's distance needs equal sizes"
    );
    let bad = [[0.0; 3], [0.0, 0.0, f32::NAN]];
    assert!(matches!(
        emd(&good, &bad),
        Err(MetricError::NonFinite {
            side: Side::Second,
            index: 1,
            ..
        })
    ));
}

/// How much above the least cost the approximation is, and its gap, relative to the least cost.
fn excess_and_gap(p: &Cloud, q: &Cloud, cost: GroundCost, group: usize) -> [f64; 2] {
    let result = emd_approximate(p, q, cost, NonZeroUsize::new(group).unwrap()).unwrap();
    assert_matching(p, q, cost, &result);
    let least = emd_with(p, q, cost).unwrap().value;
    let excess = result.value - least;
    assert!(excess >= -1e-12 * least, "{} below {least}", result.value);
    assert!(
        excess <= result.gap + 1e-9 * least,
        "{excess:e} above the least, gap {:e}",
        result.gap
    );
    [excess, result.gap].map(|x| x / least)
}

#[test]
fn approximate_emd_is_near_for_clouds_apart() {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    // 1,003 points make groups of 7 and of 8.
    let (p, q) = (tube(1003, 0.1, &mut rng), tube(1003, 1.2, &mut rng));
    let far: Cloud = q.iter().map(|[x, y, z]| [x + 1.0, *y, *z]).collect();
    for cost in COSTS {
        let [_, gap] = excess_and_gap(&p, &q, cost, 8);
        assert!(gap < 0.2, "{gap}");
        let [_, gap] = excess_and_gap(&p, &far, cost, 8);
        assert!(gap < 0.01, "{gap}");
    }
}

#[test]
fn approximate_emd_names_what_is_wrong_with_its_clouds() {
    let good = [[0.0; 3]; 2];
    let unequal = emd_approximate(&good, &good[..1], COSTS[0], NonZeroUsize::MIN).unwrap_err();
    assert_eq!(
        unequal,
        MetricError::UnequalSizes {
            first: 2,
            second: 1
        }
    );
}

proptest! {
    #[test]
    fn approximate_emd_keeps_its_bound((p, q) in pair(1..150, 1000), group in 1..20usize) {
        for cost in COSTS {
            excess_and_gap(&p, &q, cost, group);
        }
    }

    #[test]
    fn approximate_emd_keeps_its_bound_where_points_repeat((p, q) in pair(70..200, 1), group in 1..20usize) {
        for cost in COSTS {
            let result = emd_approximate(&p, &q, cost, NonZeroUsize::new(group).unwrap()).unwrap();
            let least = emd_with(&p, &q, cost).unwrap().value;
            prop_assert!(result.value >= least - 1e-12 && result.value - result.gap <= least + 1e-12);
        }
    }

    #[test]
    fn emd_is_least_over_all_permutations((p, q) in pair(1..8, 1000)) {
        for cost in COSTS {
            let result = emd_with(&p, &q, cost).unwrap();
            let expected = by_all_permutations(&p, &q, cost);
            prop_assert!((result.value - expected).abs() <= 1e-12);
        }
    }

    #[test]
    fn emd_is_least_over_all_permutations_of_points_that_repeat((p, q) in pair(1..8, 1)) {
        for cost in COSTS {
            let result = emd_with(&p, &q, cost).unwrap();
            let expected = by_all_permutations(&p, &q, cost);
            prop_assert!((result.value - expected).abs() <= 1e-12);
        }
    }

    #[test]
    fn emd_proves_itself_whatever_the_clouds((p, q) in pair(1..200, 6)) {
        for cost in COSTS {
            assert_sound(&p, &q, cost, &emd_with(&p, &q, cost).unwrap());
        }
    }
}

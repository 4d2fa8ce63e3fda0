//! Clouds of fewer points, evenly spread.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::f64::consts::PI;

use rayon::prelude::*;

use super::kdtree::KdTree;
use super::{MetricError, NEIGHBOURS, Side, checked, neighbourhoods};

/// Points about a point that may crowd it.
const OTHERS: usize = NEIGHBOURS - 1;

/// Indices, in order, of the `count` of `points` (m) that are left when the point that is crowded the most is taken away, again
/// and again; of all where there are no more.
///
/// This is sample elimination (Yuksel, Computer Graphics Forum 34, 2015): a point is crowded by those of its 15 nearest that lie
/// within `r`, each by `(1 - d / r)^2` at the distance `d`, and `r` is twice the radius of the discs of which as many as will be
/// left fill the plane about it, `r = 2 sqrt(A / (2 sqrt(3)))` with the area `A` that each will have. The density of the cloud
/// is kept: of every 8 to 16 neighbouring points, the leaves of a k-d tree, the same share is taken away.
///
/// # Errors
/// Fewer than 16 points, or a coordinate that is not finite.
pub fn evenly_spread(points: &[[f32; 3]], count: usize) -> Result<Vec<usize>, MetricError> {
    let tree = KdTree::new(&checked(points, Side::First)?);
    let mut crowds = Crowds::new(&tree, count)?;
    let mut order: BinaryHeap<_> = (0..points.len())
        .map(|slot| (crowds.key(slot), Reverse(slot)))
        .collect();
    // How many of each leaf go, and the leaf of each slot.
    let excess = points.len().saturating_sub(count);
    let share = |slots: usize| slots * excess / points.len();
    let (mut quotas, mut leaf_of) = (Vec::new(), Vec::with_capacity(points.len()));
    for slots in tree.leaves().map(|leaf| tree.slots(leaf)) {
        leaf_of.extend(slots.clone().map(|_| quotas.len()));
        quotas.push(share(slots.end) - share(slots.start));
    }
    let mut kept = Vec::with_capacity(count);
    while let Some((key, Reverse(slot))) = order.pop() {
        let quota = &mut quotas[leaf_of[slot]];
        if *quota == 0 {
            kept.push(tree.order()[slot]);
        } else if key > crowds.key(slot) {
            // Crowds only grow smaller: a point whose entry is out of date takes its place further behind.
            order.push((crowds.key(slot), Reverse(slot)));
        } else {
            crowds.remove(slot);
            *quota -= 1;
        }
    }
    kept.sort_unstable();
    Ok(kept)
}

/// How crowded each point of a tree is, by slot.
struct Crowds {
    /// Sum of what crowds a point.
    weights: Vec<f64>,
    /// Points (slots) crowded by that of slot `s`, and their weights, from `starts[s]` to `starts[s + 1]`.
    crowded: Vec<(usize, f64)>,
    starts: Vec<usize>,
}

impl Crowds {
    /// Of the points of `tree`, of which `count` will be left.
    fn new(tree: &KdTree, count: usize) -> Result<Self, MetricError> {
        let points = tree.points();
        let share = points.len() as f64 / count.max(1) as f64;
        let about = |neighbours: [(f64, usize); NEIGHBOURS]| {
            let area = PI * neighbours[OTHERS].0 / OTHERS as f64 * share;
            let radius = 2.0 * (area / (2.0 * 3.0_f64.sqrt())).sqrt();
            neighbours.map(|(squared, other)| {
                let within = 1.0 - squared.sqrt() / radius;
                // Fifteen points at one place crowd each other as much as any can.
                let within = if radius > 0.0 { within.max(0.0) } else { 1.0 };
                (other, within * within)
            })
        };
        let nearest: Vec<_> = neighbourhoods(tree, points, Side::First)?
            .map(about)
            .collect();
        let pairs = || {
            let listed = nearest.iter().enumerate();
            listed.flat_map(|(slot, list)| list.iter().map(move |&(other, w)| (slot, other, w)))
        };
        let pairs = || pairs().filter(|&(slot, other, weight)| slot != other && weight > 0.0);
        let mut weights = vec![0.0; points.len()];
        let mut starts = vec![0; points.len() + 1];
        for (slot, other, weight) in pairs() {
            weights[slot] += weight;
            starts[other + 1] += 1;
        }
        for slot in 0..points.len() {
            starts[slot + 1] += starts[slot];
        }
        let mut next = starts.clone();
        let mut crowded = vec![(0, 0.0); starts[points.len()]];
        for (slot, other, weight) in pairs() {
            crowded[next[other]] = (slot, weight);
            next[other] += 1;
        }
        Ok(Self {
            weights,
            crowded,
            starts,
        })
    }

    /// A number that grows with what crowds a point: bits of numbers that are not negative are in their order.
    fn key(&self, slot: usize) -> u64 {
        self.weights[slot].max(0.0).to_bits()
    }

    fn remove(&mut self, slot: usize) {
        for &(other, weight) in &self.crowded[self.starts[slot]..self.starts[slot + 1]] {
            self.weights[other] -= weight;
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::super::nearest_distances;
    use super::*;
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Independent points of a unit square, `left` and `right` of its middle.
    fn square([left, right]: [usize; 2], seed: u64) -> Vec<[f32; 3]> {
        let rng = &mut ChaCha8Rng::seed_from_u64(seed);
        let mut half = |n: usize, start: f32| -> Vec<[f32; 3]> {
            (0..n)
                .map(|_| [start + rng.random_range(0.0..0.5), rng.random(), 0.0])
                .collect()
        };
        [half(left, 0.0), half(right, 0.5)].concat()
    }

    fn thinned(points: &[[f32; 3]], count: usize) -> Vec<[f32; 3]> {
        let kept = evenly_spread(points, count).unwrap();
        kept.into_iter().map(|k| points[k]).collect()
    }

    proptest! {
        #[test]
        fn as_many_as_are_wanted_are_kept_in_their_order(
            points in prop::collection::vec(prop::array::uniform3(-1.0f32..1.0), 16..120),
            count in 0usize..150,
        ) {
            let kept = evenly_spread(&points, count).unwrap();
            prop_assert_eq!(kept.len(), count.min(points.len()));
            prop_assert!(kept.is_sorted_by(|a, b| a < b));
        }
    }

    #[test]
    fn a_surface_is_covered_better_than_by_as_many_independent_points() {
        let places = square([10_000; 2], 1);
        let miss = |points: &[[f32; 3]]| {
            let distances = nearest_distances(&places, points).unwrap();
            distances.iter().map(|d| d * d).sum::<f64>() / places.len() as f64
        };
        let drawn = square([1500; 2], 2);
        // Independent points miss a place by 1 / (pi density), which is 1 / (2000 pi) here.
        let independent = miss(&square([1000; 2], 3));
        assert!(
            (independent * 2000.0 * PI - 1.0).abs() < 0.1,
            "{independent}"
        );
        let even = miss(&thinned(&drawn, 2000));
        assert!(even < 0.8 * independent, "{even} beside {independent}");
    }

    #[test]
    fn where_points_are_twice_as_dense_they_stay_so() {
        let kept = thinned(&square([2000, 1000], 4), 1500);
        let left = kept.iter().filter(|point| point[0] < 0.5).count() as f64;
        assert!((left / 1000.0 - 1.0).abs() < 0.03, "{left} of 1500");
    }

    #[test]
    fn wires_keep_their_share_beside_surfaces() {
        let wire = (0..1000).map(|k| [k as f32 / 1000.0, 0.5, 0.3]);
        let points = [square([1000; 2], 5), wire.collect()].concat();
        let kept = thinned(&points, 2000);
        let on_wire = kept.iter().filter(|point| point[2] > 0.0).count() as f64;
        assert!((on_wire / 667.0 - 1.0).abs() < 0.03, "{on_wire} of 2000");
    }

    #[test]
    fn points_at_one_place_are_thinned() {
        assert_eq!(thinned(&[[0.25; 3]; 40], 7), [[0.25; 3]; 7]);
    }

    #[test]
    fn clouds_without_neighbourhoods_are_refused() {
        let few = evenly_spread(&[[0.0; 3]; 15], 4).unwrap_err();
        assert_eq!(
            few.to_string(),
            "the first cloud holds 15 points, expected at least 16"
        );
        let mut points = vec![[0.0; 3]; 20];
        points[3][1] = f32::NAN;
        assert!(evenly_spread(&points, 4).is_err());
    }
}

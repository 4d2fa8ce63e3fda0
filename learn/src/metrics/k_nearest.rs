//! The `K` nearest points, found in a k-d tree.

use super::kdtree::{KdTree, squared_distance};

/// `K` points by ascending distance from a place: squared distances (m^2) and slots.
struct Nearest<const K: usize>([(f64, usize); K]);

impl<const K: usize> Nearest<K> {
    /// Takes in a point nearer than the last, which drops out.
    fn insert(&mut self, squared: f64, slot: usize) {
        let mut place = K - 1;
        while place > 0 && self.0[place - 1].0 > squared {
            self.0[place] = self.0[place - 1];
            place -= 1;
        }
        self.0[place] = (squared, slot);
    }
}

impl KdTree {
    /// The `K` points nearest to `x` (m), by ascending distance: their squared distances (m^2) and their slots. Of points
    /// equally far, any may be taken.
    ///
    /// # Panics
    /// Where the tree holds fewer than `K` points.
    pub(super) fn k_nearest<const K: usize>(&self, x: &[f64; 3]) -> [(f64, usize); K] {
        assert!(K <= self.len(), "{K} points of {}", self.len());
        let mut nearest = Nearest([(f64::INFINITY, 0); K]);
        let mut limit = f64::INFINITY;
        self.descend(
            1,
            &mut limit,
            &|node| self.boxes()[node].squared_distance(x),
            &mut |slots, limit| {
                for slot in slots {
                    let squared = squared_distance(x, &self.points()[slot]);
                    if squared < *limit {
                        nearest.insert(squared, slot);
                        *limit = nearest.0[K - 1].0;
                    }
                }
            },
        );
        nearest.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn no_point_is_nearer_than_the_k_nearest(
            points in prop::collection::vec(prop::array::uniform3(-1.0f64..1.0), 5..200),
            x in prop::array::uniform3(-2.0f64..2.0),
        ) {
            let tree = KdTree::new(&points);
            let found: [_; 5] = tree.k_nearest(&x);
            let mut expected = points;
            expected.sort_by(|a, b| squared_distance(&x, a).total_cmp(&squared_distance(&x, b)));
            for ((squared, slot), point) in found.into_iter().zip(expected) {
                prop_assert_eq!(tree.points()[slot], point);
                prop_assert_eq!(squared, squared_distance(&x, &point));
            }
        }
    }

    #[test]
    fn equal_points_count_each() {
        let tree = KdTree::new(&[[[0.5; 3]; 40], [[0.2; 3]; 40]].concat());
        let mut slots: Vec<_> = (tree.k_nearest::<40>(&[0.1; 3]).iter())
            .map(|&(_, slot)| slot)
            .collect();
        assert!(slots.iter().all(|&slot| tree.points()[slot] == [0.2; 3]));
        slots.sort_unstable();
        slots.dedup();
        assert_eq!(slots.len(), 40);
    }
}

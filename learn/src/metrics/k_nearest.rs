//! The `K` nearest points, found in a k-d tree.

use super::kdtree::{KdTree, squared_distance};

/// `K` points by ascending squared distance (m^2) from a place.
struct Nearest<const K: usize> {
    squared: [f64; K],
    points: [[f64; 3]; K],
}

impl<const K: usize> Nearest<K> {
    /// Takes in a point nearer than the last, which drops out.
    fn insert(&mut self, squared: f64, point: [f64; 3]) {
        let mut place = K - 1;
        while place > 0 && self.squared[place - 1] > squared {
            self.squared[place] = self.squared[place - 1];
            self.points[place] = self.points[place - 1];
            place -= 1;
        }
        self.squared[place] = squared;
        self.points[place] = point;
    }
}

impl KdTree {
    /// The `K` points (m) nearest to `x`, by ascending distance. Of points equally far, any may be taken.
    ///
    /// # Panics
    /// Where the tree holds fewer than `K` points.
    pub(super) fn k_nearest<const K: usize>(&self, x: &[f64; 3]) -> [[f64; 3]; K] {
        assert!(K <= self.len(), "{K} points of {}", self.len());
        let mut nearest = Nearest {
            squared: [f64::INFINITY; K],
            points: [[0.0; 3]; K],
        };
        let mut limit = f64::INFINITY;
        self.descend(
            1,
            &mut limit,
            &|node| self.boxes()[node].squared_distance(x),
            &mut |slots, limit| {
                for point in &self.points()[slots] {
                    let squared = squared_distance(x, point);
                    if squared < *limit {
                        nearest.insert(squared, *point);
                        *limit = nearest.squared[K - 1];
                    }
                }
            },
        );
        nearest.points
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
            let found: [_; 5] = KdTree::new(&points).k_nearest(&x);
            let mut expected = points;
            expected.sort_by(|a, b| squared_distance(&x, a).total_cmp(&squared_distance(&x, b)));
            prop_assert_eq!(&found[..], &expected[..5]);
        }
    }

    #[test]
    fn equal_points_count_each() {
        let points = [[[0.5; 3]; 40], [[0.2; 3]; 40]].concat();
        assert_eq!(KdTree::new(&points).k_nearest(&[0.1; 3]), [[0.2; 3]; 40]);
    }
}

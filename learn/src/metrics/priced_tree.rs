//! A k-d tree whose points carry prices that only rise.

use super::ground_cost::GroundCost;
use super::kdtree::{Aabb, KdTree, squared_distance};

/// Ridge of the slope fit, relative to the spread of the points: flat nodes stay invertible.
const RIDGE: f64 = 1e-3;

/// An affine function that stays below the prices of one node.
///
/// Prices in an assignment follow the transport cost, whose slope is that of the cost itself. A
/// bound by the lowest price alone would miss that slope times the size of the node, and prune
/// almost nothing where clouds lie far apart.
#[derive(Clone, Copy, Debug)]
struct Floor {
    /// Centre of the node's box (m).
    centre: [f64; 3],
    /// Half extents of the node's box (m).
    half: [f64; 3],
    /// Slope (cost per m).
    slope: [f64; 3],
    /// Value at the centre (cost).
    intercept: f64,
}

/// What a least-squares fit of a slope to a node's prices needs of its points: their mean (m) and the
/// inverse of their scatter matrix (1/m^2).
#[derive(Clone, Copy, Debug)]
struct Regressor {
    mean: [f64; 3],
    inverse: [[f64; 3]; 3],
}

/// What a point of the tree costs a customer.
#[derive(Clone, Copy, Debug)]
pub(super) struct Offer {
    pub(super) slot: usize,
    /// Ground cost.
    pub(super) cost: f64,
    /// Ground cost plus price.
    pub(super) value: f64,
}

/// Points with prices: which of them cost a customer at `x` least, `cost(x, y) + price(y)`?
#[derive(Debug)]
pub(super) struct PricedTree {
    tree: KdTree,
    cost: GroundCost,
    prices: Vec<f64>,
    regressors: Vec<Regressor>,
    floors: Vec<Floor>,
    rises_since_fit: usize,
}

impl PricedTree {
    /// Prices are in the order of the tree's slots.
    pub(super) fn new(tree: KdTree, prices: Vec<f64>, cost: GroundCost) -> Self {
        let regressors = tree
            .nodes()
            .map(|node| Regressor::of(&tree.points()[tree.slots(node)]))
            .collect();
        let mut priced = Self {
            tree,
            cost,
            prices,
            regressors,
            floors: Vec::new(),
            rises_since_fit: 0,
        };
        priced.fit();
        priced
    }

    /// Prices in slot order.
    pub(super) fn prices(&self) -> &[f64] {
        &self.prices
    }

    /// Raises the price of `slot` by `rise >= 0`.
    ///
    /// A floor below the old price is below the new one; floors are fitted again once enough prices
    /// have risen to pay for it.
    pub(super) fn raise(&mut self, slot: usize, rise: f64) {
        self.prices[slot] += rise;
        self.rises_since_fit += 1;
        if self.rises_since_fit == self.tree.len() {
            self.fit();
        }
    }

    fn fit(&mut self) {
        self.rises_since_fit = 0;
        let floor = |node: usize| {
            let slots = self.tree.slots(node);
            let points = &self.tree.points()[slots.clone()];
            self.regressors[node].floor(&self.tree.boxes()[node], points, &self.prices[slots])
        };
        self.floors = self.tree.nodes().map(floor).collect();
    }

    /// What `slot` costs a customer at `x`.
    #[inline]
    pub(super) fn offer(&self, x: &[f64; 3], slot: usize) -> Offer {
        let cost = self
            .cost
            .of_squared(squared_distance(x, &self.tree.points()[slot]));
        Offer {
            slot,
            cost,
            value: cost + self.prices[slot],
        }
    }

    /// The least of `ceiling` and of `cost + price` over all points, for a customer at `x`.
    pub(super) fn lowest_value(&self, x: &[f64; 3], ceiling: f64) -> f64 {
        let mut lowest = ceiling;
        let bound = |node: usize| self.floors[node].bound(self.cost, x);
        self.tree
            .descend(1, &mut lowest, &bound, &mut |slots, lowest| {
                for slot in slots {
                    *lowest = lowest.min(self.offer(x, slot).value);
                }
            });
        lowest
    }

    /// The `count` offers of least value to a customer at `x` outside the `excluded` slots, into
    /// `offers` in ascending order; fewer where fewer are left.
    pub(super) fn cheapest(
        &self,
        x: &[f64; 3],
        count: usize,
        excluded: &[bool],
        offers: &mut Vec<Offer>,
    ) {
        offers.clear();
        let bound = |node: usize| self.floors[node].bound(self.cost, x);
        let mut limit = f64::INFINITY;
        self.tree
            .descend(1, &mut limit, &bound, &mut |slots, limit| {
                for slot in slots {
                    let offer = self.offer(x, slot);
                    if offer.value < *limit && !excluded[slot] {
                        if offers.len() == count {
                            offers.pop();
                        }
                        let place = offers.iter().rposition(|other| other.value <= offer.value);
                        offers.insert(place.map_or(0, |place| place + 1), offer);
                        if offers.len() == count {
                            *limit = offers[count - 1].value;
                        }
                    }
                }
            });
    }
}

impl Regressor {
    fn of(points: &[[f64; 3]]) -> Self {
        let mut mean = [0.0; 3];
        for point in points {
            for axis in 0..3 {
                mean[axis] += point[axis] / points.len() as f64;
            }
        }
        let mut scatter = [[0.0; 3]; 3];
        for point in points {
            let d = minus(point, &mean);
            for row in 0..3 {
                for column in 0..3 {
                    scatter[row][column] += d[row] * d[column];
                }
            }
        }
        let ridge = RIDGE * (scatter[0][0] + scatter[1][1] + scatter[2][2]);
        for (axis, row) in scatter.iter_mut().enumerate() {
            row[axis] += ridge;
        }
        Self {
            mean,
            inverse: inverse(&scatter),
        }
    }

    /// The least-squares slope of `prices`, lowered until it is below all of them.
    fn floor(&self, aabb: &Aabb, points: &[[f64; 3]], prices: &[f64]) -> Floor {
        let centre = [0, 1, 2].map(|axis| 0.5 * (aabb.min[axis] + aabb.max[axis]));
        let half = [0, 1, 2].map(|axis| 0.5 * (aabb.max[axis] - aabb.min[axis]));
        let reference = prices[0];
        let mut moment = [0.0; 3];
        for (point, price) in points.iter().zip(prices) {
            let d = minus(point, &self.mean);
            for axis in 0..3 {
                moment[axis] += d[axis] * (price - reference);
            }
        }
        let slope = [0, 1, 2].map(|axis| dot(&self.inverse[axis], &moment));
        let mut intercept = f64::INFINITY;
        for (point, price) in points.iter().zip(prices) {
            intercept = intercept.min(price - dot(&slope, &minus(point, &centre)));
        }
        Floor {
            centre,
            half,
            slope,
            intercept,
        }
    }
}

impl Floor {
    /// Lower bound of `cost(x, y) + price(y)` over the points `y` of the node.
    #[inline]
    fn bound(&self, cost: GroundCost, x: &[f64; 3]) -> f64 {
        let offset = [0, 1, 2].map(|axis| self.centre[axis] - x[axis]);
        match cost {
            GroundCost::Distance => {
                // |y - x| >= e.(y - x) for every unit vector e; towards the centre it is tight.
                let distance = norm(&offset);
                let scale = if distance > 0.0 { 1.0 / distance } else { 0.0 };
                let drop =
                    |axis: usize| (scale * offset[axis] + self.slope[axis]).abs() * self.half[axis];
                distance + self.intercept - drop(0) - drop(1) - drop(2)
            }
            GroundCost::SquaredDistance => {
                // Axis by axis, the least of (offset + y)^2 + slope y over |y| <= half.
                let least = |axis: usize| {
                    let y = (-offset[axis] - 0.5 * self.slope[axis])
                        .max(-self.half[axis])
                        .min(self.half[axis]);
                    (offset[axis] + y).powi(2) + self.slope[axis] * y
                };
                self.intercept + least(0) + least(1) + least(2)
            }
        }
    }
}

fn norm(a: &[f64; 3]) -> f64 {
    (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]).sqrt()
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn minus(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Inverse of a positive definite matrix, by cofactors; zero where the determinant vanishes, which
/// makes the slope of coincident points zero.
fn inverse(m: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let cofactor = |row: usize, column: usize| {
        let (r1, r2, c1, c2) = (
            (row + 1) % 3,
            (row + 2) % 3,
            (column + 1) % 3,
            (column + 2) % 3,
        );
        m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]
    };
    let determinant = dot(&m[0], &[cofactor(0, 0), cofactor(0, 1), cofactor(0, 2)]);
    if determinant > 0.0 {
        [0, 1, 2].map(|row| [0, 1, 2].map(|column| cofactor(column, row) / determinant))
    } else {
        [[0.0; 3]; 3]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Points on a coarse grid, so that they repeat and align, with the prices they start at.
    fn goods() -> impl Strategy<Value = Vec<([f64; 3], f64)>> {
        let coordinate = (-8i32..=8).prop_map(|x| f64::from(x) / 8.0);
        prop::collection::vec((prop::array::uniform3(coordinate), -1.0f64..1.0), 1..150)
    }

    proptest! {
        #[test]
        fn cheapest_offers_are_those_of_a_full_scan_after_any_rises(
            goods in goods(),
            rises in prop::collection::vec((any::<prop::sample::Index>(), 0.0f64..1.0), 0..300),
            x in prop::array::uniform3(-3.0f64..3.0),
            count in 1usize..20,
            distance in prop::bool::ANY,
        ) {
            let cost = if distance { GroundCost::Distance } else { GroundCost::SquaredDistance };
            let (points, prices): (Vec<_>, Vec<_>) = goods.into_iter().unzip();
            let mut priced = PricedTree::new(KdTree::new(&points), prices, cost);
            for (slot, rise) in &rises {
                priced.raise(slot.index(points.len()), *rise);
            }
            let excluded: Vec<bool> = (0..points.len()).map(|slot| slot % 3 == 1).collect();

            let value = |slot| priced.offer(&x, slot).value;
            let mut all: Vec<f64> = (0..points.len()).map(value).collect();
            let mut open: Vec<f64> =
                (0..points.len()).filter(|slot| !excluded[*slot]).map(value).collect();
            all.sort_by(f64::total_cmp);
            open.sort_by(f64::total_cmp);
            open.truncate(count);

            let mut offers = Vec::new();
            priced.cheapest(&x, count, &excluded, &mut offers);
            prop_assert_eq!(offers.len(), open.len());
            for (offer, expected) in offers.iter().zip(&open) {
                prop_assert!(!excluded[offer.slot]);
                prop_assert!((offer.value - expected).abs() < 1e-12);
            }
            prop_assert!((priced.lowest_value(&x, f64::INFINITY) - all[0]).abs() < 1e-12);
            prop_assert_eq!(priced.lowest_value(&x, -10.0), -10.0);
        }
    }
}

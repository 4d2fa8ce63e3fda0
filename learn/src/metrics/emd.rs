//! Exact earth mover's distance between clouds of equal size.

use super::assignment::Assignment;
use super::kdtree::{Aabb, KdTree, squared_distance};
use super::priced_tree::PricedTree;
use super::{MetricError, Side, checked};

/// Points per point of the next coarser level.
const COARSENING: usize = 2;

/// Clouds up to this size are solved without a coarser level.
const COARSEST: usize = 64;

/// What a row may still gain in a solution called optimal, relative to the largest cost: above what
/// rounding leaves, far below what the metric is read to.
const TOLERANCE: f64 = 1e-12;

/// Cost of moving one point to another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GroundCost {
    /// Euclidean distance (m).
    Distance,
    /// Squared Euclidean distance (m^2).
    SquaredDistance,
}

impl GroundCost {
    /// Cost of a move over the squared distance `squared` (m^2).
    #[inline]
    pub(super) fn of_squared(self, squared: f64) -> f64 {
        match self {
            Self::Distance => squared.sqrt(),
            Self::SquaredDistance => squared,
        }
    }
}

/// An optimal matching of two clouds, and the proof that it is optimal.
#[derive(Clone, Debug, PartialEq)]
pub struct Emd {
    /// Mean ground cost of the matching (m, or m^2 for squared distances).
    pub value: f64,
    /// Duality gap, in the unit of `value`: no matching whatever has a mean cost below
    /// `value - gap`. Zero but for rounding. The dual solution behind it was held against all pairs
    /// of points after the matching was found.
    pub gap: f64,
    /// Index in the second cloud of the partner of each point of the first; a permutation.
    pub matching: Vec<usize>,
}

/// Earth mover's distance (m): `EMD = min over bijections pi of 1/n sum_i |p_i - q_pi(i)|`, exactly
/// (Rubner, Tomasi and Guibas, IJCV 2000).
///
/// # Errors
/// An empty cloud, a coordinate that is not finite, or clouds of different sizes.
pub fn emd(p: &[[f32; 3]], q: &[[f32; 3]]) -> Result<Emd, MetricError> {
    emd_with(p, q, GroundCost::Distance)
}

/// Mean squared distance (m^2) of the bijection that makes it least,
/// `min over pi of 1/n sum_i |p_i - q_pi(i)|^2`: the squared 2-Wasserstein distance.
///
/// # Errors
/// As [`emd`].
pub fn emd_squared(p: &[[f32; 3]], q: &[[f32; 3]]) -> Result<Emd, MetricError> {
    emd_with(p, q, GroundCost::SquaredDistance)
}

/// The bijection of least mean ground cost between `p` and `q`, positions (m).
///
/// Solved from coarse to fine: the dual solution of the centroids of groups of neighbours starts
/// that of the points. Memory grows with the number of points, not of pairs.
///
/// # Errors
/// As [`emd`].
pub fn emd_with(p: &[[f32; 3]], q: &[[f32; 3]], cost: GroundCost) -> Result<Emd, MetricError> {
    let (first, second) = (checked(p, Side::First)?, checked(q, Side::Second)?);
    if first.len() != second.len() {
        return Err(MetricError::UnequalSizes {
            first: first.len(),
            second: second.len(),
        });
    }
    let n = first.len();
    let (first, second) = match cost {
        GroundCost::Distance => (first, second),
        // Moving a cloud as a whole adds the same to the cost of every bijection.
        GroundCost::SquaredDistance => (centred(first), centred(second)),
    };
    let bounds = Aabb::of(first.iter().chain(&second));
    let largest_cost = cost.of_squared(squared_distance(&bounds.min, &bounds.max));
    let (first, second) = (KdTree::new(&first), KdTree::new(&second));
    let order = second.order().to_vec();

    let prices = coarse_prices(&first, &second, cost);
    let mut assignment = Assignment::new(first.points(), second, prices, cost);
    assignment.solve();
    let gap = assignment.settle(TOLERANCE * largest_cost) / n as f64;

    let mut value = 0.0;
    let mut matching = vec![0; n];
    for (slot, &row) in first.order().iter().enumerate() {
        matching[row] = order[assignment.column_of(slot)];
        value += cost.of_squared(squared_distance(
            &p[row].map(f64::from),
            &q[matching[row]].map(f64::from),
        )) / n as f64;
    }
    Ok(Emd {
        value,
        gap,
        matching,
    })
}

/// The cloud, moved so that its mean lies in the origin.
fn centred(mut cloud: Vec<[f64; 3]>) -> Vec<[f64; 3]> {
    let mean = mean(&cloud);
    for point in &mut cloud {
        for axis in 0..3 {
            point[axis] -= mean[axis];
        }
    }
    cloud
}

/// Prices of the points of `q`, nearly optimal, from the assignment between centroids.
///
/// The rows' potentials `u` of the coarse solution extend to any point `y` by their c-transform,
/// `v(y) = min_a (c(x_a, y) - u_a)`, and `p = -v`.
fn coarse_prices(p: &KdTree, q: &KdTree, cost: GroundCost) -> Vec<f64> {
    if p.len() <= COARSEST {
        return vec![0.0; q.len()];
    }
    let groups = p.len().div_ceil(COARSENING);
    let (coarse_p, coarse_q) = (
        KdTree::new(&centroids(p, groups)),
        KdTree::new(&centroids(q, groups)),
    );
    let prices = coarse_prices(&coarse_p, &coarse_q, cost);
    let mut assignment = Assignment::new(coarse_p.points(), coarse_q, prices, cost);
    assignment.solve();
    let potentials = (0..groups)
        .map(|row| -assignment.row_potential(row))
        .collect();
    let transform = PricedTree::new(coarse_p, potentials, cost);
    q.points()
        .iter()
        .map(|y| -transform.lowest_value(y, f64::INFINITY))
        .collect()
}

/// Centroids of `groups` runs of neighbours of nearly equal size.
fn centroids(tree: &KdTree, groups: usize) -> Vec<[f64; 3]> {
    let n = tree.len();
    (0..groups)
        .map(|group| mean(&tree.points()[n * group / groups..n * (group + 1) / groups]))
        .collect()
}

fn mean(points: &[[f64; 3]]) -> [f64; 3] {
    [0, 1, 2].map(|axis| points.iter().map(|x| x[axis]).sum::<f64>() / points.len() as f64)
}

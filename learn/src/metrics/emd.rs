//! Exact earth mover's distance between clouds of equal size.
//!
//! A sparse assignment (`assignment`) by augmenting paths on arcs that a k-d tree gives as needed, started from the
//! dual solution of coarser clouds, and certified by its own against all pairs. An auction that ends at a tolerance was built
//! too, and was no faster than the exact solution for clouds that nearly agree.

use std::ops::Range;

use super::assignment::Assignment;
use super::ground_cost::GroundCost;
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

/// A matching of two clouds, and the proof of how near to optimal it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Emd {
    /// Mean ground cost of the matching (m, or m^2 for squared distances).
    pub value: f64,
    /// Duality gap, in the unit of `value`: no matching whatever has a mean cost below
    /// `value - gap`. Of an exact solution it is zero but for rounding. The dual solution behind it
    /// was held against all pairs of points.
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
    let [first, second] = trees(p, q, cost)?;
    let order = second.order().to_vec();
    let bounds = Aabb::of(first.points().iter().chain(second.points()));
    let largest_cost = cost.of_squared(squared_distance(&bounds.min, &bounds.max));

    let prices = start_prices(&first, &second, cost);
    let mut assignment = Assignment::new(first.points(), second, prices, cost);
    assignment.solve();
    let gap = assignment.settle(TOLERANCE * largest_cost) / p.len() as f64;

    let mut matching = vec![0; p.len()];
    for (slot, &row) in first.order().iter().enumerate() {
        matching[row] = order[assignment.column_of(slot)];
    }
    Ok(Emd {
        value: mean_cost(p, q, &matching, cost),
        gap,
        matching,
    })
}

/// The two clouds as trees, once they are known to be clouds of one size.
pub(super) fn trees(
    p: &[[f32; 3]],
    q: &[[f32; 3]],
    cost: GroundCost,
) -> Result<[KdTree; 2], MetricError> {
    let clouds = [checked(p, Side::First)?, checked(q, Side::Second)?];
    if p.len() != q.len() {
        return Err(MetricError::UnequalSizes {
            first: p.len(),
            second: q.len(),
        });
    }
    Ok(clouds.map(|cloud| match cost {
        GroundCost::Distance => KdTree::new(&cloud),
        // Moving a cloud as a whole adds the same to the cost of every bijection.
        GroundCost::SquaredDistance => KdTree::new(&centred(cloud)),
    }))
}

/// Mean cost (m, or m^2) of a matching.
pub(super) fn mean_cost(
    p: &[[f32; 3]],
    q: &[[f32; 3]],
    matching: &[usize],
    cost: GroundCost,
) -> f64 {
    let costs = p.iter().zip(matching).map(|(p, &partner)| {
        let squared = squared_distance(&p.map(f64::from), &q[partner].map(f64::from));
        cost.of_squared(squared) / matching.len() as f64
    });
    costs.sum()
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

/// Prices of the points of `q` that an assignment starts from, the nearer to optimal the less is left to do.
fn start_prices(p: &KdTree, q: &KdTree, cost: GroundCost) -> Vec<f64> {
    match p.len() {
        0..=COARSEST => vec![0.0; q.len()],
        n => Coarse::new(p, q, n.div_ceil(COARSENING), cost).prices,
    }
}

/// The assignment between the centroids of groups of neighbours, and what it tells of the points.
pub(super) struct Coarse {
    /// For each group of `p`, its partner among those of `q`.
    pub matching: Vec<usize>,
    /// Prices of the points of `q`, nearly optimal, in slot order.
    ///
    /// The rows' potentials `u` of the coarse solution extend to any point `y` by their c-transform,
    /// `v(y) = min_a (c(x_a, y) - u_a)`, and the prices are `-v`.
    pub prices: Vec<f64>,
}

impl Coarse {
    pub fn new(p: &KdTree, q: &KdTree, groups: usize, cost: GroundCost) -> Self {
        let [coarse_p, coarse_q] = [p, q].map(|tree| KdTree::new(&centroids(tree, groups)));
        let order = coarse_q.order().to_vec();
        let prices = start_prices(&coarse_p, &coarse_q, cost);
        let mut assignment = Assignment::new(coarse_p.points(), coarse_q, prices, cost);
        assignment.solve();
        let mut matching = vec![0; groups];
        for (slot, &group) in coarse_p.order().iter().enumerate() {
            matching[group] = order[assignment.column_of(slot)];
        }
        let potentials = (0..groups)
            .map(|row| -assignment.row_potential(row))
            .collect();
        let transform = PricedTree::new(coarse_p, potentials, cost);
        let prices = (q.points().iter())
            .map(|y| -transform.lowest_value(y, f64::INFINITY))
            .collect();
        Self { matching, prices }
    }
}

/// Slots of group `group` of `groups` nearly equal ones of `n` points, neighbours in tree order.
pub(super) fn group_slots(n: usize, groups: usize, group: usize) -> Range<usize> {
    n * group / groups..n * (group + 1) / groups
}

/// Centroids of `groups` groups of neighbours.
fn centroids(tree: &KdTree, groups: usize) -> Vec<[f64; 3]> {
    (0..groups)
        .map(|group| mean(&tree.points()[group_slots(tree.len(), groups, group)]))
        .collect()
}

fn mean(points: &[[f64; 3]]) -> [f64; 3] {
    [0, 1, 2].map(|axis| points.iter().map(|x| x[axis]).sum::<f64>() / points.len() as f64)
}

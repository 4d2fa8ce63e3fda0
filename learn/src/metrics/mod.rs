//! Distances between point clouds: Chamfer and exact earth mover's. What is uncertain about a cloud, and how well that
//! tells its errors: the spread about its surface, and rank correlation. Which of its points are evenly spread.
//!
//! A cloud is a slice of positions `[x, y, z]` (m) in any frame that both clouds share. Sums run in
//! `f64`. Results do not depend on threads: every distance is found sequentially, and many calls may run at once.

mod approximate;
mod assignment;
mod chain;
mod chamfer;
mod color;
mod emd;
mod ground_cost;
mod k_nearest;
mod kdtree;
mod matcher;
mod nearest;
mod priced_tree;
mod rank;
mod register;
mod relaxation;
mod spread;
mod thinning;

pub use approximate::emd_approximate;
pub use chain::{Link, lay_chain_onto};
pub use chamfer::chamfer;
pub use color::{Colored, color_error};
pub use emd::{Emd, emd, emd_squared, emd_with};
pub use ground_cost::GroundCost;
pub(crate) use matcher::Matcher;
pub(crate) use nearest::nearest_points;
pub use nearest::{nearest_distances, nearest_indices};
pub use rank::rank_correlation;
pub use register::{lay_onto, rigid_motion};
pub use relaxation::relaxed;
pub use spread::{isolation, surface_spread};
pub use thinning::evenly_spread;

use std::fmt;

use rayon::prelude::*;

use kdtree::KdTree;

/// Which argument of a metric an error is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The first cloud, `p`.
    First,
    /// The second cloud, `q`.
    Second,
}

impl fmt::Display for Side {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::First => "first cloud",
            Self::Second => "second cloud",
        })
    }
}

/// Why clouds have no distance, or no spread.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MetricError {
    /// A cloud holds no point.
    #[error("the {side} is empty; a distance needs at least one point in each cloud")]
    EmptyCloud {
        /// The empty cloud.
        side: Side,
    },
    /// A cloud has too few points to lay planes through.
    #[error("the {side} holds {found} points, expected at least {expected}")]
    TooFew {
        /// The cloud.
        side: Side,
        /// Its points.
        found: usize,
        /// Fewest points that do.
        expected: usize,
    },
    /// No bijection exists between clouds of different sizes.
    #[error(
        "the clouds hold {first} and {second} points; the earth mover's distance needs equal sizes"
    )]
    UnequalSizes {
        /// Points of the first cloud.
        first: usize,
        /// Points of the second cloud.
        second: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("point {index} of the {side} is {point:?} m; coordinates must be finite")]
    NonFinite {
        /// The cloud that holds the point.
        side: Side,
        /// The first such point.
        index: usize,
        /// Its coordinates (m).
        point: [f32; 3],
    },
}

/// Points that a place is looked at by, the place's own among them. Of 10,000 on a robot 40 mm thick and 350 mm long, they lie
/// within 4 mm.
const NEIGHBOURS: usize = 16;

/// What [`KdTree::k_nearest`] finds in `tree`, that of the cloud `side`, about each of `places` (m), in their order.
fn neighbourhoods<'a>(
    tree: &'a KdTree,
    places: &'a [[f64; 3]],
    side: Side,
) -> Result<impl IndexedParallelIterator<Item = [(f64, usize); NEIGHBOURS]> + 'a, MetricError> {
    if tree.len() < NEIGHBOURS {
        return Err(MetricError::TooFew {
            side,
            found: tree.len(),
            expected: NEIGHBOURS,
        });
    }
    Ok(places.par_iter().map(|x| tree.k_nearest(x)))
}

/// The points of `cloud` in double precision (m), once it is known to be a cloud.
fn checked(cloud: &[[f32; 3]], side: Side) -> Result<Vec<[f64; 3]>, MetricError> {
    if cloud.is_empty() {
        return Err(MetricError::EmptyCloud { side });
    }
    if let Some(index) = cloud
        .iter()
        .position(|point| point.iter().any(|x| !x.is_finite()))
    {
        return Err(MetricError::NonFinite {
            side,
            index,
            point: cloud[index],
        });
    }
    Ok(cloud.iter().map(|point| point.map(f64::from)).collect())
}

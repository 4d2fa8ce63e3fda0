//! Whether a symmetry of the robot is one of its base as well, as cameras see it.

use nalgebra::Point3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{Symmetries, Symmetry};
use crate::geometry::{Solid, base_solids};
use crate::robot::Robot;

/// How much the distances from the base of a point and its image may differ (m).
const TOLERANCE: f64 = 1e-6;

/// Points about each solid of the base at which distances are compared, and how far from its middle (m).
const POINTS: usize = 200;
const REACH: f64 = 0.05;

impl Symmetries {
    /// The largest group of those that map the base that [`Visuals::of_robot`](crate::render::Visuals::of_robot) shows to itself:
    /// random points near it are as far from it as their images are.
    #[must_use]
    pub fn of_base(&self, robot: &Robot) -> Self {
        let solids = base_solids(robot);
        self.subgroup(|symmetry| keeps(symmetry, &solids))
    }
}

fn keeps(symmetry: &Symmetry, solids: &[Solid]) -> bool {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    solids.iter().all(|solid| {
        (0..POINTS).all(|_| {
            let shift = [0; 3].map(|_| rng.random_range(-REACH..REACH));
            let point = solid.pose.translation.vector + nalgebra::Vector3::from(shift);
            let [here, there] =
                [point.into(), symmetry.point(point.into())].map(|point| distance(solids, point));
            (here - there).abs() <= TOLERANCE
        })
    })
}

/// Signed distance (m) of a point of the world from the union of solids, outside of it; inside, a bound that has the same
/// symmetries.
fn distance(solids: &[Solid], point: [f64; 3]) -> f64 {
    let of_solid = |solid: &Solid| {
        let local = solid.pose.inverse_transform_point(&Point3::from(point));
        solid.shape.nearest(&local.coords).distance
    };
    solids.iter().map(of_solid).fold(f64::INFINITY, f64::min)
}

//! How large points must be drawn to close the surface that they sample.

use tdcr_base::stats::{quantile, sorted};
use tdcr_sim::cloud::PointCloud;

/// Neighbours that tell the density about a point: their distance `d` says that `NEIGHBOURS` points lie on `pi d^2`.
const NEIGHBOURS: usize = 8;
/// Points of a cloud at which the density is asked for.
const PROBES: usize = 200;
/// Share of the probes whose surroundings are closed.
const CLOSED: f64 = 0.95;
/// Radius by the neighbours' distance. Of points that are drawn at random, a disc of this radius then holds 17 on
/// average, and less than three at one place in 100,000.
const FACTOR: f64 = 1.45;

/// Radius (m) with which the balls of nearly all points of a cloud close its surface; 0 for a cloud of a few points.
pub(crate) fn closing_radius(cloud: &PointCloud) -> f64 {
    let mut points = cloud.points.clone();
    points.retain(|p| p.iter().all(|x| x.is_finite()));
    // Clouds of few points are padded with copies, which would pass for neighbours.
    points.sort_by(|a, b| a.partial_cmp(b).expect("finite"));
    points.dedup();
    if points.len() <= NEIGHBOURS {
        return 0.0;
    }
    let count = points.len().min(PROBES);
    let mut squares = vec![0.0; points.len()];
    let distances = sorted((0..count).map(|k| {
        let probe = points[k * points.len() / count];
        for (square, point) in squares.iter_mut().zip(&points) {
            let [x, y, z]: [f32; 3] = std::array::from_fn(|axis| point[axis] - probe[axis]);
            *square = x * x + y * y + z * z;
        }
        // The nearest is the probe itself.
        let (_, square, _) = squares.select_nth_unstable_by(NEIGHBOURS, f32::total_cmp);
        f64::from(square.sqrt())
    }));
    FACTOR * quantile(&distances, CLOSED)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `side` squared points, 1 m apart in a square grid, each `copies` times.
    fn grid(side: usize, copies: usize) -> PointCloud {
        let place = |k: usize| [(k % side) as f32, (k / side) as f32, 0.5];
        let points: Vec<_> = (0..side * side)
            .flat_map(|k| vec![place(k); copies])
            .collect();
        let colors = vec![[0; 3]; points.len()];
        PointCloud { points, colors }
    }

    #[test]
    fn the_radius_follows_the_density_and_not_the_copies() {
        let radius = closing_radius(&grid(40, 1));
        // The eighth neighbour is across a cell; at the edge of the square, two cells away.
        assert!(
            (FACTOR * 2f64.sqrt()..=FACTOR * 2.3).contains(&radius),
            "{radius}"
        );
        assert_eq!(closing_radius(&grid(40, 3)), radius);
        assert_eq!(closing_radius(&grid(2, 5)), 0.0);
        assert_eq!(closing_radius(&PointCloud::default()), 0.0);
    }
}

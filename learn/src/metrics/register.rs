//! Where a part of one cloud lies in another.

use super::kdtree::KdTree;
use super::{MetricError, Side, checked};

/// A step (m) below which the shift has been found.
const STILL: f64 = 1e-7;
/// Steps at the most. Each takes off the same share of the distance, a third or more on surfaces that face all ways.
const STEPS: usize = 200;

/// The shift (m) that brings the points of `p` (m) onto the cloud `q` (m), sought from the shift `start`: iterated closest
/// points without rotation (Besl and McKay, IEEE PAMI 14, 1992). Each step moves `p` by the mean of the vectors from its
/// points to the nearest points of `q`, which never increases the sum of their squares.
///
/// A local minimum is found, near `start`. Along directions in which `p` can slide in the surface of `q`, as the wall of a
/// tube without its end can, the shift stays about where it starts.
///
/// # Errors
/// An empty cloud, or a coordinate that is not finite.
pub fn shift_onto(
    p: &[[f32; 3]],
    q: &[[f32; 3]],
    start: [f64; 3],
) -> Result<[f64; 3], MetricError> {
    let p = checked(p, Side::First)?;
    let q = KdTree::new(&checked(q, Side::Second)?);
    let mut shift = start;
    for _ in 0..STEPS {
        let (mut sum, mut guess) = ([0.0; 3], 0);
        for point in &p {
            let moved: [f64; 3] = std::array::from_fn(|k| point[k] + shift[k]);
            guess = q.nearest(&moved, guess).0;
            let nearest = q.points()[guess];
            (0..3).for_each(|k| sum[k] += nearest[k] - moved[k]);
        }
        let step = sum.map(|x| x / p.len() as f64);
        (0..3).for_each(|k| shift[k] += step[k]);
        if step.iter().map(|x| x * x).sum::<f64>() < STILL * STILL {
            break;
        }
    }
    Ok(shift)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    /// Points on the wall and the upper end of a tube along z: radius 20 mm, up to the height 0.
    fn tube(phase: f64) -> Vec<[f32; 3]> {
        let mut points = Vec::new();
        for ring in 0..60 {
            let z = -0.002 * (f64::from(ring) + phase);
            for k in 0..60 {
                let (sin, cos) = (0.1047 * (f64::from(k) + phase)).sin_cos();
                points.push([0.02 * cos, 0.02 * sin, z].map(|x| x as f32));
            }
        }
        for k in 0..300 {
            // Sunflower points (Vogel, 1979).
            let (radius, angle) = (
                0.02 * (f64::from(k) / 300.0).sqrt(),
                2.4 * f64::from(k) + phase,
            );
            points.push([radius * angle.cos(), radius * angle.sin(), 0.0].map(|x| x as f32));
        }
        points
    }

    #[test]
    fn the_end_of_a_tube_is_found_where_it_went() {
        let end: Vec<_> = tube(0.5).into_iter().filter(|p| p[2] > -0.017).collect();
        for moved in [
            [0.0, 0.0, 0.004],
            [0.003, -0.002, -0.003],
            [0.006, 0.0, 0.0],
        ] {
            let there: Vec<[f32; 3]> = tube(0.0)
                .iter()
                .map(|p| std::array::from_fn(|k| p[k] + moved[k] as f32))
                .collect();
            let found = shift_onto(&end, &there, [0.0; 3]).unwrap();
            for k in 0..3 {
                // A fifth of the points' distance.
                assert!((found[k] - moved[k]).abs() < 4e-4, "{moved:?}: {found:?}");
            }
        }
    }
}

//! Which points of those that were drawn make the cloud, and where.

use crate::metrics::{evenly_spread, isolation, relaxed};

/// Share of the ends of a flow that may be left out for being alone. More than that costs edges of the robot.
pub const ISOLATED: f64 = 0.01;

/// The same of points that were corrected ([`Model::predict`](crate::train::Model::predict)): hardly any of them is off the
/// surface.
pub const ISOLATED_CORRECTED: f64 = 0.001;

/// Indices, in order, of the `count` of `points` (m) that make the cloud that they were drawn for; of all where there are no more,
/// of the first where there are too few to tell.
///
/// The share `isolated` of them, 0 to 1, that is the most alone ([`isolation`]) is left out first, as far as there are points to
/// spare: points that a network brought to no surface have few others about them. Of the others those are kept that are
/// [`evenly_spread`], as a voxel grid spreads the points of a camera: chance has independent points crowd here and miss the
/// surface there. What that leaves uneven these even out among themselves: they are [`relaxed`], in place.
pub fn select(points: &mut [[f32; 3]], count: usize, isolated: f64) -> Vec<usize> {
    let kept = choose(points, count, isolated);
    let cloud: Vec<_> = kept.iter().map(|&k| points[k]).collect();
    if kept.len() < points.len()
        && let Ok(relaxed) = relaxed(&cloud)
    {
        kept.iter()
            .zip(relaxed)
            .for_each(|(&k, place)| points[k] = place);
    }
    kept
}

/// Indices, in order, of the points that [`select`] keeps.
fn choose(points: &[[f32; 3]], count: usize, isolated: f64) -> Vec<usize> {
    let spare = points.len().saturating_sub(count);
    let alone = ((isolated * points.len() as f64).ceil() as usize).min(spare);
    let company = least_isolated(points, points.len() - alone);
    if company.len() <= count {
        return company;
    }
    let near: Vec<_> = company.iter().map(|&k| points[k]).collect();
    match evenly_spread(&near, count) {
        Ok(even) => even.into_iter().map(|k| company[k]).collect(),
        Err(_) => company.into_iter().take(count).collect(),
    }
}

/// Indices, in order, of the `count` points that are the least alone; of the first where there are too few to tell.
fn least_isolated(points: &[[f32; 3]], count: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    if points.len() > count
        && let Ok(isolation) = isolation(points)
    {
        order.sort_by(|&a, &b| isolation[a].total_cmp(&isolation[b]));
    }
    order.truncate(count);
    order.sort_unstable();
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plane of 20 x 20 points, 1 mm apart, and five points 6 mm above it, one after each 80; which these are.
    fn plane_and_outliers() -> (Vec<[f32; 3]>, Vec<usize>) {
        let plane = (0..400).map(|k| [(k % 20) as f32 * 0.001, (k / 20) as f32 * 0.001, 0.0]);
        let mut points: Vec<[f32; 3]> = plane.collect();
        let places: Vec<_> = (0..5).map(|k| 81 * k + 40).collect();
        for (k, &place) in places.iter().enumerate() {
            points.insert(place, [0.01, 0.002 + 0.003 * k as f32, 0.006]);
        }
        (points, places)
    }

    #[test]
    fn points_off_the_surface_are_left_out_first() {
        let (points, outliers) = plane_and_outliers();
        let select =
            |points: &[[f32; 3]], count, isolated| select(&mut points.to_vec(), count, isolated);
        // Of 405 points as many as five may be left out for being alone.
        let all_but = |out: &[usize]| (0..405).filter(|k| !out.contains(k)).collect::<Vec<_>>();
        assert_eq!(select(&points, 400, ISOLATED), all_but(&outliers));
        assert_eq!(select(&points, 405, ISOLATED), all_but(&[]));
        let fewer = select(&points, 200, ISOLATED);
        assert_eq!(fewer.len(), 200);
        assert!(fewer.is_sorted());
        assert!(outliers.iter().all(|k| !fewer.contains(k)));
    }

    #[test]
    fn of_too_few_points_to_tell_the_first_are_taken() {
        let points: Vec<_> = (0..10).map(|k| [k as f32, 0.0, 0.0]).collect();
        let mut rows = points.clone();
        assert_eq!(select(&mut rows, 4, ISOLATED), [0, 1, 2, 3]);
        assert_eq!(select(&mut rows[..3], 4, ISOLATED), [0, 1, 2]);
        assert!(select(&mut [], 4, ISOLATED).is_empty());
        assert_eq!(rows, points);
    }

    #[test]
    fn where_none_is_left_out_all_stay_where_they_are() {
        let (points, _) = plane_and_outliers();
        let mut rows = points.clone();
        assert_eq!(
            select(&mut rows, points.len(), ISOLATED).len(),
            points.len()
        );
        assert_eq!(rows, points);
        let kept = select(&mut rows, 300, ISOLATED);
        assert!(kept.iter().any(|&k| rows[k] != points[k]));
        let others = (0..points.len()).filter(|k| !kept.contains(k));
        assert!(others.into_iter().all(|k| rows[k] == points[k]));
    }
}

//! How far a predicted tip is from the true one.

use nalgebra::Point3;
use tdcr_learn::metrics::{MetricError, emd_squared, lay_onto, rigid_motion};
use tdcr_sim::robot::Robot;
use tdcr_sim::statics::Equilibrium;

/// Points of both clouds that are matched for a first guess.
const MATCHED: usize = 500;
/// Matched points on the last disc, at the least.
const FEWEST: usize = 4;
/// Points of the last disc that are laid onto the predicted cloud, at the most.
const LAID: usize = 400;

/// Distance (m) of the predicted tip from the true one: how far the origin of the last disc moves with the rigid motion that
/// lays the points of the true cloud on that disc onto the predicted cloud ([`lay_onto`]). The motion starts where an
/// optimal matching of both clouds puts these points.
///
/// An error above the disc's radius is underestimated, by a third in the worst case of the test: where the disc has turned
/// far, its points settle on the walls of the discs below.
///
/// A point is on the disc whose solid it is nearest to. Both clouds have their points in random order. `None` where the
/// true cloud shows too little of the last disc.
///
/// # Errors
/// [`MetricError`] for clouds without points, or points that are not finite.
pub(super) fn tip_error(
    robot: &Robot,
    settled: &Equilibrium,
    truth: &[[f32; 3]],
    predicted: &[[f32; 3]],
) -> Result<Option<f64>, MetricError> {
    let mut on_tip = truth.to_vec();
    on_tip.retain(|&point| is_on_tip(robot, settled, point));
    on_tip.truncate(LAID);
    let count = MATCHED.min(truth.len()).min(predicted.len());
    let matching = emd_squared(&truth[..count], &predicted[..count])?.matching;
    let place = |point: [f32; 3]| Point3::from(point.map(f64::from));
    let (from, to): (Vec<_>, Vec<_>) = (truth[..count].iter().zip(matching))
        .filter(|(point, _)| is_on_tip(robot, settled, **point))
        .map(|(&point, partner)| (place(point), place(predicted[partner])))
        .unzip();
    if from.len() < FEWEST {
        return Ok(None);
    }
    let motion = lay_onto(&on_tip, predicted, rigid_motion(&from, &to))?;
    let tip = Point3::from(settled.positions[robot.discs().len() - 1]);
    Ok(Some((motion * tip - tip).norm()))
}

/// Whether a point (m) is nearer to the last disc than to all others.
fn is_on_tip(robot: &Robot, settled: &Equilibrium, point: [f32; 3]) -> bool {
    let distance = |disc: usize| {
        let offset = nalgebra::Vector3::from(point.map(f64::from)) - settled.positions[disc];
        let local = settled.orientations[disc].inverse_transform_vector(&offset);
        let disc = &robot.discs()[disc];
        // Signed distance from a solid cylinder, negative inside.
        let out = local.xy().norm() - disc.radius;
        let beyond = local.z.abs() - disc.half_height;
        out.max(0.0).hypot(beyond.max(0.0)) + out.max(beyond).min(0.0)
    };
    let last = robot.discs().len() - 1;
    let tip = distance(last);
    (0..last).all(|disc| distance(disc) > tip)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use tdcr_sim::cloud::{Observer, VoxelGrid};
    use tdcr_sim::render::BaseVisibility;
    use tdcr_sim::robot::Loads;

    use super::*;

    /// A cloud of 2m under a command, and where its discs are.
    fn seen(robot: &Robot, command: &[f64; 6], seed: u64) -> (Equilibrium, Vec<[f32; 3]>) {
        let command = robot.command(command).unwrap();
        let settled = robot.settle(&command, &Loads::default());
        let mut observer = Observer::new(robot, BaseVisibility::Hidden, VoxelGrid::new(0.002));
        let cloud = observer.observe(&settled);
        let cloud = cloud.sample_or_pad(4000, &mut ChaCha8Rng::seed_from_u64(seed));
        (settled, cloud.points)
    }

    #[test]
    fn the_error_of_a_tip_is_how_far_the_tip_moved() {
        let robot = Robot::load("2m").unwrap();
        let base = [0.034, 0.007, 0.001, 0.026, 0.015, 0.019];
        let (settled, truth) = seen(&robot, &base, 1);
        let tip = *settled.positions.last().unwrap();
        // Other points of the same shape.
        let (_, again) = seen(&robot, &base, 2);
        let error = tip_error(&robot, &settled, &truth, &again)
            .unwrap()
            .unwrap();
        assert!(error < 5e-4, "{error} m");
        // Other shapes, the last with tips off by two disc radii.
        for (other, share) in [
            ([0.034, 0.007, 0.001, 0.024, 0.015, 0.019], 0.1),
            ([0.034, 0.007, 0.001, 0.022, 0.017, 0.019], 0.1),
            ([0.033, 0.008, 0.001, 0.026, 0.015, 0.019], 0.1),
            ([0.034, 0.007, 0.001, 0.010, 0.025, 0.019], 0.35),
        ] {
            let (moved, predicted) = seen(&robot, &other, 3);
            let expected = (moved.positions.last().unwrap() - tip).norm();
            let error = tip_error(&robot, &settled, &truth, &predicted)
                .unwrap()
                .unwrap();
            assert!(
                (error - expected).abs() < 3e-4 + share * expected,
                "{error} m, expected {expected} m"
            );
        }
    }
}

//! Where cameras see points of placed boards, and how that changes as they move.
//!
//! A pose (R, p) moves by (δ, ω) to (exp(ω) R, p + δ), all in the frame that poses are in, so covariances are of positions and
//! rotations in that frame.

use nalgebra::{
    Isometry3, Matrix2, Matrix2x3, Point3, SMatrix, Translation3, UnitQuaternion, Vector2, Vector3,
    Vector6,
};
use tdcr_sim::camera::Intrinsics;

/// A pose after a motion (δ, ω).
pub(super) fn moved(pose: &Isometry3<f64>, step: &Vector6<f64>) -> Isometry3<f64> {
    let [shift, turn] = [0, 3].map(|first| step.fixed_rows::<3>(first).into_owned());
    let mut rotation = UnitQuaternion::new(turn) * pose.rotation;
    rotation.renormalize();
    Isometry3::from_parts(
        Translation3::from(pose.translation.vector + shift),
        rotation,
    )
}

/// A pixel and its derivatives by the motions of both poses.
pub(super) struct Projection {
    pub pixel: Vector2<f64>,
    pub by_camera: SMatrix<f64, 2, 6>,
    pub by_placement: SMatrix<f64, 2, 6>,
}

/// Where a camera sees a point of a placed board, with its derivatives by both poses; `None` behind the camera.
pub(super) fn project(
    intrinsics: &Intrinsics,
    camera: &Isometry3<f64>,
    placement: &Isometry3<f64>,
    point: &Point3<f64>,
) -> Option<Projection> {
    let arm = placement.rotation * point.coords;
    let sight = placement.translation.vector + arm - camera.translation.vector;
    let inverse = camera.rotation.inverse();
    let p = inverse * sight;
    let in_front = p.z > 1e-6;
    if !in_front {
        return None;
    }
    let normalised = Vector2::new(p.x / p.z, p.y / p.z);
    let (u, v) = intrinsics.pixel(normalised);
    let lens = match &intrinsics.distortion {
        None => Matrix2::identity(),
        Some(distortion) => distortion.jacobian(normalised),
    };
    let focal = Matrix2::from_diagonal(&Vector2::new(intrinsics.fx, intrinsics.fy));
    let perspective = Matrix2x3::new(1.0, 0.0, -normalised.x, 0.0, 1.0, -normalised.y) / p.z;
    let by_sight = focal * lens * perspective * inverse.to_rotation_matrix().matrix();
    // A turn of the camera by ω changes the sight, as it sees it, by -ω × sight; one of the board by ω × arm.
    let joined = |by_shift: Matrix2x3<f64>, by_turn: Matrix2x3<f64>| {
        let mut joined = SMatrix::<f64, 2, 6>::zeros();
        joined.fixed_columns_mut::<3>(0).copy_from(&by_shift);
        joined.fixed_columns_mut::<3>(3).copy_from(&by_turn);
        joined
    };
    let cross = |v: &Vector3<f64>| v.cross_matrix();
    Some(Projection {
        pixel: Vector2::new(u, v),
        by_camera: joined(-by_sight, by_sight * cross(&sight)),
        by_placement: joined(by_sight, -by_sight * cross(&arm)),
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;
    use tdcr_sim::camera::Distortion;

    #[test]
    fn derivatives_of_projections_are_those_of_differences() {
        let mut intrinsics = Intrinsics::from_fovy(640, 480, 0.8);
        intrinsics.distortion = Some(Distortion {
            k1: -0.1,
            k2: 0.03,
            p1: 0.002,
            p2: -0.001,
            k3: 0.01,
        });
        let camera = Isometry3::new(Vector3::new(0.1, -0.2, 0.05), Vector3::new(0.1, 0.3, -0.2));
        let placement = Isometry3::new(Vector3::new(0.2, -0.1, 0.7), Vector3::new(0.4, -0.3, 0.8));
        let point = Point3::new(0.08, 0.05, 0.0);
        let at = project(&intrinsics, &camera, &placement, &point).unwrap();
        for k in 0..6 {
            let step = |size: f64| {
                let mut step = Vector6::zeros();
                step[k] = size;
                step
            };
            let difference =
                |pixel: &dyn Fn(f64) -> Vector2<f64>| (pixel(1e-6) - pixel(-1e-6)) / 2e-6;
            let by_camera = difference(&|size| {
                let camera = moved(&camera, &step(size));
                project(&intrinsics, &camera, &placement, &point)
                    .unwrap()
                    .pixel
            });
            let by_placement = difference(&|size| {
                let placement = moved(&placement, &step(size));
                project(&intrinsics, &camera, &placement, &point)
                    .unwrap()
                    .pixel
            });
            assert!(
                (by_camera - at.by_camera.column(k)).norm() < 1e-4,
                "camera {k}"
            );
            assert!(
                (by_placement - at.by_placement.column(k)).norm() < 1e-4,
                "placement {k}"
            );
        }
    }
}

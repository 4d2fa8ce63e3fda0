//! Where the frame of a recording is, told from where the robot's markers should be.

use nalgebra::{Isometry3, Matrix3, Matrix4, Quaternion, Translation3, UnitQuaternion, Vector3};

use super::{Recording, Replay};

/// How a recording has to be moved onto a robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FoundFrame {
    /// What takes measured points to where the robot says they are, in the least squares.
    pub pose: Isometry3<f64>,
    /// Root mean square of the residuals as recorded, each marker's mean taken off (m).
    pub rmse_before: f64,
    /// The same of the moved recording, nothing taken off (m).
    pub rmse_after: f64,
}

/// The motion of a recording that brings its markers nearest to where `replay` says they are; none where fewer than three of them
/// were seen, or the robot does not settle.
///
/// The rotation is the eigenvector of the largest eigenvalue of Horn's matrix (Closed-form solution of absolute orientation using
/// unit quaternions, J. Opt. Soc. Am. A 4, 1987).
pub fn find_frame(replay: &Replay, recording: &Recording) -> Option<FoundFrame> {
    let rows = replay.points.iter().zip(&recording.points);
    let pairs: Vec<(Vector3<f64>, Vector3<f64>)> = rows
        .filter_map(|(simulated, measured)| Some(simulated.as_ref()?.iter().zip(measured)))
        .flatten()
        .filter_map(|(simulated, measured)| Some(((*measured)?, *simulated)))
        .collect();
    if pairs.len() < 3 {
        return None;
    }
    let count = pairs.len() as f64;
    let [from, to] = [
        pairs.iter().map(|pair| pair.0).sum::<Vector3<f64>>() / count,
        pairs.iter().map(|pair| pair.1).sum::<Vector3<f64>>() / count,
    ];
    let product: Matrix3<f64> = (pairs.iter())
        .map(|(measured, simulated)| (measured - from) * (simulated - to).transpose())
        .sum();
    let rotation = turn(&product)?;
    let pose = Isometry3::from_parts(Translation3::from(to - rotation * from), rotation);
    let squares: f64 = (pairs.iter())
        .map(|(measured, simulated)| {
            (rotation * measured + pose.translation.vector - simulated).norm_squared()
        })
        .sum();
    Some(FoundFrame {
        pose,
        rmse_before: replay.residuals(recording).rmse,
        rmse_after: (squares / count).sqrt(),
    })
}

/// The rotation `R` that makes `tr(R product)` largest; none where numbers are not finite.
fn turn(product: &Matrix3<f64>) -> Option<UnitQuaternion<f64>> {
    let s = |i: usize, j: usize| product[(i, j)];
    let (x, y, z) = (s(1, 2) - s(2, 1), s(2, 0) - s(0, 2), s(0, 1) - s(1, 0));
    let (xy, xz, yz) = (s(0, 1) + s(1, 0), s(2, 0) + s(0, 2), s(1, 2) + s(2, 1));
    let diagonal = [
        s(0, 0) + s(1, 1) + s(2, 2),
        s(0, 0) - s(1, 1) - s(2, 2),
        s(1, 1) - s(0, 0) - s(2, 2),
        s(2, 2) - s(0, 0) - s(1, 1),
    ];
    #[rustfmt::skip]
    let matrix = Matrix4::new(
        diagonal[0], x, y, z,
        x, diagonal[1], xy, xz,
        y, xy, diagonal[2], yz,
        z, xz, yz, diagonal[3],
    );
    if matrix.iter().any(|entry| !entry.is_finite()) {
        return None;
    }
    let eigen = matrix.symmetric_eigen();
    let largest = eigen.eigenvalues.imax();
    let q = eigen.eigenvectors.column(largest);
    Some(UnitQuaternion::from_quaternion(Quaternion::new(
        q[0], q[1], q[2], q[3],
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_found_by_the_markers() {
        let points = [
            [0.0, 0.0, 0.2],
            [0.1, 0.0, 0.15],
            [0.0, 0.12, 0.1],
            [-0.05, 0.02, 0.18],
        ];
        let simulated: Vec<Vector3<f64>> = points.map(Vector3::from).to_vec();
        let rotation = UnitQuaternion::from_euler_angles(1.5, -0.4, 2.5);
        let pose = Isometry3::from_parts(Translation3::new(0.3, -0.1, 1.0), rotation);
        let measured = |point: &Vector3<f64>| {
            pose.inverse_transform_point(&nalgebra::Point3::from(*point))
                .coords
        };
        let recording = Recording {
            times: vec![0.0, 1.0, 2.0, 3.0],
            points: simulated
                .iter()
                .map(|point| vec![Some(measured(point))])
                .collect(),
            ..Recording::default()
        };
        let replay = Replay {
            points: simulated.iter().map(|point| Some(vec![*point])).collect(),
            discs: vec![None; 4],
            surface: vec![None; 4],
        };
        let found = find_frame(&replay, &recording).expect("four points");
        assert!(
            found.rmse_after < 1e-12 && found.rmse_before > 0.05,
            "{found:?}"
        );
        assert!(found.pose.rotation.angle_to(&rotation) < 1e-9);
        assert!((found.pose.translation.vector - pose.translation.vector).norm() < 1e-12);
        let none = Replay {
            points: vec![None; 4],
            ..replay
        };
        assert_eq!(find_frame(&none, &recording), None);
    }
}

//! From the factory's calibration to ours.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use tdcr_sim::camera::{Distortion, Intrinsics};

use super::error::RealSenseError;
use super::library::{RsExtrinsics, RsIntrinsics};

/// How far a rotation's columns may be from orthonormal: far more than rounding to `f32` makes.
const ORTHONORMAL: f64 = 1e-4;

/// Names of `rs2_distortion`'s models, by their numbers.
const MODELS: [&str; 6] = [
    "none",
    "modified Brown-Conrady",
    "inverse Brown-Conrady",
    "f-theta",
    "Brown-Conrady",
    "Kannala-Brandt",
];

/// The intrinsics of a stream.
///
/// librealsense projects by Brown and Conrady's model in the order of [`Distortion`]'s coefficients (`rs2_project_point_to_pixel`).
/// Its modified kind displaces tangentially what was displaced radially, so without tangential coefficients it is the same. D435s
/// report the inverse kind with all coefficients 0. What is neither cannot be written as [`Distortion`], and is refused.
///
/// # Errors
/// [`RealSenseError::Calibration`] for numbers or a model that are of no use.
pub(super) fn intrinsics(
    stream: &'static str,
    found: &RsIntrinsics,
) -> Result<Intrinsics, RealSenseError> {
    let unusable = |what: String| RealSenseError::Calibration { stream, what };
    let [Ok(width), Ok(height)] = [found.width, found.height].map(u32::try_from) else {
        return Err(unusable(format!(
            "images of {} x {} pixels",
            found.width, found.height
        )));
    };
    let [fx, fy, cx, cy] = [found.fx, found.fy, found.ppx, found.ppy].map(f64::from);
    let finite = [fx, fy, cx, cy].iter().all(|x| x.is_finite());
    if width == 0 || height == 0 || !finite || fx <= 0.0 || fy <= 0.0 {
        return Err(unusable(format!(
            "{width} x {height} pixels, focal lengths {fx} and {fy}, principal point ({cx}, {cy}); expected sizes and \
             focal lengths above 0"
        )));
    }
    let [k1, k2, p1, p2, k3] = found.coeffs.map(f64::from);
    let model = usize::try_from(found.model)
        .ok()
        .and_then(|model| MODELS.get(model));
    let distortion = match model.copied() {
        Some(_) if found.coeffs == [0.0; 5] => None,
        Some("Brown-Conrady") => Some(Distortion { k1, k2, p1, p2, k3 }),
        Some("modified Brown-Conrady") if p1 == 0.0 && p2 == 0.0 => {
            Some(Distortion { k1, k2, p1, p2, k3 })
        }
        Some("none") => None,
        model => {
            return Err(unusable(format!(
                "distortion of the model {} with the coefficients {:?}; expected none, or Brown-Conrady",
                model.unwrap_or("of an unknown number"),
                found.coeffs
            )));
        }
    };
    Ok(Intrinsics {
        width,
        height,
        fx,
        fy,
        cx,
        cy,
        distortion,
    })
}

/// The transform from the depth camera's frame to the colour camera's (m).
///
/// # Errors
/// [`RealSenseError::Calibration`] where it is no rigid motion.
pub(super) fn depth_to_color(found: &RsExtrinsics) -> Result<Isometry3<f64>, RealSenseError> {
    let rotation = Matrix3::from_column_slice(&found.rotation.map(f64::from));
    let translation = Vector3::from(found.translation.map(f64::from));
    let off = (rotation.transpose() * rotation - Matrix3::identity()).amax();
    // Written so that NaN is refused.
    if !(off < ORTHONORMAL && rotation.determinant() > 0.0 && translation.amax().is_finite()) {
        return Err(RealSenseError::Calibration {
            stream: "depth-to-colour",
            what: format!(
                "rotation {:?}, translation {:?} m",
                found.rotation, found.translation
            ),
        });
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&rotation));
    Ok(Isometry3::from_parts(
        Translation3::from(translation),
        rotation,
    ))
}

//! Clouds as messages for the page.

use tdcr_sim::cloud::PointCloud;

use super::frame::Kind;

/// What a cloud is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    /// A sample of a data set.
    Sample,
    /// What a network predicts.
    Prediction,
    /// What a recording has.
    Recorded,
    /// What the cameras of a rig see now.
    Measured,
    /// What a program marks: balls, whose radius stands in place of the distance.
    Marked,
}

/// How a cloud came about.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct About {
    /// Mean distance (m) to the robot that is shown; none where it was not measured.
    pub distance: Option<f64>,
    /// Time that it took (s).
    pub seconds: f64,
}

/// A cloud as a message: what it is, its number of points, mean distance (m; NaN for none) and time (s) as little-endian `f64`s, then
/// positions (m) as `f32`s, then 8-bit RGB; read by `cloud` in `src/view/page/link.js`.
pub(super) fn bytes(role: Role, cloud: &PointCloud, about: About) -> Vec<u8> {
    let head = [
        Kind::Cloud.number(),
        f64::from(role as u8),
        cloud.len() as f64,
        about.distance.unwrap_or(f64::NAN),
        about.seconds,
    ];
    let mut message: Vec<u8> = head.into_iter().flat_map(f64::to_le_bytes).collect();
    let numbers = cloud.points.as_flattened().iter();
    message.extend(numbers.flat_map(|x| x.to_le_bytes()));
    message.extend(cloud.colors.as_flattened());
    message
}

//! Point clouds.

/// A coloured point cloud in the world frame.
///
/// `points[k]` (m) and `colors[k]` (8-bit RGB) describe the same point; both have the same length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Positions in the world frame (m).
    pub points: Vec<[f32; 3]>,
    /// Colours, 8-bit RGB.
    pub colors: Vec<[u8; 3]>,
}

impl PointCloud {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether the cloud holds no point.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }
}

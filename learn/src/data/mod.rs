//! Data sets: (command, point cloud) pairs, on disk and in memory.

/// Conditions and clouds in the normalised units that a network sees.
///
/// Clouds are world-frame positions divided by the data set's scale `s` (paper, Eq. point_normalization);
/// conditions are min-max scaled to `[0, 1]` per dimension (paper, Eq. motor_normalization).
#[derive(Clone, Debug, PartialEq)]
pub struct CloudSet {
    /// Condition dimension `D`.
    pub condition_dim: usize,
    /// Points per cloud `N`.
    pub points_per_cloud: usize,
    /// Conditions, row-major `(B, D)`, dimensionless.
    pub conditions: Vec<f32>,
    /// Points, row-major `(B, N, 3)`, dimensionless.
    pub points: Vec<f32>,
}

impl CloudSet {
    /// Number of clouds `B`.
    pub fn len(&self) -> usize {
        self.conditions.len() / self.condition_dim
    }

    /// Whether the set holds no cloud.
    pub fn is_empty(&self) -> bool {
        self.conditions.is_empty()
    }

    /// Condition of cloud `index`, length `D`.
    pub fn condition(&self, index: usize) -> &[f32] {
        &self.conditions[index * self.condition_dim..][..self.condition_dim]
    }

    /// Points of cloud `index`, row-major `(N, 3)`.
    pub fn cloud(&self, index: usize) -> &[f32] {
        let stride = 3 * self.points_per_cloud;
        &self.points[index * stride..][..stride]
    }
}

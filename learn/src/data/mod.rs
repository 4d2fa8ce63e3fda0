//! Data sets: (command, point cloud) pairs, on disk and in memory.
//!
//! A data set is a folder:
//!
//! ```text
//! meta.json                                    what it was made with; written last
//! global_motors_scope-all.json                 {"all": {"min": [...], "max": [...], "scale": [...]}}
//! global_norm_scope-all_anchor-origin.json     {"all": {"center": [0, 0, 0], "scale": s}}
//! train/shard-00000.h5, ..., val/..., test/... B samples each, N points a cloud, D values of a condition:
//!     data         (B, N, 3)  f32   points, world frame (m)
//!     rgb          (B, N, 3)  u8    colours
//!     motors       (B, D)     f32   conditions: commands (m), then where obstacles are moved their displacements (m, rad), then
//!                                   the payload (kg) in a set with payloads
//!     motors_norm  (B, D)     f32   conditions, min-max scaled to [0, 1]
//!     data_norm    (B, N, 3)  f32   points divided by s
//!     center       (B, 3)     f32   zeros
//!     scale        (B,)       f32   s (m)
//!     payload      (B,)       f32   payloads (kg) once more: in a set with payloads alone
//! ```
//!
//! Displacements of obstacles ([`ObstacleVariation`]) are more motors. A payload is one more motor to readers of the layout that know none; `payload` tells the others which it is.
//!
//! [`Collector`] makes one, takes up an interrupted one, and lets one grow, or makes a part of one; [`merge()`] puts parts
//! together; [`DataSet`] reads one, `meta.json` or not.

mod assemble;
mod blocks;
mod check;
mod collector;
mod conditions;
mod dataset;
mod error;
mod exchange;
mod folder;
mod grow;
mod hdf5_error;
mod merge;
mod merge_error;
mod meta;
mod normalisation;
mod obstacle_variation;
mod part;
mod sample;
mod sample_count;
mod shard;
mod shard_file;
mod simulator;
mod split;
mod split_samples;
mod stream;

pub use check::{Finding, check, check_with};
pub use collector::Collector;
pub use conditions::{Condition, Design, PayloadRange, UnitPoints, conditions, conditions_among};
pub use dataset::DataSet;
pub use error::DataError;
pub use exchange::{
    CloudFileError, ExportFormat, ImportSettings, Imported, LengthUnit, NpzArray, NpzRows,
    NpzValues, PredictedClouds, export, import, read_cloud, read_predictions, write_npy, write_npz,
};
pub use merge::merge;
pub use merge_error::MergeError;
pub use meta::{Meta, Origin, Recording};
pub use normalisation::{Normalisation, OutOfRange};
pub use obstacle_variation::{ObstacleDraws, ObstacleVariation};
pub use sample::Sample;
pub use simulator::{Recipe, SimulateError, SimulationTimes, Simulator, Subject};
pub use split::{Split, SplitIndices, split_indices};
pub use split_samples::SplitSamples;
pub use stream::{SimStream, StreamSpec};

use crate::channels::Channels;

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
    /// Colours, row-major `(B, N, 3)`, 8 bits that stand for [0, 1]; `None` where they are not wanted.
    pub colors: Option<Vec<u8>>,
    /// For each point, the one of a simulated surface that the flow to it starts from, dimensionless, row-major `(B, N, 3)`
    /// (see [`Prior::Surface`](crate::prior::Prior::Surface)); `None` where the flow starts from noise alone.
    pub starts: Option<Vec<f32>>,
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

    /// Points of the simulated surface that the flow to those of cloud `index` starts from, row-major `(N, 3)`, if it starts
    /// from one.
    pub fn start(&self, index: usize) -> Option<&[f32]> {
        let stride = 3 * self.points_per_cloud;
        let starts = self.starts.as_ref()?;
        Some(&starts[index * stride..][..stride])
    }

    /// Appends points `which` of cloud `index` to `rows`, as rows of `channels`; a colour's channels in [0, 1].
    ///
    /// # Panics
    /// If `channels` has colours and the set has none.
    pub fn gather(
        &self,
        index: usize,
        which: impl Iterator<Item = usize>,
        channels: Channels,
        rows: &mut Vec<f32>,
    ) {
        let first = index * self.points_per_cloud;
        let colors = match channels {
            Channels::Xyz => None,
            Channels::XyzRgb => Some(self.colors.as_deref().expect("a set with colours")),
        };
        for k in which.map(|k| 3 * (first + k)) {
            rows.extend_from_slice(&self.points[k..k + 3]);
            let color = colors.map_or(&[][..], |colors| &colors[k..k + 3]);
            rows.extend(color.iter().map(|&channel| f32::from(channel) / 255.0));
        }
    }

    /// Index of the cloud whose condition is nearest to `condition` (length `D`) in the Euclidean norm, the lowest
    /// such index if several are; `None` if the set is empty.
    ///
    /// # Panics
    /// If `condition` has another length.
    pub fn nearest_condition(&self, condition: &[f32]) -> Option<usize> {
        assert_eq!(
            condition.len(),
            self.condition_dim,
            "one component per motor"
        );
        let squared_distance = |index: usize| -> f32 {
            std::iter::zip(self.condition(index), condition)
                .map(|(a, b)| (a - b) * (a - b))
                .sum()
        };
        (0..self.len()).min_by(|&a, &b| squared_distance(a).total_cmp(&squared_distance(b)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_condition_is_the_first_of_the_nearest() {
        let set = CloudSet {
            condition_dim: 2,
            points_per_cloud: 1,
            conditions: vec![0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0],
            points: vec![0.0; 12],
            colors: None,
            starts: None,
        };
        assert_eq!(set.nearest_condition(&[0.9, 0.8]), Some(3));
        assert_eq!(set.nearest_condition(&[0.5, 0.0]), Some(0));
        assert_eq!(set.nearest_condition(&[0.5, 0.5]), Some(0));
        assert_eq!(set.nearest_condition(&[1.0, 0.1]), Some(1));
    }

    #[test]
    fn an_empty_set_has_no_nearest_condition() {
        let set = CloudSet {
            condition_dim: 1,
            points_per_cloud: 1,
            conditions: vec![],
            points: vec![],
            colors: None,
            starts: None,
        };
        assert_eq!(set.nearest_condition(&[0.5]), None);
    }
}

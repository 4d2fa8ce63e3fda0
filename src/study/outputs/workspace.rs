//! The reachable workspace of sampled commands, as the tip's places tell.

use nalgebra::Vector3;
use tdcr_sim::geometry::AlphaShape;

use super::table::Cell;
use crate::study::spec::{Column, Kind};

/// The workspace of one combination of levels.
#[derive(Clone, Debug, Default)]
pub(in crate::study) struct Workspace {
    pub shape: AlphaShape,
}

/// Columns of a workspace in a summary.
pub(in crate::study) fn columns() -> Vec<Column> {
    let number = |name, unit| Column::new(name, unit, Kind::Number);
    vec![
        number("volume", "m\u{b3}"),
        number("section_x", "m\u{b2}"),
        number("section_y", "m\u{b2}"),
        number("section_z", "m\u{b2}"),
        number("reach", "m"),
        number("z_min", "m"),
        number("z_max", "m"),
        number("alpha", "m"),
    ]
}

impl Workspace {
    /// Of the tip's places (m).
    pub fn new(tips: Vec<Vector3<f64>>, alpha: Option<f64>) -> Self {
        Self {
            shape: AlphaShape::new(tips, alpha),
        }
    }

    /// The cells of [`columns`]: sections are by the planes of the world's axes through the middle of all tips, the reach is the
    /// largest distance from the z axis of the base at `base`.
    pub fn cells(&self, base: &Vector3<f64>) -> Vec<Cell> {
        let points = self.shape.points();
        let (low, high) = bounds(points);
        let middle = (low + high) / 2.0;
        let sections = [Vector3::x(), Vector3::y(), Vector3::z()]
            .map(|normal| self.shape.section(&middle, &normal));
        let reach = points
            .iter()
            .map(|p| (p - base).xy().norm())
            .fold(f64::NAN, f64::max);
        let numbers = [
            self.shape.volume,
            sections[0],
            sections[1],
            sections[2],
            reach,
            low.z,
            high.z,
            self.shape.alpha,
        ];
        numbers.map(Cell::Number).into()
    }
}

/// Smallest and largest coordinates.
pub(in crate::study) fn bounds(points: &[Vector3<f64>]) -> (Vector3<f64>, Vector3<f64>) {
    let none = (
        Vector3::repeat(f64::INFINITY),
        Vector3::repeat(f64::NEG_INFINITY),
    );
    points
        .iter()
        .fold(none, |(low, high), p| (low.inf(p), high.sup(p)))
}

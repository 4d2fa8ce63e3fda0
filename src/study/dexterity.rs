//! Dexterity: the share of directions that the tip takes at a place, the service coefficient of Vinogradov and others (1971), as
//! sampled commands tell it.
//!
//! The sphere of directions is divided into cells of equal area (bands of equal height, by Archimedes, and sectors). At a place,
//! those cells count in which the tip's axis points under a command that brings the tip within a radius of the place. So it
//! is a bound from below, which rises with the number of commands, and a mean over the radius.

use std::collections::HashMap;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use tdcr_base::stats::{quantile, sorted};

use super::table::{Cell, Column, Kind};
use super::workspace::bounds;
use crate::report::{HeatMap, HeatPanel, Spacing, StudyFigure};

/// Bands and sectors of the sphere of directions.
const BANDS: usize = 6;
const SECTORS: usize = 8;
/// Places at which a group's dexterity is told, at most.
const PLACES: usize = 4000;
/// Places across the larger side of a map.
const ACROSS: f64 = 40.0;

/// A place of the tip (m), and the direction of its axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct TipAxis {
    place: Vector3<f64>,
    axis: Vector3<f64>,
}

impl TipAxis {
    /// Of a place and an orientation `w, x, y, z`.
    pub fn new(place: Vector3<f64>, [w, x, y, z]: [f64; 4]) -> Self {
        let turn = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
        Self {
            place,
            axis: turn * Vector3::z(),
        }
    }

    /// The cell of the sphere that the axis points to.
    fn cell(&self) -> usize {
        let band = (0.5 * (self.axis.z + 1.0) * BANDS as f64) as usize;
        let turn = self.axis.y.atan2(self.axis.x) / std::f64::consts::TAU + 0.5;
        let sector = (turn * SECTORS as f64) as usize;
        band.min(BANDS - 1) * SECTORS + sector.min(SECTORS - 1)
    }
}

/// The tips of a group, found by their places.
pub(super) struct Dexterity {
    tips: Vec<TipAxis>,
    radius: f64,
    /// Tips by cubes with edges of the radius.
    cubes: HashMap<[i64; 3], Vec<usize>>,
}

/// Columns of the dexterity in a summary.
pub(super) fn columns() -> Vec<Column> {
    let number = |name, unit| Column::new(name, unit, Kind::Number);
    vec![
        number("dexterity_p10", ""),
        number("dexterity_median", ""),
        number("dexterity_p90", ""),
        number("dexterity_max", ""),
        number("dexterity_tips", ""),
        number("dexterity_radius", "m"),
    ]
}

impl Dexterity {
    /// Of the tips of sampled commands; those within `radius` (m) of a place count there.
    pub fn new(tips: Vec<TipAxis>, radius: f64) -> Self {
        let mut cubes: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
        for (index, tip) in tips.iter().enumerate() {
            cubes
                .entry(cube(&tip.place, radius))
                .or_default()
                .push(index);
        }
        Self {
            tips,
            radius,
            cubes,
        }
    }

    /// The share of directions at a place, and how many tips tell it.
    fn at(&self, place: &Vector3<f64>) -> (f64, usize) {
        let [x, y, z] = cube(place, self.radius);
        let (mut seen, mut count) = ([false; BANDS * SECTORS], 0);
        for offset in 0..27 {
            let next = [
                x + offset % 3 - 1,
                y + offset / 3 % 3 - 1,
                z + offset / 9 - 1,
            ];
            for &tip in self.cubes.get(&next).into_iter().flatten() {
                let tip = &self.tips[tip];
                if (tip.place - place).norm() <= self.radius {
                    seen[tip.cell()] = true;
                    count += 1;
                }
            }
        }
        let cells = seen.iter().filter(|seen| **seen).count();
        (cells as f64 / seen.len() as f64, count)
    }

    /// The cells of [`columns`]: quantiles over the places of the tips.
    pub fn cells(&self) -> Vec<Cell> {
        let stride = self.tips.len().div_ceil(PLACES).max(1);
        let told = self
            .tips
            .iter()
            .step_by(stride)
            .map(|tip| self.at(&tip.place));
        let (shares, counts): (Vec<f64>, Vec<f64>) =
            told.map(|(share, count)| (share, count as f64)).unzip();
        let (shares, counts) = (sorted(shares), sorted(counts));
        let numbers = [
            quantile(&shares, 0.1),
            quantile(&shares, 0.5),
            quantile(&shares, 0.9),
            quantile(&shares, 1.0),
            quantile(&counts, 0.5),
            self.radius,
        ];
        numbers.map(Cell::Number).into()
    }
}

/// The cube of a place.
fn cube(place: &Vector3<f64>, edge: f64) -> [i64; 3] {
    [place.x, place.y, place.z].map(|x| (x / edge).floor() as i64)
}

/// Maps of the dexterity in the plane of the world's x and z axes through the middle of all tips, one for each named group.
pub(super) fn figure(groups: &[(String, Dexterity)], note: &str) -> Option<StudyFigure> {
    let radius = groups.first()?.1.radius;
    let places = groups.iter().flat_map(|(_, group)| &group.tips);
    let places: Vec<Vector3<f64>> = places.map(|tip| tip.place).collect();
    if places.is_empty() {
        return None;
    }
    let (low, high) = bounds(&places);
    let middle = (low.y + high.y) / 2.0;
    let step = ((high.x - low.x).max(high.z - low.z) / ACROSS).max(f64::MIN_POSITIVE);
    let along = |low: f64, high: f64| -> Vec<f64> {
        let count = ((high - low) / step).ceil() as usize + 1;
        (0..count).map(|k| low + k as f64 * step).collect()
    };
    let (across, up) = (along(low.x, high.x), along(low.z, high.z));
    let panel = |(name, group): &(String, Dexterity)| HeatPanel {
        title: name.clone(),
        values: (up.iter())
            .map(|z| {
                let share = |x: &f64| match group.at(&Vector3::new(*x, middle, *z)) {
                    (_, 0) => f64::NAN,
                    (share, _) => 100.0 * share,
                };
                across.iter().map(share).collect()
            })
            .collect(),
    };
    let millimetres = |values: &[f64]| values.iter().map(|x| 1e3 * x).collect();
    let map = HeatMap {
        title: "Dexterity".to_owned(),
        caption: format!(
            "Share of {} directions of equal solid angle in which the tip points under the sampled commands that bring it within \
             {:.0} mm of a place; the plane y = {:.0} mm. {note}",
            BANDS * SECTORS,
            1e3 * radius,
            1e3 * middle + 0.0
        ),
        x: ("x (mm)".to_owned(), millimetres(&across)),
        y: ("z (mm)".to_owned(), millimetres(&up)),
        value: "%".to_owned(),
        spacing: Spacing::Linear,
        panels: groups.iter().map(panel).collect(),
    };
    Some(StudyFigure {
        name: "dexterity".to_owned(),
        svg: map.to_svg(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turned(axis: Vector3<f64>) -> [f64; 4] {
        let turn = UnitQuaternion::rotation_between(&Vector3::z(), &axis);
        let q = turn.unwrap_or_else(|| {
            UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI)
        });
        [q.w, q.i, q.j, q.k]
    }

    /// Evenly spread directions (a Fibonacci sphere), `part` of them from the top.
    fn directions(count: usize, part: f64) -> Vec<Vector3<f64>> {
        (0..count)
            .map(|k| {
                let z = 1.0 - 2.0 * part * (k as f64 + 0.5) / count as f64;
                let turn = k as f64 * 2.399_963;
                let flat = (1.0 - z * z).sqrt();
                Vector3::new(flat * turn.cos(), flat * turn.sin(), z)
            })
            .collect()
    }

    #[test]
    fn the_share_of_directions_is_that_of_the_solid_angle() {
        for (part, expected) in [(1.0, 1.0), (0.5, 0.5), (1.0 / 6.0, 1.0 / 6.0)] {
            let tips = directions(2000, part);
            let tips = tips
                .iter()
                .map(|axis| TipAxis::new(Vector3::zeros(), turned(*axis)));
            let all = Dexterity::new(tips.collect(), 0.01);
            let (share, count) = all.at(&Vector3::new(0.005, 0.0, 0.0));
            assert!((share - expected).abs() < 1e-12, "{share}, not {expected}");
            assert_eq!(count, 2000);
        }
    }

    #[test]
    fn only_tips_within_the_radius_count() {
        let at = |x: f64| TipAxis::new(Vector3::new(x, 0.0, 0.0), [1.0, 0.0, 0.0, 0.0]);
        let tips = Dexterity::new(
            vec![at(-0.011), at(-0.009), at(0.0), at(0.0099), at(0.02)],
            0.01,
        );
        assert_eq!(tips.at(&Vector3::zeros()).1, 3);
        assert_eq!(tips.at(&Vector3::new(1.0, 0.0, 0.0)), (0.0, 0));
    }
}

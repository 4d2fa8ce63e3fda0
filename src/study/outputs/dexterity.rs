//! Dexterity: the share of directions that the tip takes at a place, the service coefficient of Vinogradov and others (1971), as
//! sampled commands tell it.
//!
//! The sphere of directions is divided into cells of equal area (bands of equal height, by Archimedes, and sectors). At a place,
//! those cells count in which the tip's axis points under a command that brings the tip within a radius of the place. So it
//! is a bound from below, which rises with the number of commands, and a mean over the radius.

use std::collections::HashMap;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use tdcr_base::stats::{quantile, sorted};

use super::table::Cell;
use crate::study::spec::{Column, Kind};

/// Bands and sectors of the sphere of directions.
pub(in crate::study) const BANDS: usize = 6;
pub(in crate::study) const SECTORS: usize = 8;
/// Places at which a group's dexterity is computed, at most.
const PLACES: usize = 4000;

/// A place of the tip (m), and the direction of its axis.
#[derive(Clone, Copy, Debug)]
pub(in crate::study) struct TipAxis {
    pub(in crate::study) place: Vector3<f64>,
    axis: Vector3<f64>,
}

impl TipAxis {
    /// Of a place and an orientation `w, x, y, z`.
    pub fn new(place: Vector3<f64>, [w, x, y, z]: [f64; 4]) -> Self {
        let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
        Self {
            place,
            axis: rotation * Vector3::z(),
        }
    }

    /// The cell of the sphere that the axis points to.
    fn cell(&self) -> usize {
        let band = (0.5 * (self.axis.z + 1.0) * BANDS as f64) as usize;
        let angle = self.axis.y.atan2(self.axis.x) / std::f64::consts::TAU + 0.5;
        let sector = (angle * SECTORS as f64) as usize;
        band.min(BANDS - 1) * SECTORS + sector.min(SECTORS - 1)
    }
}

/// The tips of a group, found by their places.
pub(in crate::study) struct Dexterity {
    pub(in crate::study) tips: Vec<TipAxis>,
    pub(in crate::study) radius: f64,
    /// Tips by cubes with edges of the radius.
    cubes: HashMap<[i64; 3], Vec<usize>>,
}

/// Columns of the dexterity in a summary.
pub(in crate::study) fn columns() -> Vec<Column> {
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
    pub(in crate::study) fn at(&self, place: &Vector3<f64>) -> (f64, usize) {
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
        let shares = self
            .tips
            .iter()
            .step_by(stride)
            .map(|tip| self.at(&tip.place));
        let (shares, counts): (Vec<f64>, Vec<f64>) =
            shares.map(|(share, count)| (share, count as f64)).unzip();
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

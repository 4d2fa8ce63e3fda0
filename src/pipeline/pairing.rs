//! Which samples of two data sets are of one configuration.

use std::collections::HashMap;

use serde::Serialize;
use serde::ser::Serializer;
use tdcr_learn::data::{Condition, Split};

use super::CompareError;

/// How samples are paired.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pairing {
    /// Those of equal conditions.
    Condition {
        /// Largest difference of a number of a condition, as a part of its range in both data sets.
        tolerance: f64,
    },
    /// Those of one index in one split, whatever their conditions.
    Index,
}

impl Pairing {
    /// Tolerance where nobody asks for another: files of text keep a few digits of a command, and 1/1000 of a range is far less
    /// than what tells commands apart.
    pub const TOLERANCE: f64 = 1e-3;
}

/// By equal conditions.
impl Default for Pairing {
    fn default() -> Self {
        Self::Condition {
            tolerance: Self::TOLERANCE,
        }
    }
}

/// Where a sample is in a data set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
pub struct Place {
    /// Its split.
    #[serde(serialize_with = "split_name")]
    pub split: Split,
    /// Its index there.
    pub index: usize,
}

/// A sample whose cloud is not read yet.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    pub place: Place,
    pub condition: Condition,
}

/// Samples of one configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pair {
    /// Their places in the lists of both data sets.
    pub entries: [usize; 2],
    /// Largest difference of a number of their conditions, as a part of its range.
    pub apart: f64,
}

fn split_name<S: Serializer>(split: &Split, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(split.folder())
}

impl Pairing {
    /// The pairs in the order of the first list. No sample is in two of them.
    pub(super) fn pairs(
        self,
        first: &[Entry],
        second: &[Entry],
    ) -> Result<Vec<Pair>, CompareError> {
        let motors =
            [first, second].map(|list| list.first().map_or(0, |e| e.condition.motors.len()));
        if motors[0] != motors[1] {
            return Err(CompareError::OtherMotors { found: motors });
        }
        let rows = scaled(first, second);
        let pairs = match self {
            Self::Index => by_place(first, second, &rows),
            Self::Condition { tolerance } => nearest(&rows, tolerance),
        };
        match (pairs.is_empty(), self) {
            (false, _) => Ok(pairs),
            (true, Self::Condition { tolerance }) => {
                Err(CompareError::NothingInCommon { tolerance })
            }
            (true, Self::Index) => Err(CompareError::NoCommonIndex),
        }
    }
}

/// Conditions of both lists, each number in units of its range over both. No payload is one of 0 kg.
fn scaled(first: &[Entry], second: &[Entry]) -> [Vec<Vec<f64>>; 2] {
    let loaded = first
        .iter()
        .chain(second)
        .any(|e| e.condition.payload.is_some());
    let row = |entry: &Entry| -> Vec<f64> {
        let motors = entry.condition.motors.iter().copied();
        let payload = loaded.then(|| entry.condition.payload.unwrap_or(0.0));
        motors.chain(payload).map(f64::from).collect()
    };
    let mut rows = [first, second].map(|list| list.iter().map(row).collect::<Vec<_>>());
    let width = rows.iter().flatten().map(Vec::len).min().unwrap_or(0);
    for k in 0..width {
        let values = rows.iter().flatten().map(|row| row[k]);
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
            (low.min(x), high.max(x))
        });
        // Where all are equal, their differences are 0 in any unit.
        let unit = if high > low { high - low } else { 1.0 };
        for row in rows.iter_mut().flatten() {
            row[k] /= unit;
        }
    }
    rows
}

/// Largest difference of two conditions.
fn apart(a: &[f64], b: &[f64]) -> f64 {
    let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, f64::max)
}

fn by_place(first: &[Entry], second: &[Entry], [a, b]: &[Vec<Vec<f64>>; 2]) -> Vec<Pair> {
    let places = second.iter().enumerate().map(|(k, entry)| (entry.place, k));
    let places: HashMap<Place, usize> = places.collect();
    let pair = |(k, entry): (usize, &Entry)| {
        let other = *places.get(&entry.place)?;
        Some(Pair {
            entries: [k, other],
            apart: apart(&a[k], &b[other]),
        })
    };
    first.iter().enumerate().filter_map(pair).collect()
}

/// For each row of the first list the nearest row of the second that is free and near enough.
fn nearest([first, second]: &[Vec<Vec<f64>>; 2], tolerance: f64) -> Vec<Pair> {
    let key = |row: &[f64]| row.first().copied().unwrap_or(0.0);
    // Rows that are near in all numbers are near in the first.
    let mut order: Vec<usize> = (0..second.len()).collect();
    order.sort_by(|&a, &b| key(&second[a]).total_cmp(&key(&second[b])));
    let mut free = vec![true; second.len()];
    let mut pairs = Vec::new();
    for (k, row) in first.iter().enumerate() {
        let start = order.partition_point(|&other| key(&second[other]) < key(row) - tolerance);
        let near = order[start..].iter().copied();
        let near = near.take_while(|&other| key(&second[other]) <= key(row) + tolerance);
        let candidates = near.filter(|&other| free[other]).map(|other| Pair {
            entries: [k, other],
            apart: apart(row, &second[other]),
        });
        let close = candidates.filter(|pair| pair.apart <= tolerance);
        if let Some(pair) = close.min_by(|a, b| a.apart.total_cmp(&b.apart)) {
            free[pair.entries[1]] = false;
            pairs.push(pair);
        }
    }
    pairs
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;

    fn entries(rows: &[[f32; 2]], payload: Option<f32>) -> Vec<Entry> {
        let entry = |(index, row): (usize, &[f32; 2])| Entry {
            place: Place {
                split: if index < 2 { Split::Train } else { Split::Test },
                index: index % 2,
            },
            condition: Condition {
                motors: row.to_vec(),
                payload,
            },
        };
        rows.iter().enumerate().map(entry).collect()
    }

    fn found(pairing: Pairing, first: &[Entry], second: &[Entry]) -> Vec<[usize; 2]> {
        let pairs = pairing.pairs(first, second).unwrap();
        pairs.into_iter().map(|pair| pair.entries).collect()
    }

    #[test]
    fn equal_conditions_are_paired_in_any_order_and_unit() {
        let first = entries(&[[0.0, 10.0], [0.02, 30.0], [0.04, -10.0]], None);
        // 1/1000 of the ranges is 4e-5 and 0.04.
        let second = entries(
            &[[0.04, -10.03], [0.0, 10.05], [0.02003, 30.0], [0.01, 0.0]],
            None,
        );
        assert_eq!(found(Pairing::default(), &first, &second), [[1, 2], [2, 0]]);
        let wide = Pairing::Condition { tolerance: 0.01 };
        assert_eq!(found(wide, &first, &second), [[0, 1], [1, 2], [2, 0]]);
        assert_eq!(
            found(Pairing::Index, &first, &second),
            [[0, 0], [1, 1], [2, 2]]
        );
        let pairs = Pairing::Index.pairs(&first, &second).unwrap();
        assert!((pairs[0].apart - 1.0).abs() < 1e-6, "{:?}", pairs[0]);
    }

    #[test]
    fn of_several_near_ones_each_is_paired_once() {
        let first = entries(&[[0.0, 0.0], [0.0, 0.0], [1.0, 1.0]], None);
        let second = entries(
            &[[0.0, 0.0004], [0.0, 0.0001], [1.0, 1.0], [0.0, 0.0002]],
            None,
        );
        let expected = [[0, 1], [1, 3], [2, 2]];
        assert_eq!(found(Pairing::default(), &first, &second), expected);
    }

    #[test]
    fn a_configuration_without_payload_is_one_of_none() {
        let rows = [[0.0, 1.0], [1.0, 0.0]];
        let (bare, light, heavy) = (
            entries(&rows, None),
            entries(&rows, Some(0.0)),
            entries(&rows, Some(0.1)),
        );
        assert_eq!(found(Pairing::default(), &bare, &light), [[0, 0], [1, 1]]);
        let refused = Pairing::default().pairs(&bare, &heavy).unwrap_err();
        assert!(matches!(
            refused,
            CompareError::NothingInCommon { tolerance: 1e-3 }
        ));
    }
}

//! Designs of experiments: how points are spread over a unit cube.

use rand::RngExt;
use serde::{Deserialize, Serialize};

use super::permutation::Permutation;
use super::rng;
use super::sobol::{MAX_DIMENSIONS, Sobol};
use crate::data::DataError;

/// How commands are spread over the box of the tendons' ranges, and payloads with them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Design {
    /// Independently and uniformly, as in the paper.
    Uniform,
    /// A Latin hypercube: in each dimension one point in each of `count` equal strata (McKay, Beckman and Conover, 1979).
    LatinHypercube,
    /// The Sobol sequence with a random digital shift. Counts that are powers of 2 are spread most evenly.
    Sobol,
    /// Every combination of the same number of levels in each dimension, from one end of the range to the other.
    /// Payloads are levels too, without the share of zeros.
    Grid,
}

impl Design {
    /// All designs.
    pub const ALL: [Self; 4] = [Self::Uniform, Self::LatinHypercube, Self::Sobol, Self::Grid];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Uniform => "uniform",
            Self::LatinHypercube => "latin-hypercube",
            Self::Sobol => "sobol",
            Self::Grid => "grid",
        }
    }

    /// Whether the first conditions of many are those of few, so that a data set can grow.
    pub fn can_grow(self) -> bool {
        match self {
            Self::Uniform | Self::Sobol => true,
            Self::LatinHypercube | Self::Grid => false,
        }
    }

    /// `count` points of the unit cube in so many `dimensions`, by this design and `seed`. Their first coordinates are those
    /// of fewer dimensions, but in a grid.
    ///
    /// # Errors
    /// [`DataError::Design`] where the design has no such number of points, or none of so many dimensions.
    pub fn unit_points(
        self,
        dimensions: usize,
        count: usize,
        seed: u64,
    ) -> Result<UnitPoints, DataError> {
        Ok(UnitPoints {
            points: self.points(dimensions, count, seed)?,
            dimensions,
            seed,
        })
    }

    /// The design's points; `None` where each is drawn by itself.
    pub(super) fn points(
        self,
        dimensions: usize,
        count: usize,
        seed: u64,
    ) -> Result<Option<Points>, DataError> {
        // Away from the streams of single conditions.
        let rng = |dimension: usize| rng(seed, u64::MAX - dimension as u64);
        let points = match self {
            Self::Uniform => return Ok(None),
            Self::LatinHypercube => Points::LatinHypercube {
                count,
                strata: (0..dimensions)
                    .map(|dimension| Permutation::new(count, &mut rng(dimension)))
                    .collect(),
                seed,
            },
            Self::Sobol if dimensions > MAX_DIMENSIONS => {
                return Err(DataError::Design {
                    problem: format!(
                        "Sobol points have at most {MAX_DIMENSIONS} dimensions, the conditions {dimensions}"
                    ),
                });
            }
            Self::Sobol => Points::Sobol {
                sequence: Sobol::new(dimensions),
                shift: (0..dimensions).map(|d| rng(d).random()).collect(),
            },
            Self::Grid => Points::Grid {
                levels: grid_levels(dimensions, count)?,
                dimensions,
            },
        };
        Ok(Some(points))
    }
}

/// The levels of the grid with so many points.
fn grid_levels(dimensions: usize, count: usize) -> Result<usize, DataError> {
    let exponent = u32::try_from(dimensions).unwrap_or(u32::MAX);
    let size = |levels: usize| levels.checked_pow(exponent).unwrap_or(usize::MAX);
    let levels = (1..=count)
        .take_while(|&levels| size(levels) <= count)
        .last()
        .unwrap_or(1);
    if size(levels) == count {
        return Ok(levels);
    }
    let next = levels + 1;
    Err(DataError::Design {
        problem: format!(
            "{count} commands are no grid in {dimensions} dimensions, expected {} ({levels} levels) or {} ({next} levels)",
            size(levels),
            size(next)
        ),
    })
}

/// Points of a unit cube, each by its number: [`Design::unit_points`].
pub struct UnitPoints {
    /// `None` where each is drawn by itself.
    points: Option<Points>,
    dimensions: usize,
    seed: u64,
}

impl UnitPoints {
    /// Point `index`, each coordinate from 0 to 1.
    ///
    /// # Panics
    /// For an index that is not below the number of points.
    pub fn point(&self, index: usize) -> Vec<f64> {
        match &self.points {
            Some(points) => points.point(index),
            None => {
                let mut rng = rng(self.seed, index as u64);
                (0..self.dimensions).map(|_| rng.random()).collect()
            }
        }
    }
}

/// Points of a unit cube.
pub(super) enum Points {
    LatinHypercube {
        count: usize,
        /// Which stratum each point is in, by dimension.
        strata: Vec<Permutation>,
        /// Of the places within the strata.
        seed: u64,
    },
    Sobol {
        sequence: Sobol,
        shift: Vec<u32>,
    },
    Grid {
        levels: usize,
        dimensions: usize,
    },
}

impl Points {
    pub fn point(&self, index: usize) -> Vec<f64> {
        match self {
            Self::LatinHypercube {
                count,
                strata,
                seed,
            } => {
                let mut rng = rng(*seed, index as u64);
                let place = |strata: &Permutation| {
                    (strata.place(index) as f64 + rng.random::<f64>()) / *count as f64
                };
                strata.iter().map(place).collect()
            }
            Self::Sobol { sequence, shift } => {
                let index = u32::try_from(index).expect("amounts are far below 2^32");
                let coordinate = |(dimension, shift): (usize, &u32)| {
                    let shifted = sequence.coordinate(index, dimension) ^ shift;
                    (f64::from(shifted) + 0.5) / 2f64.powi(32)
                };
                shift.iter().enumerate().map(coordinate).collect()
            }
            Self::Grid { levels, dimensions } => {
                let mut rest = index;
                (0..*dimensions)
                    .map(|_| {
                        let level = rest % levels;
                        rest /= levels;
                        match levels {
                            1 => 0.5,
                            _ => level as f64 / (levels - 1) as f64,
                        }
                    })
                    .collect()
            }
        }
    }
}

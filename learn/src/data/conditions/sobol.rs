//! Sobol points: evenly spread over a cube in any number, by the digital construction in base 2 (Sobol, 1967; the order
//! of Antonov and Saleev, 1979).

/// Bits of a coordinate.
const BITS: usize = 32;

/// Most dimensions of a point.
pub(super) const MAX_DIMENSIONS: usize = DIRECTIONS.len() + 1;

/// The sequence in so many dimensions.
pub(super) struct Sobol {
    /// Direction numbers of each dimension, the first for the lowest bit of an index.
    directions: Vec<[u32; BITS]>,
}

impl Sobol {
    /// Points of `dimensions` coordinates, at most [`MAX_DIMENSIONS`].
    pub fn new(dimensions: usize) -> Self {
        let first = std::array::from_fn(|bit| 1 << (BITS - 1 - bit));
        let others = DIRECTIONS.iter().map(|&(a, m)| expand(a, m));
        Self {
            directions: std::iter::once(first)
                .chain(others)
                .take(dimensions)
                .collect(),
        }
    }

    /// Coordinate `dimension` of point `index`, as a fraction of 2^32. Point 0 is the origin.
    pub fn coordinate(&self, index: u32, dimension: usize) -> u32 {
        let gray = index ^ (index >> 1);
        let bits = self.directions[dimension].iter().enumerate();
        bits.filter(|(bit, _)| gray >> bit & 1 == 1)
            .fold(0, |sum, (_, direction)| sum ^ direction)
    }
}

/// All direction numbers of a dimension from its primitive polynomial, whose inner coefficients are the bits of `a`, and
/// its first numbers `m` (Joe and Kuo, 2008, section 2).
fn expand(a: u32, m: &[u32]) -> [u32; BITS] {
    let degree = m.len();
    let mut directions = [0; BITS];
    for (bit, m) in m.iter().enumerate() {
        directions[bit] = m << (BITS - 1 - bit);
    }
    for bit in degree..BITS {
        let oldest = directions[bit - degree];
        directions[bit] = (1..degree)
            .filter(|k| a >> (degree - 1 - k) & 1 == 1)
            .fold(oldest ^ (oldest >> degree), |sum, k| {
                sum ^ directions[bit - k]
            });
    }
    directions
}

/// Dimensions 2 to 64 of the set new-joe-kuo-6.21201: Joe and Kuo, Constructing Sobol sequences with better
/// two-dimensional projections, SIAM J. Sci. Comput. 30 (2008).
const DIRECTIONS: [(u32, &[u32]); 63] = [
    (0, &[1]),
    (1, &[1, 3]),
    (1, &[1, 3, 1]),
    (2, &[1, 1, 1]),
    (1, &[1, 1, 3, 3]),
    (4, &[1, 3, 5, 13]),
    (2, &[1, 1, 5, 5, 17]),
    (4, &[1, 1, 5, 5, 5]),
    (7, &[1, 1, 7, 11, 19]),
    (11, &[1, 1, 5, 1, 1]),
    (13, &[1, 1, 1, 3, 11]),
    (14, &[1, 3, 5, 5, 31]),
    (1, &[1, 3, 3, 9, 7, 49]),
    (13, &[1, 1, 1, 15, 21, 21]),
    (16, &[1, 3, 1, 13, 27, 49]),
    (19, &[1, 1, 1, 15, 7, 5]),
    (22, &[1, 3, 1, 15, 13, 25]),
    (25, &[1, 1, 5, 5, 19, 61]),
    (1, &[1, 3, 7, 11, 23, 15, 103]),
    (4, &[1, 3, 7, 13, 13, 15, 69]),
    (7, &[1, 1, 3, 13, 7, 35, 63]),
    (8, &[1, 3, 5, 9, 1, 25, 53]),
    (14, &[1, 3, 1, 13, 9, 35, 107]),
    (19, &[1, 3, 1, 5, 27, 61, 31]),
    (21, &[1, 1, 5, 11, 19, 41, 61]),
    (28, &[1, 3, 5, 3, 3, 13, 69]),
    (31, &[1, 1, 7, 13, 1, 19, 1]),
    (32, &[1, 3, 7, 5, 13, 19, 59]),
    (37, &[1, 1, 3, 9, 25, 29, 41]),
    (41, &[1, 3, 5, 13, 23, 1, 55]),
    (42, &[1, 3, 7, 3, 13, 59, 17]),
    (50, &[1, 3, 1, 3, 5, 53, 69]),
    (55, &[1, 1, 5, 5, 23, 33, 13]),
    (56, &[1, 1, 7, 7, 1, 61, 123]),
    (59, &[1, 1, 7, 9, 13, 61, 49]),
    (62, &[1, 3, 3, 5, 3, 55, 33]),
    (14, &[1, 3, 1, 15, 31, 13, 49, 245]),
    (21, &[1, 3, 5, 15, 31, 59, 63, 97]),
    (22, &[1, 3, 1, 11, 11, 11, 77, 249]),
    (38, &[1, 3, 1, 11, 27, 43, 71, 9]),
    (47, &[1, 1, 7, 15, 21, 11, 81, 45]),
    (49, &[1, 3, 7, 3, 25, 31, 65, 79]),
    (50, &[1, 3, 1, 1, 19, 11, 3, 205]),
    (52, &[1, 1, 5, 9, 19, 21, 29, 157]),
    (56, &[1, 3, 7, 11, 1, 33, 89, 185]),
    (67, &[1, 3, 3, 3, 15, 9, 79, 71]),
    (70, &[1, 3, 7, 11, 15, 39, 119, 27]),
    (84, &[1, 1, 3, 1, 11, 31, 97, 225]),
    (97, &[1, 1, 1, 3, 23, 43, 57, 177]),
    (103, &[1, 3, 7, 7, 17, 17, 37, 71]),
    (115, &[1, 3, 1, 5, 27, 63, 123, 213]),
    (122, &[1, 1, 3, 5, 11, 43, 53, 133]),
    (8, &[1, 3, 5, 5, 29, 17, 47, 173, 479]),
    (13, &[1, 3, 3, 11, 3, 1, 109, 9, 69]),
    (16, &[1, 1, 1, 5, 17, 39, 23, 5, 343]),
    (22, &[1, 3, 1, 5, 25, 15, 31, 103, 499]),
    (25, &[1, 1, 1, 11, 11, 17, 63, 105, 183]),
    (44, &[1, 1, 5, 11, 9, 29, 97, 231, 363]),
    (47, &[1, 1, 5, 15, 19, 45, 41, 7, 383]),
    (52, &[1, 3, 7, 7, 31, 19, 83, 137, 221]),
    (55, &[1, 1, 1, 3, 23, 15, 111, 223, 83]),
    (59, &[1, 1, 5, 13, 31, 15, 55, 25, 161]),
    (62, &[1, 1, 3, 13, 25, 47, 39, 87, 257]),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(serde::Deserialize)]
    struct Fixture {
        index: Vec<u32>,
        points: Vec<Vec<f64>>,
    }

    /// `scipy.stats.qmc.Sobol(64, scramble=False, bits=32)`, by `tests/data/sobol_scipy.py`.
    #[test]
    fn points_are_scipys_in_every_dimension() {
        let text = include_str!("../../../tests/data/sobol_scipy.json");
        let fixture: Fixture = serde_json::from_str(text).expect("the fixture parses");
        let sobol = Sobol::new(MAX_DIMENSIONS);
        for (&index, point) in fixture.index.iter().zip(&fixture.points) {
            assert_eq!(point.len(), MAX_DIMENSIONS);
            for (dimension, &expected) in point.iter().enumerate() {
                let found = f64::from(sobol.coordinate(index, dimension)) / 2f64.powi(32);
                assert_eq!(found, expected, "point {index}, dimension {dimension}");
            }
        }
    }
}

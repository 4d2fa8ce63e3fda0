//! ChArUco boards: a chessboard with a marker of a dictionary in each white square.
//!
//! The layout is OpenCV's since 4.6: the top left square is black, markers are numbered row by row from 0, corners between four
//! squares likewise. The frame of a board has its origin at the board's top left corner, x to the right, y down, z into the
//! board; lengths in metres.

use calib_targets_charuco::{
    CharucoBoard, CharucoBoardError, CharucoBoardSpec, Dictionary, resolve_dictionary,
};
use nalgebra::{Point2, Point3};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Most squares along a side.
const MAX_SQUARES: u32 = 100;
/// Smallest and largest edge of a square (m).
const EDGES: [f64; 2] = [1e-3, 1.0];

/// What a board is, as files say it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoardSpec {
    /// Columns and rows of squares.
    pub squares: [u32; 2],
    /// Edge of a square (m), measured on the print.
    pub square: f64,
    /// Edge of a marker with its black border (m).
    pub marker: f64,
    /// Dictionary of the markers by OpenCV's name, such as `DICT_4X4_50`.
    pub dictionary: String,
}

/// Why there is no such board.
#[derive(Debug, Error, PartialEq)]
pub enum BoardError {
    /// Too few squares for four corners, or too many.
    #[error("squares = {found:?}; expected columns and rows, 3 to {MAX_SQUARES} each")]
    Squares {
        /// What was asked for.
        found: [u32; 2],
    },
    /// No length of a square.
    #[error("square = {found}; expected the edge of a square, {} to {} m", EDGES[0], EDGES[1])]
    Square {
        /// What was asked for (m).
        found: f64,
    },
    /// Markers that do not fit.
    #[error(
        "marker = {found}; expected the edge of a marker, above 0 and below the square's {square} m"
    )]
    Marker {
        /// What was asked for (m).
        found: f64,
        /// Edge of a square (m).
        square: f64,
    },
    /// No such dictionary.
    #[error(
        "dictionary = {found:?} is not known; expected one of OpenCV's, such as \"DICT_4X4_50\" or \"DICT_APRILTAG_36h11\""
    )]
    Dictionary {
        /// What was asked for.
        found: String,
    },
    /// The board needs more markers than there are.
    #[error(
        "the board has {needed} markers and {dictionary} only {available}; expected a larger dictionary, or fewer squares"
    )]
    Markers {
        /// Markers on the board.
        needed: usize,
        /// Markers of the dictionary.
        available: usize,
        /// Its name.
        dictionary: String,
    },
}

/// A board that exists.
#[derive(Clone, Debug)]
pub struct Board {
    spec: BoardSpec,
    dictionary: Dictionary,
    /// The same for the detector, in squares.
    layout: CharucoBoard,
}

impl Board {
    /// The board of a description.
    ///
    /// # Errors
    /// [`BoardError`] where it contradicts itself.
    pub fn new(spec: BoardSpec) -> Result<Self, BoardError> {
        let found = spec.squares;
        if !found.iter().all(|side| (3..=MAX_SQUARES).contains(side)) {
            return Err(BoardError::Squares { found });
        }
        let square = spec.square;
        if !(EDGES[0]..=EDGES[1]).contains(&square) {
            return Err(BoardError::Square { found: square });
        }
        let marker = spec.marker;
        // Neighbouring black squares and markers that touch would be one.
        if !(marker > 0.0 && marker < square) {
            return Err(BoardError::Marker {
                found: marker,
                square,
            });
        }
        let dictionary =
            resolve_dictionary(&spec.dictionary).ok_or_else(|| BoardError::Dictionary {
                found: spec.dictionary.clone(),
            })?;
        let [columns, rows] = spec.squares;
        let relative = (marker / square) as f32;
        let layout = CharucoBoardSpec::new(rows, columns, 1.0, relative, dictionary);
        let layout = CharucoBoard::new(layout).map_err(|error| match error {
            CharucoBoardError::NotEnoughDictionaryCodes { needed, available } => {
                BoardError::Markers {
                    needed,
                    available,
                    dictionary: spec.dictionary.clone(),
                }
            }
            // A size that is 0 as f32; the others were refused above.
            _ => BoardError::Marker {
                found: marker,
                square,
            },
        })?;
        Ok(Self {
            spec,
            dictionary,
            layout,
        })
    }

    /// Its description.
    pub fn spec(&self) -> &BoardSpec {
        &self.spec
    }

    /// For the detector.
    pub(super) fn layout(&self) -> CharucoBoardSpec {
        self.layout.spec()
    }

    /// Width and height (m).
    pub fn size(&self) -> [f64; 2] {
        self.spec
            .squares
            .map(|side| f64::from(side) * self.spec.square)
    }

    /// Number of corners between four squares.
    pub fn corners(&self) -> u32 {
        let [columns, rows] = self.spec.squares;
        (columns - 1) * (rows - 1)
    }

    /// Where corner `id` is (m, the board's frame); `None` where there is no such corner.
    pub fn corner(&self, id: u32) -> Option<Point3<f64>> {
        let across = self.spec.squares[0] - 1;
        (id < self.corners()).then(|| {
            let [column, row] = [id % across, id / across].map(|k| f64::from(k + 1));
            Point3::new(column * self.spec.square, row * self.spec.square, 0.0)
        })
    }

    /// Whether the board is black at a point of its plane (m, its frame). All around it is white.
    pub fn is_black(&self, point: Point2<f64>) -> bool {
        let [x, y] = [point.x, point.y].map(|c| c / self.spec.square);
        let [columns, rows] = self.spec.squares;
        // NaN is outside.
        if !(x >= 0.0 && y >= 0.0 && x < f64::from(columns) && y < f64::from(rows)) {
            return false;
        }
        let [column, row] = [x, y].map(|c| c as u32);
        match self.marker_in(column, row) {
            None => true,
            Some(id) => self.marker_is_black(id, x.fract(), y.fract()),
        }
    }

    /// Number of the marker in a square; `None` in a black one.
    pub(super) fn marker_in(&self, column: u32, row: u32) -> Option<usize> {
        // Every second square is white, also across the ends of rows where their number is odd. Where it is even, rows begin
        // with black and white by turns, which the division rounds off.
        let before = row * self.spec.squares[0] + column;
        ((column + row) % 2 == 1).then_some((before / 2) as usize)
    }

    /// Cells along a marker's edge, border included.
    pub(super) fn marker_cells(&self) -> usize {
        self.dictionary.marker_size() + 2
    }

    /// Whether cell (column, row) of a marker is black; the outermost ring is its border.
    pub(super) fn cell_is_black(&self, id: usize, [column, row]: [usize; 2]) -> bool {
        let bits = self.dictionary.marker_size();
        let inside = |cell: usize| (1..=bits).contains(&cell);
        if !(inside(column) && inside(row)) {
            return true;
        }
        let code = self.dictionary.codes()[id];
        (code >> ((row - 1) * bits + column - 1)) & 1 == 1
    }

    /// The same at a place of its square, 0 to 1 each way.
    fn marker_is_black(&self, id: usize, x: f64, y: f64) -> bool {
        let edge = self.spec.marker / self.spec.square;
        let cells = self.marker_cells();
        let along = |c: f64| (c - (1.0 - edge) / 2.0) / edge * cells as f64;
        let [x, y] = [x, y].map(along);
        let inside = |c: f64| (0.0..cells as f64).contains(&c);
        inside(x) && inside(y) && self.cell_is_black(id, [x as usize, y as usize])
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;

    fn spec() -> BoardSpec {
        BoardSpec {
            squares: [5, 4],
            square: 0.03,
            marker: 0.0225,
            dictionary: "DICT_4X4_50".into(),
        }
    }

    /// Samples of what OpenCV 5.0's `CharucoBoard((5, 4), 0.03, 0.0225, DICT_4X4_50).generateImage` draws: three squares of the
    /// second row, eight samples along an edge, of which the six in the middle are the marker's cells.
    #[test]
    fn the_board_is_the_one_that_opencv_draws() {
        let opencv = [
            "........########........",
            ".######.########.######.",
            ".###..#.########.#.##.#.",
            ".###..#.########.#.##.#.",
            ".###.##.########.##.###.",
            ".#..#.#.########.##..##.",
            ".######.########.######.",
            "........########........",
        ];
        let board = Board::new(spec()).unwrap();
        let along = |k: usize| (k as f64 + 0.5) / 8.0 * 0.03;
        for (row, expected) in opencv.iter().enumerate() {
            let black = |column| board.is_black(Point2::new(along(column), 0.03 + along(row)));
            let drawn: String = (0..24).map(|c| if black(c) { '#' } else { '.' }).collect();
            assert_eq!(&drawn, expected, "row {row}");
        }
    }

    #[test]
    fn markers_are_numbered_row_by_row() {
        for columns in [3, 4, 5, 8] {
            let board = Board::new(BoardSpec {
                squares: [columns, 5],
                ..spec()
            })
            .unwrap();
            let squares = (0..5).flat_map(|row| (0..columns).map(move |column| (column, row)));
            let numbers: Vec<usize> = squares.filter_map(|(c, r)| board.marker_in(c, r)).collect();
            assert_eq!(numbers, (0..numbers.len()).collect::<Vec<_>>());
            assert_eq!(numbers.len(), board.layout.marker_count());
        }
    }

    #[test]
    fn boards_that_cannot_be_are_refused_with_what_would_be_right() {
        let refused = |change: &dyn Fn(&mut BoardSpec)| {
            let mut spec = spec();
            change(&mut spec);
            Board::new(spec).unwrap_err().to_string()
        };
        let said = refused(&|s| s.squares = [2, 9]);
        assert!(said.contains("[2, 9]; expected columns and rows, 3 to 100"));
        assert!(refused(&|s| s.square = f64::NAN).starts_with("square = NaN"));
        assert!(refused(&|s| s.marker = 0.03).contains("below the square's 0.03 m"));
        assert!(refused(&|s| s.dictionary = "ABC".into()).contains("\"DICT_4X4_50\""));
        let said = refused(&|s| s.squares = [11, 10]);
        assert!(said.starts_with("the board has 55 markers and DICT_4X4_50 only 50"));
    }

    #[test]
    fn corners_are_numbered_row_by_row() {
        let board = Board::new(spec()).unwrap();
        assert_eq!(board.corner(5), Some(Point3::new(0.06, 0.06, 0.0)));
        assert_eq!((board.corner(11).is_some(), board.corner(12)), (true, None));
    }
}

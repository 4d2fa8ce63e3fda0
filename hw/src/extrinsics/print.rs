//! Boards to print.

use std::fmt::Write;

use nalgebra::Point2;
use png::{BitDepth, ColorType, Compression, Encoder, EncodingError, PixelDimensions, Unit};

use super::board::Board;

/// White paper around a printed board, in squares.
const MARGIN: f64 = 0.5;
/// Pixels per metre of a printed image: 600 dots per inch, of 42 µm.
const DENSITY: u32 = 23_622;
/// Largest edge of an image (pixels): 1.4 m of paper.
const LARGEST: f64 = 32_768.0;

/// Why a board is not an image.
#[derive(Debug, thiserror::Error)]
pub enum PrintError {
    /// Too large at the density of prints.
    #[error("the board is {:.2} m x {:.2} m: too large for an image of 600 dots per inch; expected up to 1.38 m, or an SVG", size[0], size[1])]
    TooLarge {
        /// With its margin (m).
        size: [f64; 2],
    },
    /// The image cannot be encoded.
    #[error(transparent)]
    Png(#[from] EncodingError),
}

impl Board {
    /// The board with its white margin as an SVG of its true size.
    pub fn to_svg(&self) -> String {
        let spec = self.spec();
        let [width, height] = self.printed_size().map(|side| (1e6 * side).round() / 1e3);
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}mm\" height=\"{height}mm\" viewBox=\"0 0 {width} \
             {height}\" shape-rendering=\"crispEdges\">\n<rect width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>\n<path \
             fill=\"#000\" d=\""
        );
        let mut rectangle = |x: f64, y: f64, edge: f64| {
            // Thousandths of a millimetre. Writing to a string cannot fail.
            let _ = write!(svg, "M{x:.3} {y:.3}h{edge:.3}v{edge:.3}h-{edge:.3}z");
        };
        let square = 1e3 * spec.square;
        let cells = self.marker_cells();
        let cell = 1e3 * spec.marker / cells as f64;
        for row in 0..spec.squares[1] {
            for column in 0..spec.squares[0] {
                let [x, y] = [column, row].map(|k| (f64::from(k) + MARGIN) * square);
                let Some(id) = self.marker_in(column, row) else {
                    rectangle(x, y, square);
                    continue;
                };
                let inset = (square - 1e3 * spec.marker) / 2.0;
                for (i, j) in (0..cells).flat_map(|j| (0..cells).map(move |i| (i, j))) {
                    if self.cell_is_black(id, [i, j]) {
                        let at = |start: f64, k: usize| start + inset + cell * k as f64;
                        rectangle(at(x, i), at(y, j), cell);
                    }
                }
            }
        }
        svg + "\"/>\n</svg>\n"
    }

    /// The board with its white margin as a PNG of 600 dots per inch that says so.
    ///
    /// # Errors
    /// [`PrintError`] where the board is larger than 1.4 m.
    pub fn to_png(&self) -> Result<Vec<u8>, PrintError> {
        let size = self.printed_size();
        let pixels = size.map(|side| (side * f64::from(DENSITY)).round());
        if pixels.iter().any(|side| *side > LARGEST) {
            return Err(PrintError::TooLarge { size });
        }
        let [width, height] = pixels.map(|side| side as u32);
        let margin = MARGIN * self.spec().square;
        let metres = |pixel: u32| (f64::from(pixel) + 0.5) / f64::from(DENSITY) - margin;
        // One bit a pixel, 1 for white, rows of whole bytes.
        let stride = (width as usize).div_ceil(8);
        let mut bits = vec![0xff; stride * height as usize];
        for row in 0..height {
            let line = &mut bits[row as usize * stride..][..stride];
            for column in 0..width {
                if self.is_black(Point2::new(metres(column), metres(row))) {
                    line[column as usize / 8] &= !(0x80 >> (column % 8));
                }
            }
        }
        let mut bytes = Vec::new();
        let mut encoder = Encoder::new(&mut bytes, width, height);
        encoder.set_color(ColorType::Grayscale);
        encoder.set_depth(BitDepth::One);
        encoder.set_compression(Compression::Balanced);
        encoder.set_pixel_dims(Some(PixelDimensions {
            xppu: DENSITY,
            yppu: DENSITY,
            unit: Unit::Meter,
        }));
        encoder.write_header()?.write_image_data(&bits)?;
        Ok(bytes)
    }

    /// Width and height with the margin (m).
    fn printed_size(&self) -> [f64; 2] {
        self.size()
            .map(|side| side + 2.0 * MARGIN * self.spec().square)
    }
}

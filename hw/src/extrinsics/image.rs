//! Grey images.

use std::io::{BufRead, Seek};

use png::{ColorType, DecodingError, Transformations};
use tdcr_sim::render::RgbdFrame;

/// An 8-bit grey image, row by row. Pixel centres are at integer coordinates.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GreyImage {
    size: [u32; 2],
    pixels: Vec<u8>,
}

impl GreyImage {
    /// An image of a width and a height; `None` where these are not as many pixels.
    pub fn new(size: [u32; 2], pixels: Vec<u8>) -> Option<Self> {
        (size[0] as usize * size[1] as usize == pixels.len()).then_some(Self { size, pixels })
    }

    /// The luma (ITU-R BT.601) of a picture.
    pub fn of_frame(frame: &RgbdFrame) -> Self {
        let intrinsics = &frame.camera.intrinsics;
        Self {
            size: [intrinsics.width, intrinsics.height],
            pixels: frame.color.iter().map(|rgb| luma(*rgb)).collect(),
        }
    }

    /// Reads a PNG of any colour type, which must be of this width and height.
    ///
    /// # Errors
    /// [`PngError`] where it is damaged or of another size.
    pub fn read_png(file: impl BufRead + Seek, expected: [u32; 2]) -> Result<Self, PngError> {
        let mut decoder = png::Decoder::new(file);
        decoder.set_transformations(Transformations::normalize_to_color8());
        let mut reader = decoder.read_info()?;
        let found = [reader.info().width, reader.info().height];
        // Before the pixels are read: a header may ask for any amount of memory.
        if found != expected {
            return Err(PngError::Size { found, expected });
        }
        let mut bytes = vec![0; reader.output_buffer_size().unwrap_or_default()];
        let info = reader.next_frame(&mut bytes)?;
        bytes.truncate(info.buffer_size());
        let pixels = match info.color_type {
            ColorType::Rgb => rgb_to_luma::<3>(&bytes),
            ColorType::Rgba => rgb_to_luma::<4>(&bytes),
            ColorType::GrayscaleAlpha => bytes.chunks_exact(2).map(|pixel| pixel[0]).collect(),
            // `normalize_to_color8` turns palettes into colours.
            ColorType::Grayscale | ColorType::Indexed => bytes,
        };
        Self::new(found, pixels).ok_or(PngError::Size { found, expected })
    }

    /// The image twice as large, bilinearly: pixel (u, v) of it is at ((u - 0.5) / 2, (v - 0.5) / 2) of this one.
    pub(super) fn doubled(&self) -> Self {
        let [width, height] = self.size.map(|side| side as usize);
        // The two nearest pixels of the line, the nearer one three times as heavy.
        let near = |at: usize, side: usize| {
            let other = if at.is_multiple_of(2) {
                (at / 2).saturating_sub(1)
            } else {
                (at / 2 + 1).min(side - 1)
            };
            [at / 2, other]
        };
        let mut pixels = Vec::with_capacity(4 * self.pixels.len());
        for v in 0..2 * height {
            let [row, other_row] = near(v, height).map(|row| &self.pixels[row * width..][..width]);
            for u in 0..2 * width {
                let [column, other] = near(u, width);
                let along = |row: &[u8]| 3 * u32::from(row[column]) + u32::from(row[other]);
                pixels.push(((3 * along(row) + along(other_row) + 8) / 16) as u8);
            }
        }
        Self {
            size: self.size.map(|side| 2 * side),
            pixels,
        }
    }

    /// Width and height.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Greys, row by row.
    pub fn pixels(&self) -> &[u8] {
        &self.pixels
    }
}

/// Why a PNG is not the image that is wanted.
#[derive(Debug, thiserror::Error)]
pub enum PngError {
    /// Not a PNG, or damaged.
    #[error("{0}")]
    Png(#[from] DecodingError),
    /// Of another camera, or resized.
    #[error("the image has {} x {} pixels; the camera's have {} x {}", found[0], found[1], expected[0], expected[1])]
    Size {
        /// Its width and height.
        found: [u32; 2],
        /// The camera's.
        expected: [u32; 2],
    },
}

fn luma([r, g, b]: [u8; 3]) -> u8 {
    let [r, g, b] = [r, g, b].map(u32::from);
    ((299 * r + 587 * g + 114 * b + 500) / 1000) as u8
}

fn rgb_to_luma<const CHANNELS: usize>(bytes: &[u8]) -> Vec<u8> {
    let pixels = bytes.chunks_exact(CHANNELS);
    pixels
        .map(|pixel| luma([pixel[0], pixel[1], pixel[2]]))
        .collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;
    use png::BitDepth;
    use std::io::Cursor;

    fn encoded(color: ColorType, depth: BitDepth, data: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 2, 1);
        encoder.set_color(color);
        encoder.set_depth(depth);
        if color == ColorType::Indexed {
            encoder.set_palette(vec![10, 10, 10, 200, 200, 200]);
        }
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(data).unwrap();
        drop(writer);
        bytes
    }

    #[test]
    fn images_of_all_colour_types_are_read_as_greys() {
        let cases: [(ColorType, BitDepth, &[u8]); 7] = [
            (ColorType::Grayscale, BitDepth::Eight, &[10, 200]),
            (ColorType::Grayscale, BitDepth::Sixteen, &[10, 7, 200, 7]),
            (ColorType::GrayscaleAlpha, BitDepth::Eight, &[10, 0, 200, 9]),
            (
                ColorType::Rgb,
                BitDepth::Eight,
                &[10, 10, 10, 200, 200, 200],
            ),
            (
                ColorType::Rgba,
                BitDepth::Eight,
                &[10, 10, 10, 1, 200, 200, 200, 1],
            ),
            (ColorType::Indexed, BitDepth::Eight, &[0, 1]),
            (ColorType::Indexed, BitDepth::One, &[0b0100_0000]),
        ];
        for (color, depth, data) in cases {
            let image = GreyImage::read_png(Cursor::new(encoded(color, depth, data)), [2, 1]);
            assert_eq!(image.unwrap().pixels(), [10, 200], "{color:?} {depth:?}");
        }
        assert_eq!(
            [[255, 0, 0], [0, 255, 0], [0, 0, 255]].map(luma),
            [76, 150, 29]
        );
    }

    #[test]
    fn damaged_images_and_others_sizes_are_refused() {
        let bytes = encoded(ColorType::Grayscale, BitDepth::Eight, &[10, 200]);
        let said = |bytes: &[u8], size| {
            let read = GreyImage::read_png(Cursor::new(bytes), size);
            read.unwrap_err().to_string()
        };
        assert_eq!(
            said(&bytes, [1, 2]),
            "the image has 2 x 1 pixels; the camera's have 1 x 2"
        );
        for end in 0..bytes.len() - 12 {
            assert!(!said(&bytes[..end], [2, 1]).is_empty());
        }
    }
}

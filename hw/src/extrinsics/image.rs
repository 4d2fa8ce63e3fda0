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

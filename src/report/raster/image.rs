//! Pictures of pixels.

/// An 8-bit RGB image, row-major from the top left.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Image {
    pub width: usize,
    pub height: usize,
    /// `3 * width * height` bytes.
    pub rgb: Vec<u8>,
}

impl Image {
    /// A white image; both sides are at least one pixel.
    pub fn white(width: usize, height: usize) -> Self {
        let (width, height) = (width.max(1), height.max(1));
        Self {
            width,
            height,
            rgb: vec![255; 3 * width * height],
        }
    }

    /// Copies `other` with its top left corner at `(x, y)`; what falls outside is dropped.
    pub fn paste(&mut self, other: &Image, x: usize, y: usize) {
        if x >= self.width {
            return;
        }
        let columns = other.width.min(self.width - x);
        for row in 0..other.height.min(self.height.saturating_sub(y)) {
            let from = 3 * row * other.width;
            let to = 3 * ((y + row) * self.width + x);
            self.rgb[to..to + 3 * columns].copy_from_slice(&other.rgb[from..from + 3 * columns]);
        }
    }

    /// Encodes the image as PNG.
    pub fn to_png(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::High);
        // Areas of few colours compress best without a filter.
        encoder.set_filter(png::Filter::NoFilter);
        encoder
            .write_header()
            .and_then(|mut writer| writer.write_image_data(&self.rgb))
            .expect("an image of at least one pixel encodes into memory");
        bytes
    }
}

//! Pixels of images as the bytes that a log holds, without loss.

use std::io::Cursor;

use png::{BitDepth, ColorType, Compression, Decoder, Encoder, Limits};

use super::error::DecodeError;
use super::record::Image;

/// How colour images are logged. Either way they come back as they were.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ImageFormat {
    /// A third to a half of the bytes, for some milliseconds a picture.
    #[default]
    Png,
    /// As they are.
    Raw,
}

/// Most pixels of an image that is read from a log: a compressed one may claim more than memory holds.
const MOST_PIXELS: u64 = 1 << 24;

/// Encoding of depths in whole millimetres, 16 bits each.
pub(super) const MILLIMETRES: &str = "16UC1";
/// Encoding of depths as floating-point metres.
pub(super) const METRES: &str = "32FC1";
/// Encoding of colours.
pub(super) const RGB: &str = "rgb8";

/// Depths as millimetres where that loses nothing, as for cameras that measure in them; else as they are.
pub(super) fn depth_bytes(depths: &[f32]) -> (&'static str, Vec<u8>) {
    let millimetres: Option<Vec<u8>> = depths
        .iter()
        .map(|depth| {
            let rounded = (depth * 1000.0).round();
            let fits = (0.0..=f32::from(u16::MAX)).contains(&rounded);
            let millimetres = rounded as u16;
            // Bits, as of two zeros one is lost.
            (fits && metres(millimetres).to_bits() == depth.to_bits())
                .then(|| millimetres.to_le_bytes())
        })
        .collect::<Option<Vec<_>>>()
        .map(|all| all.concat());
    match millimetres {
        Some(bytes) => (MILLIMETRES, bytes),
        None => (
            METRES,
            depths
                .iter()
                .flat_map(|depth| depth.to_le_bytes())
                .collect(),
        ),
    }
}

/// Metres as cameras give them that count millimetres: in single precision.
fn metres(millimetres: u16) -> f32 {
    f32::from(millimetres) * 0.001
}

/// Depths (m) from the bytes of an encoding.
pub(super) fn depths(encoding: &str, bytes: &[u8]) -> Option<Vec<f32>> {
    match encoding {
        MILLIMETRES => {
            let (pairs, []) = bytes.as_chunks::<2>() else {
                return None;
            };
            Some((pairs.iter().map(|&b| metres(u16::from_le_bytes(b)))).collect())
        }
        METRES => {
            let (words, []) = bytes.as_chunks::<4>() else {
                return None;
            };
            Some(words.iter().map(|&b| f32::from_le_bytes(b)).collect())
        }
        _ => None,
    }
}

/// An image, if there are as many pixels as it should have.
pub(super) fn image<P>(width: u32, height: u32, pixels: Vec<P>) -> Result<Image<P>, DecodeError> {
    let expected = u64::from(width) * u64::from(height);
    if pixels.len() as u64 != expected {
        return Err(DecodeError::Field {
            field: "data",
            found: format!("{} pixels", pixels.len()),
            expected: "as many as width and height say",
        });
    }
    Ok(Image {
        width,
        height,
        pixels,
    })
}

/// A colour image as a PNG file.
pub(super) fn write_png(image: &Image<[u8; 3]>) -> Result<Vec<u8>, png::EncodingError> {
    let mut file = Vec::new();
    let mut encoder = Encoder::new(&mut file, image.width, image.height);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(Compression::Fast);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(image.pixels.as_flattened())?;
    writer.finish()?;
    Ok(file)
}

fn bad(found: String) -> DecodeError {
    DecodeError::Field {
        field: "data",
        found,
        expected: "a PNG file of 8-bit RGB, of at most 16 million pixels",
    }
}

/// Refuses what does not begin as a PNG file of 8-bit RGB.
pub(super) fn check_png(file: &[u8]) -> Result<(), DecodeError> {
    open_png(file).map(drop)
}

/// A decoder of a PNG file of 8-bit RGB that has read what stands before its pixels.
fn open_png(file: &[u8]) -> Result<png::Reader<Cursor<&[u8]>>, DecodeError> {
    let mut decoder = Decoder::new(Cursor::new(file));
    decoder.set_limits(Limits {
        bytes: 4 * MOST_PIXELS as usize,
    });
    let reader = decoder.read_info().map_err(|e| bad(e.to_string()))?;
    let info = reader.info();
    let (width, height) = (info.width, info.height);
    if (info.color_type, info.bit_depth) != (ColorType::Rgb, BitDepth::Eight) {
        let found = format!("a PNG file of {:?} {:?}", info.bit_depth, info.color_type);
        return Err(bad(found));
    }
    if u64::from(width) * u64::from(height) > MOST_PIXELS {
        return Err(bad(format!("a PNG file of {width} x {height} pixels")));
    }
    Ok(reader)
}

/// A colour image from a PNG file of 8-bit RGB.
pub(super) fn read_png(file: &[u8]) -> Result<Image<[u8; 3]>, DecodeError> {
    let mut reader = open_png(file)?;
    let (width, height) = (reader.info().width, reader.info().height);
    let mut bytes = vec![0; 3 * width as usize * height as usize];
    reader
        .next_frame(&mut bytes)
        .map_err(|e| bad(e.to_string()))?;
    let (pixels, _) = bytes.as_chunks::<3>();
    image(width, height, pixels.to_vec())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;

    #[test]
    fn depths_come_back_bit_for_bit() {
        let millimetres: Vec<f32> = (0..=u16::MAX).map(metres).collect();
        let (encoding, bytes) = depth_bytes(&millimetres);
        assert_eq!(encoding, MILLIMETRES);
        assert_eq!(depths(encoding, &bytes), Some(millimetres));
        for odd in [0.12345, -0.0, -0.001, f32::NAN, f32::INFINITY, 65.536] {
            let (encoding, bytes) = depth_bytes(&[0.0, odd]);
            assert_eq!(encoding, METRES, "{odd}");
            let back = depths(encoding, &bytes).unwrap();
            assert_eq!(back[1].to_bits(), odd.to_bits());
        }
        assert_eq!(depths(MILLIMETRES, &[0; 3]), None);
        assert_eq!(depths("8UC1", &[0; 4]), None);
    }

    #[test]
    fn a_picture_that_claims_more_than_it_holds_is_refused() {
        let small = Image {
            width: 2,
            height: 1,
            pixels: vec![[1, 2, 3], [250, 0, 9]],
        };
        let file = write_png(&small).unwrap();
        assert_eq!(read_png(&file).unwrap(), small);
        let mut claims = Vec::new();
        let encoder = Encoder::new(&mut claims, 100_000, 100_000);
        drop(encoder.write_header().unwrap());
        assert!(read_png(&claims).is_err());
        assert!(image(1 << 31, 1 << 31, vec![0.0]).is_err());
    }
}

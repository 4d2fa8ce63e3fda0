//! Images in files.

use anyhow::Context;

/// A PNG of 8-bit colours, row by row, of a width and a height.
pub(super) fn rgb_png(size: [u32; 2], rgb: &[u8]) -> anyhow::Result<Vec<u8>> {
    png(size, png::ColorType::Rgb, png::BitDepth::Eight, rgb)
}

/// A PNG of 16-bit greys, row by row, of a width and a height.
pub(super) fn grey_png(
    size: [u32; 2],
    values: impl Iterator<Item = u16>,
) -> anyhow::Result<Vec<u8>> {
    let bytes: Vec<u8> = values.flat_map(u16::to_be_bytes).collect();
    png(
        size,
        png::ColorType::Grayscale,
        png::BitDepth::Sixteen,
        &bytes,
    )
}

fn png(
    [width, height]: [u32; 2],
    color: png::ColorType,
    depth: png::BitDepth,
    data: &[u8],
) -> anyhow::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(color);
    encoder.set_depth(depth);
    (encoder.write_header())
        .and_then(|mut writer| writer.write_image_data(data))
        .context("cannot encode a PNG")?;
    Ok(bytes)
}

/// NumPy's array file, format 1.0: `height` rows of `width` 32-bit floats.
pub(super) fn npy([width, height]: [u32; 2], values: &[f32]) -> Vec<u8> {
    const MAGIC: &[u8] = b"\x93NUMPY\x01\x00";
    let mut header =
        format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({height}, {width}), }}");
    // Data begin at a multiple of 64 bytes, after a newline.
    let length = (MAGIC.len() + 2 + header.len() + 1).next_multiple_of(64) - MAGIC.len() - 2;
    header.extend(std::iter::repeat_n(' ', length - header.len() - 1));
    header.push('\n');
    let mut bytes = MAGIC.to_vec();
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(header.bytes());
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    bytes
}

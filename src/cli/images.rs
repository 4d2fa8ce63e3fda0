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

//! Masks that another program has written.

use std::fs;
use std::io::{self, Cursor};
use std::path::{Path, PathBuf};

use png::{BitDepth, ColorType, Transformations};
use tdcr_base::files;
use tdcr_sim::render::RgbdFrame;

use super::{Mask, MaskError, Masker, Shot};

/// Largest file of a mask (bytes): 8192 x 8192 pixels that cannot be compressed.
const LARGEST: u64 = 64 << 20;

/// A folder with an image for each camera and sample, `camera0/000000.png` for the first of each: PNG of 8 bits, grey or of
/// indexed colours, 0 where the robot is not. `examples/python/masks_sam2.py` writes such folders.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MaskFolder {
    folder: PathBuf,
}

impl MaskFolder {
    /// Masks of this folder.
    pub fn new(folder: impl Into<PathBuf>) -> Self {
        Self {
            folder: folder.into(),
        }
    }

    /// The file of a mask.
    pub fn path(&self, shot: Shot) -> PathBuf {
        let Shot { view, sample } = shot;
        self.folder
            .join(format!("camera{view}"))
            .join(format!("{sample:06}.png"))
    }

    /// Makes sure that there is a file for each of these samples and so many views, without reading them.
    ///
    /// # Errors
    /// [`MaskError::Read`] for the first that is missing.
    pub fn must_have(
        &self,
        views: usize,
        samples: impl IntoIterator<Item = usize>,
    ) -> Result<(), MaskError> {
        let shots = samples.into_iter();
        let mut shots = shots.flat_map(|sample| (0..views).map(move |view| Shot { view, sample }));
        shots.try_for_each(|shot| {
            let path = self.path(shot);
            let found = fs::metadata(&path);
            found.map(drop).map_err(|source| MaskError::Read {
                view: shot.view,
                sample: shot.sample,
                path,
                source,
            })
        })
    }

    /// Writes a mask to its file.
    ///
    /// # Errors
    /// The system's.
    pub fn write(&self, mask: &Mask, shot: Shot) -> io::Result<()> {
        let path = self.path(shot);
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder)?;
        }
        let [width, height] = mask.size();
        let pixels: Vec<u8> = mask
            .pixels()
            .iter()
            .map(|shown| 255 * u8::from(*shown))
            .collect();
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width, height);
        encoder.set_color(ColorType::Grayscale);
        encoder.set_depth(BitDepth::Eight);
        let mut writer = encoder.write_header().map_err(io::Error::other)?;
        writer.write_image_data(&pixels).map_err(io::Error::other)?;
        writer.finish().map_err(io::Error::other)?;
        files::write_atomically(&path, |file| io::Write::write_all(file, &bytes))
    }
}

/// Decodes an image of which all that is not 0 shows the robot.
fn decode(bytes: &[u8], path: &Path) -> Result<Mask, MaskError> {
    let refuse = |what: String| MaskError::Image {
        path: path.to_owned(),
        what,
    };
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    // Indexed colours stay indices: 0 is the background in what segmentation programs write.
    decoder.set_transformations(Transformations::IDENTITY);
    let mut reader = decoder
        .read_info()
        .map_err(|error| refuse(error.to_string()))?;
    let (color, depth) = reader.output_color_type();
    let size = [reader.info().width, reader.info().height];
    if !matches!(color, ColorType::Grayscale | ColorType::Indexed) || depth != BitDepth::Eight {
        return Err(refuse(format!(
            "it has {color:?} pixels of {} bits",
            depth as u8
        )));
    }
    let pixels = size[0] as usize * size[1] as usize;
    if reader.output_buffer_size() != Some(pixels) || pixels as u64 > LARGEST {
        return Err(refuse(format!(
            "{} x {} pixels are too many",
            size[0], size[1]
        )));
    }
    let mut image = vec![0; pixels];
    reader
        .next_frame(&mut image)
        .map_err(|error| refuse(error.to_string()))?;
    Ok(Mask::of_size(size, |index| image[index] > 0))
}

impl Masker for MaskFolder {
    fn mask(&self, frame: &RgbdFrame, shot: Shot) -> Result<Mask, MaskError> {
        let path = self.path(shot);
        let bytes = files::read(&path, LARGEST).map_err(|source| MaskError::Read {
            view: shot.view,
            sample: shot.sample,
            path: path.clone(),
            source,
        })?;
        let mask = decode(&bytes, &path)?;
        mask.must_fit(frame, shot.view, &path.display().to_string())?;
        Ok(mask)
    }
}

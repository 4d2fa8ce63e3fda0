//! Pictures one after another, in a file: PNG, animated where there are several, or MP4 by ffmpeg.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Context, bail};

use super::output;

/// Time that a picture is shown (s).
pub(super) const FRAME_TIME: f64 = 0.04;
/// The program that makes videos, looked for on the path.
const FFMPEG: &str = "ffmpeg";

/// Pictures of one size, encoded as they come.
pub(super) enum Film {
    /// A PNG.
    Png(PngFilm),
    /// A video.
    Mp4(Video),
}

impl Film {
    /// A PNG of `count` pictures of a width and a height, for the file `path`.
    pub fn png(path: &Path, size: [u32; 2], count: usize) -> anyhow::Result<Self> {
        Ok(Self::Png(PngFilm::new(path, size, count)?))
    }

    /// A video of pictures of an even width and height in the file `path`.
    pub fn mp4(path: &Path, size: [u32; 2]) -> anyhow::Result<Self> {
        Ok(Self::Mp4(Video::new(path, size)?))
    }

    /// Adds a picture, row by row.
    pub fn add(&mut self, rgb: &[u8]) -> anyhow::Result<()> {
        match self {
            Self::Png(film) => film.add(rgb),
            Self::Mp4(video) => video.add(rgb),
        }
    }

    /// Writes the file, which is whole or keeps what it held.
    pub fn finish(self) -> anyhow::Result<()> {
        match self {
            Self::Png(film) => film.finish(),
            Self::Mp4(video) => video.finish(),
        }
    }
}

/// A PNG of one picture, or an animated one of several.
pub(super) struct PngFilm {
    path: PathBuf,
    bytes: Arc<Mutex<Vec<u8>>>,
    writer: png::Writer<Shared>,
}

/// Bytes that the writer and the film share.
struct Shared(Arc<Mutex<Vec<u8>>>);

impl Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        all.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl PngFilm {
    fn new(path: &Path, [width, height]: [u32; 2], count: usize) -> anyhow::Result<Self> {
        let bytes = Arc::new(Mutex::new(Vec::new()));
        let mut encoder = png::Encoder::new(Shared(bytes.clone()), width, height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        if count > 1 {
            let frames = u32::try_from(count).context("the motion has too many pictures")?;
            encoder
                .set_animated(frames, 0)
                .context("cannot encode a PNG")?;
            let [numerator, denominator] = [(1e3 * FRAME_TIME) as u16, 1000];
            encoder
                .set_frame_delay(numerator, denominator)
                .context("cannot encode a PNG")?;
        }
        let writer = encoder.write_header().context("cannot encode a PNG")?;
        Ok(Self {
            path: path.to_owned(),
            bytes,
            writer,
        })
    }

    fn add(&mut self, rgb: &[u8]) -> anyhow::Result<()> {
        self.writer
            .write_image_data(rgb)
            .context("cannot encode a PNG")
    }

    fn finish(self) -> anyhow::Result<()> {
        self.writer.finish().context("cannot encode a PNG")?;
        let bytes = self.bytes.lock().unwrap_or_else(PoisonError::into_inner);
        output::write(&self.path, &*bytes)
    }
}

/// A video that ffmpeg encodes into a file beside its own, which it takes the place of when it is whole.
pub(super) struct Video {
    path: PathBuf,
    partial: PathBuf,
    ffmpeg: Child,
}

impl Video {
    fn new(path: &Path, [width, height]: [u32; 2]) -> anyhow::Result<Self> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let partial = path.with_file_name(format!(".{}.{name}", std::process::id()));
        let started = Command::new(FFMPEG)
            .args(["-loglevel", "error", "-y", "-f", "rawvideo"])
            .args(["-pixel_format", "rgb24", "-framerate"])
            .arg((1.0 / FRAME_TIME).to_string())
            .args(["-video_size", &format!("{width}x{height}"), "-i", "-"])
            // Players know few videos with other colours than these.
            .args(["-pix_fmt", "yuv420p", "-f", "mp4"])
            .arg(&partial)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .spawn();
        let ffmpeg = match started {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => bail!(
                "a video takes the program {FFMPEG}, which is not on the PATH: install it (https://ffmpeg.org), or choose a .png"
            ),
            started => started.with_context(|| format!("cannot run {FFMPEG}"))?,
        };
        Ok(Self {
            path: path.to_owned(),
            partial,
            ffmpeg,
        })
    }

    fn add(&mut self, rgb: &[u8]) -> anyhow::Result<()> {
        let stdin = self.ffmpeg.stdin.as_mut();
        let stdin = stdin.with_context(|| format!("{FFMPEG} reads no pictures"))?;
        stdin
            .write_all(rgb)
            .with_context(|| format!("{FFMPEG} stopped before the video was whole"))
    }

    fn finish(mut self) -> anyhow::Result<()> {
        // The end of its input.
        drop(self.ffmpeg.stdin.take());
        let status = (self.ffmpeg.wait()).with_context(|| format!("{FFMPEG} does not end"))?;
        if !status.success() {
            bail!("{FFMPEG} could not make {}: {status}", self.path.display());
        }
        std::fs::rename(&self.partial, &self.path)
            .with_context(|| format!("cannot write {}", self.path.display()))
    }
}

/// Leaves neither a process nor half a video.
impl Drop for Video {
    fn drop(&mut self) {
        // Of a process that has ended, and a file that has moved, there is nothing left to stop or remove.
        let _ = self.ffmpeg.kill();
        let _ = self.ffmpeg.wait();
        let _ = std::fs::remove_file(&self.partial);
    }
}

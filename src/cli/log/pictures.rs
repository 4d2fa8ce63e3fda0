//! `tdcr log pictures`.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use serde::Serialize;
use tdcr::hw::recorded::{SamplePictures, Samples};
use tdcr::pipeline::Monitor;
use tdcr::report::counted;

use crate::cli::console::{Console, Interrupted};
use crate::cli::output;

/// Write the colour pictures of a capture's samples as files, for programs that mask them
///
/// DIR gets camera0/000000.png for the first camera of the rig's file and sample 0, and so on: the pictures from which the
/// clouds were made. `tdcr capture --masks` takes masks of the same names.
#[derive(Debug, Args)]
pub(super) struct PicturesArgs {
    /// The log of a capture, an MCAP file; of one that was resumed all its logs, in their order
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
    /// Folder for the pictures
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// What was written.
#[derive(Default, Serialize)]
struct Written {
    /// Samples with a picture.
    samples: usize,
    /// Pictures of each camera's folder.
    pictures: BTreeMap<String, usize>,
    /// Samples of which a picture is lost.
    incomplete: Vec<u64>,
}

pub(super) fn run(args: &PicturesArgs, console: &Console) -> anyhow::Result<()> {
    output::folder("--out", &args.out, "a folder for the pictures")?;
    // Of a sample that was captured again the later pictures are those of its cloud.
    let mut samples = BTreeMap::new();
    for file in &args.files {
        let mut log = Samples::open(file)?;
        while let Some(pictures) = log.next_sample()? {
            if console.interrupted() {
                return Err(Interrupted.into());
            }
            samples.insert(pictures.sample, write(&args.out, &pictures)?);
        }
    }
    if samples.is_empty() {
        let files: Vec<_> = args.files.iter().map(|f| f.display().to_string()).collect();
        bail!(
            "no sample of a capture in {}; expected the log.mcap that `tdcr capture` writes beside its data set",
            files.join(", ")
        );
    }
    let mut written = Written {
        samples: samples.len(),
        ..Written::default()
    };
    for (sample, views) in samples {
        for (view, there) in views.iter().enumerate() {
            *written.pictures.entry(camera(view)).or_default() += usize::from(*there);
        }
        if views.contains(&false) {
            written.incomplete.push(sample);
        }
    }
    console.summary(&written, |written| {
        let cameras = counted(written.pictures.len(), "camera");
        let samples = counted(written.samples, "sample");
        let mut text = format!("{}: {samples} by {cameras}", args.out.display());
        if let Some(first) = written.incomplete.first() {
            let lost = counted(written.incomplete.len(), "sample");
            text += &format!("\nthe log has lost pictures of {lost}, sample {first} first");
        }
        text
    })
}

/// The folder of a camera, by its number.
fn camera(view: usize) -> String {
    format!("camera{view}")
}

/// Writes a sample's pictures; for each camera whether there is one.
fn write(out: &Path, pictures: &SamplePictures) -> anyhow::Result<Vec<bool>> {
    let mut there = Vec::with_capacity(pictures.colors.len());
    for (view, color) in pictures.colors.iter().enumerate() {
        there.push(color.is_some());
        let Some(color) = color else { continue };
        let folder = out.join(camera(view));
        fs::create_dir_all(&folder)
            .with_context(|| format!("cannot make the folder {}", folder.display()))?;
        output::write(&folder.join(format!("{:06}.png", pictures.sample)), color)?;
    }
    Ok(there)
}

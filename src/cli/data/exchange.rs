//! `tdcr data import` and `tdcr data export`.

use std::path::PathBuf;

use anyhow::bail;
use clap::{Args, ValueEnum};
use serde::Serialize;
use tdcr::learn::data::{DataSet, ExportFormat, Finding, ImportSettings, LengthUnit};
use tdcr::pipeline;
use tdcr::report::counted;

use super::Console;
use super::lerobot::{self, EpisodeArgs};
use crate::cli::output;

/// Make a data set from clouds (.ply, .pcd, .npy, .npz) and the motor files {"ctrl": [...]} of the same names
///
/// Interrupted, the same command goes on where it stopped.
#[derive(Debug, Args)]
pub(in crate::cli) struct ImportArgs {
    /// Folder of clouds and motor files
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    /// Folder of the data set
    #[arg(long, value_name = "SET")]
    out: PathBuf,
    /// Unit of the clouds
    #[arg(long, value_enum, default_value_t = Units::M)]
    units: Units,
    /// Points per cloud
    #[arg(long, default_value_t = ImportSettings::default().points, value_name = "N", value_parser = super::super::amount)]
    points: usize,
    /// Edge of the voxels that thin the clouds (m); by default they are not thinned
    #[arg(long, value_name = "M", value_parser = super::super::positive)]
    voxel: Option<f64>,
    /// Which cloud is in which split: a CSV file of lines NAME,SPLIT, a cloud's file and train, val or test [default: 80, 10
    /// and 10 % by chance]
    #[arg(long, value_name = "FILE")]
    split: Option<PathBuf>,
    /// Seed of the points that are kept, and of the splits
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

/// Write the clouds of a data set as files of their own, with their conditions beside them, or episodes for LeRobot
///
/// --format lerobot makes a data set of LeRobot (version 3: Parquet, MP4) of what robots did, an episode each: of captures, logs and
/// files of commands, under which a robot is simulated. Python does it, with the packages tdcr and lerobot (pip install
/// 'tdcr[lerobot]'): python3, or the interpreter that the variable TDCR_PYTHON names.
#[derive(Debug, Args)]
pub(in crate::cli) struct ExportArgs {
    /// Folder of the data set; for lerobot the folders of captures, logs (.mcap), or files of commands (.csv or .json), a row a frame
    #[arg(required = true, value_name = "SOURCE")]
    sources: Vec<PathBuf>,
    /// What to write
    #[arg(long, value_enum)]
    format: Format,
    /// Folder to write
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten, next_help_heading = "Options of --format lerobot")]
    episodes: EpisodeArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Units {
    /// Metres
    M,
    /// Centimetres
    Cm,
    /// Millimetres
    Mm,
}

impl Units {
    fn unit(self) -> LengthUnit {
        match self {
            Self::M => LengthUnit::Metre,
            Self::Cm => LengthUnit::Centimetre,
            Self::Mm => LengthUnit::Millimetre,
        }
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Format {
    /// A cloud a file, binary
    Ply,
    /// A cloud a file, arrays of NumPy
    Npz,
    /// Episodes of a robot that moves
    Lerobot,
}

#[derive(Serialize)]
struct Moved {
    dir: PathBuf,
    clouds: usize,
}

impl Moved {
    fn tell(&self, console: &Console) -> anyhow::Result<()> {
        console.summary(self, |m| {
            format!("{}: {}", m.dir.display(), counted(m.clouds, "cloud"))
        })
    }
}

pub(super) fn import(args: &ImportArgs, console: &Console) -> anyhow::Result<()> {
    output::folder("--out", &args.out, "a folder for the data set")?;
    let settings = ImportSettings {
        unit: args.units.unit(),
        points: args.points,
        voxel_size: args.voxel,
        split: args.split.clone(),
        seed: args.seed,
    };
    let imported = pipeline::import(&args.dir, &args.out, &settings, console)?;
    for note in &imported.notes {
        tracing::warn!("{}: {note}", args.dir.display());
    }
    let dir = args.out.clone();
    let scale = DataSet::open(&dir)?.normalisation().scale;
    if let Some(finding) = Finding::of_scale(scale) {
        tracing::warn!("{}: {finding} (`--units mm`, `--units cm`)", dir.display());
    }
    let clouds = imported.clouds;
    Moved { dir, clouds }.tell(console)
}

pub(super) fn export(args: &ExportArgs, console: &Console) -> anyhow::Result<()> {
    let format = match args.format {
        Format::Ply => ExportFormat::Ply,
        Format::Npz => ExportFormat::Npz,
        Format::Lerobot => {
            output::folder("--out", &args.out, "a folder for the episodes")?;
            return lerobot::export(&args.sources, &args.out, &args.episodes, console);
        }
    };
    if let Some(option) = args.episodes.first() {
        bail!("{option} goes with --format lerobot");
    }
    let [set] = args.sources.as_slice() else {
        let sets = counted(args.sources.len(), "data set");
        bail!("{sets} are given; expected one, whose clouds have the folder for themselves");
    };
    output::folder("--out", &args.out, "a folder for the clouds")?;
    let set = DataSet::open(set)?;
    let clouds = pipeline::export(&set, format, &args.out, console)?;
    let dir = args.out.clone();
    Moved { dir, clouds }.tell(console)
}

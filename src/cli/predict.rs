//! `tdcr predict`.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, bail, ensure};
use clap::Args;
use serde::Serialize;
use tdcr::learn::data::{NpzArray, NpzRows, NpzValues, OutOfRange, write_npz};
use tdcr::learn::predict::Prediction;
use tdcr::learn::train::Model;
use tdcr::pipeline::{Monitor, Quantiles, SamplerPlan};
use tdcr::report::counted;
use tdcr::sim::cloud::{PlyError, PointCloud, PointProperty, write_ply_with};
use tdcr::sim::robot::{Loads, Robot};

use super::commands::read_commands;
use super::console::{Console, Interrupted};
use super::picture::{PictureArg, of_clouds};
use super::{PrecisionArgs, output};

/// Predict the clouds of a settled robot for one command or many, and write them as PLY or NPZ
#[derive(Debug, Args)]
pub(super) struct PredictArgs {
    /// The trained model
    #[arg(long, default_value = "run/model.safetensors", value_name = "FILE")]
    model: PathBuf,
    /// Command of every tendon, separated by commas: m, or N for a tension drive; for a network of imported clouds, the
    /// units of their motors
    #[arg(
        long,
        value_parser = super::numbers,
        required_unless_present = "commands",
        allow_hyphen_values = true,
        value_name = "C,C,..."
    )]
    command: Option<Box<[f64]>>,
    /// Mass hung from the tip (kg), for a model of data with payloads
    #[arg(long, value_name = "KG")]
    payload: Option<f64>,
    /// Predict for every command in this file: CSV, one per line, optionally with a header, or JSON, a list of lists. For a
    /// model of data with payloads, the payload (kg) is the column `payload`, or without a header the last number
    #[arg(long, value_name = "FILE", conflicts_with_all = ["command", "payload"])]
    commands: Option<PathBuf>,
    /// Points of a cloud
    #[arg(long, default_value_t = 10_000, value_name = "N", value_parser = super::amount)]
    points: usize,
    #[command(flatten)]
    sampler: SamplerPlan,
    #[command(flatten)]
    precision: PrecisionArgs,
    /// Seed of the noise that every cloud starts from
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Number of clouds, each from its own noise, that the uncertainty of the first is estimated from; only the first is
    /// written. One is enough for a network that moves each point on its own (the MLP)
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = super::amount)]
    prior_samples: usize,
    /// What to write: a .ply or .npz file; for --commands a .npz file, or a folder for a PLY file each
    /// [default: prediction.ply, with --commands predictions]
    #[arg(long, value_name = "PATH")]
    out: Option<PathBuf>,
    #[command(flatten)]
    picture: PictureArg,
}

#[derive(Serialize)]
struct Predicted {
    file: PathBuf,
    points: usize,
    /// Corners of the cloud's bounding box (m).
    min: [f32; 3],
    max: [f32; 3],
    /// Numbers of the command outside the training range, where predictions are extrapolations.
    out_of_range: Vec<OutOfRange>,
    /// How uncertain the points are (m); `None` where too few points tell.
    uncertainty: Option<Uncertainty>,
    /// Evaluations of the network that the cloud took.
    evaluations: usize,
    seconds: f64,
}

/// How uncertain the points of a cloud are.
#[derive(Serialize)]
struct Uncertainty {
    /// Over the points (m).
    #[serde(flatten)]
    quantiles: Quantiles,
    /// Where it is greatest (m, world frame).
    max_at: [f32; 3],
}

/// A prediction, and how uncertain each of its points is (m), if that can be told.
struct Cloud {
    prediction: Prediction,
    uncertainty: Option<Vec<f32>>,
}

/// In a PLY file, the points of a network that predicts positions alone have this colour.
const COLOR: [u8; 3] = [0, 114, 178];

/// Name of the uncertainty (m) of each point in files.
const UNCERTAINTY: &str = "uncertainty";

pub(super) fn run(args: &PredictArgs, console: &Console) -> anyhow::Result<()> {
    check_out(args)?;
    ensure!(
        args.picture.wanted()?.is_none() || args.command.is_some(),
        "--picture is of one command; expected --command beside it"
    );
    let model = super::load_model(&args.model)?;
    let precision = args.precision.of_width(model.network.shape().width());
    let model = model.with_precision(precision)?;
    match (&args.commands, &args.command) {
        (Some(file), _) => many(args, &model, file, console),
        (None, Some(command)) => one(args, &model, command, console),
        (None, None) => bail!("say --command or --commands"),
    }
}

/// What to write.
fn out(args: &PredictArgs) -> PathBuf {
    let usual = match args.commands {
        Some(_) => "predictions",
        None => "prediction.ply",
    };
    args.out.clone().unwrap_or(usual.into())
}

/// Refuses a path whose extension does not fit what is written.
fn check_out(args: &PredictArgs) -> anyhow::Result<()> {
    let out = out(args);
    match args.commands {
        None => output::format("--out", &out, &["ply", "npz"]).map(drop),
        Some(_) if is_npz(&out) => Ok(()),
        Some(_) => output::folder(
            "--out",
            &out,
            "a .npz file, or a folder for a PLY file each",
        ),
    }
}

fn one(
    args: &PredictArgs,
    model: &Model,
    command: &[f64],
    console: &Console,
) -> anyhow::Result<()> {
    let condition = condition(model, command, args.payload)?;
    let out = out(args);
    let (cloud, predicted) = predict(args, model, &condition, &out, "the command")?;
    if let Some(picture) = args.picture.wanted()? {
        let prediction = &cloud.prediction;
        let points = prediction.points.clone();
        let colors = prediction
            .colors
            .clone()
            .unwrap_or_else(|| vec![COLOR; points.len()]);
        of_clouds(picture, &[PointCloud { points, colors }])?;
    }
    if is_npz(&out) {
        write_npz(&out, &cloud.arrays(&[cloud.prediction.points.len(), 3]))?;
    } else {
        cloud.write_ply(&out)?;
    }
    console.summary(&predicted, line)
}

fn many(args: &PredictArgs, model: &Model, file: &Path, console: &Console) -> anyhow::Result<()> {
    let payloads = takes_payloads(model);
    let conditions = read_commands(file, |row| match row.payload {
        Some(payload) if payloads => condition(model, &row.command, Some(payload)),
        None if payloads => match row.command.split_last() {
            Some((payload, command)) => condition(model, command, Some(*payload)),
            None => condition(model, &row.command, None),
        },
        _ => condition(model, &row.unloaded()?, None),
    })?;
    let out = out(args);
    let mut archive = is_npz(&out).then(|| NpzRows::new(&out));
    if archive.is_none() {
        std::fs::create_dir_all(&out)
            .with_context(|| format!("cannot make the folder {}", out.display()))?;
        refuse_stale(&out, conditions.len())?;
    }
    let mut results = Vec::new();
    console.begin("predict", conditions.len() as u64, 0);
    for (index, condition) in conditions.iter().enumerate() {
        if console.interrupted() {
            return Err(Interrupted.into());
        }
        let path = match archive {
            Some(_) => out.clone(),
            None => out.join(format!("cloud-{index:05}.ply")),
        };
        let name = format!("command {index}");
        let (cloud, predicted) = predict(args, model, condition, &path, &name)?;
        match &mut archive {
            Some(archive) => {
                let values: Vec<f32> = condition.iter().map(|x| *x as f32).collect();
                let (shape, dimension) = ([cloud.prediction.points.len(), 3], [values.len()]);
                let mut row = cloud.arrays(&shape);
                row.push(NpzArray {
                    name: "commands",
                    shape: &dimension,
                    values: NpzValues::Floats(&values),
                });
                archive.push(&row)?;
            }
            None => cloud.write_ply(&path)?,
        }
        results.push(predicted);
        console.advance(1);
    }
    console.end();
    if let Some(archive) = archive {
        archive.finish()?;
    }
    console.summary(&results, |all| {
        all.iter().map(|predicted| line(predicted) + "\n").collect()
    })
}

/// Refuses a folder with clouds of an earlier prediction that `count` new ones would not all overwrite.
fn refuse_stale(folder: &Path, count: usize) -> anyhow::Result<()> {
    let context = || format!("cannot read the folder {}", folder.display());
    for entry in std::fs::read_dir(folder).with_context(context)? {
        let name = entry.with_context(context)?.file_name();
        let name = name.to_string_lossy();
        let number = name
            .strip_prefix("cloud-")
            .and_then(|name| name.strip_suffix(".ply"));
        let number = number.and_then(|number| number.parse::<usize>().ok());
        ensure!(
            number.is_none_or(|number| number < count),
            "{} holds {name} of an earlier prediction, which would stay among the clouds of {count} commands; \
             remove it, or choose another --out",
            folder.display()
        );
    }
    Ok(())
}

/// A cloud (m), and what is told of it; warns of a command outside the training range.
fn predict(
    args: &PredictArgs,
    model: &Model,
    condition: &[f64],
    file: &Path,
    name: &str,
) -> anyhow::Result<(Cloud, Predicted)> {
    let sampler = args.sampler.resolve(model)?;
    let out_of_range = model.provenance.normalisation.out_of_range(condition)?;
    for OutOfRange {
        index,
        value,
        min,
        max,
    } in &out_of_range
    {
        let subject = model.provenance.subject.as_ref();
        let tendons = subject.map(|subject| subject.robot.tendons());
        let (what, unit) = match tendons.as_ref().map(|tendons| tendons.get(*index)) {
            Some(Some(tendon)) => (
                format!("tendon {}", index + 1),
                format!(" {}", tendon.drive.unit()),
            ),
            Some(None) => ("the payload".to_owned(), " kg".to_owned()),
            None => (format!("motor {}", index + 1), String::new()),
        };
        tracing::warn!(
            "{name}: {what} is {value}{unit}, outside the training range {min} to {max}{unit}: \
             the prediction is an extrapolation"
        );
    }
    let start = Instant::now();
    let sample = |seed| model.predict(condition, args.points, seed, &sampler);
    let prediction = sample(args.seed)?;
    let others = (1..args.prior_samples)
        .map(|k| sample(args.seed.wrapping_add(k as u64)))
        .collect::<Result<Vec<_>, _>>()?;
    let cloud = Cloud {
        uncertainty: prediction.uncertainty(&others),
        prediction,
    };
    let seconds = start.elapsed().as_secs_f64();
    let points = &cloud.prediction.points;
    let bound = |pick: fn(f32, f32) -> f32, from: f32| {
        points.iter().fold([from; 3], |b, p| {
            std::array::from_fn(|axis| pick(b[axis], p[axis]))
        })
    };
    let predicted = Predicted {
        file: file.to_owned(),
        points: points.len(),
        min: bound(f32::min, f32::INFINITY),
        max: bound(f32::max, f32::NEG_INFINITY),
        out_of_range,
        uncertainty: cloud.summary(),
        evaluations: cloud.prediction.evaluations,
        seconds,
    };
    Ok((cloud, predicted))
}

fn line(predicted: &Predicted) -> String {
    let mut text = format!(
        "{}: {} from {:.3?} to {:.3?} m, predicted in {:.2} s by {} of the network",
        predicted.file.display(),
        counted(predicted.points, "point"),
        predicted.min,
        predicted.max,
        predicted.seconds,
        counted(predicted.evaluations, "evaluation")
    );
    if let Some(Uncertainty { quantiles, max_at }) = &predicted.uncertainty {
        text += &format!(
            "; uncertainty {:.2} mm (median), {:.2} mm (95 %), at most {:.2} mm, at {max_at:.3?} m",
            1e3 * quantiles.median,
            1e3 * quantiles.p95,
            1e3 * quantiles.max
        );
    }
    text
}

fn is_npz(path: &Path) -> bool {
    (path.extension()).is_some_and(|extension| extension.eq_ignore_ascii_case("npz"))
}

impl Cloud {
    fn summary(&self) -> Option<Uncertainty> {
        let values = self.uncertainty.as_ref()?;
        let greatest = (0..values.len()).max_by(|&a, &b| values[a].total_cmp(&values[b]))?;
        Some(Uncertainty {
            quantiles: Quantiles::of(values.iter().map(|&value| value.into()).collect()),
            max_at: self.prediction.points[greatest],
        })
    }

    /// Writes it as PLY, the uncertainty as a property.
    fn write_ply(self, path: &Path) -> Result<(), PlyError> {
        let uncertainty = self.uncertainty.as_deref();
        let uncertainty = uncertainty.map(|values| PointProperty {
            name: UNCERTAINTY,
            values,
        });
        let cloud = self.prediction.into_cloud(COLOR);
        write_ply_with(path, &cloud, uncertainty.as_slice())
    }

    /// Arrays of an archive, for points of `shape`: points and, where there are any, colours and uncertainties.
    fn arrays<'a>(&'a self, shape: &'a [usize]) -> Vec<NpzArray<'a>> {
        let Prediction { points, colors, .. } = &self.prediction;
        let colors = colors.as_deref().map(<[_]>::as_flattened);
        let uncertainty = self.uncertainty.as_deref();
        let per_point = &shape[..shape.len() - 1];
        [
            (
                "points",
                shape,
                Some(NpzValues::Floats(points.as_flattened())),
            ),
            ("rgb", shape, colors.map(NpzValues::Bytes)),
            (UNCERTAINTY, per_point, uncertainty.map(NpzValues::Floats)),
        ]
        .into_iter()
        .filter_map(|(name, shape, values)| {
            values.map(|values| NpzArray {
                name,
                shape,
                values,
            })
        })
        .collect()
    }
}

fn takes_payloads(model: &Model) -> bool {
    let subject = model.provenance.subject.as_ref();
    subject.is_some_and(|subject| subject.payload.is_some())
}

/// The command and, for a model of data with payloads, the payload.
fn condition(model: &Model, command: &[f64], payload: Option<f64>) -> anyhow::Result<Vec<f64>> {
    let mut condition = command.to_vec();
    let subject = model.provenance.subject.as_ref();
    if let Some(subject) = subject {
        Robot::new(subject.robot.clone())?.command(&condition)?;
    }
    match (subject.and_then(|subject| subject.payload), payload) {
        (Some(_), Some(mass)) => {
            Loads::payload(mass)?;
            condition.push(mass);
        }
        (Some(range), None) => {
            bail!("the model was trained with payloads of {range} kg: say --payload KG, 0 for none")
        }
        (None, Some(_)) => bail!("the model was trained without payloads: leave out --payload"),
        (None, None) => {}
    }
    // A model of imported data knows no robot, only how many numbers a command has.
    model.provenance.normalisation.condition(&condition)?;
    Ok(condition)
}

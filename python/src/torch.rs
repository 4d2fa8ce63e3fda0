//! What training in PyTorch shares with `tdcr train`: presets, settings, clouds in memory, the noise that clouds start from; and
//! the velocities of a model's network, to compare with.

use std::path::PathBuf;

use numpy::{PyArray1, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use tdcr::learn::data::{CloudSet, DataSet, Meta, Normalisation, Split};
use tdcr::learn::flow::{FlowPath, Stream, VelocityField, rng};
use tdcr::learn::net::Channels;
use tdcr::learn::options::{DataFacts, Net, Preset, Resolved, TrainOptions};
use tdcr::learn::predict::{ISOLATED, ISOLATED_CORRECTED, select};
use tdcr::learn::train::{Model, Provenance, TrainSettings};
use tdcr::pipeline;

use crate::arrays::{array, contiguous};
use crate::errors::{Failure, Outcome, choice, text};
use crate::options::options_of;
use crate::run;
use crate::stream::read_reduction;

/// Indices, and the points that they are of (N, 3).
type Selected<'py> = (Bound<'py, PyArray1<usize>>, Bound<'py, PyArray2<f32>>);

/// Conditions (B, D), points (B, N, 3) and, where they are wanted, colours (B, N, 3), and the provenance as JSON.
type CloudArrays<'py> = (
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray3<f32>>,
    Option<Bound<'py, PyArray3<u8>>>,
    String,
);

/// All presets, the default first, as JSON: name, and the options for an MLP and a hybrid.
#[pyfunction]
pub fn presets() -> Outcome<String> {
    let described = Preset::ALL.map(|preset| {
        (
            preset.name(),
            [Net::Mlp, Net::Hybrid].map(|net| preset.options(net)),
        )
    });
    text(serde_json::to_string(&described))
}

/// Shape of the network and settings of a run in PyTorch, as JSON, from its options in JSON and the number of clouds of its training
/// set, which a stream has not. The shape has no dimension of the conditions yet.
///
/// The last evaluation is not refined there, and products are of 32-bit floats where it is not said otherwise.
#[pyfunction]
#[pyo3(signature = (options, clouds_in_set = None))]
pub fn resolve_training(options: &str, clouds_in_set: Option<usize>) -> Outcome<(String, String)> {
    let asked = options_of::<TrainOptions>(options)?;
    let options = TrainOptions {
        refinement_steps: Some(0),
        precision: Some(asked.precision.unwrap_or_default()),
        ..asked
    };
    let data = DataFacts {
        clouds: clouds_in_set,
        ..DataFacts::default()
    };
    let Resolved { shape, settings } = options.resolve(&data)?;
    Ok((
        text(serde_json::to_string(&shape))?,
        text(serde_json::to_string(&settings))?,
    ))
}

/// Settings of a run from JSON, with defaults for what is not given, checked.
#[pyfunction]
pub fn train_settings(changes: &str) -> Outcome<String> {
    let settings: TrainSettings = serde_json::from_str(changes)
        .map_err(|error| Failure::input(format!("the settings of training: {error}")))?;
    settings.check()?;
    text(serde_json::to_string(&settings))
}

/// How the clouds of a data set are reduced by the symmetries that they have, with or without their colours, as JSON, and the
/// same in words, or why there are none.
#[pyfunction]
pub fn set_reduction(py: Python<'_>, folder: PathBuf, colors: bool) -> Outcome<(String, String)> {
    let found = py.detach(|| {
        let set = DataSet::open(&folder)?;
        let recipe = set.meta().and_then(|meta| meta.origin.recipe());
        pipeline::seen_symmetries(recipe, channels(colors)).map_err(Failure::from)
    })?;
    Ok((
        text(serde_json::to_string(&found.reduction()))?,
        found.to_string(),
    ))
}

/// What a network of this provenance (JSON) is told of commands (B, D), and for each the index of the symmetry that leads to its
/// representative.
#[pyfunction]
pub fn reduce<'py>(
    py: Python<'py>,
    provenance: &str,
    commands: PyReadonlyArray2<'py, f64>,
) -> Outcome<(Bound<'py, PyArray2<f32>>, Vec<usize>)> {
    let [count, dimension] = *numpy::PyUntypedArrayMethods::shape(&*commands) else {
        return Err(Failure::input("commands have no two axes"));
    };
    let refuse = |problem: String| Failure::input(format!("the provenance: {problem}"));
    let Provenance {
        normalisation,
        reduction,
        ..
    } = serde_json::from_str(provenance).map_err(|error| refuse(error.to_string()))?;
    reduction.check(dimension).map_err(refuse)?;
    let commands = contiguous(&commands, "commands", &[count, dimension])?;
    let elements = reduction.symmetries().elements();
    let (mut conditions, mut which) = (Vec::new(), Vec::new());
    for command in commands.chunks_exact(dimension.max(1)) {
        let reduced = reduction.reduce(command, &normalisation)?;
        let index = elements.iter().position(|one| one == reduced.symmetry);
        which.push(index.unwrap_or(0));
        conditions.extend(reduced.condition);
    }
    let told = dimension + reduction.view_numbers();
    Ok((array(py, conditions, [count, told])?, which))
}

fn channels(colors: bool) -> Channels {
    match colors {
        true => Channels::XyzRgb,
        false => Channels::Xyz,
    }
}

/// A split of a data set in memory, in the units of `normalisation` (JSON) or in its own; reduced by `reduction` (JSON), if
/// there is one.
#[pyfunction]
pub fn read_cloud_set<'py>(
    py: Python<'py>,
    folder: PathBuf,
    split: &str,
    normalisation: Option<&str>,
    reduction: Option<&str>,
    colors: bool,
) -> Outcome<CloudArrays<'py>> {
    let splits = Split::ALL.map(|split| (split.folder(), split));
    let split = choice("split", split, &splits)?;
    let units: Option<Normalisation> = normalisation
        .map(serde_json::from_str)
        .transpose()
        .map_err(|error| Failure::input(format!("the normalisation: {error}")))?;
    let (provenance, set) = py.detach(|| {
        let set = DataSet::open(&folder)?;
        let units = units.unwrap_or_else(|| set.normalisation().clone());
        let reduction = reduction.map(|text| read_reduction(text, units.motor_min.len()));
        let reduction = reduction.transpose()?.unwrap_or_default();
        let mut clouds = set.cloud_set_in(split, &units, channels(colors))?;
        reduction.set(&mut clouds, &mut set.conditions(split)?, &units)?;
        let subject = set.meta().and_then(Meta::subject);
        let provenance = Provenance {
            subject,
            normalisation: units,
            reduction,
        };
        Ok::<_, Failure>((provenance, clouds))
    })?;
    let shape = [set.len(), set.points_per_cloud, 3];
    let CloudSet {
        condition_dim,
        conditions,
        points,
        colors,
        ..
    } = set;
    Ok((
        array(py, conditions, [shape[0], condition_dim])?,
        array(py, points, shape)?,
        colors.map(|colors| array(py, colors, shape)).transpose()?,
        text(serde_json::to_string(&provenance))?,
    ))
}

/// Samples (N, C) of the prior, those that `tdcr predict --seed` starts from.
#[pyfunction]
pub fn start_noise(
    py: Python<'_>,
    prior_deviation: f32,
    prior_cut: Option<f32>,
    points: usize,
    colors: bool,
    seed: u64,
) -> Outcome<Bound<'_, PyArray2<f32>>> {
    let channels = channels(colors);
    let path = FlowPath {
        prior_deviation,
        prior_cut,
        ..FlowPath::PAPER
    };
    path.check()?;
    let mut rows = vec![0.0; points * channels.count()];
    path.sample_prior(&mut rng(seed, Stream::Sample(0)), channels, &mut rows);
    Ok(array(py, rows, [points, channels.count()])?)
}

/// Indices of the `count` of a cloud's drawn points (N, 3) that make the cloud, and where these are in it (count, 3);
/// `corrected`: whether they were.
#[pyfunction]
pub fn select_points<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f32>,
    count: usize,
    corrected: bool,
) -> Outcome<Selected<'py>> {
    let isolated = if corrected {
        ISOLATED_CORRECTED
    } else {
        ISOLATED
    };
    let rows = numpy::PyUntypedArrayMethods::shape(&*points)[0];
    let (points, _) = contiguous(&points, "points", &[rows, 3])?.as_chunks::<3>();
    let mut points = points.to_vec();
    let kept = py.detach(|| select(&mut points, count, isolated));
    let cloud: Vec<_> = kept.iter().flat_map(|&k| points[k]).collect();
    let cloud = array(py, cloud, [kept.len(), 3])?;
    Ok((PyArray1::from_vec(py, kept), cloud))
}

/// Velocities (B, N, C) of the network in the model file `model`, in float32, of points (B, N, C) at flow times (B,) under
/// conditions (B, D); all in normalised units.
#[pyfunction]
pub fn velocities<'py>(
    py: Python<'py>,
    model: PathBuf,
    points: PyReadonlyArray3<'py, f32>,
    times: PyReadonlyArray1<'py, f32>,
    conditions: PyReadonlyArray2<'py, f32>,
) -> Outcome<Bound<'py, PyArray3<f32>>> {
    let network = py.detach(|| Model::load(&model))?.network;
    let shape = network.shape();
    let [clouds, count, _] = *numpy::PyUntypedArrayMethods::shape(&*points) else {
        return Err(Failure::input("points have no three axes"));
    };
    let (dimension, channels) = (shape.condition_dim(), shape.channels().count());
    let points = contiguous(&points, "points", &[clouds, count, channels])?;
    let times = contiguous(&times, "times", &[clouds])?;
    let conditions = contiguous(&conditions, "conditions", &[clouds, dimension])?;
    let mut found = vec![0.0; points.len()];
    let cloud = (count * channels).max(1);
    run::long(py, None, |_| {
        let rows = points.chunks(cloud).zip(found.chunks_mut(cloud));
        let rows = rows.zip(times).zip(conditions.chunks(dimension));
        for (((points, found), &time), condition) in rows {
            network.velocity(time, condition, points, found);
        }
    })?;
    Ok(array(py, found, [clouds, count, channels])?)
}

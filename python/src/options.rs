//! Options that Python writes as JSON, by their names, for the one struct that has them; tables from files or dictionaries; and names
//! that stand alone.

use std::path::PathBuf;

use pyo3::prelude::*;
use serde::de::DeserializeOwned;
use serde_json::Value;
use tdcr::pipeline::Noise;
use tdcr::pipeline::recording::GivenPriors;
use tdcr::sim::render::Sensor;

use crate::errors::{Failure, Outcome};

/// The options in a text.
pub fn options_of<T: DeserializeOwned>(asked: &str) -> Outcome<T> {
    let refuse = |error: serde_json::Error| Failure::input(error.to_string());
    // Of a value, an error has no line and column.
    let asked: Value = serde_json::from_str(asked).map_err(refuse)?;
    serde_json::from_value(asked).map_err(refuse)
}

/// A table: its file, or the JSON text of a dictionary.
#[derive(FromPyObject)]
pub enum TableArgument {
    Json((String,)),
    File(PathBuf),
}

/// What is known of unknowns.
pub fn priors(given: Option<&TableArgument>) -> Outcome<GivenPriors> {
    Ok(match given {
        Some(TableArgument::File(path)) => GivenPriors::load(path)?,
        Some(TableArgument::Json((text,))) => GivenPriors::from_json(text)?,
        None => GivenPriors::default(),
    })
}

/// Faults of cameras, by name.
pub fn sensor(noise: Option<&str>) -> Outcome<Option<Sensor>> {
    let named = |name| Noise::named(name).map(Noise::sensor);
    noise.map(named).transpose().map_err(Failure::input)
}

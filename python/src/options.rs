//! Options that Python writes as JSON, by their names, for the one struct that has them; and names that stand alone.

use serde::de::DeserializeOwned;
use serde_json::Value;
use tdcr::pipeline::Noise;
use tdcr::sim::render::Sensor;

use crate::errors::{Failure, Outcome};

/// The options in a text.
pub fn options_of<T: DeserializeOwned>(asked: &str) -> Outcome<T> {
    let refuse = |error: serde_json::Error| Failure::input(error.to_string());
    // Of a value, an error has no line and column.
    let asked: Value = serde_json::from_str(asked).map_err(refuse)?;
    serde_json::from_value(asked).map_err(refuse)
}

/// Faults of cameras, by name.
pub fn sensor(noise: Option<&str>) -> Outcome<Option<Sensor>> {
    let named = |name| Noise::named(name).map(Noise::sensor);
    noise.map(named).transpose().map_err(Failure::input)
}

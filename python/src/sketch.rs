//! First robot files.

use pyo3::prelude::*;
use tdcr::sim::formats::{Sketch, SketchedBackbone, SketchedServos};

use crate::errors::{Outcome, choice};

/// A robot file (TOML) of a few numbers, as `tdcr new` writes it.
#[pyfunction]
#[allow(clippy::too_many_arguments, reason = "Python's caller names them")]
pub fn sketch(
    name: &str,
    segments: usize,
    discs: usize,
    tendons: usize,
    length: f64,
    backbone: &str,
    radius: f64,
    servos: &str,
) -> Outcome<String> {
    let backbones = [
        ("steel", SketchedBackbone::steel(radius)),
        ("nitinol", SketchedBackbone::nitinol(radius)),
    ];
    let all_servos = [
        ("tension", SketchedServos::Tension),
        ("position", SketchedServos::Position),
    ];
    let sketch = Sketch {
        segments,
        discs,
        tendons,
        length,
        backbone: choice("backbone", backbone, &backbones)?,
        servos: choice("servos", servos, &all_servos)?,
    };
    Ok(sketch.to_toml(name)?)
}

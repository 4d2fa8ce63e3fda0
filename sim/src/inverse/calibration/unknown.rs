//! What is to be found.

use crate::inverse::coordinate::Coordinate;
use crate::robot::{Parameter, ParameterError, RobotSpec, Values};

/// Bounds of what must be above zero, relative to its first value.
const WIDEST: [f64; 2] = [1e-6, 1e6];

/// A number to be found: one value that one or several parameters share.
#[derive(Clone, Debug, PartialEq)]
pub struct Unknown {
    name: String,
    parameters: Vec<Parameter>,
}

impl Unknown {
    /// One parameter.
    pub fn one(parameter: Parameter) -> Self {
        Self::shared(&parameter.to_string(), [parameter])
    }

    /// Parameters that share one value: for example the gain of all tendons, or the density of all
    /// modules.
    pub fn shared(name: &str, parameters: impl IntoIterator<Item = Parameter>) -> Self {
        Self {
            name: name.to_owned(),
            parameters: parameters.into_iter().collect(),
        }
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its parameters.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// Its unit.
    pub fn unit(&self) -> &'static str {
        self.parameters.first().map_or("", |p| p.unit())
    }

    /// The robot with this value of the unknown.
    ///
    /// # Errors
    /// As [`RobotSpec::with`].
    pub fn set(&self, spec: &RobotSpec, value: f64) -> Result<RobotSpec, ParameterError> {
        let values: Vec<_> = self.parameters.iter().map(|&p| (p, value)).collect();
        spec.with(&values)
    }

    /// Mean value of its parameters.
    pub(super) fn value(&self, spec: &RobotSpec) -> Result<f64, ParameterError> {
        let values: Result<Vec<f64>, _> = self.parameters.iter().map(|&p| spec.value(p)).collect();
        let values = values?;
        Ok(values.iter().sum::<f64>() / values.len() as f64)
    }

    /// The size against which its uncertainty is large or small: its own, or for the place of a hole
    /// the hole's distance from the axis.
    pub(super) fn scale(&self, spec: &RobotSpec, value: f64) -> f64 {
        match self.parameters.first() {
            Some(Parameter::Hole(body, hole, _)) => {
                let holes = spec.holes(*body).map(|holes| holes.positions());
                holes.map_or(0.0, |holes| holes[*hole][0].hypot(holes[*hole][1]))
            }
            _ => value.abs(),
        }
    }

    /// The coordinate in which it is sought, for a first value: sizes relative to it, the place of a hole as it is.
    pub(super) fn coordinate(&self, first: f64) -> Coordinate {
        let mut values = self.parameters.iter().map(|p| p.kind().quantity.values);
        match values.any(|values| values == Values::Any) || first <= 0.0 {
            true => Coordinate::SAME,
            false => Coordinate::Size { first },
        }
    }

    /// Smallest and largest value considered, from a first one.
    pub(super) fn bounds(&self, first: f64) -> [f64; 2] {
        let [least, most] = WIDEST.map(|share| share * first);
        let bounds = |parameter: &Parameter| match parameter.kind().quantity.values {
            Values::Any => [f64::NEG_INFINITY, f64::INFINITY],
            Values::NotNegative => [0.0, if first > 0.0 { most } else { f64::INFINITY }],
            Values::Positive => [least, most],
        };
        let all = self.parameters.iter().map(bounds);
        all.fold([f64::NEG_INFINITY, f64::INFINITY], |[low, high], [l, h]| {
            [low.max(l), high.min(h)]
        })
    }
}

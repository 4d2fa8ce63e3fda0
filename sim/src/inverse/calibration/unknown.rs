//! What is to be found.

use crate::inverse::coordinate::Coordinate;
use crate::inverse::least_squares::Limit;
use crate::inverse::sought::Sought;
use crate::robot::{Parameter, ParameterError, RobotSpec, Values};

/// Within what a number above zero is sought, relative to its first value.
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

    /// How it is sought from a first value: sizes relative to it, the place of a hole as it is.
    pub(super) fn sought(&self, first: f64) -> Sought {
        let kinds = self.parameters.iter().map(|p| p.kind().quantity.values);
        let free = first <= 0.0 || kinds.clone().any(|values| values == Values::Any);
        let coordinate = match free {
            true => Coordinate::SAME,
            false => Coordinate::Size { first },
        };
        // Of kinds that share a value, the one that can have the fewest.
        let values = kinds.max().unwrap_or(Values::Any);
        let [least, most] = WIDEST.map(|share| coordinate.of(share * first));
        let endless = [f64::NEG_INFINITY, f64::INFINITY];
        Sought {
            name: self.name.clone(),
            group: None,
            unit: self.unit(),
            values,
            first,
            coordinate,
            widest: Limit {
                range: match values {
                    Values::NotNegative if first > 0.0 => [f64::NEG_INFINITY, most],
                    Values::Positive => [least, most],
                    Values::Any | Values::NotNegative => endless,
                },
                // A size moves by about its own in one step.
                reach: match coordinate {
                    Coordinate::Size { .. } => 1.0,
                    _ => f64::INFINITY,
                },
            },
            bounds: [values.least(), f64::INFINITY],
        }
    }
}

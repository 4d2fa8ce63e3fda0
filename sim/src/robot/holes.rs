//! Tendon holes of a body.

use std::fmt;

use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use super::angle;

/// Tendon holes of a body, x and y in its frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Holes {
    /// Each hole's x and y (m).
    At(Vec<[f64; 2]>),
    /// Holes on a circle around the z axis.
    Circle(HoleCircle),
}

/// Holes on a circle around the z axis. Files may give `degrees` in place of `angles`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "CircleInFile")]
pub struct HoleCircle {
    /// Radius of the circle (m).
    pub radius: f64,
    /// Angle of each hole from the x axis, about z (rad).
    pub angles: Vec<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CircleInFile {
    radius: f64,
    angles: Option<Vec<f64>>,
    degrees: Option<Vec<f64>>,
}

impl TryFrom<CircleInFile> for HoleCircle {
    type Error = String;

    fn try_from(file: CircleInFile) -> Result<Self, String> {
        let to_radians = |degrees: Vec<f64>| degrees.into_iter().map(f64::to_radians).collect();
        let names = ["angles", "degrees"];
        Ok(Self {
            radius: file.radius,
            angles: angle::required(file.angles, file.degrees, names, to_radians)?,
        })
    }
}

impl Holes {
    /// Number of holes.
    pub fn count(&self) -> usize {
        match self {
            Self::At(holes) => holes.len(),
            Self::Circle(circle) => circle.angles.len(),
        }
    }

    /// The holes' x and y in the body's frame (m).
    pub fn positions(&self) -> Vec<[f64; 2]> {
        (0..self.count())
            .filter_map(|hole| self.position(hole))
            .collect()
    }

    /// The x and y of one hole (m); `None` for a hole that there is not.
    pub fn position(&self, hole: usize) -> Option<[f64; 2]> {
        match self {
            Self::At(holes) => holes.get(hole).copied(),
            Self::Circle(HoleCircle { radius, angles }) => {
                (angles.get(hole)).map(|angle| [radius * angle.cos(), radius * angle.sin()])
            }
        }
    }
}

// A table is a circle and a list is holes one by one: see `PerDisc`.
impl<'de> Deserialize<'de> for Holes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct CircleOrList;

        impl<'de> Visitor<'de> for CircleOrList {
            type Value = Holes;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str(
                    "a list of [x, y] in metres, or { radius = metres, angles = [radians] } with \
                     `degrees` in place of `angles`",
                )
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Holes, A::Error> {
                HoleCircle::deserialize(MapAccessDeserializer::new(map)).map(Holes::Circle)
            }

            fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<Holes, A::Error> {
                Vec::deserialize(SeqAccessDeserializer::new(list)).map(Holes::At)
            }
        }

        deserializer.deserialize_any(CircleOrList)
    }
}

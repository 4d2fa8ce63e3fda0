//! Masses of discs and of the rod through them.

use std::f64::consts::PI;
use std::fmt;

use nalgebra::Vector3;
use serde::de::value::SeqAccessDeserializer;
use serde::de::{SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use super::{PerDisc, RodSpec};

/// Mass of a module's discs, without that of a rod ([`RodSpec`]).
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MassSpec {
    /// Density of the solid cylinder that the disc is (kg/m³).
    Density(PerDisc<f64>),
    /// The same, with its centre elsewhere than in the disc's origin.
    Solid(PerDisc<SolidMass>),
    /// Mass and moments of inertia of each disc.
    Rigid(PerDisc<RigidMass>),
}

impl MassSpec {
    /// Multiplies masses and moments of inertia.
    pub(crate) fn scale(&mut self, factor: f64) {
        match self {
            Self::Density(density) => density.change(|density| *density *= factor),
            Self::Solid(solid) => solid.change(|solid| solid.density *= factor),
            Self::Rigid(rigid) => rigid.change(|rigid| {
                rigid.mass *= factor;
                rigid.inertia = rigid.inertia.map(|moment| factor * moment);
            }),
        }
    }
}

/// Mass of a solid cylinder of the disc's radius and height.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SolidMass {
    /// Density (kg/m³).
    pub density: f64,
    /// Centre of mass in the disc's frame (m); in files `[x, y, z]`, or the height z alone. The
    /// disc's origin where the file does not give it.
    #[serde(default, deserialize_with = "place", skip_serializing_if = "is_origin")]
    pub centre_of_mass: [f64; 3],
}

/// Mass and moments of inertia of a disc.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigidMass {
    /// Mass (kg).
    pub mass: f64,
    /// Moments of inertia about the centre of mass, along the disc's x, y and z axes (kg m²).
    pub inertia: [f64; 3],
    /// Centre of mass in the disc's frame (m); in files `[x, y, z]`, or the height z alone. The
    /// disc's origin where the file does not give it.
    #[serde(default, deserialize_with = "place", skip_serializing_if = "is_origin")]
    pub centre_of_mass: [f64; 3],
}

/// A rigid mass in the frame of a disc.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part {
    /// Mass (kg).
    pub mass: f64,
    /// Centre of mass from the disc's origin (m).
    pub centre: Vector3<f64>,
    /// Moments of inertia about the centre of mass, along the disc's axes (kg m²).
    pub inertia: Vector3<f64>,
}

impl Part {
    /// The mass of a disc of this radius and half height (m), the `index`th of its module.
    pub fn of_disc(mass: &MassSpec, index: usize, radius: f64, half_height: f64) -> Self {
        let expected = "validated: one per disc";
        match mass {
            MassSpec::Density(density) => {
                let density = *density.of_disc(index).expect(expected);
                Self::cylinder(density, radius, half_height, Vector3::zeros())
            }
            MassSpec::Solid(solid) => {
                let solid = solid.of_disc(index).expect(expected);
                let centre = solid.centre_of_mass.into();
                Self::cylinder(solid.density, radius, half_height, centre)
            }
            MassSpec::Rigid(rigid) => {
                let rigid = rigid.of_disc(index).expect(expected);
                Self {
                    mass: rigid.mass,
                    centre: rigid.centre_of_mass.into(),
                    inertia: rigid.inertia.into(),
                }
            }
        }
    }

    /// The piece of a rod between two heights above a disc's origin (m).
    pub fn of_rod(rod: &RodSpec, [low, high]: [f64; 2]) -> Self {
        let middle = Vector3::new(0.0, 0.0, 0.5 * (low + high));
        Self::cylinder(rod.density, rod.radius, 0.5 * (high - low), middle)
    }

    /// A solid upright cylinder (Goldstein, Classical Mechanics, ch. 5).
    fn cylinder(density: f64, r: f64, h: f64, centre: Vector3<f64>) -> Self {
        let mass = density * (PI * r * r * 2.0 * h);
        let across = mass * (3.0 * r * r + 4.0 * h * h) / 12.0;
        Self {
            mass,
            centre,
            inertia: Vector3::new(across, across, mass * r * r / 2.0),
        }
    }

    /// Two masses as one, their centres on the z axis (parallel axes, Goldstein, ch. 5).
    pub fn with(self, other: Self) -> Self {
        if other.mass == 0.0 {
            return self;
        }
        let mass = self.mass + other.mass;
        let centre = (self.centre * self.mass + other.centre * other.mass) / mass;
        let about_centre = |part: &Self| {
            let across = part.mass * (part.centre.z - centre.z).powi(2);
            part.inertia + Vector3::new(across, across, 0.0)
        };
        Self {
            mass,
            centre,
            inertia: about_centre(&self) + about_centre(&other),
        }
    }
}

/// A place `[x, y, z]` (m), or its height z alone.
fn place<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[f64; 3], D::Error> {
    struct HeightOrPlace;

    impl<'de> Visitor<'de> for HeightOrPlace {
        type Value = [f64; 3];

        fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
            f.write_str("[x, y, z] in metres, or the height z alone")
        }

        fn visit_i64<E: serde::de::Error>(self, z: i64) -> Result<[f64; 3], E> {
            Ok([0.0, 0.0, z as f64])
        }

        fn visit_u64<E: serde::de::Error>(self, z: u64) -> Result<[f64; 3], E> {
            Ok([0.0, 0.0, z as f64])
        }

        fn visit_f64<E: serde::de::Error>(self, z: f64) -> Result<[f64; 3], E> {
            Ok([0.0, 0.0, z])
        }

        fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<[f64; 3], A::Error> {
            Deserialize::deserialize(SeqAccessDeserializer::new(list))
        }
    }

    deserializer.deserialize_any(HeightOrPlace)
}

fn is_origin(place: &[f64; 3]) -> bool {
    *place == [0.0; 3]
}

//! What bends at the joints: elastic backbones, rods, soft limits.

use std::f64::consts::{FRAC_PI_4, PI};

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::angle;

/// Elastic backbone of one joint. With `R` the joint's rotation and `R0` that of its rest bend, the
/// energy is `1/2 phi' K phi`, `phi = log(R0' R)`, `K` diagonal in the disc's axes. Files may give
/// `rest_degrees` in place of `rest`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "BackboneInFile")]
pub struct Backbone {
    /// Bending stiffness about the disc's x and y axes (N m/rad).
    pub bending: [f64; 2],
    /// Torsion stiffness about the disc's z axis (N m/rad).
    pub torsion: f64,
    /// Rotation vector of the joint at rest (rad); straight where the file does not give it.
    #[serde(skip_serializing_if = "is_straight")]
    pub rest: [f64; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BackboneInFile {
    bending: [f64; 2],
    torsion: f64,
    rest: Option<[f64; 3]>,
    rest_degrees: Option<[f64; 3]>,
}

impl TryFrom<BackboneInFile> for Backbone {
    type Error = String;

    fn try_from(file: BackboneInFile) -> Result<Self, String> {
        let to_radians = |degrees: [f64; 3]| degrees.map(f64::to_radians);
        let names = ["rest", "rest_degrees"];
        let rest = angle::one_of(file.rest, file.rest_degrees, names, to_radians)?;
        Ok(Self {
            bending: file.bending,
            torsion: file.torsion,
            rest: rest.unwrap_or_default(),
        })
    }
}

impl Backbone {
    /// The same stiffness (N m/rad) about every axis, straight at rest.
    pub fn isotropic(stiffness: f64) -> Self {
        Self {
            bending: [stiffness; 2],
            torsion: stiffness,
            rest: [0.0; 3],
        }
    }

    /// A piece of a round rod, straight at rest: bending stiffness `E I / h` and torsion stiffness
    /// `G J / h` of length `h` (m), for Young's and shear moduli `E`, `G` (Pa) and the rod's radius
    /// (m).
    pub fn round_rod(youngs_modulus: f64, shear_modulus: f64, radius: f64, length: f64) -> Self {
        let second_moment = FRAC_PI_4 * radius.powi(4);
        Self {
            bending: [youngs_modulus * second_moment / length; 2],
            torsion: shear_modulus * 2.0 * second_moment / length,
            rest: [0.0; 3],
        }
    }
}

/// A round elastic rod through a module's discs, straight at rest, from the origin of the body below
/// to that of the module's last disc.
///
/// Each joint has the stiffness of the rod between its disc's origin and that of the body below:
/// `E I / h` in bending, `G J / h` in torsion, `G = E / (2 (1 + nu))`. Each disc carries the rod
/// from its own joint to the next (the last disc of the robot: to its origin) as a solid cylinder,
/// besides its own mass. With `joint_below` half the pitch, the chain converges to the continuous
/// rod with the square of the pitch.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RodSpec {
    /// Young's modulus `E` (Pa).
    pub youngs: f64,
    /// Poisson's ratio `nu`, above -1 and at most 0.5.
    pub poisson: f64,
    /// Radius (m).
    pub radius: f64,
    /// Density (kg/m³).
    pub density: f64,
    /// Internal damping; none where the file does not give it.
    #[serde(default, skip_serializing_if = "RodDamping::is_none")]
    pub damping: RodDamping,
}

/// Internal damping of a rod, in proportion to its stiffness (Kelvin and Voigt's solid): a moment `K (phi + tau dphi/dt)` where
/// the elastic one is `K phi`. A mode of angular frequency `omega` of a rod with the same `tau` in bending and torsion has the
/// damping ratio `tau omega / 2`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RodDamping {
    /// Relaxation time `tau` in bending (s): the viscosity over Young's modulus.
    pub bending: f64,
    /// Relaxation time in torsion (s): the viscosity in shear over the shear modulus.
    pub torsion: f64,
}

impl RodDamping {
    fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Damping of a joint of this stiffness about the disc's axes (N m s/rad).
    pub(crate) fn of_joint(&self, backbone: &Backbone) -> Vector3<f64> {
        let times = Vector3::new(self.bending, self.bending, self.torsion);
        times.component_mul(&backbone.stiffness())
    }
}

impl RodSpec {
    /// The elasticity of a joint that stands for the length `length` (m) of the rod.
    pub fn backbone(&self, length: f64) -> Backbone {
        let shear = self.youngs / (2.0 * (1.0 + self.poisson));
        Backbone::round_rod(self.youngs, shear, self.radius, length)
    }

    /// Mass per length (kg/m).
    pub fn line_density(&self) -> f64 {
        self.density * PI * self.radius * self.radius
    }
}

/// Soft limit of a joint: beyond the angle it is pushed back like a spring. Files may give `degrees`
/// in place of `angle`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "LimitInFile")]
pub struct Limit {
    /// Largest free angle between the disc and the body below, bending and torsion together (rad).
    pub angle: f64,
    /// Stiffness beyond it (N m/rad).
    pub stiffness: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LimitInFile {
    angle: Option<f64>,
    degrees: Option<f64>,
    stiffness: f64,
}

impl TryFrom<LimitInFile> for Limit {
    type Error = String;

    fn try_from(file: LimitInFile) -> Result<Self, String> {
        let names = ["angle", "degrees"];
        Ok(Self {
            angle: angle::required(file.angle, file.degrees, names, f64::to_radians)?,
            stiffness: file.stiffness,
        })
    }
}

fn is_straight(rest: &[f64; 3]) -> bool {
    *rest == [0.0; 3]
}

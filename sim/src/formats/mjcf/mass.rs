//! Masses of bodies from their geoms and inertials.

use std::f64::consts::PI;

use nalgebra::{Isometry3, Matrix3, Vector3};

use super::attributes::Attributes;
use super::frame::{Compiler, POSE, turn_to};
use crate::formats::ImportError;

/// Mass of a part of a body, in the frame of the body.
#[derive(Clone, Debug)]
pub(super) struct PartMass {
    /// Mass (kg).
    pub mass: f64,
    /// Centre of mass (m).
    pub center: Vector3<f64>,
    /// Moments of inertia about the centre of mass (kg m²).
    pub inertia: Matrix3<f64>,
}

/// A geom in the frame of its body.
#[derive(Clone, Debug)]
pub(super) struct Geom {
    pub shape: Shape,
    pub pose: Isometry3<f64>,
    pub mass: GeomMass,
}

/// How a geom's mass is given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum GeomMass {
    /// In kg/m³.
    Density(f64),
    /// In kg.
    Mass(f64),
}

/// Shapes, sizes as MuJoCo counts them (m).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Shape {
    Sphere { radius: f64 },
    Capsule { radius: f64, half: f64 },
    Cylinder { radius: f64, half: f64 },
    Box([f64; 3]),
    Ellipsoid([f64; 3]),
}

impl Shape {
    fn volume(&self) -> f64 {
        match *self {
            Self::Sphere { radius } => 4.0 / 3.0 * PI * radius.powi(3),
            Self::Capsule { radius, half } => {
                PI * radius * radius * (2.0 * half + 4.0 / 3.0 * radius)
            }
            Self::Cylinder { radius, half } => PI * radius * radius * (2.0 * half),
            Self::Box([x, y, z]) => 8.0 * x * y * z,
            Self::Ellipsoid([x, y, z]) => 4.0 / 3.0 * PI * x * y * z,
        }
    }

    /// Moments of inertia of the solid shape of unit mass about its centre and axes (m²).
    fn moments(&self) -> [f64; 3] {
        match *self {
            Self::Sphere { radius } => [0.4 * radius * radius; 3],
            Self::Capsule { radius: r, half: h } => {
                // A cylinder and two half balls, weighted by their volumes.
                let ball = 4.0 * r / (4.0 * r + 6.0 * h);
                let across = (1.0 - ball) * (3.0 * r * r + 4.0 * h * h) / 12.0
                    + ball * (0.4 * r * r + h * h + 0.75 * h * r);
                let along = (1.0 - ball) * r * r / 2.0 + ball * 0.4 * r * r;
                [across, across, along]
            }
            Self::Cylinder { radius: r, half: h } => {
                let across = (3.0 * r * r + 4.0 * h * h) / 12.0;
                [across, across, r * r / 2.0]
            }
            Self::Box(half) => box_like(half, 3.0),
            Self::Ellipsoid(half) => box_like(half, 5.0),
        }
    }

    /// Radius about the z axis and half height of the shape (m).
    pub fn extent(&self) -> (f64, f64) {
        match *self {
            Self::Sphere { radius } => (radius, radius),
            Self::Capsule { radius, half } => (radius, half + radius),
            Self::Cylinder { radius, half } => (radius, half),
            Self::Box([x, y, z]) | Self::Ellipsoid([x, y, z]) => (x.max(y), z),
        }
    }
}

fn box_like([x, y, z]: [f64; 3], divisor: f64) -> [f64; 3] {
    [y * y + z * z, z * z + x * x, x * x + y * y].map(|sum| sum / divisor)
}

impl Geom {
    /// Whether it is nothing but something to touch with: a sphere that is said to have no mass.
    pub fn is_bead(&self) -> bool {
        matches!(self.shape, Shape::Sphere { .. }) && self.mass == GeomMass::Mass(0.0)
    }

    pub fn read(attributes: &Attributes<'_>, compiler: &Compiler) -> Result<Self, ImportError> {
        let known = [
            "type",
            "size",
            "fromto",
            "mass",
            "density",
            "contype",
            "conaffinity",
            "condim",
            "group",
            "priority",
            "friction",
            "solmix",
            "solref",
            "solimp",
            "margin",
            "gap",
            "rgba",
            "material",
            "shellinertia",
        ];
        attributes.only(&[&known[..], &POSE[..]].concat(), &["fluidshape"])?;
        if attributes
            .text("shellinertia")
            .is_some_and(|shell| shell != "false")
        {
            return Err(attributes.refuse("shellinertia", "expected false: solid shapes"));
        }
        let (shape, pose) = read_shape(attributes, compiler)?;
        let mass = match attributes.not_negative("mass")? {
            Some(mass) => GeomMass::Mass(mass),
            // MuJoCo's default density is that of water.
            None => GeomMass::Density(attributes.not_negative("density")?.unwrap_or(1000.0)),
        };
        Ok(Self { shape, pose, mass })
    }

    pub fn part(&self) -> PartMass {
        let mass = match self.mass {
            GeomMass::Density(density) => density * self.shape.volume(),
            GeomMass::Mass(mass) => mass,
        };
        let turn = self.pose.rotation.to_rotation_matrix();
        let moments = Matrix3::from_diagonal(&Vector3::from(self.shape.moments())) * mass;
        PartMass {
            mass,
            center: self.pose.translation.vector,
            inertia: turn * moments * turn.inverse(),
        }
    }
}

pub(super) fn read_shape(
    attributes: &Attributes<'_>,
    compiler: &Compiler,
) -> Result<(Shape, Isometry3<f64>), ImportError> {
    let kind = attributes.text("type").unwrap_or("sphere");
    let count = match kind {
        "sphere" => 1,
        "capsule" | "cylinder" => 2,
        "box" | "ellipsoid" => 3,
        _ => {
            let expected = "expected sphere, capsule, cylinder, box or ellipsoid";
            return Err(attributes.refuse("type", expected));
        }
    };
    let mut pose = compiler.pose(attributes)?;
    let mut size = attributes.list("size")?.unwrap_or_default();
    if let Some([a, b, c, d, e, f]) = attributes.numbers("fromto")? {
        if count != 2 {
            return Err(attributes.refuse("fromto", "expected on a capsule or a cylinder alone"));
        }
        let (from, to) = (Vector3::new(a, b, c), Vector3::new(d, e, f));
        let length = (to - from).norm();
        let Some(axis) = (from - to).try_normalize(1e-10) else {
            return Err(attributes.refuse("fromto", "expected two points that differ"));
        };
        pose = Isometry3::from_parts(((from + to) / 2.0).into(), turn_to(&axis));
        size.truncate(1);
        size.push(length / 2.0);
    }
    let expected = || attributes.refuse("size", format!("expected {count} numbers above 0"));
    if size.len() < count || size[..count].iter().any(|length| *length <= 0.0) {
        return Err(expected());
    }
    let shape = match (kind, size.as_slice()) {
        ("sphere", &[radius, ..]) => Shape::Sphere { radius },
        ("capsule", &[radius, half, ..]) => Shape::Capsule { radius, half },
        ("cylinder", &[radius, half, ..]) => Shape::Cylinder { radius, half },
        ("box", &[x, y, z, ..]) => Shape::Box([x, y, z]),
        (_, &[x, y, z, ..]) => Shape::Ellipsoid([x, y, z]),
        _ => return Err(expected()),
    };
    Ok((shape, pose))
}

impl PartMass {
    /// What an `inertial` says.
    pub fn read(attributes: &Attributes<'_>, compiler: &Compiler) -> Result<Self, ImportError> {
        attributes.only(
            &[&["mass", "diaginertia", "fullinertia"], &POSE[..]].concat(),
            &[],
        )?;
        let pose = compiler.pose(attributes)?;
        let Some(mass) = attributes.not_negative("mass")? else {
            return Err(attributes.refuse_element("expected an attribute `mass`"));
        };
        let full = attributes.numbers::<6>("fullinertia")?;
        let inertia = match (attributes.numbers::<3>("diaginertia")?, full) {
            (Some(moments), None) => Matrix3::from_diagonal(&moments.into()),
            (None, Some([xx, yy, zz, xy, xz, yz])) => {
                Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
            }
            _ => {
                let reason = "expected one of the attributes `diaginertia` and `fullinertia`";
                return Err(attributes.refuse_element(reason));
            }
        };
        let turn = pose.rotation.to_rotation_matrix();
        Ok(Self {
            mass,
            center: pose.translation.vector,
            inertia: turn * inertia * turn.inverse(),
        })
    }

    /// The same mass seen from the frame in which its own is at `pose`.
    pub fn moved(&self, pose: &Isometry3<f64>) -> Self {
        let turn = pose.rotation.to_rotation_matrix();
        Self {
            mass: self.mass,
            center: (pose * nalgebra::Point3::from(self.center)).coords,
            inertia: turn * self.inertia * turn.inverse(),
        }
    }

    /// All parts as one (parallel axes, e.g. Goldstein, Classical Mechanics, ch. 5).
    pub fn sum(parts: &[Self]) -> Self {
        if let [part] = parts {
            return part.clone();
        }
        let mass: f64 = parts.iter().map(|part| part.mass).sum();
        let moment: Vector3<f64> = parts.iter().map(|part| part.center * part.mass).sum();
        let center = if mass > 0.0 {
            moment / mass
        } else {
            Vector3::zeros()
        };
        let about_center = |part: &Self| {
            let arm = part.center - center;
            let steiner = Matrix3::identity() * arm.norm_squared() - arm * arm.transpose();
            part.inertia + steiner * part.mass
        };
        Self {
            mass,
            center,
            inertia: parts.iter().map(about_center).sum(),
        }
    }
}

//! Poses as MuJoCo's attributes give them.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::attributes::Attributes;
use super::document::Document;
use crate::formats::ImportError;

/// What lies closer than this lies together (m).
pub(super) const SAME_PLACE: f64 = 1e-9;
/// Deviation of a direction from an axis, and of stiffnesses from one another (relative), that counts
/// as none.
pub(super) const SAME: f64 = 1e-9;

/// Attributes that give a pose.
pub(super) const POSE: [&str; 6] = ["pos", "quat", "axisangle", "euler", "xyaxes", "zaxis"];

/// What the element `compiler` says of the whole model.
#[derive(Debug, PartialEq)]
pub(super) struct Compiler {
    /// Radians in the unit of angles.
    angle_unit: f64,
    /// Axes of successive Euler turns; lower case turns with the body, upper case stays.
    euler_sequence: [char; 3],
    /// Whether a range implies its limit.
    pub auto_limits: bool,
    pub inertia_from_geom: InertiaFromGeom,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum InertiaFromGeom {
    Always,
    Never,
    WhereNotGiven,
}

impl Compiler {
    pub fn of(document: &Document) -> Result<Self, ImportError> {
        let mut compiler = Self {
            angle_unit: std::f64::consts::PI / 180.0,
            euler_sequence: ['x', 'y', 'z'],
            auto_limits: true,
            inertia_from_geom: InertiaFromGeom::WhereNotGiven,
        };
        for (index, _) in document.sections("compiler") {
            compiler.read(&Attributes::own(document, index))?;
        }
        Ok(compiler)
    }

    fn read(&mut self, attributes: &Attributes<'_>) -> Result<(), ImportError> {
        attributes.only(
            &[
                "angle",
                "eulerseq",
                "autolimits",
                "inertiafromgeom",
                "coordinate",
                "balanceinertia",
                "inertiagrouprange",
                "settotalmass",
                "strippath",
                "meshdir",
                "texturedir",
                "assetdir",
                "discardvisual",
                "fusestatic",
                "convexhull",
                "usethread",
                "saveinertial",
                "alignfree",
                "exactmeshinertia",
                "conflict",
            ],
            &["boundmass", "boundinertia"],
        )?;
        match attributes.text("angle") {
            None => {}
            Some("radian") => self.angle_unit = 1.0,
            Some("degree") => self.angle_unit = std::f64::consts::PI / 180.0,
            Some(_) => return Err(attributes.refuse("angle", "expected degree or radian")),
        }
        if let Some(sequence) = attributes.text("eulerseq") {
            let axes: Vec<char> = sequence.chars().collect();
            self.euler_sequence = (axes.try_into().ok())
                .filter(|axes: &[char; 3]| axes.iter().all(|axis| "xyzXYZ".contains(*axis)))
                .ok_or_else(|| attributes.refuse("eulerseq", "expected three of xyzXYZ"))?;
        }
        match attributes.text("autolimits") {
            None => {}
            Some("true") => self.auto_limits = true,
            Some("false") => self.auto_limits = false,
            Some(_) => return Err(attributes.refuse("autolimits", "expected true or false")),
        }
        match attributes.text("inertiafromgeom") {
            None => {}
            Some("true") => self.inertia_from_geom = InertiaFromGeom::Always,
            Some("false") => self.inertia_from_geom = InertiaFromGeom::Never,
            Some("auto") => self.inertia_from_geom = InertiaFromGeom::WhereNotGiven,
            Some(_) => {
                return Err(attributes.refuse("inertiafromgeom", "expected true, false or auto"));
            }
        }
        for (name, usual) in [
            ("coordinate", "local"),
            ("balanceinertia", "false"),
            ("inertiagrouprange", "0 5"),
            ("settotalmass", "-1"),
        ] {
            if attributes.text(name).is_some_and(|value| value != usual) {
                return Err(attributes.refuse(name, format!("expected {usual}")));
            }
        }
        Ok(())
    }

    /// An angle of the model in radians.
    pub fn angle(&self, angle: f64) -> f64 {
        angle * self.angle_unit
    }

    /// The pose that an element's attributes give, in the frame of the element it stands in.
    pub fn pose(&self, attributes: &Attributes<'_>) -> Result<Isometry3<f64>, ImportError> {
        let position = attributes.numbers::<3>("pos")?.unwrap_or_default();
        Ok(Isometry3::from_parts(
            Translation3::from(Vector3::from(position)),
            self.orientation(attributes)?,
        ))
    }

    fn orientation(&self, attributes: &Attributes<'_>) -> Result<UnitQuaternion<f64>, ImportError> {
        let Some(name) = attributes.first_of(&POSE[1..]) else {
            return Ok(UnitQuaternion::identity());
        };
        let degenerate = || attributes.refuse(name, "expected directions that are not zero");
        let direction = |v: Vector3<f64>| v.try_normalize(1e-10).ok_or_else(degenerate);
        match name {
            "quat" => {
                let [w, x, y, z] = attributes.numbers(name)?.unwrap_or_default();
                let q = nalgebra::Quaternion::new(w, x, y, z);
                UnitQuaternion::try_new(q, 1e-10).ok_or_else(degenerate)
            }
            "axisangle" => {
                let [x, y, z, angle] = attributes.numbers(name)?.unwrap_or_default();
                let axis = direction(Vector3::new(x, y, z))?;
                Ok(UnitQuaternion::from_scaled_axis(
                    axis * angle * self.angle_unit,
                ))
            }
            "euler" => {
                let angles: [f64; 3] = attributes.numbers(name)?.unwrap_or_default();
                Ok(self.euler(angles))
            }
            "zaxis" => {
                let z = direction(attributes.numbers::<3>(name)?.unwrap_or_default().into())?;
                Ok(turn_to(&z))
            }
            _ => {
                let [a, b, c, d, e, f] = attributes.numbers(name)?.unwrap_or_default();
                let x = direction(Vector3::new(a, b, c))?;
                let y = Vector3::new(d, e, f);
                let y = direction(y - x * x.dot(&y))?;
                let axes = Matrix3::from_columns(&[x, y, x.cross(&y)]);
                let rotation = Rotation3::from_matrix_unchecked(axes);
                Ok(UnitQuaternion::from_rotation_matrix(&rotation))
            }
        }
    }

    fn euler(&self, angles: [f64; 3]) -> UnitQuaternion<f64> {
        let mut q = UnitQuaternion::identity();
        for (axis, angle) in self.euler_sequence.iter().zip(angles) {
            let direction = match axis.to_ascii_lowercase() {
                'x' => Vector3::x_axis(),
                'y' => Vector3::y_axis(),
                _ => Vector3::z_axis(),
            };
            let turn = UnitQuaternion::from_axis_angle(&direction, angle * self.angle_unit);
            q = if axis.is_ascii_lowercase() {
                q * turn
            } else {
                turn * q
            };
        }
        q
    }
}

/// The smallest turn that takes the z axis to the unit vector `z`.
pub(super) fn turn_to(z: &Vector3<f64>) -> UnitQuaternion<f64> {
    let half_turn = || UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    UnitQuaternion::rotation_between(&Vector3::z(), z).unwrap_or_else(half_turn)
}

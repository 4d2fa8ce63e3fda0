//! The columns of measured points and poses.

use nalgebra::{Isometry3, Rotation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use tdcr_sim::inverse::recording::Marker;

use super::rotation::{quaternion, upright};
use super::servo_column::PullUnit;

/// The columns of a measured point, or of a measured pose.
///
/// An orientation counts as two more points, `lever` from the first along the marker's x and y axes: so a turn of 1 rad counts as a
/// miss of `lever`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MarkerColumns {
    /// Where it is: `"tip"`, or a disc's number from 0 at the base.
    pub disc: DiscName,
    /// Columns of x, y and z.
    pub columns: [String; 3],
    /// Their unit: `m`, `cm`, `mm` or `um`.
    pub unit: PullUnit,
    /// The point in the disc's frame (m).
    #[serde(default)]
    pub place: [f64; 3],
    /// Columns of the orientation, a quaternion (w, x, y, z), normalised on use; without them the point alone was measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub orientation: Option<[String; 4]>,
    /// Orientation of the marker in the disc's frame: a quaternion (w, x, y, z), normalised on use.
    #[serde(default = "upright", skip_serializing_if = "is_upright")]
    pub turn: [f64; 4],
    /// Length by which orientations count (m).
    #[serde(default = "lever", skip_serializing_if = "is_lever")]
    pub lever: f64,
}

/// A disc by its number, or the last one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected \"tip\" or a disc's number")]
pub enum DiscName {
    /// From 0 at the base.
    Number(usize),
    /// `"tip"`.
    Name(String),
}

/// The lever where the file does not give it (m): a turn of 3 degrees counts as a millimetre.
const LEVER: f64 = 0.02;

impl MarkerColumns {
    pub(super) fn check(&self, discs: usize) -> Result<(), String> {
        if self.unit.metres().is_none() {
            return Err("its unit is one of m, cm, mm and um".to_owned());
        }
        if self.place.iter().chain(&self.turn).any(|x| !x.is_finite()) || self.turn == [0.0; 4] {
            return Err("`place` and `turn` have finite numbers, and a `turn` is not 0".to_owned());
        }
        if !(self.lever > 0.0 && self.lever.is_finite()) {
            return Err(format!("lever = {}; expected a length above 0", self.lever));
        }
        match &self.disc {
            DiscName::Name(name) if name != "tip" => Err(format!(
                "disc is `{name}`; expected \"tip\" or a disc's number"
            )),
            DiscName::Number(disc) if *disc >= discs => Err(format!(
                "disc is {disc}; the robot has discs 0 to {}",
                discs - 1
            )),
            _ => Ok(()),
        }
    }

    /// Points that it counts as: from the marker, in its own frame (m).
    pub(super) fn arms(&self) -> Vec<Vector3<f64>> {
        let mut arms = vec![Vector3::zeros()];
        if self.orientation.is_some() {
            arms.extend([Vector3::x() * self.lever, Vector3::y() * self.lever]);
        }
        arms
    }

    /// The same as points of a robot whose last disc is `tip`.
    pub(super) fn points(&self, tip: usize) -> Vec<Marker> {
        let disc = match self.disc {
            DiscName::Number(disc) => disc,
            DiscName::Name(_) => tip,
        };
        let turn = quaternion(self.turn);
        let point = |arm: Vector3<f64>| Marker {
            disc,
            place: Vector3::from(self.place) + turn * arm,
        };
        self.arms().into_iter().map(point).collect()
    }

    /// Takes its points from `places` (m, the disc's frame): the pose whose points they are, or nearly.
    pub(super) fn set_points(&mut self, places: &mut impl Iterator<Item = Vector3<f64>>) {
        let found: Vec<Vector3<f64>> = places.take(self.arms().len()).collect();
        let Some(origin) = found.first() else { return };
        self.place = (*origin).into();
        if let [_, x, y] = found[..]
            && let Some(turn) = axes(x - origin, y - origin)
        {
            self.turn = [turn.w, turn.i, turn.j, turn.k];
        }
    }

    /// What was measured, in the world (m): columns x, y, z, and the orientation where there is one; `frame` is the recording's.
    pub(super) fn measured(
        &self,
        frame: &Isometry3<f64>,
        position: [f64; 3],
        orientation: Option<[f64; 4]>,
    ) -> Result<Vec<Vector3<f64>>, String> {
        let unit = self.unit.metres().unwrap_or(1.0);
        let origin = Vector3::from(position) * unit;
        let turn = match orientation {
            None => UnitQuaternion::identity(),
            Some([0.0, 0.0, 0.0, 0.0]) => {
                let columns = self.orientation.as_ref().map(|names| names.join(", "));
                let columns = columns.unwrap_or_default();
                return Err(format!("{columns} are all 0; expected a quaternion"));
            }
            Some(numbers) => quaternion(numbers),
        };
        let arms = self.arms().into_iter();
        let points = arms.map(|arm| origin + turn * arm);
        Ok(points
            .map(|point| frame.rotation * point + frame.translation.vector)
            .collect())
    }
}

/// The rotation whose x axis is along `x`, and whose y axis is as near to `y` as can be; none where they are on one line.
fn axes(x: Vector3<f64>, y: Vector3<f64>) -> Option<UnitQuaternion<f64>> {
    let x = x.try_normalize(0.0)?;
    let y = (y - x * x.dot(&y)).try_normalize(0.0)?;
    let rotation = Rotation3::from_basis_unchecked(&[x, y, x.cross(&y)]);
    Some(UnitQuaternion::from_rotation_matrix(&rotation))
}

fn lever() -> f64 {
    LEVER
}

fn is_lever(length: &f64) -> bool {
    *length == LEVER
}

fn is_upright(turn: &[f64; 4]) -> bool {
    *turn == upright()
}

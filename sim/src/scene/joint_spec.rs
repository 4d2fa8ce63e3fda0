//! Joints between an object and the world, as the user writes them, and as files have them.

use serde::{Deserialize, Serialize};

use super::SceneError;
use super::checks::{is_direction, not_negative, point};
use super::error::refuse;

/// The one motion that an object with a joint has. Position 0 is where the file has the object.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(
    rename_all = "snake_case",
    expecting = "{ hinge = { axis, ... } } or { slider = { axis, ... } }"
)]
pub enum JointSpec {
    /// It turns about an axis, like a door.
    Hinge(HingeSpec),
    /// It moves along an axis, like a drawer.
    Slider(SliderSpec),
}

/// A hinge between an object and the world.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(
    deny_unknown_fields,
    expecting = "a table { axis, anchor, limits, damping }"
)]
pub struct HingeSpec {
    /// Direction of the axis in the object's frame; normalised on use.
    pub axis: [f64; 3],
    /// A point on it in the object's frame (m).
    #[serde(default, skip_serializing_if = "is_origin")]
    pub anchor: [f64; 3],
    /// Smallest and largest angle (rad), 0 in between, within half a turn; `None` for a hinge that turns on and on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limits: Option<[f64; 2]>,
    /// Viscous damping (N m s/rad).
    #[serde(default, skip_serializing_if = "is_zero")]
    pub damping: f64,
}

/// A slider between an object and the world.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table { axis, limits, damping }")]
pub struct SliderSpec {
    /// Direction in the object's frame; normalised on use.
    pub axis: [f64; 3],
    /// Smallest and largest way along it (m), 0 in between; `None` for one without an end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limits: Option<[f64; 2]>,
    /// Viscous damping (N s/m).
    #[serde(default, skip_serializing_if = "is_zero")]
    pub damping: f64,
}

/// Largest angle of a hinge's limits (rad): beyond half a turn two positions are one.
const HALF_TURN: f64 = std::f64::consts::PI;

impl JointSpec {
    /// Direction of its axis in the object's frame, as it was given.
    pub fn axis(&self) -> [f64; 3] {
        match self {
            Self::Hinge(hinge) => hinge.axis,
            Self::Slider(slider) => slider.axis,
        }
    }

    /// Checks its numbers; errors name the `obstacle`.
    pub(super) fn check(&self, obstacle: &str) -> Result<(), SceneError> {
        let (kind, limits, damping, most) = match self {
            Self::Hinge(hinge) => {
                point(obstacle, "joint.hinge.anchor", &hinge.anchor)?;
                ("hinge", hinge.limits, hinge.damping, HALF_TURN)
            }
            Self::Slider(slider) => ("slider", slider.limits, slider.damping, 1e6),
        };
        let field = |name: &str| format!("joint.{kind}.{name}");
        let axis = self.axis();
        if !is_direction(&axis) {
            let expected = "three finite numbers, not all 0";
            return Err(refuse(
                obstacle,
                &field("axis"),
                format!("{axis:?}"),
                expected,
            ));
        }
        if let Some([low, high]) = limits
            && !(-most <= low && low <= 0.0 && 0.0 <= high && high <= most && low < high)
        {
            let expected = match self {
                Self::Hinge(_) => {
                    "[smallest, largest] with 0 in between, within half a turn (pi rad)"
                }
                Self::Slider(_) => "[smallest, largest] with 0 in between, within 1e6 m",
            };
            let found = format!("{:?}", [low, high]);
            return Err(refuse(obstacle, &field("limits"), found, expected));
        }
        not_negative(obstacle, &field("damping"), damping)
    }
}

fn is_origin(position: &[f64; 3]) -> bool {
    *position == [0.0; 3]
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

//! Tendons in a robot's specification: drives, friction, routes.

use serde::{Deserialize, Serialize};

/// A tendon and its drive.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TendonSpec {
    /// What a command means to the tendon.
    pub drive: Drive,
    /// Smallest and largest command (m, or N for a tension drive).
    pub range: [f64; 2],
    /// Whether the tendon can push.
    #[serde(default, skip_serializing_if = "is_bilateral")]
    pub pull: Pull,
    /// Axial stiffness of the tendon itself (N/m), in series with the servo's; inextensible where
    /// the file does not give it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axial_stiffness: Option<f64>,
    /// Growth of that stiffness, in series with the servo's, per stretch (1/m): stretched by `s`, the tendon pulls with
    /// `k s (1 + stiffening s)`.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub stiffening: f64,
    /// Friction in the holes; none where the file does not give it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<Friction>,
    /// What the servo cannot do at once, or at all; an ideal servo where the file does not give it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub servo: Option<ServoSpec>,
}

/// Limits of the servo that drives a tendon. In motion the command that acts on the tendon, `u`, follows the one given, `c`, as
/// `du/dt = (c - u) / lag`, never faster than `rate`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ServoSpec {
    /// Time constant of the first-order lag (s); acts in motion.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub lag: f64,
    /// Largest rate of the acting command (m/s, or N/s for a tension drive); acts in motion. None where the file does not give it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate: Option<f64>,
    /// Largest force that the drive exerts on the tendon (N), pulling or pushing, in motion and at rest. None where the file does not
    /// give it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub largest_force: Option<f64>,
}

impl ServoSpec {
    /// Whether the acting command takes time to follow the one given.
    pub fn follows(&self) -> bool {
        self.lag > 0.0 || self.rate.is_some()
    }
}

/// What a command means to a tendon of length `L`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Drive {
    /// A rest length `c` (m), through the servo's gain kp (N/m): the tension is `kp (L - c)`.
    Gain(f64),
    /// The length itself (m): `L = c`, by whatever tension it takes.
    Length,
    /// The tension (N), whatever the length.
    Tension,
}

/// Whether a tendon can push.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Pull {
    /// It pulls and pushes, as MuJoCo's position actuator does.
    #[default]
    Bilateral,
    /// It only pulls, and is slack when shorter than commanded.
    TensionOnly,
}

/// Friction of a tendon in its holes (capstan law): over a hole at which it turns by the angle
/// `theta`, its tension may change by a factor up to `exp(mu theta)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Friction {
    /// Coefficient of friction `mu`.
    pub coefficient: f64,
    /// Stiffness of a sticking contact (N/m): before it slips, the tendon gives way by the friction
    /// force divided by this.
    #[serde(default = "contact_stiffness")]
    pub contact_stiffness: f64,
}

impl Friction {
    /// None, on contacts as stiff as where the file does not say.
    pub const NONE: Self = Self {
        coefficient: 0.0,
        contact_stiffness: CONTACT_STIFFNESS,
    };
}

impl TendonSpec {
    /// Gives the tendon a coefficient of friction, on contacts as stiff as they were.
    pub fn set_friction(&mut self, coefficient: f64) {
        self.friction = Some(Friction {
            coefficient,
            ..self.friction.unwrap_or(Friction::NONE)
        });
    }

    /// Whether a command leaves the tendon a stretch: by its drive's gain, or by its own axial stiffness.
    pub fn stretches(&self) -> bool {
        match self.drive {
            Drive::Gain(_) => true,
            Drive::Length => self.axial_stiffness.is_some(),
            Drive::Tension => false,
        }
    }
}

/// A tendon with a route of its own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RouteSpec {
    /// The holes it goes through, from the servo to where it is fastened; at least two.
    pub through: Vec<Waypoint>,
    /// The tendon.
    pub tendon: TendonSpec,
}

/// A hole on a tendon's route, in files `[body, hole]`: the hole's number in its body's list.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Waypoint(pub Body, pub usize);

/// The joints that a route spans, from its lowest to its highest.
pub(crate) fn joints_along(route: &[Waypoint]) -> std::ops::Range<usize> {
    // Joint `i` lies below disc `i`: a route between discs `a < b` spans the joints `a + 1` to `b`.
    let height = |waypoint: &Waypoint| match waypoint.0 {
        Body::Base => 0,
        Body::Disc(disc) => disc + 1,
    };
    let low = route.iter().map(height).min().unwrap_or(0);
    let high = route.iter().map(height).max().unwrap_or(0);
    low..high
}

/// A body of the robot; in files `"base"`, or the disc's number counted from the base.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "BodyName", into = "BodyName")]
pub enum Body {
    /// The fixed base.
    Base,
    /// Disc `i`, from 0 at the base.
    Disc(usize),
}

#[derive(Serialize, Deserialize)]
#[serde(untagged, expecting = "expected \"base\" or a disc's number")]
enum BodyName {
    Disc(usize),
    Name(String),
}

impl TryFrom<BodyName> for Body {
    type Error = String;

    fn try_from(name: BodyName) -> Result<Self, String> {
        match name {
            BodyName::Disc(index) => Ok(Self::Disc(index)),
            BodyName::Name(name) if name == "base" => Ok(Self::Base),
            BodyName::Name(name) => Err(format!(
                "unknown body `{name}`: expected \"base\" or a disc's number"
            )),
        }
    }
}

impl From<Body> for BodyName {
    fn from(body: Body) -> Self {
        match body {
            Body::Base => Self::Name("base".to_owned()),
            Body::Disc(index) => Self::Disc(index),
        }
    }
}

fn is_bilateral(pull: &Pull) -> bool {
    *pull == Pull::Bilateral
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// Stiffness of contacts where the file does not give it (N/m).
const CONTACT_STIFFNESS: f64 = 1e5;

fn contact_stiffness() -> f64 {
    CONTACT_STIFFNESS
}

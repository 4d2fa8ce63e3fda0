//! The cameras of a robot's specification.

use std::f64::consts::TAU;
use std::fmt;

use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use super::angle;
use super::checks::{finite, positive, radians};
use super::{SpecError, spec_error::refuse};
use crate::lens::{Distortion, Intrinsics};

const MAX_CAMERAS: usize = 1000;
const MAX_IMAGE_SIDE: u32 = 16_384;

/// The cameras that watch a robot: in files a table `[cameras]` for a ring, or a table
/// `[[cameras]]` for each camera with a place of its own.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Cameras {
    /// Equal cameras on a circle.
    Ring(RingSpec),
    /// 1 to 1000 cameras, each with its own place and lens.
    Free(Vec<CameraSpec>),
}

/// Equal cameras on a circle around the z axis, pitched down, the first at `(0, -radius)`. Files may
/// give `pitch_degrees` in place of `pitch`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RingInFile")]
pub struct RingSpec {
    /// Number of cameras, evenly spaced.
    pub count: usize,
    /// Radius of the circle (m).
    pub radius: f64,
    /// Height of the circle in the world frame (m).
    pub height: f64,
    /// Angle of the optical axes below horizontal (rad).
    pub pitch: f64,
    /// Vertical field of view without distortion (degrees).
    pub fovy: f64,
    /// Image width and height (pixels).
    pub resolution: [u32; 2],
    /// Distortion of the lenses; none where the file does not give it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distortion: Option<Distortion>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RingInFile {
    count: usize,
    radius: f64,
    height: f64,
    pitch: Option<f64>,
    pitch_degrees: Option<f64>,
    fovy: f64,
    resolution: [u32; 2],
    distortion: Option<Distortion>,
}

impl TryFrom<RingInFile> for RingSpec {
    type Error = String;

    fn try_from(file: RingInFile) -> Result<Self, String> {
        let names = ["pitch", "pitch_degrees"];
        Ok(Self {
            count: file.count,
            radius: file.radius,
            height: file.height,
            pitch: angle::required(file.pitch, file.pitch_degrees, names, f64::to_radians)?,
            fovy: file.fovy,
            resolution: file.resolution,
            distortion: file.distortion,
        })
    }
}

/// A camera with a place of its own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraSpec {
    /// Centre of projection in the world frame (m).
    pub position: [f64; 3],
    /// Where it looks.
    pub aim: Aim,
    /// Its lens.
    pub lens: Lens,
    /// Image width and height (pixels).
    pub resolution: [u32; 2],
    /// Distortion of the lens; none where the file does not give it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distortion: Option<Distortion>,
}

/// Where a camera looks.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Aim {
    /// At a point of the world (m), the horizon level.
    At([f64; 3]),
    /// Orientation of the camera frame (x right, y down, z along the optical axis) in the world: a
    /// quaternion (w, x, y, z), normalised on use.
    Orientation([f64; 4]),
}

/// How wide a camera sees, distortion apart.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Lens {
    /// Vertical field of view (degrees), of square pixels and a principal point at the centre.
    Fovy(f64),
    /// Focal lengths and principal point, as calibrations find them.
    Pixels(PinholeSpec),
}

/// A calibrated pinhole.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PinholeSpec {
    /// Focal lengths, horizontal and vertical (pixels).
    pub focal: [f64; 2],
    /// Column and row of the principal point, pixel centres at integers (pixels).
    pub principal: [f64; 2],
}

impl Lens {
    /// The intrinsics of a camera with this lens.
    pub fn intrinsics(
        &self,
        [width, height]: [u32; 2],
        distortion: Option<Distortion>,
    ) -> Intrinsics {
        let pinhole = match *self {
            Self::Fovy(degrees) => Intrinsics::from_fovy(width, height, degrees.to_radians()),
            Self::Pixels(PinholeSpec { focal, principal }) => Intrinsics {
                width,
                height,
                fx: focal[0],
                fy: focal[1],
                cx: principal[0],
                cy: principal[1],
                distortion: None,
            },
        };
        Intrinsics {
            distortion,
            ..pinhole
        }
    }

    fn validate(&self, at: &dyn Fn(&str) -> String) -> Result<(), SpecError> {
        match self {
            Self::Fovy(degrees) => check_fovy(&at("lens.fovy"), *degrees),
            Self::Pixels(pinhole) => {
                for focal in pinhole.focal {
                    positive(&at("lens.pixels.focal"), focal)?;
                }
                finite(&at("lens.pixels.principal"), &pinhole.principal)
            }
        }
    }
}

/// The paper's pitch of the cameras (rad), and its ring's radius in lengths of the robot.
const PITCH: f64 = 0.1973;
const DISTANCE: f64 = 3.0;

impl Cameras {
    /// Eight cameras around a robot, in the proportions of the paper's rings: on a circle of three
    /// times the robot's `length` (m) around the vertical through the `base` (m), pitched down by
    /// 0.1973 rad, so high that they look at the base; field of view 45 degrees.
    ///
    /// A [`RingSpec`] where the base stands on the world's z axis, and otherwise the same cameras
    /// each with a place of its own.
    pub fn around(base: [f64; 3], length: f64, resolution: [u32; 2]) -> Self {
        let [x, y, z] = base;
        let radius = DISTANCE * length;
        let ring = RingSpec {
            count: 8,
            radius,
            height: z + radius * PITCH.tan(),
            pitch: PITCH,
            fovy: 45.0,
            resolution,
            distortion: None,
        };
        if [x, y] == [0.0; 2] {
            return Self::Ring(ring);
        }
        let camera = |index: usize| {
            // As the ring's: the first at (0, -radius), the others counterclockwise from there.
            let (sin, cos) = (TAU * index as f64 / ring.count as f64).sin_cos();
            CameraSpec {
                position: [x + radius * sin, y - radius * cos, ring.height],
                aim: Aim::At(base),
                lens: Lens::Fovy(ring.fovy),
                resolution,
                distortion: None,
            }
        };
        Self::Free((0..ring.count).map(camera).collect())
    }

    /// Number of cameras.
    pub fn count(&self) -> usize {
        match self {
            Self::Ring(ring) => ring.count,
            Self::Free(cameras) => cameras.len(),
        }
    }

    /// Whether there can be such cameras.
    ///
    /// # Errors
    /// [`SpecError`] names the field that is wrong, such as `cameras[0].lens.fovy`, and what would be right.
    pub fn validate(&self) -> Result<(), SpecError> {
        match self {
            Self::Ring(ring) => ring.validate(),
            Self::Free(cameras) if (1..=MAX_CAMERAS).contains(&cameras.len()) => {
                (cameras.iter()).enumerate().try_for_each(|(index, c)| {
                    c.validate(&|field| format!("cameras[{index}].{field}"))
                })
            }
            Self::Free(cameras) => {
                let found = format!("a list of {}", cameras.len());
                Err(refuse("cameras", found, "1 to 1000 cameras"))
            }
        }
    }
}

impl RingSpec {
    fn validate(&self) -> Result<(), SpecError> {
        let at = |field: &str| format!("cameras.{field}");
        if !(1..=MAX_CAMERAS).contains(&self.count) {
            return Err(refuse(&at("count"), self.count, "1 to 1000"));
        }
        positive(&at("radius"), self.radius)?;
        finite(&at("height"), &[self.height])?;
        radians(&at("pitch"), &[self.pitch], "pitch_degrees")?;
        check_fovy(&at("fovy"), self.fovy)?;
        check_image(
            &at,
            &Lens::Fovy(self.fovy),
            self.resolution,
            self.distortion,
        )
    }
}

impl CameraSpec {
    fn validate(&self, at: &dyn Fn(&str) -> String) -> Result<(), SpecError> {
        finite(&at("position"), &self.position)?;
        match self.aim {
            Aim::At(target) => {
                finite(&at("aim.at"), &target)?;
                let distance = (0..3).map(|k| (target[k] - self.position[k]).abs());
                if distance.fold(0.0, f64::max) < 1e-6 {
                    let expected = "a point away from the camera's position";
                    return Err(refuse(&at("aim.at"), format!("{target:?}"), expected));
                }
            }
            Aim::Orientation(quaternion) => {
                finite(&at("aim.orientation"), &quaternion)?;
                if quaternion.iter().all(|x| x.abs() < 1e-6) {
                    let (field, found) = (at("aim.orientation"), format!("{quaternion:?}"));
                    return Err(refuse(&field, found, "a quaternion (w, x, y, z)"));
                }
            }
        }
        self.lens.validate(at)?;
        check_image(at, &self.lens, self.resolution, self.distortion)
    }
}

fn check_fovy(field: &str, degrees: f64) -> Result<(), SpecError> {
    if degrees > 0.0 && degrees < 180.0 {
        return Ok(());
    }
    Err(refuse(field, degrees, "degrees between 0 and 180"))
}

fn check_image(
    at: &dyn Fn(&str) -> String,
    lens: &Lens,
    resolution: [u32; 2],
    distortion: Option<Distortion>,
) -> Result<(), SpecError> {
    let fits = |side: &u32| (1..=MAX_IMAGE_SIDE).contains(side);
    if !resolution.iter().all(fits) {
        let found = format!("{resolution:?}");
        let expected = "[width, height], 1 to 16384 pixels each";
        return Err(refuse(&at("resolution"), found, expected));
    }
    let Some(coefficients) = distortion else {
        return Ok(());
    };
    let field = at("distortion");
    finite(&field, &coefficients.coefficients())?;
    if !lens
        .intrinsics(resolution, distortion)
        .sees_each_direction_once()
    {
        let found = format!("{:?}", coefficients.coefficients());
        let expected = "k1, k2, p1, p2, k3 of a lens that folds no part of the image over another";
        return Err(refuse(&field, found, expected));
    }
    Ok(())
}

// A table is a ring and a list is free cameras, so that an error within either names its field: an
// untagged enum would only say that neither fits.
impl<'de> Deserialize<'de> for Cameras {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct TableOrList;

        impl<'de> Visitor<'de> for TableOrList {
            type Value = Cameras;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("a table with a ring of cameras, or a list with a table per camera")
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Cameras, A::Error> {
                RingSpec::deserialize(MapAccessDeserializer::new(map)).map(Cameras::Ring)
            }

            fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<Cameras, A::Error> {
                Vec::deserialize(SeqAccessDeserializer::new(list)).map(Cameras::Free)
            }
        }

        deserializer.deserialize_any(TableOrList)
    }
}

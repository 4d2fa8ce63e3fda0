//! Messages as records.

use foxglove::messages::packed_element_field::NumericType;
use foxglove::messages::{
    CameraCalibration, CompressedImage, FrameTransforms, JointState, JointStates, Log,
    PackedElementField, PointCloud as CloudMessage, RawImage, log,
};
use foxglove::{Encode, messages};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use tdcr_sim::camera::{Distortion, Intrinsics};
use tdcr_sim::cloud::PointCloud;

use super::error::DecodeError;
use super::image::{RGB, check_png, depths, image, read_png, write_png};
use super::json::{Command, HomesJson, Json, RegistersJson, StatusesJson, Text};
use super::message::Channel;
use super::record::{Event, Goal, Image, Level, LogRecord, Reading, Transform};
use super::topic::Topic;
use crate::servo::{ServoId, Ticks};

impl LogRecord {
    /// What a message of `channel` says; `None` for a topic that is not ours.
    ///
    /// # Errors
    /// [`DecodeError`] for a message that is not of its topic's schema, or makes no sense.
    pub fn decode(channel: &Channel, message: &[u8]) -> Result<Option<Self>, DecodeError> {
        let Some(topic) = Topic::parse(&channel.topic) else {
            return Ok(None);
        };
        let bytes = Bytes { channel, message };
        let record = match topic {
            Topic::Present => Self::Present(present(&bytes.protobuf()?)?),
            Topic::Goals => Self::Goals(goals(&bytes.protobuf()?)?),
            Topic::Status => {
                let StatusesJson { servos } = bytes.json()?;
                let status = servos.into_iter().map(|servo| servo.status());
                Self::Status(status.collect::<Option<_>>().ok_or_else(bad_id)?)
            }
            Topic::Homes => {
                let HomesJson { servos } = bytes.json()?;
                let homes = servos.into_iter().map(|servo| servo.home());
                Self::Homes(homes.collect::<Option<_>>().ok_or_else(bad_id)?)
            }
            Topic::Registers => {
                let json: RegistersJson = bytes.json()?;
                Self::Registers(json.registers().ok_or_else(bad_id)?)
            }
            Topic::Command => Self::Command(bytes.json::<Command>()?.values),
            Topic::Events => Self::Event(event(bytes.protobuf()?)),
            Topic::Robot => Self::Robot(bytes.json::<Text>()?.data),
            Topic::Transforms => Self::Transforms(transforms(bytes.protobuf()?)?),
            Topic::Cloud => Self::Cloud(cloud(&bytes.protobuf()?)?),
            Topic::Calibration(serial) => Self::Calibration {
                serial,
                intrinsics: intrinsics(&bytes.protobuf()?)?,
            },
            Topic::Color(serial) => Self::Color {
                serial,
                image: color(&bytes)?,
            },
            Topic::Depth(serial) => Self::Depth {
                serial,
                image: depth(&bytes.protobuf()?)?,
            },
        };
        Ok(Some(record))
    }
}

/// A message, to be read as what its channel says that it is.
struct Bytes<'a> {
    channel: &'a Channel,
    message: &'a [u8],
}

impl Bytes<'_> {
    fn schema(&self) -> &str {
        (self.channel.schema.as_ref()).map_or("", |schema| &schema.name)
    }

    fn expect(&self, expected: &'static str) -> Result<(), DecodeError> {
        if self.schema() == expected {
            return Ok(());
        }
        Err(DecodeError::Schema {
            topic: self.channel.topic.clone(),
            found: self.schema().to_owned(),
            expected,
        })
    }

    fn protobuf<M: prost::Message + Default + Named>(&self) -> Result<M, DecodeError> {
        self.expect(M::NAME)?;
        M::decode(self.message).map_err(|e| DecodeError::Bytes(e.to_string()))
    }

    fn json<T: Json>(&self) -> Result<T, DecodeError> {
        self.expect(T::NAME)?;
        serde_json::from_slice(self.message).map_err(|e| DecodeError::Bytes(e.to_string()))
    }
}

/// A message of Foxglove's, and its schema's name.
trait Named: Encode {
    const NAME: &str;
}

macro_rules! named {
    ($($message:ident)*) => {
        $(impl Named for messages::$message {
            const NAME: &str = concat!("foxglove.", stringify!($message));
        })*
    };
}

named!(JointStates Log FrameTransforms PointCloud CameraCalibration RawImage CompressedImage);

fn field(field: &'static str, found: impl ToString, expected: &'static str) -> DecodeError {
    DecodeError::Field {
        field,
        found: found.to_string(),
        expected,
    }
}

fn bad_id() -> DecodeError {
    field("id", "an address above it", "0 to 252")
}

fn servo(joint: &JointState) -> Result<ServoId, DecodeError> {
    let id = joint.name.strip_prefix("servo_");
    id.and_then(|id| id.parse().ok())
        .and_then(ServoId::new)
        .ok_or_else(|| field("name", format!("`{}`", joint.name), "`servo_` and 0 to 252"))
}

fn number(name: &'static str, value: Option<f64>) -> Result<f64, DecodeError> {
    value.ok_or_else(|| field(name, "nothing", "a number"))
}

fn ticks(radians: f64) -> Result<Ticks, DecodeError> {
    let ticks = (radians * f64::from(Ticks::PER_TURN) / std::f64::consts::TAU).round();
    if (f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(&ticks) {
        return Ok(Ticks(ticks as i32));
    }
    Err(field(
        "position",
        radians,
        "radians of at most 524,288 turns",
    ))
}

fn present(states: &JointStates) -> Result<Vec<(ServoId, Reading)>, DecodeError> {
    let servos = states.joints.iter().map(|joint| {
        let reading = Reading {
            position: ticks(number("position", joint.position)?)?,
            velocity: number("velocity", joint.velocity)?,
            current: number("effort", joint.effort)?,
        };
        Ok((servo(joint)?, reading))
    });
    servos.collect()
}

fn goals(states: &JointStates) -> Result<Vec<(ServoId, Goal)>, DecodeError> {
    let servos = states.joints.iter().map(|joint| {
        let goal = Goal {
            position: joint.position.map(ticks).transpose()?,
            current: joint.effort,
        };
        Ok((servo(joint)?, goal))
    });
    servos.collect()
}

fn event(log: Log) -> Event {
    let level = match log.level() {
        log::Level::Unknown | log::Level::Debug => Level::Debug,
        log::Level::Info => Level::Info,
        log::Level::Warning => Level::Warning,
        log::Level::Error | log::Level::Fatal => Level::Error,
    };
    Event {
        level,
        source: log.name,
        text: log.message,
    }
}

fn transforms(frames: FrameTransforms) -> Result<Vec<Transform>, DecodeError> {
    let transforms = frames.transforms.into_iter().map(|frame| {
        let pose = pose(frame.translation.as_ref(), frame.rotation.as_ref())?;
        Ok(Transform {
            parent: frame.parent_frame_id,
            child: frame.child_frame_id,
            pose,
        })
    });
    transforms.collect()
}

fn pose(
    translation: Option<&messages::Vector3>,
    rotation: Option<&messages::Quaternion>,
) -> Result<Isometry3<f64>, DecodeError> {
    let missing = |name| move || field(name, "nothing", "a value");
    let at = translation.ok_or_else(missing("translation"))?;
    let turn = rotation.ok_or_else(missing("rotation"))?;
    let quaternion = Quaternion::new(turn.w, turn.x, turn.y, turn.z);
    // Not so of NaN.
    let is_rotation = (quaternion.norm() - 1.0).abs() < 1e-6;
    if !is_rotation {
        return Err(field("rotation", quaternion, "a quaternion of length 1"));
    }
    Ok(Isometry3::from_parts(
        Translation3::new(at.x, at.y, at.z),
        // Of our logs they are normalised, and stay as they are.
        UnitQuaternion::new_unchecked(quaternion),
    ))
}

fn cloud(message: &CloudMessage) -> Result<PointCloud, DecodeError> {
    let stride = message.point_stride as usize;
    let offset = |name: &'static str, kind: NumericType, size: usize| {
        let named = |f: &&PackedElementField| f.name == name && f.r#type == i32::from(kind);
        let found = message.fields.iter().find(named);
        found
            .map(|f| f.offset as usize)
            .filter(|offset| offset.checked_add(size).is_some_and(|end| end <= stride))
            .ok_or_else(|| {
                let expected = "x, y, z as 32-bit floats; red, green, blue as bytes";
                field("fields", format!("no `{name}` within a point"), expected)
            })
    };
    let axis = |name| offset(name, NumericType::Float32, 4);
    let shade = |name| offset(name, NumericType::Uint8, 1);
    let axes = [axis("x")?, axis("y")?, axis("z")?];
    let shades = [shade("red")?, shade("green")?, shade("blue")?];
    // A point has at least the bytes of its fields, so the stride is not 0.
    if !message.data.len().is_multiple_of(stride) {
        let found = format!("{} bytes", message.data.len());
        return Err(field("data", found, "whole points"));
    }
    let mut cloud = PointCloud::default();
    for point in message.data.chunks_exact(stride) {
        let coordinate = |at: usize| {
            let bytes = [point[at], point[at + 1], point[at + 2], point[at + 3]];
            f32::from_le_bytes(bytes)
        };
        cloud.push(axes.map(coordinate), shades.map(|at| point[at]));
    }
    Ok(cloud)
}

fn intrinsics(message: &CameraCalibration) -> Result<Intrinsics, DecodeError> {
    let [fx, _, cx, _, fy, cy, ..] = message.k[..] else {
        let found = format!("{} numbers", message.k.len());
        return Err(field("K", found, "9 numbers"));
    };
    let distortion = match (message.distortion_model.as_str(), &message.d[..]) {
        (_, []) => Distortion::default(),
        ("plumb_bob", &[k1, k2, p1, p2, k3]) => Distortion { k1, k2, p1, p2, k3 },
        (model, d) => {
            let found = format!("`{model}` with {} numbers", d.len());
            return Err(field("D", found, "`plumb_bob` with 5 numbers"));
        }
    };
    Ok(Intrinsics {
        width: message.width,
        height: message.height,
        fx,
        fy,
        cx,
        cy,
        // A lens that distorts by nothing is a pinhole.
        distortion: (distortion != Distortion::default()).then_some(distortion),
    })
}

fn color(bytes: &Bytes<'_>) -> Result<Image<[u8; 3]>, DecodeError> {
    if bytes.schema() == <CompressedImage as Named>::NAME {
        let compressed: CompressedImage = bytes.protobuf()?;
        require_png(&compressed)?;
        return read_png(&compressed.data);
    }
    let raw: RawImage = bytes.protobuf()?;
    let (pixels, []) = raw.data.as_chunks::<3>() else {
        let found = format!("{} bytes", raw.data.len());
        return Err(field("data", found, "whole pixels"));
    };
    if raw.encoding != RGB {
        let found = format!("`{}`", raw.encoding);
        return Err(field("encoding", found, "`rgb8`"));
    }
    image(raw.width, raw.height, pixels.to_vec())
}

/// A colour image as a PNG file of 8-bit RGB: the log's own bytes where it holds such.
///
/// # Errors
/// [`DecodeError`] for a message that is no colour image.
pub(crate) fn color_png(channel: &Channel, message: &[u8]) -> Result<Vec<u8>, DecodeError> {
    let bytes = Bytes { channel, message };
    if bytes.schema() == <CompressedImage as Named>::NAME {
        let compressed: CompressedImage = bytes.protobuf()?;
        require_png(&compressed)?;
        check_png(&compressed.data)?;
        return Ok(compressed.data.into());
    }
    let bad = |error: png::EncodingError| field("data", error, "an image of some pixels");
    write_png(&color(&bytes)?).map_err(bad)
}

fn require_png(image: &CompressedImage) -> Result<(), DecodeError> {
    match image.format.as_str() {
        "png" => Ok(()),
        other => Err(field("format", format!("`{other}`"), "`png`")),
    }
}

fn depth(raw: &RawImage) -> Result<Image<f32>, DecodeError> {
    let pixels = depths(&raw.encoding, &raw.data).ok_or_else(|| {
        let found = format!("`{}` with {} bytes", raw.encoding, raw.data.len());
        field("encoding", found, "`16UC1` or `32FC1` with whole pixels")
    })?;
    image(raw.width, raw.height, pixels)
}

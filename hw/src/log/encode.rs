//! Records as messages: Foxglove's where it has a schema for them, else ours.

use foxglove::messages::packed_element_field::NumericType;
use foxglove::messages::{
    CameraCalibration, CompressedImage, FrameTransform, FrameTransforms, JointState, JointStates,
    Log, PackedElementField, Pose, Quaternion, RawImage, Timestamp, Vector3, log,
};
use foxglove::{Encode, Schema};
use nalgebra::Isometry3;
use tdcr_sim::camera::Intrinsics;
use tdcr_sim::cloud::PointCloud;

use super::error::LogError;
use super::image::{ImageFormat, RGB, depth_bytes, write_png};
use super::json::{
    Command, HomeJson, HomesJson, Json, RegistersJson, StatusJson, StatusesJson, Text,
};
use super::record::{
    Event, Goal, Image, Level, LogRecord, Reading, Transform, WORLD, camera_frame,
};
use super::topic::Topic;
use crate::servo::ServoId;

/// What a channel's metadata says of currents, which `JointState` has no field for.
pub(super) const EFFORT: (&str, &str) = ("effort", "current of the motor (A)");

/// Bytes between points of a cloud: three coordinates and a colour.
pub(super) const POINT_STRIDE: usize = 16;

/// A message, and what its channel is.
pub(super) struct Encoded {
    pub topic: Topic,
    pub schema: Schema,
    /// Encoding of the message: of protobuf schemas `protobuf`, of JSON Schema `json`.
    pub encoding: &'static str,
    pub bytes: Vec<u8>,
}

/// A record as the message of a time (nanoseconds since the Unix epoch).
pub(super) fn encode(
    record: &LogRecord,
    nanoseconds: u64,
    colors: ImageFormat,
) -> Result<Encoded, LogError> {
    let time = timestamp(nanoseconds);
    Ok(match record {
        LogRecord::Present(servos) => protobuf(Topic::Present, &present(servos, time)),
        LogRecord::Goals(servos) => protobuf(Topic::Goals, &goals(servos, time)),
        LogRecord::Status(servos) => {
            let servos = servos.iter().map(StatusJson::new).collect();
            json(Topic::Status, &StatusesJson { servos })?
        }
        LogRecord::Homes(servos) => {
            let servos = servos.iter().map(HomeJson::new).collect();
            json(Topic::Homes, &HomesJson { servos })?
        }
        LogRecord::Registers(registers) => json(Topic::Registers, &RegistersJson::new(registers))?,
        LogRecord::Command(values) => {
            let values = values.clone();
            if let Some(value) = values.iter().find(|value| !value.is_finite()) {
                return Err(refused("a command", format!("it has the value {value}")));
            }
            json(Topic::Command, &Command { values })?
        }
        LogRecord::Event(event) => protobuf(Topic::Events, &event_message(event, time)),
        LogRecord::Robot(urdf) => json(Topic::Robot, &Text { data: urdf.clone() })?,
        LogRecord::Transforms(transforms) => protobuf(Topic::Transforms, &frames(transforms, time)),
        LogRecord::Cloud(cloud) => protobuf(Topic::Cloud, &cloud_message(cloud, time)),
        LogRecord::Calibration { serial, intrinsics } => protobuf(
            Topic::Calibration(serial.clone()),
            &calibration(serial, intrinsics, time),
        ),
        LogRecord::Color { serial, image } => color(serial, image, time, colors)?,
        LogRecord::Depth { serial, image } => {
            check("a depth image", image)?;
            let (encoding, data) = depth_bytes(&image.pixels);
            let message = raw_image(serial, image, time, encoding, data);
            protobuf(Topic::Depth(serial.clone()), &message)
        }
    })
}

fn refused(record: &'static str, problem: String) -> LogError {
    LogError::Record { record, problem }
}

fn timestamp(nanoseconds: u64) -> Option<Timestamp> {
    const SECOND: u64 = 1_000_000_000;
    // From 2106 on, messages are without; the log's own time stamps reach to 2554.
    let seconds = u32::try_from(nanoseconds / SECOND).ok()?;
    Timestamp::new_checked(seconds, (nanoseconds % SECOND) as u32)
}

fn protobuf<M: prost::Message + Encode>(topic: Topic, message: &M) -> Encoded {
    Encoded {
        topic,
        // All of Foxglove's messages have one.
        schema: M::get_schema().unwrap_or_else(|| Schema::new("", "", &[][..])),
        encoding: "protobuf",
        bytes: message.encode_to_vec(),
    }
}

fn json<T: Json>(topic: Topic, message: &T) -> Result<Encoded, LogError> {
    let bytes = serde_json::to_vec(message).map_err(|e| refused(T::NAME, e.to_string()))?;
    Ok(Encoded {
        topic,
        schema: Schema::new(T::NAME, "jsonschema", T::SCHEMA.as_bytes()),
        encoding: "json",
        bytes,
    })
}

/// Name of a servo's joint.
pub(super) fn joint_name(id: ServoId) -> String {
    format!("servo_{id}")
}

fn present(servos: &[(ServoId, Reading)], time: Option<Timestamp>) -> JointStates {
    let joint = |(id, reading): &(ServoId, Reading)| JointState {
        name: joint_name(*id),
        position: Some(reading.position.radians()),
        velocity: Some(reading.velocity),
        acceleration: None,
        effort: Some(reading.current),
    };
    JointStates {
        timestamp: time,
        joints: servos.iter().map(joint).collect(),
    }
}

fn goals(servos: &[(ServoId, Goal)], time: Option<Timestamp>) -> JointStates {
    let joint = |(id, goal): &(ServoId, Goal)| JointState {
        name: joint_name(*id),
        position: goal.position.map(|ticks| ticks.radians()),
        velocity: None,
        acceleration: None,
        effort: goal.current,
    };
    JointStates {
        timestamp: time,
        joints: servos.iter().map(joint).collect(),
    }
}

fn event_message(event: &Event, time: Option<Timestamp>) -> Log {
    let level = match event.level {
        Level::Debug => log::Level::Debug,
        Level::Info => log::Level::Info,
        Level::Warning => log::Level::Warning,
        Level::Error => log::Level::Error,
    };
    Log {
        timestamp: time,
        level: level.into(),
        message: event.text.clone(),
        name: event.source.clone(),
        file: String::new(),
        line: 0,
    }
}

fn frames(transforms: &[Transform], time: Option<Timestamp>) -> FrameTransforms {
    let frame = |transform: &Transform| FrameTransform {
        timestamp: time,
        parent_frame_id: transform.parent.clone(),
        child_frame_id: transform.child.clone(),
        translation: Some(translation(&transform.pose)),
        rotation: Some(rotation(&transform.pose)),
    };
    FrameTransforms {
        transforms: transforms.iter().map(frame).collect(),
    }
}

fn translation(pose: &Isometry3<f64>) -> Vector3 {
    let [x, y, z] = pose.translation.vector.into();
    Vector3 { x, y, z }
}

fn rotation(pose: &Isometry3<f64>) -> Quaternion {
    let [x, y, z, w] = pose.rotation.coords.into();
    Quaternion { x, y, z, w }
}

fn cloud_message(cloud: &PointCloud, time: Option<Timestamp>) -> foxglove::messages::PointCloud {
    let field = |name: &str, offset, kind: NumericType| PackedElementField {
        name: name.to_owned(),
        offset,
        r#type: kind.into(),
    };
    let mut data = Vec::with_capacity(POINT_STRIDE * cloud.points.len());
    for (point, [red, green, blue]) in cloud.points.iter().zip(&cloud.colors) {
        data.extend(point.iter().flat_map(|x| x.to_le_bytes()));
        data.extend([*red, *green, *blue, u8::MAX]);
    }
    foxglove::messages::PointCloud {
        timestamp: time,
        frame_id: WORLD.to_owned(),
        pose: Some(Pose {
            position: Some(translation(&Isometry3::identity())),
            orientation: Some(rotation(&Isometry3::identity())),
        }),
        point_stride: POINT_STRIDE as u32,
        fields: vec![
            field("x", 0, NumericType::Float32),
            field("y", 4, NumericType::Float32),
            field("z", 8, NumericType::Float32),
            field("red", 12, NumericType::Uint8),
            field("green", 13, NumericType::Uint8),
            field("blue", 14, NumericType::Uint8),
            field("alpha", 15, NumericType::Uint8),
        ],
        data: data.into(),
    }
}

fn calibration(
    serial: &str,
    intrinsics: &Intrinsics,
    time: Option<Timestamp>,
) -> CameraCalibration {
    let Intrinsics {
        width,
        height,
        fx,
        fy,
        cx,
        cy,
        distortion,
    } = *intrinsics;
    CameraCalibration {
        timestamp: time,
        frame_id: camera_frame(serial),
        width,
        height,
        // OpenCV's name for Brown and Conrady's model.
        distortion_model: "plumb_bob".to_owned(),
        d: distortion.unwrap_or_default().coefficients().to_vec(),
        k: vec![fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: vec![fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    }
}

/// Refuses an image that is not of its size.
fn check<P>(record: &'static str, image: &Image<P>) -> Result<(), LogError> {
    let pixels = u64::from(image.width) * u64::from(image.height);
    if image.pixels.len() as u64 == pixels {
        return Ok(());
    }
    let (found, width, height) = (image.pixels.len(), image.width, image.height);
    let problem = format!("it has {found} pixels, and should have {width} x {height}");
    Err(refused(record, problem))
}

fn color(
    serial: &str,
    image: &Image<[u8; 3]>,
    time: Option<Timestamp>,
    format: ImageFormat,
) -> Result<Encoded, LogError> {
    const RECORD: &str = "a colour image";
    check(RECORD, image)?;
    let topic = Topic::Color(serial.to_owned());
    Ok(match format {
        ImageFormat::Raw => {
            let data = image.pixels.as_flattened().to_vec();
            protobuf(topic, &raw_image(serial, image, time, RGB, data))
        }
        ImageFormat::Png => {
            let file = write_png(image).map_err(|e| refused(RECORD, e.to_string()))?;
            let message = CompressedImage {
                timestamp: time,
                frame_id: camera_frame(serial),
                data: file.into(),
                format: "png".to_owned(),
            };
            protobuf(topic, &message)
        }
    })
}

fn raw_image<P>(
    serial: &str,
    image: &Image<P>,
    time: Option<Timestamp>,
    encoding: &str,
    data: Vec<u8>,
) -> RawImage {
    RawImage {
        timestamp: time,
        frame_id: camera_frame(serial),
        width: image.width,
        height: image.height,
        encoding: encoding.to_owned(),
        step: (data.len() / image.height.max(1) as usize) as u32,
        data: data.into(),
    }
}

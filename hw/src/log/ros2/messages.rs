//! Records of a log as messages of ROS 2.

use nalgebra::Isometry3;
use tdcr_sim::camera::Intrinsics;
use tdcr_sim::cloud::PointCloud;

use super::cdr::Cdr;
use super::definitions::{
    CAMERA_INFO, Definition, IMAGE, JOINT_STATE, LOG, NUMBERS, POINT_CLOUD, TEXT, TRANSFORMS,
};
use crate::log::encode::joint_name;
use crate::log::image::{RGB, depth_bytes};
use crate::log::record::{
    Event, Goal, Image, Level, LogRecord, Reading, Transform, WORLD, camera_frame,
};
use crate::servo::ServoId;

/// A message of a topic.
pub(super) struct Message {
    pub topic: String,
    pub definition: &'static Definition,
    pub bytes: Vec<u8>,
}

/// Bytes between points: three coordinates and a colour.
const POINT_STEP: u32 = 16;
/// `FLOAT32` of `sensor_msgs/PointField`.
const FLOAT32: u8 = 7;

/// The message of a record of a time (ns since the Unix epoch); none where ROS 2 has no message for it.
pub(super) fn message(record: &LogRecord, time: u64) -> Option<Message> {
    let mut cdr = Cdr::new();
    let (topic, definition) = match record {
        LogRecord::Present(servos) => {
            present(&mut cdr, servos, time);
            ("/servos/present".to_owned(), &JOINT_STATE)
        }
        LogRecord::Goals(servos) => {
            goals(&mut cdr, servos, time);
            ("/servos/goals".to_owned(), &JOINT_STATE)
        }
        LogRecord::Command(values) => {
            // A layout without dimensions.
            cdr.count(0).u32(0).numbers(values);
            ("/command".to_owned(), &NUMBERS)
        }
        LogRecord::Event(event) => {
            log(&mut cdr, event, time);
            ("/events".to_owned(), &LOG)
        }
        LogRecord::Robot(urdf) => {
            cdr.text(urdf);
            ("/robot_description".to_owned(), &TEXT)
        }
        LogRecord::Transforms(transforms) => {
            tf(&mut cdr, transforms, time);
            ("/tf".to_owned(), &TRANSFORMS)
        }
        LogRecord::Cloud(points) => {
            cloud(&mut cdr, points, time);
            ("/cloud".to_owned(), &POINT_CLOUD)
        }
        LogRecord::Calibration { serial, intrinsics } => {
            camera_info(&mut cdr, serial, intrinsics, time);
            (topic(serial, "color/camera_info"), &CAMERA_INFO)
        }
        LogRecord::Color { serial, image: of } => {
            image(&mut cdr, serial, of, time, RGB, of.pixels.as_flattened());
            (topic(serial, "color/image_raw"), &IMAGE)
        }
        LogRecord::Depth { serial, image: of } => {
            let (encoding, bytes) = depth_bytes(&of.pixels);
            image(&mut cdr, serial, of, time, encoding, &bytes);
            (topic(serial, "depth/image_raw"), &IMAGE)
        }
        LogRecord::Status(_) | LogRecord::Homes(_) | LogRecord::Registers(_) => return None,
    };
    Some(Message {
        topic,
        definition,
        bytes: cdr.finish(),
    })
}

/// A camera's topic: what its serial number has that names of ROS 2 may not have is an underscore there.
fn topic(serial: &str, kind: &str) -> String {
    let is_allowed = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let name: String = camera_frame(serial)
        .chars()
        .map(|c| if is_allowed(c) { c } else { '_' })
        .collect();
    format!("/{name}/{kind}")
}

fn stamp(cdr: &mut Cdr, time: u64) {
    const SECOND: u64 = 1_000_000_000;
    // From 2038 on, ROS 2's own clock is at its end.
    cdr.i32(i32::try_from(time / SECOND).unwrap_or(i32::MAX))
        .u32((time % SECOND) as u32);
}

fn header(cdr: &mut Cdr, time: u64, frame: &str) {
    stamp(cdr, time);
    cdr.text(frame);
}

fn present(cdr: &mut Cdr, servos: &[(ServoId, Reading)], time: u64) {
    header(cdr, time, "");
    names(cdr, servos);
    let of = |value: fn(&Reading) -> f64| -> Vec<f64> {
        servos.iter().map(|(_, reading)| value(reading)).collect()
    };
    cdr.numbers(&of(|reading| reading.position.radians()))
        .numbers(&of(|reading| reading.velocity))
        .numbers(&of(|reading| reading.current));
}

/// What a servo was not told is not a number.
fn goals(cdr: &mut Cdr, servos: &[(ServoId, Goal)], time: u64) {
    header(cdr, time, "");
    names(cdr, servos);
    let of = |value: fn(&Goal) -> Option<f64>| -> Vec<f64> {
        let values = servos.iter().map(|(_, goal)| value(goal));
        values.map(|value| value.unwrap_or(f64::NAN)).collect()
    };
    cdr.numbers(&of(|goal| goal.position.map(|ticks| ticks.radians())))
        .numbers(&[])
        .numbers(&of(|goal| goal.current));
}

fn names<T>(cdr: &mut Cdr, servos: &[(ServoId, T)]) {
    cdr.count(servos.len());
    for (id, _) in servos {
        cdr.text(&joint_name(*id));
    }
}

fn log(cdr: &mut Cdr, event: &Event, time: u64) {
    stamp(cdr, time);
    let level = match event.level {
        Level::Debug => 10,
        Level::Info => 20,
        Level::Warning => 30,
        Level::Error => 40,
    };
    cdr.u8(level).text(&event.source).text(&event.text);
    // No file, function and line.
    cdr.text("").text("").u32(0);
}

fn tf(cdr: &mut Cdr, transforms: &[Transform], time: u64) {
    cdr.count(transforms.len());
    for transform in transforms {
        header(cdr, time, &transform.parent);
        cdr.text(&transform.child);
        let Isometry3 {
            rotation,
            translation,
        } = transform.pose;
        cdr.array(translation.vector.as_slice())
            .array(rotation.coords.as_slice());
    }
}

fn cloud(cdr: &mut Cdr, cloud: &PointCloud, time: u64) {
    header(cdr, time, WORLD);
    let count = cloud.points.len() as u32;
    cdr.u32(1).u32(count).count(4);
    for (name, offset) in [("x", 0), ("y", 4), ("z", 8), ("rgb", 12)] {
        cdr.text(name).u32(offset).u8(FLOAT32).u32(1);
    }
    let mut data = Vec::with_capacity(POINT_STEP as usize * cloud.points.len());
    for (point, [red, green, blue]) in cloud.points.iter().zip(&cloud.colors) {
        data.extend(point.iter().flat_map(|x| x.to_le_bytes()));
        // The number 0x00RRGGBB, as the Point Cloud Library packs it.
        data.extend([*blue, *green, *red, 0]);
    }
    cdr.bool(false)
        .u32(POINT_STEP)
        .u32(POINT_STEP * count)
        .octets(&data)
        .bool(true);
}

fn camera_info(cdr: &mut Cdr, serial: &str, intrinsics: &Intrinsics, time: u64) {
    let Intrinsics {
        width,
        height,
        fx,
        fy,
        cx,
        cy,
        distortion,
    } = *intrinsics;
    header(cdr, time, &camera_frame(serial));
    cdr.u32(height).u32(width).text("plumb_bob");
    cdr.numbers(&distortion.unwrap_or_default().coefficients())
        .array(&[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
        .array(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
        .array(&[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]);
    // No binning; the region of interest is the whole image.
    cdr.u32(0).u32(0).u32(0).u32(0).u32(0).u32(0).bool(false);
}

fn image<P>(
    cdr: &mut Cdr,
    serial: &str,
    image: &Image<P>,
    time: u64,
    encoding: &str,
    bytes: &[u8],
) {
    header(cdr, time, &camera_frame(serial));
    cdr.u32(image.height).u32(image.width).text(encoding);
    let step = bytes.len() / image.height.max(1) as usize;
    cdr.bool(false).u32(step as u32).octets(bytes);
}

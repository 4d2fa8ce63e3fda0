//! A camera inside librealsense whose pictures come from the test.
#![allow(
    unsafe_code,
    reason = "calls a C library, with the types of its header rs_internal.h"
)]

use std::ffi::{CStr, c_char, c_int, c_void};
use std::ptr::null;
use std::sync::Arc;

use super::error::RealSenseError;
use super::handles::{Device, Owned, check};
use super::library::{
    Calls, Out, RsDevice, RsExtrinsics, RsIntrinsics, RsProfile, domain, format, info, stream,
};

/// `rs2_sensor`
#[repr(C)]
struct RsSensor {
    _private: [u8; 0],
}

/// `rs2_video_stream`
#[repr(C)]
struct RsVideoStream {
    stream: c_int,
    index: c_int,
    id: c_int,
    width: c_int,
    height: c_int,
    rate: c_int,
    bytes: c_int,
    format: c_int,
    intrinsics: RsIntrinsics,
}

/// `rs2_software_video_frame`
#[repr(C)]
struct RsVideoFrame {
    pixels: *mut c_void,
    deleter: unsafe extern "C" fn(*mut c_void),
    stride: c_int,
    bytes: c_int,
    time: f64,
    domain: c_int,
    number: c_int,
    profile: *const RsProfile,
    depth_units: f32,
}

/// `RS2_OPTION_DEPTH_UNITS`
const DEPTH_UNITS: c_int = 28;
/// `RS2_MATCHER_DEFAULT`
const MATCHER_DEFAULT: c_int = 6;

/// A function of the library that only tests call.
macro_rules! function {
    ($calls:expr, $name:literal, $type:ty) => {{
        let library = $calls.libraries.last().expect("a library is loaded");
        // SAFETY: the function of this name has this type in rs_internal.h of 2.59.
        *unsafe { library.get::<$type>($name) }.expect("the function is there")
    }};
}

/// What the camera is.
pub(super) struct SoftwareSetup {
    pub serial: &'static CStr,
    pub usb: &'static CStr,
    pub depth: RsIntrinsics,
    pub color: RsIntrinsics,
    pub depth_to_color: RsExtrinsics,
    /// Metres that 1 of a depth picture stands for.
    pub depth_units: f32,
}

/// The camera.
pub(super) struct SoftwareCamera {
    calls: Arc<Calls>,
    depth: Stream,
    color: Stream,
    depth_units: f32,
    /// After its sensors.
    _device: Owned<RsDevice>,
    /// After all that may show them.
    pixels: Vec<Vec<u8>>,
}

struct Stream {
    profile: *const RsProfile,
    width: c_int,
    bytes: c_int,
    sensor: Owned<RsSensor>,
}

impl SoftwareCamera {
    pub fn new(calls: &Arc<Calls>, setup: &SoftwareSetup) -> Result<Self, RealSenseError> {
        type Create = unsafe extern "C" fn(Out) -> *mut RsDevice;
        type Register = unsafe extern "C" fn(*mut RsDevice, c_int, *const c_char, Out);
        type Match = unsafe extern "C" fn(*mut RsDevice, c_int, Out);
        type RegisterExtrinsics =
            unsafe extern "C" fn(*const RsProfile, *const RsProfile, RsExtrinsics, Out);
        let create = function!(calls, b"rs2_create_software_device\0", Create);
        // SAFETY: takes the place for an error.
        let make = |_: &Calls, out| unsafe { create(out) };
        let device = Owned::new(
            calls,
            "rs2_create_software_device",
            calls.delete_device,
            make,
        )?;
        let register = function!(calls, b"rs2_software_device_register_info\0", Register);
        for (info, text) in [
            (info::SERIAL_NUMBER, setup.serial),
            (info::NAME, c"Software D435"),
            (info::USB_TYPE_DESCRIPTOR, setup.usb),
        ] {
            // SAFETY: the device is owned, and the string ends with a zero.
            check(calls, |_, out| unsafe {
                register(device.get(), info, text.as_ptr(), out)
            })?;
        }
        let depth = Stream::new(
            calls,
            &device,
            stream::DEPTH,
            &setup.depth,
            setup.depth_units,
        )?;
        let color = Stream::new(
            calls,
            &device,
            stream::COLOR,
            &setup.color,
            setup.depth_units,
        )?;
        let matcher = function!(calls, b"rs2_software_device_create_matcher\0", Match);
        // SAFETY: the device is owned.
        check(calls, |_, out| unsafe {
            matcher(device.get(), MATCHER_DEFAULT, out)
        })?;
        let extrinsics = function!(calls, b"rs2_register_extrinsics\0", RegisterExtrinsics);
        // SAFETY: the profiles live as long as their sensors.
        check(calls, |_, out| unsafe {
            extrinsics(depth.profile, color.profile, setup.depth_to_color, out)
        })?;
        Ok(Self {
            calls: calls.clone(),
            depth,
            color,
            depth_units: setup.depth_units,
            _device: device,
            pixels: Vec::new(),
        })
    }

    /// The camera as librealsense's users have it.
    pub fn device(&self) -> Result<Device, RealSenseError> {
        type OfSensor = unsafe extern "C" fn(*const RsSensor, Out) -> *mut RsDevice;
        let of_sensor = function!(self.calls, b"rs2_create_device_from_sensor\0", OfSensor);
        // SAFETY: the sensor is owned.
        let make = |_: &Calls, out| unsafe { of_sensor(self.depth.sensor.get(), out) };
        Owned::new(
            &self.calls,
            "rs2_create_device_from_sensor",
            self.calls.delete_device,
            make,
        )
        .map(Device)
    }

    /// Takes pictures `number`, stamped `time` (ms since the Unix epoch).
    pub fn take(
        &mut self,
        number: c_int,
        time: f64,
        depth: &[u16],
        color: &[[u8; 3]],
    ) -> Result<(), RealSenseError> {
        let depth: Vec<u8> = depth.iter().flat_map(|z| z.to_ne_bytes()).collect();
        let color: Vec<u8> = color.iter().flatten().copied().collect();
        self.depth
            .take(&self.calls, number, time, &depth, self.depth_units)?;
        self.color.take(&self.calls, number, time, &color, 0.0)?;
        self.pixels.extend([depth, color]);
        Ok(())
    }
}

impl Stream {
    fn new(
        calls: &Arc<Calls>,
        device: &Owned<RsDevice>,
        stream: c_int,
        intrinsics: &RsIntrinsics,
        depth_units: f32,
    ) -> Result<Self, RealSenseError> {
        type AddSensor = unsafe extern "C" fn(*mut RsDevice, *const c_char, Out) -> *mut RsSensor;
        type AddStream =
            unsafe extern "C" fn(*mut RsSensor, RsVideoStream, Out) -> *const RsProfile;
        type AddOption = unsafe extern "C" fn(*mut RsSensor, c_int, f32, Out);
        type Delete = unsafe extern "C" fn(*mut RsSensor);
        let (name, bytes, format) = match stream {
            stream::DEPTH => (c"Depth", 2, format::Z16),
            _ => (c"Color", 3, format::RGB8),
        };
        let add = function!(calls, b"rs2_software_device_add_sensor\0", AddSensor);
        let delete = function!(calls, b"rs2_delete_sensor\0", Delete);
        // SAFETY: the device is owned, and the string ends with a zero.
        let make = |_: &Calls, out| unsafe { add(device.get(), name.as_ptr(), out) };
        let sensor = Owned::new(calls, "rs2_software_device_add_sensor", delete, make)?;
        let add = function!(calls, b"rs2_software_sensor_add_video_stream\0", AddStream);
        let video = RsVideoStream {
            stream,
            index: 0,
            id: stream,
            width: intrinsics.width,
            height: intrinsics.height,
            rate: 30,
            bytes,
            format,
            intrinsics: *intrinsics,
        };
        let mut profile = null();
        // SAFETY: the sensor is owned.
        check(calls, |_, out| {
            profile = unsafe { add(sensor.get(), video, out) }
        })?;
        if stream == stream::DEPTH {
            let add = function!(
                calls,
                b"rs2_software_sensor_add_read_only_option\0",
                AddOption
            );
            // SAFETY: the sensor is owned.
            check(calls, |_, out| unsafe {
                add(sensor.get(), DEPTH_UNITS, depth_units, out)
            })?;
        }
        Ok(Self {
            profile,
            width: intrinsics.width,
            bytes,
            sensor,
        })
    }

    fn take(
        &self,
        calls: &Arc<Calls>,
        number: c_int,
        time: f64,
        pixels: &[u8],
        depth_units: f32,
    ) -> Result<(), RealSenseError> {
        type OnFrame = unsafe extern "C" fn(*mut RsSensor, RsVideoFrame, Out);
        let on_frame = function!(calls, b"rs2_software_sensor_on_video_frame\0", OnFrame);
        let frame = RsVideoFrame {
            pixels: pixels.as_ptr().cast_mut().cast(),
            deleter: keep_pixels,
            stride: self.width * self.bytes,
            bytes: self.bytes,
            time,
            domain: domain::SYSTEM_TIME,
            number,
            profile: self.profile,
            depth_units,
        };
        // SAFETY: the sensor is owned.
        check(calls, |_, out| unsafe {
            on_frame(self.sensor.get(), frame, out)
        })
    }
}

/// Pixels are kept by the camera.
unsafe extern "C" fn keep_pixels(_: *mut c_void) {}

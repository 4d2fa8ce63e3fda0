//! Objects of librealsense that are released with their last owner, and calls whose errors are checked.
#![allow(
    unsafe_code,
    reason = "calls a C library: here alone pointers are passed, and each is owned, or borrowed from what is owned"
)]

use std::ffi::{CStr, c_char, c_int, c_uint};
use std::ptr::{NonNull, null_mut};
use std::slice;
use std::sync::Arc;
use std::time::Duration;

use super::error::RealSenseError;
use super::library::{
    CAMERA_DISCONNECTED, Calls, Out, RsConfig, RsContext, RsDevice, RsDeviceList, RsError,
    RsExtrinsics, RsFrame, RsIntrinsics, RsPipeline, RsProfile, RsProfileList, RsQueue, stream,
};

/// An object of the library, deleted with this.
pub(super) struct Owned<T> {
    pointer: NonNull<T>,
    delete: unsafe extern "C" fn(*mut T),
    calls: Arc<Calls>,
}

// SAFETY: librealsense's objects are shared pointers to objects that lock for themselves; none is bound to a thread.
unsafe impl<T> Send for Owned<T> {}

impl<T> Owned<T> {
    /// Owns what the call named `function` has made.
    pub fn new(
        calls: &Arc<Calls>,
        function: &'static str,
        delete: unsafe extern "C" fn(*mut T),
        make: impl FnOnce(&Calls, Out) -> *mut T,
    ) -> Result<Self, RealSenseError> {
        let pointer = check(calls, make)?;
        let pointer = NonNull::new(pointer).ok_or(RealSenseError::Nothing { function })?;
        Ok(Self {
            pointer,
            delete,
            calls: calls.clone(),
        })
    }

    pub fn get(&self) -> *mut T {
        self.pointer.as_ptr()
    }

    pub fn calls(&self) -> &Arc<Calls> {
        &self.calls
    }
}

impl<T> Drop for Owned<T> {
    fn drop(&mut self) {
        // SAFETY: the pointer came from the call that belongs to `delete`, and is deleted once.
        unsafe { (self.delete)(self.pointer.as_ptr()) };
    }
}

/// Calls a function, and reads and frees the error that it may leave.
pub(super) fn check<R>(
    calls: &Calls,
    call: impl FnOnce(&Calls, Out) -> R,
) -> Result<R, RealSenseError> {
    let mut error: *mut RsError = null_mut();
    let result = call(calls, &mut error);
    if error.is_null() {
        return Ok(result);
    }
    // SAFETY: the error is the one that the library has just made; its strings live until it is freed, and are copied first.
    unsafe {
        let call = RealSenseError::Call {
            function: text((calls.get_failed_function)(error)),
            arguments: text((calls.get_failed_args)(error)),
            message: text((calls.get_error_message)(error)),
            disconnected: (calls.get_librealsense_exception_type)(error) == CAMERA_DISCONNECTED,
        };
        (calls.free_error)(error);
        Err(call)
    }
}

/// A copy of a string of the library.
///
/// # Safety
/// `pointer` is null, or points to a string that ends with a zero and lives through the call.
unsafe fn text(pointer: *const c_char) -> String {
    if pointer.is_null() {
        return String::new();
    }
    // SAFETY: as the caller promises.
    unsafe { CStr::from_ptr(pointer) }
        .to_string_lossy()
        .into_owned()
}

/// Version of the loaded library: major times 10,000, minor times 100, patch.
pub(super) fn api_version(calls: &Calls) -> Result<c_int, RealSenseError> {
    // SAFETY: takes nothing but the place for an error.
    check(calls, |calls, out| unsafe { (calls.get_api_version)(out) })
}

/// Time since the Unix epoch on the clock that pictures are stamped by.
pub(super) fn now(calls: &Calls) -> Result<Milliseconds, RealSenseError> {
    // SAFETY: takes nothing but the place for an error.
    check(calls, |calls, out| unsafe { (calls.get_time)(out) }).map(Milliseconds)
}

/// A time, or a difference of times, as librealsense counts it.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub(super) struct Milliseconds(pub f64);

/// The library's state.
pub(super) struct Context(Owned<RsContext>);

// SAFETY: librealsense's own tools query one context from several threads; the query locks the list that it reads.
unsafe impl Sync for Context {}

impl Context {
    pub fn new(calls: &Arc<Calls>) -> Result<Self, RealSenseError> {
        let version = api_version(calls)?;
        // SAFETY: takes a number and the place for an error.
        let make = |calls: &Calls, out| unsafe { (calls.create_context)(version, out) };
        Owned::new(calls, "rs2_create_context", calls.delete_context, make).map(Self)
    }

    pub fn calls(&self) -> &Arc<Calls> {
        self.0.calls()
    }

    fn list(&self) -> Result<Owned<RsDeviceList>, RealSenseError> {
        let calls = self.calls();
        // SAFETY: the context is owned.
        let make = |calls: &Calls, out| unsafe { (calls.query_devices)(self.0.get(), out) };
        Owned::new(calls, "rs2_query_devices", calls.delete_device_list, make)
    }

    /// The cameras that are plugged in.
    pub fn devices(&self) -> Result<Vec<Device>, RealSenseError> {
        let (calls, list) = (self.calls(), self.list()?);
        // SAFETY: the list is owned.
        let count = check(calls, |calls, out| unsafe {
            (calls.get_device_count)(list.get(), out)
        })?;
        let device = |index| {
            // SAFETY: the list is owned, and devices outlive it.
            let make =
                |calls: &Calls, out| unsafe { (calls.create_device)(list.get(), index, out) };
            Owned::new(calls, "rs2_create_device", calls.delete_device, make).map(Device)
        };
        (0..count).map(device).collect()
    }

    /// Whether a camera is plugged in.
    pub fn has(&self, device: &Device) -> Result<bool, RealSenseError> {
        let list = self.list()?;
        // SAFETY: list and device are owned.
        let contains = |calls: &Calls, out| unsafe {
            (calls.device_list_contains)(list.get(), device.0.get(), out)
        };
        Ok(check(self.calls(), contains)? != 0)
    }
}

/// A camera.
pub(super) struct Device(pub(super) Owned<RsDevice>);

impl Device {
    /// What it says of itself under one of [`info`](super::library::info); `None` where it says nothing.
    pub fn info(&self, info: c_int) -> Result<Option<String>, RealSenseError> {
        let (calls, device) = (self.0.calls(), self.0.get());
        // SAFETY: the device is owned.
        let supports =
            |calls: &Calls, out| unsafe { (calls.supports_device_info)(device, info, out) };
        if check(calls, supports)? == 0 {
            return Ok(None);
        }
        // SAFETY: as above; the string lives as long as the device, and is copied.
        check(calls, |calls, out| unsafe {
            text((calls.get_device_info)(device, info, out))
        })
        .map(Some)
    }
}

/// What to stream.
#[derive(Clone, Copy, Debug)]
pub(super) struct Request {
    /// Of [`stream`].
    pub stream: c_int,
    /// Of [`format`](super::library::format).
    pub format: c_int,
    pub width: c_int,
    pub height: c_int,
    pub rate: c_int,
}

/// A camera that streams into a queue; stopped with this.
pub(super) struct Pipeline {
    pipeline: Owned<RsPipeline>,
    /// After the pipeline, which writes to it.
    queue: Owned<RsQueue>,
    /// Calibration of depth and colour.
    pub calibration: Calibration,
}

/// The factory's calibration of a camera.
#[derive(Clone, Copy, Debug)]
pub(super) struct Calibration {
    pub depth: RsIntrinsics,
    pub color: RsIntrinsics,
    pub depth_to_color: RsExtrinsics,
}

impl Pipeline {
    /// Starts the streams of a device; the queue keeps the last `kept` sets of pictures.
    pub fn start(
        context: &Context,
        device: &Device,
        requests: &[Request],
        kept: c_int,
    ) -> Result<Self, RealSenseError> {
        let calls = context.calls();
        // SAFETY: takes the place for an error.
        let make = |calls: &Calls, out| unsafe { (calls.create_config)(out) };
        let config: Owned<RsConfig> =
            Owned::new(calls, "rs2_create_config", calls.delete_config, make)?;
        for request in requests {
            let Request {
                stream,
                format,
                width,
                height,
                rate,
            } = *request;
            // SAFETY: the config is owned; -1 stands for any index.
            check(calls, |calls, out| unsafe {
                (calls.config_enable_stream)(
                    config.get(),
                    stream,
                    -1,
                    width,
                    height,
                    format,
                    rate,
                    out,
                );
            })?;
        }
        // SAFETY: takes a number and the place for an error.
        let make = |calls: &Calls, out| unsafe { (calls.create_frame_queue)(kept, out) };
        let queue = Owned::new(
            calls,
            "rs2_create_frame_queue",
            calls.delete_frame_queue,
            make,
        )?;
        // SAFETY: the context is owned, and pipelines hold on to what they need of it.
        let make = |calls: &Calls, out| unsafe { (calls.create_pipeline)(context.0.get(), out) };
        let pipeline = Owned::new(calls, "rs2_create_pipeline", calls.delete_pipeline, make)?;
        // SAFETY: pipeline and device are owned.
        check(calls, |calls, out| unsafe {
            (calls.pipeline_set_device)(pipeline.get(), device.0.get(), out)
        })?;
        // SAFETY: all are owned. The library's own function that puts pictures into queues is the callback, and the queue its
        // argument: it outlives the pipeline, which is stopped and deleted first.
        let start = |calls: &Calls, out| unsafe {
            let (pipeline, config, queue) = (pipeline.get(), config.get(), queue.get().cast());
            (calls.pipeline_start_with_config_and_callback)(
                pipeline,
                config,
                calls.enqueue_frame,
                queue,
                out,
            )
        };
        let profile = Owned::new(
            calls,
            "rs2_pipeline_start",
            calls.delete_pipeline_profile,
            start,
        )?;
        // From here on the pipeline is stopped where anything fails: deleting it does so.
        // SAFETY: the profile is owned.
        let make = |calls: &Calls, out| unsafe {
            (calls.pipeline_profile_get_streams)(profile.get(), out)
        };
        let list = Owned::new(
            calls,
            "rs2_pipeline_profile_get_streams",
            calls.delete_stream_profiles_list,
            make,
        )?;
        let calibration = Calibration::of(&list)?;
        Ok(Self {
            pipeline,
            queue,
            calibration,
        })
    }

    /// The next set of pictures, waited for no longer than `patience`.
    pub fn wait(&self, patience: Duration) -> Result<Option<Frame>, RealSenseError> {
        let calls = self.queue.calls();
        // Rounded up, so that a wait is never shorter than asked for.
        let milliseconds = patience.as_nanos().div_ceil(1_000_000);
        let patience = c_uint::try_from(milliseconds).unwrap_or(c_uint::MAX);
        let mut frame = null_mut();
        // SAFETY: the queue is owned; the frame is ours where the call says that there is one.
        let came = check(calls, |calls, out| unsafe {
            (calls.try_wait_for_frame)(self.queue.get(), patience, &mut frame, out)
        })?;
        if came == 0 {
            return Ok(None);
        }
        Frame::own(calls, "rs2_try_wait_for_frame", |_, _| frame).map(Some)
    }
}

impl Drop for Pipeline {
    fn drop(&mut self) {
        let calls = self.pipeline.calls();
        // A camera that was pulled out cannot be stopped: nothing is left to do about it.
        // SAFETY: the pipeline is owned, and stopped once.
        let _ = check(calls, |calls, out| unsafe {
            (calls.pipeline_stop)(self.pipeline.get(), out)
        });
    }
}

impl Calibration {
    fn of(list: &Owned<RsProfileList>) -> Result<Self, RealSenseError> {
        let calls = list.calls();
        // SAFETY: the list is owned.
        let count = check(calls, |calls, out| unsafe {
            (calls.get_stream_profiles_count)(list.get(), out)
        })?;
        let (mut depth, mut color) = (None, None);
        for index in 0..count {
            // SAFETY: the list is owned, and its profiles live as long.
            let profile = check(calls, |calls, out| unsafe {
                (calls.get_stream_profile)(list.get(), index, out)
            })?;
            match stream_of(calls, profile)? {
                stream::DEPTH => depth = Some(profile),
                stream::COLOR => color = Some(profile),
                _ => {}
            }
        }
        let missing = RealSenseError::Nothing {
            function: "rs2_pipeline_profile_get_streams",
        };
        let (Some(depth), Some(color)) = (depth, color) else {
            return Err(missing);
        };
        let intrinsics = |profile| {
            let mut intrinsics = RsIntrinsics::default();
            // SAFETY: the profile lives as long as the list; the place to write to is ours.
            check(calls, |calls, out| unsafe {
                (calls.get_video_stream_intrinsics)(profile, &mut intrinsics, out);
            })?;
            Ok(intrinsics)
        };
        let mut depth_to_color = RsExtrinsics::default();
        // SAFETY: as above.
        check(calls, |calls, out| unsafe {
            (calls.get_extrinsics)(depth, color, &mut depth_to_color, out)
        })?;
        Ok(Self {
            depth: intrinsics(depth)?,
            color: intrinsics(color)?,
            depth_to_color,
        })
    }
}

/// Which stream a profile is of; the profile must live.
fn stream_of(calls: &Calls, profile: *const RsProfile) -> Result<c_int, RealSenseError> {
    let [mut stream, mut format, mut index, mut id, mut rate] = [0; 5];
    // SAFETY: the callers' profiles are of lists and frames that they own; the numbers' places are ours.
    check(calls, |calls, out| unsafe {
        (calls.get_stream_profile_data)(
            profile,
            &mut stream,
            &mut format,
            &mut index,
            &mut id,
            &mut rate,
            out,
        );
    })?;
    Ok(stream)
}

/// A picture, or a set of pictures of one moment.
pub(super) struct Frame(Owned<RsFrame>);

impl Frame {
    fn own(
        calls: &Arc<Calls>,
        function: &'static str,
        make: impl FnOnce(&Calls, Out) -> *mut RsFrame,
    ) -> Result<Self, RealSenseError> {
        Owned::new(calls, function, calls.release_frame, make).map(Self)
    }

    /// The set's picture of a stream.
    pub fn picture(&self, stream: c_int) -> Result<Option<Frame>, RealSenseError> {
        let calls = self.0.calls();
        // SAFETY: the set is owned.
        let count = check(calls, |calls, out| unsafe {
            (calls.embedded_frames_count)(self.0.get(), out)
        })?;
        for index in 0..count {
            // SAFETY: the set is owned; what is extracted holds a reference of its own, which is released.
            let extract =
                |calls: &Calls, out| unsafe { (calls.extract_frame)(self.0.get(), index, out) };
            let picture = Self::own(calls, "rs2_extract_frame", extract)?;
            // SAFETY: the picture is owned, and keeps its profile.
            let profile = check(calls, |calls, out| unsafe {
                (calls.get_frame_stream_profile)(picture.0.get(), out)
            })?;
            if stream_of(calls, profile)? == stream {
                return Ok(Some(picture));
            }
        }
        Ok(None)
    }

    /// A number of it, by a call that takes the picture and the place for an error.
    fn number<R>(
        &self,
        call: impl FnOnce(&Calls) -> unsafe extern "C" fn(*const RsFrame, Out) -> R,
    ) -> Result<R, RealSenseError> {
        // SAFETY: the picture is owned.
        check(self.0.calls(), |calls, out| unsafe {
            call(calls)(self.0.get(), out)
        })
    }

    /// When it was taken, and by which clock: one of [`domain`](super::library::domain).
    pub fn time(&self) -> Result<(Milliseconds, c_int), RealSenseError> {
        let time = self.number(|calls| calls.get_frame_timestamp)?;
        Ok((
            Milliseconds(time),
            self.number(|calls| calls.get_frame_timestamp_domain)?,
        ))
    }

    /// Metres that 1 stands for in a depth picture.
    pub fn depth_units(&self) -> Result<f32, RealSenseError> {
        self.number(|calls| calls.depth_frame_get_units)
    }

    /// The picture's rows, each of `width` pixels of `bytes` bytes, without padding.
    ///
    /// # Errors
    /// [`RealSenseError::Picture`] where it is of another size.
    pub fn rows(
        &self,
        name: &'static str,
        [width, height]: [usize; 2],
        bytes: usize,
    ) -> Result<impl Iterator<Item = &[u8]>, RealSenseError> {
        let size = |number: c_int| usize::try_from(number).unwrap_or(0);
        let found = [
            size(self.number(|calls| calls.get_frame_width)?),
            size(self.number(|calls| calls.get_frame_height)?),
        ];
        let stride = size(self.number(|calls| calls.get_frame_stride_in_bytes)?);
        // 0 where the pixels are not the library's own, as with software devices.
        let length = size(self.number(|calls| calls.get_frame_data_size)?);
        let data = self.number(|calls| calls.get_frame_data)?.cast::<u8>();
        let needed = height.saturating_sub(1) * stride + width * bytes;
        let short = stride < width * bytes || (length != 0 && length < needed);
        if found != [width, height] || short || data.is_null() {
            return Err(RealSenseError::Picture {
                stream: name,
                what: format!(
                    "{} x {} pixels, {length} bytes in rows of {stride}; expected {width} x {height} pixels of {bytes} bytes",
                    found[0], found[1]
                ),
            });
        }
        // SAFETY: the library says that rows of so many bytes are there, for as long as the picture is owned; the slice
        // borrows it.
        let pixels = unsafe { slice::from_raw_parts(data, needed) };
        Ok((0..height).map(move |v| &pixels[v * stride..v * stride + width * bytes]))
    }
}

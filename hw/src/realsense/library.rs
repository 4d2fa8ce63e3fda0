//! The C functions of librealsense that are called, and how they are found.
#![allow(
    unsafe_code,
    reason = "loads a C library; the declarations are checked against its headers"
)]

use std::env;
use std::ffi::{OsString, c_char, c_int, c_uint, c_void};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::error::RealSenseError;

/// Types of which only the library knows what is in them.
macro_rules! opaque {
    ($($(#[$doc:meta])* $name:ident),* $(,)?) => {
        $($(#[$doc])* #[repr(C)] pub(super) struct $name { _private: [u8; 0] })*
    };
}

opaque! {
    /// `rs2_error`
    RsError,
    /// `rs2_context`
    RsContext,
    /// `rs2_device_list`
    RsDeviceList,
    /// `rs2_device`
    RsDevice,
    /// `rs2_pipeline`
    RsPipeline,
    /// `rs2_pipeline_profile`
    RsPipelineProfile,
    /// `rs2_config`
    RsConfig,
    /// `rs2_stream_profile_list`
    RsProfileList,
    /// `rs2_stream_profile`
    RsProfile,
    /// `rs2_frame_queue`
    RsQueue,
    /// `rs2_frame`
    RsFrame,
}

/// `rs2_intrinsics`
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RsIntrinsics {
    pub width: c_int,
    pub height: c_int,
    pub ppx: f32,
    pub ppy: f32,
    pub fx: f32,
    pub fy: f32,
    /// `rs2_distortion`
    pub model: c_int,
    pub coeffs: [f32; 5],
}

/// `rs2_extrinsics`
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RsExtrinsics {
    /// Column by column.
    pub rotation: [f32; 9],
    pub translation: [f32; 3],
}

/// `rs2_camera_info`
pub(super) mod info {
    use super::c_int;
    pub const NAME: c_int = 0;
    pub const SERIAL_NUMBER: c_int = 1;
    pub const FIRMWARE_VERSION: c_int = 2;
    pub const USB_TYPE_DESCRIPTOR: c_int = 9;
}

/// `rs2_stream`
pub(super) mod stream {
    use super::c_int;
    pub const DEPTH: c_int = 1;
    pub const COLOR: c_int = 2;
}

/// `rs2_format`
pub(super) mod format {
    use super::c_int;
    pub const Z16: c_int = 1;
    pub const RGB8: c_int = 5;
}

/// `rs2_timestamp_domain`
pub(super) mod domain {
    use super::c_int;
    pub const HARDWARE_CLOCK: c_int = 0;
    pub const SYSTEM_TIME: c_int = 1;
    pub const GLOBAL_TIME: c_int = 2;
}

/// `RS2_EXCEPTION_TYPE_CAMERA_DISCONNECTED`
pub(super) const CAMERA_DISCONNECTED: c_int = 1;

/// Where errors are written.
pub(super) type Out = *mut *mut RsError;
/// `rs2_frame_callback_ptr`
pub(super) type FrameCallback = unsafe extern "C" fn(*mut RsFrame, *mut c_void);

/// Declares the table of functions: each by its name in the library without `rs2_`.
macro_rules! calls {
    ($($name:ident($($argument:ty),*) $(-> $result:ty)?;)*) => {
        /// The functions of a loaded library.
        pub(super) struct Calls {
            $(pub $name: unsafe extern "C" fn($($argument),*) $(-> $result)?,)*
            /// Keeps the functions where they are; those loaded before it are kept too.
            pub libraries: Vec<libloading::Library>,
        }

        impl Calls {
            fn find(libraries: Vec<libloading::Library>, path: &Path) -> Result<Self, RealSenseError> {
                let library = libraries.last().ok_or_else(|| unloadable(path, "no library is named"))?;
                $(
                    // SAFETY: the function of this name has this type in the headers of 2.59, and the table keeps the
                    // library loaded as long as the pointer.
                    let $name = *unsafe { library.get(concat!("rs2_", stringify!($name), "\0").as_bytes()) }
                        .map_err(|error| unloadable(path, error))?;
                )*
                Ok(Self { $($name,)* libraries })
            }
        }
    };
}

calls! {
    get_api_version(Out) -> c_int;
    get_error_message(*const RsError) -> *const c_char;
    get_failed_function(*const RsError) -> *const c_char;
    get_failed_args(*const RsError) -> *const c_char;
    get_librealsense_exception_type(*const RsError) -> c_int;
    free_error(*mut RsError);
    get_time(Out) -> f64;

    create_context(c_int, Out) -> *mut RsContext;
    delete_context(*mut RsContext);
    query_devices(*const RsContext, Out) -> *mut RsDeviceList;
    get_device_count(*const RsDeviceList, Out) -> c_int;
    device_list_contains(*const RsDeviceList, *const RsDevice, Out) -> c_int;
    delete_device_list(*mut RsDeviceList);
    create_device(*const RsDeviceList, c_int, Out) -> *mut RsDevice;
    delete_device(*mut RsDevice);
    supports_device_info(*const RsDevice, c_int, Out) -> c_int;
    get_device_info(*const RsDevice, c_int, Out) -> *const c_char;

    create_config(Out) -> *mut RsConfig;
    delete_config(*mut RsConfig);
    config_enable_stream(*mut RsConfig, c_int, c_int, c_int, c_int, c_int, c_int, Out);
    create_pipeline(*mut RsContext, Out) -> *mut RsPipeline;
    delete_pipeline(*mut RsPipeline);
    pipeline_set_device(*mut RsPipeline, *mut RsDevice, Out);
    pipeline_start_with_config_and_callback(*mut RsPipeline, *mut RsConfig, FrameCallback, *mut c_void, Out) -> *mut RsPipelineProfile;
    pipeline_stop(*mut RsPipeline, Out);
    delete_pipeline_profile(*mut RsPipelineProfile);
    pipeline_profile_get_streams(*mut RsPipelineProfile, Out) -> *mut RsProfileList;
    delete_stream_profiles_list(*mut RsProfileList);
    get_stream_profiles_count(*const RsProfileList, Out) -> c_int;
    get_stream_profile(*const RsProfileList, c_int, Out) -> *const RsProfile;
    get_stream_profile_data(*const RsProfile, *mut c_int, *mut c_int, *mut c_int, *mut c_int, *mut c_int, Out);
    get_video_stream_intrinsics(*const RsProfile, *mut RsIntrinsics, Out);
    get_extrinsics(*const RsProfile, *const RsProfile, *mut RsExtrinsics, Out);

    create_frame_queue(c_int, Out) -> *mut RsQueue;
    delete_frame_queue(*mut RsQueue);
    enqueue_frame(*mut RsFrame, *mut c_void);
    try_wait_for_frame(*mut RsQueue, c_uint, *mut *mut RsFrame, Out) -> c_int;
    embedded_frames_count(*mut RsFrame, Out) -> c_int;
    extract_frame(*mut RsFrame, c_int, Out) -> *mut RsFrame;
    release_frame(*mut RsFrame);
    get_frame_stream_profile(*const RsFrame, Out) -> *const RsProfile;
    get_frame_data(*const RsFrame, Out) -> *const c_void;
    get_frame_data_size(*const RsFrame, Out) -> c_int;
    get_frame_width(*const RsFrame, Out) -> c_int;
    get_frame_height(*const RsFrame, Out) -> c_int;
    get_frame_stride_in_bytes(*const RsFrame, Out) -> c_int;
    get_frame_timestamp(*const RsFrame, Out) -> f64;
    get_frame_timestamp_domain(*const RsFrame, Out) -> c_int;
    depth_frame_get_units(*const RsFrame, Out) -> f32;
}

fn unloadable(path: &Path, reason: impl ToString) -> RealSenseError {
    RealSenseError::Library {
        path: path.to_owned(),
        reason: reason.to_string(),
    }
}

/// The environment variable that names the library.
pub(super) const VARIABLE: &str = "REALSENSE_LIBRARY";

/// What to load, in order: librealsense is the last.
pub(super) fn named_libraries() -> Vec<PathBuf> {
    let system = if cfg!(windows) {
        "realsense2.dll"
    } else if cfg!(target_os = "macos") {
        "librealsense2.dylib"
    } else {
        "librealsense2.so"
    };
    let list = env::var_os(VARIABLE).filter(|list| !list.is_empty());
    env::split_paths(&list.unwrap_or_else(|| OsString::from(system))).collect()
}

impl Calls {
    /// Loads the libraries in order, and finds the functions in the last.
    pub fn load(paths: &[PathBuf]) -> Result<Arc<Self>, RealSenseError> {
        let mut libraries = Vec::new();
        for path in paths {
            libraries.push(open(path)?);
        }
        let path = paths.last().map_or(Path::new(""), PathBuf::as_path);
        Self::find(libraries, path).map(Arc::new)
    }
}

/// Loads a library with its symbols visible to those loaded after it.
fn open(path: &Path) -> Result<libloading::Library, RealSenseError> {
    // SAFETY: loading runs the library's initialisers; the user names librealsense, and what it needs, which have none that
    // ask anything of the caller.
    #[cfg(unix)]
    let library = unsafe {
        use libloading::os::unix::{Library, RTLD_GLOBAL, RTLD_LAZY};
        Library::open(Some(path), RTLD_LAZY | RTLD_GLOBAL).map(libloading::Library::from)
    };
    // SAFETY: as above.
    #[cfg(not(unix))]
    let library = unsafe { libloading::Library::new(path) };
    library.map_err(|error| unloadable(path, error))
}

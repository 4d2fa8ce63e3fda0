//! What goes wrong with librealsense.

use std::path::PathBuf;

use thiserror::Error;

/// Why a RealSense camera cannot be used.
#[non_exhaustive]
#[derive(Debug, Error)]
pub enum RealSenseError {
    /// The library cannot be loaded.
    #[error(
        "cannot load {}: {reason}; install librealsense 2.56 or newer, or `pip install pyrealsense2` and set REALSENSE_LIBRARY \
         to what scripts/realsense_library.py prints",
        path.display()
    )]
    Library {
        /// Its path or name.
        path: PathBuf,
        /// What the system's loader says.
        reason: String,
    },
    /// The library is not one that this program can talk to.
    #[error("librealsense {major}.{minor} was loaded; expected 2.56 or a newer 2.x")]
    Version {
        /// 2 of 2.59.
        major: i32,
        /// 59 of 2.59.
        minor: i32,
    },
    /// A call failed.
    #[error("librealsense: {function}({arguments}): {message}")]
    Call {
        /// The C function.
        function: String,
        /// Its arguments, as librealsense prints them.
        arguments: String,
        /// What went wrong.
        message: String,
        /// Whether it says that the camera is gone.
        disconnected: bool,
    },
    /// A call gave nothing where something was promised.
    #[error("librealsense: {function} gave nothing and no error")]
    Nothing {
        /// The C function.
        function: &'static str,
    },
    /// No such camera.
    #[error("no RealSense camera with the serial number {serial}; there are: {found}")]
    NoSuchCamera {
        /// The number asked for.
        serial: String,
        /// Those found, or "none".
        found: String,
    },
    /// The camera cannot stream so.
    #[error(
        "camera {serial} cannot stream depth at {depth} and colour at {color}, {rate} pictures a second ({reason}){usb}"
    )]
    Streams {
        /// Which one.
        serial: String,
        /// Size of depth images.
        depth: String,
        /// Size of colour images.
        color: String,
        /// Pictures per second.
        rate: u32,
        /// What librealsense says.
        reason: String,
        /// What is wrong with its USB port, or nothing.
        usb: String,
    },
    /// Numbers of the factory's calibration that are none.
    #[error("the factory calibration of the {stream} stream is unusable: {what}")]
    Calibration {
        /// Which stream.
        stream: &'static str,
        /// What is wrong.
        what: String,
    },
    /// A picture that is not what was asked for.
    #[error("a {stream} picture is unusable: {what}")]
    Picture {
        /// Which stream.
        stream: &'static str,
        /// What is wrong.
        what: String,
    },
}

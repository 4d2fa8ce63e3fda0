//! Intel RealSense D400 cameras through librealsense, which is loaded at run time.
//!
//! Nothing of librealsense is needed to build: [`RealSense::load`] opens the library that the environment variable
//! `REALSENSE_LIBRARY` names, or else the system's `librealsense2.so`. The variable is a list as `PATH` is; what stands before
//! the last is loaded first. So the library inside the PyPI wheel `pyrealsense2` serves too, once libpython is loaded:
//! `scripts/realsense_library.py` prints the list for it. Its version must be 2.56 or newer.
//!
//! Depth is laid onto the colour image here ([`Aligner`]), not by librealsense: its own alignment copies the depth camera's
//! distances, though the colour camera stands elsewhere and is turned a little.
//!
//! The declared functions, types and numbers are those of the headers `librealsense2/h/*.h` of version 2.59.

mod align;
mod camera;
mod error;
mod handles;
mod lens;
mod library;
#[cfg(test)]
mod software;
#[cfg(test)]
mod tests;

pub use align::Aligner;
pub use camera::{RealSense, RealSenseCamera, RealSenseInfo, RealSenseSetup};
pub use error::RealSenseError;

//! Devices in memory, behind the same traits as the real ones.

pub mod camera;

//! The robot, its physics and its virtual cameras.
pub mod cloud;

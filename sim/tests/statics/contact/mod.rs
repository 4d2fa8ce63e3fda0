//! Robots that touch obstacles.

mod derivatives;
mod hostile;
mod planar;
mod random;
mod scenes;

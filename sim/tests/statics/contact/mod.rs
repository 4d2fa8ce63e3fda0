//! Robots that touch obstacles.

mod derivatives;
mod friction;
mod hostile;
mod itself;
mod planar;
mod random;
mod scenes;

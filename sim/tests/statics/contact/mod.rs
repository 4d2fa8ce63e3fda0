//! Robots that touch obstacles.

mod by_the_robot;
mod derivatives;
mod friction;
mod hostile;
mod itself;
mod large;
mod own_friction;
mod paths;
mod planar;
mod random;
mod scenes;
mod smoothing;

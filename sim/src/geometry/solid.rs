//! Solids: shapes with a pose, a colour and a name.

use nalgebra::Isometry3;

use super::Shape;

/// What a solid is a part of, and what a pixel of a picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Instance {
    /// Nothing.
    Background,
    /// The robot's base.
    Base,
    /// The disc with this index, from the base up.
    Disc(u16),
    /// The tendon with this index, in a command's order.
    Tendon(u16),
    /// The elastic rod through the discs.
    Rod,
    /// What hangs from the distal disc.
    Payload,
    /// The obstacle with this index.
    Obstacle(u16),
    /// Something, in a picture of a real camera.
    Unknown,
}

impl Instance {
    /// Its value in mask images: 0 background, 1 base, 2 payload, 3 unknown, 4 rod, and from 10,000 on discs, from 20,000 on
    /// tendons, from 40,000 on obstacles, by their index.
    pub fn value(self) -> u16 {
        match self {
            Self::Background => 0,
            Self::Base => 1,
            Self::Payload => 2,
            Self::Unknown => 3,
            Self::Rod => 4,
            Self::Disc(index) => 10_000_u16.saturating_add(index),
            Self::Tendon(index) => 20_000_u16.saturating_add(index),
            Self::Obstacle(index) => 40_000_u16.saturating_add(index),
        }
    }
}

/// A shape somewhere in the world.
#[derive(Clone, Debug)]
pub struct Solid {
    /// Its shape.
    pub shape: Shape,
    /// Pose in the world (m).
    pub pose: Isometry3<f64>,
    /// Colour under full light.
    pub color: [u8; 3],
    /// What its pixels are labelled with.
    pub instance: Instance,
}

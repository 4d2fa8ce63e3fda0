//! What may stand around a robot.

use nalgebra::{Isometry3, Translation3};
use tdcr_sim::geometry::{Shape, ShapeError};
use tdcr_sim::render::Visuals;

/// A table under the robot's base with three things on it, and walls around it (m): what masks must remove.
///
/// The table's top is at `height` of the world, so a robot on its base stands on it at 0. Colours are of a dull kind, besides a
/// red box.
///
/// # Errors
/// None but those of the shapes, whose sizes are given here.
pub fn table(height: f64) -> Result<Visuals, ShapeError> {
    const WOOD: [u8; 3] = [168, 142, 112];
    const WALL: [u8; 3] = [176, 178, 172];
    const CARDBOARD: [u8; 3] = [150, 120, 85];
    const STEEL: [u8; 3] = [120, 124, 130];
    const RED: [u8; 3] = [190, 40, 40];
    let boxes = [
        ([0.6, 0.6, 0.01], [0.0, 0.0, -0.01], WOOD),
        ([0.08, 0.05, 0.06], [0.28, 0.12, 0.06], CARDBOARD),
        ([0.05, 0.05, 0.09], [-0.22, 0.25, 0.09], RED),
        ([2.0, 0.02, 1.5], [0.0, 1.6, 0.5], WALL),
        ([2.0, 0.02, 1.5], [0.0, -1.6, 0.5], WALL),
        ([0.02, 2.0, 1.5], [1.6, 0.0, 0.5], WALL),
        ([0.02, 2.0, 1.5], [-1.6, 0.0, 0.5], WALL),
    ];
    let mut visuals = Visuals::default();
    let at = |[x, y, z]: [f64; 3]| Isometry3::from(Translation3::new(x, y, z + height));
    for (half_sides, place, color) in boxes {
        visuals.add_obstacle(Shape::cuboid(half_sides)?, at(place), color);
    }
    visuals.add_obstacle(Shape::cylinder(0.04, 0.07)?, at([-0.1, -0.3, 0.07]), STEEL);
    Ok(visuals)
}

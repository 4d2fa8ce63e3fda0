//! Pipes: stand-in.

use std::f64::consts::TAU;

use nalgebra::{UnitQuaternion, Vector3};

use super::{Shape, ShapeError};

/// A round bore along a path, in its own frame.
#[derive(Clone, Debug)]
pub struct Pipe(Shape);

impl Pipe {
    /// A pipe of a radius and a length (m) about the z axis, its middle at the origin.
    ///
    /// # Errors
    /// As [`along`](Self::along).
    pub fn straight(radius: f64, length: f64) -> Result<Self, ShapeError> {
        Self::along(
            radius,
            &[[0.0, 0.0, -length / 2.0], [0.0, 0.0, length / 2.0]],
        )
    }

    /// A pipe of a radius about the line through the points of `path` (m).
    ///
    /// # Errors
    /// [`ShapeError::Length`] for a radius or a piece that is not above 0; [`ShapeError::Empty`] for fewer than two points.
    pub fn along(radius: f64, path: &[[f64; 3]]) -> Result<Self, ShapeError> {
        let above_0 = |what, value: f64| match value.is_finite() && value > 0.0 {
            true => Ok(()),
            false => Err(ShapeError::Length {
                shape: "pipe",
                what,
                value,
            }),
        };
        above_0("radius", radius)?;
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        for ends in path.windows(2) {
            let [from, to] = [ends[0], ends[1]].map(Vector3::from);
            above_0("piece", (to - from).norm())?;
            let turn = UnitQuaternion::rotation_between(&Vector3::z(), &(to - from));
            let turn =
                turn.unwrap_or_else(|| UnitQuaternion::from_euler_angles(TAU / 2.0, 0.0, 0.0));
            let first = vertices.len() as u32;
            for side in 0..12 {
                let (sin, cos) = (TAU * f64::from(side) / 12.0).sin_cos();
                let across = turn * Vector3::new(radius * cos, radius * sin, 0.0);
                vertices.extend([from, to].map(|end| <[f64; 3]>::from(end + across)));
                let [a, b] = [2 * side, 2 * ((side + 1) % 12)].map(|corner| first + corner);
                triangles.extend([[a, b, b + 1], [a, b + 1, a + 1]]);
            }
        }
        Ok(Self(Shape::mesh(&vertices, &triangles)?))
    }

    /// Its wall, as a mesh.
    pub fn mesh(&self) -> Shape {
        self.0.clone()
    }
}

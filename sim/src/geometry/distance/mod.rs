//! The signed distance of a point from a shape, with its gradient and its Hessian by the point.
//!
//! Outside a box or a cylinder, whose faces meet at right angles, the squared distance is the sum of the squared distances from the
//! faces that the point is beyond: `convex` has the Hessian that follows. Triangle meshes have a distance for each of their
//! features: `mesh`.

mod adjacency;
mod mesh;
mod triangle;

pub(crate) use adjacency::Adjacency;

use nalgebra::{Matrix3, Vector3};
use parry3d_f64::math::Vec3;
use parry3d_f64::query::PointQueryWithLocation;
use parry3d_f64::shape::TrianglePointLocation;

use super::primitives::Mesh;
use super::shape::{Kind, Shape};

/// What of a shape's surface is nearest to a point: the point minus `distance` times `normal`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Nearest {
    /// Distance from the surface (m), below 0 inside; never below 0 for a mesh, which has no inside.
    pub distance: f64,
    /// Gradient of the distance by the point: the outward normal.
    pub normal: Vector3<f64>,
    /// Hessian of the distance by the point (1/m), symmetric and normal to `normal`. Terms that grow without bound at a point
    /// (on a cylinder's axis, on an edge) are zero there.
    pub curvature: Matrix3<f64>,
}

impl Nearest {
    /// Of a plane.
    pub(crate) fn flat(distance: f64, normal: Vector3<f64>) -> Self {
        Self {
            distance,
            normal,
            curvature: Matrix3::zeros(),
        }
    }

    /// Of the surface at `radius` (m) from a point, or from a line along a unit vector; `away` (m) leads from it at right angles
    /// to the point asked about. With e the unit vector of `away` and t that of the line, the Hessian is
    /// `(I - ee' - tt') / |away|`. On the line the normal is `otherwise`.
    pub(super) fn round(
        away: &Vector3<f64>,
        radius: f64,
        line: Option<Vector3<f64>>,
        otherwise: Vector3<f64>,
    ) -> Self {
        let normal = direction(away, otherwise);
        let along = line.map_or_else(Matrix3::zeros, |t| t * t.transpose());
        let across = Matrix3::identity() - normal * normal.transpose() - along;
        Self {
            distance: away.norm() - radius,
            normal,
            curvature: across * inverse(away.norm()),
        }
    }
}

impl Shape {
    /// The surface nearest to a point in the shape's frame (m).
    pub(crate) fn nearest(&self, point: &Vector3<f64>) -> Nearest {
        match &self.0 {
            Kind::Cylinder(c) => {
                let across = Vector3::new(point.x, point.y, 0.0);
                let cap = Vector3::z() * point.z.signum();
                convex(&[
                    Nearest::round(&across, c.radius, Some(Vector3::z()), Vector3::x()),
                    Nearest::flat(point.z.abs() - c.half_height, cap),
                ])
            }
            Kind::Cuboid(cuboid) => {
                let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
                convex(&[0, 1, 2].map(|k: usize| {
                    let beyond = point[k].abs() - cuboid.half[k];
                    Nearest::flat(beyond, axes[k] * point[k].signum())
                }))
            }
            Kind::Sphere(sphere) => Nearest::round(point, sphere.radius, None, Vector3::x()),
            Kind::Capsule(c) => {
                let middle = point.z.clamp(-c.half_length, c.half_length);
                let side = (middle == point.z).then(Vector3::z);
                let away = point - Vector3::z() * middle;
                Nearest::round(&away, c.radius, side, Vector3::x())
            }
            Kind::Mesh(mesh) => on_mesh(mesh, point),
        }
    }

    /// Appends what of the surface is less than `reach` (m) from a point in the shape's frame (m) and nearer to it than all of
    /// the surface around: of a mesh all such faces, edges and vertices, each once; of other shapes the nearest surface.
    pub(crate) fn features(&self, point: &Vector3<f64>, reach: f64, found: &mut Vec<Nearest>) {
        match &self.0 {
            Kind::Mesh(mesh) => mesh.features(point, reach, found),
            _ => {
                let nearest = self.nearest(point);
                if nearest.distance < reach {
                    found.push(nearest);
                }
            }
        }
    }

    /// Whether the distance is known to be a convex function of the point: that of all shapes but meshes.
    pub(crate) fn is_convex(&self) -> bool {
        !matches!(self.0, Kind::Mesh(_))
    }

    /// Whether a point in the shape's frame (m) is inside. A mesh has an inside if its triangles are oriented alike and leave no
    /// edge open; where parts overlap, what is inside any of them is inside.
    pub(crate) fn contains(&self, point: &Vector3<f64>) -> bool {
        match &self.0 {
            Kind::Mesh(mesh) => mesh.contains(point),
            _ => self.nearest(point).distance < 0.0,
        }
    }
}

/// The place on a mesh nearest to a point (m).
fn on_mesh(mesh: &Mesh, point: &Vector3<f64>) -> Nearest {
    let at = Vec3::new(point.x, point.y, point.z);
    let (found, (triangle, location)) = mesh.mesh.project_local_point_and_get_location(at, false);
    let away = point - Vector3::new(found.point.x, found.point.y, found.point.z);
    match location {
        TrianglePointLocation::OnFace(..) | TrianglePointLocation::OnSolid => {
            Nearest::flat(away.norm(), direction(&away, Vector3::z()))
        }
        TrianglePointLocation::OnEdge(edge, _) => {
            let corners = mesh.corners(triangle);
            let edge = edge as usize;
            let along = corners[(edge + 1) % 3] - corners[edge];
            Nearest::round(&away, 0.0, along.try_normalize(0.0), Vector3::z())
        }
        TrianglePointLocation::OnVertex(_) => Nearest::round(&away, 0.0, None, Vector3::z()),
    }
}

/// The direction of a vector; `other` for one without length.
pub(super) fn direction(vector: &Vector3<f64>, other: Vector3<f64>) -> Vector3<f64> {
    vector.try_normalize(0.0).unwrap_or(other)
}

/// The inverse; 0 of what has none.
pub(super) fn inverse(value: f64) -> f64 {
    if value.is_normal() { 1.0 / value } else { 0.0 }
}

/// Of a solid bounded by faces at right angles to each other, one at least, by what each of them is to the point alone.
///
/// With `b` the distances from the faces that the point is outside of, `n` their gradients and `H` their Hessians, the distance is
/// `d = sqrt(sum b²)`, its gradient `g = sum b n / d`, its Hessian `(sum (nn' + b H) - gg') / d`.
pub(super) fn convex(faces: &[Nearest]) -> Nearest {
    let outside = || faces.iter().filter(|face| face.distance > 0.0);
    if outside().count() < 2 {
        // Inside, the nearest face is the one that the point is least below.
        let highest =
            faces
                .iter()
                .copied()
                .reduce(|highest, face| match face.distance > highest.distance {
                    true => face,
                    false => highest,
                });
        return highest.unwrap_or_else(|| Nearest::flat(f64::NEG_INFINITY, Vector3::z()));
    }
    let away: Vector3<f64> = outside().map(|face| face.normal * face.distance).sum();
    let distance = outside()
        .map(|face| face.distance.powi(2))
        .sum::<f64>()
        .sqrt();
    let normal = away * inverse(distance);
    let bends: Matrix3<f64> = outside()
        .map(|face| face.normal * face.normal.transpose() + face.curvature * face.distance)
        .sum();
    Nearest {
        distance,
        normal,
        curvature: (bends - normal * normal.transpose()) * inverse(distance),
    }
}

#[cfg(test)]
pub(super) mod tests;

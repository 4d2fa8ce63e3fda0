//! The surface of a shape nearest to a point.

use nalgebra::Vector3;
use parry3d_f64::math::Vec3;
use parry3d_f64::query::PointQuery;

use super::shape::{Kind, Shape};

/// What of a shape's surface is nearest to a point: the point minus `distance` times `normal`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Nearest {
    /// Distance from the surface (m), below 0 inside; never below 0 for a mesh, which has no inside.
    pub distance: f64,
    /// Gradient of the distance by the point: the outward normal.
    pub normal: Vector3<f64>,
}

impl Shape {
    /// The surface nearest to a point in the shape's frame (m).
    pub(crate) fn nearest(&self, point: &Vector3<f64>) -> Nearest {
        match &self.0 {
            Kind::Cylinder(c) => {
                let across = Vector3::new(point.x, point.y, 0.0);
                let radial = direction(&across, Vector3::x());
                let along = Vector3::z() * point.z.signum();
                let beyond = [across.norm() - c.radius, point.z.abs() - c.half_height];
                convex(&beyond, &[radial, along])
            }
            Kind::Cuboid(cuboid) => {
                let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
                let beyond = [0, 1, 2].map(|k: usize| point[k].abs() - cuboid.half[k]);
                convex(&beyond, &[0, 1, 2].map(|k| axes[k] * point[k].signum()))
            }
            Kind::Sphere(sphere) => round(point, sphere.radius),
            Kind::Capsule(c) => {
                let middle = point.z.clamp(-c.half_length, c.half_length);
                round(&(point - Vector3::z() * middle), c.radius)
            }
            Kind::Mesh(mesh) => {
                let at = Vec3::new(point.x, point.y, point.z);
                let found = mesh.mesh.project_local_point(at, false).point;
                let away = point - Vector3::new(found.x, found.y, found.z);
                Nearest {
                    distance: away.norm(),
                    normal: direction(&away, Vector3::z()),
                }
            }
        }
    }
}

/// The direction of a vector; `other` for one without length.
fn direction(vector: &Vector3<f64>, other: Vector3<f64>) -> Vector3<f64> {
    vector.try_normalize(0.0).unwrap_or(other)
}

fn round(from_middle: &Vector3<f64>, radius: f64) -> Nearest {
    Nearest {
        distance: from_middle.norm() - radius,
        normal: direction(from_middle, Vector3::x()),
    }
}

/// Of a solid bounded by faces at right angles to each other: how far the point is `beyond` each (m), and their normals.
fn convex<const N: usize>(beyond: &[f64; N], normals: &[Vector3<f64>; N]) -> Nearest {
    let outside: Vector3<f64> = (beyond.iter().zip(normals))
        .map(|(beyond, normal)| normal * beyond.max(0.0))
        .sum();
    if let Some((normal, distance)) = nalgebra::Unit::try_new_and_get(outside, 0.0) {
        return Nearest {
            distance,
            normal: normal.into_inner(),
        };
    }
    // Inside the nearest face is the one that the point is least below.
    let mut nearest = Nearest {
        distance: f64::NEG_INFINITY,
        normal: Vector3::z(),
    };
    for (&distance, &normal) in beyond.iter().zip(normals) {
        if distance > nearest.distance {
            nearest = Nearest { distance, normal };
        }
    }
    nearest
}

#[cfg(test)]
mod tests {
    use parry3d_f64::shape::{Ball, Capsule, Cuboid, Cylinder, Shape as Theirs};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// parry's cylinders and capsules stand along y: a mirrored point is as far from a mirrored shape.
    #[test]
    fn the_nearest_surface_is_that_of_parry() {
        let shapes: [(Result<Shape, _>, Box<dyn Theirs>); 4] = [
            (Shape::cylinder(0.3, 0.1), Box::new(Cylinder::new(0.1, 0.3))),
            (
                Shape::cuboid([0.1, 0.3, 0.2]),
                Box::new(Cuboid::new(Vec3::new(0.1, 0.2, 0.3))),
            ),
            (Shape::sphere(0.3), Box::new(Ball::new(0.3))),
            (Shape::capsule(0.2, 0.3), Box::new(Capsule::new_y(0.3, 0.2))),
        ];
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        for (shape, theirs) in shapes {
            let shape = shape.expect("lengths above 0");
            for _ in 0..200 {
                let point = Vector3::from_fn(|_, _| rng.random_range(-0.6..0.6));
                let found = shape.nearest(&point);
                let mirrored = Vec3::new(point.x, point.z, point.y);
                let expected = theirs.project_local_point(mirrored, false);
                let surface = point - found.normal * found.distance;
                let miss =
                    surface - Vector3::new(expected.point.x, expected.point.z, expected.point.y);
                assert!(miss.norm() < 1e-9, "{shape:?}, {point}: {miss}");
                assert_eq!(
                    found.distance <= 0.0,
                    expected.is_inside,
                    "{shape:?}, {point}"
                );
                assert!((found.normal.norm() - 1.0).abs() < 1e-12);
            }
        }
    }
}

//! Shapes and the rays that meet them.

use nalgebra::{Point3, Vector3};
use parry3d_f64::math::Vec3;
use parry3d_f64::query::{Ray, RayCast};
use parry3d_f64::shape::Cuboid;

/// A shape, centred on its frame's origin.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Shape {
    /// A cylinder about its z axis.
    Cylinder(Cylinder),
    /// A box.
    Cuboid(Cuboid),
}

/// A cylinder about the z axis (m). Cast in closed form: parry walks to its cylinders by an
/// iterative search (GJK), which is slower and less exact; a test compares the two.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cylinder {
    pub radius: f64,
    pub half_height: f64,
}

/// Where a ray meets a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Hit {
    /// Ray parameter at the hit.
    pub depth: f64,
    /// Unit normal of the surface, in the shape's frame.
    pub normal: Vector3<f64>,
}

/// What rays can meet.
pub(crate) trait Cast {
    /// First hit of the ray `origin + t direction`, `t >= 0`, from outside, in the shape's frame.
    fn cast(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<Hit>;
}

impl Shape {
    /// How far the shape reaches from its centre along the unit vector `axis` (m).
    pub fn extent(&self, axis: &Vector3<f64>) -> f64 {
        match self {
            Shape::Cylinder(cylinder) => {
                cylinder.radius * axis.x.hypot(axis.y) + cylinder.half_height * axis.z.abs()
            }
            Shape::Cuboid(cuboid) => {
                let half = cuboid.half_extents;
                half.x * axis.x.abs() + half.y * axis.y.abs() + half.z * axis.z.abs()
            }
        }
    }
}

impl Cast for Cuboid {
    fn cast(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<Hit> {
        let ray = Ray::new(
            Vec3::new(origin.x, origin.y, origin.z),
            Vec3::new(direction.x, direction.y, direction.z),
        );
        let hit = self.cast_local_ray_and_get_normal(&ray, f64::MAX, true)?;
        Some(Hit {
            depth: hit.time_of_impact,
            normal: Vector3::new(hit.normal.x, hit.normal.y, hit.normal.z),
        })
    }
}

impl Cast for Cylinder {
    /// A cylinder is the part of an infinite tube that lies between two planes: a ray enters it
    /// when it is inside both for the first time.
    fn cast(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<Hit> {
        let a = direction.x * direction.x + direction.y * direction.y;
        let b = origin.x * direction.x + origin.y * direction.y;
        let c = origin.x * origin.x + origin.y * origin.y - self.radius * self.radius;
        let discriminant = b * b - a * c;
        if discriminant < 0.0 {
            return None;
        }
        let root = discriminant.sqrt();
        // A ray along the axis is inside the tube for ever or never.
        let (tube_in, tube_out) = if a > 0.0 {
            ((-b - root) / a, (-b + root) / a)
        } else if c <= 0.0 {
            (f64::NEG_INFINITY, f64::INFINITY)
        } else {
            return None;
        };
        let slab = -self.half_height.copysign(direction.z);
        let (slab_in, slab_out) = if direction.z != 0.0 {
            (
                (slab - origin.z) / direction.z,
                (-slab - origin.z) / direction.z,
            )
        } else if origin.z.abs() <= self.half_height {
            (f64::NEG_INFINITY, f64::INFINITY)
        } else {
            return None;
        };
        let depth = tube_in.max(slab_in);
        if depth < 0.0 || depth > tube_out.min(slab_out) {
            return None;
        }
        let normal = if tube_in > slab_in {
            let x = origin.x + depth * direction.x;
            let y = origin.y + depth * direction.y;
            Vector3::new(x / self.radius, y / self.radius, 0.0)
        } else {
            Vector3::new(0.0, 0.0, 1.0f64.copysign(-direction.z))
        };
        Some(Hit { depth, normal })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use parry3d_f64::shape::Cylinder as ParryCylinder;
    use rand::{Rng, RngExt, SeedableRng};

    fn between(rng: &mut impl Rng, low: f64, high: f64) -> f64 {
        low + (high - low) * rng.random::<f64>()
    }

    fn cylinder(radius: f64, half_height: f64) -> Cylinder {
        Cylinder {
            radius,
            half_height,
        }
    }

    #[test]
    fn cylinders_are_hit_where_parry_hits_them() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let mut hits = 0;
        for _ in 0..20_000 {
            let (radius, half_height) =
                (between(&mut rng, 0.01, 0.1), between(&mut rng, 0.01, 0.1));
            let origin = Point3::from(Vector3::from_fn(|_, _| between(&mut rng, -1.0, 1.0)));
            if origin.coords.norm() < 0.2 {
                continue; // rays start outside
            }
            let target = Vector3::from_fn(|_, _| between(&mut rng, -0.1, 0.1));
            let direction = target - origin.coords;
            // parry's cylinders stand along y.
            let ray = Ray::new(
                Vec3::new(origin.x, origin.z, -origin.y),
                Vec3::new(direction.x, direction.z, -direction.y),
            );
            let expected =
                ParryCylinder::new(half_height, radius).cast_local_ray(&ray, f64::MAX, true);
            let found = cylinder(radius, half_height).cast(&origin, &direction);
            // At a grazing ray the iterative search and the closed form may differ in whether it hits.
            if let (Some(expected), Some(hit)) = (expected, found) {
                assert!(
                    (hit.depth - expected).abs() < 1e-5,
                    "{} {expected}",
                    hit.depth
                );
                hits += 1;
            } else {
                let margin = cylinder(radius * 0.999, half_height * 0.999)
                    .cast(&origin, &direction)
                    .is_some();
                let outside = cylinder(radius * 1.001, half_height * 1.001)
                    .cast(&origin, &direction)
                    .is_none();
                assert!(
                    !margin || expected.is_some(),
                    "parry missed what is well inside"
                );
                assert!(
                    !outside || expected.is_none(),
                    "parry hit what is well outside"
                );
            }
        }
        assert!(hits > 5_000, "only {hits} rays hit");
    }

    #[test]
    fn rays_along_and_across_the_axis_hit_caps_and_side() {
        let cast = |origin: [f64; 3], direction: [f64; 3]| {
            cylinder(0.02, 0.01).cast(&Point3::from(origin), &Vector3::from(direction))
        };
        let top = cast([0.01, 0.0, 1.0], [0.0, 0.0, -1.0]).expect("a hit");
        assert!((top.depth - 0.99).abs() < 1e-12 && top.normal == Vector3::z());
        let side = cast([0.0, -1.0, 0.005], [0.0, 1.0, 0.0]).expect("a hit");
        assert!((side.depth - 0.98).abs() < 1e-12 && (side.normal + Vector3::y()).norm() < 1e-12);
        assert_eq!(cast([0.03, 0.0, 1.0], [0.0, 0.0, -1.0]), None);
        assert_eq!(cast([0.0, -1.0, 0.02], [0.0, 1.0, 0.0]), None);
        assert_eq!(
            cast([0.0, 1.0, 0.0], [0.0, 1.0, 0.0]),
            None,
            "behind the origin"
        );
    }
}

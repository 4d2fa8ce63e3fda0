//! Where rays meet shapes.
//!
//! Casts are free of branches where they can be, so that the compiler casts the rays of several
//! pixels at once.

use nalgebra::Vector3;
use parry3d_f64::math::Vec3;
use parry3d_f64::query::{Ray, RayCast};
use parry3d_f64::shape::TriMesh;

/// Where a ray meets a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Hit {
    /// Ray parameter at the hit; infinite where there is none.
    pub depth: f64,
    /// `|normal . direction|` of the surface's unit normal.
    pub facing: f64,
}

/// What rays can meet.
pub(crate) trait Cast {
    /// First hit of the ray `origin + t direction`, `t >= 0`, from outside, in the shape's frame.
    fn cast(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Hit;

    /// Bounds on `x` within which rays of directions `start + x per_unit` may hit.
    fn interval(
        &self,
        _origin: &Vector3<f64>,
        _start: &Vector3<f64>,
        _per_unit: &Vector3<f64>,
    ) -> [f64; 2] {
        [f64::NEG_INFINITY, f64::INFINITY]
    }
}

/// A cylinder about the z axis (m). Cast in closed form: parry walks to its cylinders by an
/// iterative search (GJK), which is slower and less exact; a test compares the two.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cylinder {
    pub radius: f64,
    pub half_height: f64,
}

/// A box along the axes (m).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cuboid {
    pub half: Vector3<f64>,
}

/// A sphere about the origin (m).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sphere {
    pub radius: f64,
}

/// What is within `radius` of a piece of the z axis (m).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Capsule {
    pub radius: f64,
    pub half_length: f64,
}

/// Triangles, in parry's bounding volume hierarchy, and the box around them (m).
#[derive(Clone, Debug)]
pub(crate) struct Mesh {
    pub mesh: TriMesh,
    pub middle: Vector3<f64>,
    pub half: Vector3<f64>,
}

/// Smallest divisor: quotients by less would be no numbers where 0 is divided by 0.
const TINY: f64 = 1e-200;

#[inline(always)]
fn greater(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

#[inline(always)]
fn lesser(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// `x`, or a tiny number in place of 0.
#[inline(always)]
fn divisor(x: f64) -> f64 {
    if x.abs() > TINY { x } else { TINY }
}

/// When the ray is between the planes at `-half` and `half` of one coordinate: from, to.
#[inline(always)]
fn slab(origin: f64, direction: f64, half: f64) -> (f64, f64) {
    let inverse = 1.0 / divisor(direction);
    let (middle, reach) = (-origin * inverse, (half * inverse).abs());
    (middle - reach, middle + reach)
}

/// When a ray is inside a tube or a sphere, the roots of `a t² + 2 b t + c`: from, to, and the
/// root of the discriminant. Where it never is, from is infinite.
#[inline(always)]
fn quadric(a: f64, b: f64, c: f64) -> (f64, f64, f64) {
    let a = greater(a, TINY);
    let discriminant = b * b - a * c;
    let root = greater(discriminant, 0.0).sqrt();
    let inverse = 1.0 / a;
    let first = (-b - root) * inverse;
    let from = if discriminant < 0.0 {
        f64::INFINITY
    } else {
        first
    };
    (from, (-b + root) * inverse, root)
}

#[inline(always)]
fn hit_if(hit: bool, depth: f64, facing: f64) -> Hit {
    Hit {
        depth: if hit { depth } else { f64::INFINITY },
        facing,
    }
}

/// Bounds on `x` within which `[q(start), 2 q(start, unit), q(unit)] . [1, x, x²] >= 0`: the
/// discriminant of a quadric is such a form of the ray's direction.
fn nonnegative(
    form: impl Fn(&Vector3<f64>, &Vector3<f64>) -> f64,
    s: &Vector3<f64>,
    u: &Vector3<f64>,
) -> [f64; 2] {
    let (a, b, c) = (form(u, u), form(s, u), form(s, s));
    if a >= 0.0 {
        return [f64::NEG_INFINITY, f64::INFINITY];
    }
    let discriminant = b * b - a * c;
    if discriminant < 0.0 {
        return [f64::INFINITY, f64::NEG_INFINITY];
    }
    let (middle, reach) = (-b / a, discriminant.sqrt() / -a);
    [middle - reach, middle + reach]
}

impl Cast for Cylinder {
    /// A cylinder is the part of an infinite tube that lies between two planes: a ray enters it
    /// when it is inside both for the first time.
    #[inline(always)]
    fn cast(&self, o: &Vector3<f64>, d: &Vector3<f64>) -> Hit {
        let a = d.x * d.x + d.y * d.y;
        let b = o.x * d.x + o.y * d.y;
        let c = o.x * o.x + o.y * o.y - self.radius * self.radius;
        let (tube_in, tube_out, root) = quadric(a, b, c);
        let (slab_in, slab_out) = slab(o.z, d.z, self.half_height);
        let depth = greater(tube_in, slab_in);
        let hit = (depth >= 0.0) & (depth <= lesser(tube_out, slab_out));
        // On the side, normal . direction = (b + a t) / radius.
        let side = root / self.radius;
        let facing = if tube_in > slab_in { side } else { d.z.abs() };
        hit_if(hit, depth, facing)
    }

    fn interval(&self, o: &Vector3<f64>, s: &Vector3<f64>, u: &Vector3<f64>) -> [f64; 2] {
        let o = o.xy();
        let c = o.norm_squared() - self.radius * self.radius;
        let form = |d: &Vector3<f64>, e: &Vector3<f64>| {
            o.dot(&d.xy()) * o.dot(&e.xy()) - c * d.xy().dot(&e.xy())
        };
        nonnegative(form, s, u)
    }
}

impl Cast for Cuboid {
    #[inline(always)]
    fn cast(&self, o: &Vector3<f64>, d: &Vector3<f64>) -> Hit {
        let (x_in, x_out) = slab(o.x, d.x, self.half.x);
        let (y_in, y_out) = slab(o.y, d.y, self.half.y);
        let (z_in, z_out) = slab(o.z, d.z, self.half.z);
        let depth = greater(greater(x_in, y_in), z_in);
        let hit = (depth >= 0.0) & (depth <= lesser(lesser(x_out, y_out), z_out));
        let sides = if x_in > y_in { d.x } else { d.y };
        let entered = if depth > z_in { sides } else { d.z };
        hit_if(hit, depth, entered.abs())
    }
}

impl Cast for Sphere {
    #[inline(always)]
    fn cast(&self, o: &Vector3<f64>, d: &Vector3<f64>) -> Hit {
        let c = o.norm_squared() - self.radius * self.radius;
        let (depth, _, root) = quadric(d.norm_squared(), o.dot(d), c);
        hit_if(depth >= 0.0, depth, root / self.radius)
    }

    fn interval(&self, o: &Vector3<f64>, s: &Vector3<f64>, u: &Vector3<f64>) -> [f64; 2] {
        let c = o.norm_squared() - self.radius * self.radius;
        let form = |d: &Vector3<f64>, e: &Vector3<f64>| o.dot(d) * o.dot(e) - c * d.dot(e);
        nonnegative(form, s, u)
    }
}

impl Cast for Capsule {
    /// A ray enters the capsule where it first enters one of the balls at its ends, or the side
    /// between them: what is inside a flat end of the tube is inside a ball.
    #[inline(always)]
    fn cast(&self, o: &Vector3<f64>, d: &Vector3<f64>) -> Hit {
        let radius2 = self.radius * self.radius;
        let a = d.x * d.x + d.y * d.y;
        let b = o.x * d.x + o.y * d.y;
        let c = o.x * o.x + o.y * o.y - radius2;
        let (side, _, side_root) = quadric(a, b, c);
        let on_side = (side >= 0.0) & ((o.z + side * d.z).abs() <= self.half_length);
        let mut nearest = hit_if(on_side, side, side_root / self.radius);
        for end in [-self.half_length, self.half_length] {
            let z = o.z - end;
            let (depth, _, root) = quadric(a + d.z * d.z, b + z * d.z, c + z * z);
            let nearer = (depth >= 0.0) & (depth < nearest.depth);
            nearest = Hit {
                depth: if nearer { depth } else { nearest.depth },
                facing: if nearer {
                    root / self.radius
                } else {
                    nearest.facing
                },
            };
        }
        nearest
    }
}

impl Cast for Mesh {
    fn cast(&self, o: &Vector3<f64>, d: &Vector3<f64>) -> Hit {
        let direction = Vec3::new(d.x, d.y, d.z);
        let ray = Ray::new(Vec3::new(o.x, o.y, o.z), direction);
        match (self.mesh).cast_local_ray_and_get_normal(&ray, f64::MAX, false) {
            Some(hit) => hit_if(true, hit.time_of_impact, hit.normal.dot(direction).abs()),
            None => hit_if(false, 0.0, 0.0),
        }
    }
}

#[cfg(test)]
mod tests;

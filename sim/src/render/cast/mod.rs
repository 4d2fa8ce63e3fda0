//! Where rays meet shapes.
//!
//! The shapes in closed form are met by the rays of several pixels at once, one in each lane of a vector register, without
//! branches. Cylinders too: parry finds its cylinders by an iterative search (GJK), which is slower and less exact; a test
//! compares the two. Triangle meshes alone are parry's. Lanes are `f64`: with `f32`, depth at an outline would be off by
//! tenths of a millimetre.

use nalgebra::Vector3;
use parry3d_f64::math::Vec3;
use parry3d_f64::query::{Ray, RayCast};
use pulp::Simd;

use super::lanes::{Lanes, Mask};
use crate::geometry::{Capsule, Cuboid, Cylinder, Mesh, Sphere};

/// Where the rays of several pixels meet a shape.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hits<S: Simd> {
    /// Ray parameters at the hits; infinite where there is none.
    pub depth: Lanes<S>,
    /// `|normal . direction|` of the surface's unit normals.
    pub facing: Lanes<S>,
}

/// What rays can meet.
pub(super) trait Cast {
    /// First hits of the rays `origin + t direction`, `t >= 0`, from outside, in the shape's frame.
    fn cast<S: Simd>(&self, simd: S, origin: &Vector3<f64>, direction: [Lanes<S>; 3]) -> Hits<S>;
}

/// Smallest divisor: quotients by less would be no numbers where 0 is divided by 0.
const TINY: f64 = 1e-200;

/// When the rays are between the planes at `-half` and `half` of one coordinate: from, to.
#[inline(always)]
fn slab<S: Simd>(simd: S, origin: f64, direction: Lanes<S>, half: f64) -> [Lanes<S>; 2] {
    let tiny = Lanes::splat(simd, TINY);
    let divisor = tiny.less(direction.abs()).select(direction, tiny);
    let inverse = Lanes::splat(simd, 1.0) / divisor;
    let (middle, reach) = (inverse * -origin, (inverse * half).abs());
    [middle - reach, middle + reach]
}

/// When rays are inside a tube or a sphere, the roots of `a t² + 2 b t + c`: from, to, and the root
/// of the discriminant. Where they never are, from is infinite.
#[inline(always)]
fn quadric<S: Simd>(simd: S, a: Lanes<S>, b: Lanes<S>, c: f64) -> [Lanes<S>; 3] {
    let zero = Lanes::splat(simd, 0.0);
    let a = a.max(Lanes::splat(simd, TINY));
    let discriminant = b * b - a * c;
    let root = discriminant.max(zero).sqrt();
    let inverse = Lanes::splat(simd, 1.0) / a;
    let never = Lanes::splat(simd, f64::INFINITY);
    let from = discriminant.less(zero).select(never, (-b - root) * inverse);
    [from, (root - b) * inverse, root]
}

/// The hits that are ones.
#[inline(always)]
fn hits_where<S: Simd>(simd: S, hit: Mask<S>, depth: Lanes<S>, facing: Lanes<S>) -> Hits<S> {
    let never = Lanes::splat(simd, f64::INFINITY);
    Hits {
        depth: hit.select(depth, never),
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
    fn cast<S: Simd>(&self, simd: S, o: &Vector3<f64>, [x, y, z]: [Lanes<S>; 3]) -> Hits<S> {
        let c = o.x * o.x + o.y * o.y - self.radius * self.radius;
        // Where the ray enters and leaves the tube, and the slab between the flat ends.
        let [tube_in, tube_out, root] = quadric(simd, x * x + y * y, x * o.x + y * o.y, c);
        let [slab_in, slab_out] = slab(simd, o.z, z, self.half_height);
        let depth = tube_in.max(slab_in);
        let ahead = Lanes::splat(simd, 0.0).at_most(depth);
        let hit = ahead.and(depth.at_most(tube_out.min(slab_out)));
        // On the side, normal . direction = (b + a t) / radius.
        let facing = slab_in.less(tube_in).select(root / self.radius, z.abs());
        hits_where(simd, hit, depth, facing)
    }
}

impl Cylinder {
    /// Bounds on `x` within which rays of directions `s + x u` may hit.
    pub fn interval(&self, o: &Vector3<f64>, s: &Vector3<f64>, u: &Vector3<f64>) -> [f64; 2] {
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
    fn cast<S: Simd>(&self, simd: S, o: &Vector3<f64>, [x, y, z]: [Lanes<S>; 3]) -> Hits<S> {
        // Inside the box is inside three slabs: the last to enter is the face that is seen.
        let [x_in, x_out] = slab(simd, o.x, x, self.half.x);
        let [y_in, y_out] = slab(simd, o.y, y, self.half.y);
        let [z_in, z_out] = slab(simd, o.z, z, self.half.z);
        let sides_in = x_in.max(y_in);
        let depth = sides_in.max(z_in);
        let ahead = Lanes::splat(simd, 0.0).at_most(depth);
        let hit = ahead.and(depth.at_most(x_out.min(y_out).min(z_out)));
        let side = y_in.less(x_in).select(x, y);
        let entered = z_in.less(sides_in).select(side, z);
        hits_where(simd, hit, depth, entered.abs())
    }
}

impl Cast for Sphere {
    #[inline(always)]
    fn cast<S: Simd>(&self, simd: S, o: &Vector3<f64>, [x, y, z]: [Lanes<S>; 3]) -> Hits<S> {
        let c = o.norm_squared() - self.radius * self.radius;
        let (a, b) = (x * x + y * y + z * z, x * o.x + y * o.y + z * o.z);
        let [depth, _, root] = quadric(simd, a, b, c);
        let ahead = Lanes::splat(simd, 0.0).at_most(depth);
        hits_where(simd, ahead, depth, root / self.radius)
    }
}

impl Sphere {
    /// Bounds on `x` within which rays of directions `s + x u` may hit.
    pub fn interval(&self, o: &Vector3<f64>, s: &Vector3<f64>, u: &Vector3<f64>) -> [f64; 2] {
        let c = o.norm_squared() - self.radius * self.radius;
        let form = |d: &Vector3<f64>, e: &Vector3<f64>| o.dot(d) * o.dot(e) - c * d.dot(e);
        nonnegative(form, s, u)
    }
}

impl Cast for Capsule {
    /// A ray enters the capsule where it first enters one of the balls at its ends, or the side
    /// between them: what is inside a flat end of the tube is inside a ball.
    #[inline(always)]
    fn cast<S: Simd>(&self, simd: S, o: &Vector3<f64>, [x, y, z]: [Lanes<S>; 3]) -> Hits<S> {
        let zero = Lanes::splat(simd, 0.0);
        let (a, b) = (x * x + y * y, x * o.x + y * o.y);
        let c = o.x * o.x + o.y * o.y - self.radius * self.radius;
        // The side, where it is hit between the ends.
        let [side, _, root] = quadric(simd, a, b, c);
        let height = (side * z + o.z).abs();
        let between = height.at_most(Lanes::splat(simd, self.half_length));
        let ahead = zero.at_most(side);
        let mut nearest = hits_where(simd, ahead.and(between), side, root / self.radius);
        // The balls at the ends, where they are nearer.
        for end in [-self.half_length, self.half_length] {
            let up = o.z - end;
            let [depth, _, root] = quadric(simd, a + z * z, b + z * up, c + up * up);
            let nearer = zero.at_most(depth).and(depth.less(nearest.depth));
            nearest = Hits {
                depth: nearer.select(depth, nearest.depth),
                facing: nearer.select(root / self.radius, nearest.facing),
            };
        }
        nearest
    }
}

impl Mesh {
    /// First hit of a ray as in [`Cast`]: depth, and `|normal . direction|`.
    pub fn cast(&self, o: &Vector3<f64>, d: &Vector3<f64>) -> Option<[f64; 2]> {
        let direction = Vec3::new(d.x, d.y, d.z);
        let ray = Ray::new(Vec3::new(o.x, o.y, o.z), direction);
        let hit = (self.mesh).cast_local_ray_and_get_normal(&ray, f64::MAX, false)?;
        Some([hit.time_of_impact, hit.normal.dot(direction).abs()])
    }
}

#[cfg(test)]
mod tests;

//! What the cameras see: solids with poses and colours.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use parry3d_f64::math::Vec3;
use parry3d_f64::query::{Ray, RayCast};
use parry3d_f64::shape::{Cuboid, Shape as _};
use serde::{Deserialize, Serialize};

use super::{Hit, Instance};
use crate::robot::Robot;
use crate::statics::Equilibrium;

/// Colour of the base: light yellow.
const BASE_COLOR: [u8; 3] = [230, 226, 185];

/// A shape with its frame's origin at its centre.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Shape {
    /// A cylinder about its z axis. Cast in closed form here: parry walks to a cylinder by an
    /// iterative search (GJK), which is slower and less exact; a test compares the two.
    Cylinder { radius: f64, half_height: f64 },
    /// A box.
    Cuboid(Cuboid),
}

/// A shape somewhere in the world.
#[derive(Clone, Debug)]
pub struct Solid {
    pub(crate) shape: Shape,
    /// Pose in the world (m).
    pub pose: Isometry3<f64>,
    /// Colour under full light.
    pub color: [u8; 3],
    /// What its pixels are labelled with.
    pub instance: Instance,
}

/// Everything that cameras can see.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// The solids.
    pub solids: Vec<Solid>,
}

/// Whether the rigid base below the first module is part of a scene: the paper's "with base" (WB)
/// and "no base" (NB) data sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BaseVisibility {
    /// The base is seen.
    Shown,
    /// The base is not there.
    Hidden,
}

impl Scene {
    /// A settled robot.
    pub fn of_robot(robot: &Robot, equilibrium: &Equilibrium, base: BaseVisibility) -> Self {
        let mut solids = match base {
            BaseVisibility::Shown => base_solids(robot),
            BaseVisibility::Hidden => Vec::new(),
        };
        let poses = equilibrium.positions.iter().zip(&equilibrium.orientations);
        for (index, (disc, (position, orientation))) in robot.discs().iter().zip(poses).enumerate()
        {
            solids.push(Solid {
                shape: Shape::Cylinder {
                    radius: disc.radius,
                    half_height: disc.half_height,
                },
                pose: Isometry3::from_parts(Translation3::from(*position), *orientation),
                color: disc_color(index, robot.discs().len()),
                instance: Instance::Disc(index as u16),
            });
        }
        Self { solids }
    }
}

/// Colour of disc `index` of `count`: a ramp of hues from red at the base to violet at the tip.
pub fn disc_color(index: usize, count: usize) -> [u8; 3] {
    let hue = 300.0 * index as f64 / count.max(2).saturating_sub(1) as f64;
    // HSV to RGB (e.g. Foley et al., Computer Graphics, 13.3.4), one formula for the three channels.
    let (saturation, value) = (0.8, 0.95);
    [5.0, 3.0, 1.0].map(|shift| {
        let k: f64 = (shift + hue / 60.0) % 6.0;
        let channel = value * (1.0 - saturation * k.min(4.0 - k).clamp(0.0, 1.0));
        (255.0 * channel).round() as u8
    })
}

/// A base in the paper's manner, from the floor to the robot: per module a layer with a plate and
/// three servo boxes at 120 degrees, around a guide column.
fn base_solids(robot: &Robot) -> Vec<Solid> {
    const COLUMN_RADIUS: f64 = 0.012;
    const PLATE: (f64, f64) = (0.055, 0.002);
    const SERVO_HALF_SIZE: [f64; 3] = [0.017, 0.010, 0.013];
    const SERVO_RADIUS: f64 = 0.034;
    let [x, y, top] = robot.spec().base.position;
    let height = top + robot.spec().base.hole_height;
    if height <= 0.0 {
        return Vec::new();
    }
    let layers = robot.spec().modules.len();
    let layer_height = height / layers as f64;
    let solid = |shape, z: f64, offset: f64, angle: f64| {
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
        let position = Vector3::new(x, y, z) + rotation * Vector3::new(offset, 0.0, 0.0);
        Solid {
            shape,
            pose: Isometry3::from_parts(Translation3::from(position), rotation),
            color: BASE_COLOR,
            instance: Instance::Base,
        }
    };
    let cylinder = |radius, half_height| Shape::Cylinder {
        radius,
        half_height,
    };
    let mut solids = vec![solid(
        cylinder(COLUMN_RADIUS, height / 2.0),
        height / 2.0,
        0.0,
        0.0,
    )];
    for layer in 0..layers {
        let floor = layer as f64 * layer_height;
        solids.push(solid(cylinder(PLATE.0, PLATE.1), floor + PLATE.1, 0.0, 0.0));
        let servo_half_height = SERVO_HALF_SIZE[2].min(0.4 * layer_height);
        let servo = Cuboid::new(Vec3::new(
            SERVO_HALF_SIZE[0],
            SERVO_HALF_SIZE[1],
            servo_half_height,
        ));
        for arm in 0..3 {
            let angle = std::f64::consts::TAU * f64::from(arm) / 3.0;
            let z = floor + 2.0 * PLATE.1 + servo_half_height;
            solids.push(solid(Shape::Cuboid(servo), z, SERVO_RADIUS, angle));
        }
    }
    solids
}

impl Shape {
    /// Radius of a sphere around the frame's origin that holds the shape (m).
    pub fn bounding_radius(&self) -> f64 {
        match self {
            Shape::Cylinder {
                radius,
                half_height,
            } => radius.hypot(*half_height),
            Shape::Cuboid(cuboid) => cuboid.compute_local_bounding_sphere().radius,
        }
    }

    /// First hit of the ray `origin + t direction`, `t >= 0`, from outside, in the shape's frame.
    pub fn cast(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<Hit> {
        match self {
            Shape::Cylinder {
                radius,
                half_height,
            } => cast_cylinder(*radius, *half_height, origin, direction),
            Shape::Cuboid(cuboid) => {
                let ray = Ray::new(
                    Vec3::new(origin.x, origin.y, origin.z),
                    Vec3::new(direction.x, direction.y, direction.z),
                );
                let hit = cuboid.cast_local_ray_and_get_normal(&ray, f64::MAX, true)?;
                Some(Hit {
                    depth: hit.time_of_impact,
                    normal: Vector3::new(hit.normal.x, hit.normal.y, hit.normal.z),
                })
            }
        }
    }
}

/// A cylinder is the part of an infinite tube that lies between two planes: a ray enters it when it
/// is inside both for the first time.
fn cast_cylinder(
    radius: f64,
    half_height: f64,
    origin: &Point3<f64>,
    direction: &Vector3<f64>,
) -> Option<Hit> {
    let a = direction.x * direction.x + direction.y * direction.y;
    let b = origin.x * direction.x + origin.y * direction.y;
    let c = origin.x * origin.x + origin.y * origin.y - radius * radius;
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
    let slab = -half_height.copysign(direction.z);
    let (slab_in, slab_out) = if direction.z != 0.0 {
        (
            (slab - origin.z) / direction.z,
            (-slab - origin.z) / direction.z,
        )
    } else if origin.z.abs() <= half_height {
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
        Vector3::new(x / radius, y / radius, 0.0)
    } else {
        Vector3::new(0.0, 0.0, 1.0f64.copysign(-direction.z))
    };
    Some(Hit { depth, normal })
}

#[cfg(test)]
mod tests {
    use super::*;
    use parry3d_f64::shape::Cylinder;
    use rand::{Rng, RngExt, SeedableRng};

    fn between(rng: &mut impl Rng, low: f64, high: f64) -> f64 {
        low + (high - low) * rng.random::<f64>()
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
            let expected = Cylinder::new(half_height, radius).cast_local_ray(&ray, f64::MAX, true);
            let found = cast_cylinder(radius, half_height, &origin, &direction);
            // At a grazing ray the iterative search and the closed form may differ in whether it hits.
            if let (Some(expected), Some(hit)) = (expected, found) {
                assert!(
                    (hit.depth - expected).abs() < 1e-5,
                    "{} {expected}",
                    hit.depth
                );
                hits += 1;
            } else {
                let margin =
                    cast_cylinder(radius * 0.999, half_height * 0.999, &origin, &direction)
                        .is_some();
                let outside =
                    cast_cylinder(radius * 1.001, half_height * 1.001, &origin, &direction)
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
            cast_cylinder(0.02, 0.01, &Point3::from(origin), &Vector3::from(direction))
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

    #[test]
    fn the_color_ramp_runs_from_red_to_violet() {
        assert_eq!(disc_color(0, 10), [242, 48, 48]);
        assert_eq!(disc_color(9, 10), [242, 48, 242]);
        assert_eq!(disc_color(0, 1), [242, 48, 48]);
    }
}

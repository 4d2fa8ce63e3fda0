use super::*;
use parry3d_f64::shape::{
    Ball as ParryBall, Capsule as ParryCapsule, Cuboid as ParryCuboid, Cylinder as ParryCylinder,
};
use rand::{Rng, RngExt, SeedableRng};

/// Casts one ray: depth and `|normal . direction|`.
fn cast_one(shape: &impl Cast, origin: &Vector3<f64>, direction: &Vector3<f64>) -> [f64; 2] {
    let scalar = pulp::Scalar;
    let direction = [0, 1, 2].map(|k| Lanes::new(scalar, direction[k]));
    let hits = shape.cast(scalar, origin, direction);
    [hits.depth.numbers, hits.facing.numbers]
}

fn between(rng: &mut impl Rng, low: f64, high: f64) -> f64 {
    low + (high - low) * rng.random::<f64>()
}

/// A rotation that turns z, the axis of our shapes, into y, the axis of parry's.
fn to_y(v: &Vector3<f64>) -> Vec3 {
    Vec3::new(v.x, v.z, -v.y)
}

/// Casts random rays at random shapes of sizes `[a, b, c]` here and in parry; both must agree but
/// for rays that graze, where parry's iterative search is inexact.
fn compare<T: Cast>(ours: impl Fn([f64; 3]) -> T, theirs: impl Fn([f64; 3]) -> Box<dyn RayCast>) {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
    let (mut hits, mut turned) = (0, 0);
    for _ in 0..20_000 {
        let size = std::array::from_fn(|_| between(&mut rng, 0.01, 0.1));
        let origin = Vector3::from_fn(|_, _| between(&mut rng, -1.0, 1.0));
        if origin.norm() < 0.3 {
            continue; // rays start outside
        }
        let target = Vector3::from_fn(|_, _| between(&mut rng, -0.1, 0.1));
        let direction = target - origin;
        let ray = Ray::new(to_y(&origin), to_y(&direction));
        let expected = theirs(size).cast_local_ray_and_get_normal(&ray, f64::MAX, true);
        let [depth, slope] = cast_one(&ours(size), &origin, &direction);
        let scaled = |factor: f64| {
            cast_one(&ours(size.map(|x| x * factor)), &origin, &direction)[0].is_finite()
        };
        if let (Some(expected), true) = (expected, depth.is_finite()) {
            let off = (depth - expected.time_of_impact).abs();
            assert!(off < 1e-5, "{} {}", depth, expected.time_of_impact);
            let facing = expected.normal.dot(to_y(&direction)).abs();
            // At an edge, either face's normal will do.
            turned += usize::from((slope - facing).abs() > 1e-3);
            hits += 1;
        } else {
            assert!(
                !scaled(0.999) || expected.is_some(),
                "parry missed what is well inside"
            );
            assert!(
                scaled(1.001) || expected.is_none(),
                "parry hit what is well outside"
            );
        }
    }
    assert!(hits > 4_000, "only {hits} rays hit");
    assert!(
        turned < hits / 500,
        "{turned} of {hits} hits face elsewhere"
    );
}

#[test]
fn cylinders_are_hit_where_parry_hits_them() {
    let ours = |[radius, half_height, _]: [f64; 3]| Cylinder {
        radius,
        half_height,
    };
    compare(ours, |[r, h, _]| Box::new(ParryCylinder::new(h, r)));
}

#[test]
fn boxes_are_hit_where_parry_hits_them() {
    let ours = |half: [f64; 3]| Cuboid { half: half.into() };
    compare(ours, |[x, y, z]| {
        Box::new(ParryCuboid::new(Vec3::new(x, z, y)))
    });
}

#[test]
fn spheres_are_hit_where_parry_hits_them() {
    compare(
        |[radius, ..]| Sphere { radius },
        |[r, ..]| Box::new(ParryBall::new(r)),
    );
}

#[test]
fn capsules_are_hit_where_parry_hits_them() {
    let ours = |[radius, half_length, _]: [f64; 3]| Capsule {
        radius,
        half_length,
    };
    compare(ours, |[r, h, _]| Box::new(ParryCapsule::new_y(h, r)));
}

#[test]
fn rays_along_and_across_the_axis_hit_caps_and_side() {
    let cast = |origin: [f64; 3], direction: [f64; 3]| {
        let cylinder = Cylinder {
            radius: 0.02,
            half_height: 0.01,
        };
        cast_one(&cylinder, &origin.into(), &direction.into())
    };
    let top = cast([0.01, 0.0, 1.0], [0.0, 0.0, -1.0]);
    assert!((top[0] - 0.99).abs() < 1e-12 && top[1] == 1.0);
    let side = cast([0.0, -1.0, 0.005], [0.0, 1.0, 0.0]);
    assert!((side[0] - 0.98).abs() < 1e-12 && (side[1] - 1.0).abs() < 1e-12);
    let missed = |origin, direction| cast(origin, direction)[0] == f64::INFINITY;
    assert!(missed([0.03, 0.0, 1.0], [0.0, 0.0, -1.0]));
    assert!(missed([0.0, -1.0, 0.02], [0.0, 1.0, 0.0]));
    assert!(
        missed([0.0, 1.0, 0.0], [0.0, 1.0, 0.0]),
        "behind the origin"
    );
}

#[test]
fn rays_along_a_face_of_a_box_are_cast_without_dividing_by_zero() {
    let cuboid = Cuboid {
        half: Vector3::new(0.01, 0.02, 0.03),
    };
    let cast = |origin: [f64; 3]| cast_one(&cuboid, &origin.into(), &Vector3::y());
    assert_eq!(cast([0.0, -1.0, 0.0]), [0.98, 1.0]);
    assert_eq!(cast([0.011, -1.0, 0.0])[0], f64::INFINITY);
}

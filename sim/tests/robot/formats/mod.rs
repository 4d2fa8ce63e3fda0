//! Robots in files of other tools: what goes out comes back, and what cannot is named.

mod fuzz;
mod hinges;
mod mjcf;
mod models_xml;
mod refusals;
mod urdf;

use nalgebra::{UnitQuaternion, Vector3};
use rand::seq::IndexedRandom;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_sim::camera::Camera;
use tdcr_sim::robot::{
    Aim, Backbone, Body, CameraSpec, Cameras, Disc, Drive, HoleCircle, Holes, Lens, MassSpec,
    ModuleSpec, PerDisc, Pull, RigidMass, RingSpec, Robot, RobotSpec, RouteSpec, Routing,
    SolidMass, TendonSpec, Waypoint,
};

/// A robot with whatever MuJoCo can represent, drawn at random.
fn random_robot(seed: u64) -> Robot {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    loop {
        if let Ok(robot) = Robot::new(random_spec(&mut rng)) {
            return robot;
        }
    }
}

fn random_spec(rng: &mut ChaCha8Rng) -> RobotSpec {
    let mut spec = RobotSpec::standard("2m").unwrap();
    let routing = [Routing::ModuleBelow, Routing::Base];
    spec.name = "a <random> & \"odd\" robot".to_owned();
    spec.gravity = vector(rng, 9.81);
    spec.routing = *routing.choose(rng).unwrap();
    spec.base.position = vector(rng, 0.5);
    let turn = UnitQuaternion::from_scaled_axis(Vector3::from(vector(rng, 3.0)));
    spec.base.orientation = [turn.w, turn.i, turn.j, turn.k];
    spec.base.hole_height = -rng.random_range(0.001..0.02);
    let holes = rng.random_range(1..5);
    spec.base.holes = random_holes(rng, holes);
    spec.modules = (0..rng.random_range(1..4))
        .map(|_| random_module(rng, holes))
        .collect();
    spec.routes = (0..rng.random_range(0..3))
        .map(|_| random_route(rng, spec.disc_count(), holes))
        .collect();
    spec.cameras = random_cameras(rng);
    spec
}

fn random_cameras(rng: &mut ChaCha8Rng) -> Cameras {
    let resolution = [rng.random_range(8..2000), rng.random_range(8..2000)];
    if rng.random() {
        return Cameras::Ring(RingSpec {
            count: rng.random_range(1..9),
            radius: rng.random_range(0.1..1.0),
            height: rng.random_range(-0.5..1.0),
            pitch: rng.random_range(-0.5..1.0),
            fovy: rng.random_range(10.0..90.0),
            resolution,
            distortion: None,
        });
    }
    let free = |rng: &mut ChaCha8Rng| CameraSpec {
        position: vector(rng, 1.0),
        aim: match rng.random() {
            true => Aim::At(vector(rng, 1.0)),
            false => Aim::Orientation(std::array::from_fn(|_| rng.random_range(0.1..1.0))),
        },
        lens: Lens::Fovy(rng.random_range(10.0..90.0)),
        resolution,
        distortion: None,
    };
    Cameras::Free((0..rng.random_range(1..5)).map(|_| free(rng)).collect())
}

fn random_module(rng: &mut ChaCha8Rng, holes: usize) -> ModuleSpec {
    let discs = rng.random_range(1..6);
    let first_offset = rng.random_range(0.01..0.04);
    let rigid = |rng: &mut ChaCha8Rng| RigidMass {
        mass: rng.random_range(1e-4..1e-2),
        inertia: std::array::from_fn(|_| rng.random_range(1e-7..2e-7)),
        centre_of_mass: if rng.random() {
            vector(rng, 0.004)
        } else {
            [0.0; 3]
        },
    };
    let solid = |rng: &mut ChaCha8Rng| SolidMass {
        density: rng.random_range(1.0..1e4),
        centre_of_mass: vector(rng, 0.004),
    };
    let springs = |rng: &mut ChaCha8Rng| match rng.random() {
        true => Backbone::isotropic(rng.random_range(0.0..0.2)),
        false => Backbone {
            bending: [rng.random_range(0.0..0.2), rng.random_range(0.0..0.2)],
            torsion: rng.random_range(0.0..0.2),
            rest: [0.0; 3],
        },
    };
    let backbone = |rng: &mut ChaCha8Rng| Backbone {
        rest: if rng.random() {
            vector(rng, 0.5)
        } else {
            [0.0; 3]
        },
        ..springs(rng)
    };
    ModuleSpec {
        discs,
        first_offset,
        pitch: rng.random_range(0.01..0.04),
        clocking: *[0.0, 0.3].choose(rng).unwrap(),
        joint_below: *[0.0, 0.005].choose(rng).unwrap(),
        radius: rng.random_range(0.01..0.03),
        half_height: rng.random_range(0.002..0.01),
        mass: match rng.random_range(0..3) {
            0 => MassSpec::Density(per_disc(rng, discs, |rng| rng.random_range(1.0..1e4))),
            1 => MassSpec::Solid(per_disc(rng, discs, solid)),
            _ => MassSpec::Rigid(per_disc(rng, discs, rigid)),
        },
        holes: random_holes(rng, holes),
        damping: per_disc(rng, discs, |rng| rng.random_range(0.0..0.2)),
        armature: per_disc(rng, discs, |rng| rng.random_range(0.0..0.02)),
        backbone: rng.random::<bool>().then(|| per_disc(rng, discs, backbone)),
        rod: None,
        joint: None,
        limit: None,
        tendons: rng.random::<bool>().then(|| random_tendon(rng)),
    }
}

fn random_holes(rng: &mut ChaCha8Rng, count: usize) -> Holes {
    if rng.random() {
        return Holes::Circle(HoleCircle {
            radius: rng.random_range(0.005..0.01),
            angles: (0..count).map(|_| rng.random_range(0.0..6.0)).collect(),
        });
    }
    let hole = |_| std::array::from_fn(|_| rng.random_range(0.001..0.01));
    Holes::At((0..count).map(hole).collect())
}

fn random_route(rng: &mut ChaCha8Rng, discs: usize, holes: usize) -> RouteSpec {
    let waypoint = |rng: &mut ChaCha8Rng| {
        let body = match rng.random_range(0..=discs) {
            0 => Body::Base,
            above => Body::Disc(above - 1),
        };
        Waypoint(body, rng.random_range(0..holes))
    };
    RouteSpec {
        through: (0..rng.random_range(2..6)).map(|_| waypoint(rng)).collect(),
        tendon: random_tendon(rng),
    }
}

fn random_tendon(rng: &mut ChaCha8Rng) -> TendonSpec {
    let gain = Drive::Gain(rng.random_range(10.0..1000.0));
    let drive = *[gain, Drive::Length, Drive::Tension].choose(rng).unwrap();
    let needs_axial = drive == Drive::Length || rng.random();
    let low = rng.random_range(0.0..0.01);
    TendonSpec {
        drive,
        range: [low, low + rng.random_range(0.001..0.05)],
        pull: if drive != Drive::Tension && rng.random() {
            Pull::TensionOnly
        } else {
            Pull::Bilateral
        },
        axial_stiffness: needs_axial.then(|| rng.random_range(100.0..1e4)),
        stiffening: 0.0,
        friction: None,
        servo: None,
    }
}

fn per_disc<T>(
    rng: &mut ChaCha8Rng,
    discs: usize,
    mut draw: impl FnMut(&mut ChaCha8Rng) -> T,
) -> PerDisc<T> {
    if rng.random() {
        PerDisc::Uniform(draw(rng))
    } else {
        PerDisc::Each((0..discs).map(|_| draw(rng)).collect())
    }
}

fn vector(rng: &mut impl Rng, size: f64) -> [f64; 3] {
    std::array::from_fn(|_| rng.random_range(-size..size))
}

/// Fails unless the two are the same base and discs, to rounding.
fn assert_same_chain(a: &Robot, b: &Robot) {
    let (base_a, base_b) = (&a.spec().base, &b.spec().base);
    assert_near(&base_a.position, &base_b.position);
    let turn = |q: [f64; 4]| UnitQuaternion::from_quaternion(Vector4(q).into());
    assert!(turn(base_a.orientation).angle_to(&turn(base_b.orientation)) < 1e-7);
    assert_eq!(a.discs().len(), b.discs().len());
    for (a, b) in a.discs().iter().zip(b.discs()) {
        assert_same_disc(a, b);
    }
}

/// A quaternion's numbers (w, x, y, z).
struct Vector4([f64; 4]);

impl From<Vector4> for nalgebra::Quaternion<f64> {
    fn from(Vector4([w, x, y, z]): Vector4) -> Self {
        Self::new(w, x, y, z)
    }
}

fn assert_same_disc(a: &Disc, b: &Disc) {
    for (a, b) in [
        (a.offset, b.offset),
        (a.joint_offset, b.joint_offset),
        (a.origin, b.origin),
        (a.inertia, b.inertia),
        (a.centre_of_mass, b.centre_of_mass),
    ] {
        assert_near(a.as_slice(), b.as_slice());
    }
    let numbers = |disc: &Disc| [disc.mass, disc.radius, disc.half_height, disc.damping];
    assert_near(&numbers(a), &numbers(b));
}

/// Fails unless the two rest and move alike: chains, joints, tendons, gravity and cameras.
fn assert_same_robot(a: &Robot, b: &Robot) {
    assert_same_chain(a, b);
    assert_eq!(
        (&a.spec().name, a.spec().gravity),
        (&b.spec().name, b.spec().gravity)
    );
    for (a, b) in a.discs().iter().zip(b.discs()) {
        assert_eq!(a.armature, b.armature);
        let springs = [a, b].map(|disc| disc.backbone.filter(|spring| spring.torsion > 0.0));
        assert_eq!(springs[0].is_some(), springs[1].is_some());
        if let [Some(a), Some(b)] = springs {
            // A ball's one stiffness is written as it is; hinges in series are computed.
            if a.bending == [a.torsion; 2] {
                assert_eq!((a.bending, a.torsion), (b.bending, b.torsion));
            }
            assert_near(&a.bending, &b.bending);
            assert_near(&[a.torsion], &[b.torsion]);
            assert_near(&a.rest, &b.rest);
        }
    }
    assert_eq!(a.tendons().len(), b.tendons().len());
    for (one, other) in a.tendons().iter().zip(b.tendons()) {
        assert_eq!((one.range, one.pull), (other.range, other.pull));
        assert_eq!(one.drive == Drive::Tension, other.drive == Drive::Tension);
        assert_near(&[one.stiffness], &[other.stiffness]);
        assert_eq!(one.route.len(), other.route.len());
        for (p, q) in one.route.iter().zip(&other.route) {
            let place = |robot: &Robot, w: &Waypoint| robot.spec().hole_position(w.0, w.1).unwrap();
            assert_eq!(p.0, q.0);
            assert_near(&place(a, p), &place(b, q));
        }
    }
    assert_near(&[a.spec().base.hole_height], &[b.spec().base.hole_height]);
    let rings = [a, b].map(|robot| Camera::placed(&robot.spec().cameras));
    assert_eq!(rings[0].len(), rings[1].len());
    for (a, b) in rings[0].iter().zip(&rings[1]) {
        assert_eq!(a.intrinsics, b.intrinsics);
        let difference = (a.pose.to_homogeneous() - b.pose.to_homogeneous()).amax();
        assert!(difference < 1e-9, "{difference}");
    }
}

fn assert_near(a: &[f64], b: &[f64]) {
    assert_eq!(a.len(), b.len());
    for (a, b) in a.iter().zip(b) {
        assert!(
            (a - b).abs() <= 1e-12 * a.abs().max(b.abs()).max(1e-3),
            "{a} {b}"
        );
    }
}

//! Robots of every kind the specification knows, drawn at random.
#![allow(
    dead_code,
    reason = "tests share it, and none draws robots of all kinds"
)]

use rand::{Rng, RngExt};
use tdcr_sim::robot::{
    Backbone, Body, Drive, Friction, Hinge, HingeJoint, HoleCircle, Holes, Limit, MassSpec,
    PerDisc, Pull, RigidMass, Robot, RobotSpec, RouteSpec, Routing, TendonSpec, Waypoint,
};

/// Which robots to draw.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Anything, with an elastic backbone so that equilibria are well conditioned.
    Elastic,
    /// What MuJoCo models the same way: bilateral gains, no limits, isotropic backbones.
    Mujoco,
}

/// A random robot of 1 to 4 modules.
pub fn random_robot(kind: Kind, rng: &mut impl Rng) -> Robot {
    Robot::new(random_spec(kind, rng)).expect("random specifications are valid")
}

/// A random robot some of whose modules have hinges in place of ball joints, the lowest for certain.
pub fn random_hinged_robot(kind: Kind, rng: &mut impl Rng) -> Robot {
    Robot::new(random_hinged_spec(kind, rng)).expect("random specifications are valid")
}

pub fn random_hinged_spec(kind: Kind, rng: &mut impl Rng) -> RobotSpec {
    let mut spec = random_spec(kind, rng);
    for (index, module) in spec.modules.iter_mut().enumerate() {
        if index == 0 || rng.random() {
            module.backbone = None;
            let joints = (0..module.discs).map(|_| random_hinges(rng)).collect();
            module.joint = Some(PerDisc::Each(joints));
        }
    }
    spec
}

/// One to three hinges about axes in any order and direction, not at right angles, at rest and at the angles 0 anywhere near straight.
fn random_hinges(rng: &mut impl Rng) -> HingeJoint {
    let count = [1, 2, 2, 2, 3, 3][rng.random_range(0..6)];
    let first = rng.random_range(0..3);
    let step = rng.random_range(1..=2);
    let hinges = (0..count).map(|k| {
        let mut axis: [f64; 3] = std::array::from_fn(|_| within(-0.3, 0.3, rng));
        axis[(first + step * k) % 3] += if rng.random() { 1.0 } else { -1.0 };
        Hinge {
            axis,
            stiffness: within(0.3, 1.0, rng),
            rest: within(-0.1, 0.1, rng),
            damping: within(0.0, 0.1, rng),
            armature: within(0.0, 1e-2, rng),
        }
    });
    HingeJoint {
        hinges: hinges.collect(),
        zero: std::array::from_fn(|_| within(-0.1, 0.1, rng)),
    }
}

/// Uniform in the range.
pub fn within(low: f64, high: f64, rng: &mut impl Rng) -> f64 {
    low + (high - low) * rng.random::<f64>()
}

pub fn random_spec(kind: Kind, rng: &mut impl Rng) -> RobotSpec {
    let mut spec = RobotSpec::standard("2m").expect("a standard robot");
    spec.name = "random".to_owned();
    spec.gravity = std::array::from_fn(|_| within(-6.0, 6.0, rng));
    spec.base.position = std::array::from_fn(|_| within(-0.2, 0.2, rng));
    spec.base.orientation = std::array::from_fn(|_| within(-1.0, 1.0, rng));
    spec.routing = if rng.random() {
        Routing::Base
    } else {
        Routing::ModuleBelow
    };
    let holes = rng.random_range(3..=4);
    spec.base.holes = random_holes(holes, rng);
    let module = spec.modules[0].clone();
    spec.modules = vec![module; rng.random_range(1..=4)];
    for module in &mut spec.modules {
        module.discs = rng.random_range(2..=6);
        module.first_offset = within(0.012, 0.02, rng);
        module.pitch = within(0.012, 0.02, rng);
        module.joint_below = rng.random_range(0..=2) as f64 * 0.25 * module.pitch;
        module.radius = within(0.012, 0.025, rng);
        module.half_height = within(0.003, 0.006, rng);
        module.holes = random_holes(holes, rng);
        module.damping = PerDisc::Uniform(within(0.0, 0.2, rng));
        module.armature =
            PerDisc::Each((0..module.discs).map(|_| within(1e-3, 2e-2, rng)).collect());
        if rng.random() {
            let mass = within(1e-4, 2e-3, rng);
            let inertia: [f64; 3] = std::array::from_fn(|_| within(1e-7, 1.9e-7, rng));
            module.mass = MassSpec::Rigid(PerDisc::Uniform(RigidMass {
                mass,
                inertia,
                // Up to 2 mm off the origin, as random as the moments are.
                centre_of_mass: inertia.map(|moment| (moment - 1.45e-7) * 5e4),
            }));
        }
        module.backbone = random_backbone(kind, rng);
        if kind == Kind::Elastic && rng.random() {
            module.limit = Some(PerDisc::Uniform(Limit {
                angle: within(0.02, 0.2, rng),
                stiffness: within(0.1, 1.0, rng),
            }));
        }
        let tendon = random_tendon(kind, rng);
        module.tendons = (rng.random_range(0..4) > 0).then_some(tendon);
    }
    spec.routes = (0..rng.random_range(1..=3))
        .map(|_| RouteSpec {
            through: random_route(spec.disc_count(), holes, rng),
            tendon: random_tendon(kind, rng),
        })
        .collect();
    spec
}

fn random_holes(count: usize, rng: &mut impl Rng) -> Holes {
    if rng.random() {
        let angles = (0..count)
            .map(|k| std::f64::consts::TAU * k as f64 / count as f64 + within(-0.2, 0.2, rng))
            .collect();
        Holes::Circle(HoleCircle {
            radius: within(0.008, 0.014, rng),
            angles,
        })
    } else {
        Holes::At(
            (0..count)
                .map(|_| std::array::from_fn(|_| within(-0.012, 0.012, rng)))
                .collect(),
        )
    }
}

fn random_backbone(kind: Kind, rng: &mut impl Rng) -> Option<PerDisc<Backbone>> {
    // Stiff enough that tendons do not turn discs so far that holes meet.
    let stiffness = within(0.3, 1.0, rng);
    match kind {
        Kind::Mujoco => Some(PerDisc::Uniform(Backbone::isotropic(stiffness))),
        Kind::Elastic => Some(PerDisc::Uniform(Backbone {
            bending: [stiffness, within(0.3, 1.0, rng)],
            torsion: within(0.3, 1.0, rng),
            rest: std::array::from_fn(|_| within(-0.1, 0.1, rng)),
        })),
    }
}

fn random_tendon(kind: Kind, rng: &mut impl Rng) -> TendonSpec {
    let gain = TendonSpec {
        drive: Drive::Gain(within(20.0, 100.0, rng)),
        range: [0.0, 0.04],
        pull: Pull::Bilateral,
        axial_stiffness: rng.random::<bool>().then(|| within(1e3, 1e4, rng)),
        stiffening: 0.0,
        friction: None,
        servo: None,
    };
    if kind == Kind::Mujoco {
        return gain;
    }
    match rng.random_range(0..4) {
        0 => TendonSpec {
            drive: Drive::Tension,
            range: [0.0, 2.0],
            ..gain
        },
        1 => TendonSpec {
            range: [0.0, 0.15],
            pull: Pull::TensionOnly,
            friction: Some(Friction {
                coefficient: 0.0,
                contact_stiffness: 1e5,
            }),
            ..gain
        },
        _ => gain,
    }
}

/// From the base up, now and then passing discs by or staying on one, and sometimes back down.
fn random_route(discs: usize, holes: usize, rng: &mut impl Rng) -> Vec<Waypoint> {
    let mut route = vec![Waypoint(Body::Base, rng.random_range(0..holes))];
    let mut disc = rng.random_range(0..2.min(discs));
    while disc < discs {
        route.push(Waypoint(Body::Disc(disc), rng.random_range(0..holes)));
        disc += [1, 1, 1, 2, 3][rng.random_range(0..5)];
    }
    let back = Waypoint(
        Body::Disc(discs.saturating_sub(2)),
        rng.random_range(0..holes),
    );
    if rng.random_range(0..4) == 0 && discs > 2 && route.last() != Some(&back) {
        route.push(back);
    }
    route
}

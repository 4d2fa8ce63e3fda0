//! Which isometries map a robot to itself: candidates by its tendons' routes, confirmed by settling.

use std::f64::consts::{PI, TAU};

use nalgebra::{Matrix3, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::{Symmetries, Symmetry};
use crate::pose::Pose;
use crate::robot::{Command, Loads, Robot};
use crate::statics::Settler;

/// How far a hole may lie from the image of another, in distances of that from the axis: far above the rounding of holes in
/// files.
const HOLE_TOLERANCE: f64 = 1e-3;

/// How far a settled disc may lie from the image of another, in lengths of the backbone.
const SHAPE_TOLERANCE: f64 = 1e-4;

/// Commands that are settled, under each load.
const COMMANDS: usize = 8;

/// Seed of these commands.
const SEED: u64 = 0x5e77;

impl Robot {
    /// The symmetries of the robot under its own weight, and with a payload of its own mass at the tip.
    ///
    /// They are isometries that fix the base's origin and axis. Each maps the routes of all tendons to routes of tendons with
    /// the same drive, range, stiffness and friction (holes within 1/1000 of their distance from the axis), and the shapes
    /// that the robot settles in to each other: within 1/10,000 of the backbone's length, under 8 random commands and each
    /// of the loads. Discs are taken for bodies of revolution, as they are seen: their origins and axes are compared.
    ///
    /// What settling does not show is not compared: inertia and damping, the cameras, the look of the base
    /// ([`Symmetries::of_base`]).
    pub fn symmetries(&self) -> Symmetries {
        let mass = self.discs().iter().map(|disc| disc.mass).sum();
        let payload = Loads::payload(mass).ok();
        let loads: Vec<Loads> = payload.into_iter().chain([Loads::default()]).collect();
        self.symmetries_under(&loads)
    }

    /// The symmetries of the robot under each of these loads: [`Robot::symmetries`] under others, such as a payload off the
    /// axis.
    pub fn symmetries_under(&self, loads: &[Loads]) -> Symmetries {
        let candidates = candidates(self);
        if candidates.is_trivial() {
            return candidates;
        }
        let settled = Settled::new(self, loads);
        candidates.subgroup(|symmetry| settled.confirm(symmetry))
    }
}

/// An isometry of the plane across the base's axis: the turn by an angle (rad), after the reflection `y -> -y` or not.
#[derive(Clone, Copy, Debug)]
struct Turn {
    angle: f64,
    mirrored: bool,
}

impl Turn {
    /// 1, or -1 where left becomes right.
    fn hand(self) -> f64 {
        if self.mirrored { -1.0 } else { 1.0 }
    }

    fn place(self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.angle.sin_cos();
        let y = self.hand() * y;
        [cos * x - sin * y, sin * x + cos * y]
    }

    /// As an isometry of the world that maps the robot's base to itself.
    fn symmetry(self, robot: &Robot, tendons: Vec<usize>) -> Symmetry {
        let (sin, cos) = self.angle.sin_cos();
        let hand = self.hand();
        let across = Matrix3::new(
            cos,
            -sin * hand,
            0.0, //
            sin,
            cos * hand,
            0.0, //
            0.0,
            0.0,
            1.0,
        );
        let base = robot.base_orientation().to_rotation_matrix();
        let matrix = base.matrix() * across * base.matrix().transpose();
        let translation = robot.base() - matrix * robot.base();
        Symmetry::new(tendons, &matrix, &translation)
    }
}

/// The isometries that map the tendons' routes to each other.
fn candidates(robot: &Robot) -> Symmetries {
    let routes = Routes::new(robot);
    let mut found: Vec<(Turn, Vec<usize>)> = Vec::new();
    for turn in routes.turns() {
        let Some(tendons) = routes.permutation(turn) else {
            continue;
        };
        let turn = routes.fitted(turn, &tendons);
        let known = (found.iter()).any(|(other, _)| {
            other.mirrored == turn.mirrored && distance(other.angle, turn.angle) < HOLE_TOLERANCE
        });
        if !known {
            found.push((turn, tendons));
        }
    }
    let rotations = found.iter().filter(|(turn, _)| !turn.mirrored).count();
    let step = TAU / rotations.max(1) as f64;
    // Rotations are multiples of one angle, and reflections lie one such angle apart: what rounded holes say is within
    // rounding of it.
    let offset = |mirrored: bool| {
        let of_kind = found.iter().filter(|(turn, _)| turn.mirrored == mirrored);
        let phases = of_kind.map(|(turn, _)| (turn.angle * TAU / step).sin_cos());
        let (sin, cos) = phases.fold((0.0, 0.0), |sum, one| (sum.0 + one.0, sum.1 + one.1));
        if mirrored {
            f64::atan2(sin, cos) * step / TAU
        } else {
            0.0
        }
    };
    let offsets = [offset(false), offset(true)];
    for (turn, _) in &mut found {
        let offset = offsets[usize::from(turn.mirrored)];
        let exact = offset + ((turn.angle - offset) / step).round() * step;
        if distance(exact, turn.angle) < HOLE_TOLERANCE {
            turn.angle = exact;
        }
    }
    // Angles from just below 0 on, so that rounding does not put the first last.
    let order = |turn: &Turn| (turn.mirrored, (turn.angle + HOLE_TOLERANCE).rem_euclid(TAU));
    found.sort_by(|(a, _), (b, _)| {
        let (a, b) = (order(a), order(b));
        a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    let symmetries = found.into_iter();
    let mut symmetries: Vec<_> =
        (symmetries.map(|(turn, tendons)| turn.symmetry(robot, tendons))).collect();
    let identity = Symmetry::identity(robot.tendons().len());
    match symmetries.first_mut() {
        Some(first) if first.is_alike(&identity) => *first = identity,
        _ => symmetries.insert(0, identity),
    }
    Symmetries(symmetries)
}

/// How far apart two angles are (rad).
fn distance(a: f64, b: f64) -> f64 {
    ((a - b + PI).rem_euclid(TAU) - PI).abs()
}

/// The holes of every tendon.
struct Routes<'a> {
    robot: &'a Robot,
    /// The x and y of each hole in its body's frame (m).
    holes: Vec<Vec<[f64; 2]>>,
}

impl<'a> Routes<'a> {
    fn new(robot: &'a Robot) -> Self {
        let spec = robot.spec();
        let hole = |waypoint: &crate::robot::Waypoint| {
            (spec.hole_position(waypoint.0, waypoint.1)).expect("validated: a hole of a body")
        };
        let route = |tendon: &crate::robot::Tendon| tendon.route.iter().map(hole).collect();
        Self {
            robot,
            holes: robot.tendons().iter().map(route).collect(),
        }
    }

    /// Isometries that map one hole of one tendon to that of another: all that can map the routes to each other are among
    /// them. The identity is the first. It alone where all holes lie on the axis, and nothing tells turns apart.
    fn turns(&self) -> Vec<Turn> {
        let mut turns = vec![Turn {
            angle: 0.0,
            mirrored: false,
        }];
        let angle = |[x, y]: [f64; 2]| y.atan2(x);
        let holes = self.holes.iter().enumerate();
        let mut holes =
            holes.flat_map(|(tendon, route)| (0..route.len()).map(move |place| (tendon, place)));
        // Off the axis: any hole that has an angle.
        let Some((tendon, place)) = holes.find(|&(tendon, place)| {
            let [x, y] = self.holes[tendon][place];
            x.hypot(y) > 1e-6
        }) else {
            return turns;
        };
        let from = angle(self.holes[tendon][place]);
        for image in self.holes.iter().filter_map(|route| route.get(place)) {
            let to = angle(*image);
            turns.extend(
                [(to - from, false), (to + from, true)]
                    .map(|(angle, mirrored)| Turn { angle, mirrored }),
            );
        }
        turns
    }

    /// The tendon that each is mapped to; `None` where there is none for one.
    fn permutation(&self, turn: Turn) -> Option<Vec<usize>> {
        let count = self.holes.len();
        let mut taken = vec![false; count];
        (0..count)
            .map(|from| {
                let to = (0..count).find(|&to| !taken[to] && self.is_image(turn, from, to))?;
                taken[to] = true;
                Some(to)
            })
            .collect()
    }

    /// Whether tendon `from` becomes tendon `to`.
    fn is_image(&self, turn: Turn, from: usize, to: usize) -> bool {
        let tendons = self.robot.tendons();
        let (a, b) = (&tendons[from], &tendons[to]);
        let bodies = |tendon: &crate::robot::Tendon| -> Vec<_> {
            tendon.route.iter().map(|waypoint| waypoint.0).collect()
        };
        let alike = a.drive == b.drive
            && a.range == b.range
            && a.pull == b.pull
            && a.stiffness == b.stiffness
            && a.stiffening == b.stiffening
            && a.friction == b.friction
            && a.servo == b.servo
            && bodies(a) == bodies(b);
        alike
            && self.holes[from]
                .iter()
                .zip(&self.holes[to])
                .all(|(from, to)| {
                    let [x, y] = turn.place(*from);
                    let error = (x - to[0]).hypot(y - to[1]);
                    error <= HOLE_TOLERANCE * from[0].hypot(from[1])
                })
    }

    /// The turn that maps the holes best to their images: of least squared distances (Procrustes in the plane).
    fn fitted(&self, turn: Turn, tendons: &[usize]) -> Turn {
        let (mut sin, mut cos) = (0.0, 0.0);
        for (from, &to) in tendons.iter().enumerate() {
            for (from, to) in self.holes[from].iter().zip(&self.holes[to]) {
                let (x, y) = (from[0], turn.hand() * from[1]);
                sin += x * to[1] - y * to[0];
                cos += x * to[0] + y * to[1];
            }
        }
        // Holes on the axis alone say nothing.
        let angle = if sin == 0.0 && cos == 0.0 {
            turn.angle
        } else {
            sin.atan2(cos)
        };
        Turn { angle, ..turn }
    }
}

/// Shapes that a robot settles in.
struct Settled<'a> {
    robot: &'a Robot,
    /// Commands, loads, and the discs' origins and ends of their axes (m, world frame), where it settles.
    shapes: Vec<(Command, &'a Loads, Vec<[f64; 3]>)>,
    /// Commands and loads that were tried.
    tried: usize,
}

impl<'a> Settled<'a> {
    fn new(robot: &'a Robot, loads: &'a [Loads]) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(SEED);
        let mut settler = Settler::new(robot);
        let mut shapes = Vec::new();
        for _ in 0..COMMANDS {
            let command = robot.random_command(&mut rng);
            for loads in loads {
                let equilibrium = settler.settle(&command, loads);
                if equilibrium.converged {
                    let shape = shape(robot, &equilibrium.pose());
                    shapes.push((command.clone(), loads, shape));
                }
            }
        }
        Self {
            robot,
            shapes,
            tried: COMMANDS * loads.len(),
        }
    }

    /// Whether the robot settles in the images of its shapes under the images of the commands. Not where it settles under
    /// fewer than half of the commands, which proves little.
    fn confirm(&self, symmetry: &Symmetry) -> bool {
        let length = self.robot.arc_lengths().last().copied().unwrap_or(0.0);
        let mut settler = Settler::new(self.robot);
        2 * self.shapes.len() >= self.tried
            && self.shapes.iter().all(|(command, loads, shape)| {
                let image = symmetry.command(command.as_slice());
                let Ok(image) = self.robot.command(&image) else {
                    return false;
                };
                let equilibrium = settler.settle(&image, loads);
                let found = self::shape(self.robot, &equilibrium.pose());
                equilibrium.converged
                    && found.iter().zip(shape).all(|(found, point)| {
                        let expected = Vector3::from(symmetry.point(*point));
                        (Vector3::from(*found) - expected).norm() <= SHAPE_TOLERANCE * length
                    })
            })
    }
}

/// The origin of every disc, and a point of its axis at the distance of its radius (m, world frame).
fn shape(robot: &Robot, pose: &Pose) -> Vec<[f64; 3]> {
    let discs = robot.discs().iter().enumerate();
    let ends = discs.flat_map(|(index, disc)| {
        let frame = pose.disc(index);
        let end = frame * nalgebra::Point3::new(0.0, 0.0, disc.radius);
        [frame.translation.vector.into(), end.coords.into()]
    });
    ends.collect()
}

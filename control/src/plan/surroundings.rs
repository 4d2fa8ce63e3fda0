//! How far a robot's discs are from obstacles and from each other.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use tdcr_sim::chain::Configuration;
use tdcr_sim::geometry::Beads;
use tdcr_sim::robot::Robot;
use tdcr_sim::scene::{Scene, SelfContact};

/// Two discs can touch whose beads are farther apart, while the robot is straight, than this share of the widest disc's radius.
const APART: f64 = 0.1;

/// From which distance of two discs on (m) a lower bound is enough.
const ENOUGH: f64 = 1e-3;

/// Where the discs are: origins (m) and orientations in the world, before the base is moved by a vector (m).
#[derive(Clone, Copy, Debug)]
pub(super) struct Placed<'a> {
    pub positions: &'a [Vector3<f64>],
    pub orientations: &'a [UnitQuaternion<f64>],
    pub shift: Vector3<f64>,
}

impl Placed<'_> {
    fn origin(&self, disc: usize) -> Vector3<f64> {
        self.positions[disc] + self.shift
    }
}

/// What is nearest to a robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Closest {
    /// Distance of the surfaces (m), below 0 where they overlap: of the discs themselves from an obstacle at least, of the beads of
    /// two discs.
    pub distance: f64,
    pub disc: usize,
    pub partner: Near,
}

/// What a disc is near to, by its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Near {
    Obstacle(usize),
    Disc(usize),
}

/// A robot's collision geometry among obstacles.
#[derive(Clone, Debug)]
pub(super) struct Surroundings {
    beads: Beads,
    scene: Scene,
    /// Pairs of discs that can touch.
    pairs: Vec<[usize; 2]>,
    /// Of each disc, radius and half height of the cylinder about its beads' centres, and the largest of their radii (m).
    cylinders: Vec<[f64; 3]>,
}

impl Surroundings {
    pub fn new(robot: &Robot, scene: &Scene) -> Self {
        let beads = Beads::new(robot);
        let discs = robot.discs().len();
        let cylinder = |disc: usize| {
            let own = &beads.as_slice()[beads.of_disc(disc)];
            own.iter().fold([0.0_f64; 3], |[across, up, radius], bead| {
                [
                    across.max(bead.centre.xy().norm()),
                    up.max(bead.centre.z.abs()),
                    radius.max(bead.radius),
                ]
            })
        };
        let mut surroundings = Self {
            cylinders: (0..discs).map(cylinder).collect(),
            beads,
            scene: scene.clone(),
            pairs: Vec::new(),
        };
        if matches!(scene.self_contact(), SelfContact::Touching { .. }) {
            surroundings.pairs = surroundings.that_can_touch(robot);
        }
        surroundings
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Pairs of discs that are apart while the robot is straight, and all above them.
    fn that_can_touch(&self, robot: &Robot) -> Vec<[usize; 2]> {
        let (positions, orientations) = Configuration::straight(robot).place(robot);
        let straight = Placed {
            positions: &positions,
            orientations: &orientations,
            shift: Vector3::zeros(),
        };
        let discs = positions.len();
        let widest = (0..discs).map(|disc| self.beads.enclosing(disc));
        let reach = APART * widest.fold(0.0, f64::max);
        let from = |disc: usize| {
            let first = (disc + 2..discs)
                .find(|&above| self.between_beads(straight, [disc, above]) > reach)
                .unwrap_or(discs);
            (first..discs).map(move |above| [disc, above])
        };
        (0..discs).flat_map(from).collect()
    }

    /// Writes for each disc how far it is from obstacles at least, beyond `clearance` (m); numbers of `cap` (m) and more are written
    /// as `cap`.
    pub fn margins(&self, placed: Placed, clearance: f64, cap: f64, out: &mut [f64]) {
        out.fill(cap);
        let spare = clearance + self.beads.shape_error();
        for obstacle in self.scene.obstacles() {
            let mut away = f64::NEG_INFINITY;
            let mut before = placed.origin(0);
            for (disc, margin) in out.iter_mut().enumerate() {
                let origin = placed.origin(disc);
                // Distances change by no more than the way between two points.
                away -= (origin - before).norm();
                before = origin;
                let enclosing = self.beads.enclosing(disc) + spare;
                if away - enclosing >= *margin {
                    continue;
                }
                away = obstacle.signed_distance(&origin);
                if away - enclosing < *margin {
                    self.for_beads(placed, disc, |centre, radius| {
                        let gap = obstacle.signed_distance(&centre) - radius - spare;
                        *margin = margin.min(gap);
                    });
                }
            }
        }
    }

    /// The pairs of discs that can touch.
    pub fn pairs(&self) -> &[[usize; 2]] {
        &self.pairs
    }

    /// Writes for each pair of discs that can touch how far they are apart at least (m).
    pub fn gaps(&self, placed: Placed, out: &mut [f64]) {
        for (gap, &pair) in out.iter_mut().zip(&self.pairs) {
            *gap = match self.lower_bound(placed, pair) {
                apart if apart >= ENOUGH => apart,
                _ => self.between_beads(placed, pair),
            };
        }
    }

    /// The obstacle that is nearest to any disc; `None` without obstacles.
    pub fn closest_obstacle(&self, placed: Placed) -> Option<Closest> {
        let discs = (0..placed.positions.len()).map(|disc| {
            Isometry3::from_parts(placed.origin(disc).into(), placed.orientations[disc])
        });
        let nearest = self.scene.nearest(&self.beads, discs);
        nearest.map(|found| Closest {
            distance: found.gap - self.beads.shape_error(),
            disc: found.disc,
            partner: Near::Obstacle(found.obstacle),
        })
    }

    /// The first two discs found that touch.
    pub fn touching_discs(&self, placed: Placed) -> Option<Closest> {
        self.pairs.iter().find_map(|&[a, b]| {
            let distance = match self.lower_bound(placed, [a, b]) {
                apart if apart >= 0.0 => apart,
                _ => self.between_beads(placed, [a, b]),
            };
            (distance < 0.0).then_some(Closest {
                distance,
                disc: a,
                partner: Near::Disc(b),
            })
        })
    }

    /// Radius of the sphere about a disc's origin in which it is (m).
    pub fn enclosing(&self, disc: usize) -> f64 {
        self.beads.enclosing(disc)
    }

    fn for_beads(&self, placed: Placed, disc: usize, mut take: impl FnMut(Vector3<f64>, f64)) {
        let origin = placed.origin(disc);
        let turn = placed.orientations[disc].to_rotation_matrix();
        for bead in &self.beads.as_slice()[self.beads.of_disc(disc)] {
            take(origin + turn * bead.centre, bead.radius);
        }
    }

    /// A lower bound of the distance of two discs' beads (m): by the spheres about them, and by planes across the bisector of
    /// their axes.
    fn lower_bound(&self, placed: Placed, [a, b]: [usize; 2]) -> f64 {
        let between = placed.positions[b] - placed.positions[a];
        let enclosing = self.beads.enclosing(a) + self.beads.enclosing(b);
        let by_spheres = between.norm() - enclosing;
        if by_spheres > 0.5 * enclosing {
            return by_spheres;
        }
        let axes = [a, b].map(|disc| placed.orientations[disc] * Vector3::z());
        let Some(across) = (axes[0] + axes[1]).try_normalize(1e-3) else {
            return by_spheres;
        };
        let reach = |disc: usize, axis: &Vector3<f64>| {
            let [radius, half_height, margin] = self.cylinders[disc];
            let cos = axis.dot(&across);
            radius * (1.0 - cos * cos).max(0.0).sqrt() + half_height * cos.abs() + margin
        };
        let by_planes = between.dot(&across).abs() - reach(a, &axes[0]) - reach(b, &axes[1]);
        by_spheres.max(by_planes)
    }

    fn between_beads(&self, placed: Placed, [a, b]: [usize; 2]) -> f64 {
        let mut nearest = f64::INFINITY;
        self.for_beads(placed, a, |one, own| {
            self.for_beads(placed, b, |other, its| {
                nearest = nearest.min((one - other).norm() - own - its);
            });
        });
        nearest
    }
}

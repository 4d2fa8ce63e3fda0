//! The robot's collision geometry: spheres on its discs and along its rods, apart from what cameras see.
//!
//! A disc is a ring of beads as thick as the disc, whose outermost points lie on its mantle, and a bead in the middle where the
//! ring leaves a hole; a disc that is taller than wide is a column of beads as wide as it is. A rod is a row of beads of its
//! radius. Spheres have a distance to every surface with gradient and curvature in closed form, and no edges.

use std::f64::consts::TAU;
use std::ops::Range;

use nalgebra::{Isometry3, Point3, Vector3};

use super::robot::rod_pieces;
use super::shape::Kind;
use crate::chain::Configuration;
use crate::robot::{Disc, Robot};

/// Beads of a disc's ring.
const RING: usize = 12;
/// Beads of each piece of a rod at most.
const MOST_OF_ROD: usize = 16;

/// A sphere that a disc carries.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bead {
    /// The disc that carries it.
    pub disc: usize,
    /// Its centre from the disc's origin, in the disc's frame (m).
    pub centre: Vector3<f64>,
    /// Its radius (m).
    pub radius: f64,
    /// Of a bead on the rod to the joint of the disc above, its share of the way from the disc's origin to there: it moves along the disc
    /// as their distance grows. 0 for one that is fixed to its disc.
    pub along_rod: f64,
}

/// The beads of a robot.
#[derive(Clone, Debug)]
pub struct Beads {
    all: Vec<Bead>,
    /// Which of them each disc carries.
    of_disc: Vec<Range<usize>>,
    /// Radius of the sphere about each disc's origin that encloses its beads (m).
    enclosing: Vec<f64>,
    error: f64,
}

impl Beads {
    /// The beads of `robot`.
    pub fn new(robot: &Robot) -> Self {
        let mut carried: Vec<Vec<Bead>> = (robot.discs().iter().enumerate())
            .map(|(index, disc)| of_disc(index, disc))
            .collect();
        for bead in of_rods(robot) {
            carried[bead.disc].push(bead);
        }
        let error = robot.discs().iter().map(shape_error).fold(0.0, f64::max);
        Self::carried(carried, error)
    }

    /// Beads of one's own, whose shape is the robot's.
    ///
    /// # Panics
    /// If one is on a disc that the robot does not have.
    pub fn of(robot: &Robot, beads: impl IntoIterator<Item = Bead>) -> Self {
        let mut carried = vec![Vec::new(); robot.discs().len()];
        for bead in beads {
            carried[bead.disc].push(bead);
        }
        Self::carried(carried, 0.0)
    }

    fn carried(carried: Vec<Vec<Bead>>, error: f64) -> Self {
        let enclosing = (carried.iter())
            .map(|beads| {
                let reach = beads.iter().map(|bead| bead.centre.norm() + bead.radius);
                reach.fold(0.0, f64::max)
            })
            .collect();
        let (mut all, mut of_disc) = (Vec::new(), Vec::new());
        for beads in carried {
            of_disc.push(all.len()..all.len() + beads.len());
            all.extend(beads);
        }
        Self {
            all,
            of_disc,
            enclosing,
            error,
        }
    }

    /// All beads, from the base up.
    pub fn as_slice(&self) -> &[Bead] {
        &self.all
    }

    /// How far a plane that touches a disc is at most from one that touches its beads (m): what of an obstacle's distance is due
    /// to the shape of the beads.
    pub fn shape_error(&self) -> f64 {
        self.error
    }

    /// The numbers of the beads that a disc carries.
    ///
    /// # Panics
    /// For a disc that the robot does not have.
    pub fn of_disc(&self, disc: usize) -> Range<usize> {
        self.of_disc[disc].clone()
    }

    /// Radius of the sphere about a disc's origin that encloses its beads (m).
    ///
    /// # Panics
    /// For a disc that the robot does not have.
    pub fn enclosing(&self, disc: usize) -> f64 {
        self.enclosing[disc]
    }
}

fn of_disc(index: usize, disc: &Disc) -> Vec<Bead> {
    let (radius, half) = (disc.radius, disc.half_height);
    let bead = |centre, radius| Bead {
        disc: index,
        centre,
        radius,
        along_rod: 0.0,
    };
    if half >= radius {
        let end = half - radius;
        let pieces = (2.0 * end / radius).ceil().clamp(1.0, 100.0);
        let count = if end > 0.0 { pieces as usize + 1 } else { 1 };
        let at = |i: usize| Vector3::z() * (2.0 * end * i as f64 / pieces - end);
        return (0..count).map(|i| bead(at(i), radius)).collect();
    }
    let ring = radius - half;
    let angle = |i: usize| TAU * i as f64 / RING as f64;
    let mut beads: Vec<_> = (0..RING)
        .map(|i| Vector3::new(angle(i).cos(), angle(i).sin(), 0.0) * ring)
        .map(|centre| bead(centre, half))
        .collect();
    if ring > half {
        beads.push(bead(Vector3::zeros(), half));
    }
    beads
}

/// Largest difference of the support functions of a disc and of its beads: along a direction at the elevation `a`, that of the
/// disc is `R cos a + h sin a`, of a ring, halfway between two beads, `(R - h) cos(pi / 12) cos a + h`.
fn shape_error(disc: &Disc) -> f64 {
    let (radius, half) = (disc.radius, disc.half_height);
    if half >= radius {
        return radius * (2.0_f64.sqrt() - 1.0);
    }
    let between = (radius - half) * (TAU / RING as f64 / 2.0).cos();
    (radius - between).hypot(half) - half
}

/// The beads of the rods between the discs; where a disc's own enclose them there are none.
fn of_rods(robot: &Robot) -> Vec<Bead> {
    let (positions, orientations) = Configuration::straight(robot).place(robot);
    let pose = |disc: usize| Isometry3::from_parts(positions[disc].into(), orientations[disc]);
    let spec = robot.spec();
    let radius = |disc: usize| Some(spec.modules[spec.module_of(disc)?].rod?.radius);
    let mut beads = Vec::new();
    for (body, shape, piece) in rod_pieces(robot, radius, pose) {
        // What the base carries does not move.
        let (Some(disc), Kind::Capsule(rod)) = (body, shape.0) else {
            continue;
        };
        let count = ((rod.half_length / rod.radius).ceil() as usize).clamp(1, MOST_OF_ROD);
        let local = pose(disc).inverse() * piece;
        let is_above = local.translation.z > 0.0;
        let places = (0..count).map(|i| (2 * i + 1) as f64 / count as f64 - 1.0);
        let on_rod = places.map(|place| Bead {
            disc,
            centre: (local * Point3::new(0.0, 0.0, place * rod.half_length)).coords,
            radius: rod.radius,
            along_rod: if is_above { 0.5 * (place + 1.0) } else { 0.0 },
        });
        let disc = &robot.discs()[disc];
        let hidden = |bead: &Bead| {
            bead.centre.z.abs() <= disc.half_height
                && bead.centre.xy().norm() + bead.radius <= disc.radius
        };
        beads.extend(on_rod.filter(|bead| !hidden(bead)));
    }
    beads
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;

    /// The farthest that beads and a cylinder reach along a direction, by sampling the cylinder's rims.
    fn reaches(robot: &Robot, disc: usize, direction: &Vector3<f64>) -> [f64; 2] {
        let beads = Beads::new(robot);
        let own = &beads.as_slice()[beads.of_disc(disc)];
        let reach = own.iter().map(|b| b.centre.dot(direction) + b.radius);
        let model = &robot.discs()[disc];
        let across = direction.xy().norm() * model.radius;
        let along = direction.z.abs() * model.half_height;
        [reach.fold(f64::MIN, f64::max), across + along]
    }

    #[test]
    fn the_beads_stand_for_the_disc_within_the_error_that_is_stated() {
        for name in ["2m", "3m", "5m"] {
            let robot = Robot::load(name).unwrap();
            let error = Beads::new(&robot).shape_error();
            let mut largest: f64 = 0.0;
            for step in 0..20_000 {
                let (around, up) = (f64::from(step) * 0.61803, f64::from(step) / 10_000.0 - 1.0);
                let flat = (1.0 - up * up).max(0.0).sqrt();
                let direction = Vector3::new(flat * around.cos(), flat * around.sin(), up);
                let [beads, cylinder] = reaches(&robot, 4, &direction);
                assert!(beads <= cylinder + 1e-12, "beads stick out");
                largest = largest.max(cylinder - beads);
            }
            assert!(
                largest <= error + 1e-12 && largest > 0.99 * error,
                "{largest} {error}"
            );
        }
    }

    #[test]
    fn all_beads_are_within_the_sphere_about_their_disc() {
        let robot = Robot::load("3m").unwrap();
        let beads = Beads::new(&robot);
        for disc in 0..robot.discs().len() {
            for bead in &beads.as_slice()[beads.of_disc(disc)] {
                assert_eq!(bead.disc, disc);
                assert!(bead.centre.norm() + bead.radius <= beads.enclosing(disc));
            }
        }
    }
}

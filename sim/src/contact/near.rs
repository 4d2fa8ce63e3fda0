//! Which beads are near which obstacles, in one posture.
//!
//! The distance from a convex obstacle is a convex function, so that the plane which touches its graph anywhere bounds it everywhere:
//! `d(x) >= d(p) + n . (x - p)`. One such plane for each disc and obstacle ([`Bound`]) tells which beads are far away, also in later
//! postures, and that none has passed through. Other distances change by no more than the way of a point.

use nalgebra::{Matrix3, Vector3};

use super::ContactError;
use super::law::Response;
use super::surfaces::Surfaces;
use crate::chain::Chain;
use crate::geometry::{Bead, Beads, Nearest};
use crate::scene::{Obstacle, ObstacleShape, Scene};

/// Share of the clearance of a disc by which a bound may underrate it before the distance is computed again.
const SLACK: f64 = 0.5;

/// Share of its radius by which a bead that is not in the list may come into an obstacle in one step.
const WITHIN: f64 = 0.7;

/// A bead near the surface of an obstacle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Near {
    pub bead: Bead,
    pub obstacle: usize,
    /// Distance of the surfaces (m), below 0 where they overlap.
    pub gap: f64,
    /// Gradient of the gap by the bead's centre, world axes: where they touch the obstacle's outward normal.
    pub normal: Vector3<f64>,
    /// Second derivative of the gap by the bead's centre (1/m).
    pub curvature: Matrix3<f64>,
    /// Centre of the bead from that of its disc's joint, world axes (m).
    pub arm: Vector3<f64>,
    /// Centre of the bead (m).
    pub centre: Vector3<f64>,
}

impl Near {
    /// What it is between.
    pub fn surfaces(&self) -> Surfaces {
        Surfaces::Obstacle(self.bead, self.obstacle)
    }

    /// By what matrix a displacement of the bead's centre diminishes the force on it (N/m).
    pub fn stiffness(&self, response: &Response) -> Matrix3<f64> {
        let normal = self.normal * self.normal.transpose();
        normal * response.stiffness - self.curvature * response.force
    }
}

/// A lower bound of the distance from an obstacle of all points near a disc.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bound {
    /// Where the distance was computed (m), and what it is there (m): below any at first.
    at: Vector3<f64>,
    distance: f64,
    /// The distance's gradient there, world axes; of an obstacle that is not convex 0.
    pub normal: Vector3<f64>,
    is_convex: bool,
    /// Of the disc's beads that are not in the list, how far they can move at least without one coming too deep (m).
    pub clearance: f64,
    /// A lower bound of their distance (m).
    pub apart: f64,
}

impl Bound {
    const UNKNOWN: Self = Self {
        at: Vector3::new(0.0, 0.0, 0.0),
        distance: f64::NEG_INFINITY,
        normal: Vector3::new(0.0, 0.0, 0.0),
        is_convex: false,
        clearance: 0.0,
        apart: 0.0,
    };

    fn new(obstacle: &Obstacle, at: Vector3<f64>) -> Self {
        let (distance, normal) = obstacle.distance(&at);
        let is_convex = obstacle.is_convex();
        Self {
            at,
            distance,
            normal: if is_convex { normal } else { Vector3::zeros() },
            is_convex,
            clearance: 0.0,
            apart: 0.0,
        }
    }

    /// The bound at a point (m).
    fn of(&self, point: &Vector3<f64>) -> f64 {
        let way = point - self.at;
        match self.is_convex {
            true => self.distance + self.normal.dot(&way),
            false => self.distance - way.norm(),
        }
    }

    /// How far at most, from the obstacle, beads that are not in the list come nearer (m) as the disc's origin is displaced by `shift`
    /// (m), and the disc turned by `turn` (rad) about it, its beads being within `enclosing` (m).
    pub fn approach(&self, shift: &Vector3<f64>, turn: &Vector3<f64>, enclosing: f64) -> f64 {
        let straight = match self.is_convex {
            true => -self.normal.dot(shift),
            false => shift.norm(),
        };
        straight + turn.norm() * enclosing
    }
}

/// The beads within reach of obstacles.
#[derive(Clone, Debug, Default)]
pub(super) struct Neighbourhood {
    pub near: Vec<Near>,
    /// Of each obstacle and each disc, in this order.
    pub bounds: Vec<Bound>,
    /// What was near, and the bounds, when the step began.
    near_before: Vec<Near>,
    before: Vec<Bound>,
    features: Vec<Nearest>,
}

impl Neighbourhood {
    /// Forgets all that is known of other postures.
    pub fn clear(&mut self) {
        self.near.clear();
        self.bounds.clear();
    }

    /// Forgets what is known of other postures about an obstacle that has moved, given the number of discs.
    pub fn forget(&mut self, obstacle: usize, discs: usize) {
        if let Some(bounds) = self
            .bounds
            .get_mut(obstacle * discs..(obstacle + 1) * discs)
        {
            bounds.fill(Bound::UNKNOWN);
        }
    }

    /// Finds all beads whose gap to an obstacle is within the `reach` (m) of the obstacle and the bead's disc.
    pub fn find(
        &mut self,
        beads: &Beads,
        scene: &Scene,
        chain: &Chain,
        reach: impl Fn(usize, usize) -> f64,
    ) {
        let n = chain.positions.len();
        self.near.clear();
        self.bounds
            .resize(scene.obstacles().len() * n, Bound::UNKNOWN);
        for (index, obstacle) in scene.obstacles().iter().enumerate() {
            for (disc, origin) in chain.positions.iter().enumerate() {
                let (enclosing, reach) = (beads.enclosing(disc), reach(index, disc));
                let bound = &mut self.bounds[index * n + disc];
                let mut away = bound.of(origin) - enclosing;
                let least = reach.max(SLACK * (bound.distance - enclosing));
                if away.is_nan() || away < least {
                    *bound = Bound::new(obstacle, *origin);
                    away = bound.distance - enclosing;
                }
                (bound.clearance, bound.apart) = (away, away);
                if away < reach {
                    self.add_disc(beads, disc, (index, obstacle), chain, reach);
                }
            }
        }
    }

    fn add_disc(
        &mut self,
        beads: &Beads,
        disc: usize,
        (index, obstacle): (usize, &Obstacle),
        chain: &Chain,
        reach: f64,
    ) {
        let bound = &mut self.bounds[index * chain.positions.len() + disc];
        let (origin, orientation) = (&chain.positions[disc], chain.disc(disc));
        let at_origin = bound.of(origin);
        let normal = orientation.tr_mul(&bound.normal);
        let (mut clearance, mut apart) = (f64::INFINITY, f64::INFINITY);
        let mut leave_out = |distance: f64, bead: &Bead| {
            apart = apart.min(distance);
            clearance = clearance.min(distance + WITHIN * bead.radius);
        };
        for &bead in &beads.as_slice()[beads.of_disc(disc)] {
            if bound.is_convex {
                let away = at_origin + normal.dot(&bead.centre) - bead.radius;
                if away >= reach {
                    leave_out(away, &bead);
                    continue;
                }
            }
            let centre = origin + orientation * bead.centre;
            self.features.clear();
            obstacle.features(&centre, bead.radius, reach, &mut self.features);
            if self.features.is_empty() || !bound.is_convex {
                leave_out(reach, &bead);
            }
            self.near.extend(self.features.iter().map(|feature| Near {
                bead,
                obstacle: index,
                gap: feature.distance - bead.radius,
                normal: feature.normal,
                curvature: feature.curvature,
                arm: centre - chain.centres[disc],
                centre,
            }));
        }
        (bound.clearance, bound.apart) = (clearance, apart);
    }

    /// Takes the present posture as the one from which steps are judged.
    pub fn begin_step(&mut self) {
        self.near_before.clone_from(&self.near);
        self.before.clone_from(&self.bounds);
    }

    /// Whether the centre of a bead may have passed through a convex obstacle on a straight way to this posture from where the step
    /// began, or come deeper into it by more than `thin` (m): it has not if it stays outside a plane that has the obstacle behind it.
    pub fn has_crossed(&self, beads: &Beads, chain: &Chain, thin: f64) -> bool {
        let n = chain.positions.len();
        let bounds = self.before.iter().enumerate();
        bounds
            .filter(|(_, bound)| bound.is_convex)
            .any(|(index, bound)| {
                let (obstacle, disc) = (index / n, index % n);
                let at_origin = bound.of(&chain.positions[disc]);
                at_origin < beads.enclosing(disc)
                    && (beads.as_slice()[beads.of_disc(disc)].iter()).any(|bead| {
                        let arm = chain.disc(disc) * bead.centre;
                        at_origin + bound.normal.dot(&arm) < -thin
                            && self.is_behind(bead, obstacle, &(chain.positions[disc] + arm), thin)
                    })
            })
    }

    /// The same of a bead that is behind its disc's plane, by its own.
    fn is_behind(&self, bead: &Bead, obstacle: usize, centre: &Vector3<f64>, thin: f64) -> bool {
        let own = |near: &&Near| near.bead == *bead && near.obstacle == obstacle;
        let Some(near) = self.near_before.iter().find(own) else {
            return true;
        };
        let clearance = near.gap + bead.radius;
        near.normal.dot(&(centre - near.centre)) < -clearance.max(thin)
    }
}

/// Refuses a posture, given by the beads' centres (m), in which one of these is inside an obstacle.
pub(super) fn check_outside(
    beads: &Beads,
    scene: &Scene,
    centre: impl Fn(&Bead) -> Vector3<f64>,
) -> Result<(), ContactError> {
    // A bead without a radius is where it presses.
    for bead in beads.as_slice().iter().filter(|bead| bead.radius > 0.0) {
        let centre = centre(bead);
        let mut obstacles = scene.obstacles().iter();
        if let Some(obstacle) = obstacles.find(|obstacle| obstacle.contains(&centre)) {
            return Err(ContactError::StartsInside {
                disc: bead.disc,
                obstacle: obstacle.name.clone(),
                position: centre.into(),
            });
        }
    }
    Ok(())
}

impl Obstacle {
    /// Whether its distance is a convex function.
    fn is_convex(&self) -> bool {
        match &self.shape {
            ObstacleShape::HalfSpace => true,
            ObstacleShape::Solid(shape) => shape.is_convex(),
            ObstacleShape::Pipe(_) => false,
        }
    }

    /// Distance of a point in the world from the obstacle (m), below 0 inside, and its gradient.
    fn distance(&self, point: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let local = self.pose.inverse_transform_point(&(*point).into()).coords;
        let Nearest {
            distance, normal, ..
        } = match &self.shape {
            ObstacleShape::HalfSpace => Nearest::flat(local.z, Vector3::z()),
            ObstacleShape::Solid(shape) => shape.nearest(&local),
            ObstacleShape::Pipe(pipe) => pipe.nearest(&local),
        };
        (distance, self.pose.rotation * normal)
    }

    /// Whether a point in the world is inside.
    fn contains(&self, point: &Vector3<f64>) -> bool {
        match &self.shape {
            ObstacleShape::Solid(shape) => {
                let local = self.pose.inverse_transform_point(&(*point).into()).coords;
                shape.contains(&local)
            }
            ObstacleShape::HalfSpace | ObstacleShape::Pipe(_) => self.distance(point).0 < 0.0,
        }
    }

    /// Adds what of the surface is nearest to a ball in the world, of a radius and within `reach` (m), world axes.
    fn features(&self, centre: &Vector3<f64>, radius: f64, reach: f64, out: &mut Vec<Nearest>) {
        let local = self.pose.inverse_transform_point(&(*centre).into()).coords;
        match &self.shape {
            ObstacleShape::HalfSpace => out.push(Nearest::flat(local.z, Vector3::z())),
            ObstacleShape::Solid(shape) => shape.features(&local, reach + radius, out),
            ObstacleShape::Pipe(pipe) => out.push(pipe.nearest_to_ball(&local, radius)),
        }
        out.retain(|feature| feature.distance < reach + radius);
        if out.is_empty() {
            return;
        }
        let turn = *self.pose.rotation.to_rotation_matrix().matrix();
        for feature in out {
            feature.normal = turn * feature.normal;
            feature.curvature = turn * feature.curvature * turn.transpose();
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;
    use crate::chain::Configuration;
    use crate::robot::{Loads, Robot};

    fn obstacles() -> Vec<Obstacle> {
        let spot = [0.05, 0.02, 0.2];
        vec![
            Obstacle::half_space("floor"),
            Obstacle::sphere("ball", 0.02).unwrap().at(spot),
            Obstacle::capsule("bar", 0.01, 0.1).unwrap().at(spot),
            Obstacle::cylinder("post", 0.01, 0.4).unwrap().at(spot),
            Obstacle::cuboid("box", [0.02, 0.03, 0.1]).unwrap().at(spot),
            Obstacle::pipe("pipe", 0.1, 0.6)
                .unwrap()
                .at([0.0, 0.0, 0.3]),
        ]
    }

    #[test]
    fn a_bound_is_below_the_distance_everywhere() {
        for obstacle in obstacles() {
            for step in 0..200 {
                let point = |k: i32| {
                    let k = f64::from(k);
                    Vector3::new(
                        (k * 0.7).sin() * 0.1,
                        (k * 1.3).cos() * 0.1,
                        0.2 + (k * 2.1).sin() * 0.1,
                    )
                };
                let (from, to) = (point(step), point(7 * step + 3));
                let bound = Bound::new(&obstacle, from);
                let distance = obstacle.distance(&to).0;
                assert!(
                    bound.of(&to) <= distance + 1e-12,
                    "{} {step}",
                    obstacle.name
                );
                assert!((bound.of(&from) - obstacle.distance(&from).0).abs() < 1e-15);
            }
        }
    }

    /// Beads found with what is known of other postures are those found anew, and one that jumps through a post is noticed.
    #[test]
    fn what_is_near_does_not_depend_on_other_postures() {
        let robot = Robot::load("2m").unwrap();
        let beads = Beads::new(&robot);
        let scene = Scene::new(obstacles()).unwrap();
        let reach = 0.01;
        let mut known = Neighbourhood::default();
        let mut chain = Chain::new(&robot);
        let mut found = 0;
        for pull in 0..20 {
            let values = [
                0.02 + 0.0009 * f64::from(pull),
                0.02,
                0.01,
                0.02,
                0.02,
                0.01,
            ];
            let command = robot.command(&values).unwrap();
            let bent = robot.settle(&command, &Loads::default());
            chain.place(&robot, &bent.configuration);
            known.find(&beads, &scene, &chain, |_, _| reach);
            let mut anew = Neighbourhood::default();
            anew.find(&beads, &scene, &chain, |_, _| reach);
            let gaps = |of: &Neighbourhood| of.near.iter().map(|near| near.gap).collect::<Vec<_>>();
            assert_eq!(gaps(&known), gaps(&anew));
            found += anew.near.len();
        }
        assert!(found > 0);
    }

    #[test]
    fn a_step_through_a_thin_wall_is_noticed() {
        let robot = Robot::load("2m").unwrap();
        let beads = Beads::new(&robot);
        let wall = Obstacle::cuboid("wall", [0.001, 1.0, 1.0]).unwrap();
        let scene = Scene::new(vec![wall.at([0.03, 0.0, 0.3])]).unwrap();
        let mut chain = Chain::new(&robot);
        chain.place(&robot, &Configuration::straight(&robot));
        let mut neighbourhood = Neighbourhood::default();
        neighbourhood.find(&beads, &scene, &chain, |_, _| 0.01);
        neighbourhood.begin_step();
        let moved = |way: f64| {
            let mut there = chain.clone();
            there
                .positions
                .iter_mut()
                .for_each(|position| position.x += way);
            neighbourhood.has_crossed(&beads, &there, 1e-6)
        };
        assert!(!moved(0.005) && !moved(-0.2) && moved(0.1));
    }
}

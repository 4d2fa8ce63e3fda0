//! Which beads are near which obstacles, in one posture.

use nalgebra::{Matrix3, Vector3};

use super::ContactError;
use super::law::Response;
use crate::chain::Chain;
use crate::geometry::{Bead, Beads, Nearest};
use crate::scene::{Obstacle, ObstacleShape, Scene};

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
}

impl Near {
    /// By what matrix a displacement of the bead's centre diminishes the force on it (N/m).
    pub fn stiffness(&self, response: &Response) -> Matrix3<f64> {
        let normal = self.normal * self.normal.transpose();
        normal * response.stiffness - self.curvature * response.force
    }
}

/// The beads within reach of obstacles.
#[derive(Clone, Debug, Default)]
pub(super) struct Neighbourhood {
    pub near: Vec<Near>,
    /// Of each disc, how far it can move at least without a contact that is not in the list (m).
    pub free: Vec<f64>,
    features: Vec<Nearest>,
}

impl Neighbourhood {
    /// Finds all beads whose gap to an obstacle is within `reach` (m).
    pub fn find(&mut self, beads: &Beads, scene: &Scene, chain: &Chain, reach: f64) {
        self.near.clear();
        self.free.clear();
        self.free.resize(chain.positions.len(), f64::INFINITY);
        for (index, obstacle) in scene.obstacles().iter().enumerate() {
            for disc in 0..chain.positions.len() {
                let away = obstacle.distance(&chain.positions[disc]) - beads.enclosing(disc);
                if away >= reach {
                    self.free[disc] = self.free[disc].min(away);
                } else {
                    self.free[disc] = self.free[disc].min(reach);
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
        for &bead in &beads.as_slice()[beads.of_disc(disc)] {
            let centre = chain.positions[disc] + chain.disc(disc) * bead.centre;
            self.features.clear();
            obstacle.features(&centre, bead.radius, reach, &mut self.features);
            self.near.extend(self.features.iter().map(|feature| Near {
                bead,
                obstacle: index,
                gap: feature.distance - bead.radius,
                normal: feature.normal,
                curvature: feature.curvature,
                arm: centre - chain.centres[disc],
            }));
        }
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
    /// Distance of a point in the world from the obstacle (m), below 0 inside.
    pub(super) fn distance(&self, point: &Vector3<f64>) -> f64 {
        let local = self.pose.inverse_transform_point(&(*point).into()).coords;
        match &self.shape {
            ObstacleShape::HalfSpace => local.z,
            ObstacleShape::Solid(shape) => shape.nearest(&local).distance,
            ObstacleShape::Pipe(pipe) => pipe.nearest(&local).distance,
        }
    }

    /// Whether a point in the world is inside.
    fn contains(&self, point: &Vector3<f64>) -> bool {
        match &self.shape {
            ObstacleShape::Solid(shape) => {
                let local = self.pose.inverse_transform_point(&(*point).into()).coords;
                shape.contains(&local)
            }
            ObstacleShape::HalfSpace | ObstacleShape::Pipe(_) => self.distance(point) < 0.0,
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

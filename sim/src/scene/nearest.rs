//! Which obstacle a robot is nearest to.

use nalgebra::Isometry3;

use super::Scene;
use crate::geometry::Beads;

/// What is nearest of a robot and its surroundings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// The obstacle's number.
    pub obstacle: usize,
    /// The disc, from 0.
    pub disc: usize,
    /// Distance (m) of the obstacle from the disc's beads, below 0 where they overlap. The disc itself may be nearer by
    /// [`Beads::shape_error`].
    pub gap: f64,
}

impl Scene {
    /// The obstacle that is nearest to beads of discs in these places (world); `None` without obstacles.
    pub fn nearest(
        &self,
        beads: &Beads,
        discs: impl Iterator<Item = Isometry3<f64>> + Clone,
    ) -> Option<Nearest> {
        let mut nearest: Option<Nearest> = None;
        for (number, obstacle) in self.obstacles().iter().enumerate() {
            for (disc, place) in discs.clone().enumerate() {
                let least = nearest.map_or(f64::INFINITY, |found| found.gap);
                // None of the disc's beads is nearer than the sphere about them.
                let origin = place.translation.vector;
                if obstacle.signed_distance(&origin) - beads.enclosing(disc) >= least {
                    continue;
                }
                for bead in &beads.as_slice()[beads.of_disc(disc)] {
                    let centre = origin + place.rotation * bead.centre;
                    let gap = obstacle.signed_distance(&centre) - bead.radius;
                    if nearest.is_none_or(|found| gap < found.gap) {
                        nearest = Some(Nearest {
                            obstacle: number,
                            disc,
                            gap,
                        });
                    }
                }
            }
        }
        nearest
    }
}

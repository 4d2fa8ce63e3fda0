//! How far a robot is from obstacles where it rests.

use super::ContactSettler;

impl ContactSettler {
    /// Smallest gap (m) between a bead and an obstacle at the last equilibrium, of the undeformed shapes: below 0 where they are
    /// pressed into each other, infinite without obstacles.
    pub fn clearance(&self) -> f64 {
        let (beads, pose) = (self.beads(), self.found().equilibrium.pose());
        let mut least = f64::INFINITY;
        for obstacle in self.scene().obstacles() {
            for (disc, (position, turn)) in pose.positions.iter().zip(pose.orientations).enumerate()
            {
                // None of the disc's beads is nearer than the sphere about them.
                if obstacle.signed_distance(position) - beads.enclosing(disc) >= least {
                    continue;
                }
                for bead in &beads.as_slice()[beads.of_disc(disc)] {
                    let centre = position + turn * bead.centre;
                    least = least.min(obstacle.signed_distance(&centre) - bead.radius);
                }
            }
        }
        least
    }
}

//! How far a robot is from obstacles where it rests.

use super::ContactSettler;

impl ContactSettler {
    /// Smallest gap (m) between a bead and an obstacle at the last equilibrium, of the undeformed shapes: below 0 where they are
    /// pressed into each other, infinite without obstacles.
    pub fn clearance(&self) -> f64 {
        let pose = self.found().equilibrium.pose();
        let discs = (0..pose.positions.len()).map(|disc| pose.disc(disc));
        let nearest = self.scene().nearest(self.beads(), discs);
        nearest.map_or(f64::INFINITY, |found| found.gap)
    }
}

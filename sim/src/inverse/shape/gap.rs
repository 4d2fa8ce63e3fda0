//! How far beads are from obstacles.

use nalgebra::Vector3;

use crate::geometry::Beads;
use crate::scene::Scene;
use crate::sensitivity::PoseTangent;
use crate::statics::Equilibrium;

/// Where a bead is: from its disc's origin, world axes, and in the world (m).
pub(super) fn bead_place(
    beads: &Beads,
    equilibrium: &Equilibrium,
    bead: usize,
) -> [Vector3<f64>; 2] {
    let bead = &beads.as_slice()[bead];
    let arm = equilibrium.orientations[bead.disc] * bead.centre;
    [arm, equilibrium.positions[bead.disc] + arm]
}

/// The gap of a bead and an obstacle of a scene (m), and its gradient by the pose of the bead's disc.
pub(super) fn gap_of(
    beads: &Beads,
    scene: &Scene,
    equilibrium: &Equilibrium,
    [bead, obstacle]: [usize; 2],
) -> (f64, PoseTangent) {
    let [arm, centre] = bead_place(beads, equilibrium, bead);
    let (distance, normal) = scene.obstacles()[obstacle].signed_distance_and_gradient(&centre);
    let gradient = PoseTangent {
        position: normal,
        rotation: arm.cross(&normal),
    };
    (distance - beads.as_slice()[bead].radius, gradient)
}

/// The bead of one disc, or of all, that is nearest to an obstacle of a scene, and its gap (m).
pub(super) fn nearest_bead(
    beads: &Beads,
    scene: &Scene,
    equilibrium: &Equilibrium,
    (obstacle, disc): (usize, Option<usize>),
) -> Option<(usize, f64)> {
    let obstacle = &scene.obstacles()[obstacle];
    let asked = (beads.as_slice().iter().enumerate())
        .filter(|(_, bead)| disc.is_none_or(|disc| disc == bead.disc));
    let gaps = asked.map(|(number, bead)| {
        let [_, centre] = bead_place(beads, equilibrium, number);
        (number, obstacle.signed_distance(&centre) - bead.radius)
    });
    gaps.min_by(|a, b| a.1.total_cmp(&b.1))
}

//! Bristles by an active set: their forces, and what motions change those by.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::ActiveStep;
use super::touch::Face;
use crate::chain::Chain;
use crate::contact::equations::Equations;
use crate::contact::friction::Bristle;
use crate::contact::near_pairs::NearPair;
use crate::contact::surfaces::Surfaces;
use crate::energy::Coupling;

/// Where a bristle's forces point where a step began.
#[derive(Clone, Copy, Debug)]
pub(super) struct Way {
    /// Where they act (m).
    at: Vector3<f64>,
    /// Out of the surface.
    normal: Vector3<f64>,
    /// Along it, against its sliding, of one that slips.
    friction: Option<Vector3<f64>>,
}

/// What a bristle does.
#[derive(Clone, Debug)]
pub(super) struct Rubbed {
    /// Its force with what that has besides (N).
    force: Vector3<f64>,
    change: Change,
}

/// What a bristle's force diminishes by.
#[derive(Clone, Debug)]
enum Change {
    /// By a displacement of the point of a disc (N/m).
    Disc(usize, Matrix3<f64>),
    /// By the turns and displacements of two: rows of a [`Coupling`].
    Discs([usize; 2], Box<SMatrix<f64, 3, 12>>),
}

/// A bristle's force to first order where it is assumed to slip, or to stick.
struct Assumed {
    /// By the multipliers (N).
    force: Vector3<f64>,
    /// What it has besides (N).
    besides: Vector3<f64>,
    /// What a way along the surface diminishes it by (N/m).
    along: Matrix3<f64>,
    /// The same of a displacement across it, which changes what it is bounded by.
    bounded: Matrix3<f64>,
    /// The same of one that turns the normal.
    turned: Matrix3<f64>,
}

impl Way {
    /// The force (N) that a bristle has after motions of the discs, a turn (rad) and a displacement at a point (m).
    pub fn led_to(
        &self,
        rubbed: &Rubbed,
        motion: impl Fn(usize, &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>),
    ) -> Vector3<f64> {
        let change = match &rubbed.change {
            Change::Disc(disc, change) => change * motion(*disc, &self.at).1,
            Change::Discs(discs, change) => {
                let mut moved = SMatrix::<f64, 12, 1>::zeros();
                for (end, disc) in discs.iter().enumerate() {
                    let (turn, shift) = motion(*disc, &self.at);
                    moved.fixed_rows_mut::<3>(6 * end).copy_from(&turn);
                    moved.fixed_rows_mut::<3>(6 * end + 3).copy_from(&shift);
                }
                **change * moved
            }
        };
        rubbed.force - change
    }
}

impl ActiveStep {
    /// Presses a bristle, with what its faces bear.
    pub(super) fn rub(
        &mut self,
        equations: &Equations,
        (index, bristle): (usize, &Bristle),
        face: Option<Face>,
        share: f64,
    ) {
        let is_base = self.base.ways.len() == index;
        let Some(face) = face else {
            self.asked.rubbing.push((true, Vector3::zeros()));
            self.rubbed.push(None);
            if is_base {
                self.base.ways.push(None);
            }
            return;
        };
        let (slips, from) = self.assumed.rubbing[index];
        let known = from + (self.predicted.rubbing[index].1 - from) * share;
        let chain = &equations.iterate.posture.chain;
        let friction = bristle.surfaces().friction(&equations.scene);
        let way = bristle.way(chain);
        // Out of the surface, also where a step would have it pull.
        let normal = face.force.try_normalize(0.0).unwrap_or(face.normal);
        let normal = normal * normal.dot(&face.normal).signum();
        let most = friction * face.force.dot(&normal);
        let mut own = *bristle;
        own.press(normal, most);
        let gone = (-own.stretch(&way)).try_normalize(0.0).filter(|_| slips);
        let here = Way {
            at: bristle.acts_at(chain),
            normal,
            friction: gone,
        };
        if is_base {
            self.base.ways.push(Some(here));
        }
        // What forces are besides may be far from any: it takes the directions of the base.
        let base = self.base.ways[index].unwrap_or(here);
        // The normal turns as the bead moves along the surface.
        let turned = |force: &Vector3<f64>| normal * (face.curvature * force).transpose();
        let assumed = match gone {
            Some(way_back) => {
                let borne = friction * face.besides.dot(&normal);
                let force = way_back * most;
                Assumed {
                    force,
                    besides: base.friction.unwrap_or(way_back) * borne,
                    along: own.response_if(true, &way).1,
                    // Friction is bounded by what is borne.
                    bounded: way_back * (face.stiffness * normal).transpose() * friction,
                    turned: turned(&force),
                }
            }
            None => {
                let mut held = own;
                held.press(base.normal, most);
                let (rubbing, along) = held.response_if(false, &way);
                Assumed {
                    force: known,
                    besides: rubbing - known,
                    along,
                    bounded: Matrix3::zeros(),
                    turned: turned(&known),
                }
            }
        };
        let change = self.push_rubbed(equations, bristle, &assumed, &base.at);
        self.asked.rubbing.push((own.slips(&way), assumed.force));
        self.rubbed.push(Some(Rubbed {
            force: assumed.force + assumed.besides,
            change,
        }));
    }

    /// Adds the force of a bristle, and what it has besides where the step began.
    fn push_rubbed(
        &mut self,
        equations: &Equations,
        bristle: &Bristle,
        assumed: &Assumed,
        base: &Vector3<f64>,
    ) -> Change {
        let posture = &equations.iterate.posture;
        let (force, besides) = (assumed.force, assumed.besides);
        match bristle.surfaces() {
            Surfaces::Obstacle(bead, _) => {
                let change = assumed.along + assumed.bounded + assumed.turned;
                let point = (bead.disc, bead.centre);
                self.pressing.push(posture, point, force, &change);
                self.besides.push((bead.disc, *base, besides));
                Change::Disc(bead.disc, change)
            }
            Surfaces::Discs(beads) => {
                let pair = NearPair::at(beads, &posture.chain);
                let (coupling, change) = assumed.coupling(&pair, bristle, &posture.chain);
                self.pressing.push_coupling(posture, coupling, force);
                for (disc, besides) in pair.discs().into_iter().zip([besides, -besides]) {
                    self.besides.push((disc, *base, besides));
                }
                Change::Discs(pair.discs(), Box::new(change))
            }
        }
    }
}

impl Assumed {
    /// What motions of both discs change, the force on the first of them by, and all on both.
    fn coupling(
        &self,
        pair: &NearPair,
        bristle: &Bristle,
        chain: &Chain,
    ) -> (Coupling, SMatrix<f64, 3, 12>) {
        let at = pair.meeting();
        let [start, end] = bristle.ends_at(chain);
        let none = SMatrix::<f64, 3, 12>::zeros();
        // The displacement of a point of the first disc or the second.
        let moved = |disc: usize, point: &Vector3<f64>| {
            let mut moved = none;
            let arm = (point - at).cross_matrix();
            moved
                .fixed_view_mut::<3, 3>(0, 6 * disc)
                .copy_from(&arm.transpose());
            moved
                .fixed_view_mut::<3, 3>(0, 6 * disc + 3)
                .copy_from(&Matrix3::identity());
            moved
        };
        let centres = [0, 1].map(|disc| moved(disc, &pair.centres[disc]));
        let own = [0, 1].map(|disc| moved(disc, &at));
        let apart = centres[0] - centres[1];
        let change = self.along * (moved(0, &start) - moved(1, &end))
            + self.bounded * (own[0] - own[1])
            + self.turned * apart;
        // Where they meet moves on along both.
        let radii = pair.beads.map(|bead| bead.radius);
        let meeting = (centres[0] + centres[1]) * 0.5
            + pair.curvature() * apart * (0.5 * (radii[1] - radii[0]));
        let lever = self.force.cross_matrix();
        let mut form = SMatrix::<f64, 12, 12>::zeros();
        for (disc, sign) in [(0, 1.0), (1, -1.0)] {
            form.fixed_rows_mut::<3>(6 * disc)
                .copy_from(&(lever * (meeting - own[disc]) * sign));
            form.fixed_rows_mut::<3>(6 * disc + 3)
                .copy_from(&(change * sign));
        }
        let coupling = Coupling {
            discs: pair.discs(),
            position: at,
            form,
        };
        (coupling, change)
    }
}

//! Forces on points of discs that change as the points move: contacts.
//!
//! In one configuration a contact is a dead force `f` on a point `p` of a disc, which the gradient and a part of the Hessian follow
//! from ([`super::DeadForces`]). The rest of the Hessian is a form of the disc's motion `z_k`, its turn and the displacement of
//! its joint's centre: `-P' (df/dp) P`, `P` being the point's displacement by it. Where two discs press each other it is a form of
//! the displacement of one point from the other ([`Pair`]), or where that is not all that their forces follow, one of both discs' motions
//! ([`Coupling`]).

use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3};

use super::DeadForces;
use crate::tendon::Posture;

/// A point of a disc.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DiscPoint {
    pub disc: usize,
    /// From the disc's origin, in its frame (m).
    pub local: Vector3<f64>,
    /// Where it is (m).
    pub position: Vector3<f64>,
}

/// Points of two discs that push each other with opposite forces.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair {
    pub points: [DiscPoint; 2],
    /// An axis of length 1: of points that press each other apart, from the second to the first.
    pub axis: Vector3<f64>,
    /// What a displacement of the first point from the second diminishes the force on the first by (N/m): along the axis, and
    /// across it.
    pub stiffness: [f64; 2],
}

impl Pair {
    /// By what matrix a displacement of the first point from the second diminishes the force on the first (N/m).
    pub fn form(&self) -> Matrix3<f64> {
        let [along, across] = self.stiffness;
        let axis = self.axis * self.axis.transpose();
        axis * (along - across) + Matrix3::identity() * across
    }
}

/// A place at which two discs push each other with opposite forces, which follow their turns too, as the place is fixed to neither.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Coupling {
    pub discs: [usize; 2],
    /// Where (m).
    pub position: Vector3<f64>,
    /// By what the turn (rad) and the displacement there (m) of the first disc, and then of the second, diminish the moment about the place
    /// (N m) and the force (N) on the first disc, and then on the second; need not be symmetric.
    pub form: SMatrix<f64, 12, 12>,
}

/// The contacts of a robot in one configuration, as the potential takes them.
#[derive(Clone, Debug)]
pub(crate) struct Pressing {
    /// Disc, point from its origin in its frame (m), force in world axes (N).
    forces: Vec<(usize, Vector3<f64>, Vector3<f64>)>,
    /// Of each disc the form of its motion, symmetric.
    pub forms: Vec<Matrix6<f64>>,
    /// Discs that push each other.
    pub pairs: Vec<Pair>,
    /// Those whose forces follow their turns too: only dense matrices have them.
    pub couplings: Vec<Coupling>,
}

impl Pressing {
    /// No contacts of a robot of so many discs.
    pub fn none(discs: usize) -> Self {
        Self {
            forces: Vec::new(),
            forms: vec![Matrix6::zeros(); discs],
            pairs: Vec::new(),
            couplings: Vec::new(),
        }
    }

    pub fn clear(&mut self) {
        self.forces.clear();
        self.forms.fill(Matrix6::zeros());
        self.pairs.clear();
        self.couplings.clear();
    }

    /// Adds a force (N, world axes) on the first point of a pair, and the opposite one on the second.
    pub fn push_pair(&mut self, pair: Pair, force: Vector3<f64>) {
        for (point, force) in pair.points.iter().zip([force, -force]) {
            self.forces.push((point.disc, point.local, force));
        }
        self.pairs.push(pair);
    }

    /// The same where two discs are coupled.
    pub fn push_coupling(&mut self, posture: &Posture, coupling: Coupling, force: Vector3<f64>) {
        let chain = &posture.chain;
        for (disc, force) in coupling.discs.into_iter().zip([force, -force]) {
            let local = chain.local(disc, &coupling.position);
            self.forces.push((disc, local, force));
        }
        self.couplings.push(coupling);
    }

    /// Adds a force (N, world axes) on a point of a disc, from its origin in its frame (m), that a displacement `u` of the point
    /// changes by `-stiffness u` (N/m).
    pub fn push(
        &mut self,
        posture: &Posture,
        (disc, point): (usize, Vector3<f64>),
        force: Vector3<f64>,
        stiffness: &Matrix3<f64>,
    ) {
        self.forces.push((disc, point, force));
        let chain = &posture.chain;
        let arm = chain.positions[disc] + chain.disc(disc) * point - chain.centres[disc];
        // The point moves by `v - [arm]x Omega`.
        let arm = arm.cross_matrix();
        let levered = stiffness * arm;
        let form = &mut self.forms[disc];
        let mut block = form.fixed_view_mut::<3, 3>(3, 3);
        block += stiffness;
        let mut block = form.fixed_view_mut::<3, 3>(3, 0);
        block -= levered;
        let mut block = form.fixed_view_mut::<3, 3>(0, 3);
        block -= arm.tr_mul(stiffness);
        let mut block = form.fixed_view_mut::<3, 3>(0, 0);
        block += arm.transpose() * levered;
    }

    /// Adds the forces as they are in this configuration to dead ones.
    pub fn add_to(&self, dead: &mut DeadForces) {
        for (disc, point, force) in &self.forces {
            dead.push(*disc, point, force);
        }
    }
}

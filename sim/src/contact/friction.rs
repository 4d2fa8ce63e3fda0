//! Coulomb friction of contacts along paths of equilibria.
//!
//! A contact that bears the force `f` resists sliding by up to `F f`, `F` being the obstacle's coefficient. A bristle stands for
//! that: a spring from the bead to where it sticks to the surface, as compliant as the surface is, whose force is the smaller of the
//! spring's and `F f`; where that is `F f` the contact slips, and sticks from then on where the spring just bears it (return mapping:
//! Simo and Hughes, Computational Inelasticity, ch. 2). The balance is solved with contacts that slip or stick and their forces as
//! unknowns. Where that leads nowhere, `F f` and the normal are those of the solve before: then the force
//! has a convex potential, so an equilibrium is a minimum of the energy; it is solved for again until they are its own (lagged friction: Li
//! et al., Incremental Potential Contact, 2020).

use nalgebra::{Matrix3, Vector3};

use super::law::Law;
use crate::chain::Chain;
use crate::geometry::Bead;

/// A contact that resists sliding.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bristle {
    pub bead: Bead,
    pub obstacle: usize,
    /// Where the bead's centre is while the bristle is slack (m).
    anchor: Vector3<f64>,
    /// Normal of the surface.
    normal: Vector3<f64>,
    /// Stiffness along the surface (N/m).
    pub stiffness: f64,
    /// Largest force (N).
    most: f64,
}

impl Bristle {
    /// One that is slack where a bead is.
    pub fn new(bead: Bead, obstacle: usize, compliance: f64, at: &Vector3<f64>) -> Self {
        Self {
            bead,
            obstacle,
            anchor: *at,
            normal: Vector3::zeros(),
            stiffness: Law::new(0.0, compliance, 1.0).compliance.recip(),
            most: 0.0,
        }
    }

    /// Whether it is of a bead and an obstacle.
    pub fn is_of(&self, bead: &Bead, obstacle: usize) -> bool {
        self.bead == *bead && self.obstacle == obstacle
    }

    /// Lets it bear up to `most` (N) across a normal.
    pub fn press(&mut self, normal: Vector3<f64>, most: f64) {
        (self.normal, self.most) = (normal, most);
    }

    /// Where its bead's centre is (m).
    pub fn position(&self, chain: &Chain) -> Vector3<f64> {
        chain.positions[self.bead.disc] + chain.disc(self.bead.disc) * self.bead.centre
    }

    /// How far the bead has been displaced along the surface (m).
    pub fn stretch(&self, position: &Vector3<f64>) -> Vector3<f64> {
        let way = position - self.anchor;
        way - self.normal * self.normal.dot(&way)
    }

    /// Whether the contact slips where the bead's centre is at a position (m).
    pub fn slips(&self, position: &Vector3<f64>) -> bool {
        self.stiffness * self.stretch(position).norm() > self.most
    }

    /// Energy (J) there.
    pub fn energy(&self, position: &Vector3<f64>) -> f64 {
        let length = self.stretch(position).norm();
        let limit = self.most / self.stiffness;
        match length > limit {
            true => self.most * (length - 0.5 * limit),
            false => 0.5 * self.stiffness * length * length,
        }
    }

    /// Force on the bead there (N), and what a displacement of the bead diminishes it by (N/m).
    pub fn response(&self, position: &Vector3<f64>) -> (Vector3<f64>, Matrix3<f64>) {
        self.response_if(self.slips(position), position)
    }

    /// The same of a contact that is taken to slip, or to stick.
    pub fn response_if(
        &self,
        slips: bool,
        position: &Vector3<f64>,
    ) -> (Vector3<f64>, Matrix3<f64>) {
        let stretch = self.stretch(position);
        let length = stretch.norm();
        let along = Matrix3::identity() - self.normal * self.normal.transpose();
        if !slips || length == 0.0 {
            return (stretch * -self.stiffness, along * self.stiffness);
        }
        let way = stretch / length;
        let across = along - way * way.transpose();
        (way * -self.most, across * (self.most / length))
    }

    /// Where it slipped it sticks from now on.
    pub fn stick(&mut self, position: &Vector3<f64>) {
        let stretch = self.stretch(position);
        let slack = match self.slips(position) {
            true => stretch * (self.most / self.stiffness / stretch.norm()),
            false => stretch,
        };
        self.anchor = position - slack;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn force_and_stiffness_are_derivatives_of_the_energy() {
        let bead = Bead {
            disc: 0,
            centre: Vector3::zeros(),
            radius: 0.01,
            along_rod: 0.0,
        };
        let mut bristle = Bristle::new(bead, 0, 1e-3, &Vector3::new(0.1, 0.2, 0.3));
        bristle.press(Vector3::new(0.6, 0.0, 0.8), 0.5);
        for way in [1e-4, 4e-4, 6e-4, 5e-3] {
            let at = Vector3::new(0.1, 0.2, 0.3) + Vector3::new(0.3, -1.0, 0.4) * way;
            let (force, stiffness) = bristle.response(&at);
            for axis in 0..3 {
                let step = Vector3::ith(axis, 1e-8);
                let slope = (bristle.energy(&(at - step)) - bristle.energy(&(at + step))) / 2e-8;
                let change = bristle.response(&(at - step)).0 - bristle.response(&(at + step)).0;
                assert!((slope - force[axis]).abs() < 1e-6, "{slope} {force}");
                assert!((change / 2e-8 - stiffness.column(axis)).norm() < 1e-3);
            }
            assert!(force.norm() <= 0.5 + 1e-12);
            assert_eq!(bristle.slips(&at), (force.norm() - 0.5).abs() < 1e-12);
        }
    }
}

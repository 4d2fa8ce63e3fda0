//! Coulomb friction of contacts along paths of equilibria.
//!
//! A contact that bears the force `f` resists sliding by up to `F f`, `F` being the coefficient of its surfaces. A bristle stands for
//! that: a spring from the bead to where it sticks to the surface, as compliant as the surface is, whose force is the smaller of the
//! spring's and `F f`; where that is `F f` the contact slips, and sticks from then on where the spring just bears it (return mapping:
//! Simo and Hughes, Computational Inelasticity, ch. 2). The balance is solved with contacts that slip or stick and their forces as
//! unknowns. Where that leads nowhere, `F f` and the normal are those of the solve before: then the force
//! has a convex potential, so an equilibrium is a minimum of the energy; it is solved for again until they are its own (lagged friction: Li
//! et al., Incremental Potential Contact, 2020).
//!
//! Between two discs a bristle is a spring from one to the other, between points of both that are in one place while it is slack, so that
//! a motion of both does not stretch it. It acts on both where their surfaces meet, and as they roll its ends move on to there
//! ([`Bristle::carry`]).

use nalgebra::{Matrix3, Vector3};

use super::law::Law;
use super::near_pairs::NearPair;
use super::surfaces::Surfaces;
use crate::chain::Chain;
use crate::energy::{DiscPoint, Pair};
use crate::geometry::Bead;

/// A contact that resists sliding.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bristle {
    ends: Ends,
    /// Normal of the surface.
    normal: Vector3<f64>,
    /// Stiffness along the surface (N/m).
    pub stiffness: f64,
    /// Largest force (N).
    most: f64,
}

/// What a bristle holds, and where it is slack.
#[derive(Clone, Copy, Debug)]
enum Ends {
    Obstacle {
        bead: Bead,
        obstacle: usize,
        /// Where the bead's centre is while the bristle is slack, in the world (m).
        anchor: Vector3<f64>,
    },
    Discs {
        beads: [Bead; 2],
        /// Points of both, each in its disc's frame (m), which are in one place while the bristle is slack.
        points: [Vector3<f64>; 2],
    },
}

impl Bristle {
    /// One that is slack where a bead is.
    pub fn new(bead: Bead, obstacle: usize, compliance: f64, at: &Vector3<f64>) -> Self {
        let anchor = *at;
        Self::of_ends(
            Ends::Obstacle {
                bead,
                obstacle,
                anchor,
            },
            compliance,
        )
    }

    /// One that is slack where two discs are.
    pub fn between(pair: &NearPair, chain: &Chain, compliance: f64) -> Self {
        let meeting = pair.meeting();
        let ends = Ends::Discs {
            beads: pair.beads,
            points: pair.discs().map(|disc| chain.local(disc, &meeting)),
        };
        Self::of_ends(ends, compliance)
    }

    fn of_ends(ends: Ends, compliance: f64) -> Self {
        Self {
            ends,
            normal: Vector3::zeros(),
            stiffness: Law::new(0.0, compliance, 1.0).compliance.recip(),
            most: 0.0,
        }
    }

    /// What it is between.
    pub fn surfaces(&self) -> Surfaces {
        match self.ends {
            Ends::Obstacle { bead, obstacle, .. } => Surfaces::Obstacle(bead, obstacle),
            Ends::Discs { beads, .. } => Surfaces::Discs(beads),
        }
    }

    /// Whether it is between these.
    pub fn is_of(&self, surfaces: &Surfaces) -> bool {
        self.surfaces() == *surfaces
    }

    /// Lets it bear up to `most` (N) across a normal.
    pub fn press(&mut self, normal: Vector3<f64>, most: f64) {
        (self.normal, self.most) = (normal, most);
    }

    /// Where it acts (m): on a bead's centre, or where two discs meet.
    pub fn acts_at(&self, chain: &Chain) -> Vector3<f64> {
        match self.surfaces() {
            Surfaces::Obstacle(bead, _) => chain.carried(bead.disc, &bead.centre),
            Surfaces::Discs(beads) => NearPair::at(beads, chain).meeting(),
        }
    }

    /// Where its ends are (m): on the disc, and on what that touches.
    pub fn ends_at(&self, chain: &Chain) -> [Vector3<f64>; 2] {
        match &self.ends {
            Ends::Obstacle { bead, anchor, .. } => {
                [chain.carried(bead.disc, &bead.centre), *anchor]
            }
            Ends::Discs { beads, points } => {
                [0, 1].map(|end| chain.carried(beads[end].disc, &points[end]))
            }
        }
    }

    /// How far the surfaces have been displaced since it was slack (m).
    pub fn way(&self, chain: &Chain) -> Vector3<f64> {
        let [own, other] = self.ends_at(chain);
        own - other
    }

    /// What of a way is along the surface (m).
    pub fn stretch(&self, way: &Vector3<f64>) -> Vector3<f64> {
        way - self.normal * self.normal.dot(way)
    }

    /// Whether the contact slips after a way (m).
    pub fn slips(&self, way: &Vector3<f64>) -> bool {
        self.stiffness * self.stretch(way).norm() > self.most
    }

    /// Energy (J) then.
    pub fn energy(&self, way: &Vector3<f64>) -> f64 {
        let length = self.stretch(way).norm();
        let limit = self.most / self.stiffness;
        match length > limit {
            true => self.most * (length - 0.5 * limit),
            false => 0.5 * self.stiffness * length * length,
        }
    }

    /// Force (N) then, and what a displacement diminishes it by (N/m).
    pub fn response(&self, way: &Vector3<f64>) -> (Vector3<f64>, Matrix3<f64>) {
        self.response_if(self.slips(way), way)
    }

    /// The same of a contact that is taken to slip, or to stick.
    pub fn response_if(&self, slips: bool, way: &Vector3<f64>) -> (Vector3<f64>, Matrix3<f64>) {
        let stretch = self.stretch(way);
        let length = stretch.norm();
        let along = Matrix3::identity() - self.normal * self.normal.transpose();
        if !slips || length == 0.0 {
            return (stretch * -self.stiffness, along * self.stiffness);
        }
        let way = stretch / length;
        let across = along - way * way.transpose();
        (way * -self.most, across * (self.most / length))
    }

    /// What displacements change its force by, of one between these beads' discs.
    pub fn pair(&self, beads: &[Bead; 2], chain: &Chain) -> Pair {
        let ends = self.ends_at(chain);
        let stretch = self.stretch(&(ends[0] - ends[1]));
        let length = stretch.norm();
        // One that slips changes where it is turned aside, one that sticks everywhere along the surface.
        let (axis, stiffness) = match self.stiffness * length > self.most {
            true => {
                let aside = self.normal.cross(&stretch) / length;
                (aside, [self.most / length, 0.0])
            }
            false => (self.normal, [0.0, self.stiffness]),
        };
        let point = |end: usize| DiscPoint {
            disc: beads[end].disc,
            local: chain.local(beads[end].disc, &ends[end]),
            position: ends[end],
        };
        Pair {
            points: [point(0), point(1)],
            axis,
            stiffness,
        }
    }

    /// Moves the ends of one between two discs to where these meet, as far stretched as it is.
    pub fn carry(&mut self, pair: &NearPair, chain: &Chain) {
        let stretch = self.stretch(&self.way(chain));
        if let Ends::Discs { points, .. } = &mut self.ends {
            let (meeting, [disc, other]) = (pair.meeting(), pair.discs());
            *points = [
                chain.local(disc, &meeting),
                chain.local(other, &(meeting - stretch)),
            ];
        }
    }

    /// Where it slipped it sticks from now on.
    pub fn stick(&mut self, chain: &Chain) {
        let way = self.way(chain);
        let stretch = self.stretch(&way);
        let slack = match self.slips(&way) {
            true => stretch * (self.most / self.stiffness / stretch.norm()),
            false => stretch,
        };
        let [position, _] = self.ends_at(chain);
        match &mut self.ends {
            Ends::Obstacle { anchor, .. } => *anchor = position - slack,
            Ends::Discs { beads, points } => {
                points[1] = chain.local(beads[1].disc, &(position - slack));
            }
        }
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
            let way = Vector3::new(0.3, -1.0, 0.4) * way;
            let (force, stiffness) = bristle.response(&way);
            for axis in 0..3 {
                let step = Vector3::ith(axis, 1e-8);
                let slope = (bristle.energy(&(way - step)) - bristle.energy(&(way + step))) / 2e-8;
                let change = bristle.response(&(way - step)).0 - bristle.response(&(way + step)).0;
                assert!((slope - force[axis]).abs() < 1e-6, "{slope} {force}");
                assert!((change / 2e-8 - stiffness.column(axis)).norm() < 1e-3);
            }
            assert!(force.norm() <= 0.5 + 1e-12);
            assert_eq!(bristle.slips(&way), (force.norm() - 0.5).abs() < 1e-12);
        }
    }
}

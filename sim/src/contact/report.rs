//! What a solve among obstacles found.

use super::equations::Equations;
use super::friction::Bristle;
use super::law::{Law, Response};
use super::surfaces::Surfaces;
use super::{Activity, Contact, ContactEquilibrium, Partner, Sliding};
use crate::chain::Chain;
use crate::statics::{Examined, Stability};

/// Distance of two surfaces (m) from which on they do not count as touching, for each metre of the robot.
const TOUCHING: f64 = 3e-6;
/// How many times its surfaces' distance a contact is pressed in that is sure to bear force: derivatives then differ from those of
/// exact contact by this share at most.
const STRICT: f64 = 1e3;

/// Writes where the equations stand, after so many steps, to `result`; not converged without a stability.
pub(super) fn report(
    equations: &mut Equations,
    stability: Option<Stability>,
    iterations: usize,
    result: &mut ContactEquilibrium,
) {
    // The last step of a solve that failed was taken back.
    equations.press();
    let out = &mut result.equilibrium;
    out.take_over(&equations.iterate.configuration, &equations.iterate.posture);
    (out.tendon_tensions).copy_from_slice(&equations.expansion.tensions);
    out.residual = equations.expansion.residual();
    out.iterations = iterations;
    out.stability = stability.filter(|_| out.is_finite());
    out.examined = out.stability.map(|_| Examined::Energy);
    out.converged = matches!(out.stability, Some(Stability::Stable | Stability::Neutral));
    result.barrier = equations.hardness.barrier;
    report_contacts(equations, result);
}

/// Writes the contacts at the iterate, and how well they are solved.
pub(super) fn report_contacts(equations: &Equations, out: &mut ContactEquilibrium) {
    let touching = TOUCHING * equations.robot.reach();
    out.contacts.clear();
    (out.complementarity, out.penetration) = (0.0, 0.0);
    let chain = &equations.iterate.posture.chain;
    let rubbing = faces_of_bristles(equations);
    for (index, near) in equations.neighbourhood.near.iter().enumerate() {
        let law = equations.law(near);
        let response = law.at(near.gap);
        let centre = chain.centres[near.bead.disc] + near.arm;
        let normal = near.normal.try_normalize(0.0).unwrap_or(near.normal);
        let contact = Contact {
            disc: near.bead.disc,
            partner: Partner::Obstacle(near.obstacle),
            point: centre - normal * (near.gap + near.bead.radius),
            normal,
            gap: near.gap,
            force: near.normal * response.force,
            activity: Activity::Weak,
            sliding: Sliding::Free,
        };
        let bristle = rubbing.iter().find(|(_, face)| *face == index);
        let contact = match bristle {
            Some((bristle, _)) => contact.rubbed(bristle, chain),
            None => contact,
        };
        out.add(contact, &law, &response, touching);
    }
    let law = equations.own_law();
    for near in equations.near_pairs() {
        let response = law.at(near.gap);
        let [bead, other] = near.beads;
        let contact = Contact {
            disc: bead.disc,
            partner: Partner::Disc(other.disc),
            point: near.centres[1] + near.normal * other.radius,
            normal: near.normal,
            gap: near.gap,
            force: near.normal * response.force,
            activity: Activity::Weak,
            sliding: Sliding::Free,
        };
        let surfaces = Surfaces::Discs(near.beads);
        let mut bristles = equations.bristles.iter();
        let contact = match bristles.find(|bristle| bristle.is_of(&surfaces)) {
            // Where friction acts.
            Some(bristle) => Contact {
                point: near.meeting(),
                ..contact.rubbed(bristle, chain)
            },
            None => contact,
        };
        out.add(contact, &law, &response, touching);
    }
}

/// Each bristle on an obstacle, with the one of the faces near its bead, by their numbers, that bears most: its force is reported there.
fn faces_of_bristles(equations: &Equations) -> Vec<(&Bristle, usize)> {
    let near = &equations.neighbourhood.near;
    let force = |face: usize| equations.law(&near[face]).at(near[face].gap).force;
    let of_bristle = |bristle: &Bristle| {
        let own = |face: &usize| bristle.is_of(&near[*face].surfaces());
        let faces = (0..near.len()).filter(own);
        faces.max_by(|a, b| force(*a).total_cmp(&force(*b)))
    };
    let bristles = equations.bristles.iter();
    bristles
        .filter_map(|bristle| Some((bristle, of_bristle(bristle)?)))
        .collect()
}

impl Contact {
    /// With the force of its bristle.
    fn rubbed(self, bristle: &Bristle, chain: &Chain) -> Self {
        let way = bristle.way(chain);
        Self {
            force: self.force + bristle.response(&way).0,
            sliding: match bristle.slips(&way) {
                true => Sliding::Slips,
                false => Sliding::Sticks,
            },
            ..self
        }
    }
}

impl ContactEquilibrium {
    /// Takes a contact into account, and into the list if its surfaces are within `touching` (m) of each other.
    fn add(&mut self, contact: Contact, law: &Law, response: &Response, touching: f64) {
        let pressed_in = law.compliance * response.force;
        let apart = match law.barrier {
            0.0 => contact.gap.max(0.0),
            barrier => barrier / response.force,
        };
        let product = response.force * (contact.gap + pressed_in);
        self.complementarity = self.complementarity.max(product.abs());
        self.penetration = self.penetration.max(-contact.gap);
        // Smooth contacts count from where their undeformed surfaces meet.
        let met = (law.compliance * law.barrier).sqrt();
        if apart > touching.max(met * (1.0 + 1e-9)) {
            return;
        }
        let activity = match pressed_in > STRICT * apart {
            true => Activity::Strict,
            false => Activity::Weak,
        };
        self.contacts.push(Contact {
            activity,
            ..contact
        });
    }
}

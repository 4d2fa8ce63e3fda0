//! Friction of the contacts of a robot along a path of equilibria.

use nalgebra::Vector3;

use super::active::Active;
use super::equations::Equations;
use super::friction::Bristle;
use super::surfaces::Surfaces;

/// Contacts between discs have friction where they bear more than the barrier alone presses them with before they touch: the square of their
/// force is at least this share of what it is where their undeformed surfaces meet.
const RUBBING: f64 = 1e-8;

/// What a path carries on from an equilibrium: what resists sliding from there, and what bears and slips.
#[derive(Clone, Debug, Default)]
pub(super) struct Grip {
    pub bristles: Vec<Bristle>,
    pub active: Active,
}

impl Grip {
    /// That of where the equations stand, whose contacts were pressed there. What slipped sticks from now on.
    pub fn at(equations: &mut Equations) -> Self {
        let active = Active::lawful(equations);
        equations.stick_bristles();
        Self {
            bristles: equations.bristles.clone(),
            active,
        }
    }
}

impl Equations {
    /// Whether there is friction.
    pub fn rubs(&self) -> bool {
        let mut obstacles = self.scene.obstacles().iter();
        self.rubs_itself() || obstacles.any(|obstacle| obstacle.friction > 0.0)
    }

    /// Whether there is friction between discs.
    pub fn rubs_itself(&self) -> bool {
        self.scene.self_contact().friction() > 0.0
    }

    /// The contacts at the iterate, and their forces on the way from where these bristles stuck.
    pub fn press_from(&mut self, bristles: &[Bristle]) {
        if !self.is_found {
            self.find();
        }
        self.bristles.clear();
        self.bristles.extend_from_slice(bristles);
        self.press_bristles();
        self.press();
    }

    /// Takes over what the contacts press at the iterate: bristles bear as much as that lets them, and beads that have come to touch get
    /// one where they are.
    pub fn press_bristles(&mut self) {
        let mut pressed = self.bristles_on_obstacles();
        if self.rubs_itself() {
            self.add_bristles_between(&mut pressed);
        }
        self.bristles = pressed;
    }

    fn bristles_on_obstacles(&self) -> Vec<Bristle> {
        let chain = &self.iterate.posture.chain;
        let mut pressed: Vec<(Bristle, Vector3<f64>)> = Vec::new();
        for near in &self.neighbourhood.near {
            let obstacle = &self.scene.obstacles()[near.obstacle];
            if obstacle.friction == 0.0 {
                continue;
            }
            let force = near.normal * self.law(near).at(near.gap).force;
            let surfaces = near.surfaces();
            // A bead in a corner of a mesh touches several faces.
            let own = pressed.iter_mut();
            if let Some((_, sum)) = own.into_iter().find(|(own, _)| own.is_of(&surfaces)) {
                *sum += force;
                continue;
            }
            let position = chain.centres[near.bead.disc] + near.arm;
            let new = || Bristle::new(near.bead, near.obstacle, obstacle.compliance, &position);
            pressed.push((self.bristle_of(&surfaces).unwrap_or_else(new), force));
        }
        let bound = |(bristle, force): (Bristle, Vector3<f64>)| self.bounded(bristle, &force);
        pressed.into_iter().filter_map(bound).collect()
    }

    /// Adds those between discs, carried to where these meet.
    fn add_bristles_between(&self, out: &mut Vec<Bristle>) {
        let chain = &self.iterate.posture.chain;
        let law = self.own_law();
        let least = RUBBING * law.barrier / law.compliance;
        for pair in self.near_pairs() {
            let force = law.at(pair.gap).force;
            if force * force <= least {
                continue;
            }
            let new = || Bristle::between(pair, chain, law.compliance);
            let surfaces = Surfaces::Discs(pair.beads);
            let known = self.bristle_of(&surfaces).unwrap_or_else(new);
            if let Some(mut bristle) = self.bounded(known, &(pair.normal * force)) {
                bristle.carry(pair, chain);
                out.push(bristle);
            }
        }
    }

    /// The bristle between two surfaces.
    fn bristle_of(&self, surfaces: &Surfaces) -> Option<Bristle> {
        let mut bristles = self.bristles.iter();
        bristles.find(|bristle| bristle.is_of(surfaces)).copied()
    }

    /// A bristle that bears what a force across its surfaces (N) lets it; none without one.
    fn bounded(&self, mut bristle: Bristle, force: &Vector3<f64>) -> Option<Bristle> {
        let normal = force.try_normalize(0.0)?;
        let friction = bristle.surfaces().friction(&self.scene);
        bristle.press(normal, friction * force.norm());
        Some(bristle)
    }

    /// Lets what slipped stick where it is.
    pub fn stick_bristles(&mut self) {
        let chain = &self.iterate.posture.chain;
        for bristle in &mut self.bristles {
            bristle.stick(chain);
        }
    }
}

//! Friction of the contacts of a robot along a path of equilibria.

use nalgebra::Vector3;

use super::ContactError;
use super::active::Active;
use super::equations::Equations;
use super::friction::Bristle;
use crate::scene::Scene;

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
        self.scene
            .obstacles()
            .iter()
            .any(|obstacle| obstacle.friction > 0.0)
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
        let chain = &self.iterate.posture.chain;
        let mut pressed: Vec<(Bristle, Vector3<f64>)> = Vec::new();
        for near in &self.neighbourhood.near {
            let obstacle = &self.scene.obstacles()[near.obstacle];
            if obstacle.friction == 0.0 {
                continue;
            }
            let force = near.normal * self.law(near).at(near.gap).force;
            let of_near = |other: &Bristle| other.is_of(&near.bead, near.obstacle);
            // A bead in a corner of a mesh touches several faces.
            if let Some((_, sum)) = pressed.iter_mut().find(|(bristle, _)| of_near(bristle)) {
                *sum += force;
                continue;
            }
            let known = self
                .bristles
                .iter()
                .find(|bristle| of_near(bristle))
                .copied();
            let position = chain.centres[near.bead.disc] + near.arm;
            let new = || Bristle::new(near.bead, near.obstacle, obstacle.compliance, &position);
            pressed.push((known.unwrap_or_else(new), force));
        }
        self.bristles.clear();
        for (mut bristle, force) in pressed {
            let Some(normal) = force.try_normalize(0.0) else {
                continue;
            };
            let friction = self.scene.obstacles()[bristle.obstacle].friction;
            bristle.press(normal, friction * force.norm());
            self.bristles.push(bristle);
        }
    }

    /// Lets what slipped stick where it is.
    pub fn stick_bristles(&mut self) {
        let chain = &self.iterate.posture.chain;
        for bristle in &mut self.bristles {
            let position = bristle.position(chain);
            bristle.stick(&position);
        }
    }
}

/// Refuses friction between discs, which paths do not have.
pub(crate) fn check_own_friction(scene: &Scene) -> Result<(), ContactError> {
    match scene.self_contact().friction() {
        0.0 => Ok(()),
        friction => Err(ContactError::SelfFriction { friction }),
    }
}

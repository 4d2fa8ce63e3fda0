//! Contacts by an active set: which bear, which of those that rub slip, and with what forces.
//!
//! A contact of gap `g` and compliance `C` that bears has the force `f` with `g + C f = 0`, an unknown beside the robot's configuration
//! (a multiplier). Newton's method on both has the matrix of one on the force `-g / C`, but the geometry turns by `f`: where a step has
//! gone deep `-g / C` is far from any force, and its moments would bend the robot's equations. So it is with bristles that stick. What
//! bore bears on while its multiplier pushes, what did not begins to where surfaces overlap (a primal-dual active set method:
//! Hintermueller, Ito and Kunisch, SIAM J. Optim. 13, 2002).

mod rub;
mod touch;

use nalgebra::Vector3;

use super::equations::Equations;
use super::friction::Bristle;
use super::surfaces::Surfaces;
use crate::energy::Pressing;
use crate::pose::motions;
use crate::robot::Robot;
use rub::{Rubbed, Way};
use touch::{Between, End, Face, Place, Touch, touches};

/// What bears and what slips, and with what forces.
#[derive(Clone, Debug, Default)]
pub(super) struct Active {
    /// The contacts that bear, with their normal forces (N).
    bearing: Vec<(Place, f64)>,
    /// Of each bristle, whether it slips, and its force (N).
    rubbing: Vec<(bool, Vector3<f64>)>,
}

impl Active {
    /// That of a configuration in which the forces follow the law, the bristles being those of `equations`.
    pub fn lawful(equations: &Equations) -> Self {
        let chain = &equations.iterate.posture.chain;
        let bearing = touches(equations).filter(|touch| touch.gap < 0.0);
        let rubbing = equations.bristles.iter().map(|bristle| {
            let way = bristle.way(chain);
            (bristle.slips(&way), bristle.response(&way).0)
        });
        Self {
            bearing: bearing.map(|touch| (touch.place, touch.force())).collect(),
            rubbing: rubbing.collect(),
        }
    }

    /// The normal force of a contact, if it bears (N).
    fn force(&self, place: &Place) -> Option<f64> {
        let found = self.bearing.iter().find(|(own, _)| own == place);
        found.map(|(_, force)| *force)
    }

    /// The normal forces (N) of the contacts of two surfaces.
    fn force_on(&self, surfaces: &Surfaces) -> f64 {
        let own = self.bearing.iter();
        let own = own.filter(|(place, _)| place.surfaces == *surfaces);
        own.map(|(_, force)| *force).sum()
    }
}

/// What is assumed of contacts in a Newton step, and what it leads to.
#[derive(Clone, Debug)]
pub(super) struct ActiveStep {
    assumed: Active,
    /// The forces that the whole step leads to, to first order.
    predicted: Active,
    /// What the configuration asks for in which contacts were pressed last.
    asked: Active,
    /// With the forces of the multipliers there.
    pub pressing: Pressing,
    /// What the forces have besides (N), and where the step began: disc, point (m), force.
    besides: Vec<(usize, Vector3<f64>, Vector3<f64>)>,
    /// Of each bristle that bears what it does.
    rubbed: Vec<Option<Rubbed>>,
    base: Base,
}

/// Where a step began.
#[derive(Clone, Debug, Default)]
struct Base {
    /// The joints' centres (m).
    centres: Vec<Vector3<f64>>,
    contacts: Vec<(Place, Vector3<f64>, Vec<End>)>,
    /// Of each bristle that bears, where its forces point.
    ways: Vec<Option<Way>>,
}

impl ActiveStep {
    pub fn new(robot: &Robot) -> Self {
        Self {
            assumed: Active::default(),
            predicted: Active::default(),
            asked: Active::default(),
            pressing: Pressing::none(robot.discs().len()),
            besides: Vec::new(),
            rubbed: Vec::new(),
            base: Base::default(),
        }
    }

    /// Assumes what bears where the equations stand, by the law.
    pub fn assume_lawful(&mut self, equations: &Equations) {
        self.assumed = Active::lawful(equations);
    }

    /// Assumes what holds at an equilibrium.
    pub fn assume(&mut self, active: &Active) {
        self.assumed.clone_from(active);
    }

    /// Begins a step where the equations stand, and presses the contacts there.
    pub fn begin(&mut self, equations: &Equations, bristles: &[Bristle]) {
        let chain = &equations.iterate.posture.chain;
        self.base = Base {
            centres: chain.centres.clone(),
            contacts: touches(equations)
                .filter(|touch| self.assumed.force(&touch.place).is_some())
                .map(|touch| (touch.place, touch.normal, touch.ends().collect()))
                .collect(),
            ways: Vec::with_capacity(bristles.len()),
        };
        self.predicted.clone_from(&self.assumed);
        self.press(equations, bristles, 0.0);
    }

    /// Presses the contacts where the equations stand after a share of the step.
    pub fn press(&mut self, equations: &Equations, bristles: &[Bristle], share: f64) {
        self.pressing.clear();
        self.besides.clear();
        self.asked.bearing.clear();
        let mut faces: Vec<(Surfaces, Face)> = Vec::new();
        for touch in touches(equations) {
            if touch.gap < 0.0 {
                self.asked.bearing.push((touch.place, touch.force()));
            }
            let Some(known) = self.known(&touch.place, share) else {
                continue;
            };
            self.bear(equations, &touch, known);
            if !bristles.is_empty() {
                faces.push((touch.place.surfaces, Face::new(&touch, known)));
            }
        }
        self.asked.rubbing.clear();
        self.rubbed.clear();
        for (index, bristle) in bristles.iter().enumerate() {
            let own = faces.iter().filter(|(of, _)| bristle.is_of(of));
            let face = own.map(|(_, face)| *face).reduce(Face::and);
            self.rub(equations, (index, bristle), face, share);
        }
    }

    /// The multiplier of a contact after a share of the step (N), if it is assumed to bear.
    fn known(&self, place: &Place, share: f64) -> Option<f64> {
        let from = self.assumed.force(place)?;
        let to = self.predicted.force(place).unwrap_or(from);
        Some(from + share * (to - from))
    }

    /// Presses a contact that bears with the force `known` (N).
    fn bear(&mut self, equations: &Equations, touch: &Touch, known: f64) {
        let response = touch.bearing(known);
        let force = touch.normal * known;
        match touch.between {
            Between::Obstacle(near) => self.pressing.push(
                &equations.iterate.posture,
                (near.bead.disc, near.bead.centre),
                force,
                &near.stiffness(&response),
            ),
            Between::Discs(pair) => self.pressing.push_pair(pair.pressed(&response), force),
        }
        let base = self.base.contacts.iter();
        if let Some((_, normal, ends)) = base.into_iter().find(|(place, ..)| *place == touch.place)
        {
            let besides = normal * (touch.force() - known);
            for end in ends {
                self.besides
                    .push((end.disc, end.position, besides * end.sign));
            }
        }
    }

    /// Adds the moments (N m) about the joints that forces have besides those of the multipliers.
    pub fn add_besides(&self, moments: &mut [Vector3<f64>]) {
        for (disc, point, force) in &self.besides {
            for (moment, centre) in moments.iter_mut().zip(&self.base.centres).take(disc + 1) {
                *moment += (point - centre).cross(force);
            }
        }
    }

    /// The forces that a step (rad) leads to, from where contacts were pressed last.
    pub fn predict(&mut self, equations: &Equations, step: &[Vector3<f64>]) {
        let centres = &self.base.centres;
        let motions = motions(centres, step);
        let motion = |disc: usize, position: &Vector3<f64>| {
            let (turn, shift) = motions[disc];
            (turn, shift + turn.cross(&(position - centres[disc])))
        };
        self.predicted.bearing.clear();
        for touch in touches(equations) {
            if self.assumed.force(&touch.place).is_none() {
                continue;
            }
            let ways = touch.ends();
            let ways = ways.map(|end| motion(end.disc, &end.position).1 * end.sign);
            let gap = touch.gap + touch.normal.dot(&ways.sum::<Vector3<f64>>());
            let force = -gap / touch.compliance;
            self.predicted.bearing.push((touch.place, force));
        }
        let rubbed = self.base.ways.iter().zip(&self.rubbed);
        let led_to = rubbed.map(|(way, rubbed)| {
            let pressed = way.as_ref().zip(rubbed.as_ref());
            pressed.map_or(Vector3::zeros(), |(way, rubbed)| way.led_to(rubbed, motion))
        });
        self.predicted.rubbing = led_to.map(|force| (false, force)).collect();
    }

    /// The contacts that begin to bear: of each disc and obstacle, and of each two discs, the deepest. Others may be out where that one is.
    fn beginning(&self) -> Vec<(Place, f64)> {
        let mut deepest: Vec<(Place, f64)> = Vec::new();
        for (place, force) in &self.asked.bearing {
            if self.assumed.force(place).is_some() {
                continue;
            }
            match deepest
                .iter_mut()
                .find(|(other, _)| other.surfaces.are_beside(&place.surfaces))
            {
                Some(other) if other.1 < *force => *other = (*place, *force),
                Some(_) => {}
                None => deepest.push((*place, *force)),
            }
        }
        deepest.iter().map(|(place, _)| (*place, 0.0)).collect()
    }

    /// Revises what is assumed after a share of the step, where contacts were pressed last.
    pub fn revise(&mut self, equations: &Equations, bristles: &[Bristle], share: f64) {
        let mut revised = Active::default();
        for (place, _) in &self.assumed.bearing {
            let known = self.known(place, share).filter(|force| *force > 0.0);
            revised.bearing.extend(known.map(|force| (*place, force)));
        }
        revised.bearing.extend(self.beginning());
        let rubbing = self.assumed.rubbing.iter().zip(&self.asked.rubbing);
        for (bristle, ((slips, _), (must_slip, force))) in bristles.iter().zip(rubbing) {
            let surfaces = bristle.surfaces();
            let most = surfaces.friction(&equations.scene) * revised.force_on(&surfaces);
            let slips = match slips {
                true => *must_slip,
                false => force.norm() > most,
            };
            revised.rubbing.push((slips, *force));
        }
        self.assumed = revised;
    }
}

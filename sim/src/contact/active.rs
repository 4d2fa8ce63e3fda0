//! Contacts by an active set: which bear, which of those that rub slip, and with what forces.
//!
//! A contact of gap `g` and compliance `C` that bears has the force `f` with `g + C f = 0`, an unknown beside the robot's configuration
//! (a multiplier). Newton's method on both has the matrix of one on the force `-g / C`, but the geometry turns by `f`: where a step has
//! gone deep `-g / C` is far from any force, and its moments would bend the robot's equations. So it is with bristles that stick. What
//! bore bears on while its multiplier pushes, what did not begins to where surfaces overlap (a primal-dual active set method:
//! Hintermueller, Ito and Kunisch, SIAM J. Optim. 13, 2002).

use nalgebra::{Matrix3, Vector3};

use super::equations::Equations;
use super::friction::Bristle;
use super::law::Response;
use super::near::Near;
use super::near_pairs::NearPair;
use crate::energy::Pressing;
use crate::geometry::Bead;
use crate::pose::motions;
use crate::robot::Robot;

/// Where contacts are.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Place {
    /// Of a bead and an obstacle the first, second, ... face.
    Obstacle {
        bead: Bead,
        obstacle: usize,
        face: usize,
    },
    Discs([Bead; 2]),
}

impl Place {
    /// Whether it is of the same disc and obstacle, or of the same two discs.
    fn is_beside(&self, other: &Self) -> bool {
        match (self, other) {
            (
                Self::Obstacle { bead, obstacle, .. },
                Self::Obstacle {
                    bead: beside,
                    obstacle: of,
                    ..
                },
            ) => bead.disc == beside.disc && obstacle == of,
            (Self::Discs(beads), Self::Discs(beside)) => {
                beads.map(|bead| bead.disc) == beside.map(|bead| bead.disc)
            }
            _ => false,
        }
    }
}

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
            let position = bristle.position(chain);
            (bristle.slips(&position), bristle.response(&position).0)
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

    /// The normal forces (N) of a bead's contacts with an obstacle.
    fn force_on(&self, own: &Bead, by: usize) -> f64 {
        let of_own = |place: &Place| match place {
            Place::Obstacle { bead, obstacle, .. } => bead == own && *obstacle == by,
            Place::Discs(_) => false,
        };
        let own = self.bearing.iter().filter(|(place, _)| of_own(place));
        own.map(|(_, force)| *force).sum()
    }
}

/// One contact.
struct Touch<'a> {
    place: Place,
    gap: f64,
    /// The gap's gradient by the way of the first of the beads from the second, or from the obstacle.
    normal: Vector3<f64>,
    compliance: f64,
    between: Between<'a>,
}

enum Between<'a> {
    Obstacle(&'a Near),
    Discs(&'a NearPair),
}

impl Touch<'_> {
    /// What it bears if it does (N).
    fn force(&self) -> f64 {
        -self.gap / self.compliance
    }

    /// The discs that it pushes along its normal, or against it, and where (m).
    fn ends(&self) -> impl Iterator<Item = End> + use<> {
        let ends = match self.between {
            Between::Obstacle(near) => [Some((near.bead.disc, near.centre)), None],
            Between::Discs(pair) => [0, 1].map(|i| Some((pair.beads[i].disc, pair.centres[i]))),
        };
        ends.into_iter().zip([1.0, -1.0]).filter_map(|(end, sign)| {
            let (disc, position) = end?;
            Some(End {
                disc,
                position,
                sign,
            })
        })
    }
}

/// A point of a disc that a contact pushes.
#[derive(Clone, Copy, Debug)]
struct End {
    disc: usize,
    position: Vector3<f64>,
    sign: f64,
}

/// The contacts that there may be.
fn touches(equations: &Equations) -> impl Iterator<Item = Touch<'_>> {
    let mut before: Option<&Near> = None;
    let mut face = 0;
    let obstacles = equations.neighbourhood.near.iter().map(move |near| {
        let again = before.is_some_and(|other| other.is_of(&near.bead, near.obstacle));
        face = if again { face + 1 } else { 0 };
        before = Some(near);
        Touch {
            place: Place::Obstacle {
                bead: near.bead,
                obstacle: near.obstacle,
                face,
            },
            gap: near.gap,
            normal: near.normal,
            compliance: equations.law(near).compliance,
            between: Between::Obstacle(near),
        }
    });
    let compliance = equations.own_law().compliance;
    let discs = equations.near_pairs().iter().map(move |pair| Touch {
        place: Place::Discs(pair.beads),
        gap: pair.gap,
        normal: pair.normal,
        compliance,
        between: Between::Discs(pair),
    });
    obstacles.chain(discs)
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
    /// Of each bristle its force (N), and what a displacement of its bead diminishes that by (N/m).
    rubbed: Vec<(Vector3<f64>, Matrix3<f64>)>,
    base: Base,
}

/// Where a step began.
#[derive(Clone, Debug, Default)]
struct Base {
    /// The joints' centres (m).
    centres: Vec<Vector3<f64>>,
    contacts: Vec<(Place, Vector3<f64>, Vec<End>)>,
    /// Of each bristle, its bead's centre (m).
    bristles: Vec<Vector3<f64>>,
    /// Of each that bears the normal, and of those that slip which way friction points.
    ways: Vec<Option<Way>>,
}

/// Where a bristle's forces point.
#[derive(Clone, Copy, Debug)]
struct Way {
    /// Out of the surface.
    normal: Vector3<f64>,
    /// Along it, against its sliding.
    friction: Option<Vector3<f64>>,
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
            bristles: bristles.iter().map(|b| b.position(chain)).collect(),
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
        let mut faces = Vec::with_capacity(equations.neighbourhood.near.len());
        for touch in touches(equations) {
            if touch.gap < 0.0 {
                self.asked.bearing.push((touch.place, touch.force()));
            }
            let known = self.known(&touch.place, share);
            if let Some(force) = known {
                self.bear(equations, &touch, force);
            }
            if let Between::Obstacle(near) = touch.between {
                faces.push(known.map(|force| Face::new(near, force, &touch)));
            }
        }
        self.asked.rubbing.clear();
        self.rubbed.clear();
        for (index, bristle) in bristles.iter().enumerate() {
            let near = equations.neighbourhood.near.iter().zip(&faces);
            let own = near.filter(|(near, _)| near.is_of(&bristle.bead, bristle.obstacle));
            let face = own.filter_map(|(_, face)| *face).reduce(Face::and);
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
        let response = Response {
            force: known,
            ..Response::bearing(touch.gap, touch.compliance)
        };
        match touch.between {
            Between::Obstacle(near) => self.pressing.push(
                &equations.iterate.posture,
                (near.bead.disc, near.bead.centre),
                near.normal * known,
                &near.stiffness(&response),
            ),
            Between::Discs(pair) => self.pressing.push_pair(pair.pressed(&response), known),
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

    /// Presses a bristle, with what its bead's faces bear.
    fn rub(
        &mut self,
        equations: &Equations,
        (index, bristle): (usize, &Bristle),
        face: Option<Face>,
        share: f64,
    ) {
        let (slips, from) = self.assumed.rubbing[index];
        let to = self.predicted.rubbing[index].1;
        let known = from + (to - from) * share;
        let is_base = self.base.ways.len() == index;
        let Some(face) = face else {
            self.asked.rubbing.push((true, Vector3::zeros()));
            self.rubbed.push((Vector3::zeros(), Matrix3::zeros()));
            if is_base {
                self.base.ways.push(None);
            }
            return;
        };
        let posture = &equations.iterate.posture;
        let friction = equations.scene.obstacles()[bristle.obstacle].friction;
        let position = bristle.position(&posture.chain);
        // Out of the surface, also where a step would have it pull.
        let normal = face.force.try_normalize(0.0).unwrap_or(face.normal);
        let normal = normal * normal.dot(&face.normal).signum();
        let most = friction * face.force.dot(&normal);
        let mut own = *bristle;
        own.press(normal, most);
        let gone = (-own.stretch(&position))
            .try_normalize(0.0)
            .filter(|_| slips);
        if is_base {
            self.base.ways.push(Some(Way {
                normal,
                friction: gone,
            }));
        }
        // What forces are besides may be far from any: it takes the directions of the base.
        let base = self.base.ways[index].unwrap_or(Way {
            normal,
            friction: gone,
        });
        let (force, besides, mut change) = match gone {
            Some(way) => {
                let borne = friction * face.besides.dot(&normal);
                // Friction is bounded by what is borne.
                let bounded = way * (face.stiffness * normal).transpose() * friction;
                let across = own.response_if(true, &position).1;
                (
                    way * most,
                    base.friction.unwrap_or(way) * borne,
                    across + bounded,
                )
            }
            None => {
                own.press(base.normal, most);
                let (rubbing, stiffness) = own.response_if(false, &position);
                (known, rubbing - known, stiffness)
            }
        };
        own.press(normal, most);
        // The normal turns as the bead moves along the surface.
        change += normal * (face.curvature * force).transpose();
        let point = (bristle.bead.disc, bristle.bead.centre);
        self.pressing.push(posture, point, force, &change);
        let at = self.base.bristles[index];
        self.besides.push((bristle.bead.disc, at, besides));
        self.asked.rubbing.push((own.slips(&position), force));
        self.rubbed.push((force + besides, change));
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
    pub fn predict(&mut self, equations: &Equations, bristles: &[Bristle], step: &[Vector3<f64>]) {
        let centres = &self.base.centres;
        let motions = motions(centres, step);
        let way = |disc: usize, position: &Vector3<f64>| {
            let (turn, shift) = &motions[disc];
            shift + turn.cross(&(position - centres[disc]))
        };
        self.predicted.bearing.clear();
        for touch in touches(equations) {
            if self.assumed.force(&touch.place).is_none() {
                continue;
            }
            let ways = touch.ends();
            let ways = ways.map(|end| way(end.disc, &end.position) * end.sign);
            let gap = touch.gap + touch.normal.dot(&ways.sum::<Vector3<f64>>());
            let force = -gap / touch.compliance;
            self.predicted.bearing.push((touch.place, force));
        }
        let rubbed = bristles.iter().zip(&self.base.bristles).zip(&self.rubbed);
        let moved = rubbed.map(|((bristle, at), (force, change))| {
            (false, force - change * way(bristle.bead.disc, at))
        });
        self.predicted.rubbing = moved.collect();
    }

    /// The contacts that begin to bear: of each disc and obstacle, and of each two discs, the deepest. Others may be out where that one is.
    fn beginning(&self) -> Vec<(Place, f64)> {
        let mut deepest: Vec<(Place, f64)> = Vec::new();
        for (place, force) in &self.asked.bearing {
            if self.assumed.force(place).is_some() {
                continue;
            }
            match deepest.iter_mut().find(|(other, _)| other.is_beside(place)) {
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
            let most = equations.scene.obstacles()[bristle.obstacle].friction
                * revised.force_on(&bristle.bead, bristle.obstacle);
            let slips = match slips {
                true => *must_slip,
                false => force.norm() > most,
            };
            revised.rubbing.push((slips, *force));
        }
        self.assumed = revised;
    }
}

/// What a bead's contacts with an obstacle bear.
#[derive(Clone, Copy)]
struct Face {
    /// Of the first of them.
    normal: Vector3<f64>,
    /// By the multipliers (N).
    force: Vector3<f64>,
    /// What the force has besides (N).
    besides: Vector3<f64>,
    /// What a displacement of the bead diminishes the force by (N/m).
    stiffness: Matrix3<f64>,
    /// Second derivative of the gap (1/m).
    curvature: Matrix3<f64>,
}

impl Face {
    fn new(near: &Near, known: f64, touch: &Touch) -> Self {
        let response = Response {
            force: known,
            ..Response::bearing(touch.gap, touch.compliance)
        };
        Self {
            normal: near.normal,
            force: near.normal * known,
            besides: near.normal * (touch.force() - known),
            stiffness: near.stiffness(&response),
            curvature: near.curvature,
        }
    }

    fn and(self, other: Self) -> Self {
        Self {
            force: self.force + other.force,
            besides: self.besides + other.besides,
            stiffness: self.stiffness + other.stiffness,
            ..self
        }
    }
}

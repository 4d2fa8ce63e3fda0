//! The search for a command.

use nalgebra::DVector;

use super::apart::{Apart, Kept};
use super::gap::nearest_bead;
use super::{
    ActiveBound, Bound, ContactGoals, Outcome, Press, Sample, Search, ShapeControlError,
    ShapeController, ShapeSolution, Target,
};
use crate::chain::Configuration;
use crate::contact::{ContactEquilibrium, ContactSettler, Partner, normal_force};
use crate::geometry::Beads;
use crate::inverse::least_squares::{Evaluation, Limit, minimise};
use crate::robot::{Command, Loads, Robot};
use crate::scene::Scene;
use crate::statics::Equilibrium;

/// Times that a descent goes on from the equilibrium that the straight pose leads to, where that is
/// another one than the descent's.
const MAX_RETURNS: usize = 4;
/// Rounds of the multipliers of a clearance at most.
const MAX_ROUNDS: usize = 20;

/// The search for one list of targets. Its unknowns are the commands as shares of their ranges.
pub(super) struct Problem<'a> {
    pub robot: &'a Robot,
    pub loads: &'a Loads,
    pub search: &'a Search,
    pub targets: &'a [Target],
    pub presses: &'a [Press],
    /// All obstacles.
    pub scene: &'a Scene,
    /// Those that the robot settles among while it is sought, and their numbers in the whole scene.
    pub touched: Scene,
    pub numbers: Vec<usize>,
    /// Those that it keeps clear of.
    pub apart: Option<Apart>,
    pub beads: Beads,
}

/// A command, as shares of the tendons' ranges, and the equilibrium under it.
#[derive(Clone, Debug)]
pub(super) struct Place {
    pub x: DVector<f64>,
    pub settled: Equilibrium,
}

/// How good a solution is, smaller is better: by how much it is too near to an obstacle (m), then the sum of the squared errors (m²).
#[derive(Clone, Copy, PartialEq, PartialOrd)]
struct Score(f64, f64);

impl<'a> Problem<'a> {
    /// Of a controller and what is asked of it, which has been checked.
    pub fn new(
        controller: &'a ShapeController,
        targets: &'a [Target],
        contact: &'a ContactGoals,
    ) -> Self {
        let ShapeController { robot, scene, .. } = controller;
        let [numbers, apart] = contact.divide(scene);
        let clearance = contact.clearance.filter(|_| !apart.is_empty());
        Self {
            robot,
            loads: &controller.loads,
            search: &controller.search,
            targets,
            presses: &contact.presses,
            scene,
            touched: match clearance {
                None => scene.clone(),
                Some(_) => scene.part(&numbers),
            },
            numbers,
            apart: clearance.map(|clearance| Apart::new(robot, scene, apart, clearance)),
            beads: Beads::new(robot),
        }
    }

    /// The samples that come nearest to what is asked for.
    pub fn starts<'s>(&self, samples: &'s [Sample]) -> Vec<&'s Sample> {
        let mut order: Vec<(f64, &Sample)> = (samples.iter())
            .map(|sample| (self.cost_of(sample), sample))
            .collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        order.truncate(self.search.starts.max(1));
        order.into_iter().map(|(_, sample)| sample).collect()
    }

    /// Sum of the weighted squared errors of a sample, and of what it is too near by.
    fn cost_of(&self, sample: &Sample) -> f64 {
        let settled = &sample.equilibrium;
        let missed = |target: &Target| target.weight * target.error(settled).norm_squared();
        let pressed = |press: &Press| {
            let force = normal_force(&sample.contacts, press.obstacle, press.disc);
            press.weight * press.error(force, self.gap_to(press, settled)).powi(2)
        };
        let nearest = self.apart.as_ref().and_then(|apart| apart.nearest(settled));
        let (clearance, gap) = match (&self.apart, nearest) {
            (Some(apart), Some(nearest)) => (apart.clearance, nearest.gap),
            _ => (0.0, 0.0),
        };
        self.targets.iter().map(missed).sum::<f64>()
            + self.presses.iter().map(pressed).sum::<f64>()
            + (clearance - gap).max(0.0).powi(2)
    }

    /// How far what presses is from its obstacle (m).
    fn gap_to(&self, press: &Press, settled: &Equilibrium) -> f64 {
        let ends = (press.obstacle, press.disc);
        nearest_bead(&self.beads, self.scene, settled, ends).map_or(0.0, |(_, gap)| gap)
    }

    pub fn best_of<'s>(
        &self,
        starts: impl Iterator<Item = &'s Sample>,
    ) -> Result<ShapeSolution, ShapeControlError> {
        let mut settler = self.settler();
        let mut best: Option<(Score, ShapeSolution)> = None;
        let (mut steps, mut tried) = (0, 0);
        for start in starts {
            tried += 1;
            let Some((score, mut found)) = self.descend(&mut settler, start) else {
                continue;
            };
            steps += found.steps;
            found.steps = steps;
            if found.outcome == Outcome::Reached {
                return Ok(found);
            }
            if best.as_ref().is_none_or(|(least, _)| score < *least) {
                best = Some((score, found));
            }
        }
        let (_, mut found) = best.ok_or(ShapeControlError::Unsettled(tried))?;
        found.steps = steps;
        Ok(found)
    }

    /// What a descent from each start leads to.
    pub fn all_of<'s>(&self, starts: impl Iterator<Item = &'s Sample>) -> Vec<ShapeSolution> {
        let mut settler = self.settler();
        let found = starts.filter_map(|start| self.descend(&mut settler, start));
        found.map(|(_, found)| found).collect()
    }

    fn settler(&self) -> ContactSettler {
        ContactSettler::new(self.robot, &self.touched)
    }

    /// Descends from one command; also returns how good the place is.
    fn descend(
        &self,
        settler: &mut ContactSettler,
        start: &Sample,
    ) -> Option<(Score, ShapeSolution)> {
        let mut x = shares(self.robot, &start.command);
        let mut kept = Kept::default();
        if let Some(apart) = &self.apart {
            apart.join(&mut kept, &start.equilibrium);
        }
        let mut at = self.evaluate_from(settler, &x, &start.equilibrium, &kept)?;
        let mut steps = 0;
        for _ in 0..MAX_RETURNS {
            let (there, tried) = self.descend_kept(settler, (x, at), &mut kept)?;
            steps += tried;
            x = there.x;
            let settled = settler.settle(&self.command(&x), self.loads).ok()?;
            let settled = settled.equilibrium.clone();
            at = self.evaluate(settler, &x, settled, &kept)?;
            if self.same_place(&there.settled.configuration, &at.memory) {
                break;
            }
        }
        let asked = 3 * self.targets.len() + self.presses.len();
        let cost = at.residuals.rows(0, asked).norm_squared();
        let Some(apart) = &self.apart else {
            let among = (!self.scene.is_empty()).then(|| settler.found().clone());
            return Some((Score(0.0, cost), self.solution(&x, &at, among, steps)));
        };
        self.among_all(apart, &kept, (&x, at, cost), steps)
    }

    /// Descends in rounds until the clearance is kept, without one in a single round; also returns the steps tried.
    fn descend_kept(
        &self,
        settler: &mut ContactSettler,
        (mut x, mut at): (DVector<f64>, Evaluation<Equilibrium>),
        kept: &mut Kept,
    ) -> Option<(Place, usize)> {
        let limits = vec![Limit::SHARE; self.robot.tendons().len()];
        // Aimed at a tenth, so that another way to the same equilibrium is near enough too.
        let enough = 0.1 * self.search.tolerance;
        let mut steps = 0;
        for _ in 0..MAX_ROUNDS {
            let evaluate = |x: &DVector<f64>, near: &Equilibrium| {
                let (command, near) = (self.command(x), &near.configuration);
                let settled = settler.settle_from(near, &command, self.loads).ok()?;
                let settled = settled.equilibrium.clone();
                self.evaluate(settler, x, settled, kept)
            };
            let done = |x: &DVector<f64>, at: &Evaluation<Equilibrium>| {
                self.is_met(at, kept, enough) || gap(x, at) <= enough
            };
            let found = minimise(x, at, &limits, self.search.max_steps, evaluate, done);
            steps += found.steps;
            (x, at) = (found.x, found.at);
            let settled = |apart: &Apart| apart.is_settled(kept, &at.memory);
            if self.apart.as_ref().is_none_or(settled) {
                break;
            }
            at = self.evaluate_from(settler, &x, &at.memory, kept)?;
        }
        let settled = at.memory;
        Some((Place { x, settled }, steps))
    }

    /// The solution among all obstacles, from the straight pose, of a place where the robot keeps clear of some.
    fn among_all(
        &self,
        apart: &Apart,
        kept: &Kept,
        (x, mut at, cost): (&DVector<f64>, Evaluation<Equilibrium>, f64),
        steps: usize,
    ) -> Option<(Score, ShapeSolution)> {
        let mut settler = ContactSettler::new(self.robot, self.scene);
        let among = settler.settle(&self.command(x), self.loads).ok()?.clone();
        if !among.equilibrium.converged {
            return None;
        }
        let is_there = self.same_place(&at.memory.configuration, &among.equilibrium);
        at.memory.clone_from(&among.equilibrium);
        let nearest = apart.nearest(&at.memory)?;
        let partners = among.contacts.iter().map(|contact| contact.partner);
        let touches = (partners.filter_map(Partner::obstacle)).any(|obstacle| apart.has(obstacle));
        let mut found = self.solution(x, &at, Some(among), steps);
        found.nearest = Some(nearest);
        if touches || nearest.gap < apart.clearance {
            found.outcome = Outcome::TooNear { nearest };
            let by = (apart.clearance - nearest.gap).max(f64::MIN_POSITIVE);
            return Some((Score(by, cost), found));
        }
        match &mut found.outcome {
            Outcome::Unreachable { gap, .. } if !is_there => {
                found.outcome = Outcome::Stalled { gap: *gap };
            }
            Outcome::Unreachable { obstacles, .. } => {
                *obstacles = apart.obstructions(kept, &at.memory, cost.sqrt());
            }
            _ => {}
        }
        let cost = if is_there { cost } else { f64::INFINITY };
        Some((Score(0.0, cost), found))
    }

    /// As [`evaluate`](Self::evaluate), where `settler` has yet to settle to the equilibrium.
    pub fn evaluate_from(
        &self,
        settler: &mut ContactSettler,
        x: &DVector<f64>,
        settled: &Equilibrium,
        kept: &Kept,
    ) -> Option<Evaluation<Equilibrium>> {
        let settled = match self.scene.is_empty() {
            true => settled.clone(),
            false => self.settle_again(settler, x, settled)?.equilibrium,
        };
        self.evaluate(settler, x, settled, kept)
    }

    /// An equilibrium with what the robot touches there, which `settler` has yet to settle to; `None` without obstacles.
    pub fn among(
        &self,
        settler: &mut ContactSettler,
        x: &DVector<f64>,
        settled: &Equilibrium,
    ) -> Option<ContactEquilibrium> {
        match self.scene.is_empty() {
            true => None,
            false => self.settle_again(settler, x, settled),
        }
    }

    fn settle_again(
        &self,
        settler: &mut ContactSettler,
        x: &DVector<f64>,
        settled: &Equilibrium,
    ) -> Option<ContactEquilibrium> {
        let start = &settled.configuration;
        let found = settler.settle_from(start, &self.command(x), self.loads);
        Some(found.ok()?.clone())
    }

    pub fn command(&self, x: &DVector<f64>) -> Command {
        let tendons = self.robot.tendons().iter().zip(x);
        let value = |(tendon, share): (&crate::robot::Tendon, &f64)| {
            let [low, high] = tendon.range;
            (low + share * (high - low)).clamp(low, high)
        };
        let values: Vec<f64> = tendons.map(value).collect();
        (self.robot.command(&values)).expect("clamped to the tendons' ranges")
    }

    fn errors(&self, equilibrium: &Equilibrium) -> Vec<f64> {
        let error = |target: &Target| target.error(equilibrium).norm();
        self.targets.iter().map(error).collect()
    }

    /// Whether all targets and presses are met within a tolerance (m), and the clearance is kept.
    fn is_met(&self, at: &Evaluation<Equilibrium>, kept: &Kept, within: f64) -> bool {
        let first = 3 * self.targets.len();
        let pressed = (self.presses.iter().zip(first..))
            .all(|(press, row)| at.residuals[row].abs() <= within * press.weight.sqrt());
        let apart = |apart: &Apart| apart.is_met(kept, &at.memory);
        pressed
            && self.errors(&at.memory).iter().all(|error| *error <= within)
            && self.apart.as_ref().is_none_or(apart)
    }

    /// Whether a configuration is that of an equilibrium, to the tolerance as an angle on 1 m.
    pub fn same_place(&self, followed: &Configuration, settled: &Equilibrium) -> bool {
        let joints = followed.0.iter().zip(&settled.configuration.0);
        joints.fold(0.0, |largest: f64, (a, b)| largest.max(a.angle_to(b))) <= self.search.tolerance
    }

    pub fn solution(
        &self,
        x: &DVector<f64>,
        at: &Evaluation<Equilibrium>,
        among: Option<ContactEquilibrium>,
        steps: usize,
    ) -> ShapeSolution {
        let errors = self.errors(&at.memory);
        let force = |press: &Press| {
            let among = among.as_ref();
            among.map_or(0.0, |among| among.normal_force(press.obstacle, press.disc))
        };
        let forces: Vec<f64> = self.presses.iter().map(force).collect();
        let off = |(press, force): (&Press, &f64)| press.error(*force, 0.0).abs();
        let largest = (errors.iter().copied())
            .chain(self.presses.iter().zip(&forces).map(off))
            .fold(0.0, f64::max);
        let gap = gap(x, at);
        let outcome = if largest <= self.search.tolerance {
            Outcome::Reached
        } else if gap <= self.search.tolerance {
            Outcome::Unreachable {
                active: active_bounds(x, at),
                obstacles: Vec::new(),
                gap,
            }
        } else {
            Outcome::Stalled { gap }
        };
        ShapeSolution {
            command: self.command(x),
            errors,
            forces,
            nearest: None,
            equilibrium: at.memory.clone(),
            among,
            outcome,
            steps,
        }
    }
}

/// A command as shares of the tendons' ranges.
pub(super) fn shares(robot: &Robot, command: &Command) -> DVector<f64> {
    let tendons = robot.tendons().iter().zip(command.as_slice());
    let share = |(tendon, value): (&crate::robot::Tendon, &f64)| {
        let [low, high] = tendon.range;
        (value - low) / (high - low)
    };
    DVector::from_iterator(robot.tendons().len(), tendons.map(share))
}

/// The most that the norm of the residuals would fall by within the unit box, were it linear.
pub(super) fn gap<M>(x: &DVector<f64>, at: &Evaluation<M>) -> f64 {
    let gradient = at.gradient();
    let fall = |(x, slope): (&f64, &f64)| {
        if *slope > 0.0 {
            x * slope
        } else {
            (x - 1.0) * slope
        }
    };
    x.iter().zip(&gradient).map(fall).sum::<f64>() / at.residuals.norm()
}

fn active_bounds<M>(x: &DVector<f64>, at: &Evaluation<M>) -> Vec<ActiveBound> {
    let gradient = at.gradient();
    let bound = |(tendon, (x, slope)): (usize, (&f64, &f64))| {
        let bound = match (*x, *slope) {
            (0.0, slope) if slope > 0.0 => Bound::Low,
            (1.0, slope) if slope < 0.0 => Bound::High,
            _ => return None,
        };
        Some(ActiveBound { tendon, bound })
    };
    x.iter()
        .zip(&gradient)
        .enumerate()
        .filter_map(bound)
        .collect()
}

//! The search for a command.

use nalgebra::{DMatrix, DVector, Matrix3xX};

use super::{ActiveBound, Bound, Outcome, Search, ShapeControlError, ShapeSolution, Target};
use crate::chain::Configuration;
use crate::contact::{ContactEquilibrium, ContactSettler};
use crate::inverse::least_squares::{Evaluation, Limit, minimise};
use crate::robot::{Command, Loads, Robot};
use crate::scene::Scene;
use crate::statics::Equilibrium;

/// Times that a descent goes on from the equilibrium that the straight pose leads to, where that is
/// another one than the descent's.
const MAX_RETURNS: usize = 4;

/// The search for one list of targets. Its unknowns are the commands as shares of their ranges.
pub(super) struct Problem<'a> {
    pub robot: &'a Robot,
    pub scene: &'a Scene,
    pub loads: &'a Loads,
    pub search: &'a Search,
    pub targets: &'a [Target],
}

/// A command, as shares of the tendons' ranges, and the equilibrium under it.
#[derive(Clone, Debug)]
pub(super) struct Place {
    pub x: DVector<f64>,
    pub settled: Equilibrium,
}

impl Problem<'_> {
    pub fn best_of<'s>(
        &self,
        starts: impl Iterator<Item = &'s (Command, Equilibrium)>,
    ) -> Result<ShapeSolution, ShapeControlError> {
        let mut settler = self.settler();
        let mut best: Option<(f64, ShapeSolution)> = None;
        let (mut steps, mut tried) = (0, 0);
        for start in starts {
            tried += 1;
            let Some((cost, mut found)) = self.descend(&mut settler, start) else {
                continue;
            };
            steps += found.steps;
            found.steps = steps;
            if found.outcome == Outcome::Reached {
                return Ok(found);
            }
            if best.as_ref().is_none_or(|(least, _)| cost < *least) {
                best = Some((cost, found));
            }
        }
        let (_, mut found) = best.ok_or(ShapeControlError::Unsettled(tried))?;
        found.steps = steps;
        Ok(found)
    }

    /// What a descent from each start leads to.
    pub fn all_of<'s>(
        &self,
        starts: impl Iterator<Item = &'s (Command, Equilibrium)>,
    ) -> Vec<ShapeSolution> {
        let mut settler = self.settler();
        let found = starts.filter_map(|start| self.descend(&mut settler, start));
        found.map(|(_, found)| found).collect()
    }

    fn settler(&self) -> ContactSettler {
        ContactSettler::new(self.robot, self.scene)
    }

    /// Descends from one command; also returns the cost reached.
    fn descend(
        &self,
        settler: &mut ContactSettler,
        (command, settled): &(Command, Equilibrium),
    ) -> Option<(f64, ShapeSolution)> {
        let limits = vec![Limit::SHARE; self.robot.tendons().len()];
        let mut x = shares(self.robot, command);
        let mut at = self.evaluate_from(settler, &x, settled)?;
        let mut steps = 0;
        for _ in 0..MAX_RETURNS {
            let evaluate = |x: &DVector<f64>, near: &Equilibrium| {
                let (command, near) = (self.command(x), &near.configuration);
                let settled = settler.settle_from(near, &command, self.loads).ok()?;
                let settled = settled.equilibrium.clone();
                self.evaluate(settler, x, settled)
            };
            // Aimed at a tenth, so that another way to the same equilibrium is near enough too.
            let enough = 0.1 * self.search.tolerance;
            let done = |x: &DVector<f64>, at: &Evaluation<Equilibrium>| {
                self.largest_error(&at.memory) <= enough || gap(x, at) <= enough
            };
            let found = minimise(x, at, &limits, self.search.max_steps, evaluate, done);
            steps += found.steps;
            let followed = found.at.memory.configuration.clone();
            let settled = settler.settle(&self.command(&found.x), self.loads).ok()?;
            let settled = settled.equilibrium.clone();
            x = found.x;
            at = self.evaluate(settler, &x, settled)?;
            if self.same_place(&followed, &at.memory) {
                break;
            }
        }
        let cost = at.cost();
        let among = (!self.scene.is_empty()).then(|| settler.found().clone());
        Some((cost, self.solution(x, at, among, steps)))
    }

    /// As [`evaluate`](Self::evaluate), where `settler` has yet to settle to the equilibrium.
    pub fn evaluate_from(
        &self,
        settler: &mut ContactSettler,
        x: &DVector<f64>,
        settled: &Equilibrium,
    ) -> Option<Evaluation<Equilibrium>> {
        let settled = match self.scene.is_empty() {
            true => settled.clone(),
            false => self.settle_again(settler, x, settled)?.equilibrium,
        };
        self.evaluate(settler, x, settled)
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

    /// Residuals and Jacobian at an equilibrium, the last of `settler` where there are obstacles; `None` where it is not
    /// stable.
    pub fn evaluate(
        &self,
        settler: &ContactSettler,
        x: &DVector<f64>,
        settled: Equilibrium,
    ) -> Option<Evaluation<Equilibrium>> {
        let command = self.command(x);
        let poses = match self.scene.is_empty() {
            true => {
                let sensitivity = self.robot.sensitivity(&command, self.loads, &settled);
                sensitivity.ok()?.command_jacobian()
            }
            false => {
                let sensitivity = settler.sensitivity(&command, self.loads).ok()?;
                sensitivity.parameters().command_jacobian()
            }
        };
        let tendons = self.robot.tendons().len();
        let mut residuals = DVector::zeros(3 * self.targets.len());
        let mut jacobian = DMatrix::zeros(3 * self.targets.len(), tendons);
        for (i, target) in self.targets.iter().enumerate() {
            let rows = |part: usize| -> Matrix3xX<f64> {
                poses.fixed_rows::<3>(6 * target.disc + 3 * part).into()
            };
            let scale = target.weight.sqrt();
            let error = target.error(&settled) * scale;
            residuals.fixed_rows_mut::<3>(3 * i).copy_from(&error);
            let slope = target.error_jacobian(&settled, [rows(0), rows(1)]) * scale;
            jacobian.fixed_rows_mut::<3>(3 * i).copy_from(&slope);
        }
        for (mut column, tendon) in jacobian.column_iter_mut().zip(self.robot.tendons()) {
            column *= tendon.range[1] - tendon.range[0];
        }
        let finite = jacobian.iter().all(|x| x.is_finite());
        finite.then_some(Evaluation {
            residuals,
            jacobian,
            memory: settled,
        })
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

    fn largest_error(&self, equilibrium: &Equilibrium) -> f64 {
        self.errors(equilibrium).into_iter().fold(0.0, f64::max)
    }

    /// Whether a configuration is that of an equilibrium, to the tolerance as an angle on 1 m.
    pub fn same_place(&self, followed: &Configuration, settled: &Equilibrium) -> bool {
        let joints = followed.0.iter().zip(&settled.configuration.0);
        joints.fold(0.0, |largest: f64, (a, b)| largest.max(a.angle_to(b))) <= self.search.tolerance
    }

    pub fn solution(
        &self,
        x: DVector<f64>,
        at: Evaluation<Equilibrium>,
        among: Option<ContactEquilibrium>,
        steps: usize,
    ) -> ShapeSolution {
        let gap = gap(&x, &at);
        let outcome = if self.largest_error(&at.memory) <= self.search.tolerance {
            Outcome::Reached
        } else if gap <= self.search.tolerance {
            let active = active_bounds(&x, &at);
            Outcome::Unreachable { active, gap }
        } else {
            Outcome::Stalled { gap }
        };
        ShapeSolution {
            command: self.command(&x),
            errors: self.errors(&at.memory),
            equilibrium: at.memory,
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

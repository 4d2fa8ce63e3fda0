//! Commands for targets that move: each the nearest to the last on the same branch of solutions.
//!
//! Robots with more tendons than targets have coordinates reach a target by many commands. From one
//! target to the next the errors are led to zero by continuation (Allgower and Georg, Introduction to
//! Numerical Continuation Methods, 2003), and of the commands that meet the targets the one that
//! differs least from the last is taken: with commands as shares of their ranges `x`, the minimiser of
//! `|errors(x)|² + c² |x - last|²` for a small `c`, and then the nearest minimiser of the errors alone.
//! Every equilibrium is followed from the last one, and a step counts only if the robot comes from the
//! one to the other while its command changes evenly.

use nalgebra::{DMatrix, DVector};

use super::apart::Kept;
use super::problem::{Place, Problem, gap, shares};
use super::{ContactGoals, Outcome, ShapeControlError, ShapeController, ShapeSolution, Target};
use crate::contact::ContactSettler;
use crate::inverse::least_squares::{Evaluation, Limit, minimise};
use crate::robot::Command;
use crate::solve::Continuation;
use crate::statics::Equilibrium;

/// `c` (m): small enough to choose among the commands that meet the targets, not between them and
/// others.
const CHOICE: f64 = 0.01;
/// Steps of the choice at most, and how far from the minimum it may stop (m).
const CHOICE_STEPS: usize = 60;
const CHOSEN: f64 = 1e-6;
/// Smallest part of the way between two targets that is gone at once.
const LEAST_PART: f64 = 1.0 / 64.0;
/// A disc that moves by more than this share of the backbone's length in one small step has jumped.
const JUMP: f64 = 0.05;
/// Into how many small steps a change of command is divided, at first and at most.
const PARTS: [usize; 2] = [4, 64];

/// Leads a robot from target to target on one branch of solutions. See [`ShapeController::path`].
///
/// ```
/// use tdcr_sim::inverse::shape::{Arrival, Search, ShapeController, Target};
/// use tdcr_sim::robot::{Loads, Robot};
///
/// let robot = Robot::load("3m")?;
/// let controller = ShapeController::new(&robot, &Loads::default(), Search::default())?;
/// let mut path = controller.path();
/// for k in 0..10 {
///     let tip = Target::tip(&robot, [0.10, 0.002 * f64::from(k), 0.30].into());
///     let point = path.follow(&[tip])?;
///     if let Arrival::Switched = point.arrival {
///         println!("target {k}: the robot jumps by {:.3} m", point.disc_change);
///     }
///     println!("{:?} m, {:?}", point.solution.command.as_slice(), point.solution.outcome);
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct ShapePath {
    controller: ShapeController,
    settler: ContactSettler,
    last: Option<Place>,
}

/// The command for one target of a path, and how the robot comes there from the last one.
#[derive(Clone, Debug, PartialEq)]
pub struct PathPoint {
    /// The command and where the robot is under it. Its equilibrium follows from the last one: under
    /// some commands [`Robot::settle`](crate::robot::Robot::settle), from the straight pose, finds another.
    pub solution: ShapeSolution,
    /// How it follows from the last command.
    pub arrival: Arrival,
    /// Commands to go through before this one, in order. Empty unless an even change from the last
    /// command leads to another equilibrium.
    pub via: Vec<Command>,
    /// Largest change of a command's entry since the last target, in its unit.
    pub command_change: f64,
    /// How far the disc that moved most is from where it was at the last target (m).
    pub disc_change: f64,
}

/// How one command of a path follows from the last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arrival {
    /// It is the first: there is nothing to follow.
    First,
    /// Along the branch: the robot comes here, without a jump, while its command changes evenly from the
    /// last one through those of [`PathPoint::via`].
    Followed,
    /// By a jump: the branch ends, or leads away from the targets, before they are reached, and
    /// another one reaches them. Its equilibrium is that from the straight pose; no continuous way
    /// between the two was found.
    Switched,
}

impl ShapePath {
    pub(super) fn new(controller: &ShapeController, last: Option<Place>) -> Self {
        Self {
            controller: controller.clone(),
            settler: ContactSettler::new(&controller.robot, &controller.scene),
            last,
        }
    }

    /// The command for the path's next `targets`, as near to the last one as can be.
    ///
    /// Where the branch does not reach them, the robot changes to another one that does, which
    /// [`Arrival::Switched`] says; if none is found, it goes to the point of its branch where the
    /// targets are nearest, which [`ShapeSolution::outcome`] says.
    ///
    /// # Errors
    /// As [`ShapeController::reach`]. The path then stays where it was.
    pub fn follow(&mut self, targets: &[Target]) -> Result<PathPoint, ShapeControlError> {
        let controller = self.controller.clone();
        let asked = ContactGoals::default();
        let problem = controller.problem(targets, &asked)?;
        let Some(last) = &self.last else {
            let first = controller.reach(targets)?;
            return Ok(self.arrive(&problem, Arrival::First, first, Vec::new()));
        };
        let length: f64 = (self.controller.robot.discs().iter())
            .map(|disc| disc.offset.norm())
            .sum();
        let mut way = Way {
            problem: &problem,
            settler: &mut self.settler,
            jump: JUMP * length,
        };
        let followed = way.follow(last);
        let reached = |found: &ShapeSolution| found.outcome == Outcome::Reached;
        if followed.as_ref().is_none_or(|(found, _)| !reached(found)) {
            let others = problem.all_of(problem.starts(&controller.samples).into_iter());
            let distance = |found: &ShapeSolution| disc_change(&last.settled, &found.equilibrium);
            let nearest = (others.into_iter().filter(reached))
                .min_by(|a, b| distance(a).total_cmp(&distance(b)));
            if let Some(other) = nearest {
                return Ok(self.arrive(&problem, Arrival::Switched, other, Vec::new()));
            }
        }
        let (solution, via) = followed.ok_or(ShapeControlError::Unsettled(1))?;
        Ok(self.arrive(&problem, Arrival::Followed, solution, via))
    }

    fn arrive(
        &mut self,
        problem: &Problem,
        arrival: Arrival,
        solution: ShapeSolution,
        via: Vec<Command>,
    ) -> PathPoint {
        let place = Place {
            x: shares(problem.robot, &solution.command),
            settled: solution.equilibrium.clone(),
        };
        let last = self.last.as_ref().unwrap_or(&place);
        let before = problem.command(&last.x);
        let entries = before.as_slice().iter().zip(solution.command.as_slice());
        let point = PathPoint {
            arrival,
            via,
            command_change: entries.fold(0.0, |most: f64, (a, b)| most.max((a - b).abs())),
            disc_change: disc_change(&last.settled, &solution.equilibrium),
            solution,
        };
        self.last = Some(place);
        point
    }
}

/// How far the disc that moves most is displaced (m).
fn disc_change(from: &Equilibrium, to: &Equilibrium) -> f64 {
    let pairs = from.positions.iter().zip(&to.positions);
    pairs.fold(0.0, |most: f64, (a, b)| most.max((a - b).norm()))
}

/// The way from one target to the next.
struct Way<'w> {
    problem: &'w Problem<'w>,
    settler: &'w mut ContactSettler,
    /// Displacement of a disc (m) that is a jump.
    jump: f64,
}

impl Way<'_> {
    /// Goes as far towards the targets as the branch leads; also returns the commands on the way.
    /// `None` if the start is not stable.
    fn follow(&mut self, start: &Place) -> Option<(ShapeSolution, Vec<Command>)> {
        let mut place = start.clone();
        let none = Kept::default();
        let mut at = (self.problem).evaluate_from(self.settler, &place.x, &place.settled, &none)?;
        // The errors at the start. A share of the way on, that share of them is gone.
        let errors = at.residuals.clone();
        let mut continuation = Continuation::new(1.0, LEAST_PART);
        let (mut steps, mut via) = (0, Vec::new());
        while let Some(share) = continuation.target() {
            match self.nearest(&place, &at, &(&errors * (1.0 - share)), &mut steps) {
                Some((next, there)) if self.leads(&place, &next) => {
                    (place, at) = (next, there);
                    via.push(self.problem.command(&place.x));
                    continuation.succeed(2.0);
                }
                _ if continuation.fail(0.5) => {}
                _ => break,
            }
        }
        via.pop();
        let among = self.problem.among(self.settler, &place.x, &at.memory);
        Some((self.problem.solution(&place.x, &at, among, steps), via))
    }

    /// The place nearest to `from` where the errors are `wanted`, or as near to that as can be. `None`
    /// if the branch ends before. `at` is the evaluation at `from`.
    fn nearest(
        &mut self,
        from: &Place,
        at: &Evaluation<Equilibrium>,
        wanted: &DVector<f64>,
        steps: &mut usize,
    ) -> Option<(Place, Evaluation<Equilibrium>)> {
        let (problem, jump) = (self.problem, self.jump);
        let search = problem.search;
        let limits = vec![Limit::SHARE; from.x.len()];
        let settler = &mut *self.settler;
        let none = Kept::default();
        let mut follow = |x: &DVector<f64>, near: &Equilibrium| {
            let command = problem.command(x);
            let settled = settler.settle_from(&near.configuration, &command, problem.loads);
            let settled = settled.ok()?.equilibrium.clone();
            if disc_change(near, &settled) > jump {
                return None;
            }
            let mut at = problem.evaluate(settler, x, settled, &none)?;
            at.residuals -= wanted;
            Some(at)
        };

        let choice = |x: &DVector<f64>, at| with_choice(at, &(x - &from.x));
        let start = Evaluation {
            residuals: &at.residuals - wanted,
            jacobian: at.jacobian.clone(),
            memory: at.memory.clone(),
        };
        let chosen = minimise(
            from.x.clone(),
            choice(&from.x, start),
            &limits,
            CHOICE_STEPS,
            |x, near| Some(choice(x, follow(x, near)?)),
            |x, at| gap(x, at) <= CHOSEN,
        );

        let start = follow(&chosen.x, &chosen.at.memory)?;
        let enough = 0.1 * search.tolerance;
        let met = |x: &DVector<f64>, at: &Evaluation<_>, within: f64| {
            at.residuals.norm() <= within || gap(x, at) <= within
        };
        let found = minimise(
            chosen.x,
            start,
            &limits,
            search.max_steps,
            follow,
            |x, at| met(x, at, enough),
        );
        *steps += chosen.steps + found.steps;
        if !met(&found.x, &found.at, search.tolerance) {
            return None;
        }
        let mut at = found.at;
        at.residuals += wanted;
        let place = Place {
            x: found.x,
            settled: at.memory.clone(),
        };
        Some((place, at))
    }

    /// Whether the robot comes from one place to the other without a jump, while its command changes
    /// evenly.
    fn leads(&mut self, from: &Place, to: &Place) -> bool {
        let [mut parts, most] = PARTS;
        loop {
            match self.walk(from, to, parts) {
                Some(end) => return self.problem.same_place(&end.configuration, &to.settled),
                None if parts >= most => return false,
                None => parts *= 4,
            }
        }
    }

    /// Where the robot comes from `from` while its command changes to that of `to` in so many parts;
    /// `None` if it jumps, or does not settle.
    fn walk(&mut self, from: &Place, to: &Place, parts: usize) -> Option<Equilibrium> {
        let mut last = from.settled.clone();
        for part in 1..=parts {
            let share = part as f64 / parts as f64;
            let command = self.problem.command(&from.x.lerp(&to.x, share));
            let loads = self.problem.loads;
            let settled = (self.settler).settle_from(&last.configuration, &command, loads);
            let settled = &settled.ok()?.equilibrium;
            if !settled.converged || disc_change(&last, settled) > self.jump {
                return None;
            }
            last.clone_from(settled);
        }
        Some(last)
    }
}

/// `at` with `c` times the command's change as further residuals.
fn with_choice(at: Evaluation<Equilibrium>, change: &DVector<f64>) -> Evaluation<Equilibrium> {
    let (rows, columns) = at.jacobian.shape();
    let mut residuals = DVector::zeros(rows + columns);
    residuals.rows_mut(0, rows).copy_from(&at.residuals);
    residuals
        .rows_mut(rows, columns)
        .copy_from(&(change * CHOICE));
    let mut jacobian = DMatrix::zeros(rows + columns, columns);
    jacobian.rows_mut(0, rows).copy_from(&at.jacobian);
    jacobian.rows_mut(rows, columns).fill_diagonal(CHOICE);
    Evaluation {
        residuals,
        jacobian,
        memory: at.memory,
    }
}

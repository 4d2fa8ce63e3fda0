//! The velocities at the end of a step among obstacles: a convex problem.
//!
//! With `v*` the joints' rates without contacts, `A` the step's matrix and `u = u* + J w` the velocities of the contacts' points, the
//! rates are `v* + w`, where `w` minimises `w' A w / 2 + sum phi(u)`. A contact's impulse is `p = -dphi/du`: of one-sided springs and
//! dampers along the normal ([`Push`]), and of friction of a given bound `b` across it, `-b t / max(STICK, |t|)` at the sliding
//! velocity `t`. (Todorov, ICRA 2014; Castro, Permenter and Han, IEEE Trans. Robotics 2022, for such problems; the bound held during
//! the solve as by Castro, Han and Masterjohn, A Theory of Irrotational Contact Fields, 2023.) Bounds follow the normal impulses from
//! solve to solve ([`Bounds`]), which are the more exact the nearer they are.
//!
//! Inextensible tendons of commanded length are in the sum as well ([`HeldTendon`]).
//!
//! Newton's method: the next iterate solves `(A + J' H J) w = J' (p + H (u - u*))`, `H = -dp/du`, in O(n) ([`Reaction`]). Every iterate
//! has `A w = J' F` with known `F`, so that the line search is one of the contacts alone.

use nalgebra::{Matrix3, Vector3};

use super::bounds::Bounds;
use super::coupled::{Movables, Responds};
use super::tendons::HeldTendon;
use super::ties::{Ties, WithTies};
use super::touch::{DiscVelocities, Response, Side, Touch};
use crate::dynamics::Reaction;

/// Largest difference of impulses, for the largest of them, at which the problem is solved.
const TOLERANCE: f64 = 1e-10;
/// Impulse (N s) that is none.
const NO_IMPULSE: f64 = 1e-16;
const MAX_ITERATIONS: usize = 60;
/// How often bounds of friction follow the normal impulses, extrapolated and then damped, and the share of them at which they have.
const MAX_BOUNDS: usize = 20;
const MAX_DAMPED: usize = 200;
pub(super) const SAME_BOUND: f64 = 1e-6;
/// The tolerance with which the problem is solved before they have: at first, and by how much they were off last.
const ROUGH: f64 = 1e-2;
const INEXACT: f64 = 0.1;
/// Share of the slope that may be left by a line search.
const FLAT: f64 = 1e-3;
const MAX_TRIALS: usize = 60;

/// The contacts of a step, and the workspace to solve for their velocities.
#[derive(Clone, Debug, Default)]
pub(super) struct Problem {
    pub touches: Vec<Touch>,
    /// Change of the joints' rates (rad/s, world axes).
    pub change: Vec<Vector3<f64>>,
    reactions: Vec<Reaction>,
    trial: Vec<Vector3<f64>>,
    /// Of each contact, what an iteration changes velocity and impulse by.
    steps: Vec<[Vector3<f64>; 2]>,
    spatial: DiscVelocities,
    /// The objects that contacts are with.
    pub movables: Movables,
    /// The tendons of commanded length, and what ties discs together in an iteration.
    pub tendons: Vec<HeldTendon>,
    /// Of each of these, what an iteration changes velocity and impulse by.
    pulls: Vec<[f64; 2]>,
    ties: Ties,
    /// What each contact does at its velocity.
    laws: Vec<Response>,
    /// Bounds of friction as they follow the normal impulses.
    pub bounds: Bounds,
}

/// How well a problem is solved.
#[derive(Clone, Copy, Debug)]
pub(super) struct Solved {
    /// Whether the velocities are those of the bounds of friction.
    pub found: bool,
    /// By how much these bounds differ from those of the normal impulses, for the largest of them.
    pub off: f64,
}

impl Solved {
    /// Of a problem without contacts.
    pub const NOTHING: Self = Self {
        found: true,
        off: 0.0,
    };
}

impl Problem {
    /// Solves the problem, whose contacts stand at the velocities without them: bounds of friction, and the velocities under each.
    /// `robot` says how the joints' rates change by reactions.
    pub fn solve(&mut self, centres: &[Vector3<f64>], robot: &mut impl Responds) -> Solved {
        let zero = Vector3::zeros();
        self.movables.prepare(&self.touches);
        self.tendons.iter_mut().for_each(HeldTendon::reset);
        for buffer in [&mut self.change, &mut self.trial] {
            buffer.clear();
            buffer.resize(centres.len(), zero);
        }
        self.reactions.resize(centres.len(), Reaction::default());
        if self.touches.iter().all(|touch| touch.friction == 0.0) {
            let found = self.minimise(TOLERANCE, centres, robot);
            return Solved {
                found,
                ..Solved::NOTHING
            };
        }
        // A step among objects depends on earlier ones by rapier's search, too; one without them is a function of its state.
        let with_objects = !self.movables.all.is_empty();
        if with_objects {
            self.bounds.recall(&mut self.touches);
        }
        let off = self.find_bounds(centres, robot);
        if with_objects {
            self.bounds.keep(&self.touches);
        }
        let found = self.minimise(TOLERANCE, centres, robot);
        Solved { found, off }
    }

    /// Finds bounds of friction that are those of the normal impulses. By how much they are off, for the largest of them.
    fn find_bounds(&mut self, centres: &[Vector3<f64>], robot: &mut impl Responds) -> f64 {
        self.bounds.begin();
        let mut tolerance = ROUGH;
        for _ in 0..MAX_BOUNDS {
            self.minimise(tolerance, centres, robot);
            let off = self.follow_bounds(Bounds::next);
            if off <= SAME_BOUND {
                return off;
            }
            tolerance = (INEXACT * off).clamp(TOLERANCE, ROUGH);
        }
        // Where the normal impulses depend much on friction, these come to no end.
        self.bounds.begin();
        self.touches.iter_mut().for_each(|touch| touch.bound = 0.0);
        let mut off = f64::INFINITY;
        for _ in 0..MAX_DAMPED {
            self.minimise(TOLERANCE, centres, robot);
            off = self.follow_bounds(Bounds::next_damped);
            if off <= SAME_BOUND {
                break;
            }
        }
        off
    }

    /// Sets the bounds of friction to what comes `next` after those and the ones that the normal impulses ask for. By how much these
    /// differed, for the largest of them.
    fn follow_bounds(&mut self, next: fn(&mut Bounds, &[f64], Vec<f64>) -> Vec<f64>) -> f64 {
        let (mut change, mut largest): (f64, f64) = (0.0, 0.0);
        let found: Vec<f64> = (self.touches.iter())
            .map(|touch| {
                let pressed = touch.pressed(&touch.velocity) * touch.gradient.norm();
                let bound = touch.friction * pressed;
                change = change.max((bound - touch.bound).abs());
                largest = largest.max(bound);
                bound
            })
            .collect();
        if change <= NO_IMPULSE {
            return 0.0;
        }
        let bounds: Vec<f64> = self.touches.iter().map(|touch| touch.bound).collect();
        let next = next(&mut self.bounds, &bounds, found);
        for (touch, bound) in self.touches.iter_mut().zip(next) {
            touch.bound = bound;
        }
        change / largest.max(NO_IMPULSE)
    }

    /// Newton's method from where the contacts stand.
    fn minimise(
        &mut self,
        tolerance: f64,
        centres: &[Vector3<f64>],
        robot: &mut impl Responds,
    ) -> bool {
        for _ in 0..MAX_ITERATIONS {
            if self.is_solved(tolerance) {
                return true;
            }
            self.newton_step(centres, robot);
            let share = self.line_search();
            if share.is_nan() {
                return false;
            }
            for (touch, [velocity, impulse]) in self.touches.iter_mut().zip(&self.steps) {
                touch.velocity += velocity * share;
                touch.impulse += impulse * share;
            }
            for (tendon, [velocity, impulse]) in self.tendons.iter_mut().zip(&self.pulls) {
                tendon.velocity += velocity * share;
                tendon.impulse += impulse * share;
            }
            for (change, trial) in self.change.iter_mut().zip(&self.trial) {
                *change += (trial - *change) * share;
            }
            self.movables.take(share);
        }
        self.is_solved(tolerance)
    }

    fn is_solved(&self, tolerance: f64) -> bool {
        let (mut error, mut largest): (f64, f64) = (0.0, 0.0);
        for touch in &self.touches {
            let impulse = touch.impulse_at(&touch.velocity);
            error = error.max((impulse - touch.impulse).norm_squared());
            largest = largest.max(impulse.norm_squared());
        }
        let tendons = || self.tendons.iter();
        let most = tendons().map(|tendon| tendon.whole().abs());
        let allowed = tolerance * most.fold(0.0, f64::max);
        error.sqrt() <= tolerance * largest.sqrt() + NO_IMPULSE
            && tendons().all(|tendon| tendon.is_solved(allowed))
    }

    /// Solves the problem with the impulses linearised at their velocities.
    fn newton_step(&mut self, centres: &[Vector3<f64>], robot: &mut impl Responds) {
        self.reactions.fill(Reaction::default());
        self.steps.clear();
        self.laws.clear();
        for touch in &self.touches {
            let response = touch.response();
            // What acts on several discs follows below.
            if let (Side::Disc(disc), None, true) = (touch.on, touch.other, response.acts()) {
                let Response { impulse, inertance } = &response;
                let at_rest = impulse + inertance * (touch.velocity - touch.free);
                self.reactions[disc].push(&touch.arm, &at_rest, inertance);
            }
            self.laws.push(response);
        }
        let contacts = (&self.touches[..], &self.laws[..]);
        (self.ties).take(contacts, &self.tendons, &mut self.reactions);
        if self.ties.are_none() {
            self.respond(centres, robot);
        } else {
            let mut ties = std::mem::take(&mut self.ties);
            let mut robot = WithTies {
                robot,
                ties: &mut ties,
                centres,
            };
            self.respond(centres, &mut robot);
            self.ties = ties;
        }
        self.spatial.set(centres, &self.trial);
        for (number, (touch, law)) in self.touches.iter().zip(&self.laws).enumerate() {
            let mut there = touch.free + self.movables.trial(number);
            if let Side::Disc(disc) = touch.on {
                there += self.spatial.of(disc, &touch.arm);
            }
            if let Some((disc, arm)) = &touch.other {
                there -= self.spatial.of(*disc, arm);
            }
            let velocity = there - touch.velocity;
            let next = law.impulse - law.inertance * velocity;
            self.steps.push([velocity, next - touch.impulse]);
        }
        self.pulls.clear();
        for tendon in &self.tendons {
            let velocity = tendon.shortening(&self.spatial) - tendon.velocity;
            let law = tendon.law();
            let next = law.impulse - law.inertance * velocity;
            self.pulls.push([velocity, next - tendon.impulse]);
        }
    }

    /// Writes what the linearised impulses change of the rates.
    fn respond(&mut self, centres: &[Vector3<f64>], robot: &mut impl Responds) {
        if self.movables.all.is_empty() {
            robot.respond(&self.reactions, &mut self.trial);
        } else {
            robot.respond_keeping(&self.reactions, &mut self.trial);
            let contacts = (&self.touches[..], &self.laws[..]);
            (self.movables).couple(contacts, centres, &mut self.trial, robot);
        }
    }

    /// The share of the step at which the objective is least. Its slope rises with the share, for the objective is convex.
    fn line_search(&self) -> f64 {
        let start = self.slope(0.0);
        let end = self.slope(1.0);
        // The whole step, where the objective still falls there or is flat.
        if end <= FLAT * start.abs() || start >= 0.0 {
            return if end.is_nan() { f64::NAN } else { 1.0 };
        }
        // Regula falsi on the slope (Illinois).
        let ([mut low, mut high], [mut below, mut above]) = ([0.0, 1.0], [start, end]);
        let mut share = 1.0;
        for _ in 0..MAX_TRIALS {
            share = (low * above - high * below) / (above - below);
            let slope = self.slope(share);
            if slope.abs() <= FLAT * start.abs() {
                break;
            }
            if slope > 0.0 {
                (high, above) = (share, slope);
                below *= 0.5;
            } else {
                (low, below) = (share, slope);
                above *= 0.5;
            }
        }
        share
    }

    /// Derivative of the objective by the share of the step (J).
    fn slope(&self, share: f64) -> f64 {
        let touches = self.touches.iter().zip(&self.steps);
        let terms = touches.map(|(touch, [velocity, impulse])| {
            let there = touch.impulse_at(&(touch.velocity + velocity * share));
            (touch.impulse + impulse * share - there).dot(velocity)
        });
        let tendons = self.tendons.iter().zip(&self.pulls);
        let pulls = tendons.map(|(tendon, [velocity, impulse])| {
            let there = tendon.law_at(tendon.velocity + velocity * share);
            (tendon.impulse + impulse * share - there.impulse) * velocity
        });
        terms.sum::<f64>() + pulls.sum::<f64>()
    }

    /// The impulses alone as reactions, one for each disc.
    pub fn impulses(&mut self) -> &[Reaction] {
        self.reactions.fill(Reaction::default());
        for touch in self.touches.iter().filter(|touch| touch.acts()) {
            if let Side::Disc(disc) = touch.on {
                self.reactions[disc].push(&touch.arm, &touch.impulse, &Matrix3::zeros());
            }
            if let Some((disc, arm)) = &touch.other {
                self.reactions[*disc].push(arm, &-touch.impulse, &Matrix3::zeros());
            }
        }
        &self.reactions
    }
}

//! Going along a line through the space of commands, on one branch of equilibria and clear of obstacles.
//!
//! Each equilibrium is followed from the last one. Between two of them at a chord of `d` (m, of a disc's farthest point) the disc is
//! taken to move along an arc of at most `ARC d`: with a margin `a` at one end and `b` at the other it is clear all the way
//! if `a + b >= ARC d`, since at an arc length `s` from the one end its margin is at least `a - s` and `b - (ARC d - s)`. A step that
//! is not so is halved. For two discs the same holds of the motion of one as seen from the other. Where discs move farther in a step than `STRIDE`, or out of proportion to the command's change (`STEEPEST`), however
//! small it is, the branch has ended, or is about to: that counts as a jump.

use nalgebra::{UnitQuaternion, Vector3};
use tdcr_sim::chain::Configuration;
use tdcr_sim::robot::{Loads, Robot};
use tdcr_sim::statics::{Equilibrium, Settler, Stability};

use super::space::{Space, between, squared_distance};
use super::surroundings::{Placed, Surroundings};

/// Largest displacement of a disc's farthest point in a step, as a share of the backbone's length.
const STRIDE: f64 = 0.04;
/// Which share of that is aimed at.
const AIM: f64 = 0.7;
/// Arc length over chord that a disc's way between two equilibria has at most.
const ARC: f64 = 1.5;
/// Largest displacement of a disc's farthest point, as a share of the backbone's length, for each share of the tendons' ranges by
/// which the command changes: of the paper's robots it is 0.9 in the median along straight lines between random commands, and above
/// 4 next to the end of a branch, where it grows without bound.
const STEEPEST: f64 = 6.0;
/// Shortest step (shares of the tendons' ranges).
const LEAST: f64 = 2e-3;
/// What two solves of one equilibrium may differ by, as a share of the backbone's length.
const ROUNDING: f64 = 1e-4;
/// Largest turn between the joints of two configurations (rad) that are one and the same equilibrium.
const SAME: f64 = 1e-3;

/// What a robot may do on its way.
#[derive(Clone, Debug)]
pub(super) struct Rules {
    /// Least distance from obstacles (m).
    pub clearance: f64,
    /// Least and largest tension (N).
    pub tension: [f64; 2],
}

/// Why a walk halts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Halt {
    /// The robot does not settle, or not stably.
    Unsettled,
    /// It would jump to another branch of equilibria.
    Jump,
    /// It would come too near to an obstacle, or touch itself.
    Near,
    /// A tendon would pull too much or too little.
    Tension {
        /// Which.
        tendon: usize,
    },
}

/// Follows one robot's equilibria. Its memory is used again.
#[derive(Clone, Debug)]
pub(super) struct Walker {
    pub space: Space,
    pub surroundings: Surroundings,
    rules: Rules,
    loads: Loads,
    settler: Settler,
    /// Length of the backbone (m).
    length: f64,
    stride: f64,
    here: Place,
    next: Place,
    /// Whether the settler's last equilibrium is not that of `here`.
    strayed: bool,
    /// Chord of a disc for each share that commands changed by, lately (m).
    rate: f64,
    start: Vec<f64>,
    target: Vec<f64>,
    /// Equilibria solved for.
    pub settled: usize,
}

/// Where a robot rests.
#[derive(Clone, Debug)]
pub(super) struct Place {
    /// Coordinates.
    pub at: Vec<f64>,
    pub configuration: Configuration,
    pub positions: Vec<Vector3<f64>>,
    pub orientations: Vec<UnitQuaternion<f64>>,
    pub shift: Vector3<f64>,
    pub tensions: Vec<f64>,
    /// How far each disc is from obstacles at least, beyond the clearance (m).
    margins: Vec<f64>,
    /// How far the discs of each pair that can touch are apart at least (m).
    gaps: Vec<f64>,
}

impl Place {
    fn new(robot: &Robot, dimensions: usize, pairs: usize) -> Self {
        let configuration = Configuration::straight(robot);
        let (positions, orientations) = configuration.place(robot);
        Self {
            at: vec![0.0; dimensions],
            shift: Vector3::zeros(),
            tensions: vec![0.0; robot.tendons().len()],
            margins: vec![0.0; positions.len()],
            gaps: vec![0.0; pairs],
            configuration,
            positions,
            orientations,
        }
    }

    fn take(&mut self, at: &[f64], shift: Vector3<f64>, equilibrium: &Equilibrium) {
        self.at.copy_from_slice(at);
        self.shift = shift;
        (self.configuration.0).copy_from_slice(&equilibrium.configuration.0);
        self.positions.copy_from_slice(&equilibrium.positions);
        self.orientations.copy_from_slice(&equilibrium.orientations);
        self.tensions.copy_from_slice(&equilibrium.tendon_tensions);
    }

    pub fn placed(&self) -> Placed<'_> {
        Placed {
            positions: &self.positions,
            orientations: &self.orientations,
            shift: self.shift,
        }
    }

    /// Whether it is clear of obstacles and of itself.
    fn is_clear(&self) -> bool {
        self.margins
            .iter()
            .chain(&self.gaps)
            .all(|room| *room >= 0.0)
    }

    /// Displacement of a disc's farthest point at most (m), between this place and another.
    fn chord(&self, other: &Self, disc: usize, enclosing: f64) -> f64 {
        let moved = self.positions[disc] + self.shift - other.positions[disc] - other.shift;
        let [a, b] = [self, other].map(|place| place.orientations[disc].coords);
        let turned = (a - b).norm().min((a + b).norm());
        // A turn by the angle w moves a point by 2 sin(w/2) times its distance; the quaternions differ by 2 sin(w/4).
        moved.norm() + 2.0 * enclosing * turned
    }

    /// The same of a disc as seen from another one.
    fn relative_chord(&self, other: &Self, [from, disc]: [usize; 2], enclosing: f64) -> f64 {
        let seen = [self, other].map(|place| {
            let back = place.orientations[from].inverse();
            let offset = back * (place.positions[disc] - place.positions[from]);
            (offset, (back * place.orientations[disc]).coords)
        });
        let turned = (seen[0].1 - seen[1].1)
            .norm()
            .min((seen[0].1 + seen[1].1).norm());
        (seen[0].0 - seen[1].0).norm() + 2.0 * enclosing * turned
    }
}

impl Walker {
    pub fn new(
        robot: &Robot,
        space: Space,
        surroundings: Surroundings,
        rules: Rules,
        loads: &Loads,
    ) -> Self {
        let length: f64 = robot.discs().iter().map(|disc| disc.offset.norm()).sum();
        let place = Place::new(robot, space.dimensions(), surroundings.pairs().len());
        let stride = STRIDE * length;
        Self {
            rate: length,
            start: place.at.clone(),
            target: place.at.clone(),
            next: place.clone(),
            here: place,
            space,
            surroundings,
            rules,
            loads: loads.clone(),
            settler: Settler::new(robot),
            length,
            stride,
            strayed: true,
            settled: 0,
        }
    }

    /// Where it stands.
    pub fn here(&self) -> &Place {
        &self.here
    }

    /// Settles at coordinates, from a configuration near there or else from the straight pose, and stands there if it does. Whether a
    /// robot may be there.
    pub fn stand(&mut self, at: &[f64], near: Option<&Configuration>) -> Result<(), Halt> {
        let settled = self.settle(at, near);
        if settled == Err(Halt::Unsettled) {
            return settled;
        }
        std::mem::swap(&mut self.here, &mut self.next);
        self.strayed = false;
        settled?;
        match self.here.is_clear() {
            true => Ok(()),
            false => Err(Halt::Near),
        }
    }

    /// Goes towards coordinates in a straight line, as far as it may; hands every place on the way to `visit`.
    pub fn walk(&mut self, to: &[f64], mut visit: impl FnMut(&Place)) -> Result<(), Halt> {
        let mut start = std::mem::take(&mut self.start);
        start.copy_from_slice(&self.here.at);
        let whole = squared_distance(&start, to).sqrt();
        let mut step = f64::min(1.0, AIM * self.stride / (self.rate * whole).max(1e-12));
        let mut gone = 0.0;
        let mut ended = Ok(());
        while gone < 1.0 {
            let mut target = std::mem::take(&mut self.target);
            let share = if gone + step > 1.0 - 1e-9 {
                1.0
            } else {
                gone + step
            };
            between(&start, to, share, &mut target);
            if share == 1.0 {
                target.copy_from_slice(to);
            }
            let tried = self.step(&target);
            self.target = target;
            match tried {
                Ok(chord) => {
                    let length = (share - gone) * whole;
                    gone = share;
                    visit(&self.here);
                    if length > 0.0 {
                        self.rate = (chord / length).max(1e-6 * self.length);
                        let fitting = AIM * self.stride / (self.rate * whole);
                        step = fitting.min(2.0 * step);
                    }
                }
                Err(halt) => {
                    // Next to the end of a branch solves take long.
                    let part = if halt == Halt::Near { 0.5 } else { 0.25 };
                    step = (share - gone) * part;
                    if step * whole < LEAST {
                        ended = Err(halt);
                        break;
                    }
                }
            }
        }
        self.start = start;
        ended
    }

    /// Whether it stands in a configuration.
    pub fn is_at(&self, configuration: &Configuration) -> bool {
        let own = self.here.configuration.0.iter();
        own.zip(&configuration.0).all(|(a, b)| {
            let apart = (a.coords - b.coords)
                .norm()
                .min((a.coords + b.coords).norm());
            2.0 * apart <= SAME
        })
    }

    /// One step; the largest chord of a disc (m).
    fn step(&mut self, to: &[f64]) -> Result<f64, Halt> {
        let strayed = std::mem::replace(&mut self.strayed, true);
        let here = std::mem::take(&mut self.here.configuration.0);
        let here = Configuration(here);
        let settled = self.settle_next(to, strayed.then_some(&here));
        self.here.configuration = here;
        settled?;
        let (mut longest, mut clear): (f64, _) = (0.0, self.next.is_clear());
        for disc in 0..self.here.positions.len() {
            let enclosing = self.surroundings.enclosing(disc);
            let chord = self.here.chord(&self.next, disc, enclosing);
            longest = longest.max(chord);
            clear &= self.here.margins[disc] + self.next.margins[disc] >= ARC * chord;
        }
        let change = squared_distance(&self.here.at, &self.next.at).sqrt();
        if longest
            > f64::min(
                self.stride,
                STEEPEST * self.length * change + ROUNDING * self.length,
            )
        {
            return Err(Halt::Jump);
        }
        if !clear || !self.keeps_discs_apart(longest) {
            return Err(Halt::Near);
        }
        std::mem::swap(&mut self.here, &mut self.next);
        self.strayed = false;
        Ok(longest)
    }

    /// Whether no discs can touch on the way to `next`, on which none moves farther than `longest` (m).
    fn keeps_discs_apart(&self, longest: f64) -> bool {
        let gaps = self.here.gaps.iter().zip(&self.next.gaps);
        let mut pairs = self.surroundings.pairs().iter().zip(gaps);
        pairs.all(|(&pair, (one, other))| {
            let enclosing = self.surroundings.enclosing(pair[1]);
            let room = one + other;
            room >= 2.0 * ARC * longest
                || room >= ARC * self.here.relative_chord(&self.next, pair, enclosing)
        })
    }

    /// Settles `next` at coordinates: from a configuration, or by following the last equilibrium.
    fn settle_next(&mut self, at: &[f64], from: Option<&Configuration>) -> Result<(), Halt> {
        match from {
            Some(_) => self.settle(at, from),
            None => self.solve(at, |settler, command, loads| {
                settler.follow(command, loads);
            }),
        }
    }

    fn settle(&mut self, at: &[f64], near: Option<&Configuration>) -> Result<(), Halt> {
        self.strayed = true;
        self.solve(at, |settler, command, loads| {
            match near {
                Some(near) => settler.settle_from(near, command, loads),
                None => settler.settle(command, loads),
            };
        })
    }

    fn solve(
        &mut self,
        at: &[f64],
        solve: impl FnOnce(&mut Settler, &tdcr_sim::robot::Command, &Loads),
    ) -> Result<(), Halt> {
        self.settled += 1;
        let Ok(stance) = self.space.stance(at) else {
            return Err(Halt::Unsettled);
        };
        solve(&mut self.settler, &stance.command, &self.loads);
        let found = self.settler.equilibrium();
        if !found.converged
            || !matches!(
                found.stability,
                Some(Stability::Stable | Stability::Neutral)
            )
        {
            return Err(Halt::Unsettled);
        }
        self.next.take(at, self.space.shift(at), found);
        let cap = ARC * self.stride;
        let mut margins = std::mem::take(&mut self.next.margins);
        self.surroundings
            .margins(self.next.placed(), self.rules.clearance, cap, &mut margins);
        self.next.margins = margins;
        let mut gaps = std::mem::take(&mut self.next.gaps);
        self.surroundings.gaps(self.next.placed(), &mut gaps);
        self.next.gaps = gaps;
        let [least, most] = self.rules.tension;
        let beyond = |tension: &f64| !(least..=most).contains(tension);
        match self.next.tensions.iter().position(beyond) {
            Some(tendon) => Err(Halt::Tension { tendon }),
            None => Ok(()),
        }
    }
}

//! Quasi-static paths with friction between the tendons and the holes they go through.
//!
//! A tendon that turns by the angle `theta` at a hole slips there only when its tension changes by a
//! factor `exp(mu theta)` (capstan law, Euler and Eytelwein). So its tension falls from hole to hole
//! when the servo pulls, and rises when it gives way; where the robot rests depends on how it came
//! there. A [`FrictionPath`] follows the robot along a sequence of commands, slow enough that inertia
//! and damping play no part.
//!
//! # Model
//!
//! Segment `j` of a tendon runs from waypoint `j` to `j + 1` of its route, `l_j` long, with tension
//! `T_j`; `T_0` is what its drive gives at the tendon's whole length. At the interior hole `h` between
//! segments `h - 1` and `h` the contact bears the friction force `f_h = T_(h-1) - T_h`, within the
//! cone `T_(h-1) (1 - exp(mu theta_h)) <= f_h <= T_(h-1) (1 - exp(-mu theta_h))`, `theta_h` the angle
//! between the two segments. The tendon's own stretch is counted in its drive: being fastened at its
//! last hole, it moves through hole `h` towards the servo by as much as `sum_(j >= h) l_j` shrinks. A
//! contact deflects by `z_h` as the tendon moves, with `f_h = sigma z_h`, `sigma` the
//! [contact stiffness](crate::robot::Friction); beyond the cone it slips, and `f_h` stays at the bound.
//! The tension of a segment so depends on the slip at all holes before it, and there is no potential. The law is
//! elastoplasticity by return mapping (Simo and Hughes, Computational Inelasticity, ch. 1):
//! contacts store energy and dissipate it, and never create any. A tendon that does not pull has no
//! friction.
//!
//! # Path
//!
//! Nothing depends on how fast commands follow one another, but the way counts: between two commands
//! it is the straight line, in loads as in commands. It is cut into substeps over which no joint turns
//! by more than [`FrictionPath::with_resolution`] says.
//!
//! Where no substep however small has an equilibrium nearby, the robot snaps elsewhere, faster than
//! quasi-statics can follow: it buckles, or a contact that starts to slip leaves it unstable
//! (stick-slip). There it slides on as if damping in its joints were all that held it back, until it
//! rests again; the state counts the snaps and the energy lost in them. A robot's inertia may carry it
//! further than that. Snaps that follow one another lead on twice as far each: contacts that chatter do
//! so all the way. Where it comes to no rest the path stays, and says `converged: false`.
//!
//! ```
//! use tdcr_sim::tendon_friction::FrictionPath;
//! use tdcr_sim::robot::{Backbone, Friction, Loads, PerDisc, Robot, RobotSpec};
//!
//! let mut spec = RobotSpec::standard("2m").expect("a standard robot");
//! for module in &mut spec.modules {
//!     module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(0.2)));
//!     if let Some(tendons) = &mut module.tendons {
//!         tendons.friction = Some(Friction { coefficient: 0.1, contact_stiffness: 1e5 });
//!     }
//! }
//! let robot = Robot::new(spec)?;
//! let mut path = FrictionPath::new(&robot);
//! let pull = |first: f64| robot.command(&[first, 0.03, 0.03, 0.03, 0.03, 0.03]);
//! path.start(&pull(0.03)?, &Loads::default());
//! let pulling = path.advance(&pull(0.02)?, &Loads::default()).equilibrium.positions[9];
//! path.advance(&pull(0.01)?, &Loads::default());
//! let state = path.advance(&pull(0.02)?, &Loads::default());
//! assert!(state.equilibrium.converged && state.dissipated > 0.0);
//! // Under the same command the robot rests elsewhere than on the way there.
//! assert!((state.equilibrium.positions[9] - pulling).norm() > 1e-3);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod among;
mod balance;
mod differentiated;
mod snap;
mod tangent;

use crate::capstan::Work;
pub use crate::capstan::{SlipState, TendonProfile};
use crate::contact::Touching;
use crate::robot::{Command, Loads, Robot};
use crate::solve::{Continuation, turn_between};
use crate::statics::{Equilibrium, Settler};
pub use among::ContactPath;
use balance::Balance;
use tangent::Law;
pub(crate) use tangent::Tangents;

/// Turn of a joint in one substep (rad) unless another is asked for.
const RESOLUTION: f64 = 0.02;
/// Smallest part of the way to a command that is tried in one substep.
const MIN_SUBSTEP: f64 = 1e-5;
/// Largest part of the way that is left to a snap.
const MAX_SNAP: f64 = 0.02;

/// Where a path has come to.
#[derive(Clone, Debug, PartialEq)]
pub struct FrictionState {
    /// Where the robot rests. `tendon_tensions` are those at the servos, `iterations` the Newton
    /// steps since the last command, and `converged` says that the residual is within
    /// [`Robot::moment_tolerance`]; unlike in the statics without friction it says nothing about
    /// stability, and `stability` is `None`. Where a path could not reach its command, this is the last
    /// equilibrium on the way, with the residual that the command leaves there and `converged` false.
    pub equilibrium: Equilibrium,
    /// Each tendon along its route.
    pub tendons: Vec<TendonProfile>,
    /// Energy turned into heat at the holes since the start (J).
    pub dissipated: f64,
    /// Elastic energy in the sticking contacts (J).
    pub stored: f64,
    /// Snaps since the start: motions too fast for quasi-statics.
    pub snaps: usize,
    /// Energy lost in snaps since the start (J).
    pub snapped: f64,
    /// Work done on the tendons at their servos since the start (J): the integral of `-T_0 dL`. The
    /// energy in a drive's gain or a tendon's stretch belongs to the servo's side.
    pub servo_work: f64,
    /// Substeps taken since the last command.
    pub substeps: usize,
}

/// Follows a robot along a sequence of commands, with friction in its tendons' holes.
#[derive(Clone, Debug)]
pub struct FrictionPath {
    settler: Settler,
    balance: Balance,
    resolution: f64,
    /// The command (m or N) and the loads of the last equilibrium; none before the start.
    reached: Option<(Vec<f64>, Loads)>,
    state: FrictionState,
    /// What the robot touches; none where there is nothing to.
    touching: Option<Box<Touching>>,
    /// How it changes with what it depends on.
    pub(crate) tangents: Option<Tangents>,
}

impl FrictionPath {
    /// Prepares to follow `robot`.
    pub fn new(robot: &Robot) -> Self {
        let balance = Balance::new(robot);
        Self {
            settler: Settler::new(robot),
            state: FrictionState {
                equilibrium: Equilibrium::unsettled(robot),
                tendons: balance.profiles.clone(),
                dissipated: 0.0,
                stored: 0.0,
                snaps: 0,
                snapped: 0.0,
                servo_work: 0.0,
                substeps: 0,
            },
            balance,
            resolution: RESOLUTION,
            reached: None,
            touching: None,
            tangents: None,
        }
    }

    /// The same with substeps over which no joint turns by more than `turn` (rad; 0.02 otherwise).
    /// What a path dissipates is accurate to second order in it.
    ///
    /// # Panics
    /// If `turn` is not positive.
    pub fn with_resolution(mut self, turn: f64) -> Self {
        assert!(turn > 0.0, "the resolution is {turn} rad; expected above 0");
        self.resolution = turn;
        self
    }

    /// Starts a path from the equilibrium without friction under `command` and `loads`, with no
    /// contact loaded: as [`Robot::settle`].
    ///
    /// # Panics
    /// As [`Settler::settle`].
    pub fn start(&mut self, command: &Command, loads: &Loads) -> &FrictionState {
        self.settle(command, loads);
        self.begin(command, loads);
        &self.state
    }

    /// Begins a path where the robot has settled.
    fn begin(&mut self, command: &Command, loads: &Loads) {
        let tensions = &self.state.equilibrium.tendon_tensions;
        for (line, (profile, tension)) in
            (self.balance.lines.iter()).zip(self.state.tendons.iter_mut().zip(tensions))
        {
            profile.relax(line, *tension);
        }
        self.state.dissipated = 0.0;
        self.state.stored = 0.0;
        (self.state.snaps, self.state.snapped) = (0, 0.0);
        self.state.servo_work = 0.0;
        self.begin_tangents(command.as_slice(), loads);
        if let Some(tangents) = &mut self.tangents {
            tangents.arrive(1.0);
        }
    }

    /// Leads the robot along the straight line from the last command and loads to these. The first
    /// call on a new path starts it.
    ///
    /// Never fails in silence: look at [`Equilibrium::converged`]. After a failure the path goes on
    /// from the last equilibrium that it reached.
    ///
    /// Without friction in any hole this is [`Settler::settle`].
    ///
    /// # Panics
    /// As [`Settler::settle`].
    pub fn advance(&mut self, command: &Command, loads: &Loads) -> &FrictionState {
        match self.reached.take() {
            None => self.start(command, loads),
            Some(_) if self.is_frictionless() && self.tangents.is_none() => {
                self.settle(command, loads);
                let before = self.state.tendons.clone();
                let tensions = &self.state.equilibrium.tendon_tensions;
                for (t, profile) in self.state.tendons.iter_mut().enumerate() {
                    profile.follow(&self.balance.lines[t], &before[t], tensions[t]);
                }
                self.account(&before);
                &self.state
            }
            Some(from) => self.follow(from, command, loads),
        }
    }

    /// The robot.
    pub fn robot(&self) -> &Robot {
        self.settler.robot()
    }

    /// Where the path has come to.
    pub fn state(&self) -> &FrictionState {
        &self.state
    }

    fn is_frictionless(&self) -> bool {
        let lines = &self.balance.lines;
        lines.iter().all(|line| line.friction.coefficient == 0.0)
    }

    /// Settles without friction; leaves the tendons' profiles as they are.
    fn settle(&mut self, command: &Command, loads: &Loads) {
        self.settler.settle(command, loads);
        self.state
            .equilibrium
            .clone_from(self.settler.equilibrium());
        self.arrive(command, loads);
    }

    /// Takes the equilibrium of the state for where the path is.
    fn arrive(&mut self, command: &Command, loads: &Loads) {
        self.state.substeps = 1;
        let at = &self.state.equilibrium.configuration;
        self.balance.start_at(at);
        self.reached = Some((command.as_slice().to_vec(), loads.clone()));
    }

    fn follow(
        &mut self,
        from: (Vec<f64>, Loads),
        command: &Command,
        loads: &Loads,
    ) -> &FrictionState {
        let goal = command.as_slice();
        // The turn at which strides aim.
        let aim = 0.8 * self.resolution;
        let mut continuation = Continuation::new(1.0, MIN_SUBSTEP);
        let mut reached = from.clone();
        let mut arrived = 0.0;
        // Longer where one snap follows another: contacts that chatter do so all the way.
        let mut least = MIN_SUBSTEP;
        (self.state.substeps, self.state.equilibrium.iterations) = (0, 0);
        self.state.equilibrium.converged = true;
        self.state.equilibrium.stability = None;
        (
            self.state.equilibrium.examined,
            self.state.equilibrium.growth,
        ) = (None, None);
        while let Some(part) = continuation.target() {
            let between = if part == 1.0 {
                goal.to_vec()
            } else {
                let pairs = from.0.iter().zip(goal);
                pairs.map(|(from, to)| from + part * (to - from)).collect()
            };
            let loaded = from.1.towards(loads, part);
            match self.substep(&between, &loaded) {
                Some(turn) if turn <= self.resolution => {
                    continuation.succeed(f64::clamp(aim / turn, 1.0, 2.0));
                    least = f64::max(0.25 * least, MIN_SUBSTEP);
                    self.accept();
                    self.carry(part, Law::Capstan);
                }
                _ if continuation.stride <= least => {
                    if !self.snap(&between, &loaded) {
                        self.give_up(goal, loads);
                        break;
                    }
                    continuation.succeed(2.0);
                    least = f64::min(continuation.stride, MAX_SNAP);
                    self.carry(part, Law::Given);
                }
                turn => {
                    self.retreat();
                    continuation.fail(turn.map_or(0.25, |turn| f64::clamp(aim / turn, 0.1, 0.8)));
                    continuation.stride = continuation.stride.max(MIN_SUBSTEP);
                    continue;
                }
            }
            reached = (between, loaded);
            arrived = part;
        }
        if let Some(tangents) = &mut self.tangents {
            tangents.arrive(arrived);
        }
        self.reached = Some(reached);
        &self.state
    }

    /// Tries the step from the last equilibrium to this command (m or N) and these loads. Returns the
    /// largest turn of a joint (rad), or `None` if the solve failed.
    fn substep(&mut self, command: &[f64], loads: &Loads) -> Option<f64> {
        self.balance.load(command, loads, &self.state.tendons);
        let (solved, iterations) = match self.touching {
            None => self.balance.solve(command, &self.state.tendons),
            Some(_) => self.solve_among(command),
        };
        self.state.equilibrium.iterations += iterations;
        let turn = || {
            turn_between(
                &self.state.equilibrium.configuration,
                &self.balance.iterate.configuration,
            )
        };
        solved.then(turn)
    }

    /// Takes over what the balance has come to.
    fn accept(&mut self) {
        let balance = &self.balance;
        let out = &mut self.state.equilibrium;
        out.take_over(&balance.iterate.configuration, &balance.iterate.posture);
        for (tension, profile) in out.tendon_tensions.iter_mut().zip(&balance.profiles) {
            *tension = profile.tensions[0];
        }
        out.residual = balance.residual();
        if let Some(touching) = &mut self.touching {
            touching.accept();
        }
        self.state.substeps += 1;
        let before = std::mem::replace(&mut self.state.tendons, balance.profiles.clone());
        self.account(&before);
    }

    /// Goes back to the last equilibrium.
    fn retreat(&mut self) {
        let configuration = self.state.equilibrium.configuration.clone();
        self.balance.start_at(&configuration);
        if let Some(touching) = &mut self.touching {
            touching.begin();
            let pressing = touching.press(&configuration);
            self.balance.pressing.clone_from(pressing);
        }
    }

    /// Says what the command leaves unbalanced in the last equilibrium.
    fn give_up(&mut self, command: &[f64], loads: &Loads) {
        self.retreat();
        self.balance.load(command, loads, &self.state.tendons);
        self.balance.follow(&self.state.tendons);
        self.state.equilibrium.residual = self.balance.residual();
        self.state.equilibrium.converged = false;
    }

    /// Adds up the energy of the step from `before`.
    fn account(&mut self, before: &[TendonProfile]) {
        let state = &mut self.state;
        state.stored = 0.0;
        for (line, (profile, before)) in
            (self.balance.lines.iter()).zip(state.tendons.iter().zip(before))
        {
            let Work { servo, dissipated } = profile.work(line, before);
            state.servo_work += servo;
            state.dissipated += dissipated;
            state.stored += profile.stored(line);
        }
    }
}

//! From near an equilibrium among obstacles to it.

use super::{ContactSettler, Start};
use crate::chain::Configuration;
use crate::contact::active::Active;
use crate::contact::law::Hardness;
use crate::contact::mixed::Mixed;
use crate::contact::rubbing::Grip;
use crate::energy::Potential;
use crate::robot::Loads;
use crate::solve::{Continuation, newton, turn_between};
use crate::statics::Stability;

/// The first barrier (J) where a configuration near the equilibrium is given and does not lead there at once, for each N m of the
/// tolerance.
const NEAR_BARRIER: f64 = 1e1;
/// The share of it that the next one is.
const NEXT: f64 = 0.03;
/// Residual (N m) at which a barrier (J) that is not the last counts as solved.
const LOOSE_BARRIER: f64 = 100.0;
/// The least part of the way from the last equilibrium that is tried at once.
const LEAST_PART: f64 = 1.0 / 32.0;
/// The same with friction.
const LEAST_RUBBING: f64 = 1.0 / 8.0;
/// Largest turn of a joint in one of those parts (rad): a longer way leads to another branch.
const MAX_TURN: f64 = 0.1;

impl ContactSettler {
    /// Solves from near the solution. From the last equilibrium, whose contacts' forces are known, by the balance with an active
    /// set where nothing rubs; or else down the energy, at once or under barriers that fall to the last, each solve starting from
    /// the one before (Nocedal and Wright, Numerical Optimization, ch. 19.1). Whether it is solved, and the number of steps.
    pub(super) fn descend_near(&mut self, from: Start) -> (bool, usize) {
        let last = Hardness::of_barrier(self.last_barrier());
        let start = self.equations.iterate.configuration.clone();
        let mixed = match from {
            Start::Before if self.equations.bristles.is_empty() => self.balance().1,
            _ => 0,
        };
        let (solved, steps) = self.descend(last, self.tolerance);
        let mut iterations = mixed + steps;
        if solved && mixed > 0 && steps > 0 {
            return (solved, iterations);
        }
        if solved {
            return self.refine(solved, iterations);
        }
        self.go_back(&start);
        let mut barrier = NEAR_BARRIER * self.tolerance;
        while barrier > last.barrier * (1.0 + 1e-9) {
            let loose = self.tolerance.max(LOOSE_BARRIER * barrier);
            iterations += self.descend(Hardness::of_barrier(barrier), loose).1;
            barrier = last.barrier.max(NEXT * barrier);
        }
        let (solved, steps) = self.descend(last, self.tolerance);
        (solved, iterations + steps)
    }

    /// Solves the balance without a barrier, at once or along the way of commands and loads from the last equilibrium. Whether it is solved,
    /// and the number of steps; where it is not the robot stays.
    fn balance(&mut self) -> (bool, usize) {
        let from = self.equations.iterate.configuration.clone();
        let (solved, iterations) = self.balance_at_once();
        if solved {
            return (true, iterations);
        }
        self.go_back(&from);
        let (led, steps) = self.balance_in_parts();
        if !led {
            self.go_back(&from);
        }
        (led, iterations + steps)
    }

    /// Solves the balance with friction of contacts, which resists sliding from where its bristles stick. Where that leads nowhere both the
    /// robot and the bristles stay. Whether it is solved, and the number of steps.
    pub(super) fn balance_rubbing(&mut self) -> (bool, usize) {
        let from = self.equations.iterate.configuration.clone();
        let anchored = self.equations.bristles.clone();
        let hardness = self.equations.hardness;
        self.equations.find();
        let mut grip = Grip {
            active: Active::lawful(&self.equations),
            bristles: anchored.clone(),
        };
        let (mut led, iterations) = self.rub_in_parts(&mut grip);
        if led {
            let robot = self.equations.robot.clone();
            self.equations.expand_pressed(&Potential {
                robot: &robot,
                command: &self.command,
                dead: &self.weight,
            });
            led = self.equations.stability() != Stability::Unstable;
        }
        if !led {
            self.go_back(&from);
            self.equations.set_hardness(hardness, self.tolerance);
            self.equations.bristles = anchored;
        }
        (led, iterations)
    }

    /// Solves the balance with friction along the way from the last equilibrium, in parts that are solved at once: `grip` is that of where the
    /// last of them begins. What resists sliding moves on with parts that are solved alone.
    fn rub_in_parts(&mut self, grip: &mut Grip) -> (bool, usize) {
        let parts = Continuation::new(1.0, LEAST_RUBBING);
        self.in_parts(parts, |settler, part, start| {
            let (solved, steps) = settler.rub_at_once(grip);
            let turned = turn_between(start, &settler.equations.iterate.configuration);
            let led = solved && turned <= MAX_TURN;
            if led && part < 1.0 {
                *grip = Grip::at(&mut settler.equations);
            }
            (led, steps)
        })
    }

    /// Leads the robot along the way of commands and loads from the last equilibrium, in parts of which each is solved by `solve`: given how far
    /// the part goes and where the robot was before it, whether that led there and the number of steps. Whether the whole way is gone.
    fn in_parts(
        &mut self,
        mut parts: Continuation,
        mut solve: impl FnMut(&mut Self, f64, &Configuration) -> (bool, usize),
    ) -> (bool, usize) {
        let (goal, from) = (self.command.clone(), self.before.clone());
        let (mut led, mut iterations) = (true, 0);
        while let Some(part) = parts.target() {
            let start = self.equations.iterate.configuration.clone();
            self.go_to_part(&from, &goal, part);
            let (solved, steps) = solve(self, part, &start);
            iterations += steps;
            if solved {
                parts.succeed(2.0);
                continue;
            }
            self.go_back(&start);
            if !parts.fail(0.5) {
                led = false;
                break;
            }
        }
        self.command = goal;
        self.weight.set(&self.equations.robot, &self.loads);
        (led, iterations)
    }

    /// The balance with friction from where the equations stand, with the grip that they have there.
    fn rub_at_once(&mut self, grip: &Grip) -> (bool, usize) {
        let equations = &mut self.equations;
        equations.tolerance = self.tolerance;
        let robot = equations.robot.clone();
        let potential = Potential {
            robot: &robot,
            command: &self.command,
            dead: &self.weight,
        };
        newton(&mut Mixed::along(
            equations,
            &potential,
            &mut self.active,
            grip,
        ))
    }

    /// Takes the command and the loads at a part of the way from the last equilibrium.
    fn go_to_part(&mut self, from: &(Vec<f64>, Loads), goal: &[f64], part: f64) {
        let ways = self.command.iter_mut().zip(from.0.iter().zip(goal));
        ways.for_each(|(at, (from, to))| *at = from + part * (to - from));
        let loads = from.1.towards(&self.loads, part);
        self.weight.set(&self.equations.robot, &loads);
    }

    /// Goes back to where a solve began that led nowhere.
    fn go_back(&mut self, to: &Configuration) {
        self.equations.iterate.set(to);
        self.equations.neighbourhood.clear();
        self.equations.is_found = false;
    }

    /// The balance along the way of commands and loads from the last equilibrium, in parts of it that are solved at once.
    fn balance_in_parts(&mut self) -> (bool, usize) {
        let parts = Continuation::new(0.5, LEAST_PART);
        self.in_parts(parts, |settler, _, _| settler.balance_at_once())
    }

    /// The balance from where the equations stand.
    fn balance_at_once(&mut self) -> (bool, usize) {
        let equations = &mut self.equations;
        equations.tolerance = self.tolerance;
        let robot = equations.robot.clone();
        let potential = Potential {
            robot: &robot,
            command: &self.command,
            dead: &self.weight,
        };
        newton(&mut Mixed::new(equations, &potential, &mut self.active))
    }

    /// One step more where a solve among contacts has taken any: the residual that counts as solved leaves more error along the soft
    /// directions than differences of equilibria near each other can bear. Whether that is solved, and the number of all steps.
    pub(super) fn refine(&mut self, solved: bool, iterations: usize) -> (bool, usize) {
        let hardness = self.equations.hardness;
        let is_done = !solved || iterations == 0 || self.equations.is_alone();
        if is_done || !self.equations.predict(hardness) {
            return (solved, iterations);
        }
        let (solved, steps) = self.descend(hardness, self.tolerance);
        (solved, iterations + 1 + steps)
    }
}

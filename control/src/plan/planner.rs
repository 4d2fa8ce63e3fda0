//! From a start and a goal to a plan.

use std::time::Instant;

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::chain::Configuration;
use tdcr_sim::robot::{Loads, Robot};
use tdcr_sim::scene::Scene;

use super::error::{Limit, PlanError, Refusal};
use super::goal;
use super::search::Search;
use super::shorten::{Stop, holds, shorten, trace};
use super::smooth::smooth;
use super::space::{Insertion, Space, Stance};
use super::surroundings::{Near, Surroundings};
use super::tree::Tree;
use super::walk::{Halt, Place, Rules, Walker};

/// How to plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanSettings {
    /// Least distance of the discs from obstacles (m), 0 or above: all along the way, between the steps, too.
    pub clearance: f64,
    /// Least and largest tension of the tendons (N).
    pub tension: [f64; 2],
    /// A base that moves along its axis, too.
    pub insertion: Option<Insertion>,
    /// Seed of the search. For one seed the plan is the same, unless time ends the search.
    pub seed: u64,
    /// Places that the search reaches at most.
    pub nodes: usize,
    /// Time that the search takes at most (s).
    pub seconds: f64,
}

impl Default for PlanSettings {
    fn default() -> Self {
        Self {
            clearance: 0.002,
            tension: [f64::NEG_INFINITY, f64::INFINITY],
            insertion: None,
            seed: 0,
            nodes: 100_000,
            seconds: 10.0,
        }
    }
}

impl PlanSettings {
    fn check(&self) -> Result<(), PlanError> {
        let refuse = |field, found: String, expected| {
            Err(PlanError::Setting {
                field,
                found,
                expected,
            })
        };
        if !(self.clearance >= 0.0 && self.clearance.is_finite()) {
            return refuse(
                "clearance",
                format!("{} m", self.clearance),
                "a length of 0 or above",
            );
        }
        let [least, most] = self.tension;
        if least.is_nan() || most.is_nan() || least > most {
            let found = format!("{least} to {most} N");
            return refuse("tension", found, "two tensions, the smaller first");
        }
        if let Some(Insertion { range: [low, high] }) = self.insertion
            && !(low.is_finite() && high.is_finite() && low <= high)
        {
            let found = format!("{low} to {high} m");
            return refuse("insertion", found, "two lengths, the smaller first");
        }
        if self.seconds.is_nan() || self.seconds <= 0.0 {
            return refuse("seconds", self.seconds.to_string(), "a time above 0");
        }
        Ok(())
    }
}

/// Where a plan ends.
#[derive(Clone, Debug, PartialEq)]
pub enum Goal {
    /// Under a command, at the equilibrium that the robot settles in from the straight pose.
    Stance(Stance),
    /// With the tip disc's origin at a point in the world (m), under any command.
    Tip(Vector3<f64>),
}

/// A motion, by steps that are to be gone in a straight line from one to the next.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionPlan {
    /// From the start to the goal.
    pub steps: Vec<PlanStep>,
    /// What it took.
    pub effort: Effort,
}

/// A step of a plan.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanStep {
    /// The command, and where the base is.
    pub stance: Stance,
    /// Rotation of each disc relative to the body below.
    pub configuration: Configuration,
    /// Origin of the tip disc, world frame (m).
    pub tip: Vector3<f64>,
    /// Origins of all discs, world frame (m).
    pub positions: Vec<Vector3<f64>>,
    /// Distance of the discs from the nearest obstacle at least (m); `None` without obstacles.
    pub clearance: Option<f64>,
    /// Tension of each tendon (N).
    pub tensions: Vec<f64>,
}

/// What a plan took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effort {
    /// Places that were reached.
    pub nodes: usize,
    /// Equilibria that were solved for.
    pub settled: usize,
    /// Time (s).
    pub seconds: f64,
}

/// Plans motions of one robot in one scene.
#[derive(Clone, Debug)]
pub struct MotionPlanner {
    robot: Robot,
    loads: Loads,
    settings: PlanSettings,
    walker: Walker,
}

impl MotionPlanner {
    /// Prepares to plan.
    ///
    /// # Errors
    /// [`PlanError::Setting`] for settings that make no sense, [`PlanError::Loads`] for loads of another robot.
    pub fn new(
        robot: &Robot,
        scene: &Scene,
        loads: &Loads,
        settings: PlanSettings,
    ) -> Result<Self, PlanError> {
        settings.check()?;
        loads.check(robot)?;
        let space = Space::new(robot, settings.insertion);
        let rules = Rules {
            clearance: settings.clearance,
            tension: settings.tension,
        };
        let surroundings = Surroundings::new(robot, scene);
        Ok(Self {
            robot: robot.clone(),
            loads: loads.clone(),
            settings,
            walker: Walker::new(robot, space, surroundings, rules, loads),
        })
    }

    /// The robot.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// The motion from a start to a goal. Both are equilibria that the robot settles in from the straight pose.
    ///
    /// # Errors
    /// [`PlanError::Start`] and [`PlanError::Goal`] where the robot may not be there, [`PlanError::NoGoal`] where no command brings the tip there,
    /// [`PlanError::NotFound`] where the search ends without a plan, [`PlanError::Command`] for a command of another robot.
    pub fn plan(&mut self, from: &Stance, to: &Goal) -> Result<MotionPlan, PlanError> {
        self.plan_while(from, to, |_| true)
    }

    /// The same as long as `go_on` says so, which is asked between extensions of the search, with the number of places reached.
    ///
    /// # Errors
    /// As [`plan`](Self::plan); [`PlanError::Interrupted`] after it was told to stop.
    pub fn plan_while(
        &mut self,
        from: &Stance,
        to: &Goal,
        go_on: impl Fn(usize) -> bool,
    ) -> Result<MotionPlan, PlanError> {
        let began = Instant::now();
        let settled = self.walker.settled;
        let start = self.end(from)?.map_err(PlanError::Start)?;
        let goals = match to {
            Goal::Stance(stance) => vec![self.end(stance)?.map_err(PlanError::Goal)?],
            Goal::Tip(target) => self.commands_for(*target, &go_on)?,
        };
        let (way, nodes) = self.search(&start, &goals, began, &go_on)?;
        let mut steps = self.steps(&way)?;
        // But for the rounding of coordinates they are these.
        if let Some(first) = steps.first_mut() {
            first.stance = from.clone();
        }
        if let (Some(last), Goal::Stance(stance)) = (steps.last_mut(), to) {
            last.stance = stance.clone();
        }
        Ok(MotionPlan {
            steps,
            effort: Effort {
                nodes,
                settled: self.walker.settled - settled,
                seconds: began.elapsed().as_secs_f64(),
            },
        })
    }

    /// Where the robot rests under a stance, from the straight pose, and how far from obstacles: whether it may be there or not.
    ///
    /// # Errors
    /// [`PlanError::Start`] where it does not settle, [`PlanError::Command`] for a command of another robot.
    pub fn examine(&mut self, stance: &Stance) -> Result<PlanStep, PlanError> {
        match self.end(stance)? {
            Err(Refusal::Unsettled) => Err(PlanError::Start(Refusal::Unsettled)),
            _ => Ok(self.step_here(stance.clone())),
        }
    }

    /// Where a robot rests under a stance, or why it may not be there.
    fn end(&mut self, stance: &Stance) -> Result<Result<Stop, Refusal>, PlanError> {
        self.robot.command(stance.command.as_slice())?;
        let at = self.walker.space.coordinates(stance);
        if at.iter().any(|x| !(0.0..=1.0).contains(x))
            || (at.len() == stance.command.as_slice().len() && stance.insertion != 0.0)
        {
            let [low, high] = self.settings.insertion.map_or([0.0; 2], |i| i.range);
            return Err(PlanError::Setting {
                field: "the insertion of an end",
                found: format!(
                    "{} m where the base moves from {low} to {high} m",
                    stance.insertion
                ),
                expected: "one in that range",
            });
        }
        Ok(match self.walker.stand(&at, None) {
            Ok(()) => Ok(stop(self.walker.here())),
            Err(halt) => Err(self.refusal(halt, &at)),
        })
    }

    /// Why a robot may not be at coordinates where it was refused.
    fn refusal(&self, halt: Halt, at: &[f64]) -> Refusal {
        let [least, most] = self.settings.tension;
        match halt {
            Halt::Unsettled | Halt::Jump => Refusal::Unsettled,
            Halt::Tension { tendon } => Refusal::Tension {
                tendon,
                tension: self.walker.here().tensions[tendon],
                least,
                most,
            },
            Halt::Near => {
                let surroundings = &self.walker.surroundings;
                let here = self.walker.here();
                debug_assert_eq!(here.at, at, "it was refused where it stands");
                let clearance = self.settings.clearance;
                let touching = surroundings.touching_discs(here.placed());
                let nearest = surroundings.closest_obstacle(here.placed());
                let obstacle = nearest.filter(|found| found.distance < clearance);
                match obstacle.or(touching) {
                    Some(found) => match found.partner {
                        Near::Obstacle(number) => Refusal::Obstacle {
                            disc: found.disc,
                            obstacle: surroundings.scene().obstacles()[number].name.clone(),
                            distance: found.distance,
                            clearance,
                        },
                        Near::Disc(other) => Refusal::Touching {
                            discs: [found.disc, other],
                        },
                    },
                    None => Refusal::Unsettled,
                }
            }
        }
    }

    /// Equilibria with the tip at a target where the robot may be.
    fn commands_for(
        &mut self,
        target: Vector3<f64>,
        go_on: &impl Fn(usize) -> bool,
    ) -> Result<Vec<Stop>, PlanError> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.settings.seed);
        rng.set_stream(1);
        let mut starts =
            goal::Starts::new(&self.robot, &self.loads, self.settings.insertion, target)?;
        let (mut tried, mut reached, mut last) = (0, 0, None);
        let mut goals: Vec<Stop> = Vec::new();
        while tried < goal::MOST_SEARCHES && goals.len() < goal::ENOUGH {
            if !go_on(0) {
                return Err(PlanError::Interrupted);
            }
            tried += 1;
            let Some(stance) = starts.next(&mut rng)? else {
                continue;
            };
            reached += 1;
            match self.end(&stance)? {
                Ok(found) => goals.push(found),
                Err(refusal) => last = Some(refusal),
            }
        }
        match goals.is_empty() {
            false => Ok(goals),
            true => Err(PlanError::NoGoal {
                target: target.into(),
                tried,
                reached,
                last,
            }),
        }
    }

    /// A way that holds, and how many nodes it took.
    fn search(
        &mut self,
        start: &Stop,
        goals: &[Stop],
        began: Instant,
        go_on: &impl Fn(usize) -> bool,
    ) -> Result<(Vec<Stop>, usize), PlanError> {
        let PlanSettings {
            nodes: most,
            seconds,
            seed,
            ..
        } = self.settings;
        let trees = [std::slice::from_ref(start), goals].map(|roots| {
            let mut tree = Tree::new(start.at.len());
            for root in roots {
                tree.plant(&root.at, &root.configuration);
            }
            tree
        });
        let mut search = Search::new(&mut self.walker, trees, seed);
        let mut met = search.straight();
        let mut grown = 0;
        loop {
            if let Some(met) = met {
                let corners = search.corners(met);
                let way = trace(search.walker, &corners);
                match way.and_then(|way| finished(search.walker, way, seed)) {
                    Ok(way) => return Ok((way, search.nodes())),
                    Err(halt) => search.halts.count(halt),
                }
            }
            let time = began.elapsed().as_secs_f64();
            let limit = match (search.nodes() >= most, time >= seconds) {
                (true, _) => Some(Limit::Nodes),
                (_, true) => Some(Limit::Seconds),
                _ => None,
            };
            if let Some(limit) = limit {
                return Err(PlanError::NotFound {
                    limit,
                    nodes: search.nodes(),
                    seconds: time,
                    halts: search.halts,
                });
            }
            if !go_on(search.nodes()) {
                return Err(PlanError::Interrupted);
            }
            met = search.grow(grown);
            grown = 1 - grown;
        }
    }

    /// What a way consists of.
    fn steps(&mut self, way: &[Stop]) -> Result<Vec<PlanStep>, PlanError> {
        let mut steps = Vec::with_capacity(way.len());
        for stop in way {
            let stance = self.walker.space.stance(&stop.at)?;
            // It has stood there before.
            let _ = self.walker.stand(&stop.at, Some(&stop.configuration));
            steps.push(self.step_here(stance));
        }
        Ok(steps)
    }

    /// Where it stands.
    fn step_here(&self, stance: Stance) -> PlanStep {
        let here = self.walker.here();
        let closest = self.walker.surroundings.closest_obstacle(here.placed());
        let positions: Vec<_> = here.positions.iter().map(|p| p + here.shift).collect();
        PlanStep {
            stance,
            configuration: here.configuration.clone(),
            tip: positions[positions.len() - 1],
            positions,
            clearance: closest.map(|found| found.distance),
            tensions: here.tensions.clone(),
        }
    }
}

/// A way without needless length and corners that holds: where the rounded one does not, that with corners.
fn finished(walker: &mut Walker, way: Vec<Stop>, seed: u64) -> Result<Vec<Stop>, Halt> {
    let short = shorten(walker, way, seed);
    let smooth = smooth(walker, short.clone());
    match holds(walker, &smooth) {
        Ok(()) => Ok(smooth),
        Err(_) => holds(walker, &short).map(|()| short),
    }
}

fn stop(place: &Place) -> Stop {
    Stop {
        at: place.at.clone(),
        configuration: place.configuration.clone(),
    }
}

//! Drawing commands by chance.

use std::f64::consts::TAU;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use tdcr_sim::robot::Command;

use super::error::PlanError;
use super::path::Planner;
use super::shape::{Bend, Shape};

/// Draws of one command before one gives up.
const MAX_DRAWS: usize = 1000;

/// Which commands are drawn: per module a bend in any direction and a tension that its tendons share.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CommandSettings {
    /// Largest bend of a module (rad): one for each module, or a single one for all.
    pub bend: Vec<f64>,
    /// Smallest and largest tension that a module's tendons share (N).
    pub co_contraction: [f64; 2],
    /// Smallest and largest tension (N) that the simulator may find in a tendon, under a command or on the way to it.
    pub tension: [f64; 2],
}

/// For tendons of the paper's simulated robots, which pull with 22 to 43 N.
impl Default for CommandSettings {
    fn default() -> Self {
        Self {
            bend: vec![0.9],
            co_contraction: [25.0, 38.0],
            tension: [5.0, 60.0],
        }
    }
}

impl CommandSettings {
    /// The first field that makes no sense for a robot of so many modules: its name, its value, and what would be right.
    pub fn fault(&self, modules: usize) -> Option<(&'static str, String, String)> {
        if self.bend.len() != 1 && self.bend.len() != modules {
            let expected = format!("one for each of the {modules} modules, or a single one");
            return Some(("bend", format!("{} entries", self.bend.len()), expected));
        }
        if let Some(bend) = self.bend.iter().find(|bend| !(0.0..=TAU).contains(*bend)) {
            return Some(("bend", bend.to_string(), "0 to 2 pi (rad)".to_owned()));
        }
        let ranges = [
            ("co_contraction", self.co_contraction),
            ("tension", self.tension),
        ];
        for (field, [low, high]) in ranges {
            if !(low.is_finite() && high.is_finite() && 0.0 <= low && low <= high) {
                let expected = "tensions of 0 or more, the smaller first (N)".to_owned();
                return Some((field, format!("[{low}, {high}]"), expected));
            }
        }
        None
    }

    /// A shape by chance: bends uniform over the disc of directions and angles, tensions uniform.
    fn draw(&self, modules: usize, rng: &mut ChaCha8Rng) -> Shape {
        let [low, high] = self.co_contraction;
        let bend = |module: usize| {
            let most = self.bend[if self.bend.len() == 1 { 0 } else { module }];
            let direction = TAU * rng.random::<f64>();
            let angle = most * rng.random::<f64>().sqrt();
            Bend::new(direction, angle, low + (high - low) * rng.random::<f64>())
        };
        Shape((0..modules).map(bend).collect())
    }
}

/// A command that was drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawn {
    /// What is asked of the modules.
    pub shape: Shape,
    /// The command (m).
    pub command: Command,
}

/// Draws commands that can be reached from a shape of rest.
#[derive(Clone, Debug)]
pub struct Draws {
    /// Which.
    pub settings: CommandSettings,
    /// Where each has to be reached from.
    pub rest: Shape,
    /// Seed.
    pub seed: u64,
}

impl Draws {
    /// Command `index`: a function of the settings, the seed, `index` and what the planners know alone. It can be reached from rest in
    /// a straight line, on which no tendon goes slack or is overloaded.
    ///
    /// # Errors
    /// [`PlanError::NoCommand`] where chance finds none.
    pub fn draw(&self, index: u64, planner: &mut Planner) -> Result<Drawn, PlanError> {
        self.draw_for_all(index, planner, &mut [])
    }

    /// The same for a robot that carries now this and now that: a command that can be reached by each of the planners.
    ///
    /// # Errors
    /// As [`draw`](Self::draw).
    pub fn draw_for_all(
        &self,
        index: u64,
        planner: &mut Planner,
        others: &mut [Planner],
    ) -> Result<Drawn, PlanError> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(index);
        let modules = planner.robot().spec().modules.len();
        let mut last = None;
        for _ in 0..MAX_DRAWS {
            let shape = self.settings.draw(modules, &mut rng);
            let mut reached = planner.straight(&self.rest, &shape);
            for other in others.iter_mut() {
                reached = reached.and_then(|path| other.straight(&self.rest, &shape).map(|_| path));
            }
            match reached {
                Ok(path) => {
                    let Some(command) = path.into_iter().next_back() else {
                        continue;
                    };
                    return Ok(Drawn { shape, command });
                }
                Err(error @ (PlanError::Shape(_) | PlanError::TooLong { .. })) => {
                    return Err(error);
                }
                Err(error) => last = Some(error),
            }
        }
        let last = last.unwrap_or(PlanError::NotSettled { part: 0.0 });
        Err(PlanError::NoCommand {
            draws: MAX_DRAWS,
            last: Box::new(last),
        })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;
    use tdcr_sim::robot::{Backbone, Drive, Loads, PerDisc, Pull, Robot, RobotSpec, Routing};

    /// As the paper's real robot: springs, tendons that stretch little and only pull, all of them from the base.
    fn real() -> Robot {
        let mut spec = RobotSpec::standard("2m").unwrap();
        spec.routing = Routing::Base;
        for module in &mut spec.modules {
            module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(0.6)));
            let tendons = module.tendons.as_mut().unwrap();
            tendons.drive = Drive::Gain(2e4);
            tendons.pull = Pull::TensionOnly;
            tendons.range = [0.0, 0.3];
        }
        Robot::new(spec).unwrap()
    }

    const TENSION: [f64; 2] = [1.0, 60.0];

    fn planner(robot: &Robot, rest: &Shape) -> (Planner, Vec<f64>) {
        let home = Shaper::new(robot).unwrap().commands(rest);
        let limits = home.iter().map(|c| [c - 0.03, c + 0.03]).collect();
        (Planner::new(robot, limits, TENSION, 5e-4).unwrap(), home)
    }

    use super::super::Shaper;

    #[test]
    fn drawn_commands_leave_no_tendon_slack_and_overload_none_and_uniform_ones_do() {
        let robot = real();
        let settings = CommandSettings {
            bend: vec![0.5, 0.7],
            co_contraction: [12.0, 25.0],
            tension: TENSION,
        };
        let rest = Shape(vec![Bend::new(0.0, 0.0, 12.0); 2]);
        let (mut planner, home) = planner(&robot, &rest);
        let draws = Draws {
            settings,
            rest,
            seed: 1,
        };
        let drawn: Vec<Drawn> = (0..40)
            .map(|k| draws.draw(k, &mut planner).unwrap())
            .collect();
        let survives = |command: &Command| {
            let settled = robot.settle(command, &Loads::default());
            let fits = |tension: &f64| (TENSION[0]..=TENSION[1]).contains(tension);
            settled.converged && settled.tendon_tensions.iter().all(fits)
        };
        assert!(drawn.iter().all(|drawn| survives(&drawn.command)));
        // Uniform in the box that the drawn commands span.
        let bounds: Vec<[f64; 2]> = (0..home.len())
            .map(|k| {
                let values = drawn.iter().map(|drawn| drawn.command.as_slice()[k]);
                let high = values.clone().fold(f64::MIN, f64::max);
                [values.fold(f64::MAX, f64::min), high]
            })
            .collect();
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut uniform = || {
            let values = bounds
                .iter()
                .map(|[low, high]| low + (high - low) * rng.random::<f64>());
            robot.command(&values.collect::<Vec<_>>()).unwrap()
        };
        let surviving = (0..200).filter(|_| survives(&uniform())).count();
        assert!(surviving < 100, "{surviving} of 200 survive");
        // The tendons that end higher pass the modules below, and have to follow their bends.
        let span = |k: usize| bounds[k][1] - bounds[k][0];
        let spans = [0, 3].map(|first| (first..first + 3).map(span).sum::<f64>());
        assert!(spans[1] > 1.2 * spans[0], "{spans:?}");
        // One command is not another, and each the same again.
        assert_ne!(drawn[0], drawn[1]);
        assert_eq!(draws.draw(7, &mut planner).unwrap(), drawn[7]);
    }

    #[test]
    fn paths_keep_tensions_and_steps() {
        let robot = real();
        let rest = Shape(vec![Bend::new(0.0, 0.0, 12.0); 2]);
        let (mut planner, home) = planner(&robot, &rest);
        let draws = Draws {
            settings: CommandSettings {
                bend: vec![0.5],
                co_contraction: [10.0, 30.0],
                tension: TENSION,
            },
            rest: rest.clone(),
            seed: 3,
        };
        let mut settler = tdcr_sim::statics::Settler::new(&robot);
        let (mut at, mut last) = (rest.clone(), home);
        settler.settle(&robot.command(&last).unwrap(), &Loads::default());
        for index in 0..8 {
            let next = draws.draw(index, &mut planner).unwrap();
            let path = planner.path(&at, &next.shape, &rest).unwrap();
            assert_eq!(path.last(), Some(&next.command));
            for command in &path {
                let moved = command
                    .as_slice()
                    .iter()
                    .zip(&last)
                    .map(|(a, b)| (a - b).abs());
                assert!(moved.fold(0.0, f64::max) <= 5e-4);
                let settled = settler.follow(command, &Loads::default());
                let [low, high] = [0.9 * TENSION[0], 1.1 * TENSION[1]];
                let fits = |tension: &f64| (low..=high).contains(tension);
                assert!(
                    settled.tendon_tensions.iter().all(fits),
                    "{:?}",
                    settled.tendon_tensions
                );
                last = command.as_slice().to_vec();
            }
            at = next.shape;
        }
    }

    #[test]
    fn ways_without_end_take_no_memory() {
        let robot = real();
        let rest = Shape(vec![Bend::new(0.0, 0.0, 12.0); 2]);
        let limits = vec![[0.0, 0.3]; 6];
        let mut planner = Planner::new(&robot, limits, TENSION, 1e-14).unwrap();
        let bent = Shape(vec![Bend::new(0.0, 0.3, 12.0); 2]);
        let refused = planner.path(&rest, &bent, &rest).unwrap_err();
        assert!(matches!(refused, PlanError::TooLong { .. }), "{refused}");
        assert!(refused.to_string().contains("motion.slew"), "{refused}");
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let robot = real();
        let rest = Shape(vec![Bend::new(0.0, 0.0, 12.0); 2]);
        let (mut planner, _) = planner(&robot, &rest);
        let far = Shape(vec![Bend::new(0.0, 4.0, 12.0); 2]);
        let refused = planner.path(&rest, &far, &rest);
        assert!(
            matches!(refused, Err(PlanError::Limit { .. })),
            "{refused:?}"
        );
        let tight = Shape(vec![Bend::new(0.0, 0.0, 65.0); 2]);
        let refused = planner.path(&rest, &tight, &rest).unwrap_err();
        assert!(
            matches!(refused, PlanError::Tension { high: 60.0, .. }),
            "{refused}"
        );
        let settings = CommandSettings {
            bend: vec![0.1],
            co_contraction: [70.0, 80.0],
            tension: TENSION,
        };
        let draws = Draws {
            settings,
            rest,
            seed: 0,
        };
        let refused = draws.draw(0, &mut planner).unwrap_err().to_string();
        assert!(refused.contains("none of 1000 draws"), "{refused}");
    }
}

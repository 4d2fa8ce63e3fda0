//! A recording as paths with friction in the holes: where a robot rests depends on how it came there.

use std::ops::Range;

use nalgebra::Vector3;
use rayon::prelude::*;
use tdcr_base::stats::median;

use super::Recording;
use super::problem::{Model, Part, Place, Problem, Settled};
use crate::robot::{Command, Robot};
use crate::statics::Equilibrium;
use crate::tendon_friction::{FrictionPath, Tangents};

/// Steps of time longer than this many medians are gaps.
const GAP: f64 = 2.5;
/// In a gap the servos have moved where one has by more than this many of its usual steps.
const MOVED: f64 = 4.0;
/// Largest turn of a joint in one substep (rad).
const RESOLUTION: f64 = 0.1;

/// Rows that follow one another.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Run {
    /// The row that the path starts from with no contact loaded, which is the last one before the gap; none at the beginning.
    lead: Option<usize>,
    rows: Range<usize>,
}

/// Whether a robot's tendons rub in their holes.
pub(super) fn has_friction(robot: &Robot) -> bool {
    let has_friction =
        |tendon: &crate::robot::Tendon| tendon.friction.is_some_and(|f| f.coefficient > 0.0);
    robot.tendons().iter().any(has_friction)
}

impl Recording {
    /// The recording cut where servos have moved far while nobody looked: after such a motion, taken as straight, it hardly
    /// matters how tendons lay in their holes before. Paths of the pieces are independent.
    pub(super) fn runs(&self) -> Vec<Run> {
        let longest = GAP * self.median_step();
        let moved = |row: usize| {
            let pairs = self.pulls[row - 1].iter().zip(&self.pulls[row]);
            pairs.map(|(a, b)| (b - a).abs()).fold(0.0, f64::max)
        };
        let mut steps: Vec<f64> = (1..self.len()).map(moved).collect();
        let far = MOVED * median(&mut steps);
        let cut =
            |&row: &usize| self.times[row] - self.times[row - 1] > longest && moved(row) > far;
        let mut starts = vec![0];
        starts.extend((1..self.len()).filter(cut));
        let ends = starts.iter().skip(1).copied().chain([self.len()]);
        (starts.iter().zip(ends))
            .map(|(&start, end)| Run {
                lead: start.checked_sub(1),
                rows: start..end,
            })
            .collect()
    }
}

impl Run {
    /// Leads a path through the run: `visit` sees it at each row, the first time before the run, and before each step says whether
    /// there is one. Where `stop` says so, no further row settles.
    fn follow(
        &self,
        path: &mut FrictionPath,
        recording: &Recording,
        commands: &[Vec<f64>],
        stop: &dyn Fn() -> bool,
        mut aim: impl FnMut(&mut FrictionPath, usize),
        mut visit: impl FnMut(&mut FrictionPath, usize, bool),
    ) {
        let command =
            |robot: &Robot, row: usize| -> Option<Command> { robot.command(&commands[row]).ok() };
        let mut started = false;
        for row in self.lead.into_iter().chain(self.rows.clone()) {
            let next = command(path.robot(), row).filter(|_| !stop());
            let settled = next.is_some_and(|command| {
                aim(path, row);
                let loads = recording.loads(row);
                let state = match started {
                    true => path.advance(&command, &loads),
                    false => path.start(&command, &loads),
                };
                started |= state.equilibrium.converged;
                state.equilibrium.converged
            });
            if self.rows.contains(&row) {
                visit(path, row, settled);
            }
        }
    }
}

/// Where a robot rests in each row; none where it does not.
pub(super) fn replay<T: Send>(
    robot: &Robot,
    recording: &Recording,
    commands: &[Vec<f64>],
    see: impl Fn(usize, &Equilibrium) -> T + Sync,
) -> Vec<Option<T>> {
    let runs: Vec<Vec<Option<T>>> = (recording.runs().par_iter())
        .map(|run| {
            let mut path = FrictionPath::new(robot).with_resolution(RESOLUTION);
            let mut rows = Vec::with_capacity(run.rows.len());
            run.follow(
                &mut path,
                recording,
                commands,
                &|| false,
                |_, _| {},
                |path, row, settled| {
                    rows.push(settled.then(|| see(row, &path.state().equilibrium)));
                },
            );
            rows
        })
        .collect();
    runs.into_iter().flatten().collect()
}

impl Problem<'_> {
    /// What each row says, and its derivatives by the unknowns: see [`Tangents`].
    pub(super) fn paths(
        &self,
        here: &Model,
        changed: &[Model],
        memory: &[Option<Settled>],
    ) -> Vec<Part> {
        let robots =
            |model: &Model| (!model.robot.is_same(&here.robot)).then(|| model.robot.clone());
        let tangents = Tangents::new(&here.robot, changed.iter().map(robots).collect());
        let runs: Vec<Vec<Part>> = (self.recording.runs().par_iter())
            .map(|run| {
                let mut path = FrictionPath::new(&here.robot)
                    .with_resolution(RESOLUTION)
                    .with_tangents(tangents.clone());
                let mut parts = Vec::with_capacity(run.rows.len());
                let aim = |path: &mut FrictionPath, row: usize| {
                    let difference = |model: &Model| -> Vec<f64> {
                        let pairs = model.commands[row].iter().zip(&here.commands[row]);
                        pairs.map(|(changed, own)| changed - own).collect()
                    };
                    if let Some(tangents) = &mut path.tangents {
                        tangents.aim(changed.iter().map(difference));
                    }
                };
                let (rows, commands) = (self.recording, &here.commands);
                run.follow(
                    &mut path,
                    rows,
                    commands,
                    self.stop,
                    aim,
                    |path, row, settled| {
                        let last = memory[row].as_ref();
                        parts.push(self.visit(here, changed, Place { row, last }, path, settled));
                    },
                );
                parts
            })
            .collect();
        runs.into_iter().flatten().collect()
    }

    fn visit(
        &self,
        here: &Model,
        changed: &[Model],
        at: Place<'_>,
        path: &mut FrictionPath,
        settled: bool,
    ) -> Part {
        let Some(mut tangents) = path.tangents.take().filter(|_| settled) else {
            return self.stale(at.row, at.last);
        };
        let state = &path.state().equilibrium;
        let sight = self.sight(here, at.row, state);
        let moved: Vec<Vec<Vector3<f64>>> = (changed.iter().enumerate())
            .map(|(i, model)| {
                let ends = sight.points.iter().zip(sight.towards(model));
                ends.map(|(from, to)| {
                    tangents.displacement(i, path, from.disc, [from.place, to.place])
                })
                .collect()
            })
            .collect();
        let configuration = state.configuration.clone();
        path.tangents = Some(tangents);
        self.part(at, here, changed, sight, moved, configuration)
    }
}

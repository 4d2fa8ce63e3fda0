//! Sweeps: any number of configurations in constant memory.

use rayon::prelude::*;

use super::{Equilibrium, Settler};
use crate::robot::{Command, Loads, Robot};

/// Configurations settled at once: enough for every core, few enough to stay in its cache.
const BATCH: usize = 1024;

/// Whether a sweep goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sweep {
    /// Give the next equilibrium.
    Continue,
    /// That was the last one wanted.
    Stop,
}

impl Robot {
    /// Settles commands as they come, on all cores, and hands each equilibrium with its number to
    /// `visit`, in order. Memory does not grow with their number: a sweep of a million configurations
    /// needs what one of a thousand does. Returns how many were visited.
    ///
    /// ```
    /// use rand::SeedableRng;
    /// use tdcr_sim::robot::{Loads, Robot};
    /// use tdcr_sim::statics::Sweep;
    ///
    /// let robot = Robot::load("2m")?;
    /// let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    /// let commands = (0..5_000).map(|_| (robot.random_command(&mut rng), Loads::default()));
    /// let mut highest: f64 = 0.0;
    /// let visited = robot.sweep(commands, |_, settled| {
    ///     highest = highest.max(settled.positions[9].z);
    ///     Sweep::Continue
    /// });
    /// assert!(visited == 5_000 && highest > 0.3);
    /// # Ok::<(), tdcr_sim::formats::RobotFileError>(())
    /// ```
    ///
    /// # Panics
    /// As [`Robot::settle`].
    pub fn sweep(
        &self,
        commands: impl IntoIterator<Item = (Command, Loads)>,
        mut visit: impl FnMut(usize, &Equilibrium) -> Sweep,
    ) -> usize {
        let mut commands = commands.into_iter();
        let mut visited = 0;
        let mut batch: Vec<(Command, Loads)> = Vec::with_capacity(BATCH);
        let mut settled = vec![Settler::new(self).into_equilibrium(); BATCH];
        loop {
            batch.clear();
            batch.extend(commands.by_ref().take(BATCH));
            if batch.is_empty() {
                return visited;
            }
            (batch.par_iter().zip(&mut settled)).for_each_init(
                || Settler::new(self),
                |settler, ((command, loads), out)| out.clone_from(settler.settle(command, loads)),
            );
            for equilibrium in &settled[..batch.len()] {
                visited += 1;
                if visit(visited - 1, equilibrium) == Sweep::Stop {
                    return visited;
                }
            }
        }
    }
}

//! `tdcr settle --commands`: commands of a file, each settled from the straight pose.

use std::path::Path;

use anyhow::bail;
use rayon::prelude::*;
use tdcr::pipeline::Monitor;
use tdcr::report::counted;
use tdcr::sim::contact::{ContactError, ContactSettler};
use tdcr::sim::robot::{Command, Loads, Robot};
use tdcr::sim::scene::Scene;

use super::commands::{Row, read_commands};
use super::console::{Console, Interrupted};
use super::loads::LoadArgs;
use super::settle_contacts::Surroundings;
use super::settle_table::{Out, Settled};

/// Commands settled between two safe points.
const BATCH: usize = 1024;

/// Commands of a file, each under its loads: of a column `payload` or the option's.
pub(super) fn read(
    file: &Path,
    robot: &Robot,
    loads: &LoadArgs,
) -> anyhow::Result<Vec<(Command, Loads)>> {
    let common = loads.on(robot)?;
    read_commands(file, |Row { command, payload }| {
        let loads = match payload {
            Some(payload) => loads.with_payload(payload, robot)?,
            None => common.clone(),
        };
        Ok((robot.command(&command)?, loads))
    })
}

/// Settles the commands of a file and writes or prints the table.
pub(super) fn run(
    (robot, scene): (&Robot, &Scene),
    file: &Path,
    loads: &LoadArgs,
    out: Option<&Path>,
    console: &Console,
) -> anyhow::Result<()> {
    let out = Out::new(out)?;
    let jobs = read(file, robot, loads)?;
    let settled = settle(robot, scene, &jobs, console)?;
    let failed = settled.iter().filter(|s| !s.converged).count();
    out.publish(robot, &loads.on(robot)?, settled, console)?;
    if failed > 0 {
        let count = counted(jobs.len(), "command");
        bail!("{failed} of {count} did not settle");
    }
    Ok(())
}

fn settle(
    robot: &Robot,
    scene: &Scene,
    jobs: &[(Command, Loads)],
    console: &Console,
) -> anyhow::Result<Vec<Settled>> {
    let mut all = Vec::with_capacity(jobs.len());
    console.begin("settle", jobs.len() as u64, 0);
    for batch in jobs.chunks(BATCH) {
        if console.interrupted() {
            return Err(Interrupted.into());
        }
        let settle = |settler: &mut ContactSettler, (command, loads): &(Command, Loads)| {
            from_straight(settler, command, loads)
        };
        let settled = (batch.par_iter()).map_init(|| ContactSettler::new(robot, scene), settle);
        let settled: Result<Vec<_>, _> = settled.collect();
        all.extend(settled?);
        console.advance(batch.len() as u64);
    }
    console.end();
    Ok(all)
}

/// Settles a command from the straight pose.
fn from_straight(
    settler: &mut ContactSettler,
    command: &Command,
    loads: &Loads,
) -> Result<Settled, ContactError> {
    settler.settle(command, loads)?;
    let smallest_stiffness = settler.smallest_stiffness(command, loads);
    Ok(Settled::new(
        settler.robot(),
        (command, loads),
        &settler.found().equilibrium,
        smallest_stiffness,
        Surroundings::of(settler),
    ))
}

//! `tdcr settle --path`: a robot led along the commands of a file.

use std::path::Path;

use anyhow::Context;
use tdcr::pipeline::Monitor;
use tdcr::sim::contact::{BranchPath, ContactError};
use tdcr::sim::geometry::Beads;
use tdcr::sim::robot::{Command, Loads, Robot};
use tdcr::sim::scene::Scene;
use tdcr::sim::statics::Equilibrium;
use tdcr::sim::tendon_friction::ContactPath;

use super::console::{Console, Interrupted};
use super::loads::LoadArgs;
use super::settle_contacts::Surroundings;
use super::settle_many;
use super::settle_table::{Out, Settled, Way};

/// A robot on its way.
struct Led {
    by: Leader,
    /// Snaps so far.
    snaps: usize,
}

/// What leads it.
enum Leader {
    /// Tendons, obstacles or discs that touch each other have friction.
    Friction {
        path: Box<ContactPath>,
        /// Of the beads that stand for the discs (m).
        shape_error: f64,
    },
    /// Nothing has friction.
    Branch(Box<BranchPath>),
}

impl Led {
    fn new(robot: &Robot, scene: &Scene) -> Self {
        let mut tendons = robot.tendons().iter();
        let mut obstacles = scene.obstacles().iter();
        let has_friction = tendons
            .any(|tendon| tendon.friction.is_some_and(|own| own.coefficient > 0.0))
            || obstacles.any(|obstacle| obstacle.friction > 0.0)
            || scene.self_contact().friction() > 0.0;
        let by = match has_friction {
            true => Leader::Friction {
                path: Box::new(ContactPath::new(robot, scene)),
                shape_error: Beads::new(robot).shape_error(),
            },
            false => Leader::Branch(Box::new(BranchPath::new(robot, scene))),
        };
        Self { by, snaps: 0 }
    }

    /// Leads the robot to a command.
    fn to(
        &mut self,
        robot: &Robot,
        command: &Command,
        loads: &Loads,
    ) -> Result<Settled, ContactError> {
        let (settled, snaps, dissipated) = match &mut self.by {
            Leader::Friction { path, shape_error } => {
                path.advance(command, loads)?;
                let surroundings = Surroundings::on_path(path, *shape_error);
                let state = path.state();
                let at = &state.equilibrium;
                let settled = Settled::new(robot, (command, loads), at, f64::NAN, surroundings);
                (settled, state.snaps, state.dissipated)
            }
            Leader::Branch(path) => {
                path.advance(command, loads)?;
                let stiffness = path.smallest_stiffness();
                let settler = path.settler();
                let at = &settler.found().equilibrium;
                let surroundings = Surroundings::of(settler);
                let settled = Settled::new(robot, (command, loads), at, stiffness, surroundings);
                (settled, path.snaps(), 0.0)
            }
        };
        let before = std::mem::replace(&mut self.snaps, snaps);
        Ok(settled.on_path(Way {
            snaps: snaps - before,
            dissipated,
        }))
    }

    /// Where it is.
    fn equilibrium(&self) -> &Equilibrium {
        match &self.by {
            Leader::Friction { path, .. } => &path.state().equilibrium,
            Leader::Branch(path) => &path.settler().found().equilibrium,
        }
    }
}

/// Leads the robot from the first command of a file, which it settles under from the straight pose, to the last, and writes or prints the
/// table. Of a path that comes to no rest the table ends there.
pub(super) fn run(
    (robot, scene): (&Robot, &Scene),
    file: &Path,
    loads: &LoadArgs,
    out: Option<&Path>,
    console: &Console,
) -> anyhow::Result<()> {
    let out = Out::new(out)?;
    let jobs = settle_many::read(file, robot, loads)?;
    let mut led = Led::new(robot, scene);
    let mut settled = Vec::with_capacity(jobs.len());
    let mut failure = None;
    console.begin("settle", jobs.len() as u64, 0);
    for (row, (command, loads)) in jobs.iter().enumerate() {
        if console.interrupted() {
            return Err(Interrupted.into());
        }
        let place = || {
            let name = file.display();
            format!("{name}, command {row}, where the first is 0")
        };
        let found = led.to(robot, command, loads).with_context(place)?;
        settled.push(found);
        if let Some(why) = led.equilibrium().failure(robot, command) {
            failure = Some(anyhow::Error::from(why).context(place()));
            break;
        }
        console.advance(1);
    }
    console.end();
    out.publish(robot, &loads.on(robot)?, settled, console)?;
    failure.map_or(Ok(()), Err)
}

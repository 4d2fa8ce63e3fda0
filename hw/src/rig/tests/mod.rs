//! Rigs in memory: files, homing, motion, and what stops it.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use std::ops::ControlFlow;
use std::path::Path;
use std::time::Duration;

use super::*;
use crate::capture::Program;
use crate::dynamixel::{Bus, BusSettings};
use crate::plan::{Bend, Shape};
use crate::servo::Torque;
use crate::simulated::Fault;

mod cameras;
mod faults;
mod files;
mod held;
mod limits;
mod masks;
mod motion;
mod tendons;

const SIMULATED: &str = include_str!("../../../../examples/rig-sim.toml");
const PAPER: &str = include_str!("../../../../examples/rig-2m.toml");

fn file(text: &str) -> Result<RigFile, RigError> {
    // Robots are named from the folder of the file.
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/rig.toml");
    RigFile::parse(text, &path)
}

fn rig() -> Rig {
    Rig::open_file(file(SIMULATED).unwrap(), Pace::Computed).unwrap()
}

fn servo(id: u8) -> ServoId {
    ServoId::new(id).unwrap()
}

/// Moves a rig that is engaged at home from command to command and back: some seconds, in which faults are met.
fn wander(rig: &mut Rig) -> Result<(), RigError> {
    let mut program = Program::new(rig.file(), 1).unwrap();
    let rest = program.rest().clone();
    let mut shapes: Vec<Shape> = (0..4).map(|k| program.draw(k).unwrap().shape).collect();
    shapes.push(rest.clone());
    let mut at = rest;
    for shape in shapes {
        let path = program.path(&at, &shape).unwrap();
        rig.move_along(&path, &mut || ControlFlow::Continue(()))?;
        at = shape;
    }
    (0..20).try_for_each(|_| rig.poll().map(drop))
}

/// Whether a rig's servos, as far as they are true, neither pull on nor hold their tendons.
fn torques(rig: &mut Rig) -> Vec<Option<Torque>> {
    let ids: Vec<ServoId> = rig.winches().iter().map(|winch| winch.id).collect();
    rig.bus().torque(&ids).into_iter().map(Result::ok).collect()
}

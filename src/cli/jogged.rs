//! What all jogging shares: the session that keys move a rig in, what they did, and the files of what was captured.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;
use serde::Serialize;
use serde_json::json;
use tdcr::hw::capture::{Captured, Session};
use tdcr::pipeline::Monitor;
use tdcr::report::counted;
use tdcr::sim::cloud::write_ply;

use super::console::{Console, Interrupted};
use super::keys::{Keys, Pressed};

/// What was done.
#[derive(Serialize)]
pub(super) struct Jogged<'a> {
    pub dir: &'a Path,
    pub log: Option<PathBuf>,
    /// Moves that were made.
    pub moves: usize,
    /// Moves that were refused.
    pub refused: usize,
    /// Clouds that were captured.
    pub captured: usize,
}

/// Releases the tension; an error where a signal ended the work.
pub(super) fn end(session: Session<'_>, console: &Console) -> anyhow::Result<()> {
    session.end()?;
    match console.interrupted() {
        true => Err(Interrupted.into()),
        false => Ok(()),
    }
}

impl Jogged<'_> {
    /// The next key that asks for a motion; `c` captures meanwhile. `None` where a key or a signal says to end, or all are read.
    pub fn key(
        &mut self,
        session: &mut Session<'_>,
        keys: &Keys,
        console: &Console,
    ) -> anyhow::Result<Option<char>> {
        loop {
            if console.interrupted() {
                return Ok(None);
            }
            match keys.pressed() {
                Pressed::Key('q') | Pressed::End => return Ok(None),
                Pressed::Key('c') => {
                    let sample = session.observe(self.captured as u64)?;
                    let (dir, number) = (self.dir, self.captured);
                    (session.rig()).hold_while(|| save(dir, number, &sample))??;
                    self.captured += 1;
                    let points = counted(sample.cloud.len(), "point");
                    console.tell(&format!("captured {points}"));
                }
                Pressed::Key(key) => return Ok(Some(key)),
                Pressed::Nothing => {
                    session.rig().poll()?;
                }
            }
        }
    }
}

/// Writes a cloud and its motors as `tdcr data import` reads them, beside those of earlier runs.
fn save(dir: &Path, number: usize, sample: &Captured) -> anyhow::Result<()> {
    fs::create_dir_all(dir).with_context(|| format!("cannot create {}", dir.display()))?;
    let mut name = number;
    while dir.join(format!("jog-{name:04}.ply")).exists() {
        name += 1;
    }
    let path = dir.join(format!("jog-{name:04}.ply"));
    let motors = json!({
        "ctrl": sample.command,
        "ticks": sample.states.iter().map(|state| state.position.0).collect::<Vec<_>>(),
        "goals": sample.goals.iter().map(|goal| goal.0).collect::<Vec<_>>(),
    });
    super::output::write(&path.with_extension("json"), format!("{motors}\n"))?;
    Ok(write_ply(&path, &sample.cloud)?)
}

//! What a jogged rig did, and the files of what was captured.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;
use serde::Serialize;
use serde_json::json;
use tdcr::hw::capture::Captured;
use tdcr::sim::cloud::write_ply;

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

/// Writes a cloud and its motors as `tdcr data import` reads them, beside those of earlier runs.
pub(super) fn save(dir: &Path, number: usize, sample: &Captured) -> anyhow::Result<()> {
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

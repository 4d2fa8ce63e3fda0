//! What is known of a capture besides its clouds.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use tdcr_hw::capture::{Captured, Sentinel, StillDepth};

/// How a capture went. Of a capture that was resumed, what is in its journal counts too.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CaptureReport {
    /// Samples of the data set.
    pub samples: usize,
    /// Samples that this run captured.
    pub captured: usize,
    /// Samples that were taken when patience came to its end and something still moved.
    pub moving: usize,
    /// Largest difference between the times of the pictures of a sample (s).
    pub skew: f64,
    /// Largest distance of a servo from its goal when pictures were taken (ticks).
    pub lag: i32,
    /// Looks at the robot in its home pose.
    pub sentinels: usize,
    /// How far the mean of what is seen at home moved since the first look, at the most (m).
    pub drift: f64,
    /// How much a servo's current at home changed since the first look, at the most (A).
    pub current_drift: f64,
    /// Root mean square distance of the centres of the clouds of one command from their mean, over all commands that were
    /// captured more than once (m); none where no command was. Centres are means of the points seen.
    pub repeatability: Option<f64>,
    /// Times that a servo lost its turns, and its home was found again.
    pub recalled: usize,
    /// The log of this run.
    pub log: Option<PathBuf>,
    /// Time that servos rested because they were hot (s).
    pub rested: f64,
    /// Time that the rig took, by its own clock (s).
    pub rig_seconds: f64,
    /// Wall clock of this run (s).
    pub seconds: f64,
}

/// A line of the journal.
#[derive(Debug, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub(super) enum Entry {
    /// A sample was taken.
    Sample(Record),
    /// The robot was looked at at home, before sample `before`.
    Sentinel {
        before: usize,
        /// What hung at the tip (kg), where something may.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        payload: Option<f64>,
        #[serde(flatten)]
        sentinel: Sentinel,
    },
    /// Servos rested before sample `before`.
    Rest { before: usize, seconds: f64 },
    /// A servo lost its turns in or before sample `before`, and its home was found again.
    Recalled { before: usize, servo: u8 },
}

/// What is known of a sample besides its cloud. Of each sample of the data set there is one.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Record {
    pub(super) index: u64,
    /// How often its command was captured before.
    #[serde(default)]
    repeat: usize,
    /// What hung at the tip (kg), where something may.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    payload: Option<f64>,
    /// Mean of the points seen (m); older journals have none.
    #[serde(default)]
    pub(super) centroid: Option<[f64; 3]>,
    /// Time of the rig's clock (s).
    time: f64,
    /// The command (m): the sample's condition.
    command: Vec<f64>,
    /// The same as positions of the servos, from home (ticks).
    ticks: Vec<i32>,
    /// Where the servos were (ticks).
    positions: Vec<i32>,
    /// Currents, positive where they pull (A).
    pulls: Vec<f64>,
    /// Points before the sample was drawn.
    points: usize,
    /// Difference between the times of the pictures (s).
    skew: f64,
    /// How long one waited until all was still (s).
    waited: f64,
    /// Whether it was.
    still: bool,
}

impl Record {
    /// Of a sample whose command was captured `repeat` times before under the same payload (kg).
    pub(super) fn of(captured: &Captured, repeat: usize, payload: Option<f64>) -> Self {
        Self {
            index: captured.index,
            repeat,
            payload,
            centroid: Some(captured.centroid()),
            time: captured.time.as_secs_f64(),
            command: captured.command.clone(),
            ticks: captured.goals.iter().map(|goal| goal.0).collect(),
            positions: captured
                .states
                .iter()
                .map(|state| state.position.0)
                .collect(),
            pulls: captured.states.iter().map(|state| state.pull).collect(),
            points: captured.cloud.len(),
            skew: captured.skew.as_secs_f64(),
            waited: captured.stillness.waited.as_secs_f64(),
            still: captured.stillness.end == StillDepth::Still,
        }
    }
}

impl CaptureReport {
    pub(super) fn count(&mut self, entry: &Entry) {
        match entry {
            Entry::Sample(record) => {
                self.moving += usize::from(!record.still);
                self.skew = self.skew.max(record.skew);
                let lags = record.ticks.iter().zip(&record.positions);
                let lag = lags.map(|(goal, position)| (goal - position).abs()).max();
                self.lag = self.lag.max(lag.unwrap_or(0));
            }
            Entry::Sentinel { sentinel, .. } => {
                self.sentinels += 1;
                self.drift = self.drift.max(sentinel.drift);
                self.current_drift = self.current_drift.max(sentinel.current_drift);
            }
            Entry::Rest { seconds, .. } => self.rested += seconds,
            Entry::Recalled { .. } => self.recalled += 1,
        }
    }
}

//! Faults of simulated cameras, switched while they run or by time.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// What can happen to a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CameraFault {
    /// Its cable is pulled out.
    Unplugged,
    /// No pictures come.
    Stalled,
    /// The same picture comes over and over, with new times.
    Frozen,
}

/// The switch of a camera's faults. Clones switch the same camera.
#[derive(Clone, Debug, Default)]
pub struct CameraFaults {
    /// What holds from these times on.
    changes: Arc<Mutex<BTreeMap<Duration, Option<CameraFault>>>>,
}

impl CameraFaults {
    /// Lets `fault`, or `None` for a sound camera, hold for pictures exposed at `time` of the clock or later, until the next
    /// change.
    pub fn set_from(&self, time: Duration, fault: Option<CameraFault>) {
        // A map that another thread left in the middle of a change is still a map.
        let mut changes = self.changes.lock().unwrap_or_else(PoisonError::into_inner);
        changes.insert(time, fault);
    }

    /// What holds at `time`.
    pub fn at(&self, time: Duration) -> Option<CameraFault> {
        let changes = self.changes.lock().unwrap_or_else(PoisonError::into_inner);
        changes
            .range(..=time)
            .next_back()
            .and_then(|(_, fault)| *fault)
    }
}

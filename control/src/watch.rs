//! When a robot that follows a path holds, and when it stops.

/// Bounds of what is borne. Times in s; errors in parts of the robot's length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WatchSettings {
    /// Longest time without a new command, for want of a sensor or of a model that settles: then the run ends.
    pub patience: f64,
    /// Error above which the tip must not go on to leave its target.
    pub error: f64,
    /// Time for which the error, above that bound, may be larger than it was that long ago: a controller that diverges is stopped.
    pub growth: f64,
    /// Error above which a tip that does not come nearer, its command at rest, counts as kept from its target.
    pub out_of_reach: f64,
}

impl Default for WatchSettings {
    fn default() -> Self {
        Self {
            patience: 3.0,
            error: 0.25,
            growth: 1.0,
            out_of_reach: 0.02,
        }
    }
}

/// Something that went wrong.
#[derive(Clone, Debug, PartialEq)]
pub struct Incident {
    /// When (s, from the path's start).
    pub time: f64,
    /// What.
    pub reason: String,
    /// Whether it ended the run.
    pub is_end: bool,
}

/// Watches over a run.
#[derive(Clone, Debug)]
pub(crate) struct Watch {
    settings: WatchSettings,
    period: f64,
    /// The robot's length (m).
    length: f64,
    /// The reason for holding, and the periods it has lasted.
    holding: Option<(String, usize)>,
    /// Errors (m) of the last `growth` seconds, the oldest first.
    errors: Vec<f64>,
    /// Periods in which the command rested short of the target.
    kept: usize,
}

/// Part of the largest step below which a command rests.
const RESTS: f64 = 1e-3;
/// Time for which it must rest to be kept from its target (s).
const KEPT: f64 = 1.0;

impl Watch {
    pub fn new(settings: WatchSettings, period: f64, length: f64) -> Self {
        Self {
            settings,
            period,
            length,
            holding: None,
            errors: Vec::new(),
            kept: 0,
        }
    }

    /// Takes in a period: the tip's error (m), the command's change in parts of its largest step, and why it was held.
    pub fn see(
        &mut self,
        time: f64,
        error: Option<f64>,
        moved: f64,
        held: Option<&str>,
    ) -> Option<Incident> {
        let incident = |reason: String, is_end| {
            Some(Incident {
                time,
                reason,
                is_end,
            })
        };
        if let Some(reason) = held {
            let (first, lasted) = match &self.holding {
                Some((_, lasted)) => (false, lasted + 1),
                None => (true, 1),
            };
            self.holding = Some((reason.to_owned(), lasted));
            let waited = lasted as f64 * self.period;
            if waited > self.settings.patience {
                return incident(format!("held for {waited:.2} s: {reason}"), true);
            }
            return if first {
                incident(format!("held: {reason}"), false)
            } else {
                None
            };
        }
        self.holding = None;
        let error = error?;
        let span = (self.settings.growth / self.period).ceil().max(1.0) as usize;
        self.errors.push(error);
        if self.errors.len() > span + 1 {
            self.errors.remove(0);
        }
        let before = self.errors[0];
        let is_full = self.errors.len() == span + 1;
        if is_full && error > self.settings.error * self.length && error > before {
            return incident(
                format!(
                    "the error grew from {before:.4} m to {error:.4} m in {:.2} s",
                    span as f64 * self.period
                ),
                true,
            );
        }
        let rests = moved < RESTS && error > self.settings.out_of_reach * self.length;
        self.kept = if rests { self.kept + 1 } else { 0 };
        if self.kept == (KEPT / self.period).ceil() as usize {
            return incident(
                format!(
                    "the target is out of reach: {error:.4} m from it, and no command within bounds comes nearer"
                ),
                false,
            );
        }
        None
    }
}

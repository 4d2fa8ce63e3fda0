//! Iterative learning over trials of one path.
//!
//! What a model lacks does much the same in each trial: spools that are off, friction, backlash, obstacles. The path that the controller is given
//! is corrected by the errors of the last trial, `c <- Q(c + gain (r - p))` at each period, `r` the path, `p` the tip as it was seen and `Q` a low-pass filter
//! without a phase, as the trial is over (Bristow, Tharayil and Alleyne, A survey of iterative learning control, IEEE Control Systems Magazine 26,
//! 2006). The controller's model turns the corrections into commands. Errors fall from trial to trial as long as the controller's own loop
//! leaves less than the whole of an error of each frequency that `Q` passes, and as long as each trial begins alike: with friction, from the same
//! state. Where friction makes the tip too sensitive to corrections for that, [`Learner`] goes back to the best trial.

use nalgebra::Vector3;

use crate::tracking::Tracking;

/// How corrections are learnt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Learning {
    /// Share of an error that a correction takes in; above 0, and 1 at most.
    pub gain: f64,
    /// Time constant of each of the filter's passes, forwards and backwards (s); 0 for none.
    pub smoothing: f64,
}

impl Default for Learning {
    fn default() -> Self {
        Self {
            gain: 0.5,
            smoothing: 0.1,
        }
    }
}

impl Learning {
    /// Takes in the errors of a trial, whose periods are `period` (s) long, into the corrections (m) that it had: one for each period from the
    /// path's start. Periods in which the tip was not seen, and those after the trial's end, keep theirs.
    pub fn learn(&self, correction: &mut Vec<Vector3<f64>>, trial: &Tracking, period: f64) {
        let on_path = trial.rows.iter().filter(|row| row.time >= 0.0);
        for (k, row) in on_path.enumerate() {
            if k == correction.len() {
                correction.push(Vector3::zeros());
            }
            if let Some(seen) = row.seen {
                correction[k] += (row.target - seen) * self.gain;
            }
        }
        let kept = (-period / self.smoothing.max(f64::MIN_POSITIVE)).exp();
        smooth(correction.iter_mut(), kept);
        smooth(correction.iter_mut().rev(), kept);
    }
}

/// Learns from trial to trial. A trial that was no better than the best one is learnt nothing from: the corrections go on from those of the best
/// one, by half of the gain.
#[derive(Clone, Debug, Default)]
pub struct Learner {
    learning: Learning,
    best: Option<Best>,
}

/// The trial with the smallest error yet.
#[derive(Clone, Debug)]
struct Best {
    /// Its root mean square error (m).
    error: f64,
    /// The corrections that it had (m).
    correction: Vec<Vector3<f64>>,
    trial: Tracking,
}

impl Learner {
    /// Turns the corrections (m) that `trial` had, whose periods are `period` (s) long, into those of the next one.
    pub fn learn(&mut self, correction: &mut Vec<Vector3<f64>>, trial: &Tracking, period: f64) {
        let error = trial.rms_error().unwrap_or(f64::INFINITY);
        let best = match self.best.take() {
            Some(best) if best.error <= error => {
                self.learning.gain /= 2.0;
                correction.clone_from(&best.correction);
                best
            }
            _ => Best {
                error,
                correction: correction.clone(),
                trial: trial.clone(),
            },
        };
        self.learning.learn(correction, &best.trial, period);
        self.best = Some(best);
    }
}

/// A low-pass filter of first order, which starts at the first value.
fn smooth<'a>(values: impl Iterator<Item = &'a mut Vector3<f64>>, kept: f64) {
    let mut before: Option<Vector3<f64>> = None;
    for value in values {
        if let Some(before) = before {
            *value = before * kept + *value * (1.0 - kept);
        }
        before = Some(*value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracking::TrackingRow;

    /// A trial of three periods whose tip is so far from its target along x (m).
    fn trial(off: f64) -> Tracking {
        let row = |k: usize| TrackingRow {
            time: k as f64,
            target: Vector3::x() * off,
            measured: None,
            seen: Some(Vector3::zeros()),
            tip: Some(Vector3::zeros()),
            command: Vec::new(),
            tensions: None,
            estimated: Vec::new(),
            delay: 0,
            held: None,
        };
        Tracking {
            controller: "none",
            rows: (0..3).map(row).collect(),
            incidents: Vec::new(),
            stopped: None,
            unidentified: Vec::new(),
            length: 1.0,
        }
    }

    #[test]
    fn a_trial_that_is_worse_is_gone_back_from_by_half_the_gain() {
        let mut learner = Learner::default();
        let mut correction = Vec::new();
        // Each trial's error and what is learnt from it: 0.5, then of the same 0.25, then on from there.
        for (error, learnt) in [(0.8, 0.4), (1.0, 0.2), (0.4, 0.3), (0.4, 0.25)] {
            learner.learn(&mut correction, &trial(error), 1.0);
            assert!((correction[1].x - learnt).abs() < 1e-9, "{correction:?}");
        }
    }
}

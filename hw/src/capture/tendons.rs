//! Whether every tendon pulls.

use super::error::CaptureError;
use super::session::Session;
use crate::plan::{Bend, Shape};

/// Share of what the median servo takes below which a tendon is slack.
const SLACK: f64 = 0.4;

impl Session<'_> {
    /// Shares the largest tension of the rig's commands among all tendons, with the robot straight at home, and compares what their
    /// servos take ([`gauge`](crate::rig::Rig::gauge)): a tendon that has snapped, or left its spool, takes nothing. At home itself, gears' friction
    /// hides as much as a tendon pulls. Returns what each takes (A).
    ///
    /// # Errors
    /// [`CaptureError::Slack`]; as [`sample`](Self::sample).
    pub fn check_tendons(&mut self) -> Result<Vec<f64>, CaptureError> {
        let rest = self.program().rest().clone();
        let [_, most] = self.rig().spec().commands.co_contraction;
        let tense = |bend: &Bend| Bend {
            tension: most.max(bend.tension),
            ..*bend
        };
        self.visit(Shape(rest.0.iter().map(tense).collect()))?;
        let pulls = self.rig().gauge()?;
        self.visit(rest)?;
        let mut sorted = pulls.clone();
        sorted.sort_by(f64::total_cmp);
        let expected = sorted[sorted.len() / 2];
        let weakest = pulls.iter().zip(self.rig().winches());
        let weakest = weakest.min_by(|(a, _), (b, _)| a.total_cmp(b));
        match weakest {
            Some((&pull, winch)) if pull < SLACK * expected => Err(CaptureError::Slack {
                id: winch.id.get(),
                pull,
                expected,
            }),
            _ => Ok(pulls),
        }
    }
}

//! Whether every tendon pulls, and as hard as it should.
//!
//! At home, where all tendons share one tension `T_0`, a swing tells what each servo takes for it, and what its gear's friction
//! takes: the current of a tension `T` is `k T` with `k = I_0 / T_0`, and `k T + f` or `k T - f` where the servo has last wound or let
//! out. In each sample the currents, less that friction, are compared with those of the simulated tensions. Where one is nearer
//! to that of a tendon that pulls nothing, or twice as hard, the servos swing, which takes a second, and without friction it is
//! judged: a tendon is slack that takes less than 0.4 of what its tension would, and jammed where it takes more than 2.5 times as
//! much and 6 N. Nothing is concluded from tensions below 6 N. Between these bounds lies what models, friction in the holes and
//! payloads of a few newtons' moment change.

use tdcr_base::stats::median;

use super::Session;
use super::error::CaptureError;
use crate::log::Level;
use crate::plan::{Bend, Place, Shape};
use crate::rig::WinchState;

/// Share of what a servo should take below which its tendon is slack: of the median servo's at home, and of its own in a sample.
const SLACK: f64 = 0.4;

/// How many times what it should take a servo takes at least whose tendon is jammed; and so much tension (N) besides.
const JAMMED: f64 = 2.5;

/// Tension (N) from which on something is concluded.
const LEAST: f64 = 6.0;

/// Share of what a servo should take by which it may be off before its friction is taken out of it by a swing.
const SUSPICIOUS: f64 = 0.5;

/// What a servo takes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale {
    /// For a newton of its tendon's tension (A).
    per_newton: f64,
    /// For its gear's friction (A).
    friction: f64,
}

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
        let tense = Shape(rest.0.iter().map(tense).collect());
        self.visit(tense.clone())?;
        let [pulls, friction] = self.rig().gauge_friction()?;
        let tensions = self.tensions(&tense.into())?;
        self.visit(rest)?;
        let expected = median(&mut pulls.clone());
        let weakest = pulls.iter().zip(self.rig().winches());
        let weakest = weakest.min_by(|(a, _), (b, _)| a.total_cmp(b));
        if let Some((&pull, winch)) = weakest
            && pull < SLACK * expected
        {
            return Err(CaptureError::Slack {
                id: winch.id.get(),
                pull,
                expected,
            });
        }
        let servos = pulls.iter().zip(&friction).zip(&tensions);
        let scales = servos.map(|((pull, &friction), tension)| Scale {
            per_newton: pull / tension.max(LEAST),
            friction,
        });
        self.scales = scales.collect();
        Ok(pulls)
    }

    /// The simulated tensions (N) of a place.
    fn tensions(&mut self, place: &Place) -> Result<Vec<f64>, CaptureError> {
        let program = &mut self.program;
        Ok(self.rig.hold_while(|| program.tensions(place))??)
    }

    /// Compares what the servos take, standing at their goals, with what the simulated tensions would; where a tendon may have
    /// snapped or jammed, has the servos swing, and judges by what they then take. Says whether they did. Nothing is compared
    /// before [`check_tendons`](Self::check_tendons).
    ///
    /// # Errors
    /// [`CaptureError::Pull`]; as [`sample`](Self::sample).
    pub(super) fn compare_pulls(
        &mut self,
        index: u64,
        states: &[WinchState],
    ) -> Result<Swung, CaptureError> {
        if self.scales.is_empty() {
            return Ok(Swung::No);
        }
        let tensions = self.tensions(&self.at.clone())?;
        let turned = self.rig.last_turned();
        let servos = self.scales.iter().zip(&tensions).zip(states).zip(turned);
        let suspicious = servos.map(|(((scale, tension), state), turned)| {
            let expected = scale.per_newton * tension;
            let known = f64::from(turned.signum()) * scale.friction;
            // Of a servo that has hardly turned, friction may hide its whole.
            let hidden = if turned == 0 { scale.friction } else { 0.0 };
            let least = scale.per_newton * LEAST;
            (state.pull - known - expected).abs() > SUSPICIOUS * expected.max(least) + hidden
        });
        if !suspicious.into_iter().any(|suspicious| suspicious) {
            return Ok(Swung::No);
        }
        self.rig
            .log_event(Level::Info, "servos swing: a current is unlike its tension");
        let pulls = self.rig.gauge()?;
        let servos = self.scales.iter().zip(&tensions).zip(&pulls);
        let servos = servos.zip(self.rig.winches());
        let wrong = servos.filter_map(|(((scale, &tension), &pull), winch)| {
            let expected = scale.per_newton * tension;
            let slack = tension >= LEAST && pull < SLACK * expected;
            let jammed = pull > JAMMED * expected + scale.per_newton * LEAST;
            // Of what it should take, or that of what it takes.
            let share = if slack {
                pull / expected
            } else {
                expected / pull
            };
            (slack || jammed).then_some((share, winch.id, pull, expected, tension))
        });
        // Where one tendon snaps, others slacken.
        match wrong.min_by(|a, b| a.0.total_cmp(&b.0)) {
            None => Ok(Swung::Yes),
            Some((_, id, pull, expected, tension)) => Err(CaptureError::Pull {
                index,
                id: id.get(),
                pull,
                expected,
                tension,
            }),
        }
    }
}

/// Whether servos swung.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Swung {
    Yes,
    No,
}

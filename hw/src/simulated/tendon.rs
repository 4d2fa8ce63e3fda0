//! A tendon between its spool and the robot: what it pulls with, and what may be wrong with it.

use super::spool::Spool;

/// Stiffness (N/m) of the short piece of a tendon between its spool and where it jams or ends.
const JAMMED_STIFFNESS: f64 = 2e4;
/// Rest lengths (m) that the robot is solved for: from a tendon that is wound up whole to one that is gone.
pub const REACH: [f64; 2] = [0.0, 10.0];

/// What is wrong with a tendon.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TendonFault {
    /// Nothing.
    #[default]
    Whole,
    /// It has snapped: it pulls neither at the robot nor at the servo.
    Snapped,
    /// It is stuck at the base: the robot feels no more of the spool, and the spool only the piece up to there.
    Jammed,
}

/// How a tendon is, in truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TendonTruth {
    /// Rest length on the robot's side (m).
    pub rest_length: f64,
    /// Length in the robot (m).
    pub length: f64,
    /// Tension in the robot (N); never negative.
    pub tension: f64,
    /// Tension at the spool (N); another one where the tendon is jammed.
    pub tension_at_spool: f64,
    /// By how much it is longer than its way (m); 0 where it pulls, and for one that has snapped.
    pub slack: f64,
    /// What is wrong with it.
    pub fault: TendonFault,
}

/// One tendon between its spool and the robot.
#[derive(Clone, Debug)]
pub struct Line {
    /// What it is wound on.
    pub spool: Spool,
    /// Stiffness (N/m).
    pub stiffness: f64,
    /// Rest length at home (m).
    home: f64,
    fault: TendonFault,
    /// Rest length and tension where it jammed.
    jammed: (f64, f64),
    /// Rest length of the last solve (m).
    pub solved: f64,
    /// Length in the robot as of the last solve (m).
    pub length: f64,
}

impl Line {
    /// A whole tendon, its spool at home.
    pub fn new(spool: Spool, stiffness: f64, home: f64, length: f64) -> Self {
        Self {
            spool,
            stiffness,
            home,
            fault: TendonFault::Whole,
            jammed: (home, 0.0),
            solved: home,
            length,
        }
    }

    /// Rest length by the spool (m).
    pub fn rest(&self) -> f64 {
        self.home - self.spool.wound()
    }

    /// Shortens it by this (m), at the same angle of its spool.
    pub fn shorten(&mut self, length: f64) {
        self.home -= length;
    }

    /// Rest length as the robot feels it (m).
    pub fn rest_at_robot(&self) -> f64 {
        let rest = match self.fault {
            TendonFault::Whole => self.rest(),
            TendonFault::Snapped => REACH[1],
            TendonFault::Jammed => self.jammed.0,
        };
        rest.clamp(REACH[0], REACH[1])
    }

    /// Tension at the robot (N).
    pub fn tension_at_robot(&self) -> f64 {
        match self.fault {
            TendonFault::Snapped => 0.0,
            _ => (self.stiffness * (self.length - self.rest_at_robot())).max(0.0),
        }
    }

    /// Tension at the spool (N).
    pub fn tension(&self) -> f64 {
        match self.fault {
            TendonFault::Snapped => 0.0,
            // A tendon that is wound up whole stops the spool.
            TendonFault::Whole => {
                self.tension_at_robot() + JAMMED_STIFFNESS * (-self.rest()).max(0.0)
            }
            TendonFault::Jammed => {
                let (rest, tension) = self.jammed;
                (tension + JAMMED_STIFFNESS * (rest - self.rest())).max(0.0)
            }
        }
    }

    /// How the tendon is.
    pub fn truth(&self) -> TendonTruth {
        TendonTruth {
            rest_length: self.rest_at_robot(),
            length: self.length,
            tension: self.tension_at_robot(),
            tension_at_spool: self.tension(),
            slack: match self.fault {
                TendonFault::Snapped => 0.0,
                _ => (self.rest_at_robot() - self.length).max(0.0),
            },
            fault: self.fault,
        }
    }

    /// Breaks the tendon, or makes it whole.
    pub fn set_fault(&mut self, fault: TendonFault) {
        self.jammed = (self.rest_at_robot(), self.tension_at_robot());
        self.fault = fault;
    }
}

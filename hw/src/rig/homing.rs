//! Finding home: by hand, or from where servos were left.

use std::time::Duration;

use super::turns::{Homing, Turns};
use super::{Rig, RigError};
use crate::log::LogRecord;
use crate::servo::{ServoId, Ticks};

/// Time between looks at servos whose motors are off.
const LOOK: Duration = Duration::from_millis(50);

/// How long tendons may turn servos whose motors were switched off.
const LETTING_GO: Duration = Duration::from_secs(1);

/// How long a servo may take until it answers after it got its power back.
const RESTART: Duration = Duration::from_secs(5);

/// What homing found for a servo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HomingReport {
    /// Which servo.
    pub id: ServoId,
    /// What was known of it.
    pub before: Homing,
    /// Where it stands, from home (ticks).
    pub position: Ticks,
}

impl Rig {
    /// Asks the servos where they are, and compares with where they were left.
    ///
    /// # Errors
    /// [`RigError::Servo`] for the first that does not answer.
    pub fn meet(&mut self) -> Result<&[Homing], RigError> {
        let positions = self.positions()?;
        let met = |(&id, &found): (&ServoId, &Ticks)| {
            let known = self.turns.of(id);
            known.map_or(Homing::Never, |turns| turns.meet(found))
        };
        self.homing = self.ids.iter().zip(&positions).map(met).collect();
        Ok(&self.homing)
    }

    /// What is known of where the servos are, as of the last [`meet`](Self::meet).
    pub fn homing(&self) -> &[Homing] {
        &self.homing
    }

    /// Takes where the servos stand for home: the robot has to be in its home pose, straight, with every tendon at its
    /// tension of home.
    ///
    /// # Errors
    /// [`RigError::Servo`] for the first that does not answer; [`RigError::Write`]. Nothing has changed then.
    pub fn home_here(&mut self) -> Result<Vec<HomingReport>, RigError> {
        let positions = self.positions()?;
        self.set_homes(&positions, &positions)
    }

    /// Finds home from where the servos were left: they have lost their count, but not turned by more than
    /// [`KNOWN_WITHIN`](super::KNOWN_WITHIN).
    ///
    /// # Errors
    /// [`RigError::NotRecalled`] where that does not tell all homes; as [`home_here`](Self::home_here).
    pub fn home_recalled(&mut self) -> Result<Vec<HomingReport>, RigError> {
        self.meet()?;
        let positions = self.positions()?;
        let servos = self.homing.iter().zip(&positions);
        let recalled: Vec<_> = servos
            .map(|(homing, &found)| homing.recall(found))
            .collect();
        let unknown = |((id, homing), home): ((&ServoId, &Homing), &Option<Ticks>)| match home {
            Some(_) => None,
            None => Some(homing.known(*id).err().unwrap_or_default()),
        };
        let servos = self.ids.iter().zip(&self.homing);
        let unknown: Vec<String> = servos.zip(&recalled).filter_map(unknown).collect();
        if !unknown.is_empty() {
            return Err(RigError::NotRecalled(unknown));
        }
        let homes: Vec<Ticks> = recalled.into_iter().flatten().collect();
        self.set_homes(&homes, &positions)
    }

    /// The same after a servo was without power for a moment: waits until tendons have let go of the servos, whose motors are
    /// off, and until all answer.
    ///
    /// # Errors
    /// As [`home_recalled`](Self::home_recalled).
    pub fn home_recalled_after_restart(&mut self) -> Result<Vec<HomingReport>, RigError> {
        let began = self.clock.now();
        loop {
            self.clock.wait(LOOK);
            // What a tendon still turns is followed, so that it does not count as lost.
            self.note_positions();
            let waited = self.clock.now().saturating_sub(began);
            if waited < LETTING_GO {
                continue;
            }
            match self.home_recalled() {
                Err(RigError::Servo(error)) if waited < RESTART => {
                    tracing::debug!("{error}");
                }
                recalled => return recalled,
            }
        }
    }

    /// Sets homes in the servos' own counts, and where they stand.
    pub(super) fn set_homes(
        &mut self,
        homes: &[Ticks],
        positions: &[Ticks],
    ) -> Result<Vec<HomingReport>, RigError> {
        let servos = self.ids.iter().zip(homes).zip(positions);
        let turns: Vec<Turns> = servos
            .map(|((id, home), last)| Turns {
                id: id.get(),
                home: home.0,
                last: last.0,
            })
            .collect();
        self.turns.write(&turns)?;
        self.log(|| LogRecord::Homes(self.known_homes()));
        let before = std::mem::replace(
            &mut self.homing,
            homes.iter().map(|&home| Homing::Homed(home)).collect(),
        );
        let servos = self.ids.iter().zip(before).zip(turns);
        Ok(servos
            .map(|((&id, before), turns)| HomingReport {
                id,
                before,
                position: Ticks(turns.last.saturating_sub(turns.home)),
            })
            .collect())
    }

    /// Homes in the servos' own counts.
    ///
    /// # Errors
    /// [`RigError::NotHomed`], with a line for each that is not known.
    pub(super) fn homes(&self) -> Result<Vec<Ticks>, RigError> {
        let known = self.ids.iter().zip(&self.homing);
        let (homes, unknown): (Vec<_>, Vec<_>) = known
            .map(|(&id, homing)| homing.known(id))
            .partition(Result::is_ok);
        if unknown.is_empty() {
            return Ok(homes.into_iter().flatten().collect());
        }
        Err(RigError::NotHomed(
            unknown.into_iter().filter_map(Result::err).collect(),
        ))
    }

    /// Where the servos stand in their own counts.
    pub(super) fn positions(&mut self) -> Result<Vec<Ticks>, RigError> {
        let present = self.bus.present(&self.ids);
        Ok(present
            .into_iter()
            .map(|present| present.map(|present| present.position))
            .collect::<Result<_, _>>()?)
    }
}

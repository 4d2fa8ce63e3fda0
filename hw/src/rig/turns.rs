//! What servos forget when their power goes: how many turns they stand from where they started.
//!
//! A servo's encoder knows its angle within a turn; the turns it counts in memory. The rig keeps, in a file beside its own,
//! where home is in each servo's count and where the servo last stood. From these a servo that lost its count is found again,
//! as long as it turned by less than a quarter of a turn meanwhile.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use tdcr_base::files::{self, write_atomically};

use super::RigError;
use crate::log::ServoHome;
use crate::servo::{ServoId, Ticks};

/// Largest distance (ticks) between where a servo was left and where it is found for which its turns are known: a quarter of
/// a turn.
pub const KNOWN_WITHIN: i32 = Ticks::PER_TURN / 4;

/// A servo's place is written down whenever it is farther than this (ticks) from the one in the file: half of what may go
/// wrong at a loss of power, so that the other half is left to what turns until then.
const WRITE_BEYOND: i32 = KNOWN_WITHIN / 2;

/// Largest state file (bytes).
const LARGEST: u64 = 1 << 20;

/// Where a servo's home is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Turns {
    /// Address of the servo.
    pub id: u8,
    /// Home in the servo's own count (ticks).
    pub home: i32,
    /// Where it stood when this was written, in its own count (ticks).
    pub last: i32,
}

/// What is known of where a servo stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Homing {
    /// Its home is at this position of its own count.
    Homed(Ticks),
    /// It was never homed.
    Never,
    /// It lost its count, or was turned by hand: it stands this far (ticks, less than half a turn) from where it was left,
    /// turns apart.
    Lost {
        /// Where home was in its old count.
        home: Ticks,
        /// Where it was left in its old count.
        last: Ticks,
        /// From there to the nearest position that it can stand at.
        off: i32,
    },
}

impl Turns {
    /// What follows for a servo that now says to stand at `found` in its own count.
    pub fn meet(&self, found: Ticks) -> Homing {
        let moved = i64::from(found.0) - i64::from(self.last);
        if moved.abs() <= i64::from(KNOWN_WITHIN) {
            return Homing::Homed(Ticks(self.home));
        }
        let turn = i64::from(Ticks::PER_TURN);
        let off = (moved + turn / 2).rem_euclid(turn) - turn / 2;
        Homing::Lost {
            home: Ticks(self.home),
            last: Ticks(self.last),
            // Less than a turn.
            off: off as i32,
        }
    }
}

impl Homing {
    /// Home in the count of a servo that stands at `found`, from where it was left; `None` where that does not tell it.
    pub fn recall(self, found: Ticks) -> Option<Ticks> {
        match self {
            Self::Homed(home) => Some(home),
            Self::Never => None,
            Self::Lost { home, last, off } => {
                let stands = last.0.checked_add(off)?;
                let shift = found.0.checked_sub(stands)?;
                (off.abs() <= KNOWN_WITHIN).then_some(Ticks(home.0.checked_add(shift)?))
            }
        }
    }
}

/// The file of a rig's turns.
#[derive(Debug)]
pub struct TurnsFile {
    /// Where it lies; `None` for servos in memory, whose turns end with the program.
    path: Option<PathBuf>,
    written: Vec<Turns>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Contents {
    /// Version of the layout.
    format: u32,
    servos: Vec<Turns>,
}

const FORMAT: u32 = 1;

impl TurnsFile {
    /// The file beside that of a rig: `rig.toml` has `rig.turns.json`.
    pub fn beside(rig: &Path) -> PathBuf {
        rig.with_extension("turns.json")
    }

    /// Turns that are kept in memory alone.
    pub fn in_memory() -> Self {
        Self {
            path: None,
            written: Vec::new(),
        }
    }

    /// Turns that a log has, kept in memory alone.
    pub fn of_log(homes: &[ServoHome]) -> Self {
        let turns = homes.iter().map(|home| Turns {
            id: home.id.get(),
            home: home.home.0,
            last: home.last.0,
        });
        Self {
            path: None,
            written: turns.collect(),
        }
    }

    /// Reads the file at `path`; none of the servos is known where there is none.
    ///
    /// # Errors
    /// [`RigError::Read`]; [`RigError::Parse`] for a file that is damaged.
    pub fn open(path: PathBuf) -> Result<Self, RigError> {
        let fail = |source| RigError::Read {
            path: path.clone(),
            source,
        };
        let written = match files::read_text(&path, LARGEST) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Vec::new(),
            Err(error) => return Err(fail(error)),
            Ok(text) => {
                let contents = serde_json::from_str::<Contents>(&text);
                let known = contents.map_err(|error| error.to_string()).and_then(|c| {
                    if c.format == FORMAT {
                        return Ok(c.servos);
                    }
                    Err(format!("format {}, expected {FORMAT}", c.format))
                });
                known.map_err(|reason| RigError::Parse {
                    path: path.clone(),
                    reason: format!("{reason}; remove the file and home the rig anew"),
                })?
            }
        };
        Ok(Self {
            path: Some(path),
            written,
        })
    }

    /// The same, from now on in memory alone.
    pub fn kept_in_memory(self) -> Self {
        Self { path: None, ..self }
    }

    /// What is written of a servo.
    pub fn of(&self, id: ServoId) -> Option<&Turns> {
        self.written.iter().find(|turns| turns.id == id.get())
    }

    /// Writes down homes, and where servos stand, all of it.
    ///
    /// # Errors
    /// [`RigError::Write`].
    pub fn write(&mut self, turns: &[Turns]) -> Result<(), RigError> {
        for new in turns {
            match self.written.iter_mut().find(|old| old.id == new.id) {
                Some(old) => *old = *new,
                None => self.written.push(*new),
            }
        }
        let Some(path) = &self.path else {
            return Ok(());
        };
        let contents = Contents {
            format: FORMAT,
            servos: self.written.clone(),
        };
        let mut bytes = serde_json::to_vec_pretty(&contents).expect("plain values serialise");
        bytes.push(b'\n');
        write_atomically(path, |file| file.write_all(&bytes)).map_err(|source| RigError::Write {
            path: path.clone(),
            source,
        })
    }

    /// Writes `turns` down where a servo has moved far from what is written.
    ///
    /// # Errors
    /// [`RigError::Write`].
    pub fn follow(&mut self, turns: &[Turns]) -> Result<(), RigError> {
        let is_near = |new: &Turns| {
            self.written.iter().any(|old| {
                let moved = i64::from(old.last) - i64::from(new.last);
                (old.id, old.home) == (new.id, new.home) && moved.abs() <= i64::from(WRITE_BEYOND)
            })
        };
        match turns.iter().all(is_near) {
            true => Ok(()),
            false => self.write(turns),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use std::fs;

    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_servo_that_lost_its_turns_is_found_again(
            home in -8000..8000, last in -20_000..20_000, turned in -KNOWN_WITHIN..=KNOWN_WITHIN, offset in -5..5_i32,
        ) {
            let turns = Turns { id: 1, home, last };
            // Its own count begins anew, some turns off.
            let found = Ticks(last + turned + offset * Ticks::PER_TURN);
            let expected = Ticks(home + offset * Ticks::PER_TURN);
            prop_assert_eq!(turns.meet(found).recall(found), Some(expected));
            prop_assert_eq!(matches!(turns.meet(found), Homing::Homed(_)), offset == 0);
        }

        #[test]
        fn a_servo_that_was_turned_far_is_not_guessed(
            last in -20_000..20_000, turned in KNOWN_WITHIN + 1..3 * KNOWN_WITHIN, offset in -5..5_i32,
        ) {
            let turns = Turns { id: 1, home: 0, last };
            let found = Ticks(last + turned + offset * Ticks::PER_TURN);
            prop_assert_eq!(turns.meet(found).recall(found), None);
        }

        #[test]
        fn no_count_overflows(home: i32, last: i32, found: i32) {
            let _ = Turns { id: 1, home, last }.meet(Ticks(found)).recall(Ticks(found));
        }
    }

    #[test]
    fn turns_are_whole_on_disk_and_written_when_servos_go_far() {
        let folder = tempfile::tempdir().unwrap();
        let path = TurnsFile::beside(&folder.path().join("rig.toml"));
        let at = |last| {
            [Turns {
                id: 3,
                home: 10,
                last,
            }]
        };
        let mut file = TurnsFile::open(path.clone()).unwrap();
        let three = ServoId::new(3).unwrap();
        assert_eq!(file.of(three), None);
        file.follow(&at(0)).unwrap();
        file.follow(&at(WRITE_BEYOND)).unwrap();
        let read = |path: &PathBuf| *TurnsFile::open(path.clone()).unwrap().of(three).unwrap();
        assert_eq!(read(&path), at(0)[0]);
        file.follow(&at(WRITE_BEYOND + 1)).unwrap();
        assert_eq!(read(&path), at(WRITE_BEYOND + 1)[0]);
        let marked = [&b"\xef\xbb\xbf"[..], &fs::read(&path).unwrap()].concat();
        fs::write(&path, marked).unwrap();
        assert_eq!(read(&path), at(WRITE_BEYOND + 1)[0]);
        fs::write(&path, "{\"format\":1,\"serv").unwrap();
        let said = TurnsFile::open(path).unwrap_err().to_string();
        assert!(
            said.contains("rig.turns.json") && said.contains("home the rig anew"),
            "{said}"
        );
    }
}

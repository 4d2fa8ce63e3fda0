//! What can go wrong on a simulated bus, and when.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use thiserror::Error;

use crate::servo::ServoId;

/// Something that goes wrong. As text: `lost=0.01`, `snapped:4`, `unplugged`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// This share of all bytes, both ways, is lost.
    Lost(f64),
    /// This share of all bytes, both ways, arrives with a bit flipped.
    Corrupted(f64),
    /// This share of all bytes, both ways, arrives twice.
    Duplicated(f64),
    /// This share of all answers comes [`LATENESS`] later.
    Late(f64),
    /// The servo's data line falls off: it neither hears nor answers.
    Silent(ServoId),
    /// The servo is as hot as its limit.
    Overheated(ServoId),
    /// The servo reports an overload.
    Overloaded(ServoId),
    /// The servo is without power for a moment.
    PowerCycled(ServoId),
    /// The servo's tendon snaps.
    Snapped(ServoId),
    /// The servo's tendon jams at the base.
    Jammed(ServoId),
    /// The computer's cable is pulled: every call on the line fails.
    Unplugged,
}

/// How late answers are under [`Fault::Late`].
pub const LATENESS: Duration = Duration::from_millis(30);

/// A kind of fault by its name, made from what it is about.
type Named<T> = (&'static str, fn(T) -> Fault);

impl Fault {
    const RATES: [Named<f64>; 4] = [
        ("lost", Self::Lost),
        ("corrupted", Self::Corrupted),
        ("duplicated", Self::Duplicated),
        ("late", Self::Late),
    ];
    const OF_SERVOS: [Named<ServoId>; 6] = [
        ("silent", Self::Silent),
        ("overheated", Self::Overheated),
        ("overloaded", Self::Overloaded),
        ("power-cycled", Self::PowerCycled),
        ("snapped", Self::Snapped),
        ("jammed", Self::Jammed),
    ];
    const UNPLUGGED: &str = "unplugged";

    /// The servo that it is about.
    pub fn servo(&self) -> Option<ServoId> {
        match *self {
            Self::Lost(_)
            | Self::Corrupted(_)
            | Self::Duplicated(_)
            | Self::Late(_)
            | Self::Unplugged => None,
            Self::Silent(id)
            | Self::Overheated(id)
            | Self::Overloaded(id)
            | Self::PowerCycled(id)
            | Self::Snapped(id)
            | Self::Jammed(id) => Some(id),
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rate = |f: &mut fmt::Formatter<'_>, name, share| write!(f, "{name}={share}");
        let of = |f: &mut fmt::Formatter<'_>, name, id| write!(f, "{name}:{id}");
        match *self {
            Self::Lost(share) => rate(f, "lost", share),
            Self::Corrupted(share) => rate(f, "corrupted", share),
            Self::Duplicated(share) => rate(f, "duplicated", share),
            Self::Late(share) => rate(f, "late", share),
            Self::Silent(id) => of(f, "silent", id),
            Self::Overheated(id) => of(f, "overheated", id),
            Self::Overloaded(id) => of(f, "overloaded", id),
            Self::PowerCycled(id) => of(f, "power-cycled", id),
            Self::Snapped(id) => of(f, "snapped", id),
            Self::Jammed(id) => of(f, "jammed", id),
            Self::Unplugged => f.write_str(Self::UNPLUGGED),
        }
    }
}

/// A text that names no fault.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error(
    "`{0}` is no fault; expected lost=SHARE, corrupted=SHARE, duplicated=SHARE, late=SHARE (shares from 0 to 1), silent:ID, \
     overheated:ID, overloaded:ID, power-cycled:ID, snapped:ID, jammed:ID (ids from 0 to 252) or unplugged"
)]
pub struct UnknownFault(pub String);

impl FromStr for Fault {
    type Err = UnknownFault;

    fn from_str(text: &str) -> Result<Self, UnknownFault> {
        let rate = || {
            let (name, share) = text.split_once('=')?;
            let (_, fault) = Self::RATES.into_iter().find(|(known, _)| *known == name)?;
            let share: f64 = share.parse().ok()?;
            (0.0..=1.0).contains(&share).then(|| fault(share))
        };
        let of_servo = || {
            let (name, id) = text.split_once(':')?;
            let mut known = Self::OF_SERVOS.into_iter();
            let (_, fault) = known.find(|(known, _)| *known == name)?;
            Some(fault(ServoId::new(id.parse().ok()?)?))
        };
        let unplugged = || (text == Self::UNPLUGGED).then_some(Self::Unplugged);
        (rate().or_else(of_servo).or_else(unplugged)).ok_or_else(|| UnknownFault(text.to_owned()))
    }
}

/// A fault and when it comes. As text: that of the fault, then `@` and seconds; without them, at once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScheduledFault {
    /// What happens.
    pub fault: Fault,
    /// At which time of the clock.
    pub at: Duration,
}

impl FromStr for ScheduledFault {
    type Err = UnknownFault;

    fn from_str(text: &str) -> Result<Self, UnknownFault> {
        let (fault, seconds) = text.split_once('@').unwrap_or((text, "0"));
        let at = (seconds.parse().ok())
            .and_then(|seconds| Duration::try_from_secs_f64(seconds).ok())
            .ok_or_else(|| UnknownFault(text.to_owned()))?;
        Ok(Self {
            fault: fault.parse()?,
            at,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_read_back_what_they_write() {
        let id = ServoId::new(7).expect("an id");
        let rates = Fault::RATES.map(|(_, fault)| fault(0.25));
        let of_servos = Fault::OF_SERVOS.map(|(_, fault)| fault(id));
        for fault in rates.into_iter().chain(of_servos).chain([Fault::Unplugged]) {
            assert_eq!(fault.to_string().parse(), Ok(fault));
            let scheduled = ScheduledFault {
                fault,
                at: Duration::from_millis(1500),
            };
            assert_eq!(format!("{fault}@1.5").parse(), Ok(scheduled));
        }
    }

    #[test]
    fn other_texts_are_refused_and_the_message_names_them() {
        for text in [
            "",
            "lost",
            "lost=2",
            "lost=-0.1",
            "lost=nan",
            "silent",
            "silent:253",
            "snap:4",
            "snapped:4@-1",
            "snapped:4@x",
            "unplugged:4",
        ] {
            let error = text.parse::<ScheduledFault>().expect_err(text);
            assert!(error.to_string().starts_with('`'), "{error}");
        }
    }
}

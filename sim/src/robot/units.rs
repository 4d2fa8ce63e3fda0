//! What commands are measured in, and which tendons belong together.

use std::fmt;
use std::ops::Range;

use super::{Body, Drive, RobotSpec, Tendon};

/// Unit of a tendon's command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CommandUnit {
    /// A rest length or a length (m).
    Metre,
    /// A tension (N).
    Newton,
}

/// A unit in which people read values of another one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DisplayUnit {
    /// Its symbol.
    pub symbol: &'static str,
    /// How many of it make one of the other.
    pub per_unit: f64,
    /// Digits after the point that say as much as one wants to know.
    pub decimals: usize,
}

/// Tendons of one module, or that end at one disc on routes of their own. Their commands have one unit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TendonGroup {
    /// What they have in common, such as `module 1`.
    pub name: String,
    /// Their places in a command.
    pub tendons: Range<usize>,
    /// Unit of their commands.
    pub unit: CommandUnit,
}

impl CommandUnit {
    /// Symbol of the SI unit, in which commands are given.
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Metre => "m",
            Self::Newton => "N",
        }
    }

    /// The unit for tables and pictures: millimetres for lengths.
    pub fn display(self) -> DisplayUnit {
        match self {
            Self::Metre => DisplayUnit {
                symbol: "mm",
                per_unit: 1e3,
                decimals: 1,
            },
            Self::Newton => DisplayUnit {
                symbol: "N",
                per_unit: 1.0,
                decimals: 2,
            },
        }
    }
}

/// The symbol.
impl fmt::Display for CommandUnit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.symbol())
    }
}

impl Drive {
    /// Unit of the commands that the drive takes.
    pub fn unit(self) -> CommandUnit {
        match self {
            Self::Gain(_) | Self::Length => CommandUnit::Metre,
            Self::Tension => CommandUnit::Newton,
        }
    }
}

impl Tendon {
    /// Unit of the tendon's commands.
    pub fn unit(&self) -> CommandUnit {
        self.drive.unit()
    }
}

impl RobotSpec {
    /// The tendons in a command's order, those that belong together in a group: those of a module, and neighbours among
    /// those with routes of their own that end at the same body.
    pub fn tendon_groups(&self) -> Vec<TendonGroup> {
        let mut groups: Vec<TendonGroup> = Vec::new();
        let of_modules = self
            .modules
            .iter()
            .enumerate()
            .filter_map(|(index, module)| {
                let tendon = module.tendons.as_ref()?;
                Some((
                    format!("module {}", index + 1),
                    module.holes.count(),
                    tendon,
                ))
            });
        let own = self.routes.iter().map(|route| {
            let end = match route.through.last().map(|waypoint| waypoint.0) {
                Some(Body::Disc(disc)) => format!("routes to disc {disc}"),
                _ => "routes to the base".to_owned(),
            };
            (end, 1, &route.tendon)
        });
        let mut first = 0;
        for (name, count, tendon) in of_modules.chain(own) {
            let (tendons, unit) = (first..first + count, tendon.drive.unit());
            first = tendons.end;
            match groups.last_mut() {
                Some(last) if last.name == name && last.unit == unit => {
                    last.tendons.end = first;
                }
                _ => groups.push(TendonGroup {
                    name,
                    tendons,
                    unit,
                }),
            }
        }
        groups
    }
}

//! Which numbers of a command belong together, and what they are measured in.

use std::ops::Range;

use tdcr_sim::robot::{CommandUnit, RobotSpec};

use super::html::{NOT_AVAILABLE, fixed};

/// Numbers of a command that belong together: those of a module's tendons, or all that another program recorded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MotorGroup {
    /// What they have in common; empty where that is not known.
    pub name: String,
    /// Their places in a command.
    pub motors: Range<usize>,
    /// Their unit; `None` where nobody says.
    pub unit: Option<CommandUnit>,
}

impl MotorGroup {
    /// The groups of a robot's commands; all of the `motors` in one group of unknown unit where no robot is known.
    pub fn of(robot: Option<&RobotSpec>, motors: usize) -> Vec<Self> {
        let unknown = Self {
            name: String::new(),
            motors: 0..motors,
            unit: None,
        };
        robot.map_or_else(
            || vec![unknown],
            |robot| {
                let groups = robot.tendon_groups().into_iter();
                let known = groups.map(|group| Self {
                    name: group.name,
                    motors: group.tendons,
                    unit: Some(group.unit),
                });
                // What moves obstacles follows the tendons.
                let tendons = robot.tendon_count();
                let obstacles = (tendons < motors).then(|| Self {
                    name: "obstacles".to_owned(),
                    motors: tendons..motors,
                    unit: None,
                });
                known.chain(obstacles).collect()
            },
        )
    }

    /// The unit that values are shown in.
    pub(crate) fn unit_name(&self) -> &'static str {
        self.unit
            .map_or("motor units", |unit| unit.display().symbol)
    }

    /// A value in the unit that it is shown in.
    pub(crate) fn shown(&self, value: f64) -> f64 {
        value * self.unit.map_or(1.0, |unit| unit.display().per_unit)
    }

    /// Values with as many digits as one wants to know.
    fn text(&self, values: &[f64]) -> String {
        let shown: Vec<f64> = values.iter().map(|&value| self.shown(value)).collect();
        let decimals = match self.unit {
            Some(unit) => unit.display().decimals,
            None => recorded_decimals(&shown),
        };
        let texts: Vec<String> = shown.iter().map(|&x| fixed(x, decimals)).collect();
        texts.join(", ")
    }
}

/// Digits after the point that tell a thousandth of the largest magnitude.
fn recorded_decimals(values: &[f64]) -> usize {
    let largest = values
        .iter()
        .copied()
        .map(f64::abs)
        .filter(|x| x.is_finite());
    let largest = largest.fold(0.0, f64::max);
    match largest > 0.0 {
        true => (3.0 - largest.log10().ceil()).clamp(0.0, 6.0) as usize,
        false => 0,
    }
}

/// A command in words: groups apart, and the unit once where all have the same.
pub(crate) fn command_text(command: &[f64], groups: &[MotorGroup]) -> String {
    let filled = groups.iter().filter_map(|group| {
        let values = command.get(group.motors.clone())?;
        (!values.is_empty()).then_some((group, values))
    });
    let filled: Vec<(&MotorGroup, &[f64])> = filled.collect();
    let Some((first, _)) = filled.first() else {
        return format!("Command: {NOT_AVAILABLE}");
    };
    let alike = filled.iter().all(|(group, _)| group.unit == first.unit);
    let texts = filled.iter().map(|(group, values)| match alike {
        true => group.text(values),
        false => format!("{}\u{a0}{}", group.text(values), group.unit_name()),
    });
    let texts = texts.collect::<Vec<_>>().join(" | ");
    match alike {
        true => format!("Command ({}): {texts}", first.unit_name()),
        false => format!("Command: {texts}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn group(motors: Range<usize>, unit: Option<CommandUnit>) -> MotorGroup {
        MotorGroup {
            name: String::new(),
            motors,
            unit,
        }
    }

    #[test]
    fn a_command_is_said_in_its_units_and_in_the_groups_of_its_modules() {
        let (metre, newton) = (Some(CommandUnit::Metre), Some(CommandUnit::Newton));
        let forces = [2.3594, 0.0, 1.0, 10.0, 3.0, 2.0, 1.0, 0.5];
        let modules = [group(0..4, newton), group(4..8, newton)];
        assert_eq!(
            command_text(&forces, &modules),
            "Command (N): 2.36, 0.00, 1.00, 10.00 | 3.00, 2.00, 1.00, 0.50"
        );
        let mixed = [group(0..2, metre), group(2..3, newton)];
        assert_eq!(
            command_text(&[0.034, 0.0265, 2.5], &mixed),
            "Command: 34.0, 26.5\u{a0}mm | 2.50\u{a0}N"
        );
        let recorded = [group(0..3, None)];
        assert_eq!(
            command_text(&[-1200.0, 2300.0, 64.0], &recorded),
            "Command (motor units): -1200, 2300, 64"
        );
        assert_eq!(
            command_text(&[0.034, 0.007, 0.0265], &recorded),
            "Command (motor units): 0.0340, 0.0070, 0.0265"
        );
        assert_eq!(command_text(&[], &recorded), "Command: not available");
    }
}

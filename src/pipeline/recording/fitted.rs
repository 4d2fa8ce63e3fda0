//! What is fitted to a recording, by the names that users give.

use tdcr_sim::inverse::recording::{Group, Order, RecordingSettings};
use tdcr_sim::robot::RobotSpec;

/// What is fitted to a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    /// The default groups, as far as the robot has them and the recording can tell them. Where a recording of markers
    /// contradicts the column map clearly, servos and the frame are then taken as the recording tells them.
    pub defaults: bool,
    /// Groups of unknowns besides.
    pub groups: Vec<Group>,
    /// Whether servos are taken as the markers move in rows in which one servo moves alone, and not as the column map says.
    pub servo_map: bool,
}

impl Default for Fitted {
    fn default() -> Self {
        Self {
            defaults: true,
            ..Self::nothing()
        }
    }
}

impl Fitted {
    /// Name of the default groups.
    pub const DEFAULT: &str = "default";
    /// Name of the search for which servo pulls which tendon.
    pub const SERVO_MAP: &str = "servo_map";

    /// Nothing: the robot is only held against the recording.
    pub fn nothing() -> Self {
        Self {
            defaults: false,
            groups: Vec::new(),
            servo_map: false,
        }
    }

    /// All names.
    pub fn names() -> impl Iterator<Item = &'static str> {
        let groups = Group::ALL.map(Group::name).into_iter();
        groups.chain([Self::SERVO_MAP, Self::DEFAULT])
    }

    /// What `names` say; one that is none of [`names`](Self::names) is returned as the error.
    ///
    /// # Errors
    /// The name.
    pub fn named<'a>(names: impl IntoIterator<Item = &'a str>) -> Result<Self, &'a str> {
        let mut fitted = Self::nothing();
        for name in names {
            match Group::named(name) {
                Some(group) => fitted.groups.push(group),
                None if name == Self::SERVO_MAP => fitted.servo_map = true,
                None if name == Self::DEFAULT => fitted.defaults = true,
                None => return Err(name),
            }
        }
        Ok(fitted)
    }

    /// The groups for a robot and a recording whose rows are in `order`.
    pub(super) fn groups_of(&self, robot: &RobotSpec, order: Order) -> Vec<Group> {
        let mut groups = match self.defaults {
            true => RecordingSettings::of(robot, order).groups,
            false => Vec::new(),
        };
        groups.extend(&self.groups);
        groups
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_stand_beside_the_default_ones_by_name() {
        let fitted = Fitted::named(["friction", "default", "servo_map"]);
        let expected = Fitted {
            defaults: true,
            groups: vec![Group::Friction],
            servo_map: true,
        };
        assert_eq!(fitted, Ok(expected.clone()));
        assert_eq!(Fitted::named(["lag", "mush"]), Err("mush"));
        let robot = RobotSpec::standard("2m").expect("a standard robot");
        let all = expected.groups_of(&robot, Order::Motion);
        assert!(all.ends_with(&[Group::Friction]) && all.contains(&Group::Lag));
        assert!(
            !expected
                .groups_of(&robot, Order::AtRest)
                .contains(&Group::Lag)
        );
        assert!(
            Fitted::nothing()
                .groups_of(&robot, Order::Motion)
                .is_empty()
        );
    }
}

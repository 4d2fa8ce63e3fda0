//! Fields of a robot file by path: `base.hole_height`, `modules[1].radius`, `modules[*].tendons.drive.gain`, `gravity[2]`.

use serde_json::Value;
use tdcr_sim::robot::{ParameterKind, RobotSpec};

/// Fields of a robot file that a path may begin with.
const ROOTS: [&str; 6] = ["gravity", "routing", "base", "modules", "routes", "cameras"];

/// Where a value lies in a robot's specification.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::study) struct Field(Vec<Step>);

#[derive(Clone, Debug, PartialEq, Eq)]
enum Step {
    Key(String),
    Entry(usize),
    All,
}

impl Field {
    /// The path in `text`; `None` where it is none of a robot file.
    pub fn parse(text: &str) -> Option<Self> {
        let mut steps = Vec::new();
        for part in text.split('.') {
            let (key, mut rest) = part.split_at(part.find('[').unwrap_or(part.len()));
            let plain = |c: char| c.is_ascii_alphanumeric() || c == '_';
            if key.is_empty() || !key.chars().all(plain) {
                return None;
            }
            steps.push(Step::Key(key.to_owned()));
            while let Some((inside, after)) = rest.strip_prefix('[').and_then(|r| r.split_once(']'))
            {
                steps.push(match inside {
                    "*" => Step::All,
                    number => Step::Entry(number.parse().ok()?),
                });
                rest = after;
            }
            if !rest.is_empty() {
                return None;
            }
        }
        match &steps[..] {
            [Step::Key(root), ..] if ROOTS.contains(&root.as_str()) => Some(Self(steps)),
            _ => None,
        }
    }

    /// Whether one lies within the other, or they are the same.
    pub fn overlaps(&self, other: &Self) -> bool {
        let mut steps = self.0.iter().zip(&other.0);
        steps.all(|steps| match steps {
            (Step::Key(a), Step::Key(b)) => a == b,
            (Step::Entry(a), Step::Entry(b)) => a == b,
            (Step::All, Step::Entry(_) | Step::All) | (Step::Entry(_), Step::All) => true,
            (Step::Key(_), _) | (_, Step::Key(_)) => false,
        })
    }

    /// Unit of its numbers, by its name; empty where that does not tell.
    pub fn unit(&self) -> &'static str {
        let named = self.0.iter().rev().find_map(|step| match step {
            Step::Key(key) => Some(key.as_str()),
            _ => None,
        });
        let name = named.unwrap_or_default();
        if let Some(kind) = ParameterKind::named(name) {
            return kind.quantity.unit;
        }
        match name {
            "position" | "hole_height" | "first_offset" | "length" | "radius" | "half_height"
            | "joint_below" | "holes" => "m",
            "gravity" => "m/s\u{b2}",
            "clocking" => "rad",
            "contact_stiffness" => "N/m",
            "stiffening" => "1/m",
            _ => "",
        }
    }

    /// The robot with `value` there.
    ///
    /// # Errors
    /// What is wrong, as text: a place that the robot does not have, or a value that it cannot take.
    pub fn set(&self, spec: &RobotSpec, value: &Value) -> Result<RobotSpec, String> {
        let mut tree = serde_json::to_value(spec).map_err(|error| error.to_string())?;
        write(&mut tree, &self.0, &whole(value))?;
        serde_json::from_value(tree).map_err(|error| error.to_string())
    }
}

/// A number without a fraction as a whole one, which fields of both kinds take.
fn whole(value: &Value) -> Value {
    match value.as_f64() {
        Some(number) if value.is_f64() && number.fract() == 0.0 && number.abs() < 1e15 => {
            Value::from(number as i64)
        }
        _ => value.clone(),
    }
}

fn write(tree: &mut Value, path: &[Step], value: &Value) -> Result<(), String> {
    let Some((step, rest)) = path.split_first() else {
        tree.clone_from(value);
        return Ok(());
    };
    match (step, tree) {
        (Step::Key(key), Value::Object(table)) => {
            let entry = table
                .entry(key.clone())
                .or_insert_with(|| match rest.is_empty() {
                    true => Value::Null,
                    false => Value::Object(serde_json::Map::new()),
                });
            write(entry, rest, value)
        }
        (Step::Entry(index), Value::Array(list)) => {
            let count = list.len();
            let entry = list.get_mut(*index);
            let entry = entry.ok_or_else(|| {
                format!("there is no entry [{index}]: the list has {count}, counted from 0")
            })?;
            write(entry, rest, value)
        }
        (Step::All, Value::Array(list)) => {
            (list.iter_mut()).try_for_each(|entry| write(entry, rest, value))
        }
        (Step::Key(key), _) => Err(format!("there is no field `{key}`")),
        (Step::Entry(_) | Step::All, found) => {
            Err(format!("a list is expected, and the robot has {found}"))
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;
    use serde_json::json;

    #[test]
    fn a_path_sets_the_field_that_a_robot_file_has_there() {
        let spec = RobotSpec::standard("2m").unwrap();
        let set = |path: &str, value: Value| Field::parse(path).unwrap().set(&spec, &value);
        assert_eq!(
            set("modules[1].radius", json!(0.018)).unwrap().modules[1].radius,
            0.018
        );
        let all = set("modules[*].pitch", json!(0.02)).unwrap();
        assert!(all.modules.iter().all(|module| module.pitch == 0.02));
        assert_eq!(
            set("modules[0].discs", json!(7.0)).unwrap().modules[0].discs,
            7
        );
        assert_eq!(set("gravity[2]", json!(-1.62)).unwrap().gravity[2], -1.62);
        let routed = set("routing", json!("base")).unwrap();
        assert_eq!(routed.routing, tdcr_sim::robot::Routing::Base);
        assert!(
            set("modules[2].radius", json!(1.0))
                .unwrap_err()
                .contains("the list has 2")
        );
        assert!(
            set("modules[0].radios", json!(1.0))
                .unwrap_err()
                .contains("radios")
        );
        for none in [
            "radius",
            "modules[x]",
            "modules[0",
            "modules..pitch",
            "name",
            "",
        ] {
            assert_eq!(Field::parse(none), None, "{none}");
        }
    }
}

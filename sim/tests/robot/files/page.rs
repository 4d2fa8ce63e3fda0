//! `docs/robot-files.md`, read into sections and rows, and the robot files that they speak of.

use toml::{Table, Value};

/// The page.
const PAGE: &str = include_str!("../../../../docs/robot-files.md");

/// A section of the page: a table of a robot file, or the choices of a field.
pub struct Section {
    /// Where such tables stand, as `modules[].mass`; empty for the file itself.
    pub paths: Vec<&'static str>,
    /// Such a table.
    example: Option<Table>,
    pub rows: Vec<Row>,
}

pub struct Row {
    /// With its quotation marks where it is a text to choose.
    pub field: &'static str,
    pub kind: &'static str,
    pub default: &'static str,
    pub accepted: &'static str,
}

/// The texts between backticks.
pub fn quoted(text: &str) -> Vec<&str> {
    text.split('`').skip(1).step_by(2).collect()
}

fn unquoted(text: &'static str) -> &'static str {
    text.trim_matches('`')
}

/// The TOML blocks of a part of the page.
fn blocks(text: &str) -> Vec<Table> {
    let blocks = text.split("```toml\n").skip(1);
    blocks
        .map(|rest| rest.split("```").next().unwrap().parse().unwrap())
        .collect()
}

pub fn sections() -> Vec<Section> {
    let parts = PAGE.split("\n## ").skip(1);
    parts
        .map(|part| {
            let (heading, body) = part.split_once('\n').unwrap();
            let mut paths = quoted(heading);
            if heading == "The file" {
                paths.push("");
            }
            assert!(!paths.is_empty(), "no path in the heading `{heading}`");
            let name = paths[0].rsplit('.').next().unwrap().trim_end_matches("[]");
            let example = blocks(body).pop().map(|table| match table.get(name) {
                Some(Value::Table(inner)) if table.len() == 1 => inner.clone(),
                _ => table,
            });
            let lines = body.lines().filter(|line| line.starts_with("| `"));
            let row = |line: &'static str| {
                let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
                let [field, kind, _, default, accepted, meaning] = cells[..] else {
                    panic!("not six cells: {line}");
                };
                assert!(!meaning.is_empty(), "no meaning: {line}");
                let field = unquoted(field);
                Row {
                    field,
                    kind,
                    default,
                    accepted,
                }
            };
            Section {
                paths,
                example,
                rows: lines.map(row).collect(),
            }
        })
        .collect()
}

/// The complete robot of the page.
pub fn robot() -> Value {
    Value::Table(blocks(PAGE.split("\n## ").next().unwrap()).remove(0))
}

/// The value at a path; empty tables are made on the way.
pub fn at<'a>(document: &'a mut Value, path: &str) -> &'a mut Value {
    let mut value = document;
    for step in path.split('.').filter(|step| !step.is_empty()) {
        let empty = || Value::Table(Table::new());
        let table = value.as_table_mut().unwrap();
        value = match step.strip_suffix("[]") {
            None => table.entry(step).or_insert_with(empty),
            Some(name) => {
                let list = table
                    .entry(name)
                    .or_insert_with(|| Value::Array(Vec::new()));
                let list = list.as_array_mut().unwrap();
                if list.is_empty() {
                    list.push(empty());
                }
                &mut list[0]
            }
        };
    }
    value
}

/// A robot file that has the section's table at the path.
pub fn document(sections: &[Section], path: &str) -> Value {
    let of = |path: &str| sections.iter().find(|s| s.paths.contains(&path)).unwrap();
    let mut document = match path.rsplit_once('.') {
        None => robot(),
        Some((above, _)) => {
            let mut document = document(sections, above);
            if of(above).is_choice() {
                *at(&mut document, above) = Value::Table(Table::new());
            }
            document
        }
    };
    if let Some(example) = &of(path).example {
        *at(&mut document, path) = Value::Table(example.clone());
    }
    document
}

/// A value as TOML writes it; `None` for other texts.
pub fn value(text: &str) -> Option<Value> {
    let table: Table = format!("x = {text}").parse().ok()?;
    table.get("x").cloned()
}

impl Section {
    pub fn is_choice(&self) -> bool {
        self.rows.iter().all(|row| row.default.is_empty())
    }

    /// A file in which the row's field has this value.
    pub fn with(&self, mut document: Value, path: &str, row: &Row, value: &Value) -> Value {
        if row.kind == "value" {
            *at(&mut document, path) = Value::String(row.field.trim_matches('"').to_owned());
            return document;
        }
        if self.is_choice() {
            *at(&mut document, path) = Value::Table(Table::new());
        }
        let table = at(&mut document, path).as_table_mut().unwrap();
        for other in row.alternatives() {
            table.remove(other);
        }
        table.insert(row.field.to_owned(), value.clone());
        document
    }
}

impl Row {
    /// Fields that must not stand beside this one.
    pub fn alternatives(&self) -> Vec<&str> {
        let of_them = ["in place of", "required, or"];
        let any = of_them.iter().any(|start| self.default.starts_with(start));
        if any {
            quoted(self.default)
        } else {
            Vec::new()
        }
    }

    /// The field with a number at each of its places in turn.
    pub fn values(&self, number: f64, before: Option<&Value>) -> Vec<Value> {
        let integer = self.kind.contains("integer");
        let number = if integer {
            Value::Integer(number as i64)
        } else {
            Value::Float(number)
        };
        let list = |count: usize| {
            let all = before
                .and_then(Value::as_array)
                .filter(|list| list.len() == count);
            let all = all.cloned().unwrap_or_else(|| vec![number.clone(); count]);
            let replaced = |place: usize| {
                let mut all = all.clone();
                all[place] = number.clone();
                Value::Array(all)
            };
            (0..count).map(replaced).collect::<Vec<_>>()
        };
        match self.kind {
            "number" | "integer" => vec![number],
            "number, or per disc" => vec![number.clone(), Value::Array(vec![number; 5])],
            "2 numbers" | "2 integers" => list(2),
            "3 numbers" => list(3),
            "3 numbers, or z" => [list(3), vec![number]].concat(),
            "list of numbers" => vec![Value::Array(vec![number; 3])],
            "list of [x, y], or table" => {
                vec![Value::Array(vec![Value::Array(vec![number; 2]); 3])]
            }
            other => panic!("no interval of `{other}`"),
        }
    }
}

/// Numbers just within and just beyond the ends of an interval; `None` for other texts.
pub fn ends(interval: &str, integer: bool) -> Option<[Vec<f64>; 2]> {
    let inner = interval.get(1..interval.len().checked_sub(1)?)?;
    if !interval.starts_with(['[', '(']) || !interval.ends_with([']', ')']) {
        return None;
    }
    let number = |text: &str| {
        let factor = if text.contains('π') {
            std::f64::consts::PI
        } else {
            1.0
        };
        let text = match text.trim().trim_end_matches('π') {
            "" => "1",
            text => text,
        };
        factor * text.parse::<f64>().unwrap()
    };
    let (low, high) = inner.split_once(',').unwrap();
    let (low, high) = (number(low), number(high));
    let step = |end: f64| {
        if integer {
            1.0
        } else {
            0.01 * end.abs().max(1e-3)
        }
    };
    let (mut within, mut beyond) = (Vec::new(), Vec::new());
    for (end, closed, outwards) in [
        (low, interval.starts_with('['), -step(low)),
        (high, interval.ends_with(']'), step(high)),
    ] {
        within.push(if closed { end } else { end - outwards });
        beyond.push(if closed { end + outwards } else { end });
    }
    beyond.extend(if integer { None } else { Some(f64::NAN) });
    Some([within, beyond])
}
